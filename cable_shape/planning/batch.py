"""Many grasps at once: :func:`predict_batch`.

The rod starts each row from a shape that was solved at the centre of the row's cell, a cell of a fixed lattice in the
space of grasps (:mod:`cable_shape.kernels.network.batch_cells`): rows in one cell share that start, its mesh and the
factors that move it, to first order, to the row's own ends (:mod:`cable_shape.kernels.safety.batch_rows`). A row that
is not reached so is solved by itself, from nothing. Either way a row's answer depends on its own ends and on nothing
else.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import Any, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import batch_cells, beside, drive
from cable_shape.kernels.network.newton import CONVERGED, I_ITERATIONS
from cable_shape.kernels.safety import batch_rows
from cable_shape.planning.batch_spread import BatchTube, check_tube
from cable_shape.planning.cables_batch import CablesBatch, predict_cables
from cable_shape.planning.harness_batch import (
    MOST_NUMBERS,
    HarnessBatch,
    Tables,
    normalise,
    pose_table,
    predict_rows,
)
from cable_shape.planning.row_judge import RowJudge
from cable_shape.planning.row_slopes import COLUMNS, RowSlopes
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.pose import GRIP_KINDS, NOT_GIVEN, FreeEnd, Grip, Pose, both_given
from cable_shape.prediction.predictor import Predictor
from cable_shape.scene.scene import Clip, Scene
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.answers import Solved
from cable_shape.solve.network import Network
from cable_shape.solve.problem import GRAVITY
from cable_shape.uncertainty.tube_watch import TubeWatch
from cable_shape.uncertainty.uncertainty import Uncertainty

MOST_THREADS = 1024
#: Units of the lattice of cells: this fraction of the cable's length, and radians.
CELL_REACH, CELL_TURN = 0.25, 0.3
#: In clips: the first as a fraction of the shortest stretch between supports, which a grip leaves little room.
REACH_IN_CLIPS = 0.15
#: The grips of a cell's shape are at most this fraction of the length apart.
LONGEST_CHORD = 0.95
#: Rows in one task.
TASK_ROWS = 128

#: Codes of `batch_rows.solve_rows` that tell nothing of other shapes.
_ALONE = (CONVERGED, batch_rows.COARSE, batch_rows.LOST, drive.TAUT)

Rows = NDArray[np.int64]


@overload
def predict_batch(cable: Cable, starts: ArrayLike, ends: ArrayLike | FreeEnd | None, **_: Any) -> ShapeBatch: ...
@overload
def predict_batch(cable: Harness, starts: Tables, **_: Any) -> HarnessBatch: ...
@overload
def predict_batch(cable: Mapping[str, Cable | Harness], starts: Mapping[str, Any], **_: Any) -> CablesBatch: ...
def predict_batch(  # type: ignore[misc]
    cable: Cable | Harness | Mapping[str, Cable | Harness],
    starts: Any,
    ends: Any = NOT_GIVEN,
    *,
    start_kind: str = "clamped",
    end_kind: str = "clamped",
    model: str = "auto",
    gravity: ArrayLike = GRAVITY,
    scene: Scene | Sequence[Scene] | None = None,
    points: int = 150,
    tolerance: float | None = None,
    distributed_load: Any = None,
    acceleration: Any = None,
    threads: int | None = None,
    time_limit: float | None = None,
    uncertainty: Uncertainty | Mapping[str, Uncertainty] | None = None,
    kinds: Mapping[str, str] | None = None,
    clips: Mapping[str, Sequence[Clip]] | None = None,
    slopes: bool = False,
) -> Any:
    """The shapes of one cable for many pairs of ends, or of a harness or several cables for many rows, with clearance
    and margins.

    The order of the rows, the other rows and the number of threads change no bit of a row.

    Parameters
    ----------
    starts, ends : (k, 7) array_like
        Position [m] and quaternion x y z w of the cable frame at each end, in the world. `ends` may be a FreeEnd, which
        is that of all rows, or None: free without load. Of a harness `starts` alone: a mapping of held ends to such
        tables, and of free ones to FreeEnd; the answer is a :class:`cable_shape.planning.harness_batch.HarnessBatch`.
        Of several, a mapping of name to Cable or Harness, `starts` alone, too: a mapping of name to (starts, ends), or
        for a harness to its own mapping, every row a scene of all of them; the answer is a
        :class:`cable_shape.planning.cables_batch.CablesBatch`.
    start_kind, end_kind : str
        How grips hold the ends: "clamped", "swivel" or "pinned", as of :class:`Grip`.
    kinds : mapping of end to str, optional
        The same of a harness, and of several cables, by "name.start" and "name.end", and "h/a.start" of harness "h".
    clips : mapping of cable name to sequence of Clip, optional
        Of several cables: what holds that one, in place of the scene's `clips`, which hold every cable.
    model, gravity, points, tolerance, scene, distributed_load, acceleration
        As for :func:`predict`, the same for all rows. Other models than the rod, clips of kind "slide" and contact are
        solved row by row and far more slowly, and so are harnesses. Obstacles on robot links are left out. `scene` may
        be a list, a scene for each row, which differ by where bodies and clips are, not in how many: a scene of many
        rows given once is worked out once. Of several
        cables `acceleration` is a mapping by their names, and `distributed_load` may be one. With ``contact="solve"``
        these are kept out of each other and of themselves: rows in which they touch are solved row by row.
    threads : int, optional
        Default: as many as there are cores to run on.
    time_limit : float, optional
        [s]; after it what is done is returned, see `done` and `partial`; looked at between tasks of some 10 ms.
    uncertainty : Uncertainty, optional
        Gives every row a tube, to first order in all that is not known, see `ShapeBatch.radius`; distances and what
        they use of their margins are those of the tube then. Of the rod. The poses that are not exactly known are those
        of `starts` and `ends`. Rows in eyelets, of sections, of harnesses or in contact take two shapes more for every
        direction. Of several cables one for all, or a mapping by their names.

    slopes : bool
        Of one cable, of the rod: also how margins change with the grips, see `ShapeBatch.slopes`, in clips and in
        contact, too. It takes a row as long as some ten shapes.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy; not for the numbers in a row, see `errors`.
    """
    began = perf_counter()
    if threads is not None:
        checks.integer("threads", threads, at_least=1, at_most=MOST_THREADS)
    one: Any = scene
    known: Any = uncertainty
    if slopes and (isinstance(cable, (Harness, Mapping)) or model not in ("auto", "cosserat")):
        raise ArgumentError.of("slopes", slopes, "they are of one cable, by the rod", "Leave them out.")
    if isinstance(scene, (list, tuple)) and isinstance(cable, (Harness, Mapping)):
        bound = "a row's own scene is known of one cable only"
        raise ArgumentError.of("scene", f"{len(scene)} scenes", bound, "Give one scene, or call it scene by scene.")
    if isinstance(cable, Harness):
        of_cables = {
            "start_kind": start_kind, "end_kind": end_kind, "ends": ends, "clips": clips,
        }  # fmt: skip
        for name, value in of_cables.items():
            given = value is not None and value is not NOT_GIVEN
            if given and not (isinstance(value, str) and value == "clamped"):
                remedy = "Write predict_batch(harness, {'a.start': table, ...}, kinds={...})."
                raise ArgumentError.of(name, value, "it is known of cables only", remedy)
        return predict_rows(
            cable, starts, kinds=kinds, scene=one, acceleration=acceleration, uncertainty=known, time_limit=time_limit,
            model=model, gravity=gravity, points=points, tolerance=tolerance, distributed_load=distributed_load,
        )  # fmt: skip
    if isinstance(cable, Mapping):
        return _predict_several(
            cable, starts, ends, (start_kind, end_kind), kinds=kinds, clips=clips, scene=scene, model=model,
            acceleration=acceleration, uncertainty=uncertainty, threads=threads, time_limit=time_limit, gravity=gravity,
            points=points, tolerance=tolerance, distributed_load=distributed_load,
        )  # fmt: skip
    both_given("predict_batch(cable, starts, ends)", ends, "ends")
    if kinds is not None:
        raise ArgumentError.of("kinds", kinds, "a cable has two ends", "Write start_kind=.., end_kind=...")
    if clips is not None:
        raise ArgumentError.of("clips", clips, "those of one cable are the scene's", "Write scene=Scene(clips=[...]).")
    if isinstance(uncertainty, Mapping):
        raise ArgumentError.of(
            "uncertainty", uncertainty, "there is one cable", "Write uncertainty=Uncertainty({...})."
        )
    if threads is None:
        threads = len(os.sched_getaffinity(0))
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    checks.one_of("start_kind", start_kind, GRIP_KINDS)
    checks.one_of("end_kind", end_kind, GRIP_KINDS)
    poses = pose_table("starts", starts)
    free = FreeEnd() if ends is None else ends if isinstance(ends, FreeEnd) else None
    how = start_kind, end_kind if free is None else free
    others = poses.copy() if isinstance(ends, FreeEnd) or ends is None else pose_table("ends", ends)
    batch: ShapeBatch | None = None
    for rows, own in _scenes(scene, len(poses)):
        options = {
            "gravity": gravity,
            "points": points,
            "scene": own,
            "distributed_load": distributed_load,
            "friction": False,
        }
        predictor = Predictor(cable, model=model, tolerance=tolerance, **options)
        if acceleration is not None:
            predictor.accelerate(acceleration)
            if predictor.problem.velocity is not None:
                bound = "a batch takes accelerations only"
                raise ArgumentError.of("acceleration", "with a velocity", bound, "Give three columns.")
        work = _Work(predictor, poses, others, how, acceleration, deadline, uncertainty, options, batch, rows)
        batch = work.batch
        if work.network is not None:
            work.solve_cells(threads)
            work.judge_meant()
        work.solve_left()
        if slopes:
            work.tell_slopes(cable, {**options, "tolerance": tolerance})
    assert batch is not None
    batch.blank()
    batch.partial = int(batch.done.sum()) + len(batch.errors) < len(batch)
    batch.time = perf_counter() - began
    return batch


def _scenes(scene: Any, rows: int) -> list[tuple[Rows | None, Scene | None]]:
    """Each scene with its rows; None: all of them."""
    if not isinstance(scene, (list, tuple)):
        return [(None, scene)]
    for i, one in enumerate(scene):
        checks.instance(f"scene[{i}]", one, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
    if len(scene) != rows or not rows:
        bound = f"there must be one a row, and there are {rows}"
        raise ArgumentError.of("scene", f"{len(scene)} scenes", bound, "Give as many starts and ends as scenes.")
    of: dict[int, list[int]] = {}
    for i, one in enumerate(scene):
        of.setdefault(id(one), []).append(i)
    return [(np.array(those), scene[those[0]]) for those in of.values()]


def _predict_several(
    cables: Mapping[str, Cable | Harness], starts: Any, ends: Any, held: tuple[str, str], **more: Any
) -> Any:
    """Several cables, which take what one does in mappings by their names."""
    remedy = "Write predict_batch({'a': cable, ..}, {'a': (starts, ends), ..}, kinds={'a.start': 'swivel'})."
    if ends is not NOT_GIVEN:
        raise ArgumentError.of("ends", "given", "tables of several cables are one mapping", remedy)
    for name, kind in zip(("start_kind", "end_kind"), held, strict=True):
        if kind != "clamped":
            raise ArgumentError.of(name, kind, "it is of one cable", remedy)
    return predict_cables(cables, starts, predict_batch, **more)


_Task = tuple[Rows, Rows]


@final
class _Work:
    """One call of :func:`predict_batch`, or its rows in one scene; batch: that it shares with those in others."""

    def __init__(
        self,
        predictor: Predictor,
        starts: Array,
        ends: Array,
        how: tuple[str, str | FreeEnd],
        acceleration: ArrayLike | None,
        deadline: float,
        uncertainty: Uncertainty | None,
        options: Mapping[str, Any],
        batch: ShapeBatch | None = None,
        rows: Rows | None = None,
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
        self.predictor, self.problem, self.deadline = predictor, problem, deadline
        self.starts, self.ends, self.how, self.acceleration = starts, ends, how, acceleration
        rod = cable.mean_bending_stiffness > 0.0 and predictor.model in ("cosserat", "auto")
        #: What all rows share, if they are solved together.
        alone = scene.contact == "solve" or any(clip.kind == "slide" for clip in problem.clips) or bool(cable.sections)
        self.network = None if alone or not rod else self._shared()
        if uncertainty is not None:
            check_tube(uncertainty, predictor)
        self.tube = BatchTube(self.network, uncertainty)
        self.beside: TubeWatch | None = None  # of rows that are solved one by one
        if uncertainty is not None and self.network is None:
            self.beside = TubeWatch(cable, uncertainty, **options)
        self.judge = RowJudge(cable, scene)
        made = self.judge.batch(len(starts), problem)
        self.batch = batch or made
        if not self.batch.stacks_with(made):
            bound = (
                f"it must have the bodies, the number of clips and the distances of the first one, {self.batch.bodies}"
            )
            what = f"scene[{0 if rows is None else rows[0]}]"
            raise ArgumentError.of(what, made.bodies, bound, "What a row's scene may differ by is where things are.")
        if uncertainty is not None and batch is None:
            self.batch.confidence = uncertainty.confidence
            self.batch.radius = np.full((len(starts), problem.points), math.nan)
        self.invalid: NDArray[np.bool_] = np.zeros(len(starts), np.bool_)
        if rows is not None:
            self.invalid[:] = True
            self.invalid[rows] = False
        for name, poses in (("starts", starts), ("ends", ends)):
            self._check(name, poses)

    def _shared(self) -> Network:
        """The cable as all rows hold it."""
        network = Network(self.problem)
        network.tolerance = beside.SHARE * self.problem.tolerance
        network.aim(*self._grips(Pose(), Pose()))
        return network

    def _grips(self, start: Pose, end: Pose) -> tuple[Grip, Grip | FreeEnd]:
        """What holds the ends of a row."""
        kind, other = self.how
        return Grip(start, kind), other if isinstance(other, FreeEnd) else Grip(end, other)

    def _check(self, name: str, poses: Array) -> None:
        """Normalises the quaternions, and puts rows that are not valid into the errors."""
        for row, error in normalise(name, poses).items():
            self.invalid[row] = True
            self.batch.errors.setdefault(row, error)
            self.batch.details.setdefault(row, str(error))

    # -- many rows from one shape

    def solve_cells(self, threads: int) -> None:
        """Every valid row that its cell's shape leads to, in tasks that share nothing but what they read."""
        rows = np.flatnonzero(~self.invalid)
        starts, ends = self.starts[rows], self.ends[rows]
        told, judged, found = self._told(), self._judged(), self._found()
        wide = batch_cells.IN_CLIPS if self.problem.clips else batch_cells.DIMENSIONS
        cells = np.empty((len(rows), wide), np.int64)

        def find(a: int, b: int) -> None:
            batch_cells.keys(starts[a:b], ends[a:b], told.reach, told.turn, cells[a:b])

        def solve(task: _Task) -> None:
            self._solve(task, told, judged, found)

        with ThreadPoolExecutor(threads) as pool:
            run = map if threads == 1 else pool.map
            cuts = np.linspace(0, len(rows), threads + 1).astype(int).tolist()
            for _ in run(find, cuts[:-1], cuts[1:]):
                pass
            order = np.lexsort(cells.T)
            for _ in run(solve, self._tasks(rows[order], cells[order])):
                pass
        self.batch.tell_several_by(cells, rows, lambda keys: _several(told, keys))

    def _told(self) -> beside.Told:
        """The cable, as compiled code takes it."""
        network, length = self.network, self.problem.cable.length
        assert network is not None
        reach, longest = CELL_REACH * length, math.inf
        if self.problem.clips:
            reach = REACH_IN_CLIPS * float(np.diff(network.arcs).min())
        elif self.problem.cable.axial_stiffness is None:
            longest = LONGEST_CHORD * length
        return beside.Told(
            network.bare, network.held, network.knots, network.stops, network.finer(1.0), self.problem.tolerance,
            reach, CELL_TURN, longest,
        )  # fmt: skip

    def _judged(self) -> batch_rows.Judged:
        """What shapes are judged by, likewise."""
        watch, checker = self.judge.watch, self.judge.checker
        assert self.network is not None
        end = self._grips(Pose(), Pose())[1]
        masses, held = self.network.masses(end), isinstance(end, Grip)
        return batch_rows.Judged(
            watch.pieces, watch.warn, watch.soft, held, masses, checker.radius, checker.horizon, *checker.tables
        )

    def _found(self) -> batch_rows.Found:
        """Where compiled code puts what it finds."""
        batch = self.batch
        radius = np.empty((len(batch), 0)) if batch.radius is None else batch.radius
        return batch_rows.Found(batch.buffer, batch.info, batch.loads, batch.tables, batch.margin_rows, radius)

    @staticmethod
    def _tasks(rows: Rows, cells: Rows) -> Iterator[_Task]:
        """Rows and their cells."""
        for a in range(0, len(rows), TASK_ROWS):
            b = a + TASK_ROWS
            yield rows[a:b], cells[a:b]

    def _solve(self, task: _Task, told: beside.Told, judged: batch_rows.Judged, found: batch_rows.Found) -> None:
        """Some rows."""
        if perf_counter() > self.deadline:
            return
        batch, rows = self.batch, task[0]
        codes = np.empty(len(rows), np.int64)
        asked = batch_rows.Rows(*task, self.starts, self.ends)
        batch_rows.solve_rows(asked, told, judged, self.tube.known, self.problem.points, found, codes)
        good = rows[codes == CONVERGED]
        batch.status[good] = Status.OK.value
        batch.iterations[good] = batch.info[good, I_ITERATIONS]
        batch.done[good] = True
        batch.flag_several(rows[~np.isin(codes, _ALONE)])

    def judge_meant(self) -> None:
        """Judges what is done by the contact that the scene allows."""
        if self.judge.allowed:
            for row in np.flatnonzero(self.batch.done & ~self.invalid).tolist():
                self.judge.judge_meant(self.batch, row)

    # -- one row by itself

    def solve_left(self) -> None:
        """Every valid row that is not done yet."""
        for row in np.flatnonzero(~(self.batch.done | self.invalid)).tolist():
            if perf_counter() > self.deadline:
                return
            self._solve_alone(row)

    def tell_slopes(self, cable: Cable, keywords: dict[str, Any]) -> None:
        """How the margins of what is done change with the grips."""
        batch = self.batch
        if batch.slopes is None:
            batch.slopes = np.full((*batch.used.shape, COLUMNS), math.nan)
        told = RowSlopes(self.judge, cable, keywords, self.acceleration)
        for row in np.flatnonzero(batch.done & ~self.invalid).tolist():
            ends = self._grips(Pose.trusted(self.starts[row]), Pose.trusted(self.ends[row]))
            told.take(batch, row, *ends)

    def _solve_alone(self, row: int) -> None:
        """A row from nothing."""
        batch = self.batch
        start, end = self._grips(Pose.trusted(self.starts[row]), Pose.trusted(self.ends[row]))
        state: Solved | None
        if self.network is not None:
            state = Network(self.problem)
            shape = cosserat.solve(self.problem.move(start, end), state)
        else:
            self.predictor.reset()
            shape = self.predictor.predict(start, end, acceleration=self.acceleration)
            state = self.predictor.rod_state
        swell = None
        if batch.radius is not None and shape.status:
            swell = self._radius(state, shape, start, end)
            batch.radius[row] = math.nan if swell is None else swell
        clearance = self.judge.checker.check(shape, swell=swell)
        self.judge.keep(batch, row, shape, clearance, state, isinstance(end, Grip))

    def _radius(self, state: Solved | None, shape: CableShape, start: Grip, end: Grip | FreeEnd) -> Array | None:
        """(points,) [m], of the tube of a row's shape; None where there is none."""
        if self.beside is None:
            assert isinstance(state, Network)
            return self.tube.radius(state, shape)
        self.beside.reset()
        tube = self.beside.tube(self.predictor, shape, (start, end), None, self.acceleration)
        return None if tube is None else tube.radius


def _several(told: beside.Told, keys: Rows) -> NDArray[np.bool_]:
    """(c,): whether guesses lead to several stable shapes at the centres of cells (c, d)."""
    found = np.zeros(len(keys), np.int64)
    beside.others(told, keys, np.zeros(drive.INFO + 2), found)
    return found.astype(np.bool_)
