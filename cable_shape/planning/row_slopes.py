"""How the margins of a row of a batch change with its grips: :class:`RowSlopes`."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from scipy.spatial.transform import Rotation

from cable_shape.checks import Array
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.planning.row_judge import RowJudge
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.prediction.nearby import memory_of, nearby
from cable_shape.prediction.predictor import Predictor

#: Of the length, and [rad]: shapes so far beside are of first order, so that only what margins make of them matters.
STEP = 1e-5
#: Twists of both ends.
COLUMNS = 12


@final
class RowSlopes:
    """Of rows of one cable in one scene, by the shapes on both sides of each.

    They follow from the factors of the row's own solution, and nothing is solved for. A margin that is the worst along
    the cable has the slope at its worst point.
    """

    def __init__(self, judge: RowJudge, cable: Any, keywords: dict[str, Any], acceleration: Any) -> None:
        self._judge, self._acceleration = judge, acceleration
        self._predictor, self._beside = (Predictor(cable, model="cosserat", **keywords) for _ in range(2))
        self._beside.accelerate(acceleration)

    def take(self, batch: ShapeBatch, row: int, start: Grip, end: Grip | FreeEnd) -> None:
        """Puts those of a row into the batch; NaN where there are none."""
        assert batch.slopes is not None
        if not batch.usable[row]:
            return
        predictor, shape = self._predictor, batch[row]
        predictor.begin(shape, (start, end), None)
        predictor.look_again()
        found = predictor.predict(start, end, acceleration=self._acceleration)
        far = np.abs(found.positions - shape.positions).max()
        memory = memory_of(predictor)
        same = 10.0 * predictor.problem.tolerance + shape.error_estimate + found.error_estimate
        if memory is None or not found.status or far > same:
            return
        memory.refresh()
        step = STEP * np.repeat((shape.length, 1.0, shape.length, 1.0), 3)
        for column in range(COLUMNS):
            if column >= COLUMNS // 2 and isinstance(end, FreeEnd):
                batch.slopes[row, :, column] = 0.0
                continue
            used = []
            for sign in (1.0, -1.0):
                self._beside.problem.move(*_moved(start, end, column, sign * step[column]), None)
                found_there = nearby(memory, self._beside.problem)
                if found_there is None:
                    return
                used.append(self._used(found_there[0], isinstance(end, Grip)))
            batch.slopes[row, :, column] = (used[0] - used[1]) / (2.0 * step[column])

    def _used(self, shape: Any, held: bool) -> Array:
        """(6 + m,), of a shape beside; stability and the forces of bodies are not told."""
        clearance = self._judge.checker.check(shape)
        return self._judge.margins_of(shape, clearance, held=held)[:, margins.USED]


def _moved(start: Grip, end: Grip | FreeEnd, column: int, by: float) -> tuple[Grip, Grip | FreeEnd]:
    """Both ends, one of them moved along a world axis [m], or turned about it in the cable's end [rad]."""
    side, part = divmod(column, 6)
    if side == 0:
        return _turned(start, part, by), end
    assert isinstance(end, Grip)
    return start, _turned(end, part, by)


def _turned(grip: Grip, part: int, by: float) -> Grip:
    """A grip whose cable frame is moved."""
    way, pose = np.zeros(3), grip.cable_frame
    way[part % 3] = by
    if part < 3:
        return Grip(Pose(pose.position + way, pose.quaternion), grip.kind)
    turned = Rotation.from_rotvec(way) * Rotation.from_quat(pose.quaternion)
    return Grip(Pose(pose.position, turned.as_quat()), grip.kind)
