"""Local defects of the planar rod, and the correction that they call for: see :mod:`cable_shape.kernels.rod_defect`."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_element import (
    Pair,
    element_gradient,
    element_hessian,
    half_turn,
    product,
    quotient,
    relative,
    section,
    unit,
)
from cable_shape.kernels.planar_system import (
    B1,
    B2,
    CC,
    CHANGE,
    G1,
    G2,
    GL,
    H12,
    H22,
    MISSED,
    G,
    forces,
    jumps,
    respond,
)
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_between import astray, integral, middle
from cable_shape.kernels.rod_curve import STIFF
from cable_shape.kernels.rod_defect import COARSE

Array = Any
#: z, its first and second derivative, M', M'', r', r'', u, u', N (along t and nu)
Node = tuple[Pair, Pair, Pair, float, float, Pair, Pair, float, float, Pair]
NO_NODE: Node = (
    (1.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.0, 0.0, (0.0, 0.0), (0.0, 0.0), 0.0, 0.0, (0.0, 0.0),
)  # fmt: skip


@inlined
def spin(z: Pair, u: float) -> Pair:
    """i u z / 2, the rate of z in a frame that turns at u."""
    return -0.5 * u * z[1], 0.5 * u * z[0]


@inlined
def at_node(z: Pair, M: float, n: Pair, dn: Pair, u0: float, k1: float, flex: float, C: Pair) -> Node:
    """All that the equations say at a node. n, dn: force [N] and its derivative; u0, k1: rest curvature and its."""
    t = product(z, z)
    a, b, slope = section(t, n, C)
    u = u0 + flex * M
    Vt, Vn = 1.0 + C[0] * a, C[1] * b
    dM = Vn * a - Vt * b
    da = u * b + dn[0] * t[0] + dn[1] * t[1]
    db = dn[1] * t[0] - dn[0] * t[1] - u * a
    du = k1 + flex * dM
    dVt, dVn = C[0] * da, C[1] * db
    ddM = dVn * a + Vn * da - dVt * b - Vt * db
    dz = spin(z, u)
    x, y = spin(dz, u), spin(z, du)
    along, over = dVt - u * Vn, u * Vt + dVn
    bow = (along * t[0] - over * t[1], along * t[1] + over * t[0])
    return z, dz, (x[0] + y[0], x[1] + y[1]), dM, ddM, slope, bow, u, du, (a, b)


@inlined
def force_slopes(h: float, nL: Pair, nM: Pair, nR: Pair) -> tuple[Pair, Pair]:
    """n' at the left and right of an element whose force is the parabola through three values."""
    f = 1.0 / h
    return (
        (f * (4.0 * nM[0] - 3.0 * nL[0] - nR[0]), f * (4.0 * nM[1] - 3.0 * nL[1] - nR[1])),
        (f * (nL[0] + 3.0 * nR[0] - 4.0 * nM[0]), f * (nL[1] + 3.0 * nR[1] - 4.0 * nM[1])),
    )


@inlined
def between(x: float, a: Pair, b: Pair, c: Pair) -> Pair:
    """The parabola through a, b, c at 0, 1/2, 1."""
    f, g, k = (2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)
    return f * a[0] + g * b[0] + k * c[0], f * a[1] + g * b[1] + k * c[1]


@inlined
def apart(a: float, b: float) -> bool:
    """Whether two moments differ by more than an unfinished iteration leaves: something holds the node."""
    return (a - b) * (a - b) > 1e-6 * (a * a + b * b)


@inlined
def change(x: Node, turn: float, dM: float, flex: float, C: Pair) -> tuple[float, float, Pair]:
    """Change of u, M' and r' at a node whose frame turns by `turn` and whose moment changes by dM."""
    a, b = x[9]
    t = product(x[0], x[0])
    Vt, Vn = 1.0 + C[0] * a, C[1] * b
    da, db = turn * b, -turn * a
    dVt, dVn = C[0] * da, C[1] * db
    along, over = dVt - turn * Vn, turn * Vt + dVn
    return (
        flex * dM,
        dVn * a + Vn * da - dVt * b - Vt * db,
        (along * t[0] - over * t[1], along * t[1] + over * t[0]),
    )


@inlined
def landing(h: float, M: float, a: Node, m: Node, b: Node) -> tuple[Pair, float, Pair]:
    """z and moment at the right node, and the step in position, from the left node by Hermite-Simpson."""
    p, da, dm, db, dda, ddb = a[0], a[1], m[1], b[1], a[2], b[2]
    r, rm, s, dr, ds = a[5], m[5], b[5], a[6], b[6]
    return (
        (
            p[0] + integral(h, da[0], dm[0], db[0], dda[0], ddb[0]),
            p[1] + integral(h, da[1], dm[1], db[1], dda[1], ddb[1]),
        ),
        M + integral(h, a[3], m[3], b[3], a[4], b[4]),
        (integral(h, r[0], rm[0], s[0], dr[0], ds[0]), integral(h, r[1], rm[1], s[1], dr[1], ds[1])),
    )


@inlined
def missed(h: float, a: Node, m: Node, b: Node, flex: float, C: Pair) -> tuple[float, float, Pair]:
    """The leading error of that landing, because the middle is off the quintic: rotation, M, r."""
    da, db, dda, ddb, ddm = a[1], b[1], a[2], b[2], m[2]
    off = (astray(h, da[0], dda[0], ddm[0], db[0], ddb[0]), astray(h, da[1], dda[1], ddm[1], db[1], ddb[1]))
    dM = astray(h, a[3], a[4], m[4], b[3], b[4])
    du, ddM, dr = change(m, 2.0 * quotient(off, m[0])[1], dM, flex, C)
    x, y = spin(off, m[7]), spin(m[0], du)
    f = 8.0 * h / 15.0
    turn = quotient((x[0] + y[0], x[1] + y[1]), b[0])[1]
    return 2.0 * f * turn, f * ddM, (f * dr[0], f * dr[1])


@inlined
def as_gradient(e: int, turn: float, dM: float, dr: Pair, parts: Array) -> tuple[float, float, Pair]:
    """A defect of the landing as one of element e's gradient in theta_1, theta_2, lambda."""
    return (
        -parts[e, H12] * turn,
        dM - parts[e, H22] * turn,
        (-dr[0] - parts[e, B2] * turn, -dr[1] - parts[e, B2 + 1] * turn),
    )


@inlined
def halves(
    h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, C: Pair
) -> tuple[float, float, Pair]:  # fmt: skip
    """Gradient of two half elements in theta_1, theta_2, lambda, the rotation between them being in balance."""
    near, _ = relative(z1, z2)
    z = unit((z1[0] + near[0], z1[1] + near[1]))
    na, nb = between(0.25, nL, nM, nR), between(0.75, nL, nM, nR)
    ka, kb = k0 - 0.25 * h * k1, k0 + 0.25 * h * k1
    for _ in range(2):
        _, a2, _, _, _, A22, _, _, _ = element_hessian(0.5 * h, z1, z, nL, na, nM, ka, k1, K, C)
        b1, _, _, B11, _, _, _, _, _ = element_hessian(0.5 * h, z, z2, nM, nb, nR, kb, k1, K, C)
        z = unit(product(z, half_turn(-(a2 + b1) / (A22 + B11))))
    _, a1, _, al = element_gradient(0.5 * h, z1, z, nL, na, nM, ka, k1, K, C)
    _, _, b2, bl = element_gradient(0.5 * h, z, z2, nM, nb, nR, kb, k1, K, C)
    return a1, b2, (al[0] + bl[0], al[1] + bl[1])


@kernel(fastmath=FAST)
def defects(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, soft: float, C: Pair, rows: Array,
    parts: Array, side: Array, sums: Array,
) -> float:  # fmt: skip
    """Adds the defects of the gradient in the angles and in lambda to G of rows and to the closure in sums.

    `side` takes each element's of lambda and the moments, with the defect, at its right and at the first one's left.
    What the rule itself misses goes into G1 and MISSED of parts, in theta and lambda; what it misses at the last node
    is returned. soft: the smaller bending stiffness.
    """
    elements = h.shape[0]
    flex = 1.0 / K
    left = missing = s0 = s1 = 0.0
    b, moment = NO_NODE, 0.0
    stale = True  # b is not the node left of the next element
    for e in range(elements):
        nL, nM, nR = forces(load, e, lam)
        k0, k1 = rest[e, 0], rest[e, 1]
        z1, z2 = (z[e, 0], z[e, 1]), (z[e + 1, 0], z[e + 1, 1])
        gl, g1, g2 = (parts[e, GL], parts[e, GL + 1]), parts[e, G1], parts[e, G2]
        if h[e] * h[e] * math.sqrt(nM[0] * nM[0] + nM[1] * nM[1]) > STIFF * soft:
            a1, a2, al = halves(h[e], z1, z2, nL, nM, nR, k0, k1, K, C)
            f = 16.0 / 15.0
            d1, d2, dl = f * (a1 - g1), f * (a2 - g2), (f * (al[0] - gl[0]), f * (al[1] - gl[1]))
            e1, e2, el = COARSE * d1, COARSE * d2, (COARSE * dl[0], COARSE * dl[1])
            stale = True
        else:
            dnL, dnR = force_slopes(h[e], nL, nM, nR)
            if stale or k1 != 0.0 or jumps(load, e) or apart(moment, -g1):
                b = at_node(z1, -g1, nL, dnL, k0 - 0.5 * h[e] * k1, k1, flex, C)
                moment = -g1
            else:
                z1 = b[0]
            a, Ma, stale = b, moment, False
            z2, _ = relative(z1, z2)
            b = at_node(z2, g2, nR, dnR, k0 + 0.5 * h[e] * k1, k1, flex, C)
            moment = g2
            Mm = middle(h[e], Ma, a[3], a[4], g2, b[3], b[4])
            zm = unit((
                middle(h[e], z1[0], a[1][0], a[2][0], z2[0], b[1][0], b[2][0]),
                middle(h[e], z1[1], a[1][1], a[2][1], z2[1], b[1][1], b[2][1]),
            ))  # fmt: skip
            dnM = ((nR[0] - nL[0]) / h[e], (nR[1] - nL[1]) / h[e])
            m = at_node(zm, Mm, nM, dnM, k0, k1, flex, C)
            p, M, r = landing(h[e], Ma, a, m, b)
            miss = quotient(p, z2)
            turn = 2.0 * miss[1] / miss[0]
            dM, dr = M - g2, (r[0] + gl[0], r[1] + gl[1])
            # the rule sees the right node where it is, half of h f_y times the defect away from where it should be
            du, ddM, ddr = change(b, turn, dM, flex, C)
            f = 0.5 * h[e]
            turn, dM, dr = turn + f * du, dM + f * ddM, (dr[0] + f * ddr[0], dr[1] + f * ddr[1])
            d1, d2, dl = as_gradient(e, turn, dM, dr, parts)
            d1 -= Ma + g1  # what is missing to balance at the left node
            turn, dM, dr = missed(h[e], a, m, b, flex, C)
            e1, e2, el = as_gradient(e, turn, dM, dr, parts)
        rows[e, G] += left + d1
        side[e, 0], side[e, 1] = dl
        if e == 0:
            side[0, 2] = -g1 - d1
        side[e, 3] = g2 + d2
        parts[e, G1] = missing + e1
        parts[e, MISSED], parts[e, MISSED + 1] = el
        left, missing = d2, e2
        s0, s1 = s0 + dl[0], s1 + dl[1]
    rows[elements, G] += left
    sums[9], sums[10] = sums[9] + s0, sums[10] + s1
    return missing


@inlined
def step_change(parts: Array, e: int, d1: float, d2: float, l0: float, l1: float) -> Pair:
    """Minus the change of element e's step in position, under rotations of its nodes and a change of lambda."""
    return (
        parts[e, B1] * d1 + parts[e, B2] * d2 + parts[e, CC] * l0 + parts[e, CC + 1] * l1,
        parts[e, B1 + 1] * d1 + parts[e, B2 + 1] * d2 + parts[e, CC + 1] * l0 + parts[e, CC + 2] * l1,
    )


@kernel(fastmath=FAST)
def correct(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, soft: float, C: Pair, stiffest: float,
    held: bool, rows: Array, parts: Array, side: Array, sums: Array, errors: Array, better: Array,
) -> tuple[Pair, float, float]:  # fmt: skip
    """The solution at hand without its discretisation error, to first order in it; see `rod_defect.correct`.

    better (N+1, 2) takes z, `side` the moments, GL of parts minus the steps in position; returns lambda, the largest
    error in position [m] that is taken off, and the largest that is left; infinite if they cannot be judged.
    """
    elements = h.shape[0]
    last = elements - 1 if held else elements
    missing = defects(z, lam, h, load, rest, K, soft, C, rows, parts, side, sums)
    l0, l1 = respond(last, held, rows, parts, sums)
    lam = (lam[0] + l0, lam[1] + l1)
    largest = r0 = r1 = c0 = c1 = 0.0
    side[0, 2] -= parts[0, H12] * rows[1, CHANGE] + parts[0, B1] * l0 + parts[0, B1 + 1] * l1
    for e in range(elements):
        d1, d2 = rows[e, CHANGE], rows[e + 1, CHANGE]
        p, q = step_change(parts, e, d1, d2, l0, l1)
        p, q = p + side[e, 0], q + side[e, 1]
        parts[e, GL] += p
        parts[e, GL + 1] += q
        r0, r1 = r0 + p, r1 + q
        largest = max(largest, r0 * r0 + r1 * r1)
        M = side[e, 3] + parts[e, H12] * d1 + parts[e, H22] * d2 + parts[e, B2] * l0 + parts[e, B2 + 1] * l1
        side[e, 3] = M
        if e < elements - 1:
            side[e + 1, 2] = M
        rows[e, G] = parts[e, G1]
        c0, c1 = c0 + parts[e, MISSED], c1 + parts[e, MISSED + 1]
    rows[elements, G] = missing
    sums[9], sums[10] = c0, c1
    for k in range(elements + 1):
        x = (z[k, 0], z[k, 1])
        turn = spin(x, rows[k, CHANGE])
        better[k, 0], better[k, 1] = unit((x[0] + turn[0], x[1] + turn[1]))
    l0, l1 = respond(last, held, rows, parts, sums)
    left = r0 = r1 = 0.0
    for e in range(elements):
        p, q = step_change(parts, e, rows[e, CHANGE], rows[e + 1, CHANGE], l0, l1)
        a, b = parts[e, MISSED], parts[e, MISSED + 1]
        errors[e] = math.sqrt(a * a + b * b) + h[e] * h[e] * abs(parts[e, G1]) / stiffest
        r0, r1 = r0 + p + a, r1 + q + b
        left = max(left, r0 * r0 + r1 * r1)
    if not math.isfinite(largest) or not math.isfinite(left):
        return lam, math.inf, math.inf
    return lam, math.sqrt(largest), math.sqrt(left)
