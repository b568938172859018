"""Many grasps of several cables and harnesses that may touch each other: :class:`CablesBatch`, made by `predict_batch`.

Rows in which these, each found by itself, are clear of bodies, of each other and of themselves are done with that, the
cables in compiled code and threads. Others are solved one by one, from nothing, as :func:`cable_shape.predict` does.
Either way a row's answer depends on its own ends and on nothing else.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.errors import ArgumentError
from cable_shape.planning.cables_parts import WRITE, CablePart, HarnessPart, Part
from cable_shape.planning.harness_batch import MOST_NUMBERS, HarnessBatch, kinds_of, same_rows
from cable_shape.planning.row_judge import RowJudge
from cable_shape.planning.shape_batch import Several, ShapeBatch
from cable_shape.prediction.cables_predictor import CablesPredictor, named_parts, of_all
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.safety.near import CableNear
from cable_shape.safety.report import Clearance
from cable_shape.scene.scene import Clip, Scene
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.uncertainty.uncertainty import Uncertainty


@final
class CablesBatch(Several[dict[str, Any]]):
    """Shapes of cables and harnesses for k rows of ends; `batch[i]` maps their names to CableShape and HarnessShape.

    Attributes
    ----------
    cables : mapping of cable name to ShapeBatch
        All that is told of each, and of segments, by "h/a". Of its `bodies` the last ones are the other cables and
        segments, and "itself"; those that meet in a junction are not checked against each other.
    harnesses : mapping of harness name to HarnessBatch
        Of which the segments are those of `cables`.
    positions, distances, used, radius : mapping of cable name to what its ShapeBatch has
    clearance, worst : (k,)
        Of all cables.
    status : (k,) int
        The gravest of the cables'.
    done, partial, usable, errors, details, iterations, time
        As of :class:`cable_shape.ShapeBatch`.
    """

    def __init__(self, strands: Mapping[str, ShapeBatch], parts: Mapping[str, ShapeBatch | HarnessBatch]) -> None:
        super().__init__(strands)
        self.of = dict(parts)  # of cables and harnesses, in the order that was given

    @property
    def cables(self) -> dict[str, ShapeBatch]:
        """See the class."""
        return self.parts

    @property
    def harnesses(self) -> dict[str, HarnessBatch]:
        """See the class."""
        return {name: one for name, one in self.of.items() if isinstance(one, HarnessBatch)}

    def tell(self, row: int) -> None:
        """Takes over what became of a row's cables."""
        every = self.of.values()
        self.done[row] = all(batch.done[row] for batch in every)
        self.status[row] = max(int(batch.status[row]) for batch in every)
        self.iterations[row] = sum(int(batch.iterations[row]) for batch in every)
        told = {name: batch.details[row] for name, batch in self.of.items() if row in batch.details}
        if told:
            self.details[row] = " ".join(f"cable {name!r}: {detail}" for name, detail in told.items())

    def end(self, errors: Mapping[int, ArgumentError], *, partial: bool, time: float) -> None:
        """Of rows that are not done nothing is told but what is wrong with them."""
        every: list[Any] = [self, *self.cables.values(), *self.harnesses.values()]
        for batch in every:
            batch.done[:] = self.done
            batch.partial, batch.time = partial, time
            batch.errors.update(errors)
            batch.details.update({row: str(error) for row, error in errors.items()})
        for one in self.cables.values():
            one.blank()

    def __getitem__(self, row: int) -> dict[str, Any]:
        """The shapes of row `row`; of one that was not done the status is NOT_CONVERGED and positions are NaN."""
        return {name: batch[row] for name, batch in self.of.items()}


def predict_cables(
    cables: Mapping[str, Cable | Harness],
    ends: Mapping[str, Any],
    alone: Callable[..., ShapeBatch],
    *,
    kinds: Mapping[str, str] | None = None,
    clips: Mapping[str, Sequence[Clip]] | None = None,
    scene: Scene | None = None,
    acceleration: Mapping[str, Any] | None = None,
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
    predictor = CablesPredictor(named_parts(cables), scene=scene, clips=clips, friction=False, **options)
    parts = _parts(predictor, ends, kinds)
    moves = checks.mapping("acceleration", acceleration, predictor.predictors, "Write {name of the cable: ..}.")
    common = {key: options[key] for key in ("model", "tolerance") if key in options}
    own = {name: {**one, **common} for name, one in predictor.options.items()}
    work = _Work(predictor, parts, moves, _known(uncertainty, predictor), own, deadline)
    work.solve_alone(alone, threads)
    work.solve_left()
    batch = work.batch
    batch.end(work.errors, partial=not bool((batch.done | work.invalid).all()), time=perf_counter() - began)
    return batch


def _known(
    uncertainty: Uncertainty | Mapping[str, Uncertainty] | None, among: CablesPredictor
) -> dict[str, Uncertainty]:
    """What is known of each cable; those that are known exactly are left out."""
    if isinstance(uncertainty, Uncertainty):
        return dict.fromkeys(among.predictors, uncertainty)
    remedy = "Write Uncertainty({...}), or {name of the cable: Uncertainty({...})}."
    return checks.mapping("uncertainty", uncertainty, among.predictors, remedy)


def _parts(among: CablesPredictor, ends: Mapping[str, Any], kinds: Mapping[str, str] | None) -> dict[str, Part]:
    """The cables and harnesses, with what holds them in each row."""
    parts: dict[str, Part] = {}
    for name, told in of_all("starts", ends, among.predictors, WRITE).items():
        predictor = among.predictors[name]
        harness = isinstance(predictor, HarnessPredictor)
        parts[name] = HarnessPart(name, predictor, told) if harness else CablePart(name, predictor, told)
    tables = {end: table for part in parts.values() for end, table in part.tables.items()}
    same_rows("starts", tables)
    named = kinds_of(kinds, tables)
    for part in parts.values():
        part.kinds = {end: kind for end, kind in named.items() if end in part.tables}
    rows, strands = len(next(iter(tables.values()))), sum(len(part.cables) for part in parts.values())
    points = next(iter(among.predictors.values())).problem.points
    most = MOST_NUMBERS // (NUMBERS_PER_POINT * points * strands)
    if rows > most:
        bound = f"{most} rows of {points} points of {strands} cables are allowed"
        raise ArgumentError.of("starts", f"{rows} rows", bound, "Split them.")
    return parts


@final
class _Work:
    """One call of :func:`predict_cables`; options: of each one's own predictor."""

    def __init__(
        self,
        predictor: CablesPredictor,
        parts: Mapping[str, Part],
        moves: Mapping[str, Any],
        known: Mapping[str, Uncertainty],
        options: Mapping[str, Mapping[str, Any]],
        deadline: float,
    ) -> None:
        self.predictor, self.parts, self.moves, self.options = predictor, parts, moves, options
        self.deadline = deadline
        rows = len(next(iter(next(iter(parts.values())).tables.values())))
        self.errors: dict[int, ArgumentError] = {}
        for part in parts.values():
            self.errors = {**part.errors, **self.errors}
        self.invalid: NDArray[np.bool_] = np.zeros(rows, np.bool_)
        self.invalid[list(self.errors)] = True
        cables = {strand: cable for part in parts.values() for strand, cable in part.cables.items()}
        scene = predictor.scene
        #: How many of a cable's bodies are none of the cables.
        self.fixed = 0 if scene.contact == "off" else sum(body.link is None for body in scene.obstacles)
        bodies = tuple(body for body in scene.obstacles if body.link is None) if self.fixed else ()
        meeting = {pair for part in parts.values() for pair in part.meeting}
        self.near = None
        if scene.contact != "off":
            self.near = CableNear(cables, dataclasses.replace(scene, obstacles=bodies), joined=meeting)
        self.judges: dict[str, RowJudge] = {}
        made: dict[str, ShapeBatch] = {}
        for name, part in parts.items():
            for (strand, cable), problem in zip(part.cables.items(), part.problems, strict=True):
                others = () if self.near is None else self.near.bodies(strand)
                judge = self.judges[strand] = RowJudge(cable, predictor.scenes[name], others)
                made[strand] = judge.batch(rows, problem)
        self.batch = CablesBatch(made, {name: part.batch(made) for name, part in parts.items()})
        for name, one in known.items():
            parts[name].know(one, together=predictor.solves_crossing, **options[name])
            for strand in parts[name].cables:
                told = made[strand]
                told.confidence, told.radius = one.confidence, np.full((rows, told.points), math.nan)

    # -- each by itself

    def solve_alone(self, predict: Callable[..., ShapeBatch], threads: int | None) -> None:
        """Every valid row in which nothing touches, or all of them where that is not solved for.

        predict: rows of a single cable.
        """
        found = {name: self._each(predict, name, threads) for name in self.parts}
        good: NDArray[np.bool_] = ~self.invalid
        for one in found.values():
            good &= one.done
            if self.predictor.solves_crossing:
                good &= (one.status == Status.OK.value) & ~(one.clearance < 0.0)
        shapes = {row: {name: one[row] for name, one in found.items()} for row in np.flatnonzero(good).tolist()}
        if self.predictor.solves_crossing:
            shapes = {row: each for row, each in shapes.items() if not self.predictor.overlapping(each)}
        rows, strands = np.array(list(shapes), np.int64), dict[str, ShapeBatch]()
        for name, part in self.parts.items():
            own: dict[str, ShapeBatch] = part.strands(found[name])
            for strand, one in own.items():
                _copy(one, self.batch.cables[strand], rows, self.fixed)
            part.take(found[name], rows, self.batch.of[name])
            strands.update(own)
        for row, each in shapes.items():
            self._add_others(row, self._strands(each), {name: one.clearance_of(row) for name, one in strands.items()})
            self.batch.tell(row)

    def _each(self, predict: Callable[..., ShapeBatch], name: str, threads: int | None) -> Any:
        """The rows of one as if nothing touched it."""
        options = dict(self.options[name])
        if self.predictor.solves_crossing:
            options["scene"] = dataclasses.replace(options["scene"], contact="warn")
        left = self.deadline - perf_counter()
        options["time_limit"] = None if left == math.inf else max(left, 1e-9)
        try:
            return self.parts[name].alone(predict, threads, acceleration=self.moves.get(name), **options)
        except ArgumentError as error:
            raise type(error)(f"cable {name!r}: {error}") from None

    def _strands(self, shapes: Mapping[str, Any]) -> dict[str, CableShape]:
        """The shapes of cables and of segments."""
        return {strand: one for name, part in self.parts.items() for strand, one in part.strands(shapes[name]).items()}

    def _add_others(self, row: int, shapes: Mapping[str, CableShape], clearance: Mapping[str, Clearance]) -> None:
        """How near the cables of a row that is done are to each other."""
        if self.near is None:
            return
        for name, one in self._joined(row, shapes, clearance).items():
            self.judges[name].keep_others(self.batch.cables[name], row, shapes[name], one, self.fixed)

    def _joined(
        self, row: int, shapes: Mapping[str, CableShape], clearance: Mapping[str, Clearance]
    ) -> dict[str, Clearance]:
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
        for row in np.flatnonzero(~(self.batch.done | self.invalid)).tolist():
            if perf_counter() > self.deadline:
                return
            self._solve_together(row)

    def _solve_together(self, row: int) -> None:
        """A row from nothing."""
        ends = {name: part.ends(row) for name, part in self.parts.items()}
        self.predictor.reset()
        whole = self.predictor.predict(ends, acceleration=self.moves)
        tubes = {
            strand: tube
            for name, part in self.parts.items()
            for strand, tube in part.tubes(whole[name], ends[name], self.moves.get(name)).items()
        }
        shapes, clearance = self._strands(whole), {}
        for strand, shape in shapes.items():
            one, swell = self.batch.cables[strand], tubes[strand].radius if strand in tubes else None
            if one.radius is not None:
                one.radius[row] = math.nan if swell is None else swell
            clearance[strand] = self.judges[strand].checker.check(shape, swell=swell)
        clearance = self._joined(row, shapes, clearance)
        for name, part in self.parts.items():
            part.keep(self.batch.of[name], row, whole[name], clearance, self.judges)
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
