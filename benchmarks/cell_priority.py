"""A node with a real-time priority beside one without, on a machine whose cores are busy: how late their shapes come.

The two nodes are fed in turns by this process, which has a higher priority itself. Beside them run none, one or four
busy processes for each core.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
import yaml
from cell_cables import CABLE, poses
from cell_node import FedNode

TURNS, ROUNDS = 6, 150
#: of the node as in config/systemd/cable_shape.service, and of this process, which must not be late itself
NODE, SELF = 50, 60


def give_priority(process: int, priority: int) -> None:
    """SCHED_FIFO for every thread that the process has; those that it starts have it, too."""
    for thread in os.listdir(f"/proc/{process}/task"):
        os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(priority))


@contextlib.contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many processes without a priority that do nothing but compute."""
    program = "import os; os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))\nwhile True: pass"
    started = [subprocess.Popen([sys.executable, "-S", "-c", program]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def compare(rates: list[float]) -> None:
    """Prints the table."""
    cores = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory(prefix="bench_cell_") as place:
        folder = Path(place)
        (folder / "cable.yaml").write_text(yaml.safe_dump(CABLE))
        given = {"cable_file": folder / "cable.yaml"}
        with FedNode("plain", folder, given) as plain, FedNode("first", folder, given) as first:
            nodes = {"none": plain, f"SCHED_FIFO {NODE}": first}
            for node in nodes.values():
                node.wait()
                node.feed(partial(poses, 1, 25.0), 25.0, ROUNDS)
            give_priority(first.process.pid, NODE)
            give_priority(os.getpid(), SELF)
            print("| rate | busy processes | priority | in time | p50 | p99 | max ms until the shape came |")
            print("| --- | --- | --- | --- | --- | --- | --- |")
            for rate in rates:
                for load in (0, cores, 4 * cores):
                    waits: dict[str, list[float]] = {name: [] for name in nodes}
                    with busy(load):
                        for _ in range(TURNS):
                            for name, node in nodes.items():
                                waits[name] += node.feed(partial(poses, 1, rate), rate, ROUNDS)
                    for name, waited in waits.items():
                        figures = np.percentile(1e3 * np.array(waited), (50, 99, 100), method="lower")
                        answered = np.mean(np.array(waited) < 1.0 / rate)
                        numbers = " | ".join(f"{figure:.2f}" for figure in figures)
                        print(f"| {rate:g} Hz | {load} | {name} | {answered:.1%} | {numbers} |", flush=True)


def run(rates: list[float]) -> bool:
    """See the module."""
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, *before)
    except PermissionError:
        print("A real-time priority needs root, CAP_SYS_NICE or a limit (ulimit -r) of 60 or more.", file=sys.stderr)
        return False
    rclpy.init()
    try:
        compare(rates)
    finally:
        rclpy.try_shutdown()
    return True
