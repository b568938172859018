"""A snap before it happens: :func:`predicted_snap` follows a cable along the present motion of its grips,
:class:`SnapWatch` does so when stability is running out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeVar, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.safety.speed import follow
from cable_shape.pose import FreeEnd, Grip, Pose, multiply
from cable_shape.safety.report import Margin
from cable_shape.shape import CableShape, Status
from cable_shape.solve.harness_shape import HarnessShape

#: Solves on the way to the horizon.
STEPS = 8
#: A predicted snap that stands is looked for this much further ahead.
LONGER = 1.25
#: Looks ahead in the time of one horizon.
LOOKS = 10.0

_Shape = TypeVar("_Shape", CableShape, HarnessShape)
#: Between which times [s] a snap lies, and the shape after it, as `predicted_snap` returns them.
Found = tuple[float, float, CableShape | HarnessShape]
#: What looks for a snap within a horizon [s]; None: it does not snap.
Find = Callable[[float], Found | None]


def predicted_snap(
    predict: Callable[[Grip, Grip | FreeEnd], CableShape], ends: tuple[Grip, Grip | FreeEnd], twists: Array,
    horizon: float,
) -> tuple[float, float, CableShape] | None:  # fmt: skip
    """When the cable snaps if its grips keep their speed, and the shape that it then has; None if it does not snap.

    Parameters
    ----------
    predict : callable
        Goes on from the last shape to other ends, see :meth:`cable_shape.Predictor.ahead`.
    ends : (Grip, Grip or FreeEnd)
        Of that shape.
    twists : (12,)
        Velocity [m/s] and angular velocity [rad/s] of the start, then of the end, world axes, about that cable end.
    horizon : float
        [s], how far to look.

    Returns
    -------
    no_sooner, no_later : float
        [s], the snap lies between.
    shape : CableShape
        After it, with the ends where they are at `no_later`.
    """
    start, end = ends

    def shape_at(time: float) -> CableShape:
        return predict(moved(start, twists[:6], time), moved(end, twists[6:], time) if type(end) is Grip else end)

    return first_snap(shape_at, horizon)


def predicted_harness_snap(
    predict: Callable[[Mapping[str, Grip | FreeEnd]], HarnessShape], ends: Mapping[str, Grip | FreeEnd],
    twists: Mapping[str, Array], horizon: float,
) -> tuple[float, float, HarnessShape] | None:  # fmt: skip
    """The same of a harness; twists: (6,) of each held end."""

    def shape_at(time: float) -> HarnessShape:
        return predict({end: moved(how, twists[end], time) if type(how) is Grip else how for end, how in ends.items()})

    return first_snap(shape_at, horizon)


def first_snap(shape_at: Callable[[float], _Shape], horizon: float) -> tuple[float, float, _Shape] | None:
    """Between which times [s] the first snap is, and the shape after it."""
    for k in range(1, STEPS + 1):
        time = horizon * k / STEPS
        shape = shape_at(time)
        if shape.status is Status.SNAPPED:
            return horizon * (k - 1) / STEPS, time, shape
        if not shape.status:
            return None
    return None


@final
class SnapWatch:
    """Looks for a snap when stability says that it may come within the horizon [s], ten times in that time.

    One that was predicted stands as long as stability is running out.
    """

    __slots__ = ("_horizon", "_looked", "_snaps_at", "after", "skipped", "time")

    def __init__(self, horizon: float) -> None:
        self._horizon = horizon
        self.reset()

    def reset(self) -> None:
        """Forgets it."""
        self.after: CableShape | HarnessShape | None = None  # the shape after the snap that is predicted
        self.time = math.nan  # s, until it comes
        self.skipped = False  # there was no need to look for one
        self._looked = self._snaps_at = -math.inf  # ns, when it was looked for, and when it is to come

    def look(
        self,
        stability: Margin | None,
        stamp: int,
        find: Find | None,
    ) -> None:
        """Once a cycle. find: what predicts a snap within a horizon [s]; None: the motion is not known."""
        last, self.after = self.after, None
        horizon = self._horizon * (1.0 if last is None else LONGER)
        self.skipped = horizon > 0.0
        if stability is None or not stability.time_to_limit < horizon or find is None:
            self._looked = -math.inf
            return
        self.after = last
        if not 0.0 <= (stamp - self._looked) * 1e-9 < horizon / LOOKS:
            self.skipped = False
            self._looked = stamp
            time = stability.time_to_limit
            found = find(horizon)
            if found is not None:
                no_sooner, no_later, self.after = found
                time = min(max(time, no_sooner), no_later)
            self._snaps_at = stamp + time * 1e9
        self.time = max(0.0, (self._snaps_at - stamp) * 1e-9)


def moved(grip: Grip, twist: Array, time: float) -> Grip:
    """The grip whose cable end keeps its velocity [m/s] and angular velocity [rad/s] (6,) for `time` [s]."""
    frame = grip.cable_frame
    there = moved_frame(frame.array, twist, time)
    return Grip(Pose(there[:3], there[3:], frame.turns), grip.kind, curvature=grip.curvature)


def twist_between(before: Array, now: Array, seconds: float) -> Array:
    """(6,): velocity [m/s] and angular velocity [rad/s], world axes, of what went from one frame (7,) to another."""
    twists = np.empty(12)
    follow(np.tile(before, 2), np.tile(now, 2), True, seconds, twists)
    return twists[:6]


def moved_frame(frame: Array, twist: Array, time: float) -> Array:
    """(7,): where a frame is that keeps its velocity [m/s] and angular velocity [rad/s] (6,) for `time` [s]."""
    turn = 0.5 * time * twist[3:]
    half = math.sqrt(float(turn @ turn))
    q = np.append(np.sinc(half / math.pi) * turn, math.cos(half))
    return np.concatenate((frame[:3] + time * twist[:3], multiply(q, frame[3:])))
