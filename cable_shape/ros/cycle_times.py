"""When the last cycles ended and what they took: :class:`CycleTimes`. Knows no ROS."""

from __future__ import annotations

from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.messages.pairing import SECOND

#: Cycles that are kept: five seconds at 500 Hz.
MOST_CYCLES = 2500


@final
class CycleTimes:
    """The newest `MOST_CYCLES` cycles; times of ending are in nanoseconds of the node's clock."""

    def __init__(self) -> None:
        self._ends = np.zeros(MOST_CYCLES, dtype=np.int64)
        self._seconds = np.full(MOST_CYCLES, np.nan)
        self._count = 0

    @property
    def last_end(self) -> int:
        """[ns], 0 before the first cycle."""
        return int(self._ends[(self._count - 1) % MOST_CYCLES])

    def add(self, seconds: float, now: int) -> None:
        """A cycle that took `seconds` has ended."""
        i = self._count % MOST_CYCLES
        self._ends[i] = now
        self._seconds[i] = seconds
        self._count += 1

    def within(self, window: float, now: int) -> Array:
        """[s], what each cycle took that ended in the last `window` [s]."""
        kept = min(self._count, MOST_CYCLES)
        age = now - self._ends[:kept]
        return self._seconds[:kept][(age >= 0) & (age < window * SECOND)]
