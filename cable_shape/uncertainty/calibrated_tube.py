"""How far the real cable may be from a predicted centreline: :func:`predict_tube`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.calibration.harness_result import HarnessCalibration
from cable_shape.calibration.parameters import held
from cable_shape.calibration.result import Calibration
from cable_shape.pose import NOT_GIVEN, FreeEnd, Grip, Pose, as_grip, both_given, one_mapping
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import End
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.problem import GRAVITY
from cable_shape.uncertainty.harness_tube_watch import HarnessTubeWatch
from cable_shape.uncertainty.tube_watch import TubeWatch, left_out
from cable_shape.uncertainty.uncertainty import CONFIDENCE, Tube, Uncertainty


@overload
def predict_tube(found: HarnessCalibration, start: Mapping[str, End], **_: Any) -> dict[str, Tube]: ...
@overload
def predict_tube(found: Calibration, start: Pose | Grip, end: Pose | Grip | FreeEnd | None, **_: Any) -> Tube: ...
def predict_tube(  # type: ignore[misc]
    found: Calibration | HarnessCalibration,
    start: Any,
    end: Any = NOT_GIVEN,
    *,
    confidence: float = CONFIDENCE,
    start_error: ArrayLike = (0.0, 0.0),
    end_error: ArrayLike = (0.0, 0.0),
    acceleration: Any = None,
    inertia: float | None = None,
    gravity: ArrayLike = GRAVITY,
    points: int = 101,
) -> Any:
    """The shape of a calibrated cable with its uncertainty; of a calibrated harness that of each segment, by its name.

    The radius joins two things in quadrature: the quantile of the misses that the calibration left, stray points left
    out, which is what model and points are off by, and that of the positions by their covariance, of which the part
    across the cable counts, as a normal distribution in the plane. `start_error` and `end_error` are those of the
    grips' poses, as in :class:`cable_shape.Uncertainty`. Where there is no usable shape, covariance and radius are NaN:
    look at its status.

    inertia: the load of the cable's inertia, as a fraction of its weight, that `acceleration` leaves out; 0: the cable
    is at rest. Default: with an `acceleration` 0.6 of what it has beyond those of the calibration, whose misses tell
    of them already; without, it is not known, the tube is that of a cable at rest, and `Tube.holds` is False.

    Of a harness `start` alone is a mapping of ends, in the poses of the grips, `acceleration` one of segments, and
    `start_error` and `end_error` are those of every grip at a segment's start, and at an end.

    Raises
    ------
    ArgumentError
        For a calibration with a parameter that its data do not see, and as `cable_shape.predict`.
    """
    remedy = "Calibrate a cable, or a harness: cs.calibrate(observations, cable)."
    checks.instance("found", found, (Calibration, HarnessCalibration), remedy)
    uncertainty = Uncertainty.of(found, start_error, end_error, confidence=confidence)
    if inertia is not None:
        inertia = checks.number("inertia", inertia, at_least=0.0)
    if isinstance(found, HarnessCalibration):
        one_mapping(start, () if end is NOT_GIVEN else (end,))
        return _of_harness(found, uncertainty, start, acceleration, inertia, gravity, points)
    both_given("predict_tube(found, start, end)", end)
    near = as_grip("start", start)
    far = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)
    if found.parameters is not None and found.values is not None:
        shifted = held(near, found.parameters.offset(found.values, "start"))
        assert isinstance(shifted, Grip)
        ends = shifted, held(far, found.parameters.offset(found.values, "end"))
    else:
        ends = near, far
    if inertia is None:
        inertia = math.nan if acceleration is None else left_out(found, acceleration, gravity)
    predictor = Predictor(found.cable, model=MODEL, points=points, gravity=gravity)
    watch = TubeWatch(found.cable, uncertainty, found.parameters, found.values, points=points, gravity=gravity)
    shape = predictor.predict(*ends, acceleration=acceleration)
    tube = watch.tube(predictor, shape, (near, far), acceleration=acceleration, inertia=inertia)
    return _unknown(shape, uncertainty) if tube is None else tube


def _of_harness(
    found: HarnessCalibration,
    uncertainty: Uncertainty,
    ends: Mapping[str, End],
    acceleration: Mapping[str, ArrayLike] | None,
    inertia: float | None,
    gravity: ArrayLike,
    points: int,
) -> dict[str, Tube]:
    """The tubes of the segments of a calibrated harness; of its inertia the load of the segment that bears most."""
    predictor = HarnessPredictor(found.harness, points=points, gravity=gravity)
    watch = HarnessTubeWatch(found.harness, uncertainty, points=points, gravity=gravity)
    there = found.held(ends)
    shape = predictor.predict(there, acceleration=acceleration)
    if inertia is None:
        loads = [] if acceleration is None else [left_out(found, a, gravity) for a in acceleration.values()]
        inertia = max(loads, default=math.nan)
    tubes = watch.tubes(predictor, shape, there, acceleration, inertia)
    return {name: tubes.get(name) or _unknown(one, uncertainty) for name, one in shape.segments.items()}


def _unknown(shape: CableShape, uncertainty: Uncertainty) -> Tube:
    """Where there is no usable shape, or none beside it."""
    n = shape.points
    return Tube(shape, np.full((n, 3, 3), np.nan), np.full(n, np.nan), uncertainty.confidence)
