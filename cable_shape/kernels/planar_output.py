"""The planar solution at any points of the world: :mod:`cable_shape.kernels.rod_output` in a plane."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_defect import NO_NODE, apart, at_node, force_slopes, spin
from cable_shape.kernels.planar_element import Pair, product, section, unit
from cable_shape.kernels.planar_system import GL, forces, jumps
from cable_shape.kernels.rod_algebra import FAST, Quaternion, Vector, add, inlined, scale
from cable_shape.kernels.rod_between import integral
from cable_shape.kernels.rod_curve import Curve, Layer, at, curve, functions, layers, middle_slope
from cable_shape.kernels.rod_output import INTERPOLATION

Array = Any


@inlined
def curves(h: float, a: Pair, da: Pair, dda: Pair, b: Pair, db: Pair, ddb: Pair, layer: Layer) -> tuple[Curve, Curve]:
    """`rod_curve.curve` of two numbers."""
    return (
        curve(h, a[0], da[0], dda[0], b[0], db[0], ddb[0], layer),
        curve(h, a[1], da[1], dda[1], b[1], db[1], ddb[1], layer),
    )


@kernel(fastmath=FAST)
def sample(
    z: Array, lam: Pair, side: Array, parts: Array, s: Array, h: Array, load: Array, rest: Array, K: float, soft: float,
    C: Pair, weight: Pair, start: Vector, e1: Vector, e2: Vector, normal: Vector, local: Vector, q0: Quaternion,
    points: int, out: Array, totals: Array,
) -> None:  # fmt: skip
    """Fills `out` (17 points) and totals (4,) as `rod_output.sample` does.

    A point of the plane is start + x e1 + y e2, and the frame's quaternion is q0 (local sin, cos) of half the angle.
    normal: of the plane, world; local: the same in the cable frame. weight [N/m]: in the plane; heights count from the
    start. side: the moments in its last two columns; parts: minus the steps in position in GL.
    """
    elements = h.shape[0]
    flex, softness = 1.0 / K, 1.0 / soft
    # q0 (local, 0), to which the sine belongs
    q1 = (
        q0[3] * local[0] + q0[1] * local[2] - q0[2] * local[1],
        q0[3] * local[1] + q0[2] * local[0] - q0[0] * local[2],
        q0[3] * local[2] + q0[0] * local[1] - q0[1] * local[0],
        -q0[0] * local[0] - q0[1] * local[1] - q0[2] * local[2],
    )
    r = (0.0, 0.0)
    dx = s[elements] / (points - 1)
    o1, o2, o3, o4, o5 = points, 4 * points, 8 * points, 11 * points, 14 * points
    i = 0
    b, moment = NO_NODE, 0.0
    work = gap = off_M = off_q = 0.0
    bent = 1e-3 * soft / s[elements]
    sign = 1.0
    for e in range(elements):
        he = h[e]
        nL, nM, nR = forces(load, e, lam)
        k0, k1 = rest[e, 0], rest[e, 1]
        za, Ma, Mb = (sign * z[e, 0], sign * z[e, 1]), side[e, 2], side[e, 3]
        sign = -1.0 if za[0] * z[e + 1, 0] + za[1] * z[e + 1, 1] < 0.0 else 1.0
        zb = (sign * z[e + 1, 0], sign * z[e + 1, 1])
        rb = (r[0] - parts[e, GL], r[1] - parts[e, GL + 1])
        f = 1.0 / he
        dnL, dnR = force_slopes(he, nL, nM, nR)
        if e == 0 or k1 != 0.0 or jumps(load, e) or apart(moment, Ma):
            b = at_node(za, Ma, nL, dnL, k0 - 0.5 * he * k1, k1, flex, C)
        a = b
        b = at_node(zb, Mb, nR, dnR, k0 + 0.5 * he * k1, k1, flex, C)
        moment = Mb
        layer = layers(he * math.sqrt(softness * math.sqrt(nM[0] * nM[0] + nM[1] * nM[1])))
        rs = curves(he, r, a[5], a[6], rb, b[5], b[6], layer)
        zs = curves(he, za, a[1], a[2], zb, b[1], b[2], layer)
        Ms = curve(he, Ma, a[3], a[4], Mb, b[3], b[4], layer)
        # in mid-element the equations and the interpolation's own rates are two things
        f1, f2 = functions(0.5, layer)
        rm, Mm = (at(rs[0], 0.5, f1, f2), at(rs[1], 0.5, f1, f2)), at(Ms, 0.5, f1, f2)
        zm = unit((at(zs[0], 0.5, f1, f2), at(zs[1], 0.5, f1, f2)))
        um = k0 + flex * Mm
        am, bm, slope = section(product(zm, zm), nM, C)
        x, y = he * slope[0] - middle_slope(rs[0], layer), he * slope[1] - middle_slope(rs[1], layer)
        gap = max(gap, x * x + y * y)
        torque = bm * (1.0 + (C[0] - C[1]) * am)
        bent = max(bent, abs(Mm))
        off_M = max(off_M, abs(he * torque + middle_slope(Ms, layer)))
        dz = spin(zm, um)
        x, y = he * dz[0] - middle_slope(zs[0], layer), he * dz[1] - middle_slope(zs[1], layer)
        off_q = max(off_q, x * x + y * y)
        # elastic energy of bending, of stretch and shear (Simpson), and potential energy
        work += 0.5 * flex * integral(he, Ma * Ma, Mm * Mm, Mb * Mb, 2.0 * Ma * a[3], 2.0 * Mb * b[3])
        if C[0] != 0.0 or C[1] != 0.0:
            work += he / 12.0 * (strain(a[9], C) + 4.0 * strain((am, bm), C) + strain(b[9], C))
        work -= integral(
            he, lift(weight, r), lift(weight, rm), lift(weight, rb), lift(weight, a[5]), lift(weight, b[5])
        )
        next_i = points if e == elements - 1 else min(points, math.ceil(s[e + 1] / dx - 1e-9))
        n0, n1, n2 = world(nL, e1, e2), world(nM, e1, e2), world(nR, e1, e2)
        for j in range(i, next_i):
            x = (j * dx - s[e]) * f
            out[j] = j * dx
            f1, f2 = functions(x, layer)
            u, v = at(rs[0], x, f1, f2), at(rs[1], x, f1, f2)
            c, d = at(zs[0], x, f1, f2), at(zs[1], x, f1, f2)
            size = c * c + d * d
            g = 1.5 - 0.5 * size if abs(size - 1.0) < 1e-8 else 1.0 / math.sqrt(size)
            c, d = g * c, g * d
            M = at(Ms, x, f1, f2)
            k = k0 + he * (x - 0.5) * k1 + flex * M
            p0, p1, p2 = (2.0 * x - 1.0) * (x - 1.0), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)
            put3(out, o1 + 3 * j, add(start, world((u, v), e1, e2)))
            put3(out, o3 + 3 * j, scale(k, local))
            put3(out, o4 + 3 * j, add(add(scale(p0, n0), scale(p1, n1)), scale(p2, n2)))
            put3(out, o5 + 3 * j, scale(M, normal))
            for axis in range(4):
                out[o2 + 4 * j + axis] = c * q0[axis] + d * q1[axis]
        i = max(i, next_i)
        r = rb
    totals[0], totals[1], totals[2] = work, 0.0, INTERPOLATION * math.sqrt(gap)
    totals[3] = max(2.0 * math.sqrt(off_q), off_M / bent, math.sqrt(gap) / s[elements])


@inlined
def put3(out: Array, i: int, a: Vector) -> None:
    """Writes three numbers from place i on."""
    out[i], out[i + 1], out[i + 2] = a


@inlined
def strain(N: Pair, C: Pair) -> float:
    """N . C N."""
    return C[0] * N[0] * N[0] + C[1] * N[1] * N[1]


@inlined
def lift(weight: Pair, r: Pair) -> float:
    """weight . r."""
    return weight[0] * r[0] + weight[1] * r[1]


@inlined
def world(a: Pair, e1: Vector, e2: Vector) -> Vector:
    """A vector in the plane as one of the world."""
    return a[0] * e1[0] + a[1] * e2[0], a[0] * e1[1] + a[1] * e2[1], a[0] * e1[2] + a[1] * e2[2]
