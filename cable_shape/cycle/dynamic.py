"""A cable of a cycle that swings: steps in time from stamp to stamp, :class:`Dynamic`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.motion import Motion
from cable_shape.pose import Ends, FreeEnd, Grip, Pose, between
from cable_shape.safety.report import Ahead, Clearance
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape

#: Ways to take a cable between its grips: at rest in every instant, or as it swings.
MOTIONS = ("quasistatic", "dynamic")
QUASISTATIC, DYNAMIC = MOTIONS
#: Every so many steps of a look ahead bodies are looked at.
LOOK = 2
#: [s], the longest single step, the shortest gap that is told of, and the longest that is bridged: after that it begins
#: anew, at rest.
STEP, GAP, LONGEST = 0.0105, 0.03, 1.0
#: A gap is more than so many times the median of the last steps, so many of them.
_LATE, _LAST = 2.5, 9


@final
class Dynamic:
    """The motion of one cable, from input to input.

    Steps are those between stamps, in parts of 10 ms at most, in which the ends go the straight way. Where an input is
    late or missing that is bridged in the same way, and told; after a second the cable begins anew, at rest.
    """

    def __init__(self, cable: Cable, scene: Scene, gravity: Array, points: int) -> None:
        if scene.contact == "solve":
            bound = "a cycle in which cables swing knows no contact"
            raise ArgumentError.of("scene.contact", "solve", bound, "Write contact='warn', or motion='quasistatic'.")
        self.motion = Motion(cable, scene, gravity, points)
        self.reset()

    def reset(self) -> None:
        """Forgets everything from before: the next shape is at rest."""
        self._stamp: int | None = None  # of the last step that was taken
        self._ends: Ends | None = None  # at that
        self._last: CableShape | None = None
        self._kinds: tuple[str, ...] = ()
        self._steps: list[float] = []  # s, the last ones
        self.bridged = 0.0  # s, without input before the last shape; 0: none was missing

    def predict(self, ends: Ends, stamp: int) -> CableShape:
        """The shape at a stamp [ns], not older than the last, with the ends there."""
        self.bridged = 0.0
        last, before = self._last, self._stamp
        seconds = math.nan if before is None else (stamp - before) * 1e-9
        if last is not None and seconds == 0.0:
            again = last.again()
            again.reused = True
            return again
        if last is None or not seconds <= LONGEST or _kinds(ends) != self._kinds:
            gone = 0.0 if last is None or not seconds > LONGEST else seconds
            self.reset()
            shape = self.motion.begin(*ends)
            if shape.status:
                self._take(shape, ends, stamp)
                self.bridged = gone
            return shape
        if len(self._steps) > 1 and seconds > max(GAP, _LATE * float(np.median(self._steps))):
            self.bridged = seconds
        shape = self._step(last, ends, stamp, seconds)
        if shape.status and not self.bridged:
            self._steps = [*self._steps[1 - _LAST :], seconds]
        return shape

    def _step(self, last: CableShape, ends: Ends, stamp: int, seconds: float) -> CableShape:
        """From the last shape to these ends, in parts; what was done of it before one could not be taken stays."""
        begin, ways = self._ends, max(1, math.ceil(seconds / STEP))
        assert begin is not None
        shape, since = last, stamp - round(1e9 * seconds)
        for k in range(1, ways + 1):
            there = ends if k == ways else _between(begin, ends, k / ways)
            shape = self.motion.step(*there, seconds / ways)
            if not shape.status:
                break
            self._take(shape, there, stamp if k == ways else since + round(1e9 * seconds * k / ways))
        return shape

    def ahead(self, seconds: float, check: Callable[[CableShape], Clearance]) -> Ahead | None:
        """Where it swings in that time [s] if its grips stop now; None without a state to go on from."""
        if self._last is None or self._ends is None:
            return None
        found: Ahead | None = None
        parts = max(1, math.ceil(seconds / STEP))
        for k, shape in enumerate(self.motion.ahead(parts, seconds / parts), 1):
            if k % LOOK and k < parts:
                continue
            body = check(shape).closest
            time = k * seconds / parts
            nearest = math.inf if found is None or found.body is None else found.body.distance
            if found is None or nearest == math.inf or (body is not None and body.distance < nearest):
                found = Ahead(time, shape, body)
        return found

    def _take(self, shape: CableShape, ends: Ends, stamp: int) -> None:
        self._last, self._stamp, self._ends, self._kinds = shape, stamp, ends, _kinds(ends)


def _kinds(ends: Ends) -> tuple[str, ...]:
    """How the ends are held."""
    return tuple(end.kind if isinstance(end, Grip) else "clamped" if isinstance(end, Pose) else "free" for end in ends)


def _between(before: Ends, now: Ends, x: float) -> Ends:
    """The ends at the fraction x of the straight way."""
    (a, b), (c, d) = before, now
    return _part_way(a, c, x), d if d is None or isinstance(d, FreeEnd) or isinstance(b, FreeEnd) else _part_way(
        b, d, x
    )


def _part_way(before: Pose | Grip | None, now: Pose | Grip, x: float) -> Pose | Grip:
    """The same of a grip."""
    a = before.pose if isinstance(before, Grip) else before
    b = now.pose if isinstance(now, Grip) else now
    pose = b if a is None else Pose.trusted(between(a.array, b.array, x), b.turns)
    return now.at(pose) if isinstance(now, Grip) else pose
