"""The best point of a study, furthest from its nearest limit: :func:`best`.

What is made least is the greatest share of a limit that is used at any instant. It has kinks where another measure or
another instant takes over, so that no derivative is followed: the points of a coarse grid are looked at, and from the
best of them Brent's method, or of several places Nelder and Mead's, goes on; a point without a shape is worse than any.
"""

from __future__ import annotations

import math
from typing import NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.study_chunk import Chunk, solve_chunk
from cable_shape.planning.study_result import Question

#: Points of the grid for each place, and starts that are gone on from.
GRID, STARTS = 9, 3
MOST_SOLVES = 2000


@final
class Best(NamedTuple):
    """The point that was found.

    point (axes,); used: the greatest share of a limit there, 1 at the limit; limiting: measures that use as much, to a
    hundredth, there; value (q,) of all measures; solves: points that were solved for; starts: what the grid's best
    points came to, the best first.
    """

    point: Array
    used: float
    limiting: tuple[str, ...]
    value: Array
    solves: int
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
    from scipy.optimize import minimize, minimize_scalar

    checks.number("precision", precision, above=0.0, at_most=0.1)
    checks.integer("grid", grid, at_least=3, at_most=101)
    checks.integer("starts", starts, at_least=1, at_most=100)
    if not study.axes or any(axis.law or axis.values.min() == axis.values.max() for axis in study.axes):
        bound = "each place must have a range, from one value to another"
        raise ArgumentError.of("vary", [axis.name for axis in study.axes], bound, "Write {from: .., to: .., count: 2}.")
    low = np.array([axis.values.min() for axis in study.axes])
    wide = np.array([axis.values.max() for axis in study.axes]) - low
    asked = _Asked(study, low, wide)
    shares = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, grid)] * len(low), indexing="ij"), -1).reshape(-1, len(low))
    first = np.array([asked(x) for x in shares])
    if not np.isfinite(first).any():
        bound = "no point of the grid has a shape at all instants and a measure with a limit"
        raise ArgumentError.of("study", study.name, bound, "Widen the ranges, or give a limit.")
    found, step = [], 1.0 / (grid - 1)
    for x in shares[np.argsort(first, kind="stable")[:starts]]:
        if len(low) == 1:
            ends = max(x[0] - step, 0.0), min(x[0] + step, 1.0)
            one = minimize_scalar(asked.alone, bounds=ends, method="bounded", options={"xatol": 0.3 * precision})
            found.append((float(one.fun), np.array([one.x])))
        else:
            simplex = np.concatenate((x[None], np.clip(x + 0.5 * step * np.eye(len(x)), 0.0, 1.0)))
            simplex[1:][np.all(simplex[1:] == x, axis=1)] -= 0.5 * step
            options = {"xatol": precision, "fatol": 1e-6, "initial_simplex": simplex, "maxfev": MOST_SOLVES}
            more = minimize(asked, x, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(x), options=options)
            found.append((float(more.fun), np.asarray(more.x)))
    found.append((float(np.nanmin(first)), shares[int(np.nanargmin(first))]))
    found.sort(key=lambda one: one[0])
    used, x = found[0]
    row = asked.rows(x)
    shares_used = _used(study, row)
    near = [m.name for m, share in zip(study.measures, shares_used.tolist(), strict=True) if share > used - 0.01]
    starts_found = tuple(one for one, _ in found[: max(1, len(found) - 1)])
    return Best(low + wide * x, used, tuple(near), row.value[0], asked.solves, starts_found)


@final
class _Asked:
    """How much of its limits a point uses, by its shares (axes,) of the ranges."""

    def __init__(self, study: Question, low: Array, wide: Array) -> None:
        self.study, self.low, self.wide, self.solves = study, low, wide, 0

    def rows(self, shares: Array) -> Chunk:
        """What is told of it."""
        point = (self.low + self.wide * shares)[None]
        return solve_chunk(self.study.cases, self.study.measures, point, False)

    def __call__(self, shares: Array) -> float:
        self.solves += 1
        told = self.rows(shares)
        if told.first[0] >= 0:
            return math.inf
        used = _used(self.study, told)
        return float(np.nanmax(used)) if np.isfinite(used).any() else math.inf

    def alone(self, share: float) -> float:
        """The same of one place; scipy's method needs numbers."""
        return min(self(np.array([share])), 1e6)


def _used(study: Question, told: Chunk) -> Array:
    """(q,), NaN without a limit."""
    pairs = zip(study.measures, told.value[0], told.limit[0], strict=True)
    used = [float(m.used(np.array(value), np.array(limit))) for m, value, limit in pairs]
    return np.where(np.isnan(told.limit[0]), math.nan, used)
