"""Between two nodes of the planar rod: what the equations say there; see :mod:`cable_shape.kernels.rod_between`."""

from __future__ import annotations

from cable_shape.kernels.planar_element import Pair, product, quotient, section
from cable_shape.kernels.rod_algebra import inlined
from cable_shape.kernels.rod_between import astray, integral

#: z, its first and second derivative, M', M'', r', r'', u, u', N (along t and nu)
Node = tuple[Pair, Pair, Pair, float, float, Pair, Pair, float, float, Pair]


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
