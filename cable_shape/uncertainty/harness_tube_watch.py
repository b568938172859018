"""Every shape of a harness with a tube about each segment: :class:`HarnessTubeWatch`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness, split_end
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip, Pose, as_grip
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.tails import Tail
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY
from cable_shape.uncertainty.hanging import TAIL_OPTIONS, hanging, tail_answers, turned_by
from cable_shape.uncertainty.tube_watch import STEP, both_nan, carried, covariance_of, loaded
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty, directions_of

Ends = Mapping[str, End]
#: Ends and shape of one beside.
_Line = tuple[dict[str, End], HarnessShape]


class _Beside(NamedTuple):
    """A harness one standard deviation away, or under another load, its numbers, and its tails."""

    predictor: HarnessPredictor
    at: Array
    tails: dict[str, Tail]


@final
class HarnessTubeWatch:
    """The covariance of one harness's shapes, as :class:`.tube_watch.TubeWatch` has that of a cable.

    Parameters
    ----------
    harness : Harness
    uncertainty : Uncertainty
        Its `start` is that of every grip at a segment's start, `end` that of those at ends; each grip for itself.
    **options
        Keywords of :class:`cable_shape.prediction.harness_predictor.HarnessPredictor`.
    """

    def __init__(self, harness: Harness, uncertainty: Uncertainty, **options: Any) -> None:
        self.uncertainty = uncertainty
        self.trouble = ""  # why the last shape has no tubes
        self._links: Mapping[str, Pose] | None = None  # at the last shape
        self._known, steps = uncertainty.harness_parameters(harness)
        middle = np.empty(0) if self._known is None else self._known.start
        self._of_grip = {side: directions_of(getattr(uncertainty, side)).T for side in ("start", "end")}
        loads: dict[str, Any] = {key: options[key] for key in TAIL_OPTIONS if key in options}
        own = _tails(harness, loads)
        points = {end: tail.predictor.problem.points for end, tail in own.items()}

        def beside(at: Array, **changes: Any) -> _Beside:
            """The harness with these numbers, and with other options."""
            made = harness if self._known is None else self._known.make(at)
            return _Beside(
                HarnessPredictor(made, **{**options, **changes}), at, _tails(made, {**loads, **changes}, points)
            )

        try:
            self._beside = [beside(at) for step in steps for at in (middle + step, middle - step)]
        except ArgumentError as error:
            raise ArgumentError(f"uncertainty, one standard deviation away: {error}") from None
        gravity = checks.vector("gravity", options.get("gravity", GRAVITY), 3, "m/s^2")
        size = float(np.linalg.norm(gravity))
        along = STEP * size * np.eye(3) if size > 0.0 else np.empty((0, 3))
        self._loaded = [beside(middle, gravity=gravity + load) for load in along]
        self._forget()

    def reset(self) -> None:
        """Forgets the last shape."""
        self._forget()
        for predictor, _, tails in (*self._beside, *self._loaded):
            predictor.reset()
            for tail in tails.values():
                tail.reset()

    def _forget(self) -> None:
        self._last: dict[str, Tube] = {}
        self._still: Array | None = None  # covariance of the last shape without its inertia
        self._swing: Array | None = None  # by its inertia, for a ratio of 1
        self._answers: dict[str, Array] = {}  # (n, 3, 6 g), of the last shape's segments to its grips
        self._ways: Array = np.empty((0, 0))  # (6 g, m), how these move
        self._grips: tuple[str, ...] = ()
        self._lines: list[_Line] = []  # of `_beside`
        self._swung: list[_Line] = []  # of `_loaded`
        self._hanging: dict[str, tuple[Array, Array | None]] = {}  # covariances of tails, by end

    def tubes(
        self,
        predictor: HarnessPredictor,
        shape: HarnessShape,
        ends: Ends,
        acceleration: Mapping[str, ArrayLike] | None = None,
        inertia: float = math.nan,
        links: Mapping[str, Pose] | None = None,
    ) -> dict[str, Tube]:
        """The tubes of the segments of the shape that `predictor` has just given; none where they are not known.

        inertia: the load that the shape leaves out, as a fraction of the weight; NaN: it is not known, see `Tube`.
        """
        if inertia > 0.0 and not self._loaded:
            bound = "without gravity there is no weight to compare it with"
            raise ArgumentError.of("inertia", inertia, bound, "Give a gravity, or leave it out.")
        self.trouble = ""
        if not shape.reused or self._still is None:
            self._forget()
            self._links = links
            self._still = self._at_rest(predictor, shape, ends, acceleration)
        if self._still is not None and inertia > 0.0 and self._swing is None:
            self._swung = self._predict(predictor, self._loaded, ends, acceleration)
            if all(line.status for _, line in self._swung):
                self._swing = loaded([_line(line) for _, line in self._swung], _line(shape))
            else:
                self.trouble, self._still = "under its inertia the harness has no usable shape", None
        if self._still is None:
            self._last = {}
            return {}
        before = next(iter(self._last.values()), None)
        if before is not None and (before.inertia == inertia or both_nan(before.inertia, inertia)):
            self._last = {name: replace(tube, shape=shape.segments[name]) for name, tube in self._last.items()}
        else:
            self._last = self._tubes(shape, self._still, inertia)
        return self._last

    def _at_rest(
        self, predictor: HarnessPredictor, shape: HarnessShape, ends: Ends, acceleration: Mapping[str, ArrayLike] | None
    ) -> Array | None:
        """(N, 3, 3) [m^2] of the points of all segments, without inertia; None, with `trouble`, where not known."""
        if not shape.status:
            self.trouble = "there is no usable shape"
            return None
        self._grips, self._ways = predictor.grips, self._moves(predictor)
        answers = np.empty((len(_line(shape)), 3, 0))
        if self._ways.shape[1]:
            self._answers = predictor.sensitivity()
            answers = np.concatenate(list(self._answers.values()))
        self._lines = self._predict(predictor, self._beside, ends, acceleration)
        lines = [_line(line) if line.status else None for _, line in self._lines]
        if any(one is None and other is None for one, other in zip(lines[0::2], lines[1::2], strict=True)):
            self.trouble = "harnesses one standard deviation away have no usable shape"
            return None
        return covariance_of(lines, _line(shape), answers, self._ways)

    def _moves(self, predictor: HarnessPredictor) -> Array:
        """(6 g, m): how the held ends move for each independent error of a grip."""
        blocks = []
        for end in predictor.grips:
            held = predictor.problem.ends[end]
            assert isinstance(held, Grip)
            blocks.append(carried(held, self._of_grip[split_end(end)[1]]))
        out = np.zeros((6 * len(blocks), sum(block.shape[1] for block in blocks)))
        column = 0
        for i, block in enumerate(blocks):
            out[6 * i : 6 * i + 6, column : column + block.shape[1]] = block
            column += block.shape[1]
        return out

    def _predict(
        self,
        predictor: HarnessPredictor,
        beside: list[_Beside],
        ends: Ends,
        acceleration: Mapping[str, ArrayLike] | None,
    ) -> list[_Line]:
        """Where harnesses beside the predicted one are held, and their shapes."""
        lines = []
        for one, at, _ in beside:
            held = dict(ends) if self._known is None else self._known.held(at, ends)
            lines.append((held, predictor.predict_beside(one, held, self._links, acceleration)))
        return lines

    def tail_tube(self, end: str, tail: Tail, shape: CableShape, ends: Ends) -> Tube | None:
        """The tube of the shape that the tail at a held end has beyond the last one; None where that has none."""
        segment, side = split_end(end)
        if segment not in self._last or not shape.status:
            return None
        still, swing = self._hanging.get(end, (None, None))
        if still is None:
            errors, root = self._ways.shape[1], np.empty((6, 0))
            if errors:
                row, grip = 6 * self._grips.index(end), as_grip(end, ends[end])  # type: ignore[arg-type]
                span, answers = self._last[segment].shape, self._answers[segment]
                root = turned_by(grip, side, span, self._ways[row : row + 6], answers, self._ways)
            lines = _hanging(self._lines, self._beside, end, self._links)
            still = covariance_of(lines, shape.positions, tail_answers(tail, shape.points, errors), root)
        if swing is None and self._swing is not None:
            swing = loaded(_hanging(self._swung, self._loaded, end, self._links), shape.positions)
        self._hanging[end] = still, swing
        inertia = self._last[segment].inertia
        return self._tube(shape, still if swing is None or not inertia > 0.0 else still + inertia**2 * swing, inertia)

    def _tubes(self, shape: HarnessShape, still: Array, inertia: float) -> dict[str, Tube]:
        covariance = still if self._swing is None or not inertia > 0.0 else still + inertia**2 * self._swing
        out = {}
        for i, (name, segment) in enumerate(shape.segments.items()):
            out[name] = self._tube(segment, covariance[i * shape.points : (i + 1) * shape.points], inertia)
        return out

    def _tube(self, shape: CableShape, covariance: Array, inertia: float) -> Tube:
        known = self.uncertainty
        return Tube(shape, covariance, known.radius(covariance, shape.tangents), known.confidence, inertia)


def _line(shape: HarnessShape) -> Array:
    """(N, 3) [m], the points of all segments."""
    return np.concatenate([segment.positions for segment in shape.segments.values()])


def _tails(harness: Harness, loads: Mapping[str, Any], points: Mapping[str, int] | None = None) -> dict[str, Tail]:
    """Its tails by the ends that they hang beyond; points: of each, in place of their share."""
    out = {}
    for end, long in harness.tails.items():
        segment, side = split_end(end)
        own = None if points is None else points[end]
        out[end] = Tail(harness.segments[segment], side, long, own_points=own, **loads)
    return out


def _hanging(lines: list[_Line], rods: list[_Beside], end: str, links: Mapping[str, Pose] | None) -> list[Array | None]:
    """(n, 3) [m] of the tails that harnesses beside the predicted one have there; None without a usable shape."""
    segment, _ = split_end(end)
    pairs = zip(lines, rods, strict=True)
    beside = ((rod.tails[end], as_grip(end, held[end]), line.segments[segment]) for (held, line), rod in pairs)  # type: ignore[arg-type]
    return hanging(beside, links)
