"""Between two nodes: what the rod's equations say about the derivatives there, and quintics through them.

A solution's rotation, moment and position at two nodes, with their first and second derivatives from the differential
equations, fix a quintic each. Its rate in mid-element, beside the equations' own, gives the integral of the rate over
the element to sixth order (Hermite-Simpson):

    y1 - y0 = h/30 (7 y0' + 16 ym' + 7 y1') + h^2/60 (y0'' - y1'') + O(h^7).
"""

from __future__ import annotations

from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    add,
    apply,
    cross,
    dot,
    inlined,
    qconj,
    qmul,
    rotation,
    scale,
    subtract,
    tapply,
    times,
)
from cable_shape.kernels.rod_element import E3

#: q, M, then their first and second derivatives, r', r'', u, u'
Node = tuple[Quaternion, Vector, Quaternion, Quaternion, Vector, Vector, Vector, Vector, Vector, Vector]
#: rotation, moment, step in position
Slope = tuple[Quaternion, Vector, Vector]


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
def spin(q: Quaternion, u: Vector) -> Quaternion:
    """1/2 q u, the rate of a quaternion that turns at u (its own frame)."""
    return qmul(q, (0.5 * u[0], 0.5 * u[1], 0.5 * u[2], 0.0))


@inlined
def flexibility(K: Vector, K1: Vector, x: float) -> tuple[Vector, Vector]:
    """1 / stiffness and its derivative, a distance x [m] from where the stiffness is K and has the slope K1."""
    f = (1.0 / (K[0] + x * K1[0]), 1.0 / (K[1] + x * K1[1]), 1.0 / (K[2] + x * K1[2]))
    return f, (-K1[0] * f[0] * f[0], -K1[1] * f[1] * f[1], -K1[2] * f[2] * f[2])


@inlined
def at_node(
    q: Quaternion, M: Vector, n: Vector, dn: Vector, u0: Vector, k1: Vector, flex: Vector, dflex: Vector, C: Vector
) -> Node:  # fmt: skip
    """All that the equations say at a node.

    n, dn: force [N] and its derivative; u0, k1: rest curvature and its; flex, dflex: 1 / stiffness and its.
    """
    R = rotation(q)
    u = add(u0, times(flex, M))
    N = tapply(R, n)
    V = add(E3, times(C, N))
    dM = subtract(cross(M, u), cross(V, N))
    dN = add(cross(N, u), tapply(R, dn))
    du = add(k1, add(times(flex, dM), times(dflex, M)))
    dV = times(C, dN)
    ddM = subtract(add(cross(dM, u), cross(M, du)), add(cross(dV, N), cross(V, dN)))
    dq = spin(q, u)
    a, b = spin(dq, u), spin(q, du)
    ddq = (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])
    return q, M, dq, ddq, dM, ddM, apply(R, V), apply(R, add(cross(u, V), dV)), u, du


@inlined
def apart(a: Vector, b: Vector) -> bool:
    """Whether two moments differ by more than an unfinished iteration leaves: something holds the node."""
    d = (a[0] - b[0], a[1] - b[1], a[2] - b[2])
    return dot(d, d) > 1e-6 * (dot(a, a) + dot(b, b))


@inlined
def force_slopes(h: float, nL: Vector, nM: Vector, nR: Vector) -> tuple[Vector, Vector]:
    """n' at the left and right of an element whose force is the parabola through three values."""
    f = 1.0 / h
    return (
        scale(f, add(scale(-3.0, nL), subtract(scale(4.0, nM), nR))),
        scale(f, add(nL, subtract(scale(3.0, nR), scale(4.0, nM)))),
    )


@inlined
def middle(h: float, a: float, da: float, dda: float, b: float, db: float, ddb: float) -> float:
    """The quintic's value in the middle."""
    return 0.5 * (a + b) + 0.15625 * h * (da - db) + 0.015625 * h * h * (dda + ddb)


@inlined
def middle3(h: float, a: Vector, da: Vector, dda: Vector, b: Vector, db: Vector, ddb: Vector) -> Vector:
    """The same of a vector."""
    return (
        middle(h, a[0], da[0], dda[0], b[0], db[0], ddb[0]),
        middle(h, a[1], da[1], dda[1], b[1], db[1], ddb[1]),
        middle(h, a[2], da[2], dda[2], b[2], db[2], ddb[2]),
    )


@inlined
def integral(h: float, da: float, dm: float, db: float, dda: float, ddb: float) -> float:
    """Hermite-Simpson."""
    return h / 30.0 * (7.0 * (da + db) + 16.0 * dm) + h * h / 60.0 * (dda - ddb)


@inlined
def integral3(h: float, da: Vector, dm: Vector, db: Vector, dda: Vector, ddb: Vector) -> Vector:
    """The same of a vector."""
    return (
        integral(h, da[0], dm[0], db[0], dda[0], ddb[0]),
        integral(h, da[1], dm[1], db[1], dda[1], ddb[1]),
        integral(h, da[2], dm[2], db[2], dda[2], ddb[2]),
    )


@inlined
def middle4(h: float, a: Node, b: Node) -> Quaternion:
    """The same of the rotation; not normalised."""
    p, dp, ddp = a[0], a[2], a[3]
    q, dq, ddq = b[0], b[2], b[3]
    return (
        middle(h, p[0], dp[0], ddp[0], q[0], dq[0], ddq[0]),
        middle(h, p[1], dp[1], ddp[1], q[1], dq[1], ddq[1]),
        middle(h, p[2], dp[2], ddp[2], q[2], dq[2], ddq[2]),
        middle(h, p[3], dp[3], ddp[3], q[3], dq[3], ddq[3]),
    )


@inlined
def astray(h: float, da: float, dda: float, ddm: float, db: float, ddb: float) -> float:
    """How far the true value in the middle is from the quintic's, judged by its second derivative there."""
    return (1.5 * h * (db - da) - h * h * (0.25 * (dda + ddb) + ddm)) / 24.0


@inlined
def astray3(h: float, da: Vector, dda: Vector, ddm: Vector, db: Vector, ddb: Vector) -> Vector:
    """The same of a vector."""
    return (
        astray(h, da[0], dda[0], ddm[0], db[0], ddb[0]),
        astray(h, da[1], dda[1], ddm[1], db[1], ddb[1]),
        astray(h, da[2], dda[2], ddm[2], db[2], ddb[2]),
    )


@inlined
def landing(h: float, a: Node, m: Node, b: Node) -> Slope:
    """Rotation and moment at the right node, and the step in position, from the left node by Hermite-Simpson."""
    p, da, dm, db, dda, ddb = a[0], a[2], m[2], b[2], a[3], b[3]
    return (
        (
            p[0] + integral(h, da[0], dm[0], db[0], dda[0], ddb[0]),
            p[1] + integral(h, da[1], dm[1], db[1], dda[1], ddb[1]),
            p[2] + integral(h, da[2], dm[2], db[2], dda[2], ddb[2]),
            p[3] + integral(h, da[3], dm[3], db[3], dda[3], ddb[3]),
        ),
        add(a[1], integral3(h, a[4], m[4], b[4], a[5], b[5])),
        integral3(h, a[6], m[6], b[6], a[7], b[7]),
    )


@inlined
def change(
    x: Node, n: Vector, turn: Vector, dM: Vector, flex: Vector, C: Vector
) -> tuple[Vector, Vector, Vector]:  # fmt: skip
    """Change of u, M' and r' at a node whose frame turns by `turn` (its own frame) and whose moment changes by dM."""
    R = rotation(x[0])
    N = tapply(R, n)
    V = add(E3, times(C, N))
    du = times(flex, dM)
    dN = cross(N, turn)
    dV = times(C, dN)
    return (
        du,
        subtract(add(cross(dM, x[8]), cross(x[1], du)), add(cross(dV, N), cross(V, dN))),
        apply(R, add(cross(turn, V), dV)),
    )


@inlined
def missed(h: float, a: Node, m: Node, b: Node, n: Vector, flex: Vector, C: Vector) -> tuple[Vector, Vector, Vector]:
    """The leading error of that landing, because the middle is off the quintic: rotation (frame of b), M, r."""
    da, db, dda, ddb, ddm = a[2], b[2], a[3], b[3], m[3]
    off = (
        astray(h, da[0], dda[0], ddm[0], db[0], ddb[0]),
        astray(h, da[1], dda[1], ddm[1], db[1], ddb[1]),
        astray(h, da[2], dda[2], ddm[2], db[2], ddb[2]),
        astray(h, da[3], dda[3], ddm[3], db[3], ddb[3]),
    )
    dM = astray3(h, a[4], a[5], m[5], b[4], b[5])
    w = qmul(qconj(m[0]), off)
    du, ddM, dr = change(m, n, (2.0 * w[0], 2.0 * w[1], 2.0 * w[2]), dM, flex, C)
    x, y = spin(off, m[8]), spin(m[0], du)
    f = 8.0 * h / 15.0
    w = qmul(qconj(b[0]), (x[0] + y[0], x[1] + y[1], x[2] + y[2], x[3] + y[3]))
    return scale(2.0 * f, (w[0], w[1], w[2])), scale(f, ddM), scale(f, dr)
