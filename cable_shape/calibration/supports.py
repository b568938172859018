"""What is fitted, where cross validation says so: supports along the cable, and optional names: :func:`chosen`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.calibration.cables_forward import CablesForward, forward_of
from cable_shape.calibration.fitted import fitted, fitted_in_two, groups_of
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import ALONG, VARYING, Parameters
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

#: Numbers of supports that "auto" tries, fewest first, until one more does not help.
TRIED = (3, 5, 9, 13, 17, 25)
#: Parts into which the groups go, each left out once.
PARTS = 3
#: [1], by which more supports, or an optional name, have to make the error less.
_WORTH = 0.01
_REMEDY = "a whole number of supports and no optional names, or observations of two groups at least."


@final
class Task(NamedTuple):
    """What is to be fitted to what; loads: keywords of :class:`Forward`."""

    seen: Sequence[Observation]
    cable: Cable
    names: Sequence[str]
    priors: Mapping[str, float]
    loads: Mapping[str, Any]


@final
class Choice(NamedTuple):
    """What is fitted: names, the supports of what varies along the cable, and what to say of how these were chosen."""

    names: tuple[str, ...]
    supports: int
    remarks: tuple[str, ...]


def chosen(supports: int | str, optional: Sequence[str], task: Task, proceed: Callable[[int, float], bool]) -> Choice:
    """The number of supports, and which of the optional names are fitted, too.

    supports: it, or "auto": of `TRIED` the first whose error on groups that were left out the next one does not better.
    optional: names that are taken, one after the other, where that betters the same error.

    Raises
    ------
    ArgumentError
    """
    by_data = isinstance(supports, str)
    if by_data and supports != "auto":
        raise ArgumentError.of("supports", supports, "it must be a whole number or 'auto'", f"Give {_REMEDY}")
    if by_data and not set(VARYING) & set(task.names):
        bound = f"it is of {' and '.join(VARYING)}, which are not fitted"
        raise ArgumentError.of("supports", supports, bound, f"Fit {ALONG}, too.")
    rows = TRIED[0] if isinstance(supports, str) else supports
    if not (by_data or optional):
        return Choice(tuple(task.names), rows, ())
    judge = Judge(task, "supports" if by_data else "optional", proceed)
    remarks = []
    best = judge.error(task.names, rows)
    if by_data:
        errors = {rows: best}
        for more in TRIED[1:]:
            errors[more] = judge.error(task.names, more)
            if not errors[more] < (1.0 - _WORTH) * best:
                break
            rows, best = more, errors[more]
        told = ", ".join(f"{some} {1e3 * error:.3g} mm" for some, error in errors.items())
        remarks.append(f"{rows} supports by cross validation; mean miss of observations left out: {told}.")
    names = tuple(task.names)
    for name in optional:
        error = judge.error(joined(names, name), rows)
        taken = error < (1.0 - _WORTH) * best
        remarks.append(
            f"{name} is {'fitted' if taken else 'left out'} by cross validation; mean miss of observations left out: "
            f"{1e3 * error:.3g} mm with it, {1e3 * best:.3g} mm without."
        )
        names, best = (joined(names, name), error) if taken else (names, best)
    return Choice(names, rows, tuple(remarks))


def joined(names: Sequence[str], name: str) -> tuple[str, ...]:
    """Names with one more, without what that one is in place of: a constant, or what varies along the cable."""
    instead = {name.removesuffix("_along"), f"{name.removesuffix('_along')}_along"}
    return (*(one for one in names if one not in instead), name)


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


@final
class Judge:
    """Errors on observations that are left out."""

    def __init__(self, task: Task, why: str, proceed: Callable[[int, float], bool]) -> None:
        """why: the argument that asks for it."""
        self._task, self._proceed = task, proceed
        self._part = parts_of(groups_of(task.seen))
        if self._part.max() < 1:
            raise ArgumentError(f"{why}: it needs observations of two groups at least. Give {_REMEDY}")
        self._begins: list[tuple[Parameters, Array] | None] = [None] * (int(self._part.max()) + 1)

    def error(self, names: Sequence[str], supports: int) -> float:
        """[m], mean miss of observations predicted from nothing by a fit to the other parts.

        Each begins where the last one to the same part ended, with whatever names and supports.
        """
        task, sizes = self._task, []
        for k, before in enumerate(self._begins):
            parameters = Parameters(task.cable, names, priors_of(task.priors, names), supports)
            learn, judge = (
                [o for o, p in zip(task.seen, self._part, strict=True) if (p == k) == held] for held in (False, True)
            )
            model = partial(_forward, task, parameters)
            if before is None:
                found = fitted_in_two(model, learn, self._proceed)
            else:
                found = fitted(model(learn), self._proceed, parameters.taken(*before))
            self._begins[k] = parameters, found.values
            sizes.append(np.linalg.norm(model(judge).misses(found.values), axis=1))
        return float(np.nanmean(np.concatenate(sizes)))


def priors_of(priors: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """Those of these names."""
    return {name: prior for name, prior in priors.items() if name in names}


def _forward(task: Task, parameters: Parameters, some: Sequence[Observation]) -> Forward | CablesForward:
    """Predictions of some of the observations."""
    return forward_of(parameters, some, **task.loads)
