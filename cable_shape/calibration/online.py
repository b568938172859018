"""Observations from streams of poses and points, paired by their stamps: :class:`Gatherer`. Knows no ROS."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import Cable
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
    """The newest observations of one cable; all methods may be called from several threads.

    Parameters
    ----------
    cable : Cable
    grips : (Grip, Grip)
        Kinds and offsets of start and end; their poses do not matter.
    max_skew : int
        [ns], poses and points further apart in time are not of one observation.
    window : int
        Observations that are kept; the oldest go first.
    """

    def __init__(
        self, cable: Cable, grips: tuple[Grip, Grip], max_skew: int, window: int, gravity: ArrayLike = GRAVITY
    ) -> None:
        self._cable, self._grips, self._max_skew = cable, grips, max_skew
        weight = float(np.linalg.norm(np.asarray(gravity, dtype=np.float64)))
        self._gravity = weight or math.inf
        load = cable.linear_density * weight
        stiff = (cable.mean_bending_stiffness / load) ** (1.0 / 3.0) if load > 0.0 else math.inf
        self._lever = min(stiff, 0.5 * cable.length)
        self._newest: list[tuple[int, Pose] | None] = [None, None]
        self._pairs: deque[tuple[int, Pose, Pose, float]] = deque(maxlen=_PAIRS)
        self._clouds: deque[tuple[int, Array, Array | None]] = deque(maxlen=_CLOUDS)
        self._kept: deque[tuple[int, Observation]] = deque(maxlen=window)
        self._memory: Array = np.zeros(swing.MEMORY)
        self._frames: Array = np.empty((2, 7))  # of the cable at the last pair
        self._lock = threading.Lock()
        self.taken = 0  # observations in all
        self.passed = {"without poses of that time": 0, "while the cable moved": 0, "that show nothing new": 0}

    def pose(self, side: int, stamp: int, pose: Pose) -> None:
        """A gripper's pose; side 0: start, 1: end; stamp [ns]."""
        with self._lock:
            self._newest[side] = stamp, pose
            left, right = self._newest
            if left is None or right is None or abs(left[0] - right[0]) > self._max_skew:
                return
            self._newest = [None, None]
            paired = min(left[0], right[0])
            if self._pairs and paired < self._pairs[-1][0]:  # a clock that was set back
                self._forget()
            before = self._pairs[-1][0] if self._pairs else paired
            ends = self._grips[0].at(left[1]), self._grips[1].at(right[1])
            frames = np.array([end.cable_frame.array for end in ends])
            ratio = self._ratio(frames, (paired - before) * 1e-9)
            self._pairs.append((paired, left[1], right[1], ratio))
            self._match()

    def points(self, stamp: int, points: Array, arc_length: Array | None = None) -> None:
        """Points (m, 3) [m] seen on the cable at a `stamp` [ns], with their arc lengths (m,) [m] if these are known."""
        chosen = np.unique(np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).round().astype(int))
        with self._lock:
            self._clouds.append((stamp, points[chosen], None if arc_length is None else arc_length[chosen]))
            self._match()

    def observations(self) -> tuple[int, list[Observation]]:
        """The stamp of the newest [ns] and all that are kept; 0 and none in the beginning."""
        with self._lock:
            return (self._kept[-1][0] if self._kept else 0), [one for _, one in self._kept]

    def _forget(self) -> None:
        self._pairs.clear()
        self._clouds.clear()
        self._memory[:] = 0.0

    def _ratio(self, frames: Array, seconds: float) -> float:
        """Load of the cable's inertia to its weight with these frames (2, 7); NaN: not known."""
        before, self._frames = self._frames, frames
        if not 0.0 < seconds <= _GAP:
            self._memory[:] = 0.0
            return math.nan
        moved = np.concatenate([_twist(a, b, seconds) for a, b in zip(before, frames, strict=True)])
        ratio, _ = swing.load_ratio(self._memory, moved, seconds, self._lever, self._cable.length, self._gravity)
        return float(ratio) if self._memory[swing.SEEN] > 2.0 * swing.SMOOTH else math.nan

    def _match(self) -> None:
        """Takes the clouds whose poses have come."""
        while self._clouds and self._pairs and self._pairs[-1][0] >= self._clouds[0][0]:
            stamp, points, arc_length = self._clouds.popleft()
            paired, start, end, ratio = min(self._pairs, key=lambda pair: abs(pair[0] - stamp))
            if abs(paired - stamp) > self._max_skew:
                self.passed["without poses of that time"] += 1
            elif not ratio <= CALM:
                self.passed["while the cable moved"] += 1
            else:
                self._take(stamp, start, end, points, arc_length)

    def _take(self, stamp: int, start: Pose, end: Pose, points: Array, arc_length: Array | None) -> None:
        try:
            seen = Observation(self._grips[0].at(start), self._grips[1].at(end), points, arc_length)
        except ArgumentError:  # no point in it is finite
            self.passed["that show nothing new"] += 1
            return
        if self._kept:
            last = self._kept[-1][1]
            assert isinstance(last.end, Grip)
            ways = [last.start.pose.distance(start), last.end.pose.distance(end)]
            if max(way for way, _ in ways) < NEW_PLACE and max(angle for _, angle in ways) < NEW_ANGLE:
                self.passed["that show nothing new"] += 1
                return
        self._kept.append((stamp, seen))
        self.taken += 1


def _twist(before: Array, now: Array, seconds: float) -> Array:
    """(6,): mean velocity [m/s] and angular velocity [rad/s], world axes, between two frames (7,)."""
    turn = multiply(now[3:], before[3:] * np.array((-1.0, -1.0, -1.0, 1.0)))
    sine = float(np.linalg.norm(turn[:3]))
    angle = 2.0 * math.atan2(sine, abs(float(turn[3])))
    axis = turn[:3] * (math.copysign(angle, float(turn[3])) / sine if sine > 0.0 else 0.0)
    return np.concatenate((now[:3] - before[:3], axis)) / seconds
