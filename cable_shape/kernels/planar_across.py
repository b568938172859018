"""Whether a planar shape is stable out of its plane: the second variation in rotations about nu and t.

In a plane that holds the loads and two of the frame's axes, a rotation (alpha about nu, beta about the tangent) and a
force along the normal e change the energy in second order only, apart from what stays within the plane. The element's
exact Hessian (see :mod:`cable_shape.kernels.rod_element`) then has blocks of 2x2 and one border column, which are
eliminated as they come. The factors are kept in rows of a node, behind what `planar_system` has in the work space:

    across (N+1, 18)   1/pivot 3 (aa, ab, bb), eliminated border 2, 1/pivot times the block to the next node 4,
                       gradient or right-hand side 2, change 2; B1 2, B2 2 and CC of the element that begins there

A held node has none of the first nine. In their place, the first row has the border's Schur complement, and the first
and the last one have the block H12 of their element.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_element import Pair, product, relative, section
from cable_shape.kernels.planar_lanes import (
    FORCE_LEFT,
    FORCE_MIDDLE,
    FORCE_RIGHT,
    LEFT,
    REST,
    RIGHT,
    SERIES,
    SLOPE,
    D,
    H,
    gather,
    gather_turns,
    lane2,
)
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_element import SMALL_FORCE, angle_series
from cable_shape.kernels.rod_lanes import LANES, lane4, put_lane4

Array = Any
#: aa, ab, ba, bb of a 2x2 block in (alpha, beta)
Block = tuple[float, float, float, float]
COLUMNS = 18
I11, I12, I22, W1, W2, Y11, Y12, Y21, Y22, G1, G2, D1, D2 = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12
B11, B12, B21, B22, CC = 13, 14, 15, 16, 17
# Rows of lanes, after those of `gather_turns`: blocks, borders and the derivative in the force twice.
FIRST, BESIDE, SECOND, BORDERS, FORCE = 17, 21, 25, 29, 33
ROWS = 34


@kernel(fastmath=FAST)
def element_across(
    h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, across: float,
    GJ: float, C: Pair,
) -> tuple[Block, Block, Block, Pair, Pair, float]:  # fmt: skip
    """H11, H12, H22, B1, B2, CC in the rotations (alpha, beta) of the two nodes and the force along e.

    across: EI about nu, in which the cable bends out of the plane; the others as in `planar_element`.
    """
    z2, d = relative(z1, z2)
    f, f1, _ = angle_series(d[1] * d[1], d[0])
    return across_of(d, (f, f1), h, z1, z2, nL, nM, nR, k0, k1, K, across, GJ, C)


@inlined
def across_of(
    d: Pair, series: Pair, h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float,
    across: float, GJ: float, C: Pair,
) -> tuple[Block, Block, Block, Pair, Pair, float]:  # fmt: skip
    """The same from z2 / z1 and its series, z2 having the sign nearer to z1, without a branch."""
    (w, v), (f, f1) = d, series
    k = f * v / h
    m = K * (k - k0)
    c = C[0] - C[1]
    a, b, _ = section(product(z1, z2), nM, C)  # Nt, Nn
    size = math.sqrt(nM[0] * nM[0] + nM[1] * nM[1] + SMALL_FORCE)
    slope = 0.1 * h * h
    c0 = -h * h * h / 12.0
    W = 1.0 / (K + slope * size)
    g = b * (1.0 + c * a) - K * k1
    y = c0 * W * g
    e = -0.5 * slope * y * W * g
    # dE/dN at the midpoint: along t and nu
    Vt, Vn = 1.0 + C[0] * a, C[1] * b
    Gt = -2.0 / 3.0 * h * Vt - y * Vn + C[0] * b * y
    Gn = -2.0 / 3.0 * h * Vn + y * Vt - C[1] * a * y
    # second derivatives in k about nu (1) and t (2), and in N along e
    gamma = 1.0 + c * a
    c1, c2 = c0 / (across + slope * size), c0 / GJ
    p, r = k * GJ - m, m - k * across
    a_, b_ = f / h, 2.0 * f1 / h
    more = b_ * v * h * m
    Q11 = a_ * a_ * (h * across + c2 * r * r) + more
    Q22 = a_ * a_ * (h * GJ + c1 * p * p) + more
    Q12 = a_ * a_ * (across - GJ) * y
    E2 = -a_ * c1 * p * gamma
    EN = c1 * gamma * gamma - 2.0 / 3.0 * h * C[1]
    # in the midpoint's rotation about nu and t, and in the force
    Qaa = EN * a * a - Gt * a
    Qbb = EN * b * b - Gn * b
    Qab = 0.5 * (Gn * a + Gt * b) - EN * a * b
    la, lb = EN * a - Gt, Gn - EN * b
    # to mean s and difference d of the nodes' rotations: k ~ (v sb + w/2 da, w/2 db - v sa),
    # theta = (sa + x db, sb - x da)
    o, x = 0.5 * w, 0.5 * v / (1.0 + w)
    Saa = v * v * Q22 - 2.0 * v * E2 * a + Qaa
    Sbb = v * v * Q11 + Qbb
    Sab = v * (E2 * b - v * Q12) + Qab
    Daa = o * o * Q11 + x * x * Qbb
    Dbb = o * o * Q22 + 2.0 * o * x * E2 * a + x * x * Qaa
    Dab = o * o * Q12 + o * x * E2 * b - x * x * Qab
    Maa = -o * v * Q12 - x * (v * E2 * b + Qab)  # s_alpha with d_alpha
    Mab = -o * v * Q22 + o * E2 * a + x * (Qaa - v * E2 * a)
    Mba = o * v * Q11 - x * Qbb
    Mbb = o * v * Q12 - o * E2 * b + x * Qab
    sa, sb = la - v * E2, lb
    da, db = -x * lb, o * E2 + x * la
    # to the nodes' rotations, with the second-order terms of the rotations
    mu = m * (f + 2.0 * f1 * v * v)
    vM, tt = v * mu, (Gt * b - Gn * a) * v / (1.0 + w)
    aL, bL, _ = section(product(z1, z1), nL, C)
    aR, bR, _ = section(product(z2, z2), nR, C)
    gL, gR = h / 6.0 * (1.0 + c * aL), h / 6.0 * (1.0 + c * aR)
    left, right = 0.25 * (tt - vM), -0.25 * (tt + vM)
    Caa, Cab, Cbb = 0.25 * Saa + Daa, 0.25 * Sab + Dab, 0.25 * Sbb + Dbb
    slant = 0.5 * (Mab + Mba)
    H11 = (Caa - Maa + left + gL * aL, Cab - slant - 0.5 * gL * bL, 0.0, Cbb - Mbb + left)
    H22 = (Caa + Maa + right + gR * aR, Cab + slant - 0.5 * gR * bR, 0.0, Cbb + Mbb + right)
    skew = 0.5 * (Mab - Mba) + 0.25 * w * mu
    H12 = (0.25 * Saa - Daa - 0.25 * vM, 0.25 * Sab - Dab + skew, 0.25 * Sab - Dab - skew, 0.25 * Sbb - Dbb - 0.25 * vM)
    return (
        (H11[0], H11[1], H11[1], H11[3]),
        H12,
        (H22[0], H22[1], H22[1], H22[3]),
        (0.5 * sa - da + gL, 0.5 * sb - db),
        (0.5 * sa + da + gR, 0.5 * sb + db),
        EN + e / size - h / 3.0 * C[1],
    )


@kernel(fastmath=FAST)
def blocks(lanes: Array, K: float, across: float, GJ: float, C: Pair) -> None:
    """`element_across` of all lanes."""
    gather_turns(lanes)
    for k in range(LANES):
        h11, h12, h22, b1, b2, cc = across_of(
            lane2(lanes, D, k), lane2(lanes, SERIES, k), lanes[H * LANES + k], lane2(lanes, LEFT, k),
            lane2(lanes, RIGHT, k), lane2(lanes, FORCE_LEFT, k), lane2(lanes, FORCE_MIDDLE, k),
            lane2(lanes, FORCE_RIGHT, k), lanes[REST * LANES + k], lanes[SLOPE * LANES + k], K, across, GJ, C,
        )  # fmt: skip
        put_lane4(lanes, FIRST, k, h11)
        put_lane4(lanes, BESIDE, k, h12)
        put_lane4(lanes, SECOND, k, h22)
        put_lane4(lanes, BORDERS, k, (b1[0], b1[1], b2[0], b2[1]))
        lanes[FORCE * LANES + k] = cc


@inlined
def negative(a: float, c: float, det: float) -> int:
    """Negative eigenvalues of a symmetric 2x2 matrix with the diagonal a, c; det: its determinant."""
    if det < 0.0:
        return 1
    return 2 if a + c < 0.0 else 0


@kernel(fastmath=FAST)
def excess_across(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, across: float, GJ: float, C: Pair, shift: float,
    held: bool, kept: Array,
) -> int:  # fmt: skip
    """Negative eigenvalues of the second variation out of the plane beyond that of the border: 0 if it is stable.

    shift diag(mean element length) is added, as in `rod_factor.factor`; kept (N+1, 18) takes the factors.
    """
    elements = h.shape[0]
    last = elements - 1 if held else elements
    count = 0
    p11 = p12 = p22 = w1 = w2 = S = 0.0  # pivot and border of the node at hand, Schur complement
    lanes = np.empty(ROWS * LANES)
    for e in range(elements):
        lane = e % LANES
        if lane == 0:
            gather(e, z, lam, h, load, rest, lanes)
            blocks(lanes, K, across, GJ, C)
        H11, H12, H22 = lane4(lanes, FIRST, lane), lane4(lanes, BESIDE, lane), lane4(lanes, SECOND, lane)
        kept[e, B11], kept[e, B12], kept[e, B21], kept[e, B22] = B = lane4(lanes, BORDERS, lane)
        kept[e, CC] = cc = lanes[FORCE * LANES + lane]
        if e == 0 or e == last:
            node = 0 if e == 0 else elements
            kept[node, Y11], kept[node, Y12], kept[node, Y21], kept[node, Y22] = H12
        S += cc
        size = 0.5 * shift * (h[e] + (h[e + 1] if e + 1 < elements else 0.0))
        q11, q12, q22, x1, x2 = H22[0] + size, H22[1], H22[3] + size, B[2], B[3]
        if e > 0:
            a, b, c = p11 + H11[0], p12 + H11[1], p22 + H11[3]
            u1, u2 = w1 + B[0], w2 + B[1]
            det = a * c - b * b
            count += negative(a, c, det)
            i = 1.0 / det
            S -= i * (c * u1 * u1 - 2.0 * b * u1 * u2 + a * u2 * u2)
            # Y = P^-1 H12
            y11, y12 = i * (c * H12[0] - b * H12[2]), i * (c * H12[1] - b * H12[3])
            y21, y22 = i * (a * H12[2] - b * H12[0]), i * (a * H12[3] - b * H12[1])
            kept[e, I11], kept[e, I12], kept[e, I22], kept[e, W1], kept[e, W2] = i * c, -i * b, i * a, u1, u2
            kept[e, Y11], kept[e, Y12], kept[e, Y21], kept[e, Y22] = y11, y12, y21, y22
            q11 -= y11 * H12[0] + y21 * H12[2]
            q12 -= y11 * H12[1] + y21 * H12[3]
            q22 -= y12 * H12[1] + y22 * H12[3]
            x1 -= y11 * u1 + y21 * u2
            x2 -= y12 * u1 + y22 * u2
        p11, p12, p22, w1, w2 = q11, q12, q22, x1, x2
    kept[0, 0] = S
    if last == elements:
        det = p11 * p22 - p12 * p12
        kept[last, I11], kept[last, I12], kept[last, I22] = p22 / det, -p12 / det, p11 / det
        kept[last, W1], kept[last, W2] = w1, w2
        return count + negative(p11, p22, det)
    return count + (0 if S < 0.0 else -1)


@kernel(fastmath=FAST)
def respond_across(last: int, held: bool, closure: float, kept: Array) -> float:
    """Solves for the changes of nodes 1 to last, with the right-hand sides in `kept`; returns that of the force.

    closure: derivative in the force, as in `rod_factor.border`.
    """
    s = 0.0
    for k in range(1, last + 1):
        if k > 1:
            z1, z2 = kept[k - 1, G1], kept[k - 1, G2]
            kept[k, G1] -= kept[k - 1, Y11] * z1 + kept[k - 1, Y21] * z2
            kept[k, G2] -= kept[k - 1, Y12] * z1 + kept[k - 1, Y22] * z2
        z1, z2 = kept[k, G1], kept[k, G2]
        s += kept[k, W1] * (kept[k, I11] * z1 + kept[k, I12] * z2)
        s += kept[k, W2] * (kept[k, I12] * z1 + kept[k, I22] * z2)
    step = (s - closure) / kept[0, 0] if held else 0.0
    d1 = d2 = 0.0
    for k in range(last, 0, -1):
        x1, x2 = kept[k, G1] + step * kept[k, W1], kept[k, G2] + step * kept[k, W2]
        x1, x2 = kept[k, I11] * x1 + kept[k, I12] * x2, kept[k, I12] * x1 + kept[k, I22] * x2
        if k < last:
            x1 += kept[k, Y11] * d1 + kept[k, Y12] * d2
            x2 += kept[k, Y21] * d1 + kept[k, Y22] * d2
        d1, d2 = -x1, -x2
        kept[k, D1], kept[k, D2] = d1, d2
    return step
