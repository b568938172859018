"""The planar solution at any points of the world: :mod:`cable_shape.kernels.rod_output` in a plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_arcs import (
    BENT,
    COURSE,
    FRAME,
    GAP,
    LAYER,
    MOMENT,
    OFF_M,
    OFF_Q,
    ROWS,
    WORK,
    arcs,
    gather_course,
)
from cable_shape.kernels.planar_between import force_slopes
from cable_shape.kernels.planar_element import Pair
from cable_shape.kernels.planar_lanes import REST, gather, lane2
from cable_shape.kernels.planar_system import forces
from cable_shape.kernels.rod_algebra import FAST, Quaternion, Vector, inlined
from cable_shape.kernels.rod_arcs import lane_curve
from cable_shape.kernels.rod_curve import at, functions
from cable_shape.kernels.rod_lanes import LANES, lane4
from cable_shape.kernels.rod_output import INTERPOLATION

Array = Any


@kernel(fastmath=FAST)
def sample(
    z: Array, lam: Pair, side: Array, parts: Array, s: Array, h: Array, load: Array, rest: Array, K: float, soft: float,
    C: Pair, weight: Pair, start: Vector, e1: Vector, e2: Vector, normal: Vector, local: Vector, q0: Quaternion,
    opposite: Quaternion, points: int, out: Array, totals: Array,
) -> None:  # fmt: skip
    """Fills `out` (17 points) and totals (4,) as `rod_output.sample` does.

    A point of the plane is start + x e1 + y e2, and the frame's quaternion is cos q0 + sin opposite of half the angle.
    normal: of the plane, world; local: the same in the cable frame. weight [N/m]: in the plane; heights count from the
    start. side: the moments in its last two columns; parts: minus the steps in position in GL.
    """
    elements = h.shape[0]
    flex, softness = 1.0 / K, 1.0 / soft
    r = (0.0, 0.0)
    dx = s[elements] / (points - 1)
    done = 0
    work = gap = off_M = off_q = 0.0
    bent = 1e-3 * soft / s[elements]
    sign = 1.0
    lanes = np.empty(ROWS * LANES)
    for e in range(elements):
        lane = e % LANES
        if lane == 0:
            gather(e, z, lam, h, load, rest, lanes)
            r, sign = gather_course(e, side, parts, softness, r, sign, lanes)
            arcs(lanes, flex, C, weight)
        gap, off_q = max(gap, lanes[GAP * LANES + lane]), max(off_q, lanes[OFF_Q * LANES + lane])
        off_M, bent = max(off_M, lanes[OFF_M * LANES + lane]), max(bent, lanes[BENT * LANES + lane])
        work += lanes[WORK * LANES + lane]
        he, f = h[e], 1.0 / h[e]
        nL, nM, nR = forces(load, e, lam)
        (k0, k1), layer = lane2(lanes, REST, lane), lane4(lanes, LAYER, lane)
        rs = lane_curve(lanes, COURSE, lane), lane_curve(lanes, COURSE + 6, lane)
        zs = lane_curve(lanes, FRAME, lane), lane_curve(lanes, FRAME + 6, lane)
        Ms = lane_curve(lanes, MOMENT, lane)
        next_i = points if e == elements - 1 else min(points, math.ceil(s[e + 1] / dx - 1e-9))
        a, b = force_slopes(1.0, nL, nM, nR)
        n0, n1 = world(nL, e1, e2), world(a, e1, e2)
        n2 = world((0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1])), e1, e2)
        arc, place, turned, curved, pulled, bending = numbers(out, points, done)
        for j in range(next_i - done):
            at_point = (done + j) * dx
            x = (at_point - s[e]) * f
            arc[j] = at_point
            f1, f2 = functions(x, layer)
            u, v = at(rs[0], x, f1, f2), at(rs[1], x, f1, f2)
            c, d = at(zs[0], x, f1, f2), at(zs[1], x, f1, f2)
            c, d = near(c, d)
            M = at(Ms, x, f1, f2)
            k = k0 + he * (x - 0.5) * k1 + flex * M
            for i in range(3):
                place[3 * j + i] = start[i] + u * e1[i] + v * e2[i]
                curved[3 * j + i] = k * local[i]
                pulled[3 * j + i] = n0[i] + x * (n1[i] + x * n2[i])
                bending[3 * j + i] = M * normal[i]
            for i in range(4):
                turned[4 * j + i] = c * q0[i] + d * opposite[i]
        done = max(done, next_i)
    totals[0], totals[1], totals[2] = work, 0.0, INTERPOLATION * math.sqrt(gap)
    totals[3] = max(2.0 * math.sqrt(off_q), off_M / bent, math.sqrt(gap) / s[elements])


@inlined
def numbers(out: Array, points: int, j: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Arc length, positions, quaternions, curvature, force and moment in `out` from point j on, flat."""
    n = points
    return (
        out[j:],
        out[n + 3 * j :],
        out[4 * (n + j) :],
        out[8 * n + 3 * j :],
        out[11 * n + 3 * j :],
        out[14 * n + 3 * j :],
    )


@inlined
def near(c: float, d: float) -> Pair:
    """(c, d), nearly of unit length, scaled to unit length: within 1e-5 of it without a root, to rounding."""
    x = c * c + d * d - 1.0
    f = 1.0 - x * (0.5 - 0.375 * x) if abs(x) < 1e-5 else 1.0 / math.sqrt(1.0 + x)
    return f * c, f * d


@inlined
def world(a: Pair, e1: Vector, e2: Vector) -> Vector:
    """A vector in the plane as one of the world."""
    return a[0] * e1[0] + a[1] * e2[0], a[0] * e1[1] + a[1] * e2[1], a[0] * e1[2] + a[1] * e2[2]
