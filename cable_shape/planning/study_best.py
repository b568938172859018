"""The best point of a study, furthest from its nearest limit: :func:`best`.

What is made least is the greatest share of a limit that is used at any instant. The points of a coarse grid are looked
at, all choices among them, and from the best of them scipy's SLSQP goes on: the share t is made least under the
conditions that no measure uses more at its worst instants, whose derivatives are those of
:func:`cable_shape.planning.study_slopes.slopes`. That has no kinks where another measure or instant takes over.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.study_chunk import Chunk, solve_chunk
from cable_shape.planning.study_result import Question
from cable_shape.planning.study_slopes import Asked, slopes
from cable_shape.planning.study_vary import Axis

#: Points of the grid for each place, and starts that are gone on from.
GRID, STARTS = 9, 3
#: Steps of one start, and worst instants that are conditions.
MOST_STEPS, CONDITIONS = 30, 6
#: Conditions that use less than this share of what the worst one does are taken for constant.
NEAR = 0.5
#: In place of what a point without a shape uses: more than any that is gone on from.
_NO_SHAPE = 1e3


@final
class Best(NamedTuple):
    """The point that was found.

    point (axes,); used: the greatest share of a limit there, 1 at the limit; limiting: measures that use as much, to a
    hundredth, there; value (q,) of all measures; solves: points that were solved for at all instants; shapes: single
    shapes for derivatives, those of their instants and, where none are exact, those beside; exact: share of the
    derivatives that are; starts: what the grid's best points came to, the best first.
    """

    point: Array
    used: float
    limiting: tuple[str, ...]
    value: Array
    solves: int
    shapes: int
    exact: float
    starts: tuple[float, ...]


def best(study: Question, *, precision: float = 1e-4, grid: int = GRID, starts: int = STARTS) -> Best:
    """The point between the least and the greatest values of what varies that uses least of its limits.

    Parameters
    ----------
    study : Study
        Of lists or ranges; its measures need limits. What is drawn from a distribution is a tolerance: the point is
        judged by the worst of all that its `sample` draws.
    precision : float
        Of the range of each place.
    grid, starts : int
        Points of the coarse grid for each place, and how many of its best ones are gone on from.

    Raises
    ------
    ArgumentError
        Where nothing has a range, no measure has a limit, or no point has a shape.
    """
    checks.number("precision", precision, above=0.0, at_most=0.1)
    checks.integer("grid", grid, at_least=3, at_most=101)
    checks.integer("starts", starts, at_least=1, at_most=100)
    chosen = [axis for axis in study.axes if not axis.law]
    if not chosen or any(axis.values.min() == axis.values.max() for axis in chosen):
        bound = "each place must have a range, from one value to another"
        raise ArgumentError.of("vary", [axis.name for axis in study.axes], bound, "Write {from: .., to: .., count: 2}.")
    asked = _Asked(study)
    shares = np.array(list(itertools.product(*(_first(axis, grid) for axis in study.axes))))
    used = np.array([asked.used(x) for x in shares])
    if not np.isfinite(used).any():
        bound = "no point of the grid has a shape at all instants and a measure with a limit"
        raise ArgumentError.of("study", study.name, bound, "Widen the ranges, or give a limit.")
    found = [asked.gone_on(x, precision) for x in shares[np.argsort(used, kind="stable")[:starts]]]
    told = asked.rows(asked.best)
    each = np.fmax.reduce(_used(study, told), axis=0)
    near = [m.name for m, share in zip(study.measures, each.tolist(), strict=True) if share > asked.least - 0.01]
    value = [(np.fmax if m.worst == "most" else np.fmin).reduce(told.value[:, k]) for k, m in enumerate(study.measures)]
    point = [axis.middle if axis.law else x for axis, x in zip(study.axes, asked.points(asked.best)[0], strict=True)]
    return Best(
        np.array(point), asked.least, tuple(near), np.array(value), asked.solves, asked.shapes,
        asked.exact / max(asked.derivatives, 1), tuple(sorted(found)),
    )  # fmt: skip


def _first(axis: Axis, grid: int) -> Array:
    """What the grid takes of one axis: all words, shares of a range, and nothing of what is drawn."""
    return np.zeros(1) if axis.law else np.arange(float(len(axis.words))) if axis.words else np.linspace(0.0, 1.0, grid)


@final
class _Asked:
    """How much of its limits a point uses, by its shares of the ranges; of choices by their number."""

    def __init__(self, study: Question) -> None:
        self.study = study
        plain = [not (axis.words or axis.law) for axis in study.axes]
        ranges = [axis.values if yes else np.array((0.0, 1.0)) for axis, yes in zip(study.axes, plain, strict=True)]
        self.low = np.array([values.min() for values in ranges])
        self.wide = np.array([np.ptp(values) for values in ranges])
        self.free = np.flatnonzero(plain)
        laws = [i for i, axis in enumerate(study.axes) if axis.law]
        shares = study.sample.shares(len(laws)) if laws else np.empty((1, 0))
        self.drawn = {i: study.axes[i].at(column) for i, column in zip(laws, shares.T, strict=True)}
        self.count = len(shares)
        self.solves = self.shapes = self.derivatives = self.exact = 0
        self.least, self.best = math.inf, self.low
        self._last: tuple[bytes, Chunk] | None = None

    def points(self, shares: Array) -> Array:
        """(k, axes), one with every tolerance that is drawn."""
        out = np.tile(self.low + self.wide * shares, (self.count, 1))
        for i, column in self.drawn.items():
            out[:, i] = column
        return out

    def rows(self, shares: Array) -> Chunk:
        """What is told of them."""
        key = shares.tobytes()
        if self._last is None or self._last[0] != key:
            self.solves += self.count
            self._last = key, solve_chunk(self.study.cases, self.study.measures, self.points(shares), True)
        return self._last[1]

    def used(self, shares: Array) -> float:
        """The greatest share of a limit at any instant; infinite where it has no shape at some."""
        told = self.rows(shares)
        used = _used(self.study, told)
        if (told.first >= 0).any() or not np.isfinite(used).any():
            return math.inf
        worst = float(np.nanmax(used))
        if worst < self.least:
            self.least, self.best = worst, shares.copy()
        return worst

    def gone_on(self, begin: Array, precision: float) -> float:
        """What one start comes to: its choices stay, all else is moved."""
        from scipy.optimize import minimize

        before = self.used(begin)
        if not self.free.size or not math.isfinite(before):
            return before
        least = before

        def whole(x: Array) -> Array:
            out = begin.copy()
            out[self.free] = np.clip(x[:-1], 0.0, 1.0)
            return out

        def room(x: Array) -> Array:
            nonlocal least
            worst = self.used(whole(x))
            least = min(least, worst)
            if not math.isfinite(worst):
                return np.full(CONDITIONS, x[-1] - _NO_SHAPE)
            return np.asarray(x[-1] - self._conditions(whole(x))[1])

        def slope(x: Array) -> Array:
            out = np.zeros((CONDITIONS, len(x)))
            out[:, -1] = 1.0
            if math.isfinite(self.used(whole(x))):
                out[:, :-1] = -self._slopes(whole(x))
            return out

        minimize(
            lambda x: x[-1],
            np.append(begin[self.free], before),
            jac=lambda x: np.append(np.zeros(len(x) - 1), 1.0),
            method="SLSQP",
            bounds=[(0.0, 1.0)] * self.free.size + [(None, None)],
            constraints={"type": "ineq", "fun": room, "jac": slope},
            options={"maxiter": MOST_STEPS, "ftol": 10.0 * precision**2},
        )
        return least

    def _conditions(self, shares: Array) -> tuple[list[tuple[int, Asked]], Array]:
        """The worst instants of all measures, of which point drawn, and what they use (CONDITIONS,).

        Each is the worst of those next to it in time.
        """
        told, found = self.rows(shares), []
        for m, measure in enumerate(self.study.measures):
            for row in range(self.count):
                limit = told.limit[row, m]
                if math.isnan(limit):
                    continue
                used = measure.used(told.over[row, :, m], np.full(told.over.shape[1], limit))
                used = np.where(np.isfinite(used), used, -math.inf)
                around = np.concatenate(([-math.inf], used, [-math.inf]))
                worst = np.flatnonzero((used >= around[:-2]) & (used > around[2:]) & np.isfinite(used))
                found += [(float(used[i]), row, Asked(m, i)) for i in worst.tolist()]
        found.sort(key=lambda one: -one[0])
        found = found[:CONDITIONS]
        out = np.full(CONDITIONS, min(found[-1][0], 0.0) - 1.0)
        out[: len(found)] = [used for used, _, _ in found]
        return [(row, asked) for _, row, asked in found], out

    def _slopes(self, shares: Array) -> Array:
        """(CONDITIONS, free), derivatives of what they use with the shares; those far from the worst have none."""
        asked, used = self._conditions(shares)
        asked = asked[: int((used[: len(asked)] > NEAR * used[0]).sum())]
        points, out = self.points(shares), np.zeros((CONDITIONS, self.free.size))
        for row in dict.fromkeys(row for row, _ in asked):
            own = [k for k, one in enumerate(asked) if one[0] == row]
            found = slopes(self.study, points[row], [asked[k][1] for k in own], self.wide, self.free.tolist())
            self.shapes += found.solves
            self.derivatives += found.exact.size
            self.exact += int(found.exact.sum())
            for k, slope in zip(own, found.slope, strict=True):
                out[k] = self._change(self.rows(shares), row, asked[k][1]) * slope * self.wide[self.free]
        return np.nan_to_num(out)

    def _change(self, told: Chunk, row: int, asked: Asked) -> float:
        """Derivative of the share of the limit with the measure's value."""
        measure, limit = self.study.measures[asked.measure], told.limit[row, asked.measure]
        value = told.over[row, asked.instant, asked.measure]
        step = 1e-6 * max(abs(value), abs(limit))
        high, low = (float(measure.used(np.array(value + x), np.array(limit))) for x in (step, -step))
        return float((high - low) / (2.0 * step))


def _used(study: Question, told: Chunk) -> Array:
    """(v, q), NaN without a limit."""
    used = [measure.used(told.value[:, k], told.limit[:, k]) for k, measure in enumerate(study.measures)]
    return np.where(np.isnan(told.limit), math.nan, np.column_stack(used))
