"""How far the discrete rod is from the continuous one: local defects, and the position error that they cause.

In every element the rod's differential equations are integrated from the left node's rotation and moment by a
sixth-order Runge-Kutta step (Butcher 1964), which shares nothing with the solver's element. Where it lands beside the
right node is the defect. Turned into a change of the Newton system's right-hand side and solved with the factors at
hand it gives the error in position, not a bound. Elements much longer than the boundary layer, over which forward
integration blows up, are compared with their own two halves instead.
"""

from __future__ import annotations

import math
from typing import Any

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
    get9,
    inlined,
    inverse,
    madd,
    put3,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    rotation,
    scale,
    subtract,
    tapply,
    times,
)
from cable_shape.kernels.rod_element import E3, element_hessian, relative
from cable_shape.kernels.rod_factor import backward, border, forward
from cable_shape.kernels.rod_system import forces
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any
State = tuple[Quaternion, Vector, Vector]

STIFF = 4.0  # h^2 |n| / min(EI) above which an element is compared with its halves


@inlined
def quadratic(x: float, a: Vector, b: Vector, c: Vector) -> Vector:
    """The parabola through a, b, c at 0, 1/2, 1."""
    fa, fb, fc = (2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)
    return (
        fa * a[0] + fb * b[0] + fc * c[0],
        fa * a[1] + fb * b[1] + fc * c[1],
        fa * a[2] + fb * b[2] + fc * c[2],
    )


@inlined
def slope(q: Quaternion, M: Vector, n: Vector, u0: Vector, flex: Vector, C: Vector) -> State:
    """q', M' = -u x M - V x N (in the cable frame) and r' = R V."""
    u = add(u0, times(flex, M))
    R = rotation(q)
    N = tapply(R, n)
    V = add(E3, times(C, N))
    turn = qmul(q, (0.5 * u[0], 0.5 * u[1], 0.5 * u[2], 0.0))
    return turn, subtract(cross(M, u), cross(V, N)), apply(R, V)


@inlined
def moved(q: Quaternion, M: Vector, f: float, a: State) -> tuple[Quaternion, Vector]:
    """q and M after f times a slope."""
    b = a[0]
    return (
        (q[0] + f * b[0], q[1] + f * b[1], q[2] + f * b[2], q[3] + f * b[3]),
        add(M, scale(f, a[1])),
    )


@inlined
def blend(a: State, fa: float, b: State, fb: float) -> State:
    """fa a + fb b."""
    p, q = a[0], b[0]
    return (
        (fa * p[0] + fb * q[0], fa * p[1] + fb * q[1], fa * p[2] + fb * q[2], fa * p[3] + fb * q[3]),
        add(scale(fa, a[1]), scale(fb, b[1])),
        add(scale(fa, a[2]), scale(fb, b[2])),
    )


@kernel(fastmath=FAST)
def integrate(
    h: float, q: Quaternion, M: Vector, nL: Vector, nM: Vector, nR: Vector, k0: Vector, k1: Vector, flex: Vector,
    C: Vector,
) -> State:  # fmt: skip
    """Rotation, moment (cable frame) and step in position at the right end, from those at the left."""
    third = quadratic(1.0 / 3.0, nL, nM, nR)
    a = slope(q, M, nL, add(k0, scale(-0.5 * h, k1)), flex, C)
    p, L = moved(q, M, h / 3.0, a)
    b = slope(p, L, third, add(k0, scale(-h / 6.0, k1)), flex, C)
    p, L = moved(q, M, h * 2.0 / 3.0, b)
    c = slope(p, L, quadratic(2.0 / 3.0, nL, nM, nR), add(k0, scale(h / 6.0, k1)), flex, C)
    p, L = moved(q, M, h, blend(blend(a, 1.0 / 12.0, b, 1.0 / 3.0), 1.0, c, -1.0 / 12.0))
    d = slope(p, L, third, add(k0, scale(-h / 6.0, k1)), flex, C)
    p, L = moved(q, M, h, blend(blend(a, -1.0 / 16.0, b, 9.0 / 8.0), 1.0, blend(c, -3.0 / 16.0, d, -3.0 / 8.0), 1.0))
    e = slope(p, L, nM, k0, flex, C)
    p, L = moved(q, M, h, blend(blend(b, 9.0 / 8.0, c, -3.0 / 8.0), 1.0, blend(d, -0.75, e, 0.5), 1.0))
    f = slope(p, L, nM, k0, flex, C)
    p, L = moved(
        q,
        M,
        h,
        blend(
            blend(blend(a, 9.0 / 44.0, b, -9.0 / 11.0), 1.0, blend(c, 63.0 / 44.0, d, 18.0 / 11.0), 1.0),
            1.0,
            f,
            -16.0 / 11.0,
        ),
    )
    g = slope(p, L, nR, add(k0, scale(0.5 * h, k1)), flex, C)
    total = blend(
        blend(blend(a, 11.0 / 120.0, g, 11.0 / 120.0), 1.0, blend(c, 27.0 / 40.0, d, 27.0 / 40.0), 1.0),
        1.0,
        blend(e, -4.0 / 15.0, f, -4.0 / 15.0),
        1.0,
    )
    p, L = moved(q, M, h, total)
    return qnormal(p), L, scale(h, total[2])


@kernel
def halves(
    h: float, q1: Quaternion, q2: Quaternion, nL: Vector, nM: Vector, nR: Vector, k0: Vector, k1: Vector, K: Vector,
    C: Vector,
) -> tuple[Vector, Vector, Vector]:  # fmt: skip
    """Gradient of two half elements in delta_1, delta_2, lambda, the rotation between them being in balance."""
    v, w = relative(q1, q2)
    f = 1.0 / math.sqrt(2.0 * (1.0 + w))
    q = qmul(q1, (f * v[0], f * v[1], f * v[2], f * (1.0 + w)))
    na, nb = quadratic(0.25, nL, nM, nR), quadratic(0.75, nL, nM, nR)
    ka, kb = add(k0, scale(-0.25 * h, k1)), add(k0, scale(0.25 * h, k1))
    a1 = b2 = al = bl = (0.0, 0.0, 0.0)
    for i in range(3):
        a1, a2, al, _, _, A22, _, _, _ = element_hessian(0.5 * h, q1, q, nL, na, nM, ka, k1, K, C)
        b1, b2, bl, B11, _, _, _, _, _ = element_hessian(0.5 * h, q, q2, nM, nb, nR, kb, k1, K, C)
        if i < 2:
            inv, _ = inverse(madd(A22, B11))
            q = qnormal(qmul(q, qexp(scale(-1.0, apply(inv, add(a2, b1))))))
    return a1, b2, add(al, bl)


@kernel
def defects(
    q: Array, lam: Array, h: Array, load: Array, rest: Array, stiff: Array, mask: Array, U: Array, parts: Array,
    first: Array, G: Array, slack: Array, total: Array,
) -> float:  # fmt: skip
    """Fills G (N+1, 3), slack (N, 3) and total[:3] with the defects of the gradient in the rotations and in lambda.

    Returns the largest defect of an element: of its rotation [rad], its position / length and its moment / the
    largest moment, whichever is largest.
    """
    elements = h.shape[0]
    K = (stiff[0], stiff[1], stiff[2])
    C = (stiff[3], stiff[4], stiff[5])
    flex = (1.0 / K[0], 1.0 / K[1], 1.0 / K[2])
    softest = min(K[0], K[1])
    l3 = (lam[0], lam[1], lam[2])
    length = largest = moment = 0.0
    for e in range(elements):
        length += h[e]
        M = (first[e, 6], first[e, 7], first[e, 8])
        moment = max(moment, dot(M, M))
    moment = max(math.sqrt(moment), 1e-3 * softest / length)
    s0 = s1 = s2 = 0.0
    left = (0.0, 0.0, 0.0)
    for e in range(elements):
        nL, nM, nR = forces(load, e, l3)
        k0 = (rest[e, 0], rest[e, 1], rest[e, 2])
        k1 = (rest[e, 3], rest[e, 4], rest[e, 5])
        q1, q2 = get4(q, e), get4(q, e + 1)
        gl, g1 = (first[e, 0], first[e, 1], first[e, 2]), (first[e, 3], first[e, 4], first[e, 5])
        g2 = (first[e, 6], first[e, 7], first[e, 8])
        if h[e] * h[e] * math.sqrt(dot(nM, nM)) > STIFF * softest:
            a1, a2, al = halves(h[e], q1, q2, nL, nM, nR, k0, k1, K, C)
            f = 16.0 / 15.0
            d1, d2, dl = scale(f, subtract(a1, g1)), scale(f, subtract(a2, g2)), scale(f, subtract(al, gl))
            residual = max(math.sqrt(max(dot(d1, d1), dot(d2, d2))) / moment, math.sqrt(dot(dl, dl)) / length)
        else:
            p, M, r = integrate(h[e], q1, scale(-1.0, g1), nL, nM, nR, k0, k1, flex, C)
            miss = qmul(qconj(q2), p)
            if miss[3] < 0.0:
                miss = (-miss[0], -miss[1], -miss[2], -miss[3])
            turn = qlog(miss)
            dM, dr = subtract(M, g2), add(r, gl)
            residual = max(math.sqrt(dot(turn, turn)), math.sqrt(dot(dM, dM)) / moment, math.sqrt(dot(dr, dr)) / length)
            d1 = scale(-1.0, apply(get9(U, e, 0), turn))
            # M is a derivative in the frame it is given in, which the miss turns
            d2 = subtract(dM, add(apply(get9(parts, e, 0), turn), scale(0.5, cross(g2, turn))))
            dl = scale(-1.0, add(dr, tapply(get9(parts, e, 18), turn)))
        if not residual <= largest:  # NaN is the largest of all
            largest = residual
        put3(G, e, 0, add(left, d1))
        left = d2
        put3(slack, e, 0, dl)
        s0 += dl[0]
        s1 += dl[1]
        s2 += dl[2]
    put3(G, elements, 0, left)
    for i in range(3):
        G[0, i] *= mask[0, i]
        G[elements, i] *= mask[1, i]
    total[0], total[1], total[2] = s0, s1, s2
    return largest


@kernel
def position_error(
    q: Array, lam: Array, h: Array, load: Array, rest: Array, stiff: Array, mask: Array, work: Array, width: int,
    slack: Array, errors: Array, info: Array,
) -> float:  # fmt: skip
    """Estimated largest position error of the solution at hand [m]; infinite if it cannot be judged.

    slack (N, 3): scratch; errors (N, ): takes each element's share, a guide for the next mesh; info[5] takes the
    residual.
    """
    elements = h.shape[0]
    _, U, _, P, Y, W = matrices(work, elements, width)
    parts, first, G, d, gram, total, step = vectors(work, elements, width)
    info[5] = defects(q, lam, h, load, rest, stiff, mask, U, parts, first, G, slack, total)
    stiffest = max(stiff[0], stiff[1], stiff[2])
    for e in range(elements):
        a, b = get3(slack, e), get3(G, e)
        errors[e] = math.sqrt(dot(a, a)) + h[e] * math.sqrt(dot(b, b)) / stiffest * h[e]
    forward(G, P, Y, W, gram)
    border(gram, total[3:], total[:3], step)
    backward(P, Y, W, step, d)
    dl = (step[0], step[1], step[2]) if width > 1 else (0.0, 0.0, 0.0)
    x = y = z = largest = 0.0
    for e in range(elements):
        t = add(
            add(tapply(get9(parts, e, 9), get3(d, e)), tapply(get9(parts, e, 18), get3(d, e + 1))),
            apply(get9(parts, e, 27), dl),
        )
        x -= slack[e, 0] + t[0]
        y -= slack[e, 1] + t[1]
        z -= slack[e, 2] + t[2]
        largest = max(largest, x * x + y * y + z * z)
    if not math.isfinite(largest) or not math.isfinite(info[5]) or not math.isfinite(x + y + z):
        return math.inf
    return math.sqrt(largest)
