"""The solution at any points: interpolation of its own order or better, energy and twist.

Between two nodes position, quaternion and moment follow the curves of :mod:`cable_shape.kernels.rod_curve` through
values, first and second derivatives that the rod's equations give at both nodes. Internal force and rest curvature are
known exactly.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import FAST, add, apply, qnear, rotation, scale, times
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
    ROWS,
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
from cable_shape.kernels.rod_lanes import LANES, REST, SLOPE, gather, lane3, lane4
from cable_shape.kernels.rod_system import forces

Array = Any
INTERPOLATION = 0.2


@kernel(fastmath=FAST)
def sample(
    q: Array, lam: Array, moments: Array, s: Array, h: Array, load: Array, rest: Array, stiff: Array, origin: Array,
    weight: Array, first: Array, points: int, out: Array, totals: Array,
) -> None:  # fmt: skip
    """Fills `out` (17 points): arc length, positions, quaternions, curvature, force, moment, as CableShape.buffer.

    moments (N, 6) [N m], cable frame: at the left and right of each element; first (N, 9): minus the steps in position
    first; origin (3,) [m]: start; weight (3,) [N/m]. totals: 0 elastic energy - weight . r [J], 1 integral of u3 [rad],
    2 error of the interpolation [m], judged by how far r' and R V, interpolated apart, differ in mid-element; 3 the
    largest such difference over an element, of rotation [rad], moment / largest moment and position / length; 4
    integral of n . r' - weight . r [J], which with the functional's value makes the energy, too.
    """
    elements = h.shape[0]
    flex = (1.0 / stiff[0], 1.0 / stiff[1], 1.0 / stiff[2])
    C = (stiff[3], stiff[4], stiff[5])
    softness = max(flex[0], flex[1])
    w3 = (weight[0], weight[1], weight[2])
    l3 = (lam[0], lam[1], lam[2])
    r = (origin[0], origin[1], origin[2])
    dx = s[elements] / (points - 1)
    o1, o2, o3, o4, o5 = points, 4 * points, 8 * points, 11 * points, 14 * points
    i = 0
    work = pull = heavy = twist = gap = off_M = off_q = 0.0
    bent = (1e-3 * min(stiff[0], stiff[1]) / s[elements]) ** 2
    sign = 1.0
    lanes = np.empty(ROWS * LANES)
    for e in range(elements):
        lane = e % LANES
        if lane == 0:
            gather(e, q, l3, h, load, rest, lanes)
            r, sign = gather_course(e, q, first, moments, softness, r, sign, lanes)
            arcs(lanes, flex, C, w3)
        gap, off_q = max(gap, lanes[GAP * LANES + lane]), max(off_q, lanes[OFF_Q * LANES + lane])
        off_M, bent = max(off_M, lanes[OFF_M * LANES + lane]), max(bent, lanes[BENT * LANES + lane])
        work += lanes[WORK * LANES + lane] - lanes[WEIGH * LANES + lane]
        heavy += lanes[WEIGH * LANES + lane]
        pull += lanes[PULL * LANES + lane]
        twist += lanes[TWIST * LANES + lane]
        he, f = h[e], 1.0 / h[e]
        nL, nM, nR = forces(load, e, l3)
        k0, k1 = lane3(lanes, REST, lane), lane3(lanes, SLOPE, lane)
        layer = lane4(lanes, LAYER, lane)
        rs, Ms = lane_curves(lanes, COURSE, lane), lane_curves(lanes, MOMENT, lane)
        qs, q4 = lane_curves(lanes, FRAME, lane), lane_curve(lanes, FRAME + 18, lane)
        next_i = points if e == elements - 1 else min(points, math.ceil(s[e + 1] / dx - 1e-9))
        for j in range(i, next_i):
            x = (j * dx - s[e]) * f
            out[j] = j * dx
            e1, e2 = functions(x, layer)
            out[o1 + 3 * j], out[o1 + 3 * j + 1], out[o1 + 3 * j + 2] = at3(rs, x, e1, e2)
            p = qnear((at(qs[0], x, e1, e2), at(qs[1], x, e1, e2), at(qs[2], x, e1, e2), at(q4, x, e1, e2)))
            out[o2 + 4 * j], out[o2 + 4 * j + 1], out[o2 + 4 * j + 2], out[o2 + 4 * j + 3] = p
            M = at3(Ms, x, e1, e2)
            out[o3 + 3 * j], out[o3 + 3 * j + 1], out[o3 + 3 * j + 2] = add(
                add(k0, scale(he * (x - 0.5), k1)), times(flex, M)
            )
            out[o4 + 3 * j], out[o4 + 3 * j + 1], out[o4 + 3 * j + 2] = quadratic(x, nL, nM, nR)
            out[o5 + 3 * j], out[o5 + 3 * j + 1], out[o5 + 3 * j + 2] = apply(rotation(p), M)
        i = max(i, next_i)
    totals[0], totals[1], totals[2] = work, twist, INTERPOLATION * math.sqrt(gap)
    totals[4] = pull - heavy
    totals[3] = max(2.0 * math.sqrt(off_q), math.sqrt(off_M / bent), math.sqrt(gap) / s[elements])


@kernel(fastmath=FAST)
def all_finite(a: Array) -> bool:
    """Whether every number of a flat array is finite."""
    total = 0.0
    for x in a:
        total += x
    return math.isfinite(total)
