"""One fit of given parameters to given observations: :func:`fitted`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cable_shape.calibration.forward import Forward
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.robust import Fit, Robust
from cable_shape.checks import Array


def fitted(forward: Forward, proceed: Callable[[int, float], bool] | None = None, begin: Array | None = None) -> Fit:
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


def owners_of(seen: Sequence[Observation]) -> Array:
    """(n,): which observation each point is of."""
    return np.repeat(np.arange(len(seen)), [len(o.points) for o in seen])


def groups_of(seen: Sequence[Observation]) -> Array:
    """(observations,): a number for each group; those without one are groups of their own."""
    return np.array([-1 - i if o.group is None else o.group for i, o in enumerate(seen)])
