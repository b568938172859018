"""The solution at any points: interpolation of its own order or better, energy and twist.

Between two nodes position, quaternion and moment follow the curves of :mod:`cable_shape.kernels.rod_curve` through
values, first and second derivatives that the rod's equations give at both nodes. Internal force and rest curvature are
known exactly.
"""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    add,
    apply,
    cross,
    dot,
    get4,
    qnear,
    qnormal,
    rotation,
    scale,
    subtract,
    tapply,
    times,
)
from cable_shape.kernels.rod_between import apart, at_node, force_slopes, integral, no_node, quadratic, spin
from cable_shape.kernels.rod_curve import (
    at,
    at3,
    curves,
    functions,
    layers,
    middle_slope,
    slope3,
    spins,
)
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.rod_system import forces, jumps

Array = Any
INTERPOLATION = 0.2


@kernel(fastmath=FAST)
def sample(
    q: Array, lam: Array, moments: Array, s: Array, h: Array, load: Array, rest: Array, stiff: Array, origin: Array,
    weight: Array, first: Array, points: int, out: Array, totals: Array,
) -> None:  # fmt: skip
    """Fills `out` (17 points): arc length, positions, quaternions, curvature, force, moment, as CableShape.buffer.

    moments (N, 6) [N m], cable frame: at the left and right of each element; first (N, 9): minus the steps in position
    first; origin (3,) [m]: start; weight (3,) [N/m]. totals: 0 elastic energy - weight . r [J], 1 integral of u3 [rad],
    2 error of the interpolation [m], judged by how far r' and R V, interpolated apart, differ in mid-element; 3 the
    largest such difference over an element, of rotation [rad], moment / largest moment and position / length; 4
    integral of n . r' - weight . r [J], which with the functional's value makes the energy, too.
    """
    elements = h.shape[0]
    flex = (1.0 / stiff[0], 1.0 / stiff[1], 1.0 / stiff[2])
    C = (stiff[3], stiff[4], stiff[5])
    softness = max(flex[0], flex[1])
    w3 = (weight[0], weight[1], weight[2])
    l3 = (lam[0], lam[1], lam[2])
    r = (origin[0], origin[1], origin[2])
    dx = s[elements] / (points - 1)
    o1, o2, o3, o4, o5 = points, 4 * points, 8 * points, 11 * points, 14 * points
    i = 0
    b = no_node()
    work = pull = heavy = twist = gap = off_M = off_q = 0.0
    bent = (1e-3 * min(stiff[0], stiff[1]) / s[elements]) ** 2
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
        Ma, Mb = (moments[e, 0], moments[e, 1], moments[e, 2]), (moments[e, 3], moments[e, 4], moments[e, 5])
        rb = (r[0] - first[e, 0], r[1] - first[e, 1], r[2] - first[e, 2])
        f = 1.0 / he
        dnL, dnR = force_slopes(he, nL, nM, nR)
        if e == 0 or rest[e, 3] != 0.0 or rest[e, 4] != 0.0 or rest[e, 5] != 0.0 or jumps(load, e) or apart(b[1], Ma):
            b = at_node(qa, Ma, nL, dnL, add(k0, scale(-0.5 * he, k1)), k1, flex, C)
        a = b
        b = at_node(qb, Mb, nR, dnR, add(k0, scale(0.5 * he, k1)), k1, flex, C)
        layer = layers(he * math.sqrt(softness * math.sqrt(dot(nM, nM))))
        rs = curves(he, r, a[6], a[7], rb, b[6], b[7], layer)
        qs = spins(he, a, b, layer)
        Ms = curves(he, Ma, a[4], a[5], Mb, b[4], b[5], layer)
        # in mid-element the equations and the interpolation's own rates are two things
        e1, e2 = functions(0.5, layer)
        rm, Mm = at3(rs, 0.5, e1, e2), at3(Ms, 0.5, e1, e2)
        qm = qnormal((at(qs[0], 0.5, e1, e2), at(qs[1], 0.5, e1, e2), at(qs[2], 0.5, e1, e2), at(qs[3], 0.5, e1, e2)))
        um = add(k0, times(flex, Mm))
        R = rotation(qm)
        Nm = tapply(R, nM)
        V = add(E3, times(C, Nm))
        miss = subtract(scale(he, apply(R, V)), slope3(rs, layer))
        gap = max(gap, dot(miss, miss))
        miss = subtract(scale(he, subtract(cross(Mm, um), cross(V, Nm))), slope3(Ms, layer))
        bent = max(bent, dot(Mm, Mm))
        off_M = max(off_M, dot(miss, miss))
        dq = spin(qm, um)
        w = middle_slope(qs[3], layer)
        v = (middle_slope(qs[0], layer), middle_slope(qs[1], layer), middle_slope(qs[2], layer))
        miss = subtract(scale(he, (dq[0], dq[1], dq[2])), v)
        off_q = max(off_q, dot(miss, miss) + (he * dq[3] - w) ** 2)
        # elastic energy of bending and twist, of stretch and shear (Simpson), and potential energy
        ea, em, eb = dot(Ma, times(flex, Ma)), dot(Mm, times(flex, Mm)), dot(Mb, times(flex, Mb))
        dea, deb = 2.0 * dot(Ma, times(flex, a[4])), 2.0 * dot(Mb, times(flex, b[4]))
        work += 0.5 * integral(he, ea, em, eb, dea, deb)
        if C[0] != 0.0 or C[2] != 0.0:
            Na, Nb = tapply(rotation(qa), nL), tapply(rotation(qb), nR)
            work += he / 12.0 * (dot(Na, times(C, Na)) + 4.0 * dot(Nm, times(C, Nm)) + dot(Nb, times(C, Nb)))
        weigh = integral(he, dot(w3, r), dot(w3, rm), dot(w3, rb), dot(w3, a[6]), dot(w3, b[6]))
        work -= weigh
        heavy += weigh
        pull += dot(nR, rb) - dot(nL, r)
        pull -= he / 6.0 * (dot(dnL, r) + 2.0 * dot(add(dnL, dnR), rm) + dot(dnR, rb))
        twist += 0.5 * he * (a[8][2] + b[8][2]) + he * he / 12.0 * (a[9][2] - b[9][2])
        next_i = points if e == elements - 1 else min(points, math.ceil(s[e + 1] / dx - 1e-9))
        for j in range(i, next_i):
            x = (j * dx - s[e]) * f
            out[j] = j * dx
            e1, e2 = functions(x, layer)
            out[o1 + 3 * j], out[o1 + 3 * j + 1], out[o1 + 3 * j + 2] = at3(rs, x, e1, e2)
            p = qnear((at(qs[0], x, e1, e2), at(qs[1], x, e1, e2), at(qs[2], x, e1, e2), at(qs[3], x, e1, e2)))
            out[o2 + 4 * j], out[o2 + 4 * j + 1], out[o2 + 4 * j + 2], out[o2 + 4 * j + 3] = p
            M = at3(Ms, x, e1, e2)
            out[o3 + 3 * j], out[o3 + 3 * j + 1], out[o3 + 3 * j + 2] = add(
                add(k0, scale(he * (x - 0.5), k1)), times(flex, M)
            )
            out[o4 + 3 * j], out[o4 + 3 * j + 1], out[o4 + 3 * j + 2] = quadratic(x, nL, nM, nR)
            out[o5 + 3 * j], out[o5 + 3 * j + 1], out[o5 + 3 * j + 2] = apply(rotation(p), M)
        i = max(i, next_i)
        r = rb
    totals[0], totals[1], totals[2] = work, twist, INTERPOLATION * math.sqrt(gap)
    totals[4] = pull - heavy
    totals[3] = max(2.0 * math.sqrt(off_q), math.sqrt(off_M / bent), math.sqrt(gap) / s[elements])


@kernel(fastmath=FAST)
def all_finite(a: Array) -> bool:
    """Whether every number of a flat array is finite."""
    total = 0.0
    for x in a:
        total += x
    return math.isfinite(total)
