"""One fit of given parameters to given observations: :func:`fitted`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from cable_shape.calibration.parameters import Parameter
from cable_shape.calibration.result import correlation_of, estimates_of, remarks_of
from cable_shape.calibration.robust import Fit, Robust
from cable_shape.checks import Array

#: Of twice as many observations or more a part of about this size is fitted first, in so many iterations at most.
_FIRST, _ROUGH = 25, 10
#: Another shape is nearer with a median miss below this fraction.
_NEARER = 0.8
#: What is said of observations of one group.
ONE_GROUP = (
    "all was seen in one group: by how much another differs is not known, and a tube holds less of it than told."
)


class Look(Protocol):
    """The points of one observation."""

    @property
    def points(self) -> Array:
        """(m, 3) [m]."""

    @property
    def arc_length(self) -> Array:
        """(m,) [m], NaN where it is not known."""

    @property
    def planar(self) -> bool:
        """Whether they were seen in a plane only."""

    @property
    def group(self) -> int | None:
        """Number of the recording."""


class Numbers(Protocol):
    """What is fitted."""

    each: list[Parameter]
    start: Array

    @property
    def precision(self) -> Array:
        """(k, k), of what is known before."""


class Model(Protocol):
    """What predicts observations, see :class:`cable_shape.calibration.forward.Forward`."""

    @property
    def observations(self) -> Sequence[Look]:
        """In the order of the misses."""

    @property
    def parameters(self) -> Numbers:
        """What is fitted."""

    def misses(self, values: Array) -> Array:
        """(n, 3) [m]."""

    def afresh(self, values: Array) -> Array:
        """The same of shapes predicted from nothing."""

    def jacobian(self, values: Array, now: Array) -> Array:
        """(n, 3, k)."""


def fitted(forward: Model, proceed: Callable[[int, float], bool] | None = None, begin: Array | None = None) -> Fit:
    """The least loss over all observations of `forward`, from values `begin` (k,), by default where parameters start.

    What is known before is known about where the parameters start. proceed: see :class:`Robust`.
    """
    seen, parameters = forward.observations, forward.parameters
    owners = owners_of(seen)
    arc = np.concatenate([o.arc_length for o in seen])
    freedom = 3 - np.isnan(arc) - np.array([o.planar for o in seen])[owners]
    steps = np.array([p.most for p in parameters.each])
    robust = Robust(
        forward.misses, forward.jacobian, forward.afresh, freedom, groups_of(seen)[owners], steps, parameters.precision
    )
    start = parameters.start
    return robust.run(start if begin is None else begin, proceed, about=start)


def fitted_in_two(
    model: Callable[[Sequence[Any]], Model], seen: Sequence[Any], proceed: Callable[[int, float], bool] | None
) -> Fit:
    """The same of `model` of all that was seen, from where the fit to a part of it, evenly spread, ends."""
    begin = None
    if len(seen) >= 2 * _FIRST:
        thin = model(seen[:: len(seen) // _FIRST])
        if np.isfinite(thin.misses(thin.parameters.start)).any():
            begin = fitted(thin, lambda i, scale: i <= _ROUGH and (proceed is None or proceed(i, scale))).values
    return fitted(model(seen), proceed, begin)


def owners_of(seen: Sequence[Look]) -> Array:
    """(n,): which observation each point is of."""
    return np.repeat(np.arange(len(seen)), [len(o.points) for o in seen])


def groups_of(seen: Sequence[Look]) -> Array:
    """(observations,): a number for each group; those without one are groups of their own."""
    return np.array([-1 - i if o.group is None else o.group for i, o in enumerate(seen)])


def elsewhere(found: Fit, owners: Array) -> Iterator[str]:
    """How many observations look like another stable shape than the one that is predicted from nothing."""
    count = 0
    for i in np.unique(owners):
        fresh, followed = (
            float(np.median(np.linalg.norm(misses[owners == i], axis=1))) for misses in (found.misses, found.followed)
        )
        count += followed < _NEARER * fresh
    if count:
        yield f"{count} observations are nearer to another stable shape than to the one predicted from nothing."


def told_of_fit(
    found: Fit, parameters: Numbers, seen: Sequence[Look], first: Sequence[str] = (), more: Sequence[str] = ()
) -> dict[str, Any]:
    """What a calibration says of its fit; `first` and `more`: remarks before and among those that all fits have."""
    correlation, owners = correlation_of(found.covariance), owners_of(seen)
    lost = len(np.unique(owners[np.isnan(found.misses[:, 0])]))
    groups = {o.group for o in seen if o.group is not None}
    if len(groups) == 1 and len(seen) > 1:
        more = (*more, ONE_GROUP)
    usual = remarks_of(parameters.each, found.covariance, correlation, found.blind, found.converged, lost)
    return {
        "estimates": estimates_of(parameters.each, found.values, found.covariance, found.freedom),
        "correlation": correlation,
        "scale": found.scale,
        "distances": np.linalg.norm(found.misses, axis=1),
        "weights": found.weights,
        "iterations": found.iterations,
        "converged": found.converged,
        "remarks": (*first, *usual, *more, *elsewhere(found, owners)),
        "parameters": parameters,
        "values": found.values,
        "covariance": found.covariance,
        "freedom": found.freedom,
        "groups": len(groups),
    }
