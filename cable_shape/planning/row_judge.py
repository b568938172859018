"""What every row of a batch is judged by: :class:`RowJudge`, clearance and margins, and how a shape becomes a row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels.network import drive
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.safety.allowed import Allowed
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import LOAD_MARGINS, Clearance, WarningKind
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape
from cable_shape.solve.answers import Solved
from cable_shape.solve.problem import Problem


@final
class RowJudge:
    """Clearance and margins of one cable, among the obstacles of a scene that stand still and what `others` names."""

    def __init__(self, cable: Cable, scene: Scene, others: Sequence[str] = ()) -> None:
        bodies = [] if scene.contact == "off" else [body for body in scene.obstacles if body.link is None]
        around = Scene(obstacles=bodies, warn_distance=scene.warn_distance, error_distance=scene.error_distance)
        self.checker = ClearanceChecker(around, cable=cable)
        moving = np.concatenate((self.checker.moving, np.ones(len(others), np.bool_)))
        self.watch = MarginWatch(cable, scene, moving)
        self.names = (*self.checker.names, *others)
        self.allowed = Allowed(scene, cable)

    def batch(self, rows: int, problem: Problem) -> ShapeBatch:
        """Rows of the problem's cable, none of them done."""
        length, clips = problem.cable.length, len(problem.clips)
        return ShapeBatch(rows, problem.points, length, self.names, self.checker.horizon, clips)

    def keep(
        self,
        batch: ShapeBatch,
        row: int,
        shape: CableShape,
        clearance: Clearance,
        state: Solved | None = None,
        held: bool = False,
    ) -> None:
        """Makes a shape and its clearance a row, which is done; held: grips hold both ends."""
        batch.buffer[row] = shape.buffer
        info = batch.info[row]
        info[:] = math.nan
        info[drive.I_ENERGY], error = shape.energy, shape.unread_error
        if callable(error):
            batch.unread_errors[row] = error
        else:
            info[drive.I_ESTIMATE] = error
        info[drive.I_RESIDUAL], info[drive.INFO] = shape.residual, shape.twist
        info[drive.I_FORCE], info[drive.I_MOMENT] = shape.force_error, shape.moment_error
        batch.iterations[row], batch.turns[row] = shape.iterations, shape.turns
        batch.models[row] = shape.model
        batch.missing_length[row] = shape.missing_length
        if shape.supports is not None and len(batch.loads[row]):
            batch.loads[row, 1:-1] = shape.supports
        if len(shape.touches) or shape.frictionless:
            batch.touches[row] = shape.bodies, shape.touches, shape.frictionless
        batch.status[row] = shape.status.value
        if shape.detail:
            batch.details[row] = shape.detail
        batch.tables[row] = math.nan if clearance.table is None else clearance.table
        batch.margin_rows[row] = self.margins_of(
            shape, clearance, batch.radius[row] if batch.radius is not None else None, state, held
        )
        batch.done[row] = True

    def judge_meant(self, batch: ShapeBatch, row: int) -> None:
        """Judges the bodies of a row again whose margins are those of clearance, whatever contact is meant."""
        rows = self.margins_of(batch[row], batch.clearance_of(row), None if batch.radius is None else batch.radius[row])
        batch.margin_rows[row, margins.BODIES :] = rows[margins.BODIES :]

    def keep_others(self, batch: ShapeBatch, row: int, shape: CableShape, clearance: Clearance, known: int) -> None:
        """Adds the clearance from all bodies but the first, `known` ones to a row that is done but for these."""
        if clearance.table is None:
            return
        batch.tables[row, known:] = clearance.table[known:]
        if np.isfinite(clearance.table[known:, 0]).any():
            batch.margin_rows[row, margins.BODIES + known :] = self.margins_of(shape, clearance)[
                margins.BODIES + known :
            ]

    def margins_of(
        self,
        shape: CableShape,
        clearance: Clearance,
        radius: Array | None = None,
        state: Solved | None = None,
        held: bool = False,
    ) -> Array:
        """(6 + m, COLUMNS), NaN where there is none; radius (n,) [m]: of the tube that the clearance is of."""
        swell = 0.0 if radius is None else float(np.nan_to_num(radius).max())
        judged, forces = self.allowed.judged(shape, clearance, None, swell)
        rows = np.full((margins.BODIES + len(self.names), margins.COLUMNS), math.nan)
        self.watch.reset()
        columns: dict[str | WarningKind, int] = {kind: i for i, kind in enumerate(LOAD_MARGINS)}
        columns |= {name: margins.BODIES + i for i, name in enumerate(self.names)}
        for margin in (*self.watch.margins(shape, judged, 0, state=state, held=held), *forces):
            column = columns[margin.other or margin.kind]
            if not margin.used < rows[column, margins.USED]:
                rows[column, : margins.TIME] = margin.used, margin.limit, margin.value, margin.arc_length
        return rows
