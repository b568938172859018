"""Every shape of a harness with a tube about each segment: :class:`HarnessTubeWatch`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness, split_end
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY
from cable_shape.uncertainty.tube_watch import STEP, both_nan, carried, covariance_of, loaded
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty, directions_of

Ends = Mapping[str, End]


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
        self._known, steps = uncertainty.harness_parameters(harness)
        middle = np.empty(0) if self._known is None else self._known.start
        self._of_grip = {side: directions_of(getattr(uncertainty, side)).T for side in ("start", "end")}

        def beside(at: Array, **changes: Any) -> tuple[HarnessPredictor, Array]:
            """The harness with these numbers, and with other options."""
            made = harness if self._known is None else self._known.make(at)
            return HarnessPredictor(made, **{**options, **changes}), at

        try:
            self._beside = [beside(at) for step in steps for at in (middle + step, middle - step)]
        except ArgumentError as error:
            raise ArgumentError(f"uncertainty, one standard deviation away: {error}") from None
        gravity = checks.vector("gravity", options.get("gravity", GRAVITY), 3, "m/s^2")
        size = float(np.linalg.norm(gravity))
        loads = STEP * size * np.eye(3) if size > 0.0 else np.empty((0, 3))
        self._loaded = [beside(middle, gravity=gravity + load) for load in loads]
        self._forget()

    def reset(self) -> None:
        """Forgets the last shape."""
        self._forget()
        for predictor, _ in (*self._beside, *self._loaded):
            predictor.reset()

    def _forget(self) -> None:
        self._last: dict[str, Tube] = {}
        self._still: Array | None = None  # covariance of the last shape without its inertia
        self._swing: Array | None = None  # by its inertia, for a ratio of 1

    def tubes(
        self,
        predictor: HarnessPredictor,
        shape: HarnessShape,
        ends: Ends,
        acceleration: Mapping[str, ArrayLike] | None = None,
        inertia: float = math.nan,
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
            self._still = self._at_rest(predictor, shape, ends, acceleration)
        if self._still is not None and inertia > 0.0 and self._swing is None:
            lines = self._lines(self._loaded, ends, acceleration)
            if all(line is not None for line in lines):
                self._swing = loaded(lines, _line(shape))
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
        ways = self._ways(predictor)
        answers = np.empty((len(_line(shape)), 3, 0))
        if ways.shape[1]:
            answers = np.concatenate(list(predictor.sensitivity().values()))
        lines = self._lines(self._beside, ends, acceleration)
        if any(one is None and other is None for one, other in zip(lines[0::2], lines[1::2], strict=True)):
            self.trouble = "harnesses one standard deviation away have no usable shape"
            return None
        return covariance_of(lines, _line(shape), answers, ways)

    def _ways(self, predictor: HarnessPredictor) -> Array:
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

    def _lines(
        self, beside: list[tuple[HarnessPredictor, Array]], ends: Ends, acceleration: Mapping[str, ArrayLike] | None
    ) -> list[Array | None]:
        """(N, 3) [m] of harnesses beside the predicted one; None without a usable shape."""
        lines: list[Array | None] = []
        for predictor, at in beside:
            held = ends if self._known is None else self._known.held(at, ends)
            found = predictor.predict(held, acceleration=acceleration)
            lines.append(_line(found) if found.status else None)
        return lines

    def _tubes(self, shape: HarnessShape, still: Array, inertia: float) -> dict[str, Tube]:
        covariance = still if self._swing is None or not inertia > 0.0 else still + inertia**2 * self._swing
        known, out = self.uncertainty, {}
        for i, (name, segment) in enumerate(shape.segments.items()):
            own = covariance[i * shape.points : (i + 1) * shape.points]
            out[name] = Tube(segment, own, known.radius(own, segment.tangents), known.confidence, inertia)
        return out


def _line(shape: HarnessShape) -> Array:
    """(N, 3) [m], the points of all segments."""
    return np.concatenate([segment.positions for segment in shape.segments.values()])
