"""What the planner found, as answers of PredictShapes and CheckTrajectory; arrays are copied as wholes."""

from __future__ import annotations

import array
import math
from typing import Any

import numpy as np

from cable_shape.ros.messages import CableViolation, CheckTrajectory, PredictShapes
from cable_shape.shape_batch import ShapeBatch
from cable_shape.trajectory_report import TrajectoryCheck, Violation

#: bits of PredictShapes.arrays -> fields of the answer and of ShapeBatch
ARRAYS = {
    PredictShapes.Request.POSITIONS: "positions",
    PredictShapes.Request.QUATERNIONS: "quaternions",
    PredictShapes.Request.CURVATURE: "curvature",
    PredictShapes.Request.FORCE: "force",
    PredictShapes.Request.MOMENT: "moment",
}


def fill_shapes(response: Any, batch: ShapeBatch, arrays: int) -> None:
    """A batch into a PredictShapes.Response, with those of `ARRAYS` whose bit is set."""
    response.success = True
    response.partial = batch.partial
    response.time = batch.time
    response.points = batch.points
    response.bodies = list(batch.bodies)
    for name in ("done", "status", "usable", "several"):
        setattr(response, name, _bytes(getattr(batch, name)))
    for name in ("energy", "error_estimate", "distances", "used"):
        setattr(response, name, _doubles(getattr(batch, name)))
    for bit, name in ARRAYS.items():
        if arrays & bit:
            setattr(response, name, _doubles(getattr(batch, name)))
    told = sorted(batch.details)
    response.told = array.array("I", told)
    response.texts = [batch.details[row] for row in told]


def fill_check(result: Any, found: TrajectoryCheck) -> None:
    """A check into a CheckTrajectory.Result."""
    result.success = True
    result.valid, result.partial, result.robot_checked = found.valid, found.partial, found.robot_checked
    result.first = violation_message(found.first)
    result.done, result.segments = _bytes(found.done), _bytes(found.segments)
    result.clearance = _doubles(found.clearance)
    wrong = [i for i, violation in enumerate(found.waypoints) if violation is not None]
    result.wrong = array.array("I", wrong)
    result.violations = [violation_message(found.waypoints[i]) for i in wrong]
    result.solved, result.time = found.solved, found.time


def feedback(found: TrajectoryCheck) -> Any:
    """How far a check is."""
    return CheckTrajectory.Feedback(
        waypoint=int(found.done.sum()), waypoints=len(found.done), violated=found.first is not None
    )


def violation_message(violation: Violation | None) -> CableViolation:
    """None becomes a violation without a reason."""
    if violation is None:
        return CableViolation(place=math.nan, time=math.nan, value=math.nan, limit=math.nan, arc_length=math.nan)
    return CableViolation(
        reason=violation.reason.value,
        place=float(violation.place),
        time=float(violation.time),
        text=violation.text,
        value=float(violation.value),
        limit=float(violation.limit),
        other=violation.other,
        arc_length=float(violation.arc_length),
    )


def _doubles(values: Any) -> array.array[float]:
    return array.array("d", np.asarray(values, dtype=np.float64).tobytes())


def _bytes(values: Any) -> array.array[int]:
    return array.array("B", np.asarray(values, dtype=np.uint8).tobytes())
