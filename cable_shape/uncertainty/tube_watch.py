"""Every shape with its tube: :class:`TubeWatch`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.calibration.result import Found
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.safety import spread as tube
from cable_shape.pose import Ends, FreeEnd, Grip, Pose, as_grip
from cable_shape.prediction.carried import stretched
from cable_shape.prediction.predictor import Predictor
from cable_shape.prediction.tails import Tail
from cable_shape.shape import CableShape
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.quasistatic import inertia_of
from cable_shape.uncertainty.hanging import TAIL_OPTIONS, hanging, tail_answers, turned_by
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty, directions_of

#: Load of the rods that show how a shape answers its inertia, as a fraction of the weight.
STEP = 0.25
#: Standard deviation of the inertial load along each axis, as a fraction of the ratio that is told: that of loads of
#: this size in all directions.
SHARE = 3.0**-0.5
#: Part of a given acceleration that stands for what is wrong with it, and with the model of a cable that moves.
LEFT = 0.6


def left_out(known: Uncertainty | Found, acceleration: ArrayLike, gravity: ArrayLike = GRAVITY) -> float:
    """The load that a prediction with this acceleration leaves out, as a fraction of the weight: a part of what it has
    beyond the accelerations of the data of a calibration, whose misses tell of these already."""
    return LEFT * math.sqrt(max(inertia_of(acceleration, gravity) ** 2 - known.inertia**2, 0.0))


class _Beside(NamedTuple):
    """A cable one standard deviation away, or under another load, where it is held beside its grips, and its tails."""

    rod: Predictor
    offsets: dict[str, Pose | None]
    tails: dict[str, Tail]


#: Ends and shape of one beside.
_Line = tuple[dict[str, Grip | FreeEnd], CableShape]


@final
class TubeWatch:
    """The covariance of one cable's shapes, first order in the grips' poses and of second order in the cable's numbers.

    Poses count through the rod's sensitivity. Of the cable each principal direction of what is not known has two
    rods of its own, one standard deviation to either side, that are warm and move along: half their difference is
    how far the shape moves. Where one of the two has no usable shape (it is too short to reach, say), how far the
    other is from the prediction counts. What is not known of other cables that it touches is left out. Tails go
    with the frames that hold them: with the grip where it clamps the cable, with the tangent of the span where it
    lets it turn.

    A moving cable bears its inertia, which a prediction leaves out. How large that load is at most is told by the
    motion of the grips (:mod:`cable_shape.solve.quasistatic`), its direction is not: it counts as one that is the same
    all along the cable and normally distributed, alike in all directions. Three more rods, each with a load along one
    axis, show how the shape answers it, to first order.

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
        self._answers: Array = np.empty((0, 3, 12))  # of the last span to its ends
        self._ways: Array = self._poses  # how these move
        self._links: Mapping[str, Pose] | None = None  # at the last shape
        self._lines: list[_Line] = []  # of `_beside`
        self._swung: list[_Line] = []  # of `_loaded`; none before they are asked for
        self._forget()
        given: Parameters | None
        if parameters is None:
            given, steps = uncertainty.parameters(cable)
        else:
            given, steps = parameters, directions_of(uncertainty.covariance)
        middle = np.empty(0) if given is None else given.start if values is None else values
        hanging: dict[str, Any] = {key: options[key] for key in TAIL_OPTIONS if key in options}
        own = {side: Tail(cable, side, long, **hanging).predictor for side, long in cable.tails.items()}

        def beside(at: Array, **changes: Any) -> _Beside:
            """The cable with these numbers, and with other options."""
            changed = cable if given is None else given.make_cable(at)
            tails = {
                side: Tail(changed, side, long, own_points=own[side].problem.points, **{**hanging, **changes})
                for side, long in cable.tails.items()
            }
            offsets = {side: None if given is None else given.offset(at, side) for side in ("start", "end")}
            return _Beside(Predictor(changed, model=MODEL, **{**options, **changes}), offsets, tails)

        try:
            self._beside = [beside(at) for step in steps for at in (middle + step, middle - step)]
        except ArgumentError as error:
            raise ArgumentError(f"uncertainty, one standard deviation away: {error}") from None
        gravity = checks.vector("gravity", options.get("gravity", GRAVITY), 3, "m/s^2")
        size = float(np.linalg.norm(gravity))
        loads = STEP * size * np.eye(3) if size > 0.0 else np.empty((0, 3))
        self._loaded = [beside(middle, gravity=gravity + load) for load in loads]

    def reset(self) -> None:
        """Forgets the last shape."""
        self._forget()
        for rod, _, tails in (*self._beside, *self._loaded):
            rod.reset()
            for tail in tails.values():
                tail.reset()

    def begin(self, shape: CableShape, ends: Ends, links: Mapping[str, Pose] | None) -> None:
        """Has all rods go on from a shape between these ends, so that they are on its branch."""
        for rod, _, _ in (*self._beside, *self._loaded):
            rod.begin(stretched(shape, rod.cable.length), ends, links)
            rod.head_for()

    def _forget(self) -> None:
        self._last: Tube | None = None
        self._still: Array | None = None  # covariance of the last span without its inertia
        self._swing: Array | None = None  # of the last span by its inertia, for a ratio of 1
        self._tails: dict[str, tuple[Array, Array | None]] = {}  # the same of its tails, by side

    def tube(
        self,
        predictor: Predictor,
        shape: CableShape,
        ends: Ends,
        links: Mapping[str, Pose] | None = None,
        acceleration: ArrayLike | None = None,
        inertia: float = math.nan,
    ) -> Tube | None:
        """The tube of the shape that `predictor` has just given between these ends; None where it is not known.

        `trouble` says why then. Where a rod beside it takes another stable shape, the tube is as wide as that is far.
        inertia: the load that the shape leaves out, as a fraction of the weight; NaN: it is not known, and the tube is
        that of a cable at rest. Look at `Tube.holds`.
        """
        if not math.isnan(inertia):
            inertia = checks.number("inertia", inertia, at_least=0.0)
        if inertia > 0.0 and not self._loaded:
            remedy = "Give a gravity, or leave it out."
            raise ArgumentError.of("inertia", inertia, "without gravity there is no weight to compare it with", remedy)
        self.trouble, self._links = "", links
        if not shape.reused or self._still is None:
            self._forget()
            self._still = self._at_rest(predictor, shape, ends, links, acceleration)
            self._swung = []
        if self._still is not None and inertia > 0.0 and self._swing is None:
            self._swung = self._predict(predictor, self._loaded, ends, links, acceleration)
            if all(line.status for _, line in self._swung):
                self._swing = loaded([line.positions for _, line in self._swung], shape.positions)
            else:
                self.trouble = "under its inertia the cable has no usable shape"
                self._still = None
        if self._still is None:
            self._last = None
        elif self._last is not None and (self._last.inertia == inertia or both_nan(self._last.inertia, inertia)):
            self._last = replace(self._last, shape=shape)
        else:
            self._last = self._tube(shape, self._still, self._swing, inertia)
        return self._last

    def _at_rest(
        self,
        predictor: Predictor,
        shape: CableShape,
        ends: Ends,
        links: Mapping[str, Pose] | None,
        acceleration: ArrayLike | None,
    ) -> Array | None:
        """(n, 3, 3) [m^2], of a shape that leaves no inertia out; None, and `trouble`, where it is not known."""
        if not shape.status:
            self.trouble = "there is no usable shape"
            return None
        if self._poses.shape[1]:
            held_by = _held(ends)
            self._answers = predictor.sensitivity()
            self._ways = np.concatenate(
                (carried(held_by["start"], self._poses[:6]), carried(held_by["end"], self._poses[6:]))
            )
        self._lines = self._predict(predictor, self._beside, ends, links, acceleration)
        lines = [line.positions if line.status else None for _, line in self._lines]
        if any(one is None and other is None for one, other in zip(lines[0::2], lines[1::2], strict=True)):
            self.trouble = "cables one standard deviation away have no usable shape"
            return None
        return covariance_of(lines, shape.positions, self._answers, self._ways)

    def _predict(
        self,
        predictor: Predictor,
        rods: list[_Beside],
        ends: Ends,
        links: Mapping[str, Pose] | None,
        acceleration: ArrayLike | None,
    ) -> list[_Line]:
        """Where rods beside the predicted one are held, and their shapes."""
        held_by, lines = _held(ends), []
        for rod, offsets, _ in rods:
            there = {side: held(end, offsets[side]) for side, end in held_by.items()}
            start = there["start"]
            assert isinstance(start, Grip)
            lines.append((there, predictor.beside(rod, (start, there["end"]), links, acceleration)))
        return lines

    def tail_tube(self, tail: Tail, shape: CableShape, ends: Ends) -> Tube | None:
        """The tube of the shape that a tail has beyond the last span; None where that has none."""
        if self._last is None or not shape.status:
            return None
        still, swing = self._tails.get(tail.side, (None, None))
        if still is None:
            still = self._tail_covariance(tail, shape, _held(ends))
        if swing is None and self._swing is not None:
            swing = loaded(_hanging(self._swung, self._loaded, tail.side, self._links), shape.positions)
        self._tails[tail.side] = still, swing
        return self._tube(shape, still, swing, self._last.inertia)

    def _tail_covariance(self, tail: Tail, shape: CableShape, ends: Mapping[str, Grip | FreeEnd]) -> Array:
        """(n, 3, 3) [m^2], without its inertia."""
        side, errors = tail.side, self._poses.shape[1]
        grip, root = ends[side], np.empty((6, 0))
        assert isinstance(grip, Grip)
        if errors:
            assert self._last is not None
            twists = self._ways[:6] if side == "start" else self._ways[6:]
            root = turned_by(grip, side, self._last.shape, twists, self._answers, self._ways)
        lines = _hanging(self._lines, self._beside, side, self._links)
        return covariance_of(lines, shape.positions, tail_answers(tail, shape.points, errors), root)

    def _tube(self, shape: CableShape, still: Array, swing: Array | None, inertia: float) -> Tube:
        """From covariances (n, 3, 3) [m^2] without the inertia, and by it for a ratio of 1."""
        covariance = still if swing is None or not inertia > 0.0 else still + inertia**2 * swing
        radius = self.uncertainty.radius(covariance, shape.tangents)
        return Tube(shape, covariance, radius, self.uncertainty.confidence, inertia)


def _held(ends: Ends) -> dict[str, Grip | FreeEnd]:
    """Both ends as what they are, by side."""
    end = ends[1]
    far = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)
    return {"start": as_grip("start", ends[0]), "end": far}


def _hanging(
    lines: list[_Line], rods: list[_Beside], side: str, links: Mapping[str, Pose] | None
) -> list[Array | None]:
    """(n, 3) [m] of the tails that rods beside the predicted one have there; None without a usable shape."""
    beside = []
    for (there, line), (_, _, tails) in zip(lines, rods, strict=True):
        own = there[side]
        assert isinstance(own, Grip)
        beside.append((tails[side], own, line))
    return hanging(beside, links)


def loaded(lines: Sequence[Array | None], middle: Array) -> Array:
    """(n, 3, 3) [m^2]: of a line (n, 3) by its inertia for a ratio of 1, from those loaded by STEP along each axis."""
    out = np.zeros((len(middle), 3, 3))
    steps = np.zeros((len(middle), 3, len(lines)))
    for j, line in enumerate(lines):
        if line is not None:
            steps[:, :, j] = (SHARE / STEP) * (line - middle)
    tube.add_moves(steps, np.eye(len(lines)), out)
    return out


def both_nan(a: float, b: float) -> bool:
    return math.isnan(a) and math.isnan(b)


def carried(end: Grip | FreeEnd, twists: Array) -> Array:
    """(6, m): twists about a gripper's own origin as those about the cable's end, world axes."""
    if isinstance(end, FreeEnd):
        return twists
    x, y, z = (end.cable_frame.position - end.pose.position).tolist()
    if x == y == z == 0.0:
        return twists
    arm = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))  # w x arm
    return np.concatenate((twists[:3] + arm @ twists[3:], twists[3:]))


def covariance_of(lines: list[Array | None], middle: Array, answers: Array, ways: Array) -> Array:
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
