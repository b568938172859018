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
    shapes solved for beside them, for derivatives; exact: share of the derivatives that needed none; starts: what the
    grid's best points came to, the best first.
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
        Of lists or ranges; its measures need limits.
    precision : float
        Of the range of each place.
    grid, starts : int
        Points of the coarse grid for each place, and how many of its best ones are gone on from.

    Raises
    ------
    ArgumentError
        Where nothing varies, something is drawn from a distribution, no measure has a limit, or no point has a shape.
    """
    checks.number("precision", precision, above=0.0, at_most=0.1)
    checks.integer("grid", grid, at_least=3, at_most=101)
    checks.integer("starts", starts, at_least=1, at_most=100)
    if not study.axes or any(axis.law or axis.values.min() == axis.values.max() for axis in study.axes):
        bound = "each place must have a range, from one value to another"
        raise ArgumentError.of("vary", [axis.name for axis in study.axes], bound, "Write {from: .., to: .., count: 2}.")
    asked = _Asked(study)
    first = [np.arange(len(axis.words)) if axis.words else np.linspace(0.0, 1.0, grid) for axis in study.axes]
    shares = np.array(list(itertools.product(*first)))
    used = np.array([asked.used(x) for x in shares])
    if not np.isfinite(used).any():
        bound = "no point of the grid has a shape at all instants and a measure with a limit"
        raise ArgumentError.of("study", study.name, bound, "Widen the ranges, or give a limit.")
    found = [asked.gone_on(x, precision) for x in shares[np.argsort(used, kind="stable")[:starts]]]
    row = asked.rows(asked.best)
    shares_used = _used(study, row)
    near = [m.name for m, share in zip(study.measures, shares_used.tolist(), strict=True) if share > asked.least - 0.01]
    exact = asked.exact / max(asked.derivatives, 1)
    return Best(
        asked.point(asked.best), asked.least, tuple(near), row.value[0], asked.solves, asked.shapes, exact,
        tuple(sorted(found)),
    )  # fmt: skip


@final
class _Asked:
    """How much of its limits a point uses, by its shares of the ranges; of choices by their number."""

    def __init__(self, study: Question) -> None:
        self.study = study
        self.low = np.array([0.0 if axis.words else axis.values.min() for axis in study.axes])
        self.wide = np.array([1.0 if axis.words else np.ptp(axis.values) for axis in study.axes])
        self.free = np.flatnonzero([not axis.words for axis in study.axes])
        self.solves = self.shapes = self.derivatives = self.exact = 0
        self.least, self.best = math.inf, self.low
        self._last: tuple[bytes, Chunk] | None = None

    def point(self, shares: Array) -> Array:
        """(axes,)."""
        return np.asarray(self.low + self.wide * shares)

    def rows(self, shares: Array) -> Chunk:
        """What is told of it."""
        key = shares.tobytes()
        if self._last is None or self._last[0] != key:
            self.solves += 1
            self._last = key, solve_chunk(self.study.cases, self.study.measures, self.point(shares)[None], True)
        return self._last[1]

    def used(self, shares: Array) -> float:
        """The greatest share of a limit at any instant; infinite where it has no shape at some."""
        told = self.rows(shares)
        used = _used(self.study, told)
        if told.first[0] >= 0 or not np.isfinite(used).any():
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

    def _conditions(self, shares: Array) -> tuple[list[Asked], Array]:
        """The worst instants of all measures, each the worst of those next to it, and what they use (CONDITIONS,)."""
        told, found = self.rows(shares), []
        for m, measure in enumerate(self.study.measures):
            limit = told.limit[0, m]
            if math.isnan(limit):
                continue
            used = measure.used(told.over[0, :, m], np.full(told.over.shape[1], limit))
            used = np.where(np.isfinite(used), used, -math.inf)
            around = np.concatenate(([-math.inf], used, [-math.inf]))
            worst = np.flatnonzero((used >= around[:-2]) & (used > around[2:]) & np.isfinite(used))
            found += [(float(used[i]), Asked(m, i)) for i in worst.tolist()]
        found.sort(key=lambda one: -one[0])
        found = found[:CONDITIONS]
        out = np.full(CONDITIONS, min(found[-1][0], 0.0) - 1.0)
        out[: len(found)] = [used for used, _ in found]
        return [asked for _, asked in found], out

    def _slopes(self, shares: Array) -> Array:
        """(CONDITIONS, free), derivatives of what they use with the shares; those far from the worst have none."""
        asked, used = self._conditions(shares)
        asked = asked[: int((used[: len(asked)] > NEAR * used[0]).sum())]
        told, out = self.rows(shares), np.zeros((CONDITIONS, self.free.size))
        found = slopes(self.study, self.point(shares), asked, self.wide, self.free.tolist())
        self.shapes += found.solves
        self.derivatives += found.exact.size
        self.exact += int(found.exact.sum())
        for k, (m, instant) in enumerate(asked):
            measure, limit = self.study.measures[m], told.limit[0, m]
            value = told.over[0, instant, m]
            step = 1e-6 * max(abs(value), abs(limit))
            high, low = (float(measure.used(np.array(value + x), np.array(limit))) for x in (step, -step))
            out[k] = (high - low) / (2.0 * step) * found.slope[k] * self.wide[self.free]
        return np.nan_to_num(out)


def _used(study: Question, told: Chunk) -> Array:
    """(q,), NaN without a limit."""
    pairs = zip(study.measures, told.value[0], told.limit[0], strict=True)
    used = [float(m.used(np.array(value), np.array(limit))) for m, value, limit in pairs]
    return np.where(np.isnan(told.limit[0]), math.nan, used)
