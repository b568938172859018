"""What the planner found, as answers of PredictShapes and CheckTrajectory; arrays are copied once, as wholes."""

from __future__ import annotations

import array
import math
from typing import Any

import numpy as np

from cable_shape.planning.harness_batch import HarnessBatch
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.planning.trajectory_report import TrajectoryCheck, Violation
from cable_shape.ros.messages import CableViolation, CheckTrajectory, PredictShapes

#: bits of PredictShapes.arrays -> fields of the answer and of ShapeBatch
ARRAYS = {
    PredictShapes.Request.POSITIONS: "positions",
    PredictShapes.Request.QUATERNIONS: "quaternions",
    PredictShapes.Request.CURVATURE: "curvature",
    PredictShapes.Request.FORCE: "force",
    PredictShapes.Request.MOMENT: "moment",
}


def fill_shapes(response: Any, batch: ShapeBatch | HarnessBatch, arrays: int) -> None:
    """A batch into a PredictShapes.Response, with those of `ARRAYS` whose bit is set."""
    response.success = True
    response.partial = batch.partial
    response.time = batch.time
    response.points = batch.points
    response.bodies = list(batch.bodies)
    for name in ("done", "status", "usable"):
        _put(getattr(response, name), getattr(batch, name), np.uint8)
    _put(response.several, batch.several if isinstance(batch, ShapeBatch) else np.zeros(len(batch)), np.uint8)
    asked = [name for bit, name in ARRAYS.items() if arrays & bit]
    for name in ("energy", "error_estimate", "distances", "used", *asked):
        found = getattr(batch, name)  # of a harness row by row, in a row one segment after the other
        whole = np.stack(list(found.values()), axis=1) if isinstance(found, dict) else found
        _put(getattr(response, name), whole, np.float64)
    told = sorted(batch.details)
    response.told = array.array("I", told)
    response.texts = [batch.details[row] for row in told]


def fill_check(result: Any, found: TrajectoryCheck) -> None:
    """A check into a CheckTrajectory.Result."""
    result.success = True
    result.valid, result.partial, result.robot_checked = found.valid, found.partial, found.robot_checked
    result.first = violation_message(found.first)
    _put(result.done, found.done, np.uint8)
    _put(result.segments, found.segments, np.uint8)
    _put(result.clearance, found.clearance, np.float64)
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


def _put(field: array.array[Any], values: Any, kind: type[np.generic]) -> None:
    """Into a field that is still empty: to assign an array to it would copy the array, megabytes of it."""
    field.frombytes(np.ascontiguousarray(values, dtype=kind).reshape(-1).view(np.uint8))  # type: ignore[arg-type]
