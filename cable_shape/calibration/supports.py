"""How many supports a rest curvature along the cable has: given, or by cross validation: :func:`supports_of`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.calibration.fitted import fitted, fitted_in_two, groups_of
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import ALONG, Parameters
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

#: Numbers of supports that "auto" tries, fewest first, until one more does not help.
TRIED = (3, 5, 9, 13, 17, 25)
#: Parts into which the groups go, each left out once.
PARTS = 3
#: [1], by which more supports have to make the error less.
_WORTH = 0.01


@final
class Task(NamedTuple):
    """What is to be fitted to what; loads: keywords of :class:`Forward`."""

    seen: Sequence[Observation]
    cable: Cable
    names: Sequence[str]
    priors: Mapping[str, float] | None
    loads: Mapping[str, Any]


def supports_of(given: int | str, task: Task, proceed: Callable[[int, float], bool]) -> tuple[int, tuple[str, ...]]:
    """The number of supports, and what to say of it.

    given: it, or "auto": of `TRIED` the first whose error on groups that were left out the next one does not better.

    Raises
    ------
    ArgumentError
    """
    if not isinstance(given, str):
        return given, ()
    remedy = "Give a whole number, or 'auto' with observations of two groups at least."
    if given != "auto":
        raise ArgumentError.of("supports", given, "it must be a whole number or 'auto'", remedy)
    if ALONG not in task.names:
        raise ArgumentError.of("supports", given, f"it is of {ALONG}, which is not fitted", f"Fit {ALONG}, too.")
    part = parts_of(groups_of(task.seen))
    if part.max() < 1:
        raise ArgumentError.of("supports", given, "it needs observations of two groups at least", remedy)
    errors: dict[int, float] = {}
    begins: list[tuple[Parameters, Array] | None] = [None] * (int(part.max()) + 1)
    best = TRIED[0]
    for rows in TRIED:
        errors[rows] = _held_back(rows, task, part, begins, proceed)
        if rows != TRIED[0] and not errors[rows] < (1.0 - _WORTH) * errors[best]:
            break
        best = rows
    told = ", ".join(f"{rows} {1e3 * error:.3g} mm" for rows, error in errors.items())
    return best, (f"{best} supports by cross validation; mean miss of observations left out: {told}.",)


def parts_of(groups: Array) -> Array:
    """(n,) part, 0 to 2, of observations of these groups (n,): the largest first, each to the smallest part."""
    numbers, counts = np.unique(groups, return_counts=True)
    sizes = np.zeros(min(PARTS, len(numbers)))
    out = np.zeros(len(groups))
    for k in np.argsort(-counts, kind="stable"):
        smallest = int(np.argmin(sizes))
        out[groups == numbers[k]] = smallest
        sizes[smallest] += counts[k]
    return out


def _held_back(
    rows: int, task: Task, part: Array, begins: list[tuple[Parameters, Array] | None],
    proceed: Callable[[int, float], bool],
) -> float:  # fmt: skip
    """[m], mean miss of observations predicted from nothing by a fit to the other parts.

    begins: where the last fit of each part ended, with another number of supports; takes where this one does.
    """
    sizes = []
    for k in range(len(begins)):
        parameters = Parameters(task.cable, task.names, task.priors, rows)
        learn, judge = ([o for o, p in zip(task.seen, part, strict=True) if (p == k) == held] for held in (False, True))
        before = begins[k]
        begin = None if before is None else parameters.taken(*before)
        if begin is None:
            found = fitted_in_two(partial(_forward, task, parameters), learn, proceed)
        else:
            found = fitted(_forward(task, parameters, learn), proceed, begin)
        begins[k] = parameters, found.values
        sizes.append(np.linalg.norm(_forward(task, parameters, judge).misses(found.values), axis=1))
    return float(np.nanmean(np.concatenate(sizes)))


def _forward(task: Task, parameters: Parameters, some: Sequence[Observation]) -> Forward:
    """Predictions of some of the observations."""
    return Forward(parameters, some, **task.loads)
