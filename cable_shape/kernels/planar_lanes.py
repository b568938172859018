"""The same formulas in the plane for LANES elements of the rod at a time, see :mod:`cable_shape.kernels.rod_lanes`."""

from __future__ import annotations

from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_element import Pair, gradient_of, hessian_of, relative
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_element import angle_series
from cable_shape.kernels.rod_lanes import LANES

Array = Any
# Rows of what is given: length, z, forces, rest curvature; relative rotation and its series.
H, LEFT, RIGHT, FORCE_LEFT, FORCE_MIDDLE, FORCE_RIGHT, REST, SLOPE = 0, 1, 3, 5, 7, 9, 11, 12
D, SERIES = 13, 15
# What comes: gradient in theta_1, theta_2, lambda, and the value, or in its place the Hessian.
G1, G2, GL, VALUE, H11, H12, H22, B1, B2, CC = 17, 18, 19, 21, 21, 22, 23, 24, 26, 28
ROWS = 31
#: (asin(v) - v) / v^3 in powers of v^2, as far as NEAR: interpolation at Chebyshev's points, within 1e-18.
ASIN = (
    0.16666666666666666, 0.07499999999999868, 0.04464285714327705, 0.030381944392269065, 0.022372162407488093,
    0.017352641829031474, 0.01396765621548518, 0.011510645468458914, 0.010144040425319885, 0.006233336622127126,
    0.013801890904727696,
)  # fmt: skip
NEAR = 0.125


@inlined
def lane2(lanes: Array, row: int, k: int) -> Pair:
    """Two numbers of element k."""
    i = row * LANES + k
    return lanes[i], lanes[i + LANES]


@inlined
def put_lane2(lanes: Array, row: int, k: int, a: Pair) -> None:
    """Writes two numbers of element k."""
    i = row * LANES + k
    lanes[i], lanes[i + LANES] = a


@inlined
def gather(begin: int, z: Array, lam: Pair, h: Array, load: Array, rest: Array, lanes: Array) -> int:
    """Fills length to rest curvature of the elements from `begin` on; returns how many there are, at most LANES.

    Lanes beyond the last element repeat it.
    """
    elements = h.shape[0]
    for k in range(LANES):
        e = min(begin + k, elements - 1)
        lanes[H * LANES + k] = h[e]
        put_lane2(lanes, LEFT, k, (z[e, 0], z[e, 1]))
        put_lane2(lanes, RIGHT, k, (z[e + 1, 0], z[e + 1, 1]))
        put_lane2(lanes, FORCE_LEFT, k, (load[e, 0] + lam[0], load[e, 1] + lam[1]))
        put_lane2(lanes, FORCE_MIDDLE, k, (load[e, 2] + lam[0], load[e, 3] + lam[1]))
        put_lane2(lanes, FORCE_RIGHT, k, (load[e, 4] + lam[0], load[e, 5] + lam[1]))
        put_lane2(lanes, REST, k, (rest[e, 0], rest[e, 1]))
    return min(LANES, elements - begin)


@inlined
def near_series(x: float) -> Pair:
    """The first two of `rod_element.angle_series` for x up to NEAR, without a branch, a root or a division."""
    a, da = ASIN[10], 0.0
    for c in (ASIN[9], ASIN[8], ASIN[7], ASIN[6], ASIN[5], ASIN[4], ASIN[3], ASIN[2], ASIN[1], ASIN[0], 1.0):
        a, da = a * x + c, da * x + a
    return 2.0 * a, 2.0 * da


@inlined
def gather_turns(lanes: Array) -> None:
    """Fills relative rotations and the first two of their series; z at the right takes the sign nearer to the left."""
    for k in range(LANES):
        z2, d = relative(lane2(lanes, LEFT, k), lane2(lanes, RIGHT, k))
        put_lane2(lanes, RIGHT, k, z2)
        put_lane2(lanes, D, k, d)
        put_lane2(lanes, SERIES, k, near_series(d[1] * d[1]))
    for k in range(LANES):
        w, v = lane2(lanes, D, k)
        if v * v > NEAR:
            f, f1, _ = angle_series(v * v, w)
            put_lane2(lanes, SERIES, k, (f, f1))


@kernel(fastmath=FAST)
def hessians(lanes: Array, K: float, C: Pair) -> None:
    """`planar_element.element_hessian` of all lanes."""
    gather_turns(lanes)
    for k in range(LANES):
        g1, g2, gl, h11, h12, h22, b1, b2, cc = hessian_of(
            lanes[SERIES * LANES + k] * lanes[(D + 1) * LANES + k], lanes[H * LANES + k], lane2(lanes, LEFT, k),
            lane2(lanes, RIGHT, k), lane2(lanes, FORCE_LEFT, k), lane2(lanes, FORCE_MIDDLE, k),
            lane2(lanes, FORCE_RIGHT, k), lanes[REST * LANES + k], lanes[SLOPE * LANES + k], K, C,
        )  # fmt: skip
        put_lane2(lanes, G1, k, (g1, g2))
        put_lane2(lanes, GL, k, gl)
        put_lane2(lanes, H11, k, (h11, h12))
        lanes[H22 * LANES + k] = h22
        put_lane2(lanes, B1, k, b1)
        put_lane2(lanes, B2, k, b2)
        put_lane2(lanes, CC, k, (cc[0], cc[1]))
        lanes[(CC + 2) * LANES + k] = cc[2]


@kernel(fastmath=FAST)
def gradients(lanes: Array, K: float, C: Pair) -> None:
    """`planar_element.element_gradient` of all lanes."""
    gather_turns(lanes)
    for k in range(LANES):
        value, g1, g2, gl = gradient_of(
            lanes[SERIES * LANES + k] * lanes[(D + 1) * LANES + k], lanes[H * LANES + k], lane2(lanes, LEFT, k),
            lane2(lanes, RIGHT, k), lane2(lanes, FORCE_LEFT, k), lane2(lanes, FORCE_MIDDLE, k),
            lane2(lanes, FORCE_RIGHT, k), lanes[REST * LANES + k], lanes[SLOPE * LANES + k], K, C,
        )  # fmt: skip
        put_lane2(lanes, G1, k, (g1, g2))
        put_lane2(lanes, GL, k, gl)
        lanes[VALUE * LANES + k] = value
