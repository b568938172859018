"""How a study's measures change with what varies: :func:`slopes`.

Of clearances and of the lowest point the derivative is exact, from that of the shape (`Predictor.sensitivity`), by the
length, weight and stiffness of a cable and the places of grips and clips. All else is told by central differences of
the worst instant alone, solved on its mesh from its solution; where compiled code cannot follow the cable, of the whole
motion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.study_case import Case
from cable_shape.planning.study_chunk import solve_chunk
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_result import Question
from cable_shape.planning.study_walk import Followed, Rows, follows, predictor_of, rows_of
from cable_shape.solve.answers import NUMBERS
from cable_shape.solve.cosserat import sensitivity
from cable_shape.solve.network import Network

#: Steps of differences, of the scale of what varies.
STEP = 1e-3
_MOVED = re.compile(r"(start|end|scene\.clips\.([^.]+))\.position\.([xyz0-2])")
_COMPONENT = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}


@final
class Asked(NamedTuple):
    """A measure at an instant."""

    measure: int
    instant: int


@final
class Slopes(NamedTuple):
    """Derivatives of measures with what varies.

    slope : (k, axes), of each of the k that were asked for; NaN where there is none
    exact : (k, axes), whether it is from the derivative of the shape
    solves : single shapes that were solved for
    """

    slope: Array
    exact: NDArray[np.bool_]
    solves: int


def slopes(study: Question, point: Array, asked: Sequence[Asked], scale: Array, by: Sequence[int]) -> Slopes:
    """The derivatives of measures at their instants with the axes `by`, at a point (axes,).

    scale (axes,): by which what varies is measured, its spread or its range.
    """
    out = Slopes(np.full((len(asked), len(by)), math.nan), np.zeros((len(asked), len(by)), np.bool_), 0)
    case = study.cases.at(point.tolist())
    if isinstance(case.cable, Harness) or case.robot is not None or not follows(case, predictor_of(case)):
        return _of_motions(study, point, asked, scale, by, out)
    solves = 0
    for instant in dict.fromkeys(one.instant for one in asked):
        here = _Here(study, case, point, instant)
        solves += 1
        for column, a in enumerate(by):
            columns = here.columns(a)
            for k, (m, at) in enumerate(asked):
                normal = None if columns is None or at != instant else _normal(study.measures[m], here.rows)
                if normal is not None and columns is not None:
                    place, direction = normal
                    out.slope[k, column] = float(direction @ _at(here.rows, columns, place))
                    out.exact[k, column] = True
            left = [k for k, (_, at) in enumerate(asked) if at == instant and not out.exact[k, column]]
            if left:
                both = [here.beside(a, side * STEP * scale[a]) for side in (1.0, -1.0)]
                solves += 2
                for k in left:
                    high, low = (_value(study.measures[asked[k].measure], rows) for rows in both)
                    out.slope[k, column] = (high - low) / (2.0 * STEP * scale[a])
    return out._replace(solves=solves)


def _of_motions(
    study: Question, point: Array, asked: Sequence[Asked], scale: Array, by: Sequence[int], out: Slopes
) -> Slopes:
    """By differences of whole motions."""
    steps = (STEP * np.diag(scale))[list(by)]
    over = solve_chunk(study.cases, study.measures, np.concatenate((point + steps, point - steps)), True).over
    for k, (m, instant) in enumerate(asked):
        if instant < over.shape[1]:
            values = over[:, instant, m]
            out.slope[k] = (values[: len(by)] - values[len(by) :]) / (2.0 * STEP * scale[list(by)])
    return out._replace(solves=over.shape[0] * over.shape[1])


def _value(measure: Measure, rows: Rows | None) -> float:
    return math.nan if rows is None or not rows.usable[0] else float(measure.of(rows)[0][0])


def _normal(measure: Measure, rows: Rows) -> tuple[float, Array] | None:
    """Arc length at which a measure of one shape is told, and its derivative by the place of that point (3,)."""
    kind, _, what = measure.name.partition(":")
    if measure.function is not None or kind not in ("clearance", "lowest"):
        return None
    value, place = (float(x[0]) for x in measure.of(rows))
    if kind == "lowest":
        return place, np.array((0.0, 0.0, 1.0))
    if not math.isfinite(value):
        return None
    which = rows.bodies.index(what) if what else int(np.nanargmin(rows.tables[0, :, 0]))
    point = np.array(
        [np.interp(place, np.linspace(0.0, rows.cable.length, rows.points), x) for x in rows.part(1, 3)[0].T]
    )
    way = point - rows.tables[0, which, 5:8]
    far = float(np.linalg.norm(way))
    inside = value + rows.checker.radius < 0.0
    return None if far < 1e-9 else (place, (-way if inside else way) / far)


@final
class _Here:
    """One instant of a point, and the shapes beside it."""

    def __init__(self, study: Question, case: Case, point: Array, instant: int) -> None:
        self.study, self.case, self.point, self.instant = study, case, point, instant
        until = _cut(case, 0, instant + 1)
        predictor = predictor_of(until)
        rows = rows_of(until, predictor)
        followed = Followed(until, rows, predictor.problem)
        followed.run()
        assert followed.state is not None
        self.state: Network = followed.state
        self.rows = self.beside(0, 0.0) or rows

    def beside(self, axis: int, step: float) -> Rows | None:
        """The shape with one thing varied by `step`, from that of here; None where there is no such cable."""
        point = self.point.copy()
        point[axis : axis + 1] += step
        try:
            case = _cut(self.study.cases.at(point.tolist()), self.instant, self.instant + 1)
            predictor = predictor_of(case)
            rows = rows_of(case, predictor)
            Followed(case, rows, predictor.problem).run(self.state.copied() if self.state.history else None)
        except ArgumentError:
            return None
        return rows

    def columns(self, axis: int) -> Array | None:
        """(n, 3), the derivative of the shape, points keeping their share of the length; None: not known."""
        name, state = self.study.axes[axis].name, self.state
        if state.history == 0:
            return None
        moved = _MOVED.fullmatch(name)
        if moved is not None:
            side, clip, component = moved.groups()
            motion = self.study.cases.values.get("motion") or {}
            if clip is None and (motion.get(side) is not None or motion.get("joints") is not None):
                return None
            found = sensitivity(state, [side if clip is None else f"clip:{self._clip(clip)}"])
            return np.asarray(found[:, :, _COMPONENT[component]])
        section, _, number = name.partition(".")
        if section != "cable" or number not in NUMBERS:
            return None
        told = self.study.cases.told(self.point.tolist())
        cable = state.problem.cable
        if "youngs_modulus" in told["cable"]:
            return None
        if number == "bending_stiffness":
            both = sensitivity(state, ["bending_stiffness", "twisting_stiffness"])
            follows_it = told["cable"].get("twisting_stiffness") is None
            ratio = cable.twisting_stiffness / cable.mean_bending_stiffness if follows_it else 0.0
            return np.asarray(both[:, :, 0] + ratio * both[:, :, 1])
        return np.asarray(sensitivity(state, [number])[:, :, 0])

    def _clip(self, told: str) -> str:
        return told if told in self.rows.clips else self.rows.clips[int(told)]


def _at(rows: Rows, columns: Array, place: float) -> Array:
    """(3,), columns (n, 3) at an arc length."""
    arcs = np.linspace(0.0, rows.cable.length, rows.points)
    return np.array([np.interp(place, arcs, x) for x in columns.T])


def _cut(case: Case, first: int, last: int) -> Case:
    """Some of its instants."""
    links = None if case.links is None else case.links[first:last]
    return case._replace(frames={end: table[first:last] for end, table in case.frames.items()}, links=links)
