"""The solution at any points: interpolation of its own order or better, energy and twist.

Between two nodes position, quaternion and moment follow the curves of :mod:`cable_shape.kernels.rod_curve` through
values, first and second derivatives that the rod's equations give at both nodes. Internal force and rest curvature are
known exactly.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import FAST, Vector, add, apply, get3, qnear, rotation, scale, take3
from cable_shape.kernels.rod_arcs import (
    BENT,
    COURSE,
    FRAME,
    GAP,
    LAYER,
    MOMENT,
    OFF_M,
    OFF_Q,
    PULL,
    TWIST,
    WEIGH,
    WORK,
    arcs,
    gather_course,
    lane_curve,
    lane_curves,
)
from cable_shape.kernels.rod_between import quadratic
from cable_shape.kernels.rod_curve import at, at3, functions
from cable_shape.kernels.rod_lanes import (
    LANES,
    REST,
    SLOPE,
    STIFF,
    TAPER,
    gather,
    lane3,
    lane4,
)

INTERPOLATION = 0.2


#: Numbers that `sample_cable` gathers: elastic energy - weight . r, twist, integral of n . r' - weight . r; then the
#: largest squares of how far rates are apart in mid-element (position, rotation, moment), and of a moment.
S_WORK, S_TWIST, S_PULL, S_GAP, S_TURN, S_MOMENT, S_BENT = 0, 1, 2, 3, 4, 5, 6
SUMS = 7


@kernel(fastmath=FAST)
def sample_cable(
    left: Array, q: Array, moments: Array, s: Array, h: Array, full: Array, rest: Array, section: Array, origin: Vector,
    weight: Vector, elastic: bool, first: Array, apart: float, points: int, out: Array, sums: Array, lanes: Array,
) -> None:  # fmt: skip
    """Fills `out` (17 points, as CableShape.buffer) for the points of one cable.

    left (N,), full (N, 9): see `rod_lanes.gather`; moments (N, 6) [N m], cable frame: at the left and right of each
    element; s (n,): of the nodes; first (N, 9): minus the steps in position first; section (N, 9): see `rod_lanes`;
    origin [m]: where the cable starts; weight [N/m]; apart [m]: arc length between points. sums (SUMS,) takes part.
    """
    elements = h.shape[0]
    r = origin
    sign = 1.0
    o1, o2, o3, o4, o5 = points, 4 * points, 8 * points, 11 * points, 14 * points
    i = 0
    work = pull = twist = gap = off_M = off_q = bent = 0.0
    for e in range(elements):
        lane = e % LANES
        if lane == 0:
            gather(e, left, q, h, full, rest, section, lanes)
            r, sign = gather_course(e, left, q, first, moments, r, sign, lanes)
            arcs(lanes, elastic, weight)
        gap, off_q = max(gap, lanes[GAP * LANES + lane]), max(off_q, lanes[OFF_Q * LANES + lane])
        off_M, bent = max(off_M, lanes[OFF_M * LANES + lane]), max(bent, lanes[BENT * LANES + lane])
        work += lanes[WORK * LANES + lane] - lanes[WEIGH * LANES + lane]
        pull += lanes[PULL * LANES + lane] - lanes[WEIGH * LANES + lane]
        twist += lanes[TWIST * LANES + lane]
        he, f = h[e], 1.0 / h[e]
        nL, nM, nR = get3(full, e), take3(full, e, 3), take3(full, e, 6)
        a = s[left[e]]
        k0, k1 = lane3(lanes, REST, lane), lane3(lanes, SLOPE, lane)
        K, K1 = lane3(lanes, STIFF, lane), lane3(lanes, TAPER, lane)
        layer = lane4(lanes, LAYER, lane)
        rs, Ms = lane_curves(lanes, COURSE, lane), lane_curves(lanes, MOMENT, lane)
        qs, q4 = lane_curves(lanes, FRAME, lane), lane_curve(lanes, FRAME + 18, lane)
        next_i = points if e == elements - 1 else min(points, math.ceil(s[left[e] + 1] / apart - 1e-9))
        for j in range(i, next_i):
            x = (j * apart - a) * f
            out[j] = j * apart
            e1, e2 = functions(x, layer)
            out[o1 + 3 * j], out[o1 + 3 * j + 1], out[o1 + 3 * j + 2] = at3(rs, x, e1, e2)
            p = qnear((at(qs[0], x, e1, e2), at(qs[1], x, e1, e2), at(qs[2], x, e1, e2), at(q4, x, e1, e2)))
            out[o2 + 4 * j], out[o2 + 4 * j + 1], out[o2 + 4 * j + 2], out[o2 + 4 * j + 3] = p
            M = at3(Ms, x, e1, e2)
            y = he * (x - 0.5)
            u = (M[0] / (K[0] + y * K1[0]), M[1] / (K[1] + y * K1[1]), M[2] / (K[2] + y * K1[2]))
            out[o3 + 3 * j], out[o3 + 3 * j + 1], out[o3 + 3 * j + 2] = add(add(k0, scale(y, k1)), u)
            out[o4 + 3 * j], out[o4 + 3 * j + 1], out[o4 + 3 * j + 2] = quadratic(x, nL, nM, nR)
            out[o5 + 3 * j], out[o5 + 3 * j + 1], out[o5 + 3 * j + 2] = apply(rotation(p), M)
        i = max(i, next_i)
    sums[S_WORK] += work
    sums[S_TWIST] += twist
    sums[S_PULL] += pull
    sums[S_GAP], sums[S_TURN] = max(sums[S_GAP], gap), max(sums[S_TURN], off_q)
    sums[S_MOMENT], sums[S_BENT] = max(sums[S_MOMENT], off_M), max(sums[S_BENT], bent)


@kernel(fastmath=FAST)
def all_finite(a: Array) -> bool:
    """Whether every number of a flat array is finite."""
    total = 0.0
    for x in a:
        total += x
    return math.isfinite(total)
