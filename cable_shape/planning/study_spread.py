"""How sure a study's measures are, and what makes them unsure: :func:`shares` and :func:`envelope`.

A share is a Sobol index (I. M. Sobol, 2001): of the variance of a measure's worst value the part that is gone if one
source were known, first order, or left if all others were, total. They are those of ``scipy.stats.sobol_indices``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.study_chunk import TOGETHER, Chunk, solve_chunk
from cable_shape.planning.study_result import Question, joined
from cable_shape.planning.study_slopes import Asked, slopes
from cable_shape.planning.study_vary import points_of
from cable_shape.planning.study_walk import walk

T = TypeVar("T")

#: Points of each of the two samples that Sobol indices are made from.
POINTS = 256


@final
class Shares(NamedTuple):
    """What makes a measure unsure.

    sources : names of what varies
    measures : names
    first, total : (measures, sources), Sobol indices; NaN where a measure does not vary
    deviation : (measures,), standard deviation of each measure's worst value, in its unit
    linear : (measures, sources), shares to first order, from derivatives: all that a small spread needs
    slope : (measures, sources), these derivatives, of the worst instant in the middle of all distributions
    exact : (measures, sources), whether one is exact, see
        :func:`cable_shape.planning.study_slopes.slopes`, and not from differences
    solves : points that were solved for
    """

    sources: tuple[str, ...]
    measures: tuple[str, ...]
    first: Array
    total: Array
    deviation: Array
    linear: Array
    slope: Array
    exact: NDArray[np.bool_]
    solves: int


@final
class Envelope(NamedTuple):
    """Where a cable is with a confidence: a tube about its mean shape, by segment; of a cable the name is "".

    middle : {segment: (n, 3)} [m], of all shapes at the instant
    radius : {segment: (n,)} [m], of the sphere about it that holds the point of so many shapes
    confidence, instant : as asked for
    shapes : how many there were; without : points that had none
    """

    middle: dict[str, Array]
    radius: dict[str, Array]
    confidence: float
    instant: int
    shapes: int
    without: int


def shares(study: Question, points: int = POINTS, seed: int = 0) -> Shares:
    """What share of each measure's variance each source makes.

    Parameters
    ----------
    study : Study
        Of which distributions vary, and nothing else.
    points : int
        A power of 2; points * (sources + 2) are solved for.

    Raises
    ------
    ArgumentError
        Where a list varies, or a point has no shape.
    """
    from scipy.stats import sobol_indices

    checks.integer("points", points, at_least=2, at_most=1 << 20)
    if points & (points - 1):
        raise ArgumentError.of("points", points, "it must be a power of 2", "Write 256, or 1024.")
    _of_distributions(study)
    solves, values = 0, np.empty((0, 0))

    def told(x: Array) -> Array:
        nonlocal solves, values
        rows = np.ascontiguousarray(x.T)
        found = _solved(study, rows)
        bad = np.flatnonzero(found.first >= 0)
        if bad.size:
            where = dict(zip([axis.name for axis in study.axes], rows[bad[0]].tolist(), strict=True))
            bound = "it has no shape at all instants, so that there is no variance"
            raise ArgumentError.of("vary", where, bound, "Take narrower distributions.")
        solves += len(rows)
        values = found.value.T if not values.size else values
        return np.ascontiguousarray(found.value.T)

    found: Any = sobol_indices(func=told, n=points, dists=[_law(axis) for axis in study.axes], rng=seed)
    deviation = values.std(axis=1)
    known = deviation > 0.0
    first, total = (np.atleast_2d(x).copy() for x in (found.first_order, found.total_order))
    first[~known], total[~known] = math.nan, math.nan
    names = tuple(axis.name for axis in study.axes), tuple(measure.name for measure in study.measures)
    share, slope, exact = linear(study)
    return Shares(*names, first, total, deviation, share, slope, exact, solves)


def linear(study: Question) -> tuple[Array, Array, NDArray[np.bool_]]:
    """(measures, sources): shares to first order, derivatives in the middle of all distributions, whether exact."""
    middle = np.array([axis.middle for axis in study.axes])
    spread = np.array([axis.spread for axis in study.axes])
    told = solve_chunk(study.cases, study.measures, middle[None], False)
    asked = [Asked(m, int(instant)) for m, instant in enumerate(told.instant[0]) if instant >= 0]
    found = slopes(study, middle, asked, spread, range(len(middle)))
    slope = np.full((len(study.measures), len(middle)), math.nan)
    exact = np.zeros(slope.shape, np.bool_)
    which = [one.measure for one in asked]
    slope[which], exact[which] = found.slope, found.exact
    parts = (slope * spread) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(parts / parts.sum(axis=1, keepdims=True)), slope, exact


def envelope(study: Question, confidence: float = 0.95, instant: int = 0) -> Envelope:
    """Where the cable is at an instant with a confidence, over all points of the study's sample.

    Raises
    ------
    ArgumentError
        Where a list varies, the instant does not exist, or no point has a shape.
    """
    checks.number("confidence", confidence, above=0.0, at_most=1.0)
    checks.integer("instant", instant, at_least=0)
    _of_distributions(study)
    rows = points_of(study.axes, study.sample)
    seen = [lines for told in _shared(study, rows, lambda cut: _lines(study, cut, instant)) for lines in told]
    if not seen:
        raise ArgumentError.of("study", study.name, "no point has a shape", "Take narrower distributions.")
    middle, radius = {}, {}
    for name in seen[0]:
        whole = np.concatenate([lines[name] for lines in seen])
        middle[name] = whole.mean(axis=0)
        apart = (np.linalg.norm(whole[:, i] - middle[name][i], axis=1) for i in range(whole.shape[1]))
        radius[name] = np.array([np.quantile(one, confidence) for one in apart])
    shapes = sum(len(next(iter(lines.values()))) for lines in seen)
    return Envelope(middle, radius, confidence, instant, shapes, len(rows) - shapes)


def _lines(study: Question, rows: Array, instant: int) -> list[dict[str, Array]]:
    """Centrelines (k, n, 3) of these points at an instant, by segment, of those that have a shape then."""
    out, left = [], rows
    if study.beside is not None and instant == 0:
        together = study.beside.rows(rows)
        out, left = [{"": together.part(1, 3)[together.usable]}], rows[~together.usable]
    for row in left.tolist():
        try:
            found = walk(study.cases.at(row))
        except ArgumentError:
            continue
        if instant >= len(next(iter(found.values()))):
            raise ArgumentError.of("instant", instant, "the motion has fewer instants", "Choose an earlier one.")
        if all(rows.usable[instant] for rows in found.values()):
            out.append({name: rows.part(1, 3)[instant : instant + 1].copy() for name, rows in found.items()})
    return out


def _solved(study: Question, rows: Array) -> Chunk:
    """The points (r, axes) of a study."""
    return joined(_shared(study, rows, lambda cut: solve_chunk(study.cases, study.measures, cut, False, study.beside)))


def _shared(study: Question, rows: Array, solve: Callable[[Array], T]) -> list[T]:
    """What `solve` makes of rows (r, axes), cut into pieces: on all cores, if compiled code does most of it."""
    cuts = [rows[first : first + TOGETHER] for first in range(0, len(rows), TOGETHER)]
    if study.beside is None:
        return [solve(cut) for cut in cuts]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(solve, cuts))


def _of_distributions(study: Question) -> None:
    if not study.axes or not all(axis.law for axis in study.axes):
        bound = "each place must have a distribution"
        raise ArgumentError.of("vary", [axis.name for axis in study.axes], bound, "Write {normal: [mean, deviation]}.")


def _law(axis: Any) -> Any:
    from scipy import stats

    return stats.norm(axis.a, axis.b) if axis.law == "normal" else stats.uniform(axis.a, axis.b - axis.a)
