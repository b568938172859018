"""How fast the grips move: :class:`GripSpeed`."""

from __future__ import annotations

import math
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.speed import twists
from cable_shape.pose import FreeEnd, Grip, Pose

#: [s], poses further apart say nothing about the speed now.
LONGEST_GAP = 0.5


@final
class GripSpeed:
    """The mean speed of a cable's two ends between their last two poses."""

    __slots__ = ("_frames", "_spare", "_stamp", "twists")

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets the last poses."""
        self._stamp = -math.inf
        self._frames: Array = np.empty((2, 7))
        self._spare: Array = np.empty((2, 7))
        self.twists: Array | None = None

    def update(self, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, stamp: int) -> Array | None:
        """(12,): velocity [m/s] and angular velocity [rad/s] of the start's cable frame, then of the end's; world axes.

        None while not known: at first, and after a gap in the stamps [ns]. A repeated stamp gives the last answer
        again. Zero for a free end.
        """
        if stamp == self._stamp:
            return self.twists
        frames = self._spare
        frames[0] = _frame(start)
        held = not (end is None or isinstance(end, FreeEnd))
        frames[1] = frames[0] if end is None or isinstance(end, FreeEnd) else _frame(end)
        seconds = (stamp - self._stamp) * 1e-9
        self.twists = None
        if 0.0 < seconds <= LONGEST_GAP:
            self.twists = twists(self._frames, frames, seconds)
            if not held:
                self.twists[6:] = 0.0
        self._frames, self._spare, self._stamp = frames, self._frames, stamp
        return self.twists


def _frame(end: Pose | Grip) -> Array:
    """(7,), of the cable at this end."""
    return end.array if isinstance(end, Pose) else end.cable_frame.array
