"""The curves of :mod:`cable_shape.kernels.rod_arcs` in a plane, on elements side by side, and what they tell."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_between import at_node, force_slopes, spin
from cable_shape.kernels.planar_element import Pair, product, section, unit
from cable_shape.kernels.planar_lanes import (
    FORCE_LEFT,
    FORCE_MIDDLE,
    FORCE_RIGHT,
    LEFT,
    REST,
    RIGHT,
    H,
    lane2,
    put_lane2,
)
from cable_shape.kernels.planar_system import GL
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_arcs import put_lane_curve
from cable_shape.kernels.rod_between import integral
from cable_shape.kernels.rod_curve import Curve, Layer, at, curve, layers, middle_functions, middle_slope
from cable_shape.kernels.rod_lanes import LANES, lane4, put_lane4

Array = Any
# Rows, after those of `gather`: moments and positions at the left and right, and the boundary layer, see `layers`;
M_LEFT, M_RIGHT, R_LEFT, R_RIGHT, LAYER = 13, 14, 15, 17, 19
# what comes: curves of position, z and moment,
COURSE, FRAME, MOMENT = 23, 35, 47
# how far the rates of these are apart in mid-element, squares but for the moment, and the moment there; elastic energy
# less weight . r.
GAP, OFF_Q, OFF_M, BENT, WORK = 53, 54, 55, 56, 57
ROWS = 58


@inlined
def curves(h: float, a: Pair, da: Pair, dda: Pair, b: Pair, db: Pair, ddb: Pair, layer: Layer) -> tuple[Curve, Curve]:
    """`rod_curve.curve` of two numbers."""
    return (
        curve(h, a[0], da[0], dda[0], b[0], db[0], ddb[0], layer),
        curve(h, a[1], da[1], dda[1], b[1], db[1], ddb[1], layer),
    )


@inlined
def gather_course(
    begin: int, side: Array, parts: Array, softness: float, r: Pair, sign: float, lanes: Array
) -> tuple[Pair, float]:
    """Fills moments, positions and layers, and makes the signs of z follow one another.

    r: position where element `begin` begins; sign: of its left z. Returns the same of what follows the lanes.
    """
    elements = side.shape[0]
    for k in range(LANES):
        e = min(begin + k, elements - 1)
        put_lane2(lanes, M_LEFT, k, (side[e, 2], side[e, 3]))
        put_lane2(lanes, R_LEFT, k, r)
        r = (r[0] - parts[e, GL], r[1] - parts[e, GL + 1])
        put_lane2(lanes, R_RIGHT, k, r)
        n = lane2(lanes, FORCE_MIDDLE, k)
        rate = lanes[H * LANES + k] * math.sqrt(softness * math.sqrt(n[0] * n[0] + n[1] * n[1]))
        put_lane4(lanes, LAYER, k, layers(rate))
        a, b = lane2(lanes, LEFT, k), lane2(lanes, RIGHT, k)
        put_lane2(lanes, LEFT, k, (sign * a[0], sign * a[1]))
        if a[0] * b[0] + a[1] * b[1] < 0.0:
            sign = -sign
        put_lane2(lanes, RIGHT, k, (sign * b[0], sign * b[1]))
    return r, sign


@kernel(fastmath=FAST)
def arcs(lanes: Array, flex: float, C: Pair, weight: Pair) -> None:
    """Fills curves, mid-element differences and energies of all lanes."""
    for k in range(LANES):
        h, za, zb = lanes[H * LANES + k], lane2(lanes, LEFT, k), lane2(lanes, RIGHT, k)
        nL, nM, nR = lane2(lanes, FORCE_LEFT, k), lane2(lanes, FORCE_MIDDLE, k), lane2(lanes, FORCE_RIGHT, k)
        (k0, k1), (Ma, Mb) = lane2(lanes, REST, k), lane2(lanes, M_LEFT, k)
        ra, rb, layer = lane2(lanes, R_LEFT, k), lane2(lanes, R_RIGHT, k), lane4(lanes, LAYER, k)
        dnL, dnR = force_slopes(h, nL, nM, nR)
        a = at_node(za, Ma, nL, dnL, k0 - 0.5 * h * k1, k1, flex, C)
        b = at_node(zb, Mb, nR, dnR, k0 + 0.5 * h * k1, k1, flex, C)
        rs = curves(h, ra, a[5], a[6], rb, b[5], b[6], layer)
        zs = curves(h, za, a[1], a[2], zb, b[1], b[2], layer)
        Ms = curve(h, Ma, a[3], a[4], Mb, b[3], b[4], layer)
        # in mid-element the equations and the interpolation's own rates are two things
        f1, f2 = middle_functions(layer)
        rm, Mm = (at(rs[0], 0.5, f1, f2), at(rs[1], 0.5, f1, f2)), at(Ms, 0.5, f1, f2)
        zm = unit((at(zs[0], 0.5, f1, f2), at(zs[1], 0.5, f1, f2)))
        am, bm, slope = section(product(zm, zm), nM, C)
        x, y = h * slope[0] - middle_slope(rs[0], layer), h * slope[1] - middle_slope(rs[1], layer)
        lanes[GAP * LANES + k] = x * x + y * y
        torque = bm * (1.0 + (C[0] - C[1]) * am)
        lanes[OFF_M * LANES + k], lanes[BENT * LANES + k] = abs(h * torque + middle_slope(Ms, layer)), abs(Mm)
        dz = spin(zm, k0 + flex * Mm)
        x, y = h * dz[0] - middle_slope(zs[0], layer), h * dz[1] - middle_slope(zs[1], layer)
        lanes[OFF_Q * LANES + k] = x * x + y * y
        # elastic energy of bending, of stretch and shear (Simpson), and potential energy
        work = 0.5 * flex * integral(h, Ma * Ma, Mm * Mm, Mb * Mb, 2.0 * Ma * a[3], 2.0 * Mb * b[3])
        work += h / 12.0 * (strain(a[9], C) + 4.0 * strain((am, bm), C) + strain(b[9], C))
        lanes[WORK * LANES + k] = work - integral(
            h, lift(weight, ra), lift(weight, rm), lift(weight, rb), lift(weight, a[5]), lift(weight, b[5])
        )
        put_lane_curve(lanes, COURSE, k, rs[0])
        put_lane_curve(lanes, COURSE + 6, k, rs[1])
        put_lane_curve(lanes, FRAME, k, zs[0])
        put_lane_curve(lanes, FRAME + 6, k, zs[1])
        put_lane_curve(lanes, MOMENT, k, Ms)


@inlined
def strain(N: Pair, C: Pair) -> float:
    """N . C N."""
    return C[0] * N[0] * N[0] + C[1] * N[1] * N[1]


@inlined
def lift(weight: Pair, r: Pair) -> float:
    """weight . r."""
    return weight[0] * r[0] + weight[1] * r[1]
