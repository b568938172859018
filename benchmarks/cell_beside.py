"""Cycles of several nodes in turns, with work beside some: how much later the shape comes than with the first of them.

Each node is fed in turns of some seconds, so that whatever else the machine does meets all of them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from queue import Queue
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Self, final

import numpy as np
import rclpy
from cell_node import DAY, FedNode

RATE, TURN_S = 250.0, 2.0  # Hz, s
P99_ALLOWED = 1.5  # times that without

ALONG_X = (0.5, 0.5, 0.5, 0.5)
APART = 0.3  # m, between several cables


@contextmanager
def measuring() -> Iterator[tuple[ExitStack, Path]]:
    """What is closed at the end, and a folder for the time in between; with ROS."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    try:
        with ExitStack() as stack:
            yield stack, Path(stack.enter_context(TemporaryDirectory(prefix="bench_cell_")))
    finally:
        rclpy.try_shutdown()


def poses(stamp: int, cables: int = 1) -> tuple[list[tuple[float, ...]]]:
    """Left and right of each cable at a stamp [ns].

    Slow enough for cables at rest, and never the same as a tenth of a second before.
    """
    rows: list[tuple[float, ...]] = []
    for i in range(cables):
        phase, y = 1e-9 * (stamp % DAY) + i, APART * i
        rows.append((0.0, y + 0.08 * np.sin(phase), 0.5 + 0.08 * np.cos(phase), *ALONG_X))
        rows.append((0.7 + 0.05 * np.sin(0.7 * phase), y, 0.5, *ALONG_X))
    return (rows,)


@final
class Work:
    """A child that works while it is told to: its script is run with `arguments`, see :func:`work_when_told`."""

    def __init__(self, script: str, *arguments: str) -> None:
        self._child = subprocess.Popen(
            [sys.executable, script, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.spent: list[float] = []  # s, of each piece of work

    def _say(self, word: str) -> None:
        assert self._child.stdin is not None
        print(word, file=self._child.stdin, flush=True)

    def _hear(self) -> str:
        assert self._child.stdout is not None
        line = self._child.stdout.readline()
        if not line:
            raise RuntimeError(f"{self._child.args} ended with exit code {self._child.wait()}")
        return line.strip()

    def wait(self) -> Self:
        """Until it can begin."""
        self._hear()
        return self

    @contextmanager
    def going(self) -> Iterator[None]:
        """It works until the end of the block, and that piece to its end."""
        self._say("go")
        self._hear()
        try:
            yield
        finally:
            self._say("stop")
            while (line := self._hear()) != "stopped":
                self.spent.append(float(line))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._child.stdin is not None
        self._child.stdin.close()
        try:
            self._child.wait(30)
        except subprocess.TimeoutExpired:  # it waits for a node that has ended
            self._child.kill()
            self._child.wait()


def work_when_told(piece: Callable[[], float]) -> None:
    """The other side of :class:`Work`: does `piece` again and again, which tells how long it took [s].

    Clients are not what is measured: they make way, as if they were on another machine.
    """
    os.nice(10)
    words: Queue[str] = Queue()

    def listen() -> None:
        for line in sys.stdin:
            words.put(line.strip())
        words.put("end")

    threading.Thread(target=listen, daemon=True).start()
    print("ready", flush=True)
    while words.get() == "go":
        while True:
            print(f"{piece():.4f}", flush=True)
            if not words.empty():
                break
        if words.get() != "stop":
            return
        print("stopped", flush=True)


class Turn(NamedTuple):
    """[ms], of one turn: from the last pose of a round until its shapes came, and of the cycle alone; and what came."""

    in_time: float  # of the shapes, before the next poses
    p50: float
    p99: float
    worst: float
    cycle_p50: float
    cycle_p99: float
    overtaken: float  # share of the rounds, that have no shapes of their own


class Side(NamedTuple):
    """A node, what it is fed at a stamp, and what goes on beside it meanwhile."""

    name: str
    node: FedNode
    given: Callable[[int], tuple[Any, ...]] = poses
    work: Callable[[], AbstractContextManager[Any]] = nullcontext


def turn(side: Side, rate: float, seconds: float) -> Turn:
    """Feeds the node beside its work."""
    with side.work():
        waits = np.array(side.node.feed(side.given, rate, round(seconds * rate)))
    values = side.node.fresh()
    p50, p99, worst = np.percentile(1e3 * waits, (50, 99, 100), method="lower")
    cycle = [float(values.get(f"cycle time {name} [ms]", "nan")) for name in ("p50", "p99")]
    overtaken = side.node.overtaken / len(waits)
    return Turn(float((waits < 1.0 / rate).mean()), p50, p99, worst, cycle[0], cycle[1], overtaken)


def compare(sides: Sequence[Side], rounds: int, rate: float = RATE, seconds: float = TURN_S) -> dict[str, Turn]:
    """Prints a table of all sides, with ratios to the first; medians over the rounds by name."""
    for side in sides:
        turn(side, rate, seconds)
    turns: dict[str, list[Turn]] = {side.name: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            turns[side.name].append(turn(side, rate, seconds))
    medians = {name: Turn(*np.median(rows, axis=0).tolist()) for name, rows in turns.items()}
    first = medians[sides[0].name]
    width = max(len(name) for name in medians)
    print(f"\n{rate:g} Hz, {rounds} turns of {seconds:g} s each, medians")
    print(f"| {'':{width}} | in time | p50 | p99 | max ms until the shape came | / first | cycle p50 | p99 ms |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, m in medians.items():
        times = f"{m.p50:.2f} | {m.p99:.2f} | {m.worst:.2f} | {m.p50 / first.p50:.2f}, {m.p99 / first.p99:.2f}"
        print(f"| {name:{width}} | {m.in_time:.1%} | {times} | {m.cycle_p50:.2f} | {m.cycle_p99:.2f} |", flush=True)
    return medians
