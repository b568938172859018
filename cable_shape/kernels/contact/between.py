"""Planes that keep a network that moves against drag in front of bodies between its nodes: :func:`guard_between`.

A body's edge, or one that is thin, is nearest to a point inside an element: there lies a plane as at nodes (`guard`),
and what keeps the point in front of it presses on both nodes of the element (`network.props`).
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.points import GAP, before_at, find_points
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.network.compiled import part
from cable_shape.kernels.network.motion import N_PROPS, PAIRS, PROP, PROPS, motion_of
from cable_shape.kernels.network.props import ELEMENT, GRIP, HOLDER, NORMAL, PUSH
from cable_shape.kernels.network.tables import NOW, Floats, Whole, model_of, plan_of, solution_of
from cable_shape.kernels.rod_algebra import dot, get4, put3, rotation, take3


@kernel
def guard_between(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, bodies: Bodies, thick: Array, wholes: Array,
    reach: float, nearer: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Gives elements the planes of the bodies within `reach` [m] that are nearer to points inside, as `find_points`.

    Without friction; pushes go on from before. Returns how far [m] points may go before one may be in a body that has
    no plane for it, the least cosine of the angle by which a plane that pushes has turned, and the least gap [m].
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    sol, had = solution_of(ints, sols, NOW), int(motion.par[N_PROPS])
    tangents, rough = np.empty((wholes.size, 3)), np.full(wholes.size, 0.0)
    for k in range(wholes.size):
        R = rotation(get4(sol.q, k))
        put3(tangents, k, 0, (R[2], R[5], R[8]))
    find_points(
        plan, model, motion, motion.origin, tangents, bodies, thick, wholes, rough, reach, nearer, True, PROPS
    )  # fmt: skip
    was, props = part(motion.aside, 0, (PROPS + PAIRS, PROP)), motion.props
    count, cosine, least, most = int(motion.par[N_PROPS]), 1.0, math.inf, 0.0
    for i in range(count):
        props[i, GRIP] = 0.0
        least, most = min(least, props[i, GAP]), max(most, props[i, GAP])
        k = before_at(was, had, int(props[i, ELEMENT]), int(props[i, HOLDER]), False)
        if k >= 0 and was[k, PUSH] > 0.0:
            cosine = min(cosine, dot(take3(props, i, NORMAL), take3(was, k, NORMAL)))
    return reach if count < PROPS else max(most, 0.0), cosine, least
