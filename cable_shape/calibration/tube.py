"""How far the real cable may be from a predicted centreline: :func:`predict_tube`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.calibration.result import STRAY, Calibration
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.models.rod_common import MODEL
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip
from cable_shape.predictor import predict
from cable_shape.problem import GRAVITY
from cable_shape.shape import CableShape


@final
@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """A predicted shape and how well it is known.

    shape : of the calibrated cable in the calibrated grips.
    covariance : (n, 3, 3) [m^2], of the positions, from what the calibration does not know of its parameters.
    radius : (n,) [m], of the tube that holds a point of the cable with the confidence asked for.
    """

    shape: CableShape
    covariance: Array
    radius: Array


def predict_tube(
    found: Calibration,
    start: Pose | Grip,
    end: Pose | Grip | FreeEnd | None,
    *,
    confidence: float = 0.95,
    acceleration: ArrayLike | None = None,
    gravity: ArrayLike = GRAVITY,
    points: int = 101,
) -> Tube:
    """The shape of a calibrated cable with its uncertainty.

    The radius joins two things in quadrature: the quantile of the misses that the calibration left, stray points left
    out, which is what model and points are off by, and that of the positions by their covariance, first order in the
    parameters, of which the part across the cable counts, as a normal distribution in the plane.

    Raises
    ------
    ArgumentError
        For a calibration from a sag, or with a parameter that its data do not see, and as `cable_shape.predict`.
    """
    share = checks.number("confidence", confidence, above=0.0)
    if share >= 1.0:
        raise ArgumentError.of("confidence", share, "it must be below 1", "Give 0.95 for 95 %.")
    parameters, values, covariance = found.parameters, found.values, found.covariance
    if parameters is None or values is None or covariance is None or not np.isfinite(covariance).all():
        remedy = "Calibrate with observed points, and fit only what they show."
        raise ArgumentError("found: this calibration has no finite covariance. " + remedy)
    near = as_grip("start", start)
    far = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)

    def shape_of(at: Array) -> CableShape:
        grips = _grips(parameters, at, near, far)
        cable = parameters.make_cable(at)
        return predict(cable, *grips, model=MODEL, points=points, gravity=gravity, acceleration=acceleration)

    shape = shape_of(values)
    change = np.empty((points, 3, len(values)))
    for j, parameter in enumerate(parameters.each):
        stepped = values.copy()
        stepped[j] += parameter.step
        change[:, :, j] = (shape_of(stepped).positions - shape.positions) / parameter.step
    spread = np.einsum("nij,jk,nlk->nil", change, covariance, change)
    tangents = shape.tangents
    across = np.eye(3) - tangents[:, :, None] * tangents[:, None, :]
    widest = np.linalg.eigvalsh(across @ spread @ across)[:, -1]
    left = float(np.quantile(found.distances[found.weights > STRAY], share))
    radius = np.sqrt(left**2 - 2.0 * math.log1p(-share) * np.maximum(widest, 0.0))
    return Tube(shape, spread, radius)


def _grips(parameters: Parameters, values: Array, start: Grip, end: Grip | FreeEnd) -> tuple[Grip, Grip | FreeEnd]:
    """The ends as calibrated."""
    near = held(start, parameters.offset(values, "start"))
    assert isinstance(near, Grip)
    return near, held(end, parameters.offset(values, "end"))
