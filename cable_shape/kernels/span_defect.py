"""How far a discrete rod in spans is from the continuous one, and its correction: `rod_defect`, span by span.

A clip makes force and moment jump, so that no defect is carried across one; the answer of the whole cable to the
defects of all spans comes from the factors at hand, and that of the eyelets with it.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    add,
    apply,
    get3,
    get4,
    get9,
    put3,
    rotation,
    subtract,
    take3,
)
from cable_shape.kernels.rod_defect import defects, left_over, take_off
from cable_shape.kernels.rod_lanes import sections
from cable_shape.kernels.span_factor import FORCE, SHIFTED, backward, forward
from cable_shape.kernels.span_slide import carried, settle
from cable_shape.kernels.span_system import NONE, release
from cable_shape.kernels.span_work import joints_of, matrices, vectors


@kernel(fastmath=FAST)
def correct(
    q: Array, lam: Array, frames: Array, h: Array, rest: Array, stiff: Array, where: Array, mask: Array, place: Array,
    forces: int, rings: Array, slides: tuple[Array, Array, Array, Array, Array], work: Array, errors: Array,
    moments: Array, better: Array, pulled: Array,
) -> tuple[float, float]:  # fmt: skip
    """The solution at hand without its discretisation error, to first order in it; `rod_defect.correct` of spans.

    better (N+1, 4) takes the rotations, moments (N, 6) the moments in the cable frame at the left and right of each
    element, pulled (m, 3) the forces of the spans, the first three columns of `first` minus the steps in position,
    frames the places that are unknown, the last of `slides` how far the cable runs through its eyelets. errors (N,):
    each element's share of what is left. Returns the largest error in position [m] that is taken off, and the largest
    that is left; infinite if they cannot be judged.
    """
    turn, push, slope, J, way = slides
    elements, spans = h.shape[0], lam.shape[0]
    _, U, parts, P, Y, W = matrices(work, elements)
    first, full, slack, G, d, _ = vectors(work, elements)
    joints, sums, pull, given = joints_of(work, elements, spans)
    stiffest = max(stiff[0], stiff[1], stiff[2])
    missing, section = np.empty((spans, 3)), sections(stiff, elements)
    still = np.zeros(3)
    for j in range(spans):
        a, b = where[j], where[j + 1]
        short = defects(
            q[a : b + 1], still, h[a:b], full[a:b], rest[a:b], section[a:b], U[a:b], parts[a:b], first[a:b],
            G[a : b + 1], slack[a:b], moments[a:b], sums[j],
        )  # fmt: skip
        put3(missing, j, 0, short)
    release(G, where, mask)
    forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
    backward(where, place, forces, P, Y, W, joints, d)
    settle(q, lam, where, rings, turn, push, J, 1.0, d, joints, way)
    largest = left = 0.0
    r = NONE
    for j in range(spans):
        a, b = where[j], where[j + 1]
        dl = take3(joints, j, FORCE)
        put3(pulled, j, 0, add(get3(lam, j), dl))
        put3(frames, j + 1, 0, add(get3(frames, j + 1), take3(joints, j, SHIFTED)))
        r, far, closure = take_off(
            q[a : b + 1], U[a:b], parts[a:b], get9(sums, j, 12), d[a : b + 1], dl, slack[a:b], first[a:b],
            moments[a:b], G[a : b + 1], better[a : b + 1], r,
        )  # fmt: skip
        largest = max(largest, far)
        put3(sums, j, 0, closure)
        if j > 0:
            put3(G, a, 0, add(get3(G, a), get3(missing, j - 1)))
    put3(G, elements, 0, get3(missing, spans - 1))
    run = 0.0
    if rings.shape[0] > 0:
        for e in range(elements):
            put3(first, e, 0, add(take3(first, e, 0), carried(slope, way, e, 0, elements)))
            put3(moments, e, 0, subtract(take3(moments, e, 0), carried(slope, way, e, 3, elements)))
            put3(moments, e, 3, add(take3(moments, e, 3), carried(slope, way, e, 6, elements)))
    # what the rule itself misses
    pull[:, :] = 0.0
    given[:, :] = 0.0
    release(G, where, mask)
    forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
    backward(where, place, forces, P, Y, W, joints, d)
    taken = way.copy()
    settle(q, lam, where, rings, turn, push, J, 0.0, d, joints, way)
    r = NONE
    for j in range(spans):
        a, b = where[j], where[j + 1]
        r, far = left_over(
            h[a:b], parts[a:b], d[a : b + 1], take3(joints, j, FORCE), first[a:b], stiffest, errors[a:b], r
        )  # fmt: skip
        left = max(left, far)
    for c in range(way.shape[0]):
        run += abs(way[c])
        way[c] = taken[c]
    if not math.isfinite(largest) or not math.isfinite(left) or not math.isfinite(run):
        return math.inf, math.inf
    return math.sqrt(largest), max(math.sqrt(left), run)


@kernel
def support_loads(
    q: Array, pulled: Array, moments: Array, s: Array, where: Array, loads: Array
) -> None:  # fmt: skip
    """loads (m-1, 7): arc length, force [N] and moment [N m], world, of the cable on every support inside."""
    for j in range(1, where.shape[0] - 1):
        k = where[j]
        loads[j - 1, 0] = s[k]
        put3(loads, j - 1, 1, subtract(get3(pulled, j), get3(pulled, j - 1)))
        jump = subtract(take3(moments, k, 0), take3(moments, k - 1, 3))
        put3(loads, j - 1, 4, apply(rotation(get4(q, k)), jump))
