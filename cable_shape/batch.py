"""Many grasps at once: :func:`predict_batch`.

The rod starts each row from a shape that was solved at the centre of the row's cell, a cell of a fixed lattice in the
space of grasps (:mod:`cable_shape.kernels.batch_cells`): rows in one cell share that start, its mesh and the factors
that move it, to first order, to the row's own ends (:mod:`cable_shape.kernels.batch_rows`). A row that is not reached
so is solved by itself, from nothing. Either way a row's answer depends on its own ends and on nothing else.
"""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from threading import Lock
from time import perf_counter
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.batch_seed import MESH_TOLERANCE, Seed, seed_at
from cable_shape.batch_tube import BatchTube, check_tube
from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.clearance import ClearanceChecker
from cable_shape.errors import ArgumentError
from cable_shape.kernels import batch_cells, batch_rows, margins, rod_drive
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.margins import MarginWatch
from cable_shape.models import cosserat as rod_of_rows
from cable_shape.models.rod_state import RodState
from cable_shape.pose import Pose
from cable_shape.predictor import Predictor
from cable_shape.problem import GRAVITY, Problem
from cable_shape.report import LOAD_MARGINS
from cable_shape.scene import Scene
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.shape_batch import ShapeBatch
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.uncertainty import Uncertainty

#: More numbers than this are not kept: 8 GB of shapes.
MOST_NUMBERS = 1_000_000_000
MOST_THREADS = 1024
#: Units of the lattice of cells: this fraction of the cable's length, and radians; coarse cells are so much wider.
CELL_REACH, CELL_TURN, COARSER = 0.25, 0.3, 3.0
#: The grips of a cell's shape are at most this fraction of the length apart.
LONGEST_CHORD = 0.95
#: Rows in one task.
TASK_ROWS = 128

#: Codes of `batch_rows.solve_rows` that tell nothing of other shapes.
_ALONE = (CONVERGED, batch_rows.COARSE, batch_rows.LOST, rod_drive.TOO_FAR)

Rows = NDArray[np.int64]


def predict_batch(
    cable: Cable,
    starts: ArrayLike,
    ends: ArrayLike,
    *,
    model: str = "auto",
    gravity: ArrayLike = GRAVITY,
    scene: Scene | None = None,
    points: int = 150,
    tolerance: float | None = None,
    distributed_load: ArrayLike | None = None,
    threads: int | None = None,
    time_limit: float | None = None,
    uncertainty: Uncertainty | None = None,
) -> ShapeBatch:
    """The shapes of one cable for many pairs of clamped ends, with clearance and margins.

    The order of the rows, the other rows and the number of threads change no bit of a row.

    Parameters
    ----------
    starts, ends : (k, 7) array_like
        Position [m] and quaternion x y z w of the cable frame at each end, in the world.
    model, gravity, points, tolerance, scene, distributed_load
        As for :func:`predict`. Other models than the rod, clips and contact are solved row by row and far more
        slowly. Obstacles on robot links are left out.
    threads : int, optional
        Default: as many as there are cores to run on.
    time_limit : float, optional
        [s]; after it what is done is returned, see `done` and `partial`; looked at between tasks of some 10 ms.
    uncertainty : Uncertainty, optional
        Gives every row a tube, to first order in all that is not known, see `ShapeBatch.radius`; distances and what
        they use of their margins are those of the tube then. Of the rod between grips, without clips and contact. The
        poses that are not exactly known are those of `starts` and `ends`.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy; not for the numbers in a row, see `errors`.
    """
    began = perf_counter()
    predictor = Predictor(
        cable,
        model=model,
        gravity=gravity,
        points=points,
        tolerance=tolerance,
        scene=scene,
        distributed_load=distributed_load,
    )
    if threads is None:
        threads = len(os.sched_getaffinity(0))
    threads = checks.integer("threads", threads, at_least=1, at_most=MOST_THREADS)
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    work = _Work(predictor, _table("starts", starts), _table("ends", ends), deadline, uncertainty)
    if model in ("cosserat", "auto") and work.compiled and work.even:
        work.solve_cells(threads)
    work.solve_left()
    batch = work.batch
    for kept in (batch.buffer, batch.info, batch.tables, batch.margin_rows):
        kept[~batch.done] = math.nan
    batch.tables[np.isinf(batch.distances), 1:] = math.nan
    batch.margin_rows[np.isnan(batch.used)] = math.nan
    batch.partial = not bool((batch.done | work.invalid).all())
    batch.time = perf_counter() - began
    return batch


@final
class _CoarseCell:
    """The shape of a coarse cell, made by the first task that needs it."""

    def __init__(self, make: Callable[[], Seed | None]) -> None:
        self._make: Callable[[], Seed | None] | None = make
        self._seed: Seed | None = None
        self._making = Lock()

    def seed(self) -> Seed | None:
        """None if there is no good one."""
        with self._making:
            if self._make is not None:
                self._seed, self._make = self._make(), None
            return self._seed


_Task = tuple[Rows, Rows, _CoarseCell]


@final
class _Work:
    """One call of :func:`predict_batch`."""

    def __init__(
        self, predictor: Predictor, starts: Array, ends: Array, deadline: float, uncertainty: Uncertainty | None
    ) -> None:
        if starts.shape != ends.shape:
            raise ArgumentError.of(
                "ends", f"{len(ends)} rows", f"it must have as many as starts, {len(starts)}", "Give a pose a row."
            )
        problem = predictor.problem
        cable, scene = predictor.cable, predictor.scene or Scene()
        if len(starts) * problem.points * NUMBERS_PER_POINT > MOST_NUMBERS:
            most = MOST_NUMBERS // (problem.points * NUMBERS_PER_POINT)
            raise ArgumentError.of(
                "starts", f"{len(starts)} rows", f"{most} rows of {problem.points} points are allowed", "Split them."
            )
        self.finer: Problem = copy.copy(problem)
        self.finer.tolerance = MESH_TOLERANCE * problem.tolerance
        self.predictor, self.problem, self.deadline = predictor, problem, deadline
        self.starts, self.ends = starts, ends
        self.reach = CELL_REACH * cable.length
        self.longest = math.inf if cable.axial_stiffness is not None else LONGEST_CHORD * cable.length
        self.compiled = cable.mean_bending_stiffness > 0.0 and not problem.clips and scene.contact != "solve"
        self.even = np.ndim(cable.rest_curvature) == 1  # else every kink of the table would be a node
        if uncertainty is not None:
            check_tube(uncertainty, predictor, self.compiled)
        self.tube = BatchTube(cable, uncertainty)
        judged = [] if scene.contact == "off" else [body for body in scene.obstacles if body.link is None]
        self.checker = ClearanceChecker(
            Scene(obstacles=judged, warn_distance=scene.warn_distance, error_distance=scene.error_distance),
            radius=0.5 * cable.diameter,
        )
        self.watch = MarginWatch(cable, scene)
        self.batch = ShapeBatch(len(starts), problem.points, cable.length, self.checker.names, self.checker.horizon)
        if uncertainty is not None:
            self.batch.confidence = uncertainty.confidence
            self.batch.radius = np.full((len(starts), problem.points), math.nan)
        self.invalid: NDArray[np.bool_] = np.zeros(len(starts), np.bool_)
        for name, poses in (("starts", starts), ("ends", ends)):
            self._check(name, poses)
        self.masses: Array = np.empty((len(problem.masses), 4))
        for row, mass in zip(self.masses, problem.masses, strict=True):
            row[0], row[1:] = mass.arc_length, mass.mass * problem.gravity

    def _check(self, name: str, poses: Array) -> None:
        """Normalises the quaternions, and puts rows that are not valid into the errors."""
        given = poses.copy()
        off = np.empty(len(poses))
        batch_cells.normalise(poses, off)
        for row in np.flatnonzero(~(off <= checks.QUATERNION_TOLERANCE)).tolist():
            try:
                Pose(given[row, :3], given[row, 3:])
            except ArgumentError as error:
                self.invalid[row] = True
                self.batch.errors.setdefault(row, ArgumentError(f"{name}[{row}]: {error}"))
                self.batch.details.setdefault(row, f"{name}[{row}]: {error}")

    # -- many rows from one shape

    def solve_cells(self, threads: int) -> None:
        """Every valid row that its cell's shape leads to, in tasks that share nothing but what they read."""
        rows = np.flatnonzero(~self.invalid)
        starts, ends = self.starts[rows], self.ends[rows]
        fine, coarse = np.empty((2, len(rows), batch_cells.DIMENSIONS), np.int64)

        def find(a: int, b: int) -> None:
            batch_cells.keys(starts[a:b], ends[a:b], self.reach, CELL_TURN, COARSER, fine[a:b], coarse[a:b])

        with ThreadPoolExecutor(threads) as pool:
            run = map if threads == 1 else pool.map
            cuts = np.linspace(0, len(rows), threads + 1).astype(int).tolist()
            for _ in run(find, cuts[:-1], cuts[1:]):
                pass
            order = np.lexsort((*fine.T, *coarse.T))
            for _ in run(self._solve, self._tasks(rows[order], fine[order], coarse[order])):
                pass

    def _tasks(self, rows: Rows, fine: Rows, coarse: Rows) -> Iterator[_Task]:
        """Rows of one coarse cell, their cells, and the coarse one."""
        cuts = np.flatnonzero((coarse[1:] != coarse[:-1]).any(axis=1)) + 1
        for first, last in pairwise((0, *cuts.tolist(), len(rows))):
            if last > first:
                cell = _CoarseCell(partial(self._seed, coarse[first]))
                for a in range(first, last, TASK_ROWS):
                    b = min(last, a + TASK_ROWS)
                    yield rows[a:b], fine[a:b], cell

    def _seed(self, key: Rows) -> Seed | None:
        """The shape at the centre of a coarse cell; None if there is no good one."""
        start, end = np.empty((2, 7))
        batch_cells.grasp(key, COARSER * self.reach, COARSER * CELL_TURN, self.longest, start, end)
        return seed_at(self.finer, start, end)

    def _solve(self, task: _Task) -> None:
        """Rows of one coarse cell."""
        if perf_counter() > self.deadline:
            return
        rows, cells, coarse = task
        seed = coarse.seed()
        if seed is None:
            return
        batch, state, problem = self.batch, seed.state, self.problem
        codes = np.empty(len(rows), np.int64)
        batch_rows.solve_rows(
            rows,
            cells,
            self.reach,
            CELL_TURN,
            self.longest,
            self.starts,
            self.ends,
            state.par,
            state.mesh,
            state.sol,
            state.work,
            state.elements,
            seed.mode,
            state.info[rod_drive.ESTIMATE],
            seed.loads,
            problem.points,
            problem.tolerance,
            self.watch.soft,
            self.watch.section,
            self.watch.limits,
            self.checker.radius,
            self.checker.horizon,
            *self.checker.tables,
            self.masses,
            self.tube.known,
            batch.buffer,
            batch.info,
            codes,
            batch.tables,
            batch.margin_rows,
            np.empty((len(batch), 0)) if batch.radius is None else batch.radius,
        )
        good = rows[codes == CONVERGED]
        batch.status[good] = Status.OK.value
        batch.iterations[good] = batch.info[good, rod_drive.ITERATIONS]
        batch.done[good] = True
        batch.several[rows] = seed.several
        batch.several[rows[~np.isin(codes, _ALONE)]] = True

    # -- one row by itself

    def solve_left(self) -> None:
        """Every valid row that is not done yet."""
        for row in np.flatnonzero(~(self.batch.done | self.invalid)).tolist():
            if perf_counter() > self.deadline:
                return
            self._solve_alone(row)

    def _solve_alone(self, row: int) -> None:
        """A row from nothing."""
        batch = self.batch
        start, end = Pose.trusted(self.starts[row]), Pose.trusted(self.ends[row])
        state = None
        if self.compiled and self.predictor.model in ("cosserat", "auto"):
            state = Network(self.problem)
            shape = cosserat.solve(self.problem.move(start, end), state)
        else:
            self.predictor.reset()
            shape = self.predictor.predict(start, end)
        batch.buffer[row] = shape.buffer
        info = batch.info[row]
        info[:] = math.nan
        info[rod_drive.ENERGY], error = shape.energy, shape.unread_error
        if callable(error):
            batch.unread_errors[row] = error
        else:
            info[rod_drive.ESTIMATE] = error
        info[rod_drive.RESIDUAL], info[rod_drive.TWIST] = shape.residual, shape.twist
        batch.iterations[row], batch.turns[row] = shape.iterations, shape.turns
        batch.models[row] = shape.model
        batch.status[row] = shape.status.value
        if shape.detail:
            batch.details[row] = shape.detail
        swell = None
        if batch.radius is not None and state is not None and shape.status:
            beside = RodState(self.problem)
            rod_of_rows.solve(self.problem, beside)
            swell = batch.radius[row] = self.tube.radius(beside, shape)
        clearance = self.checker.check(shape, swell=swell)
        batch.tables[row] = math.nan if clearance.table is None else clearance.table
        rows = batch.margin_rows[row]
        rows[:] = math.nan
        self.watch.reset()
        columns = {kind: i for i, kind in enumerate(LOAD_MARGINS)} | {
            n: margins.BODIES + i for i, n in enumerate(batch.bodies)
        }
        for margin in self.watch.margins(shape, clearance, 0, state=state, held=True):
            column = columns[margin.other or margin.kind]
            rows[column, : margins.TIME] = margin.used, margin.limit, margin.value, margin.arc_length
        batch.done[row] = True


def _table(name: str, value: ArrayLike) -> Array:
    """Poses as a new array (k, 7)."""
    remedy = "A row is a position in m and a quaternion x, y, z, w."
    table = checks.numbers(name, value, remedy)
    if table.ndim != 2 or table.shape[1] != 7:
        raise ArgumentError.of(name, f"array of shape {table.shape}", "it must have shape (k, 7)", remedy)
    return table
