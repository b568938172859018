"""Cables and harnesses of a cycle that swing: steps in time from stamp to stamp, :class:`Dynamic`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Generic, Protocol, TypeVar, cast, final

import numpy as np

from cable_shape.motion.harness_motion import HarnessMotion
from cable_shape.motion.motion import Motion
from cable_shape.motion.run import STEP
from cable_shape.pose import Ends, Grip, Pose, between
from cable_shape.safety.report import Ahead, Clearance
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.uncertainty.motions_beside import MotionsBeside

#: Ways to take a cable between its grips: at rest in every instant, or as it swings.
MOTIONS = ("quasistatic", "dynamic")
QUASISTATIC, DYNAMIC = MOTIONS
#: Every so many steps of a look ahead bodies are looked at.
LOOK = 2
#: [s], the shortest gap that is told of, and the longest that is bridged: after that it begins anew, at rest.
GAP, LONGEST = 0.03, 1.0
#: A gap is more than so many times the median of the last steps, so many of them.
_LATE, _LAST = 2.5, 9

Links = Mapping[str, Pose] | None
Held = Ends | Mapping[str, End]
#: Of a cable, or of a harness.
Shape = TypeVar("Shape", CableShape, HarnessShape)


class Before(Protocol):
    """What one goes on from."""

    @property
    def stamp(self) -> int | None:
        """[ns], of the last step; None: there was none."""

    @property
    def steps(self) -> list[float]:
        """[s], the last ones."""

    @property
    def motion(self) -> Any:
        """That which took them."""


@final
class Dynamic(Generic[Shape]):
    """The motion of one cable or harness, from input to input.

    Steps are those between stamps, in parts of 10 ms at most, in which ends and links go the straight way. Where an
    input is late or missing that is bridged in the same way, and told; after a second it begins anew, at rest.
    """

    def __init__(self, motion: Motion | HarnessMotion | MotionsBeside, load: Any = None) -> None:
        self.load = load  # the distributed load that the motion was made with
        self.tube = motion if isinstance(motion, MotionsBeside) else None  # how well it is known
        self.motion = motion.motion if isinstance(motion, MotionsBeside) else motion
        self.reset()

    def reset(self) -> None:
        """Forgets everything from before: the next shape is at rest."""
        self.stamp: int | None = None  # of the last step that was taken
        self.ends: Held | None = None  # at that
        self.links: Links = None
        self.last: Shape | None = None
        self._kinds: tuple[str, ...] = ()
        self.steps: list[float] = []  # s, the last ones
        self.bridged = 0.0  # s, without input before the last shape; 0: none was missing

    def predict(self, ends: Held, stamp: int, links: Links = None) -> Shape:
        """The shape at a stamp [ns], not older than the last, with the ends, and links that carry bodies, there."""
        self.bridged = 0.0
        last, before = self.last, self.stamp
        seconds = math.nan if before is None else (stamp - before) * 1e-9
        if last is not None and seconds == 0.0:
            again = last.again()
            again.reused = True
            return again
        if last is None or not seconds <= LONGEST or _kinds(ends) != self._kinds:
            gone = 0.0 if last is None or not seconds > LONGEST else seconds
            self.reset()
            shape: Shape = self._begun(ends, links)
            if shape.status:
                self._take(shape, ends, links, stamp)
                self.bridged = gone
            return shape
        if len(self.steps) > 1 and seconds > GAP and seconds > _LATE * float(np.median(self.steps)):
            self.bridged = seconds
        shape = self._step(last, ends, links, stamp, seconds)
        if shape.status and not self.bridged:
            self.steps = [*self.steps[1 - _LAST :], seconds]
        return shape

    def go_on_from(self, other: Before, shape: Shape, ends: Held, links: Links) -> None:
        """Goes on as another one would, from a shape with its velocity that is its last one, but for an edit."""
        if other.stamp is None:
            return
        motion: Any = self.motion
        motion.take_up(shape, *self._held(ends), links=links, left_by=other.motion)
        self.steps = other.steps
        self._take(shape, ends, links, other.stamp)

    def _step(self, last: Shape, ends: Held, links: Links, stamp: int, seconds: float) -> Shape:
        """From the last shape to these ends, in parts; what was done of it before one could not be taken stays."""
        begin, placed, ways = self.ends, self.links, max(1, math.ceil(seconds / STEP))
        assert begin is not None
        shape, since = last, stamp - round(1e9 * seconds)
        for k in range(1, ways + 1):
            there = ends if k == ways else _between(begin, ends, k / ways)
            on = links if k == ways or placed is None else links_between(placed, links, k / ways)
            shape = self._one(there, seconds / ways, on)
            if not shape.status:
                break
            self._take(shape, there, on, stamp if k == ways else since + round(1e9 * seconds * k / ways))
        return shape

    def _held(self, ends: Held) -> tuple[Any, ...]:
        """As the motion takes them: those of a harness are one mapping."""
        return (ends,) if isinstance(self.motion, HarnessMotion) else cast("Ends", ends)

    def _begun(self, ends: Held, links: Links) -> Any:
        """The motion's first shape."""
        motion: Any = self.motion
        shape: CableShape | HarnessShape = motion.begin(*self._held(ends), links=links)
        if self.tube is not None and shape.status:
            self.tube.follow(ends, links)
        return shape

    def _one(self, ends: Held, dt: float, links: Links) -> Any:
        """One step of the motion."""
        motion: Any = self.motion
        shape: CableShape | HarnessShape = motion.step(*self._held(ends), dt, links)
        if self.tube is not None and shape.status:
            self.tube.follow(ends, links, dt)
        return shape

    def ahead(self, seconds: float) -> list[tuple[float, Shape]]:
        """Where it swings in that time [s] if its grips stop now: times from now [s] and shapes, those to look at; none
        without a state to go on from."""
        if self.last is None:
            return []
        parts = max(1, math.ceil(seconds / STEP))
        found: Any = enumerate(self.motion.ahead(parts, seconds / parts), 1)
        return [(k * seconds / parts, one) for k, one in found if k % LOOK == 0 or k == parts]

    def _take(self, shape: Shape, ends: Held, links: Links, stamp: int) -> None:
        self.last, self.stamp, self.ends, self._kinds = shape, stamp, ends, _kinds(ends)
        self.links = links


def nearest(ahead: Iterable[tuple[float, CableShape]], check: Callable[[CableShape], Clearance]) -> Ahead | None:
    """Where a cable is nearest to a body of these times [s] and shapes, or the last of them; None: none."""
    found: Ahead | None = None
    for time, shape in ahead:
        body = check(shape).closest
        least = math.inf if found is None or found.body is None else found.body.distance
        if found is None or least == math.inf or (body is not None and body.distance < least):
            found = Ahead(time, shape, body)
    return found


def _kind(end: End | None) -> str:
    """How an end is held."""
    return end.kind if isinstance(end, Grip) else "clamped" if isinstance(end, Pose) else "free"


def _kinds(ends: Held) -> tuple[str, ...]:
    """How the ends are held."""
    if isinstance(ends, Mapping):
        return tuple(f"{name} {_kind(end)}" for name, end in sorted(ends.items()))
    return tuple(_kind(end) for end in ends)


def _between(before: Held, now: Held, x: float) -> Held:
    """The ends at the fraction x of the straight way."""
    if isinstance(now, Mapping):
        assert isinstance(before, Mapping)
        return {name: _part_way(before[name], end, x) for name, end in now.items()}
    assert not isinstance(before, Mapping)
    return _part_way(before[0], now[0], x), _part_way(before[1], now[1], x)  # type: ignore[return-value]


def links_between(before: Mapping[str, Pose], now: Links, x: float) -> Links:
    """The links at the fraction x of the straight way."""
    if now is None:
        return None
    return {name: cast("Pose", _part_way(before.get(name), pose, x)) for name, pose in now.items()}


def _part_way(before: End | None, now: End | None, x: float) -> End | None:
    """The same of one end; what is not held at both ends of the way is as it is now."""
    if not isinstance(now, (Pose, Grip)) or not isinstance(before, (Pose, Grip)):
        return now
    a = before.pose if isinstance(before, Grip) else before
    b = now.pose if isinstance(now, Grip) else now
    pose = Pose.trusted(between(a.array, b.array, x), b.turns)
    return now.at(pose) if isinstance(now, Grip) else pose
