"""The curves of :mod:`cable_shape.kernels.rod_curve` on elements side by side, see `rod_lanes`, and what they tell.

In mid-element the equations and the curves' own rates are two things, and how far apart they are is the error of the
interpolation. Energy, potential and twist are integrals over the element.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    Quaternion,
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    inlined,
    qnormal,
    rotation,
    scale,
    subtract,
    tapply,
    times,
)
from cable_shape.kernels.rod_between import at_node, flexibility, force_slopes, integral, spin
from cable_shape.kernels.rod_curve import (
    Curve,
    at,
    at3,
    curves,
    layers,
    middle_functions,
    middle_slope,
    slope3,
    spins,
)
from cable_shape.kernels.rod_element import E3
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
    put_lane4,
)

# Rows, after those of `gather`: moments and positions at the left and right, and the boundary layer, see `layers`;
M_LEFT, M_RIGHT, R_LEFT, R_RIGHT, LAYER = GIVEN, GIVEN + 3, GIVEN + 6, GIVEN + 9, GIVEN + 12
# what comes: curves of position, rotation and moment,
COURSE, FRAME, MOMENT = GIVEN + 16, GIVEN + 34, GIVEN + 58
# squares of how far the rates of these are apart in mid-element, and of the moment there; elastic energy and integrals
# of weight . r, n . r' and u3.
GAP, OFF_Q, OFF_M, BENT = GIVEN + 76, GIVEN + 77, GIVEN + 78, GIVEN + 79
WORK, WEIGH, PULL, TWIST = GIVEN + 80, GIVEN + 81, GIVEN + 82, GIVEN + 83
ROWS = GIVEN + 84


@inlined
def lane_curve(lanes: Array, row: int, k: int) -> Curve:
    """A curve of element k."""
    a, b = lane3(lanes, row, k), lane3(lanes, row + 3, k)
    return a[0], a[1], a[2], b[0], b[1], b[2]


@inlined
def lane_curves(lanes: Array, row: int, k: int) -> tuple[Curve, Curve, Curve]:
    """Three curves of element k."""
    return lane_curve(lanes, row, k), lane_curve(lanes, row + 6, k), lane_curve(lanes, row + 12, k)


@inlined
def put_lane_curve(lanes: Array, row: int, k: int, c: Curve) -> None:
    """Writes a curve of element k."""
    put_lane3(lanes, row, k, (c[0], c[1], c[2]))
    put_lane3(lanes, row + 3, k, (c[3], c[4], c[5]))


@inlined
def put_lane_curves(lanes: Array, row: int, k: int, c: tuple[Curve, Curve, Curve]) -> None:
    """Writes three curves of element k."""
    put_lane_curve(lanes, row, k, c[0])
    put_lane_curve(lanes, row + 6, k, c[1])
    put_lane_curve(lanes, row + 12, k, c[2])


@inlined
def turns_over(a: Quaternion, b: Quaternion) -> bool:
    """Whether b has the other sign than the quaternion next to a."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0.0


@inlined
def gather_course(
    begin: int, left: Array, q: Array, first: Array, moments: Array, r: Vector, sign: float, lanes: Array
) -> tuple[Vector, float]:
    """Fills moments, positions and layers, and makes the signs of the quaternions follow one another.

    r: position where element `begin` begins; sign: of its left quaternion. Returns the same of what follows the lanes.
    """
    elements = first.shape[0]
    for k in range(LANES):
        e = min(begin + k, elements - 1)
        put_lane3(lanes, M_LEFT, k, (moments[e, 0], moments[e, 1], moments[e, 2]))
        put_lane3(lanes, M_RIGHT, k, (moments[e, 3], moments[e, 4], moments[e, 5]))
        put_lane3(lanes, R_LEFT, k, r)
        r = subtract(r, get3(first, e))
        put_lane3(lanes, R_RIGHT, k, r)
        n = lane3(lanes, FORCE_MIDDLE, k)
        softest = min(lanes[STIFF * LANES + k], lanes[(STIFF + 1) * LANES + k], lanes[(STIFF + 2) * LANES + k])
        layer = layers(lanes[H * LANES + k] * math.sqrt(math.sqrt(dot(n, n)) / softest))
        put_lane4(lanes, LAYER, k, layer)
        node = left[e]
        a, b = get4(q, node), get4(q, node + 1)
        if opens(left, e) and e > 0 and turns_over(get4(q, node - 1), a):
            sign = -sign
        put_lane4(lanes, LEFT, k, (sign * a[0], sign * a[1], sign * a[2], sign * a[3]))
        if turns_over(a, b):
            sign = -sign
        put_lane4(lanes, RIGHT, k, (sign * b[0], sign * b[1], sign * b[2], sign * b[3]))
    return r, sign


@kernel(fastmath=FAST)
def arcs(lanes: Array, elastic: bool, weight: Vector) -> None:
    """Fills curves, mid-element differences and integrals of all lanes; elastic: a compliance may be above 0."""
    for k in range(LANES):
        h = lanes[H * LANES + k]
        qa, qb = lane4(lanes, LEFT, k), lane4(lanes, RIGHT, k)
        nL, nM, nR = lane3(lanes, FORCE_LEFT, k), lane3(lanes, FORCE_MIDDLE, k), lane3(lanes, FORCE_RIGHT, k)
        k0, k1 = lane3(lanes, REST, k), lane3(lanes, SLOPE, k)
        Ma, Mb = lane3(lanes, M_LEFT, k), lane3(lanes, M_RIGHT, k)
        ra, rb = lane3(lanes, R_LEFT, k), lane3(lanes, R_RIGHT, k)
        layer = lane4(lanes, LAYER, k)
        K, C, K1 = lane3(lanes, STIFF, k), lane3(lanes, COMPLIANCE, k), lane3(lanes, TAPER, k)
        fL, dfL = flexibility(K, K1, -0.5 * h)
        flex, _ = flexibility(K, K1, 0.0)
        fR, dfR = flexibility(K, K1, 0.5 * h)
        dnL, dnR = force_slopes(h, nL, nM, nR)
        a = at_node(qa, Ma, nL, dnL, add(k0, scale(-0.5 * h, k1)), k1, fL, dfL, C)
        b = at_node(qb, Mb, nR, dnR, add(k0, scale(0.5 * h, k1)), k1, fR, dfR, C)
        rs = curves(h, ra, a[6], a[7], rb, b[6], b[7], layer)
        qs = spins(h, a, b, layer)
        Ms = curves(h, Ma, a[4], a[5], Mb, b[4], b[5], layer)
        e1, e2 = middle_functions(layer)
        rm, Mm = at3(rs, 0.5, e1, e2), at3(Ms, 0.5, e1, e2)
        qm = qnormal((at(qs[0], 0.5, e1, e2), at(qs[1], 0.5, e1, e2), at(qs[2], 0.5, e1, e2), at(qs[3], 0.5, e1, e2)))
        um = add(k0, times(flex, Mm))
        R = rotation(qm)
        Nm = tapply(R, nM)
        V = add(E3, times(C, Nm))
        miss = subtract(scale(h, apply(R, V)), slope3(rs, layer))
        lanes[GAP * LANES + k] = dot(miss, miss)
        miss = subtract(scale(h, subtract(cross(Mm, um), cross(V, Nm))), slope3(Ms, layer))
        lanes[OFF_M * LANES + k], lanes[BENT * LANES + k] = dot(miss, miss), dot(Mm, Mm)
        dq = spin(qm, um)
        v = (middle_slope(qs[0], layer), middle_slope(qs[1], layer), middle_slope(qs[2], layer))
        miss = subtract(scale(h, (dq[0], dq[1], dq[2])), v)
        lanes[OFF_Q * LANES + k] = dot(miss, miss) + (h * dq[3] - middle_slope(qs[3], layer)) ** 2
        # elastic energy of bending and twist, of stretch and shear (Simpson), and potential energy
        ea, em, eb = dot(Ma, times(fL, Ma)), dot(Mm, times(flex, Mm)), dot(Mb, times(fR, Mb))
        dea = dot(Ma, add(scale(2.0, times(fL, a[4])), times(dfL, Ma)))
        deb = dot(Mb, add(scale(2.0, times(fR, b[4])), times(dfR, Mb)))
        work = 0.5 * integral(h, ea, em, eb, dea, deb)
        if elastic:
            Na, Nb = tapply(rotation(qa), nL), tapply(rotation(qb), nR)
            work += h / 12.0 * (dot(Na, times(C, Na)) + 4.0 * dot(Nm, times(C, Nm)) + dot(Nb, times(C, Nb)))
        lanes[WORK * LANES + k] = work
        lanes[WEIGH * LANES + k] = integral(
            h, dot(weight, ra), dot(weight, rm), dot(weight, rb), dot(weight, a[6]), dot(weight, b[6])
        )
        pull = h / 6.0 * (dot(dnL, ra) + 2.0 * dot(add(dnL, dnR), rm) + dot(dnR, rb))
        lanes[PULL * LANES + k] = dot(nR, rb) - dot(nL, ra) - pull
        lanes[TWIST * LANES + k] = 0.5 * h * (a[8][2] + b[8][2]) + h * h / 12.0 * (a[9][2] - b[9][2])
        put_lane_curves(lanes, COURSE, k, rs)
        put_lane_curves(lanes, FRAME, k, (qs[0], qs[1], qs[2]))
        put_lane_curve(lanes, FRAME + 18, k, qs[3])
        put_lane_curves(lanes, MOMENT, k, Ms)
