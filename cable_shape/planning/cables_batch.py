"""Many grasps of several cables that may touch each other: :class:`CablesBatch`, made by `predict_batch`.

Rows in which the cables, each found by itself, are clear of bodies, of each other and of themselves are done with that,
in compiled code and threads. Others are solved one by one, from nothing, as :func:`cable_shape.predict` does. Either
way a row's answer depends on its own ends and on nothing else.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.batch_spread import check_tube
from cable_shape.planning.harness_batch import MOST_NUMBERS, normalise, pose_table
from cable_shape.planning.row_judge import RowJudge
from cable_shape.planning.shape_batch import Several, ShapeBatch
from cable_shape.pose import GRIP_KINDS, Ends, FreeEnd, Grip, Pose
from cable_shape.prediction.cables_predictor import CablesPredictor, named_cables, of_all
from cable_shape.safety.near import CableNear
from cable_shape.scene.scene import Clip, Scene
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.uncertainty.tube_watch import TubeWatch
from cable_shape.uncertainty.uncertainty import Uncertainty

SIDES = ("start", "end")
_WRITE = "Write {name of the cable: (starts, ends)} of every cable, tables (k, 7); ends may be a FreeEnd or None."

#: Tables of both ends of a cable, or what loads its free end.
Tables = tuple[ArrayLike, ArrayLike | FreeEnd | None]


@final
class CablesBatch(Several[dict[str, CableShape]]):
    """Shapes of several cables for k rows of ends; `batch[i]` is a mapping of cable name to CableShape.

    Attributes
    ----------
    cables : mapping of cable name to ShapeBatch
        All that is told of each. Of its `bodies` the last ones are the other cables and "itself".
    positions, distances, used, radius : mapping of cable name to what its ShapeBatch has
    clearance, worst : (k,)
        Of all cables.
    status : (k,) int
        The gravest of the cables'.
    done, partial, usable, errors, details, iterations, time
        As of :class:`cable_shape.ShapeBatch`.
    """

    @property
    def cables(self) -> dict[str, ShapeBatch]:
        """See the class."""
        return self.parts

    def tell(self, row: int) -> None:
        """Takes over what became of a row's cables."""
        every = self.cables.values()
        self.done[row] = all(batch.done[row] for batch in every)
        self.status[row] = max(int(batch.status[row]) for batch in every)
        self.iterations[row] = sum(int(batch.iterations[row]) for batch in every)
        told = {name: batch.details[row] for name, batch in self.cables.items() if row in batch.details}
        if told:
            self.details[row] = " ".join(f"cable {name!r}: {detail}" for name, detail in told.items())

    def __getitem__(self, row: int) -> dict[str, CableShape]:
        """The shapes of row `row`; of one that was not done the status is NOT_CONVERGED and positions are NaN."""
        return {name: batch[row] for name, batch in self.cables.items()}


def predict_cables(
    cables: Mapping[str, Cable],
    ends: Mapping[str, Tables],
    alone: Callable[..., ShapeBatch],
    *,
    kinds: Mapping[str, str] | None = None,
    clips: Mapping[str, Sequence[Clip]] | None = None,
    scene: Scene | None = None,
    acceleration: Mapping[str, ArrayLike] | None = None,
    uncertainty: Uncertainty | Mapping[str, Uncertainty] | None = None,
    threads: int | None = None,
    time_limit: float | None = None,
    **options: Any,
) -> CablesBatch:
    """What :func:`cable_shape.predict_batch` says; alone: that of a single cable; `options`: of a CablesPredictor."""
    began = perf_counter()
    deadline = math.inf
    if time_limit is not None:
        deadline = began + checks.number("time_limit", time_limit, above=0.0, unit="s")
    predictor = CablesPredictor(named_cables(cables), scene=scene, clips=clips, friction=False, **options)
    given = _Given(predictor, ends, kinds)
    moves = checks.mapping("acceleration", acceleration, predictor.predictors, "Write {name of the cable: ..}.")
    work = _Work(predictor, given, moves, _known(uncertainty, predictor), deadline)
    work.solve_alone(alone, threads, {key: options[key] for key in ("model", "tolerance") if key in options})
    work.solve_left()
    batch = work.batch
    for one in batch.cables.values():
        for kept in (one.buffer, one.info, one.tables, one.margin_rows):
            kept[~batch.done] = math.nan
        one.done[:] = batch.done
        one.partial = batch.partial = not bool((batch.done | given.invalid).all())
        one.errors.update(given.errors)
        one.time = perf_counter() - began
    batch.errors.update(given.errors)
    batch.details.update({row: str(error) for row, error in given.errors.items()})
    batch.time = perf_counter() - began
    return batch


def _known(
    uncertainty: Uncertainty | Mapping[str, Uncertainty] | None, among: CablesPredictor
) -> dict[str, Uncertainty]:
    """What is known of each cable; those that are known exactly are left out."""
    if isinstance(uncertainty, Uncertainty):
        known = dict.fromkeys(among.predictors, uncertainty)
    else:
        remedy = "Write Uncertainty({...}), or {name of the cable: Uncertainty({...})}."
        known = checks.mapping("uncertainty", uncertainty, among.predictors, remedy)
    for name, one in known.items():
        check_tube(one, among.predictors[name])
    return known


@final
class _Given:
    """The ends of all rows, and which rows are not valid."""

    def __init__(self, among: CablesPredictor, ends: Mapping[str, Tables], kinds: Mapping[str, str] | None) -> None:
        names = among.predictors
        told = of_all("starts", ends, names, _WRITE)
        self.tables: dict[str, Array] = {}  # of held ends, "cable.start"
        self.free: dict[str, FreeEnd] = {}
        for name, both in told.items():
            if not isinstance(both, (tuple, list)) or len(both) != 2:
                raise ArgumentError.of(f"starts[{name!r}]", both, "it must be (starts, ends)", _WRITE)
            self.tables[f"{name}.start"] = pose_table(f"{name}.start", both[0])
            if both[1] is None or isinstance(both[1], FreeEnd):
                self.free[name] = both[1] or FreeEnd()
            else:
                self.tables[f"{name}.end"] = pose_table(f"{name}.end", both[1])
        lengths = {end: len(table) for end, table in self.tables.items()}
        if len(set(lengths.values())) > 1:
            raise ArgumentError.of("starts", lengths, "all must have as many rows", "Give a pose of each end a row.")
        self.kinds = checks.mapping("kinds", kinds, self.tables, "Write {'a.start': 'swivel'}.")
        for end, kind in self.kinds.items():
            checks.one_of(f"kinds[{end!r}]", kind, GRIP_KINDS)
        self.rows = next(iter(lengths.values()))
        points = next(iter(names.values())).problem.points
        most = MOST_NUMBERS // (NUMBERS_PER_POINT * points * len(names))
        if self.rows > most:
            bound = f"{most} rows of {points} points of {len(names)} cables are allowed"
            raise ArgumentError.of("starts", f"{self.rows} rows", bound, "Split them.")
        self.invalid: NDArray[np.bool_] = np.zeros(self.rows, np.bool_)
        self.errors: dict[int, ArgumentError] = {}
        for end, table in self.tables.items():
            for row, error in normalise(end, table).items():
                self.invalid[row] = True
                self.errors.setdefault(row, error)

    def kind(self, name: str, side: str) -> str:
        """How an end is held."""
        return str(self.kinds.get(f"{name}.{side}", "clamped"))

    def ends(self, name: str, row: int) -> tuple[Grip, Grip | FreeEnd]:
        """The ends of a cable in a row."""
        held = [
            Grip(Pose.trusted(self.tables[f"{name}.{side}"][row]), self.kind(name, side))
            for side in SIDES
            if f"{name}.{side}" in self.tables
        ]
        return held[0], held[1] if len(held) > 1 else self.free[name]


@final
class _Work:
    """One call of :func:`predict_cables`."""

    def __init__(
        self,
        predictor: CablesPredictor,
        given: _Given,
        moves: Mapping[str, Any],
        known: Mapping[str, Uncertainty],
        deadline: float,
    ) -> None:
        self.predictor, self.given, self.moves, self.known, self.deadline = predictor, given, moves, known, deadline
        cables = {name: one.cable for name, one in predictor.predictors.items()}
        scene = predictor.scene
        #: How many of a cable's bodies are none of the cables.
        self.fixed = 0 if scene.contact == "off" else sum(body.link is None for body in scene.obstacles)
        bodies = tuple(body for body in scene.obstacles if body.link is None) if self.fixed else ()
        self.near = CableNear(cables, dataclasses.replace(scene, obstacles=bodies)) if scene.contact != "off" else None
        self.judges = {
            name: RowJudge(cable, predictor.scenes[name], () if self.near is None else self.near.bodies(name))
            for name, cable in cables.items()
        }
        self.batch = CablesBatch(
            {name: judge.batch(given.rows, predictor.predictors[name].problem) for name, judge in self.judges.items()}
        )
        self.tubes = {
            name: TubeWatch(cables[name], one, **predictor.options[name])
            for name, one in (known.items() if predictor.solves_crossing else ())
        }
        for name, one in known.items():
            told = self.batch.cables[name]
            told.confidence, told.radius = one.confidence, np.full((given.rows, told.points), math.nan)

    # -- each cable by itself

    def solve_alone(self, predict: Callable[..., ShapeBatch], threads: int | None, more: Mapping[str, Any]) -> None:
        """Every valid row in which nothing touches, or all of them where that is not solved for.

        predict: rows of a single cable; more: its keywords beside those of the predictor.
        """
        found = {name: self._each(predict, name, threads, more) for name in self.judges}
        good: NDArray[np.bool_] = ~self.given.invalid
        for one in found.values():
            good &= one.done
            if self.predictor.solves_crossing:
                good &= (one.status == Status.OK.value) & ~(one.clearance < 0.0)
        for name, one in found.items():
            self.batch.cables[name].tell_several_as(one)
        shapes = {row: {name: one[row] for name, one in found.items()} for row in np.flatnonzero(good).tolist()}
        if self.predictor.solves_crossing:
            shapes = {row: each for row, each in shapes.items() if not self.predictor.overlapping(each)}
        for name, one in found.items():
            _copy(one, self.batch.cables[name], np.array(list(shapes), np.int64), self.fixed)
        for row, each in shapes.items():
            self._add_others(row, each, {name: one.clearance_of(row) for name, one in found.items()})
            self.batch.tell(row)

    def _each(
        self, predict: Callable[..., ShapeBatch], name: str, threads: int | None, more: Mapping[str, Any]
    ) -> ShapeBatch:
        """The rows of one cable as if nothing touched it."""
        given, options = self.given, dict(self.predictor.options[name])
        scene: Scene = options.pop("scene")
        options.pop("friction")
        if self.predictor.solves_crossing:
            scene = dataclasses.replace(scene, contact="warn")
        left = self.deadline - perf_counter()
        free = name in given.free
        try:
            return predict(
                self.predictor.predictors[name].cable,
                given.tables[f"{name}.start"],
                given.free[name] if free else given.tables[f"{name}.end"],
                start_kind=given.kind(name, "start"),
                end_kind="clamped" if free else given.kind(name, "end"),
                scene=scene,
                acceleration=self.moves.get(name),
                uncertainty=self.known.get(name),
                threads=threads,
                time_limit=None if left == math.inf else max(left, 1e-9),
                **options,
                **more,
            )
        except ArgumentError as error:
            raise type(error)(f"cable {name!r}: {error}") from None

    def _add_others(self, row: int, shapes: Mapping[str, CableShape], clearance: Mapping[str, Any]) -> None:
        """How near the cables of a row that is done are to each other."""
        if self.near is None:
            return
        for name, one in self._joined(row, shapes, clearance).items():
            self.judges[name].keep_others(self.batch.cables[name], row, shapes[name], one, self.fixed)

    def _joined(self, row: int, shapes: Mapping[str, CableShape], clearance: Mapping[str, Any]) -> dict[str, Any]:
        """Clearances with the other cables in them."""
        if self.near is None:
            return dict(clearance)
        swell = {}
        for name, one in self.batch.cables.items():
            if one.radius is not None and not math.isnan(one.radius[row, 0]):
                swell[name] = float(one.radius[row].max())
        return self.near.added(shapes, clearance, swell)

    # -- together

    def solve_left(self) -> None:
        """Every valid row that is not done yet, if cables are kept out of each other."""
        if not self.predictor.solves_crossing:
            return
        for row in np.flatnonzero(~(self.batch.done | self.given.invalid)).tolist():
            if perf_counter() > self.deadline:
                return
            self._solve_together(row)

    def _solve_together(self, row: int) -> None:
        """A row from nothing."""
        ends: dict[str, Ends] = {name: self.given.ends(name, row) for name in self.judges}
        self.predictor.reset()
        shapes = self.predictor.predict(ends, acceleration=self.moves)
        clearance = {}
        for name, shape in shapes.items():
            one, swell = self.batch.cables[name], None
            if name in self.tubes and shape.status:
                watch = self.tubes[name]
                watch.reset()
                tube = watch.tube(self.predictor.predictors[name], shape, ends[name], None, self.moves.get(name))
                swell = None if tube is None else tube.radius
                assert one.radius is not None
                one.radius[row] = math.nan if swell is None else swell
            clearance[name] = self.judges[name].checker.check(shape, swell=swell)
        for name, near in self._joined(row, shapes, clearance).items():
            state, held = self.predictor.state_of(name), isinstance(ends[name][1], Grip)
            self.judges[name].keep(self.batch.cables[name], row, shapes[name], near, state, held)
        self.batch.tell(row)


def _copy(one: ShapeBatch, other: ShapeBatch, rows: NDArray[np.int64], bodies: int) -> None:
    """Makes rows of one batch those of another, which knows more than its first bodies."""
    for name in ("buffer", "info", "loads", "missing_length", "turns", "models", "status", "iterations"):
        getattr(other, name)[rows] = getattr(one, name)[rows]
    other.tables[rows, :bodies] = one.tables[rows]
    other.margin_rows[rows, : one.margin_rows.shape[1]] = one.margin_rows[rows]
    if one.radius is not None and other.radius is not None:
        other.radius[rows] = one.radius[rows]
    for kept in ("details", "unread_errors", "touches"):
        told = getattr(one, kept)
        getattr(other, kept).update({row: told[row] for row in rows.tolist() if row in told})
    other.done[rows] = True
