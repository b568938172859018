"""Every shape with its tube: :class:`TubeWatch`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable import Cable
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import tube
from cable_shape.pose import Ends, FreeEnd, Grip, Pose, as_grip
from cable_shape.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.solve.outcome import MODEL
from cable_shape.tails import Tail, held_frame
from cable_shape.uncertainty import Tube, Uncertainty


class _Beside(NamedTuple):
    """A cable one standard deviation away, where it is held beside its grips, and its tails."""

    rod: Predictor
    offsets: dict[str, Pose | None]
    tails: dict[str, Tail]


@final
class TubeWatch:
    """The covariance of one cable's shapes, first order in the grips' poses and of second order in the cable's numbers.

    Poses count through the rod's sensitivity. Of the cable each principal direction of what is not known has two rods
    of its own, one standard deviation to either side, that are warm and move along: half their difference is how far
    the shape moves. Where one of the two has no usable shape (it is too short to reach, say), how far the other is from
    the prediction counts. Tails go with the frames that hold them: with the grip where it clamps the cable, with the
    tangent of the span where it lets it turn.

    Parameters
    ----------
    cable : Cable
        With its tails.
    uncertainty : Uncertainty
    parameters, values : optional
        Of a calibration, and where they are; default: those of the cable, as it is.
    **options
        Keywords of :class:`cable_shape.Predictor`.
    """

    def __init__(
        self,
        cable: Cable,
        uncertainty: Uncertainty,
        parameters: Parameters | None = None,
        values: Array | None = None,
        **options: Any,
    ) -> None:
        if cable.mean_bending_stiffness == 0.0:
            raise ArgumentError.of(
                "uncertainty",
                "of a cable without bending stiffness",
                "it is told by the Cosserat rod",
                "Give a bending stiffness above 0 N m^2, or leave the uncertainty out.",
            )
        self.uncertainty = uncertainty
        self.trouble = ""  # why the last shape has no tube
        self._poses = uncertainty.poses
        self._last: Tube | None = None
        self._spread: dict[str, Array] = {}  # covariance of the last tails, by side
        self._answers: Array = np.empty((0, 3, 12))  # of the last span to its ends
        self._ways: Array = self._poses  # how these move
        self._lines: list[tuple[dict[str, Grip | FreeEnd], CableShape]] = []  # ends and shapes of `_beside`
        self._beside: list[_Beside] = []
        given = uncertainty.parameters(cable) if parameters is None else parameters
        if given is None:
            return
        middle = given.start if values is None else values
        hanging = {key: options[key] for key in ("gravity", "points") if key in options}
        own = {side: Tail(cable, side, long, **hanging).predictor for side, long in cable.tails.items()}
        for step in uncertainty.directions():
            for at in (middle + step, middle - step):
                try:
                    changed = given.make_cable(at)
                    rod = Predictor(changed, model=MODEL, **options)
                except ArgumentError as error:
                    raise ArgumentError(f"uncertainty, one standard deviation away: {error}") from None
                tails = {
                    side: Tail(changed, side, long, own_points=own[side].problem.points, **hanging)
                    for side, long in cable.tails.items()
                }
                offsets = {side: given.offset(at, side) for side in ("start", "end")}
                self._beside.append(_Beside(rod, offsets, tails))

    def reset(self) -> None:
        """Forgets the last shape."""
        self._last = None
        self._spread = {}
        for rod, _, tails in self._beside:
            rod.reset()
            for tail in tails.values():
                tail.reset()

    def tube(
        self,
        predictor: Predictor,
        shape: CableShape,
        ends: Ends,
        links: Mapping[str, Pose] | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Tube | None:
        """The tube of the shape that `predictor` has just given between these ends; None where it is not known.

        `trouble` says why then. Where a rod beside it takes another stable shape, the tube is as wide as that is far.
        """
        self.trouble = ""
        if shape.reused and self._last is not None:
            self._last = Tube(shape, self._last.covariance, self._last.radius, self._last.confidence)
            return self._last
        self._last, self._spread = None, {}
        if not shape.status:
            self.trouble = "there is no usable shape"
            return None
        if predictor.touching and (self._beside or self._poses.shape[1]):
            self.trouble = "the cable touches itself or another one"
            return None
        held_by = _held(ends)
        if self._poses.shape[1]:
            self._answers = predictor.sensitivity()
            self._ways = np.concatenate(
                (_carried(held_by["start"], self._poses[:6]), _carried(held_by["end"], self._poses[6:]))
            )
        self._lines = []
        for rod, offsets, _ in self._beside:
            there = {side: held(end, offsets[side]) for side, end in held_by.items()}
            start = there["start"]
            assert isinstance(start, Grip)
            self._lines.append((there, rod.predict(start, there["end"], links, acceleration=acceleration)))
        lines = [line.positions if line.status else None for _, line in self._lines]
        if any(one is None and other is None for one, other in zip(lines[0::2], lines[1::2], strict=True)):
            self.trouble = "cables one standard deviation away have no usable shape"
            return None
        self._last = self._tube(shape, _covariance(lines, shape.positions, self._answers, self._ways))
        return self._last

    def tail_tube(self, tail: Tail, hanging: CableShape, ends: Ends) -> Tube | None:
        """The tube of the shape that a tail has beyond the last span; None where that has none."""
        if self._last is None or not hanging.status:
            return None
        if tail.side not in self._spread:
            self._spread[tail.side] = self._tail_covariance(tail, hanging, _held(ends))
        return self._tube(hanging, self._spread[tail.side])

    def _tail_covariance(self, tail: Tail, hanging: CableShape, ends: Mapping[str, Grip | FreeEnd]) -> Array:
        """(n, 3, 3) [m^2]."""
        side = tail.side
        grip = ends[side]
        assert isinstance(grip, Grip)
        places = []
        for (there, line), beside in zip(self._lines, self._beside, strict=True):
            own = there[side]
            assert isinstance(own, Grip)
            found = beside.tails[side].predict(held_frame(own, line, side)) if line.status else None
            places.append(found.positions if found is not None and found.status else None)
        root, answers = np.empty((6, 0)), np.empty((hanging.points, 3, 6))
        if self._poses.shape[1]:
            root = self._root(grip, side)
            answers = np.ascontiguousarray(tail.predictor.sensitivity()[:, :, :6])
        return _covariance(places, hanging.positions, answers, root)

    def _root(self, grip: Grip, side: str) -> Array:
        """(6, m): velocity and angular velocity of the frame that holds a tail, for each column of `_poses`."""
        twists = self._ways[:6] if side == "start" else self._ways[6:]
        if grip.kind == "clamped":
            return twists
        assert self._last is not None
        span = self._last.shape
        near = self._answers[:3] if side == "start" else self._answers[:-4:-1]
        answers = near @ self._ways
        apart = span.arc_length[1] if side == "start" else -span.arc_length[1]
        turned = (4.0 * answers[1] - 3.0 * answers[0] - answers[2]) / (2.0 * apart)  # of the tangent, of second order
        along = span.tangents[0 if side == "start" else -1]
        return np.concatenate((twists[:3], np.cross(along, turned, axisb=0, axisc=0)))

    def _tube(self, shape: CableShape, covariance: Array) -> Tube:
        radius = self.uncertainty.radius(covariance, shape.tangents)
        return Tube(shape, covariance, radius, self.uncertainty.confidence)


def _held(ends: Ends) -> dict[str, Grip | FreeEnd]:
    """Both ends as what they are, by side."""
    end = ends[1]
    far = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)
    return {"start": as_grip("start", ends[0]), "end": far}


def _carried(end: Grip | FreeEnd, twists: Array) -> Array:
    """(6, m): twists about a gripper's own origin as those about the cable's end, world axes."""
    if isinstance(end, FreeEnd):
        return twists
    x, y, z = (end.cable_frame.position - end.pose.position).tolist()
    if x == y == z == 0.0:
        return twists
    arm = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))  # w x arm
    return np.concatenate((twists[:3] + arm @ twists[3:], twists[3:]))


def _covariance(lines: list[Array | None], middle: Array, answers: Array, ways: Array) -> Array:
    """(n, 3, 3): of a line (n, 3) with answers (n, 3, k) to what varies as `ways` (k, m), and of the cable's numbers.

    lines: of cables a standard deviation above and below in each direction; half the way between these counts, or that
    from the middle to the only one there is.
    """
    out = np.zeros((len(middle), 3, 3))
    if ways.shape[1]:
        tube.add_moves(answers, ways, out)
    if lines:
        steps = np.empty((len(middle), 3, len(lines) // 2))
        for j, (one, other) in enumerate(zip(lines[0::2], lines[1::2], strict=True)):
            if one is not None and other is not None:
                steps[:, :, j] = 0.5 * (one - other)
            else:
                only = one if one is not None else other
                steps[:, :, j] = 0.0 if only is None else only - middle
        tube.add_moves(steps, np.eye(steps.shape[2]), out)
    return out
