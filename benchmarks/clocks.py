"""How long calls take: medians, of one call or of several in turns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import perf_counter, thread_time
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def clocked(run: Callable[[], T], clock: Callable[[], float] = perf_counter) -> tuple[float, T]:
    """[s] that a call takes, and its result."""
    began = clock()
    found = run()
    return clock() - began, found


def timed(run: Callable[[], object], least: int = 5, seconds: float = 0.05) -> float:
    """Median processor time [s] of a call, repeated at least so often and for so long."""
    spent: list[float] = []
    end = perf_counter() + seconds
    while len(spent) < least or perf_counter() < end:
        spent.append(clocked(run, thread_time)[0])
    return float(np.median(spent))


class Turns:
    """Times [s] of several things that are done in turns, so that other load on the machine meets all of them."""

    def __init__(self, *names: str, clock: Callable[[], float] = perf_counter) -> None:
        self.spent: dict[str, list[float]] = {name: [] for name in names}
        self._clock = clock

    def of(self, name: str, run: Callable[[], T]) -> T:
        """Does it once, and keeps how long that took."""
        seconds, found = clocked(run, self._clock)
        self.spent.setdefault(name, []).append(seconds)
        return found

    @property
    def medians(self) -> Mapping[str, float]:
        """[s] by name."""
        return {name: float(np.median(times)) for name, times in self.spent.items()}

    def percentile(self, name: str, share: float) -> float:
        """[s], that so many per cent of the times are at most."""
        return float(np.percentile(self.spent[name], share))
