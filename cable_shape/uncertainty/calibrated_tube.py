"""How far the real cable may be from a predicted centreline: :func:`predict_tube`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.calibration.parameters import held
from cable_shape.calibration.result import Calibration
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip
from cable_shape.prediction.predictor import Predictor
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.problem import GRAVITY
from cable_shape.uncertainty.tube_watch import TubeWatch, left_out
from cable_shape.uncertainty.uncertainty import CONFIDENCE, Tube, Uncertainty


def predict_tube(
    found: Calibration,
    start: Pose | Grip,
    end: Pose | Grip | FreeEnd | None,
    *,
    confidence: float = CONFIDENCE,
    start_error: ArrayLike = (0.0, 0.0),
    end_error: ArrayLike = (0.0, 0.0),
    acceleration: ArrayLike | None = None,
    inertia: float | None = None,
    gravity: ArrayLike = GRAVITY,
    points: int = 101,
) -> Tube:
    """The shape of a calibrated cable with its uncertainty.

    The radius joins two things in quadrature: the quantile of the misses that the calibration left, stray points left
    out, which is what model and points are off by, and that of the positions by their covariance, of which the part
    across the cable counts, as a normal distribution in the plane. `start_error` and `end_error` are those of the
    grips' poses, as in :class:`cable_shape.Uncertainty`. Where there is no usable shape, covariance and radius are NaN:
    look at its status.

    inertia: the load of the cable's inertia, as a fraction of its weight, that `acceleration` leaves out; 0: the cable
    is at rest. Default: with an `acceleration` 0.6 of what it has beyond those of the calibration, whose misses tell
    of them already; without, it is not known, the tube is that of a cable at rest, and `Tube.holds` is False.

    Raises
    ------
    ArgumentError
        For a calibration with a parameter that its data do not see, and as `cable_shape.predict`.
    """
    remedy = "Of a harness write Cycle({...}, uncertainty=Uncertainty.of(found))."
    checks.instance("found", found, (Calibration,), remedy)
    uncertainty = Uncertainty.of(found, start_error, end_error, confidence=confidence)
    near = as_grip("start", start)
    far = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)
    if found.parameters is not None and found.values is not None:
        shifted = held(near, found.parameters.offset(found.values, "start"))
        assert isinstance(shifted, Grip)
        ends = shifted, held(far, found.parameters.offset(found.values, "end"))
    else:
        ends = near, far
    if inertia is not None:
        inertia = checks.number("inertia", inertia, at_least=0.0)
    else:
        inertia = math.nan if acceleration is None else left_out(found, acceleration, gravity)
    predictor = Predictor(found.cable, model=MODEL, points=points, gravity=gravity)
    watch = TubeWatch(found.cable, uncertainty, found.parameters, found.values, points=points, gravity=gravity)
    shape = predictor.predict(*ends, acceleration=acceleration)
    tube = watch.tube(predictor, shape, (near, far), acceleration=acceleration, inertia=inertia)
    if tube is None:
        return Tube(shape, np.full((points, 3, 3), np.nan), np.full(points, np.nan), uncertainty.confidence)
    return tube
