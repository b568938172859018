"""How sure a study's measures are, and what makes them unsure: :func:`shares` and :func:`envelope`.

A share is a Sobol index (I. M. Sobol, 2001): of the variance of a measure's worst value the part that is gone if one
source were known, first order, or left if all others were, total. They are those of ``scipy.stats.sobol_indices``.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.planning.study_chunk import solve_chunk
from cable_shape.planning.study_result import Question
from cable_shape.planning.study_vary import points_of
from cable_shape.planning.study_walk import walk

#: Points of each of the two samples that Sobol indices are made from.
POINTS = 256


@final
class Shares(NamedTuple):
    """What makes a measure unsure.

    sources : names of what varies
    measures : names
    first, total : (measures, sources), Sobol indices; NaN where a measure does not vary
    deviation : (measures,), standard deviation of each measure's worst value, in its unit
    solves : points that were solved for
    """

    sources: tuple[str, ...]
    measures: tuple[str, ...]
    first: Array
    total: Array
    deviation: Array
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
        found = solve_chunk(study.cases, study.measures, rows, False)
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
    return Shares(*names, first, total, deviation, solves)


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
    seen: dict[str, list[Array]] = {}
    rows_of, without = points_of(study.axes, study.sample), 0
    for row in rows_of.tolist():
        try:
            found = walk(study.cases.at(row))
        except ArgumentError:
            without += 1
            continue
        if instant >= len(next(iter(found.values()))):
            raise ArgumentError.of("instant", instant, "the motion has fewer instants", "Choose an earlier one.")
        if not all(rows.usable[instant] for rows in found.values()):
            without += 1
            continue
        for name, rows in found.items():
            seen.setdefault(name, []).append(rows.part(1, 3)[instant].copy())
    if not seen:
        raise ArgumentError.of("study", study.name, "no point has a shape", "Take narrower distributions.")
    middle, radius = {}, {}
    for name, shapes in seen.items():
        whole = np.array(shapes)
        middle[name] = whole.mean(axis=0)
        apart = np.linalg.norm(whole - middle[name], axis=2)
        radius[name] = np.quantile(apart, confidence, axis=0)
    return Envelope(middle, radius, confidence, instant, len(rows_of) - without, without)


def _of_distributions(study: Question) -> None:
    if not study.axes or not all(axis.law for axis in study.axes):
        bound = "each place must have a distribution"
        raise ArgumentError.of("vary", [axis.name for axis in study.axes], bound, "Write {normal: [mean, deviation]}.")


def _law(axis: Any) -> Any:
    from scipy import stats

    return stats.norm(axis.a, axis.b) if axis.law == "normal" else stats.uniform(axis.a, axis.b - axis.a)
