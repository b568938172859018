"""How far the discrete rod is from the continuous one: local defects, and the correction that they call for.

In every element the rod's differential equations are integrated from the left node's rotation and moment by the
sixth-order Hermite-Simpson rule, which shares nothing with the solver's element. Where that lands beside the right node
is the defect. Turned into a change of the Newton system's right-hand side and solved with the factors at hand it gives
the error of the solution, which is taken off (deferred correction). Elements much longer than the boundary layer are
compared with their own two halves instead.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    get9,
    inlined,
    inverse,
    madd,
    put3,
    qexp,
    qmul,
    qnormal,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
    times,
)
from cable_shape.kernels.rod_between import quadratic, spin
from cable_shape.kernels.rod_element import E3, element_hessian, relative
from cable_shape.kernels.rod_lanes import LANES, gather, lane3, opens
from cable_shape.kernels.rod_rule import (
    M_LEFT,
    MISSED_MOMENT,
    MISSED_PLACE,
    MISSED_TURN,
    MOMENT,
    PLACE,
    TURN,
    gather_moments,
    is_long,
    land,
)

COARSE = 0.08  # of such a comparison is what it misses


@kernel
def halves(
    h: float, q1: Quaternion, q2: Quaternion, nL: Vector, nM: Vector, nR: Vector, k0: Vector, k1: Vector, K: Vector,
    C: Vector, K1: Vector,
) -> tuple[Vector, Vector, Vector]:  # fmt: skip
    """Gradient of two half elements in delta_1, delta_2, lambda, the rotation between them being in balance."""
    v, w = relative(q1, q2)
    f = 1.0 / math.sqrt(2.0 * (1.0 + w))
    q = qmul(q1, (f * v[0], f * v[1], f * v[2], f * (1.0 + w)))
    na, nb = quadratic(0.25, nL, nM, nR), quadratic(0.75, nL, nM, nR)
    ka, kb = add(k0, scale(-0.25 * h, k1)), add(k0, scale(0.25 * h, k1))
    Ka, Kb = add(K, scale(-0.25 * h, K1)), add(K, scale(0.25 * h, K1))
    a1 = b2 = al = bl = (0.0, 0.0, 0.0)
    for i in range(3):
        a1, a2, al, _, _, A22, _, _, _ = element_hessian(
            0.5 * h, q1, q, nL, na, nM, ka, k1, Ka, C, K1, (0.0, 0.0), None
        )
        b1, b2, bl, B11, _, _, _, _, _ = element_hessian(
            0.5 * h, q, q2, nM, nb, nR, kb, k1, Kb, C, K1, (0.0, 0.0), None
        )
        if i < 2:
            inv, _ = inverse(madd(A22, B11))
            q = qnormal(qmul(q, qexp(scale(-1.0, apply(inv, add(a2, b1))))))
    return a1, b2, add(al, bl)


@inlined
def as_gradient(
    e: int, turn: Vector, dM: Vector, dr: Vector, g2: Vector, U: Array, parts: Array
) -> tuple[Vector, Vector, Vector]:
    """A defect of the landing as one of element e's gradient in delta_1, delta_2, lambda."""
    d1 = scale(-1.0, apply(get9(U, e, 0), turn))
    # M is a derivative in the frame it is given in, which the miss turns
    d2 = subtract(dM, add(apply(get9(parts, e, 0), turn), scale(0.5, cross(g2, turn))))
    return d1, d2, scale(-1.0, add(dr, tapply(get9(parts, e, 18), turn)))


@kernel(fastmath=FAST)
def defects(
    left: Array, q: Array, h: Array, full: Array, rest: Array, section: Array, U: Array, parts: Array, first: Array,
    G: Array, slack: Array, moments: Array, sums: Array, missing: Array, lanes: Array,
) -> None:  # fmt: skip
    """Adds the defects of the gradient in the rotations and in the spans' forces to G (n, 3) and sums[:, :3].

    left (N,), full (N, 9): see `rod_lanes.gather`; section (N, 9): see `rod_lanes`. slack (N, 3) takes each element's
    of the force. moments (N, 6) [N m], cable frame, takes in columns 3 to 5 the moment at the right of each element and
    in the first three that at the left of the first of each span, with the defect. What the rule itself misses goes,
    likewise, into columns 3 to 5 (rotations) and 6 to 8 (force) of `first`; what it misses at the last node of each
    span into `missing` (m, 3).
    """
    elements = h.shape[0]
    j = -1
    behind = short = g2 = (0.0, 0.0, 0.0)
    for begin in range(0, elements, LANES):
        count = gather(begin, left, q, h, full, rest, section, lanes)
        gather_moments(begin, left, first, h, full, rest, section, g2, lanes)
        land(lanes)
        for k in range(count):
            e = begin + k
            node = left[e]
            gl, g1 = (first[e, 0], first[e, 1], first[e, 2]), (first[e, 3], first[e, 4], first[e, 5])
            g2 = (first[e, 6], first[e, 7], first[e, 8])
            if is_long(h, full, e, section):
                nL, nM, nR = get3(full, e), take3(full, e, 3), take3(full, e, 6)
                k0, k1 = (rest[e, 0], rest[e, 1], rest[e, 2]), (rest[e, 3], rest[e, 4], rest[e, 5])
                K, C, K1 = get3(section, e), take3(section, e, 3), take3(section, e, 6)
                a1, a2, al = halves(h[e], get4(q, node), get4(q, node + 1), nL, nM, nR, k0, k1, K, C, K1)
                f = 16.0 / 15.0
                d1, d2, dl = scale(f, subtract(a1, g1)), scale(f, subtract(a2, g2)), scale(f, subtract(al, gl))
                e1, e2, el = scale(COARSE, d1), scale(COARSE, d2), scale(COARSE, dl)
            else:
                turn, dM, dr = lane3(lanes, TURN, k), lane3(lanes, MOMENT, k), lane3(lanes, PLACE, k)
                d1, d2, dl = as_gradient(e, turn, dM, dr, g2, U, parts)
                d1 = subtract(d1, add(lane3(lanes, M_LEFT, k), g1))  # what is missing to balance at the left node
                turn, dM = lane3(lanes, MISSED_TURN, k), lane3(lanes, MISSED_MOMENT, k)
                e1, e2, el = as_gradient(e, turn, dM, lane3(lanes, MISSED_PLACE, k), g2, U, parts)
            if opens(left, e):
                if j >= 0:
                    put3(G, node - 1, 0, add(get3(G, node - 1), behind))
                    put3(missing, j, 0, short)
                j += 1
                behind = short = (0.0, 0.0, 0.0)
                put3(moments, e, 0, scale(-1.0, add(g1, d1)))
            put3(G, node, 0, add(get3(G, node), add(behind, d1)))
            put3(slack, e, 0, dl)
            put3(moments, e, 3, add(g2, d2))
            put3(first, e, 3, add(short, e1))
            put3(first, e, 6, el)
            put3(sums, j, 0, add(get3(sums, j), dl))
            behind, short = d2, e2
    last = left[elements - 1] + 1
    put3(G, last, 0, add(get3(G, last), behind))
    put3(missing, j, 0, short)


@inlined
def change_of_step(parts: Array, e: int, d1: Vector, d2: Vector, dl: Vector) -> Vector:
    """Minus the change of element e's step in position, under rotations of its nodes and a change of lambda."""
    return add(
        add(tapply(get9(parts, e, 9), d1), tapply(get9(parts, e, 18), d2)),
        apply(get9(parts, e, 27), dl),
    )


@inlined
def take_off(
    q: Array, U: Array, parts: Array, block: Matrix, d: Array, dl: Vector, slack: Array, first: Array, moments: Array,
    G: Array, better: Array, r: Vector,
) -> tuple[Vector, float, Vector]:  # fmt: skip
    """Takes the answer d, dl to the defects off a stretch of elements; see `correct`.

    block: second derivative in the first node's rotation, of the first element alone; r: change of that node's
    position. G takes what the rule misses in the rotations of all nodes but the last. Returns the change of the last
    node's position, the square of the largest on the way, and what the rule misses in lambda.
    """
    elements = first.shape[0]
    largest = 0.0
    closure = (0.0, 0.0, 0.0)
    d1 = get3(d, 0)
    M = get3(moments, 0)  # minus the derivative in delta_1
    t = add(apply(block, d1), apply(get9(U, 0, 0), get3(d, 1)))
    t = add(t, add(apply(get9(parts, 0, 9), dl), scale(-0.5, cross(M, d1))))
    put3(moments, 0, 0, subtract(M, t))
    for e in range(elements):
        d2 = get3(d, e + 1)
        t = add(change_of_step(parts, e, d1, d2, dl), get3(slack, e))
        for i in range(3):
            first[e, i] += t[i]
        r = add(r, t)
        largest = max(largest, dot(r, r))
        M = (moments[e, 3], moments[e, 4], moments[e, 5])
        t = add(tapply(get9(U, e, 0), d1), apply(get9(parts, e, 0), d2))
        M = add(add(M, t), add(apply(get9(parts, e, 18), dl), scale(0.5, cross(M, d2))))
        put3(moments, e, 3, M)
        if e < elements - 1:
            put3(moments, e + 1, 0, M)
        put3(G, e, 0, (first[e, 3], first[e, 4], first[e, 5]))
        closure = add(closure, (first[e, 6], first[e, 7], first[e, 8]))
        d1 = d2
    for k in range(elements + 1):
        p, turn = get4(q, k), spin(get4(q, k), get3(d, k))
        p = qnormal((p[0] + turn[0], p[1] + turn[1], p[2] + turn[2], p[3] + turn[3]))
        better[k, 0], better[k, 1], better[k, 2], better[k, 3] = p
    return r, largest, closure


@inlined
def left_over(
    h: Array, parts: Array, d: Array, dl: Vector, first: Array, stiffest: float, errors: Array, r: Vector
) -> tuple[Vector, float]:
    """What is left of the error on a stretch of elements, from the answer d, dl to what the rule misses.

    errors (N,) takes each element's share; r as in `take_off`. Returns the error of the last node's position and the
    square of the largest on the way.
    """
    left = 0.0
    for e in range(h.shape[0]):
        t = change_of_step(parts, e, get3(d, e), get3(d, e + 1), dl)
        a, b = (first[e, 6], first[e, 7], first[e, 8]), (first[e, 3], first[e, 4], first[e, 5])
        errors[e] = math.sqrt(dot(a, a)) + h[e] * h[e] * math.sqrt(dot(b, b)) / stiffest
        r = add(r, add(t, a))
        left = max(left, dot(r, r))
    return r, left


@inlined
def node_slope(q: Array, k: int, d: Vector, n: Vector, dl: Vector, C: Vector) -> Vector:
    """Change of r' = R V at node k under the rotation d (cable frame) and the change dl of the force."""
    R = rotation(get4(q, k))
    N = tapply(R, n)
    dN = add(cross(N, d), tapply(R, dl))
    return apply(R, add(cross(d, add(E3, times(C, N))), times(C, dN)))
