"""What a row of a :class:`.cables_batch.CablesBatch` is made of: a :class:`CablePart` or a :class:`HarnessPart` each.

Strands are cables, and segments of harnesses, by what clearance and margins call them: "c", "h/a".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.cycle.harness_cycle import beside_each_other
from cable_shape.cycle.harness_stability import HarnessStability
from cable_shape.errors import ArgumentError
from cable_shape.planning.batch_spread import check_tube
from cable_shape.planning.harness_batch import (
    HarnessBatch,
    normalise,
    pose_table,
    predict_rows,
    tables_of,
    tell_stability,
)
from cable_shape.planning.row_judge import RowJudge
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.pose import IDENTITY, FreeEnd, Grip, Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.layout import cable_id
from cable_shape.prediction.predictor import Predictor
from cable_shape.safety.report import Clearance
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import Problem
from cable_shape.uncertainty.harness_tube_watch import HarnessTubeWatch
from cable_shape.uncertainty.tube_watch import TubeWatch
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

SIDES = ("start", "end")
WRITE = (
    "Write {name of the cable: (starts, ends)} of every cable, tables (k, 7); ends may be a FreeEnd or None. Of a "
    "harness {end: table}."
)


class Part(Protocol):
    """A cable or a harness among others: what holds it in each row, and what it does with its rows."""

    tables: dict[str, Array]
    """(k, 7) of held ends, "c.start" or "h/a.start"."""
    cables: dict[str, Cable]
    """By strand."""
    problems: list[Problem]
    """Of the strands."""
    meeting: set[frozenset[str]]
    """Strands that are not checked against each other."""
    errors: dict[int, ArgumentError]
    """What is wrong with rows that are not valid."""
    kinds: dict[str, str]
    """How ends are held, by the names of `tables`; those that are not named are clamped."""

    def batch(self, made: Mapping[str, ShapeBatch]) -> Any:
        """The rows of the whole, of which those of the strands are `made`."""

    def know(self, uncertainty: Uncertainty, *, together: bool, **options: Any) -> None:
        """Takes what is not known of it; options: of its predictor; together: rows may be solved together."""

    def ends(self, row: int) -> Any:
        """What holds it in a row, as its predictor takes it."""

    def alone(self, predict: Callable[..., ShapeBatch], threads: int | None, **options: Any) -> Any:
        """All rows as if there were no others; predict: those of a cable."""

    def strands(self, whole: Any) -> dict[str, Any]:
        """Rows, or a shape, strand by strand."""

    def take(self, found: Any, rows: NDArray[np.int64], batch: Any) -> None:
        """Takes over of rows found alone what the strands do not tell."""

    def tubes(self, shape: Any, ends: Any, acceleration: Any) -> dict[str, Tube]:
        """Of the strands of the shape just predicted; none where it is not known."""

    def keep(
        self, batch: Any, row: int, shape: Any, clearance: Mapping[str, Clearance], judges: Mapping[str, RowJudge]
    ) -> None:
        """Makes the shape just predicted a row, which is done."""


@final
class CablePart:
    """See `Part`. both: tables of its starts and ends."""

    def __init__(self, name: str, predictor: Predictor, both: Any) -> None:
        if not isinstance(both, (tuple, list)) or len(both) != 2:
            raise ArgumentError.of(f"starts[{name!r}]", both, "it must be (starts, ends)", WRITE)
        self.name, self.predictor = name, predictor
        self.cables, self.problems = {name: predictor.cable}, [predictor.problem]
        self.meeting: set[frozenset[str]] = set()
        self.free = both[1] or FreeEnd() if both[1] is None or isinstance(both[1], FreeEnd) else None
        held = SIDES if self.free is None else SIDES[:1]
        self.tables = {f"{name}.{side}": pose_table(f"{name}.{side}", both[SIDES.index(side)]) for side in held}
        self.errors = _wrong(self.tables)
        self.kinds: dict[str, str] = {}
        self._known: Uncertainty | None = None
        self._watch: TubeWatch | None = None

    def batch(self, made: Mapping[str, ShapeBatch]) -> ShapeBatch:
        """See `Part`."""
        return made[self.name]

    def know(self, uncertainty: Uncertainty, *, together: bool, **options: Any) -> None:
        """See `Part`."""
        check_tube(uncertainty, self.predictor)
        self._known = uncertainty
        if together:
            own = {key: value for key, value in options.items() if key not in ("model", "tolerance")}
            self._watch = TubeWatch(self.predictor.cable, uncertainty, **own)

    def ends(self, row: int) -> tuple[Grip, Grip | FreeEnd]:
        """See `Part`."""
        held = [Grip(Pose.trusted(table[row]), self.kinds.get(end, "clamped")) for end, table in self.tables.items()]
        return held[0], held[1] if self.free is None else self.free

    def alone(self, predict: Callable[..., ShapeBatch], threads: int | None, **options: Any) -> ShapeBatch:
        """See `Part`."""
        options.pop("friction")
        start, end = (f"{self.name}.{side}" for side in SIDES)
        return predict(
            self.predictor.cable, self.tables[start], self.tables.get(end, self.free), uncertainty=self._known,
            start_kind=self.kinds.get(start, "clamped"), end_kind=self.kinds.get(end, "clamped"), threads=threads,
            **options,
        )  # fmt: skip

    def strands(self, whole: Any) -> dict[str, Any]:
        """See `Part`."""
        return {self.name: whole}

    def take(self, found: ShapeBatch, rows: NDArray[np.int64], batch: ShapeBatch) -> None:
        """See `Part`."""
        batch.tell_several_as(found)

    def tubes(self, shape: CableShape, ends: Any, acceleration: ArrayLike | None) -> dict[str, Tube]:
        """See `Part`."""
        if self._watch is None or not shape.status:
            return {}
        self._watch.reset()
        tube = self._watch.tube(self.predictor, shape, ends, None, acceleration)
        return {} if tube is None else {self.name: tube}

    def keep(
        self,
        batch: ShapeBatch,
        row: int,
        shape: CableShape,
        clearance: Mapping[str, Clearance],
        judges: Mapping[str, RowJudge],
    ) -> None:
        """See `Part`."""
        judge, state = judges[self.name], self.predictor.rod_state
        judge.keep(batch, row, shape, clearance[self.name], state, self.free is None)


@final
class HarnessPart:
    """See `Part`. ends: tables, or loads of free ends, by end."""

    def __init__(self, name: str, predictor: HarnessPredictor, ends: Any) -> None:
        self.name, self.predictor = name, predictor
        harness = predictor.harness
        self.cables = {cable_id(name, segment): cable for segment, cable in harness.segments.items()}
        self.problems: list[Problem] = list(predictor.problem.segments.values())
        self.meeting = beside_each_other(name, harness)
        try:
            own, self.free = tables_of(harness, ends)
            predictor.problem.move({**dict.fromkeys(own, Grip(IDENTITY)), **self.free})  # refuses what cannot be held
        except ArgumentError as error:
            raise type(error)(f"starts[{name!r}]: {error}") from None
        self.tables = {f"{name}/{end}": table for end, table in own.items()}
        self.errors = _wrong({end: table.copy() for end, table in self.tables.items()})
        self.kinds: dict[str, str] = {}
        self._stability = HarnessStability(predictor, 0.0)
        self._known: Uncertainty | None = None
        self._watch: HarnessTubeWatch | None = None

    def batch(self, made: Mapping[str, ShapeBatch]) -> HarnessBatch:
        """See `Part`."""
        segments = self.predictor.harness.segments
        return HarnessBatch(
            self.predictor.harness, dict(zip(segments, (made[one] for one in self.cables), strict=True))
        )

    def know(self, uncertainty: Uncertainty, *, together: bool, **options: Any) -> None:
        """See `Part`."""
        checks.instance(f"uncertainty[{self.name!r}]", uncertainty, (Uncertainty,), "Write Uncertainty({...}).")
        self._known = uncertainty
        if together:
            self._watch = HarnessTubeWatch(self.predictor.harness, uncertainty, **options)

    def ends(self, row: int) -> dict[str, Grip | FreeEnd]:
        """See `Part`."""
        held = {
            self._own(end): Grip(Pose(table[row, :3], table[row, 3:]), self.kinds.get(end, "clamped"))
            for end, table in self.tables.items()
        }
        return {**held, **self.free}

    def _own(self, end: str) -> str:
        """What the harness calls an end."""
        return end.removeprefix(f"{self.name}/")

    def alone(self, predict: Callable[..., ShapeBatch], threads: int | None, **options: Any) -> HarnessBatch:
        """See `Part`."""
        told: dict[str, Any] = {**{self._own(end): table for end, table in self.tables.items()}, **self.free}
        kinds = {self._own(end): kind for end, kind in self.kinds.items()}
        return predict_rows(self.predictor.harness, told, kinds=kinds, uncertainty=self._known, **options)

    def strands(self, whole: Any) -> dict[str, Any]:
        """See `Part`."""
        return dict(zip(self.cables, whole.segments.values(), strict=True))

    def take(self, found: HarnessBatch, rows: NDArray[np.int64], batch: HarnessBatch) -> None:
        """See `Part`."""
        for row in rows.tolist():
            batch.keep(row, found[row])

    def tubes(self, shape: HarnessShape, ends: Any, acceleration: Mapping[str, ArrayLike] | None) -> dict[str, Tube]:
        """See `Part`."""
        if self._watch is None:
            return {}
        self._watch.reset()
        found = self._watch.tubes(self.predictor, shape, ends, acceleration)
        return {cable_id(self.name, segment): tube for segment, tube in found.items()}

    def keep(
        self,
        batch: HarnessBatch,
        row: int,
        shape: HarnessShape,
        clearance: Mapping[str, Clearance],
        judges: Mapping[str, RowJudge],
    ) -> None:
        """See `Part`."""
        for (strand, one), part in zip(self.strands(shape).items(), batch.segments.values(), strict=True):
            judges[strand].keep(part, row, one, clearance[strand])
        batch.keep(row, shape)
        tell_stability(self._stability, shape, batch, row)


def _wrong(tables: Mapping[str, Array]) -> dict[int, ArgumentError]:
    """What is wrong with rows; makes quaternions unit ones."""
    errors: dict[int, ArgumentError] = {}
    for end, table in tables.items():
        for row, error in normalise(end, table).items():
            errors.setdefault(row, error)
    return errors
