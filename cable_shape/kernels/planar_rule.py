"""The sixth-order rule of :mod:`cable_shape.kernels.rod_rule` in a plane, on elements side by side."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_between import apart, at_node, change, force_slopes, landing, missed
from cable_shape.kernels.planar_element import Pair, quotient, relative, unit
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
from cable_shape.kernels.planar_system import G1, G2, GL, jumps
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_between import middle
from cable_shape.kernels.rod_curve import STIFF
from cable_shape.kernels.rod_lanes import LANES

Array = Any
# Rows, after those of `gather`: moments at the left and right, and minus the step in position;
M_LEFT, M_RIGHT, STEP = 13, 14, 15
# what comes: defects in rotation and moment, and in position, and what the rule itself misses of these.
TURN, PLACE, MISSED_TURN, MISSED_PLACE = 17, 19, 21, 23
ROWS = 25


@inlined
def is_long(h: Array, load: Array, lam: Pair, e: int, soft: float) -> bool:
    """Whether element e is so much longer than its boundary layer that the rule is none for it."""
    n0, n1 = load[e, 2] + lam[0], load[e, 3] + lam[1]
    return h[e] * h[e] * math.sqrt(n0 * n0 + n1 * n1) > STIFF * soft


@inlined
def gather_moments(
    begin: int, lam: Pair, h: Array, load: Array, rest: Array, parts: Array, soft: float, lanes: Array
) -> None:
    """Fills moments and steps. A node's moment is that of the element before it, unless something holds the node."""
    elements = h.shape[0]
    for k in range(LANES):
        e = min(begin + k, elements - 1)
        M = -parts[e, G1]
        if e > 0 and rest[e, 1] == 0.0 and not (is_long(h, load, lam, e - 1, soft) or jumps(load, e)):
            before = parts[e - 1, G2]
            M = M if apart(before, M) else before
        put_lane2(lanes, M_LEFT, k, (M, parts[e, G2]))
        put_lane2(lanes, STEP, k, (parts[e, GL], parts[e, GL + 1]))


@kernel(fastmath=FAST)
def land(lanes: Array, flex: float, C: Pair) -> None:
    """Integrates over all lanes from the left: fills by how much the right node is missed, and what the rule misses."""
    for k in range(LANES):
        h, z1 = lanes[H * LANES + k], lane2(lanes, LEFT, k)
        z2, _ = relative(z1, lane2(lanes, RIGHT, k))
        nL, nM, nR = lane2(lanes, FORCE_LEFT, k), lane2(lanes, FORCE_MIDDLE, k), lane2(lanes, FORCE_RIGHT, k)
        (k0, k1), (M1, M2), step = lane2(lanes, REST, k), lane2(lanes, M_LEFT, k), lane2(lanes, STEP, k)
        dnL, dnR = force_slopes(h, nL, nM, nR)
        a = at_node(z1, M1, nL, dnL, k0 - 0.5 * h * k1, k1, flex, C)
        b = at_node(z2, M2, nR, dnR, k0 + 0.5 * h * k1, k1, flex, C)
        Mm = middle(h, M1, a[3], a[4], M2, b[3], b[4])
        zm = unit((
            middle(h, z1[0], a[1][0], a[2][0], z2[0], b[1][0], b[2][0]),
            middle(h, z1[1], a[1][1], a[2][1], z2[1], b[1][1], b[2][1]),
        ))  # fmt: skip
        m = at_node(zm, Mm, nM, ((nR[0] - nL[0]) / h, (nR[1] - nL[1]) / h), k0, k1, flex, C)
        p, M, r = landing(h, M1, a, m, b)
        miss = quotient(p, z2)
        turn = 2.0 * miss[1] / miss[0]
        dM, dr = M - M2, (r[0] + step[0], r[1] + step[1])
        # the rule sees the right node where it is, half of h f_y times the defect away from where it should be
        du, ddM, ddr = change(b, turn, dM, flex, C)
        f = 0.5 * h
        put_lane2(lanes, TURN, k, (turn + f * du, dM + f * ddM))
        put_lane2(lanes, PLACE, k, (dr[0] + f * ddr[0], dr[1] + f * ddr[1]))
        turn, dM, dr = missed(h, a, m, b, flex, C)
        put_lane2(lanes, MISSED_TURN, k, (turn, dM))
        put_lane2(lanes, MISSED_PLACE, k, dr)
