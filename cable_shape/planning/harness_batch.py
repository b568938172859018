"""Many grasps of one harness: what :func:`cable_shape.predict_batch` makes of them, as :class:`HarnessBatch`.

Every row is solved by itself, from nothing, so that its answer depends on its own ends and on nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import batch_cells
from cable_shape.planning.shape_batch import Rows
from cable_shape.pose import GRIP_KINDS, IDENTITY, FreeEnd, Grip, Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import LOAD_MARGINS, Clearance
from cable_shape.scene.scene import Scene
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_shape import HarnessShape

#: More numbers than this are not kept: 8 GB of shapes.
MOST_NUMBERS = 1_000_000_000

#: What is told of the ends of all rows: tables of poses, or loads of free ends.
Tables = Mapping[str, ArrayLike | FreeEnd | None]


@final
class HarnessBatch(Rows[HarnessShape]):
    """Shapes of one harness for k rows of ends; `batch[i]` is a HarnessShape whose arrays are views of these.

    Attributes
    ----------
    points : int, of each segment
    status, done, partial, usable, errors, details, iterations, time, energy, error_estimate
        As of :class:`cable_shape.ShapeBatch`.
    positions, quaternions, curvature, force, moment : mapping of segment to (k, n, 3) or (k, n, 4)
        As of it, too.
    bodies : tuple of str
    horizon : float [m]
    distances : mapping of segment to (k, m) [m]
        From its surface to each of `bodies`, negative on overlap, infinite beyond `horizon`; NaN where not told.
    used : mapping of segment to (k, 6 + m)
        Margins, 1 at the limit: `report.LOAD_MARGINS`, then each body; NaN where none. Stability is not told.
    """

    def __init__(self, harness: Harness, rows: int, points: int, bodies: tuple[str, ...], horizon: float) -> None:
        super().__init__(rows)
        self.harness, self.points, self.bodies, self.horizon = harness, points, bodies, horizon
        names, width = tuple(harness.segments), len(LOAD_MARGINS) + len(bodies)
        self.buffer: Array = np.full((rows, NUMBERS_PER_POINT * points * len(names)), math.nan)
        self.distances: dict[str, Array] = {name: np.full((rows, len(bodies)), math.nan) for name in names}
        self.used: dict[str, Array] = {name: np.full((rows, width), math.nan) for name in names}
        self.energy: Array = np.full(rows, math.nan)
        self.error_estimate: Array = np.full(rows, math.nan)
        self._shapes: dict[int, HarnessShape] = {}

    @property
    def positions(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [m], world; NaN where not done."""
        return self._part(1, 3)

    @property
    def quaternions(self) -> dict[str, Array]:
        """{segment: (k, n, 4)} x, y, z, w."""
        return self._part(4, 4)

    @property
    def curvature(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [1/m], cable frame."""
        return self._part(8, 3)

    @property
    def force(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [N], world."""
        return self._part(11, 3)

    @property
    def moment(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [N m], world."""
        return self._part(14, 3)

    def _part(self, first: int, width: int) -> dict[str, Array]:
        n = self.points
        whole = self.buffer.reshape(len(self), len(self.harness.segments), NUMBERS_PER_POINT * n)
        own = whole[:, :, first * n : (first + width) * n]
        return {name: own[:, i].reshape(len(self), n, width) for i, name in enumerate(self.harness.segments)}

    @property
    def clearance(self) -> Array:
        """(k,) [m], to the nearest body; infinite beyond the horizon or without bodies, NaN where not told."""
        return np.asarray(np.concatenate(list(self.distances.values()), axis=1).min(axis=1, initial=math.inf))

    @property
    def worst(self) -> Array:
        """(k,), the greatest of `used` of all segments; NaN where there is none."""
        return np.asarray(np.fmax.reduce(np.concatenate(list(self.used.values()), axis=1), axis=1))

    def keep(self, row: int, shape: HarnessShape) -> None:
        """Takes the shape of a row, whose arrays are those of the batch from now on."""
        self.buffer[row] = shape.buffer
        shape.buffer = self.buffer[row]
        self._shapes[row] = shape
        self.status[row], self.iterations[row] = shape.status.value, shape.iterations
        self.energy[row], self.error_estimate[row] = shape.energy, shape.error_estimate
        if shape.detail:
            self.details[row] = shape.detail

    def __getitem__(self, row: int) -> HarnessShape:
        """Row `row`; of one that was not done the status is NOT_CONVERGED and positions are NaN."""
        row = range(len(self))[row]
        if row in self._shapes:
            return self._shapes[row]
        detail = self.details.get(row, "")
        return HarnessShape(
            self.harness, self.buffer[row], self.points, model="cosserat", status=Status.NOT_CONVERGED, detail=detail
        )


def predict_rows(
    harness: Harness,
    ends: Tables,
    *,
    kinds: Mapping[str, str] | None = None,
    scene: Scene | None = None,
    acceleration: Mapping[str, ArrayLike] | None = None,
    time_limit: float | None = None,
    **options: Any,
) -> HarnessBatch:
    """What :func:`cable_shape.predict_batch` says; `options`: those of a HarnessPredictor."""
    began = perf_counter()
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    predictor = HarnessPredictor(harness, scene=scene, friction=False, **options)
    tables, grips, free = _told(harness, ends, kinds)
    predictor.problem.move({**grips, **free})  # refuses what cannot be held
    judged = _Judged(harness, scene or Scene())
    rows, points = len(next(iter(tables.values()))), predictor.problem.points
    most = MOST_NUMBERS // (NUMBERS_PER_POINT * points * len(harness.segments))
    if rows > most:
        bound = f"{most} rows of {points} points are allowed"
        raise ArgumentError.of("ends", f"{rows} rows", bound, "Split them.")
    batch = HarnessBatch(harness, rows, points, judged.names, judged.horizon)
    for row in range(rows):
        if perf_counter() > deadline:
            batch.partial = True
            break
        try:
            held = {end: grips[end].at(_pose(f"{end}[{row}]", table[row])) for end, table in tables.items()}
        except ArgumentError as error:
            batch.errors[row], batch.details[row] = error, str(error)
            continue
        predictor.reset()
        batch.keep(row, predictor.predict({**held, **free}, acceleration=acceleration))
        judged.judge(batch, row)
        batch.done[row] = True
    batch.time = perf_counter() - began
    return batch


def _told(
    harness: Harness, ends: Tables, kinds: Mapping[str, str] | None
) -> tuple[dict[str, Array], dict[str, Grip], dict[str, FreeEnd]]:
    """Tables (k, 7) and grips at the origin of the held ends, and the free ends with their loads."""
    remedy = "Write {'a.start': table of (k, 7), ...}; ends that are not named are free."
    told = checks.mapping("ends", ends, harness.ends, remedy)
    free = {end: FreeEnd() if held is None else held for end, held in told.items() if _is_free(held)}
    tables = {end: pose_table(end, held) for end, held in told.items() if not _is_free(held)}
    if not tables:
        raise ArgumentError.of("ends", list(told), "no end is held", remedy)
    lengths = {end: len(table) for end, table in tables.items()}
    if len(set(lengths.values())) > 1:
        raise ArgumentError.of("ends", lengths, "all must have as many rows", "Give a pose of each end a row.")
    named = checks.mapping("kinds", kinds, tables, "Write {'a.start': 'swivel'}.")
    for end, kind in named.items():
        checks.one_of(f"kinds[{end!r}]", kind, GRIP_KINDS)
    return tables, {end: Grip(IDENTITY, named.get(end, "clamped")) for end in tables}, free


def _is_free(held: object) -> bool:
    return held is None or isinstance(held, FreeEnd)


def pose_table(name: str, value: Any) -> Array:
    """Poses as a new array (k, 7)."""
    remedy = "A row is a position in m and a quaternion x, y, z, w."
    table = checks.numbers(name, value, remedy)
    if table.ndim != 2 or table.shape[1] != 7:
        raise ArgumentError.of(name, f"array of shape {table.shape}", "it must have shape (k, 7)", remedy)
    return table


def normalise(name: str, poses: Array) -> dict[int, ArgumentError]:
    """Makes the quaternions of poses (k, 7) unit ones; what is wrong with rows that are not valid."""
    given, off, errors = poses.copy(), np.empty(len(poses)), {}
    batch_cells.normalise(poses, off)
    for row in np.flatnonzero(~(off <= checks.QUATERNION_TOLERANCE)).tolist():
        try:
            Pose(given[row, :3], given[row, 3:])
        except ArgumentError as error:
            errors[row] = ArgumentError(f"{name}[{row}]: {error}")
    return errors


def _pose(where: str, row: Array) -> Pose:
    try:
        return Pose(row[:3], row[3:])
    except ArgumentError as error:
        raise ArgumentError(f"{where}: {error}") from None


@final
class _Judged:
    """What the segments of every row are judged by: the obstacles of the scene that stand still, and limits."""

    def __init__(self, harness: Harness, scene: Scene) -> None:
        bodies = [] if scene.contact == "off" else [body for body in scene.obstacles if body.link is None]
        around = Scene(obstacles=bodies, warn_distance=scene.warn_distance, error_distance=scene.error_distance)
        cables = harness.segments.items()
        self._checkers = {name: ClearanceChecker(around, cable=cable) for name, cable in cables}
        self._watches = {name: MarginWatch(cable, scene) for name, cable in cables}
        first = next(iter(self._checkers.values()))
        self.names, self.horizon = first.names, first.horizon
        kinds: dict[Any, int] = {kind: i for i, kind in enumerate(LOAD_MARGINS)}
        self._columns = kinds | {name: len(kinds) + i for i, name in enumerate(self.names)}

    def judge(self, batch: HarnessBatch, row: int) -> None:
        """Clearance and margins of a row's segments."""
        for name, shape in batch[row].segments.items():
            clearance: Clearance = self._checkers[name].check(shape)
            if clearance.table is not None:
                batch.distances[name][row] = clearance.table[:, 0]
            watch = self._watches[name]
            watch.reset()
            for margin in watch.margins(shape, clearance, 0):
                batch.used[name][row, self._columns[margin.other or margin.kind]] = margin.used
