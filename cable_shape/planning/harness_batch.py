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
from cable_shape.cable.junction import Junction
from cable_shape.checks import Array
from cable_shape.cycle.harness_stability import HarnessStability
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import batch_cells
from cable_shape.kernels.safety import loads_used
from cable_shape.planning.row_judge import RowJudge
from cable_shape.planning.shape_batch import Several, ShapeBatch
from cable_shape.pose import GRIP_KINDS, IDENTITY, FreeEnd, Grip, Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.scene.scene import Scene
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.uncertainty.harness_tube_watch import HarnessTubeWatch
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

#: More numbers than this are not kept: 8 GB of shapes.
MOST_NUMBERS = 1_000_000_000
_WRITE = "Write {'a.start': table of (k, 7), ...}; ends that are not named are free."

#: What is told of the ends of all rows: tables of poses, or loads of free ends.
Tables = Mapping[str, ArrayLike | FreeEnd | None]


@final
class HarnessBatch(Several[HarnessShape]):
    """Shapes of one harness for k rows of ends; `batch[i]` is a HarnessShape whose arrays are views of these.

    Attributes
    ----------
    segments : mapping of segment to ShapeBatch
        All that is told of each. Stability, of which there is one of the whole, is with the segment that turns most in
        the softest mode.
    positions, distances, used, radius : mapping of segment to what its ShapeBatch has
    clearance, worst : (k,)
        Of all segments; they are not checked against each other.
    points : int, of each segment
    bodies : tuple of str
    horizon : float [m]
    status, done, partial, usable, errors, details, iterations, time, energy, error_estimate
        As of :class:`cable_shape.ShapeBatch`.
    """

    def __init__(self, harness: Harness, parts: Mapping[str, ShapeBatch]) -> None:
        super().__init__(parts)
        self.harness = harness
        first = next(iter(parts.values()))
        self.points, self.bodies, self.horizon = first.points, first.bodies, first.horizon
        size = NUMBERS_PER_POINT * self.points
        beside = sum(joint.frame(end).position.any() for joint in _rigid(harness) for end in joint.ends)
        #: After the segments come, as in a HarnessShape, what ends beside their junctions hang on.
        self.buffer: Array = np.full((len(self), size * (len(parts) + int(beside))), math.nan)
        for i, part in enumerate(parts.values()):
            part.buffer = self.buffer[:, i * size : (i + 1) * size]
        self.energy: Array = np.full(len(self), math.nan)
        self.error_estimate: Array = np.full(len(self), math.nan)
        self._shapes: dict[int, HarnessShape] = {}

    @property
    def segments(self) -> dict[str, ShapeBatch]:
        """See the class."""
        return self.parts

    @property
    def quaternions(self) -> dict[str, Array]:
        """{segment: (k, n, 4)} x, y, z, w."""
        return {name: batch.quaternions for name, batch in self.parts.items()}

    @property
    def curvature(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [1/m], cable frame."""
        return {name: batch.curvature for name, batch in self.parts.items()}

    @property
    def force(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [N], world."""
        return {name: batch.force for name, batch in self.parts.items()}

    @property
    def moment(self) -> dict[str, Array]:
        """{segment: (k, n, 3)} [N m], world."""
        return {name: batch.moment for name, batch in self.parts.items()}

    def keep(self, row: int, shape: HarnessShape) -> None:
        """Takes the shape of a row, whose arrays are those of the batch from now on."""
        self.buffer[row] = shape.buffer
        shape.buffer = self.buffer[row]
        vars(shape).pop("segments", None)  # made anew, of these
        self._shapes[row] = shape
        self.status[row], self.iterations[row] = shape.status.value, shape.iterations
        self.energy[row], self.error_estimate[row] = shape.energy, shape.error_estimate
        if shape.detail:
            self.details[row] = shape.detail
        self.done[row] = True

    def refuse(self, row: int, error: ArgumentError) -> None:
        """Says what is wrong with a row's input."""
        self.errors[row], self.details[row] = error, str(error)
        for part in self.parts.values():
            part.errors[row], part.details[row] = error, str(error)

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
    uncertainty: Uncertainty | None = None,
    time_limit: float | None = None,
    **options: Any,
) -> HarnessBatch:
    """What :func:`cable_shape.predict_batch` says; `options`: those of a HarnessPredictor."""
    began = perf_counter()
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    options["friction"] = False
    predictor = HarnessPredictor(harness, scene=scene, **options)
    tables, free = tables_of(harness, ends)
    named = kinds_of(kinds, tables)
    grips = {end: Grip(IDENTITY, named.get(end, "clamped")) for end in tables}
    predictor.problem.move({**grips, **free})  # refuses what cannot be held
    rows, points = len(next(iter(tables.values()))), predictor.problem.points
    most = MOST_NUMBERS // (NUMBERS_PER_POINT * points * len(harness.segments))
    if rows > most:
        bound = f"{most} rows of {points} points are allowed"
        raise ArgumentError.of("ends", f"{rows} rows", bound, "Split them.")
    judged = _Judged(predictor, rows, uncertainty, {"scene": scene, **options})
    batch = judged.batch
    for row in range(rows):
        if perf_counter() > deadline:
            batch.partial = True
            break
        try:
            held = {end: grips[end].at(_pose(f"{end}[{row}]", table[row])) for end, table in tables.items()}
        except ArgumentError as error:
            batch.refuse(row, error)
            continue
        judged.solve(row, {**held, **free}, acceleration)
    for one in batch.parts.values():
        one.partial = batch.partial
        one.blank()
    batch.time = perf_counter() - began
    return batch


def tables_of(harness: Harness, ends: Tables) -> tuple[dict[str, Array], dict[str, FreeEnd]]:
    """Tables (k, 7) of the held ends, and the free ends with their loads."""
    told = checks.mapping("ends", ends, harness.ends, _WRITE)
    free = {end: FreeEnd() if held is None else held for end, held in told.items() if _is_free(held)}
    tables = {end: pose_table(end, held) for end, held in told.items() if not _is_free(held)}
    if not tables:
        raise ArgumentError.of("ends", list(told), "no end is held", _WRITE)
    same_rows("ends", tables)
    return tables, free


def same_rows(name: str, tables: Mapping[str, Array]) -> None:
    """Refuses tables of which one is longer than another."""
    lengths = {end: len(table) for end, table in tables.items()}
    if len(set(lengths.values())) > 1:
        raise ArgumentError.of(name, lengths, "all must have as many rows", "Give a pose of each end a row.")


def kinds_of(kinds: Mapping[str, str] | None, tables: Mapping[str, Array]) -> dict[str, str]:
    """How held ends are held; those that are not named are clamped."""
    named = checks.mapping("kinds", kinds, tables, "Write {'a.start': 'swivel'}.")
    for end, kind in named.items():
        checks.one_of(f"kinds[{end!r}]", kind, GRIP_KINDS)
    return named


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


def _rigid(harness: Harness) -> list[Junction]:
    return [junction for junction in harness.junctions if junction.kind == "rigid"]


@final
class _Judged:
    """The rows, each found from nothing and judged: every segment by the obstacles that stand still and its limits."""

    def __init__(
        self, predictor: HarnessPredictor, rows: int, uncertainty: Uncertainty | None, options: Mapping[str, Any]
    ) -> None:
        self.predictor = predictor
        segments = predictor.problem.segments
        self.judges = {name: RowJudge(one.cable, predictor.scene or Scene()) for name, one in segments.items()}
        made = {name: judge.batch(rows, segments[name]) for name, judge in self.judges.items()}
        self.batch = HarnessBatch(predictor.harness, made)
        self.stability = HarnessStability(predictor, 0.0)
        self.known: HarnessTubeWatch | None = None
        if uncertainty is not None:
            checks.instance("uncertainty", uncertainty, (Uncertainty,), "Write Uncertainty({...}).")
            self.known = HarnessTubeWatch(predictor.harness, uncertainty, **options)
            for one in made.values():
                one.confidence, one.radius = uncertainty.confidence, np.full((rows, one.points), math.nan)

    def solve(self, row: int, ends: Mapping[str, Grip | FreeEnd], acceleration: Mapping[str, ArrayLike] | None) -> None:
        """One row."""
        batch, tubes = self.batch, dict[str, Tube]()
        self.predictor.reset()
        shape = self.predictor.predict(ends, acceleration=acceleration)
        batch.keep(row, shape)
        if self.known is not None:
            self.known.reset()
            tubes = self.known.tubes(self.predictor, shape, ends, acceleration)
        for name, judge in self.judges.items():
            part, segment = batch.segments[name], shape.segments[name]
            swell = tubes[name].radius if name in tubes else None
            if part.radius is not None:
                part.radius[row] = math.nan if swell is None else swell
            judge.keep(part, row, segment, judge.checker.check(segment, swell=swell))
        tell_stability(self.stability, shape, batch, row)


def tell_stability(stability: HarnessStability, shape: HarnessShape, batch: HarnessBatch, row: int) -> None:
    """Judges the shape just predicted, and tells a row with the segment that turns most."""
    stability.reset()
    stability.judge(shape, 0)
    margin = stability.margin
    if margin is not None:
        told = batch.segments[stability.segment].margin_rows[row, loads_used.STABILITY]
        told[: loads_used.TIME] = margin.used, margin.limit, margin.value, margin.arc_length
