"""Observations from streams of poses and points, paired by their stamps: :class:`Gatherer`. Knows no ROS."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.calibration.observation import Observation
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import swing
from cable_shape.pose import Grip, Pose, multiply
from cable_shape.solve.problem import GRAVITY

#: Points of one observation; more are thinned out evenly.
MOST_POINTS = 200
#: A cable whose inertial load is above this part of its weight is not at rest; it is looked at once it is.
CALM = 0.1
#: Grips that moved by less than this [m] or this angle [rad] since the last observation show nothing new.
NEW_PLACE, NEW_ANGLE = 0.005, 0.03
_PAIRS, _CLOUDS = 500, 20
#: [s], poses further apart say nothing about the speed now.
_GAP = 0.5


@final
class Gatherer:
    """The newest observations of one cable or harness; all methods may be called from several threads.

    Parameters
    ----------
    cable : Cable or Harness
    grips : sequence of Grip
        Kinds and offsets of start and end, or of all held ends of a harness; their poses do not matter.
    max_skew : int
        [ns], poses and points further apart in time are not of one observation.
    window : int
        Observations that are kept; the oldest go first.
    make : callable, optional
        Makes an observation of poses of the grips, points (m, 3) [m] and arc lengths (m,) [m] or None: of a harness,
        which has none of its own.
    thin : bool
        Whether some of many points do for all of them: not where their order tells what they are.
    """

    def __init__(
        self,
        cable: Cable | Harness,
        grips: Sequence[Grip],
        max_skew: int,
        window: int,
        gravity: ArrayLike = GRAVITY,
        make: Callable[[Sequence[Pose], Array, Array | None], Any] | None = None,
        *,
        thin: bool = True,
    ) -> None:
        self._grips, self._max_skew, self._thin = tuple(grips), max_skew, thin
        self._make = self._of_cable if make is None else make
        weight = float(np.linalg.norm(np.asarray(gravity, dtype=np.float64)))
        self._gravity = weight or math.inf
        cables = [cable] if isinstance(cable, Cable) else list(cable.segments.values())
        self._lever, self._length = max(_lever(one, weight) for one in cables), max(one.length for one in cables)
        count = len(self._grips)
        self._newest: list[tuple[int, Pose] | None] = [None] * count
        self._pairs: deque[tuple[int, tuple[Pose, ...], float]] = deque(maxlen=_PAIRS)
        self._clouds: deque[tuple[int, Array, Array | None]] = deque(maxlen=_CLOUDS)
        self._kept: deque[tuple[int, tuple[Pose, ...], Any]] = deque(maxlen=window)
        self._memory: Array = np.zeros((max(count - 1, 1), swing.MEMORY))  # of each grip with the next one
        self._frames: Array = np.empty((count, 7))  # of the cable at the last pair
        self._lock = threading.Lock()
        self.taken = 0  # observations in all
        self.passed = {"without poses of that time": 0, "while the cable moved": 0, "that show nothing new": 0}

    def pose(self, side: int, stamp: int, pose: Pose) -> None:
        """A gripper's pose; side: its number among the grips; stamp [ns]."""
        with self._lock:
            self._newest[side] = stamp, pose
            told = [one for one in self._newest if one is not None]
            stamps = [at for at, _ in told]
            if len(told) < len(self._grips) or max(stamps) - min(stamps) > self._max_skew:
                return
            self._newest = [None] * len(told)
            paired = min(stamps)
            if self._pairs and paired < self._pairs[-1][0]:  # a clock that was set back
                self._forget()
            before = self._pairs[-1][0] if self._pairs else paired
            poses = tuple(pose for _, pose in told)
            ends = [grip.at(pose) for grip, pose in zip(self._grips, poses, strict=True)]
            frames = np.array([end.cable_frame.array for end in ends])
            ratio = self._ratio(frames, (paired - before) * 1e-9)
            self._pairs.append((paired, poses, ratio))
            self._match()

    def points(self, stamp: int, points: Array, arc_length: Array | None = None) -> None:
        """Points (m, 3) [m] seen on the cable at a `stamp` [ns], with their arc lengths (m,) [m] if these are known."""
        most = min(len(points), MOST_POINTS) if self._thin else len(points)
        chosen = np.unique(np.linspace(0, len(points) - 1, most).round().astype(int))
        with self._lock:
            self._clouds.append((stamp, points[chosen], None if arc_length is None else arc_length[chosen]))
            self._match()

    def observations(self) -> tuple[int, list[Any]]:
        """The stamp of the newest [ns] and all that are kept; 0 and none in the beginning."""
        with self._lock:
            return (self._kept[-1][0] if self._kept else 0), [one for _, _, one in self._kept]

    def _of_cable(self, poses: Sequence[Pose], points: Array, arc_length: Array | None) -> Observation:
        return Observation(self._grips[0].at(poses[0]), self._grips[1].at(poses[1]), points, arc_length)

    def _forget(self) -> None:
        self._pairs.clear()
        self._clouds.clear()
        self._memory[:] = 0.0

    def _ratio(self, frames: Array, seconds: float) -> float:
        """Load of the cable's inertia to its weight with these frames (g, 7), the largest; NaN: not known."""
        before, self._frames = self._frames, frames
        if not 0.0 < seconds <= _GAP:
            self._memory[:] = 0.0
            return math.nan
        moved = [_twist(a, b, seconds) for a, b in zip(before, frames, strict=True)]
        largest = 0.0
        for memory, both in zip(self._memory, pairwise(moved) if len(moved) > 1 else [(*moved, *moved)], strict=True):
            ratio, _ = swing.load_ratio(memory, np.concatenate(both), seconds, self._lever, self._length, self._gravity)
            largest = max(largest, float(ratio)) if memory[swing.SEEN] > 2.0 * swing.SMOOTH else math.nan
        return largest

    def _match(self) -> None:
        """Takes the clouds whose poses have come."""
        while self._clouds and self._pairs and self._pairs[-1][0] >= self._clouds[0][0]:
            stamp, points, arc_length = self._clouds.popleft()
            paired, poses, ratio = min(self._pairs, key=lambda pair: abs(pair[0] - stamp))
            if abs(paired - stamp) > self._max_skew:
                self.passed["without poses of that time"] += 1
            elif not ratio <= CALM:
                self.passed["while the cable moved"] += 1
            else:
                self._take(stamp, poses, points, arc_length)

    def _take(self, stamp: int, poses: tuple[Pose, ...], points: Array, arc_length: Array | None) -> None:
        try:
            seen = self._make(poses, points, arc_length)
        except ArgumentError:  # no point in it is finite
            self.passed["that show nothing new"] += 1
            return
        if self._kept:
            ways = [last.distance(now) for last, now in zip(self._kept[-1][1], poses, strict=True)]
            if max(way for way, _ in ways) < NEW_PLACE and max(angle for _, angle in ways) < NEW_ANGLE:
                self.passed["that show nothing new"] += 1
                return
        self._kept.append((stamp, poses, seen))
        self.taken += 1


def _lever(cable: Cable, gravity: float) -> float:
    """[m], of which an end of a cable turns what is beside it with it."""
    load = cable.linear_density * gravity
    stiff = (cable.mean_bending_stiffness / load) ** (1.0 / 3.0) if load > 0.0 else math.inf
    return min(stiff, 0.5 * cable.length)


def _twist(before: Array, now: Array, seconds: float) -> Array:
    """(6,): mean velocity [m/s] and angular velocity [rad/s], world axes, between two frames (7,)."""
    turn = multiply(now[3:], before[3:] * np.array((-1.0, -1.0, -1.0, 1.0)))
    sine = float(np.linalg.norm(turn[:3]))
    angle = 2.0 * math.atan2(sine, abs(float(turn[3])))
    axis = turn[:3] * (math.copysign(angle, float(turn[3])) / sine if sine > 0.0 else 0.0)
    return np.concatenate((now[:3] - before[:3], axis)) / seconds
