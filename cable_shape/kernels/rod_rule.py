"""The sixth-order rule of :mod:`cable_shape.kernels.rod_defect` on elements side by side, see `rod_lanes`."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    Vector,
    add,
    cross,
    dot,
    inlined,
    qconj,
    qmul,
    qnormal,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_between import (
    Node,
    apart,
    at_node,
    change,
    flexibility,
    force_slopes,
    landing,
    middle3,
    middle4,
    missed,
)
from cable_shape.kernels.rod_curve import STIFF as MANY
from cable_shape.kernels.rod_lanes import (
    COMPLIANCE,
    FORCE_LEFT,
    FORCE_MIDDLE,
    FORCE_RIGHT,
    GIVEN,
    LANES,
    LEFT,
    REST,
    RIGHT,
    SLOPE,
    STIFF,
    TAPER,
    H,
    lane3,
    lane4,
    opens,
    put_lane3,
)
from cable_shape.kernels.rod_mesh import jumps

# Rows, after those of `gather`: moments at the left and right, and minus the step in position;
M_LEFT, M_RIGHT, STEP = GIVEN, GIVEN + 3, GIVEN + 6
# what comes: defects in rotation, moment and position, and what the rule itself misses of these.
TURN, MOMENT, PLACE = GIVEN + 9, GIVEN + 12, GIVEN + 15
MISSED_TURN, MISSED_MOMENT, MISSED_PLACE = GIVEN + 18, GIVEN + 21, GIVEN + 24
ROWS = GIVEN + 27


@inlined
def is_long(h: Array, full: Array, e: int, section: Array) -> bool:
    """Whether element e is so much longer than its boundary layer that the rule is none for it."""
    n = take3(full, e, 3)
    return h[e] * h[e] * math.sqrt(dot(n, n)) > MANY * min(section[e, 0], section[e, 1])


@inlined
def other_section(section: Array, e: int) -> bool:
    """Whether the stiffness changes in element e > 0, or from the one before it."""
    change = 0.0
    for i in range(3):
        change += abs(section[e, 6 + i]) + abs(section[e, i] - section[e - 1, i])
    return change != 0.0


@inlined
def gather_moments(
    begin: int, left: Array, first: Array, h: Array, full: Array, rest: Array, section: Array, before: Vector,
    lanes: Array,
) -> None:  # fmt: skip
    """Fills moments and steps. A node's moment is that of the element before it, unless something holds the node.

    before: moment at the right of the element before `begin`.
    """
    elements = h.shape[0]
    for k in range(LANES):
        e = min(begin + k, elements - 1)
        M = (-first[e, 3], -first[e, 4], -first[e, 5])
        if k > 0:
            before = (first[e - 1, 6], first[e - 1, 7], first[e - 1, 8])
        bent = rest[e, 3] != 0.0 or rest[e, 4] != 0.0 or rest[e, 5] != 0.0 or other_section(section, e)
        held = opens(left, e)
        if not (held or bent or is_long(h, full, e - 1, section) or jumps(full, e) or apart(before, M)):
            M = before
        put_lane3(lanes, M_LEFT, k, M)
        put_lane3(lanes, M_RIGHT, k, (first[e, 6], first[e, 7], first[e, 8]))
        put_lane3(lanes, STEP, k, (first[e, 0], first[e, 1], first[e, 2]))


@inlined
def onward(
    h: float, turn: Vector, dM: Vector, dr: Vector, b: Node, n: Vector, flex: Vector, C: Vector
) -> tuple[Vector, Vector, Vector]:
    """The defect of a rule that uses the right node, too, as one of integration from the left alone.

    The rule sees the right node where it is, half of h f_y times the defect away from where it should be.
    """
    du, ddM, ddr = change(b, n, turn, dM, flex, C)
    f = 0.5 * h
    return add(turn, scale(f, add(du, scale(0.5, cross(turn, b[8]))))), add(dM, scale(f, ddM)), add(dr, scale(f, ddr))


@kernel(fastmath=FAST)
def land(lanes: Array) -> None:
    """Integrates over all lanes from the left: fills by how much the right node is missed, and what the rule misses."""
    for k in range(LANES):
        h, q1, q2 = lanes[H * LANES + k], lane4(lanes, LEFT, k), lane4(lanes, RIGHT, k)
        sign = 1.0 if q1[0] * q2[0] + q1[1] * q2[1] + q1[2] * q2[2] + q1[3] * q2[3] >= 0.0 else -1.0
        q2 = (sign * q2[0], sign * q2[1], sign * q2[2], sign * q2[3])
        nL, nM, nR = lane3(lanes, FORCE_LEFT, k), lane3(lanes, FORCE_MIDDLE, k), lane3(lanes, FORCE_RIGHT, k)
        k0, k1 = lane3(lanes, REST, k), lane3(lanes, SLOPE, k)
        K, C, K1 = lane3(lanes, STIFF, k), lane3(lanes, COMPLIANCE, k), lane3(lanes, TAPER, k)
        fL, dfL = flexibility(K, K1, -0.5 * h)
        flex, dflex = flexibility(K, K1, 0.0)
        fR, dfR = flexibility(K, K1, 0.5 * h)
        dnL, dnR = force_slopes(h, nL, nM, nR)
        M1, M2 = lane3(lanes, M_LEFT, k), lane3(lanes, M_RIGHT, k)
        a = at_node(q1, M1, nL, dnL, add(k0, scale(-0.5 * h, k1)), k1, fL, dfL, C)
        b = at_node(q2, M2, nR, dnR, add(k0, scale(0.5 * h, k1)), k1, fR, dfR, C)
        Mm = middle3(h, a[1], a[4], a[5], b[1], b[4], b[5])
        m = at_node(qnormal(middle4(h, a, b)), Mm, nM, scale(1.0 / h, subtract(nR, nL)), k0, k1, flex, dflex, C)
        p, M, r = landing(h, a, m, b)
        miss = qmul(qconj(q2), p)
        # small, or the mesh is hopeless
        turn = scale(2.0 / miss[3], (miss[0], miss[1], miss[2]))
        turn, dM, dr = onward(h, turn, subtract(M, M2), add(r, lane3(lanes, STEP, k)), b, nR, fR, C)
        put_lane3(lanes, TURN, k, turn)
        put_lane3(lanes, MOMENT, k, dM)
        put_lane3(lanes, PLACE, k, dr)
        turn, dM, dr = missed(h, a, m, b, nM, flex, C)
        put_lane3(lanes, MISSED_TURN, k, turn)
        put_lane3(lanes, MISSED_MOMENT, k, dM)
        put_lane3(lanes, MISSED_PLACE, k, dr)
