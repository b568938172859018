"""Fixtures: nodes that end with the test or with the module."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from harness import Cell, NodeProcess

from cable_shape import warm_up
from cable_shape.shape import Status

CABLE_YAML = "length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ndiameter: 0.008\n"

# Compiled kernels hold copies of those that they call, rounded differently where products and sums were fused, and a
# process uses the copy that it loads first. So this one loads them in the order in which the node's process does.
warm_up()

Start = Callable[..., Cell]
_count = iter(range(10**6))


@pytest.fixture(scope="session")
def cable_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cable of 1.2 m."""
    file = tmp_path_factory.mktemp("cable") / "cable.yaml"
    file.write_text(CABLE_YAML)
    return file


def _starter(folder: Path, cable_file: Path, cells: list[Cell]) -> Start:
    def start(*arguments: str, active: bool = True, fresh: bool = False, **parameters: Any) -> Cell:
        # else a test of the planner takes as long as others keep the cores busy
        given = {"cable_file": cable_file, "workers_make_way": "false", **parameters}
        told = [f"{name.replace('__', '.')}:={value}" for name, value in given.items() if value is not None]
        flags = [flag for one in told for flag in ("-p", one)]
        process = NodeProcess(f"n{os.getpid()}_{next(_count)}", folder, [*flags, *arguments], fresh=fresh)
        cell = Cell(process)
        cells.append(cell)
        if active:
            cell.active()
        return cell

    return start


def _end(cells: list[Cell]) -> None:
    try:
        for cell in cells:
            cell.process.stop()
    finally:
        for cell in cells:
            cell.close()


@pytest.fixture
def start(tmp_path: Path, cable_file: Path) -> Iterator[Start]:
    """Starts nodes that end with the test: start(parameter=value)."""
    cells: list[Cell] = []
    try:
        yield _starter(tmp_path, cable_file, cells)
    finally:
        _end(cells)


@pytest.fixture(scope="session")
def start_for_all(tmp_path_factory: pytest.TempPathFactory, cable_file: Path) -> Iterator[Start]:
    """Like start, for nodes that end with the session."""
    cells: list[Cell] = []
    try:
        yield _starter(tmp_path_factory.mktemp("node"), cable_file, cells)
    finally:
        _end(cells)


@pytest.fixture(scope="session")
def shared(start_for_all: Start) -> Cell:
    """One active node for many tests, which leave it able to predict."""
    return start_for_all(stale_after=0.4, diagnostics_period=0.3)


@pytest.fixture
def cell(shared: Cell) -> Cell:
    """The shared node, predicting, with nothing kept from the test before."""
    if Status(shared.predicted().status) is not Status.OK:  # a snap of the test before is told as long as nothing moves
        shared.shape_at(shared.now(), (0.0, 0.0, 0.501), (0.8, 0.0, 0.5))
        shared.predicted()
    shared.shapes.clear()
    shared.diagnostics.clear()
    return shared
