"""How a study's measures change with what varies: :func:`slopes`.

All that can be told of a rod, or of a harness of them, has an exact derivative, by any number that varies: the shapes
on both sides of it, STEP away, follow from the factors of the solution at that instant
(:mod:`cable_shape.prediction.nearby`), and nothing is solved for. A measure that is the worst along the cable has the
derivative at its worst point. What touches itself, harnesses on bodies and closed forms are told by differences of
whole motions, and so is, on bodies, what such a shape does not tell: how stable it is, and whatever a function of the
user's asks of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import sliding
from cable_shape.kernels.network.respond import softest_mode
from cable_shape.kernels.safety import follow_rows
from cable_shape.planning.study_case import Case
from cable_shape.planning.study_chunk import solve_chunk
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_result import Question
from cable_shape.planning.study_walk import (
    Rows,
    any_predictor_of,
    ends_at,
    held_at,
    judged_by,
    link_rows_of,
    links_at,
    memories,
    predictor_of,
    rows_of,
    rows_of_harness,
)
from cable_shape.pose import Grip
from cable_shape.prediction.nearby import Memory, nearby
from cable_shape.shape import CableShape
from cable_shape.solve.network import Network

#: Steps of exact derivatives and of differences of motions, of the scale of what varies; the former not less than LEAST
#: of the number itself, where rounding would be felt.
STEP, OF_MOTIONS, LEAST = 1e-5, 1e-3, 1e-7
#: Inverse iterations for the softest mode beside a shape, from that of the shape.
MODE_STEPS = 20


@final
class Asked(NamedTuple):
    """A measure at an instant."""

    measure: int
    instant: int


@final
class Slopes(NamedTuple):
    """Derivatives of measures with what varies.

    slope : (k, axes), of each of the k that were asked for; NaN where there is none
    exact : (k, axes), whether it is from the factors of the solution
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
    if asked and (isinstance(case.cable, Harness) or predictor_of(case).is_rod):
        out = _of_shapes(study, case, point, asked, scale, by, out)
    left = [column for column in range(len(by)) if not out.exact[:, column].all()]
    if left:
        out = _of_motions(study, point, asked, scale, by, out, left)
    out.exact[np.isnan(out.slope)] = False
    return out


def _of_shapes(
    study: Question, case: Case, point: Array, asked: Sequence[Asked], scale: Array, by: Sequence[int], out: Slopes
) -> Slopes:
    """By the shapes beside those of the instants."""
    instants, solves = sorted({one.instant for one in asked}), 0
    stable = [study.measures[m].name == "stability" for m, _ in asked]
    alone = [stable[k] or study.measures[one.measure].function is not None for k, one in enumerate(asked)]
    steps = [max(STEP * float(scale[a]), LEAST * abs(float(point[a]))) for a in by]
    sides = [[_side(study, point, a, sign * step) for sign in (1.0, -1.0)] for a, step in zip(by, steps, strict=True)]
    middle = _Side(case)
    for instant, state in memories(case, instants):
        solves += 1
        own = [k for k, one in enumerate(asked) if one.instant == instant]
        state.refresh()
        if not isinstance(state, Network):  # contacts are not told, nor how stable they are
            own = [k for k in own if not alone[k]]
        mode = _mode(state) if isinstance(state, Network) and any(stable[k] for k in own) else None
        for column, (pair, step) in enumerate(zip(sides, steps, strict=True)):
            ways = [side is not None and side.find(state, instant, mode) for side in pair]
            if not any(ways):
                continue
            if not all(ways) and not middle.find(state, instant, mode):  # there is no such cable on one side
                continue
            high, low = (side.rows if way and side else middle.rows for side, way in zip(pair, ways, strict=True))
            for k in own:
                measure = study.measures[asked[k].measure]
                out.slope[k, column] = (_value(measure, high) - _value(measure, low)) / (sum(ways) * step)
                out.exact[k, column] = True
    return out._replace(solves=solves)


def _of_motions(
    study: Question, point: Array, asked: Sequence[Asked], scale: Array, by: Sequence[int], out: Slopes,
    left: Sequence[int],
) -> Slopes:  # fmt: skip
    """By differences of whole motions what is `left`, columns of `by`."""
    axes = [by[column] for column in left]
    steps = (OF_MOTIONS * np.diag(scale))[axes]
    over = solve_chunk(study.cases, study.measures, np.concatenate((point + steps, point - steps)), True).over
    for k, (m, instant) in enumerate(asked):
        if instant < over.shape[1]:
            values = over[:, instant, m]
            with np.errstate(invalid="ignore"):  # of bodies that are out of reach
                found = (values[: len(axes)] - values[len(axes) :]) / (2.0 * OF_MOTIONS * scale[axes])
            out.slope[k, left] = np.where(out.exact[k, left], out.slope[k, left], found)
    return out._replace(solves=out.solves + over.shape[0] * over.shape[1])


def _value(measure: Measure, found: Mapping[str, Rows]) -> float:
    """The worst of all segments."""
    told = [x for rows in found.values() if not math.isnan(x := float(measure.of(rows)[0][0]))]
    return (min if measure.worst == "least" else max)(told, default=math.nan)


def _side(study: Question, point: Array, axis: int, step: float) -> _Side | None:
    """What is asked with one thing varied by `step`; None where there is no such cable."""
    beside = point.copy()
    beside[axis] += step
    try:
        return _Side(study.cases.at(beside.tolist()))
    except ArgumentError:
        return None


@final
class _Side:
    """A case beside another one; `rows` has its shape at one instant, by segment; of a cable under the name ""."""

    def __init__(self, case: Case) -> None:
        self.case = case
        predictor = any_predictor_of(case)
        self.problem = predictor.problem
        one = case._replace(frames={end: table[:1] for end, table in case.frames.items()})
        if isinstance(case.cable, Harness):
            self.rows = rows_of_harness(one, case.cable, self.problem.points)
        else:
            self.rows = {"": rows_of(one, predictor)}

    def find(self, state: Memory, instant: int, mode: Array | None) -> bool:
        """Whether there is a shape beside that of `state`; mode (n, 3): the softest one, if stability is asked for."""
        case, links, held = self.case, links_at(self.case, instant), False
        if isinstance(case.cable, Harness):
            self.problem.move(held_at(case, instant))
        else:
            start, end = ends_at(case, instant)
            self.problem.move(start, end, links)
            held = isinstance(end, Grip)
        found = nearby(state, self.problem)
        if found is None:
            return False
        shape, network = found
        shapes = {"": shape} if isinstance(shape, CableShape) else shape.segments
        for name, rows in self.rows.items():
            judged = judged_by(rows, held, np.empty((0, 4)))
            rows.take(0, shapes[name], judged, link_rows_of(rows, links))
            if network is not None and mode is not None:
                memory = np.array((math.nan, 0.0, 0.0))
                follow_rows.tell_stability(
                    network.ints, network.floats, network.sols, network.work, sliding.new_slides(network.ints, True),
                    judged.soft, mode.copy(), MODE_STEPS, True, memory, rows.margins[0],
                )  # fmt: skip
        return True


def _mode(state: Network) -> Array:
    """(n, 3), the softest mode of a solution."""
    mode = np.random.default_rng(0).normal(size=(len(state.nodes), 3))
    softest_mode(
        state.ints, state.floats, state.sols, state.work.copy(), sliding.new_slides(state.ints, True), mode,
        follow_rows.STEPS_AT_FIRST, True, np.empty(2),
    )  # fmt: skip
    return mode
