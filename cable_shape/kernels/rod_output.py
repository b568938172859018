"""The solution at any points: interpolation of the solver's own order or better, energy and twist.

Between two nodes position and quaternion follow the quintic through values, first and second derivatives that the
rod's equations give at both nodes; moments follow the cubic through values and first derivatives. Internal force and
rest curvature are known exactly.
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
    get4,
    inlined,
    qmul,
    qnormal,
    rotation,
    scale,
    subtract,
    tapply,
    times,
)
from cable_shape.kernels.rod_defect import quadratic
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.rod_system import forces

Array = Any
INTERPOLATION = 0.2
Derivatives = tuple[Vector, Vector, Vector, Quaternion, Quaternion, Vector, Vector]


@inlined
def derivatives(
    q: Quaternion, M: Vector, n: Vector, dn: Vector, u0: Vector, k1: Vector, flex: Vector, C: Vector
) -> Derivatives:
    """At one node: r', r'', M', q', q'', u, u'."""
    R = rotation(q)
    u = add(u0, times(flex, M))
    N = tapply(R, n)
    V = add(E3, times(C, N))
    dM = subtract(cross(M, u), cross(V, N))
    dN = add(cross(N, u), tapply(R, dn))
    du = add(k1, times(flex, dM))
    dV = times(C, dN)
    dq = qmul(q, (0.5 * u[0], 0.5 * u[1], 0.5 * u[2], 0.0))
    a = qmul(dq, (0.5 * u[0], 0.5 * u[1], 0.5 * u[2], 0.0))
    b = qmul(q, (0.5 * du[0], 0.5 * du[1], 0.5 * du[2], 0.0))
    ddq = (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])
    return apply(R, V), apply(R, add(cross(u, V), dV)), dM, dq, ddq, u, du


@inlined
def quintic(
    h: float, a: float, da: float, dda: float, b: float, db: float, ddb: float
) -> tuple[float, float, float, float, float, float]:
    """Coefficients in x = 0 .. 1 of the quintic with these values and derivatives in s at both ends."""
    c1, c2 = h * da, 0.5 * h * h * dda
    p = b - a - c1 - c2
    r = h * db - c1 - 2.0 * c2
    t = 0.5 * h * h * ddb - c2
    return a, c1, c2, 10.0 * p - 4.0 * r + t, -15.0 * p + 7.0 * r - 2.0 * t, 6.0 * p - 3.0 * r + t


@inlined
def at(c: tuple[float, float, float, float, float, float], x: float) -> float:
    """A quintic's value."""
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))


@inlined
def rate(c: tuple[float, float, float, float, float, float]) -> float:
    """A quintic's derivative at x = 1/2."""
    return c[1] + c[2] + 0.75 * c[3] + 0.5 * c[4] + 0.3125 * c[5]


@kernel(fastmath=FAST)
def sample(
    q: Array, lam: Array, s: Array, h: Array, load: Array, rest: Array, stiff: Array, origin: Array, weight: Array,
    first: Array, points: int, out: Array, totals: Array,
) -> None:  # fmt: skip
    """Fills `out` (17 points): arc length, positions, quaternions, curvature, force, moment, as CableShape.buffer.

    origin (3,) [m]: start. weight (3,) [N/m]. totals: 0 integral of n . r' - weight . r [J], 1 integral of u3 [rad],
    2 error of the interpolation [m], judged by how far r' and R V, interpolated apart, differ in mid-element.
    """
    elements = h.shape[0]
    flex = (1.0 / stiff[0], 1.0 / stiff[1], 1.0 / stiff[2])
    C = (stiff[3], stiff[4], stiff[5])
    l3 = (lam[0], lam[1], lam[2])
    r = (origin[0], origin[1], origin[2])
    length = s[elements]
    o1, o2, o3, o4, o5 = points, 4 * points, 8 * points, 11 * points, 14 * points
    i = 0
    work = twist = gap = 0.0
    sign = 1.0
    for e in range(elements):
        he = h[e]
        nL, nM, nR = forces(load, e, l3)
        k0 = (rest[e, 0], rest[e, 1], rest[e, 2])
        k1 = (rest[e, 3], rest[e, 4], rest[e, 5])
        qa, qb = get4(q, e), get4(q, e + 1)
        qa = (sign * qa[0], sign * qa[1], sign * qa[2], sign * qa[3])
        if qa[0] * qb[0] + qa[1] * qb[1] + qa[2] * qb[2] + qa[3] * qb[3] < 0.0:
            qb = (-qb[0], -qb[1], -qb[2], -qb[3])
            sign = -1.0
        else:
            sign = 1.0
        Ma = (-first[e, 3], -first[e, 4], -first[e, 5])
        Mb = (first[e, 6], first[e, 7], first[e, 8])
        rb = (r[0] - first[e, 0], r[1] - first[e, 1], r[2] - first[e, 2])
        f = 1.0 / he
        dna = scale(f, add(scale(-3.0, nL), subtract(scale(4.0, nM), nR)))
        dnb = scale(f, add(nL, subtract(scale(3.0, nR), scale(4.0, nM))))
        v1, v2, dMa, qa1, qa2, ua, dua = derivatives(qa, Ma, nL, dna, add(k0, scale(-0.5 * he, k1)), k1, flex, C)
        w1, w2, dMb, qb1, qb2, ub, dub = derivatives(qb, Mb, nR, dnb, add(k0, scale(0.5 * he, k1)), k1, flex, C)
        x0 = quintic(he, r[0], v1[0], v2[0], rb[0], w1[0], w2[0])
        x1 = quintic(he, r[1], v1[1], v2[1], rb[1], w1[1], w2[1])
        x2 = quintic(he, r[2], v1[2], v2[2], rb[2], w1[2], w2[2])
        rm = (at(x0, 0.5), at(x1, 0.5), at(x2, 0.5))
        # integral of n . r' by parts, and of the weight, by Simpson
        fa, fb = scale(-1.0, dna), scale(-1.0, dnb)
        fm = scale(0.5, add(fa, fb))
        w3 = (weight[0], weight[1], weight[2])
        work += dot(nR, rb) - dot(nL, r)
        work += he / 6.0 * (
            dot(subtract(fa, w3), r) + 4.0 * dot(subtract(fm, w3), rm) + dot(subtract(fb, w3), rb)
        )  # fmt: skip
        twist += 0.5 * he * (ua[2] + ub[2]) + he * he / 12.0 * (dua[2] - dub[2])
        stop = s[e + 1] - 1e-12 * length
        if i < points and (i * length / (points - 1) < stop or e == elements - 1):
            y0 = quintic(he, qa[0], qa1[0], qa2[0], qb[0], qb1[0], qb2[0])
            y1 = quintic(he, qa[1], qa1[1], qa2[1], qb[1], qb1[1], qb2[1])
            y2 = quintic(he, qa[2], qa1[2], qa2[2], qb[2], qb1[2], qb2[2])
            y3 = quintic(he, qa[3], qa1[3], qa2[3], qb[3], qb1[3], qb2[3])
            R = rotation(qnormal((at(y0, 0.5), at(y1, 0.5), at(y2, 0.5), at(y3, 0.5))))
            V = add(E3, times(C, tapply(R, nM)))
            miss = subtract(scale(he, apply(R, V)), (rate(x0), rate(x1), rate(x2)))
            gap = max(gap, dot(miss, miss))
            while i < points:
                si = i * length / (points - 1)
                if si >= stop and e < elements - 1:
                    break
                x = (si - s[e]) * f
                out[i] = si
                out[o1 + 3 * i] = at(x0, x)
                out[o1 + 3 * i + 1] = at(x1, x)
                out[o1 + 3 * i + 2] = at(x2, x)
                p = qnormal((at(y0, x), at(y1, x), at(y2, x), at(y3, x)))
                out[o2 + 4 * i], out[o2 + 4 * i + 1], out[o2 + 4 * i + 2], out[o2 + 4 * i + 3] = p
                z = 1.0 - x
                M = add(
                    add(scale(z * z * (1.0 + 2.0 * x), Ma), scale(z * z * x * he, dMa)),
                    subtract(scale(x * x * (3.0 - 2.0 * x), Mb), scale(x * x * z * he, dMb)),
                )
                u = add(add(k0, scale(si - s[e] - 0.5 * he, k1)), times(flex, M))
                n = quadratic(x, nL, nM, nR)
                m = apply(rotation(p), M)
                out[o3 + 3 * i], out[o3 + 3 * i + 1], out[o3 + 3 * i + 2] = u
                out[o4 + 3 * i], out[o4 + 3 * i + 1], out[o4 + 3 * i + 2] = n
                out[o5 + 3 * i], out[o5 + 3 * i + 1], out[o5 + 3 * i + 2] = m
                i += 1
        r = rb
    totals[0], totals[1], totals[2] = work, twist, INTERPOLATION * math.sqrt(gap)


@kernel(fastmath=FAST)
def all_finite(a: Array) -> bool:
    """Whether every number of a flat array is finite."""
    total = 0.0
    for x in a:
        total += x
    return math.isfinite(total)
