"""Whether a moving cable may be taken for one at rest.

Told is the load of the cable's inertia as a fraction of its weight, from the motion of the grips: what a prediction
leaves out of its loads. A cable that was accelerated swings on; the ratio dies away by a factor of e in a period of the
cable as a pendulum about the line through its grips, which its stiffness makes quicker:

    omega^2 = g integral(depth) / integral(distance^2) + beta^2 EI / (w / g L^4),  beta that of a straight beam.

The first term is Rayleigh's for a cable that keeps its shape, a per cent or two too large for one that hangs deeply;
that both add up is Southwell's rule, which is a little too small.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels import swing
from cable_shape.pose import FreeEnd, Grip, Pose

#: Ratio of the loads from which a warning is given by default.
LIMIT = 0.25
#: beta of a straight beam, by the number of ends that turn freely; and with one end free.
_BEAM = (22.3733, 15.4182, 9.8696)
_CANTILEVER = 3.5160


def swing_state(cable: Cable, gravity: ArrayLike, limit: float | None) -> Array:
    """What :mod:`cable_shape.kernels.swing` keeps of a cable's motion, before there is any.

    limit: of the ratio, above 0; None: it is not asked for. Without gravity or density there is no ratio.

    Raises
    ------
    ArgumentError
    """
    state = np.zeros(swing.SIZE)
    g = checks.vector("gravity", gravity, 3, "m/s^2")
    weight = cable.linear_density * float(np.linalg.norm(g))
    state[swing.LIMIT] = state[swing.RATIO] = state[swing.PERIOD] = math.nan
    if limit is not None and weight > 0.0:
        state[swing.GRAVITY : swing.LEVER] = g
        state[swing.LEVER] = min((cable.mean_bending_stiffness / weight) ** (1.0 / 3.0), 0.5 * cable.length)
        state[swing.LIMIT] = checks.number("quasistatic_limit", limit, above=0.0)
    return state


def bending_rate(cable: Cable, start: Pose | Grip, end: Pose | Grip | FreeEnd | None) -> float:
    """[1/s^2], square of the lowest angular frequency of the cable as a straight beam held like this."""
    if cable.linear_density == 0.0:
        return math.inf
    if isinstance(end, (Pose, Grip)):
        beta = _BEAM[sum(isinstance(x, Grip) and x.kind == "pinned" for x in (start, end))]
    else:
        beta = 0.0 if isinstance(start, Grip) and start.kind == "pinned" else _CANTILEVER
    return beta**2 * cable.mean_bending_stiffness / (cable.linear_density * cable.length**4)


def inertia_of(acceleration: ArrayLike | None, gravity: ArrayLike) -> float:
    """Root mean square of accelerations (3,), (m, 3) or (m, 6) along a cable, as a fraction of gravity; None: 0.

    NaN without gravity.
    """
    if acceleration is None:
        return 0.0
    table = np.atleast_2d(checks.numbers("acceleration", acceleration, "Give (3,) or (m, 3) in m/s^2."))[:, :3]
    size = float(np.linalg.norm(checks.vector("gravity", gravity, 3, "m/s^2")))
    return math.sqrt(float((table**2).sum(axis=1).mean())) / size if size > 0.0 else math.nan
