"""Cycles beside work in other processes: how much later the shape comes with it than without, in turns.

Each node is fed in turns of some seconds, so that whatever else the machine does meets all of them. A round of turns
begins with the node that has nothing beside it; figures are medians over the rounds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from queue import Queue
from typing import NamedTuple, Self, final

import numpy as np
from cell_node import DAY, FedNode

RATE, TURN_S = 250.0, 2.0  # Hz, s
P99_ALLOWED = 1.5  # times that without

ALONG_X = (0.5, 0.5, 0.5, 0.5)


def poses(stamp: int) -> list[tuple[float, ...]]:
    """Left and right at a stamp [ns]: slow enough for a cable at rest, never the same as a tenth of a second before."""
    phase = 1e-9 * (stamp % DAY)
    return [
        (0.0, 0.08 * np.sin(phase), 0.5 + 0.08 * np.cos(phase), *ALONG_X),
        (0.7 + 0.05 * np.sin(0.7 * phase), 0.0, 0.5, *ALONG_X),
    ]


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
    """[ms], of one turn: from the last pose of a round until its shape came, and of the cycle alone; and what came."""

    p50: float
    p99: float
    cycle_p50: float
    cycle_p99: float
    in_time: float  # of the shapes, before the next poses


class Side(NamedTuple):
    """A node, and what goes on beside it while it is fed."""

    name: str
    node: FedNode
    work: Callable[[], AbstractContextManager[None]] = nullcontext


def turn(side: Side, seconds: float = TURN_S) -> Turn:
    """Feeds the node beside its work."""
    with side.work():
        waits = np.array(side.node.feed(poses, RATE, round(seconds * RATE)))
    values = side.node.fresh()
    p50, p99 = np.percentile(1e3 * waits, (50, 99))
    cycle = [float(values[f"cycle time {name} [ms]"]) for name in ("p50", "p99")]
    return Turn(p50, p99, cycle[0], cycle[1], float((waits < 1.0 / RATE).mean()))


def compare(sides: Sequence[Side], rounds: int) -> dict[str, Turn]:
    """Prints a table of all sides, the first of which has nothing beside it; medians over the rounds by name."""
    for side in sides:
        side.node.wait()
        turn(side)
    turns: dict[str, list[Turn]] = {side.name: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            turns[side.name].append(turn(side))
    medians = {name: Turn(*np.median(rows, axis=0).tolist()) for name, rows in turns.items()}
    first = medians[sides[0].name]
    width = max(len(name) for name in medians)
    print(f"| {'beside':{width}} | in time | p50 | p99 ms until the shape came | ratio | cycle p50 | p99 ms | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, m in medians.items():
        each = ", ".join(f"{row.p99:.2f}" for row in turns[name])
        print(
            f"| {name:{width}} | {m.in_time:.1%} | {m.p50:.2f} | {m.p99:.2f} ({each}) | {m.p99 / first.p99:.2f} "
            f"| {m.cycle_p50:.2f} | {m.cycle_p99:.2f} | {m.cycle_p99 / first.cycle_p99:.2f} |"
        )
    return medians
