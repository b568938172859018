"""What swings, and motions beside it with what is known of it: :class:`MotionsBeside`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness, split_end
from cable_shape.calibration.parameters import VARYING, Parameters, held
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.harness_motion import HarnessMotion
from cable_shape.motion.motion import Motion
from cable_shape.motion.tangents import Pair
from cable_shape.pose import Ends, FreeEnd, Grip, Pose, as_grip
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.uncertainty.tube_watch import carried, covariance_of
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty, directions_of

#: Cables of which derivatives are told are so much of a standard deviation away.
_NEAR = 1e-3
Links = Mapping[str, Pose] | None
Held = Mapping[str, Grip | FreeEnd]


class _Beside(NamedTuple):
    """A motion one standard deviation away."""

    motion: Motion | HarnessMotion
    at: Array | None  # numbers, of which some may displace the cable in its grips
    grip: str  # that is elsewhere; "": none
    twist: Array  # (6,), by so much


class MotionsBeside:
    """A cable, or harness, that swings, and motions of it one standard deviation away.

    Parameters are those of :class:`MotionTube`.
    """

    def __init__(self, cable: Cable | Harness, uncertainty: Uncertainty, scene: Any = None, **options: Any) -> None:
        checks.instance("uncertainty", uncertainty, (Uncertainty,), "Write Uncertainty(...).")
        self.motion: Motion | HarnessMotion = Motion(cable, scene, **options)
        if cable.tails:
            bound = "tails of a cable that swings have no tube"
            raise ArgumentError.of("tails", sorted(cable.tails), bound, "Leave them, or the uncertainty, out.")
        self.uncertainty, self.trouble = uncertainty, ""  # why the last shape has no tube
        self._scene, self._options = scene, options
        self._known: Any
        self._known, self._steps = (
            uncertainty.harness_parameters(cable) if isinstance(cable, Harness) else uncertainty.parameters(cable)
        )
        self._middle: Array = np.empty(0) if self._known is None else self._known.start
        self._of_grip = {side: directions_of(getattr(uncertainty, side)) for side in ("start", "end")}
        self._beside: list[_Beside] = []
        self._lines: list[Array | None] = []  # of these
        self._last: dict[str, Tube] = {}
        for step in self._steps:  # before a motion begins
            self._made(self._middle + step), self._made(self._middle - step)

    def follow(self, ends: Ends | Mapping[str, End], links: Links, dt: float | None = None) -> None:
        """Goes along with what the motion has just done: a step dt [s], or, without, the beginning."""
        there = _named(ends)
        if dt is None:
            self._begin(there)
        self._lines = []
        for beside in self._beside:
            shape = self._stepped(beside, self._moved(beside, there), links, dt)
            self._lines.append(_line(shape) if shape is not None and shape.status else None)

    def told(self, shape: CableShape | HarnessShape) -> dict[str, Tube]:
        """:meth:`tubes`; where they are not known, ones that are NaN."""
        found = self.tubes(shape)
        if found:
            return found
        level = self.uncertainty.confidence
        return {
            name: Tube(one, np.full((one.points, 3, 3), np.nan), np.full(one.points, np.nan), level, 0.0)
            for name, one in _parts(shape).items()
        }

    def tubes(self, shape: CableShape | HarnessShape) -> dict[str, Tube]:
        """The tubes of the motion's last shape, of a cable by "", of a harness by segment; none where not known."""
        if shape.reused and self._last:
            self._last = {name: replace(tube, shape=one) for (name, tube), one in zip(
                self._last.items(), _parts(shape).values(), strict=True)}  # fmt: skip
            return self._last
        self.trouble, self._last = "", {}
        if not shape.status:
            self.trouble = "there is no usable shape"
            return {}
        if any(one is None and other is None for one, other in zip(self._lines[0::2], self._lines[1::2], strict=True)):
            self.trouble = "motions one standard deviation away have no usable shape"
            return {}
        whole = _line(shape)
        answers = np.empty((len(whole), 3, 0))
        if self.motion.traced:
            told = self.motion.sensitivity()
            answers = np.concatenate(list(told.values())) if isinstance(told, dict) else told
        covariance = covariance_of(self._lines, whole, answers, np.eye(answers.shape[2]))
        for i, (name, one) in enumerate(_parts(shape).items()):
            own = np.ascontiguousarray(covariance[i * one.points : (i + 1) * one.points])
            radius = self.uncertainty.radius(own, one.tangents)
            self._last[name] = Tube(one, own, radius, self.uncertainty.confidence, 0.0)
        return self._last

    # -- what is beside

    def _begin(self, ends: Held) -> None:
        """Which errors derivatives are carried along for, and which have motions of their own."""
        errors = [
            (name, twist)
            for name, end in ends.items()
            if isinstance(end, Grip)
            for twist in self._of_grip[split_end(name)[1] if "." in name else name]
        ]
        known = self._known
        smooth = isinstance(known, Parameters) and not set(VARYING) & set(known.names)
        pairs: dict[int, Pair] = {}
        self._beside = []
        if self.motion.traceable:
            if smooth:
                pairs = {j: (self._pair(_NEAR * step), _NEAR, 1.0) for j, step in enumerate(self._steps)}
            self._trace(pairs, errors)
            errors = []
        steps: Sequence[Array] = () if pairs else list(self._steps)
        for step in steps:
            for at in (self._middle + step, self._middle - step):
                self._beside.append(_Beside(Motion(self._made(at), self._scene, **self._options), at, "", np.zeros(6)))
        for name, twist in errors:
            for sign in (1.0, -1.0):
                motion = Motion(self._made(self._middle), self._scene, **self._options)
                self._beside.append(_Beside(motion, None, name, sign * twist))

    def _trace(self, pairs: Mapping[int, Pair], errors: Sequence[tuple[str, Array]]) -> None:
        """Has the motion carry derivatives along."""
        knots, count = self.motion.knots
        first = len(pairs)
        offsets = [self._displaced(_NEAR * step) for step in self._steps] if pairs else []

        def moves(_: float) -> Array:
            out = np.zeros((first + len(errors), count, 6))
            now = self.motion.held
            for j, both in enumerate(offsets):
                for name, (above, below) in both.items():
                    out[j, knots[name]] = _between(held(now[name], above), held(now[name], below)) / (2.0 * _NEAR)
            for j, (name, twist) in enumerate(errors, first):
                out[j, knots[name]] = carried(now[name], twist[:, None])[:, 0]
            return out

        if isinstance(self.motion, Motion):
            self.motion.trace(pairs, moves)
        else:
            self.motion.trace(moves)

    def _displaced(self, step: Array) -> dict[str, tuple[Pose | None, Pose | None]]:
        """By how much a cable lies elsewhere in its grips, a step of its numbers above and below; where it does."""
        found = {}
        for side in ("start", "end"):
            both = self._known.offset(self._middle + step, side), self._known.offset(self._middle - step, side)
            if both != (None, None):
                found[side] = both
        return found

    def _pair(self, step: Array) -> tuple[Cable, Cable]:
        """Cables above and below."""
        return self._known.make_cable(self._middle + step), self._known.make_cable(self._middle - step)

    def _made(self, at: Array) -> Any:
        """The cable, or harness, of these numbers."""
        try:
            if self._known is None:
                return self.motion.cable if isinstance(self.motion, Motion) else self.motion.harness
            return self._known.make_cable(at) if isinstance(self._known, Parameters) else self._known.make(at)
        except ArgumentError as error:
            raise ArgumentError(f"uncertainty, one standard deviation away: {error}") from None

    def _moved(self, beside: _Beside, ends: Held) -> dict[str, Any]:
        """Where a motion beside is held."""
        there: dict[str, Any] = dict(ends)
        if beside.at is not None and isinstance(self._known, Parameters):
            there = {side: held(end, self._known.offset(beside.at, side)) for side, end in ends.items()}
        elif beside.at is not None:
            there = dict(self._known.held(beside.at, there))
        if beside.grip:
            there[beside.grip] = _twisted(there[beside.grip], beside.twist)
        return there

    @staticmethod
    def _stepped(beside: _Beside, ends: dict[str, Any], links: Links, dt: float | None) -> Any:
        """Its next shape; None if it has none to step from."""
        motion = beside.motion
        if dt is None:
            if isinstance(motion, Motion):
                return motion.begin(ends["start"], ends["end"], links=links)
            return motion.begin(ends, links=links)
        if not motion.alive:
            return None
        if isinstance(motion, Motion):
            return motion.step(ends["start"], ends["end"], dt, links)
        return motion.step(ends, dt, links)


def _named(ends: Ends | Mapping[str, End]) -> dict[str, Grip | FreeEnd]:
    """Ends by name, as what they are."""
    given = ends if isinstance(ends, Mapping) else {"start": ends[0], "end": ends[1]}
    return {
        name: FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip(name, end)
        for name, end in given.items()
    }


def _between(above: Grip | FreeEnd, below: Grip | FreeEnd) -> Array:
    """(6,): way and turn from one end to another, world."""
    if isinstance(above, FreeEnd) or isinstance(below, FreeEnd):
        return np.zeros(6)
    a, b = above.cable_frame, below.cable_frame
    turn = Rotation.from_quat(a.quaternion) * Rotation.from_quat(b.quaternion).inv()
    return np.concatenate((a.position - b.position, turn.as_rotvec()))


def _twisted(grip: Grip, twist: Array) -> Grip:
    """A grip moved and turned about its own origin, world axes."""
    pose = grip.pose
    turn = Rotation.from_rotvec(twist[3:]) * Rotation.from_quat(pose.quaternion)
    return grip.at(Pose(pose.position + twist[:3], turn.as_quat()))


def _parts(shape: CableShape | HarnessShape) -> Mapping[str, CableShape]:
    """A cable by "", segments by their names."""
    return shape.segments if isinstance(shape, HarnessShape) else {"": shape}


def _line(shape: CableShape | HarnessShape) -> Array:
    """(N, 3) [m], all points."""
    return np.concatenate([one.positions for one in _parts(shape).values()])
