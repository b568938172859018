"""One element of the rod: energy, gradient and exact Hessian in its two end rotations and the force multiplier.

Between two nodes the frame turns at a constant Darboux vector k. With the internal force n known but for the constant
lambda, the element's part of the stationary functional is

    h/2 (k - k0).K(k - k0) - h/6 (psi_left + 4 psi_mid + psi_right) - h^3/24 g.W g,
    psi = N.e3 + 1/2 N.C N,  N = R^T n,  C = diag(1/GA, 1/GA, 1/EA),
    g = k x m + V x N + K' (k - k0) - K k0',  m = K (k - k0),  V = e3 + C N  at the midpoint,
    W = (K + h^2/10 |n| diag(1, 1, 0))^-1.

The last term is the energy that the true, varying Darboux vector saves: the minimum over a parabolic rotation between
the nodes, whose load is the body moment imbalance g. K and k0 may change linearly along the element. It makes the
element fourth order in h; the |n| in W keeps it bounded where h exceeds the boundary layer sqrt(EI/|n|). Minus the
derivative in lambda is the step in position.

With `swings`, of what has mass, tension holds the bow and compression lets it go: g^2 / (K + h^2/10 |n|) is, of
either direction across,

    2 / b^2 (sqrt(A^2 + b^2 g^2) - A),   A = K + h^2/10 N3,   b = 4 h^2/10,

g^2 / A where that is stiff, and 4 |A| / b^2 in an element that buckles, which is then shorter by a tenth at most. It is
convex in g and N3 together: a force more makes a step longer, never shorter, as a mass on it must have it. The |n|
above does not, across n. Under the root is

    D = (CROOKED K)^2 / (1 + (A / NARROW K)^2)^4

too: what nothing bends in a direction would buckle all at once, by any way under one force. It makes an element shorter
by 5e-8 where N3 = 0.

Rotations are perturbed from the right, R exp(delta).
"""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    columns_times,
    cross,
    diagonal,
    dot,
    hat,
    hat_mul,
    inlined,
    madd,
    mscale,
    mshift,
    msub,
    mul,
    mul_hat,
    outer,
    qconj,
    qmul,
    rotation,
    rows_times,
    scale,
    subtract,
    symmetric,
    tapply,
    times,
    tmul,
    transpose,
)

Pair = tuple[float, float]

E3 = (0.0, 0.0, 1.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
CROOKED, NARROW = 0.03, 0.35  # see above
_LEAST = CROOKED**2 / (1.0 + NARROW**-2) ** 4
BENT = _LEAST / (1.0 + math.sqrt(1.0 + _LEAST))  # sqrt(1 + D / K^2) - 1 where A = K
SMALL_FORCE = 1e-60  # N^2, keeps |n| differentiable at n = 0


@inlined
def angle_series(x: float, w: float) -> tuple[float, float, float]:
    """F(x) = 2 asin(sqrt x)/sqrt x and its first two derivatives; w = sqrt(1 - x)."""
    if x < 0.03:
        f2 = 0.3 + x * (
            15.0 / 28.0
            + x * (35.0 / 48.0 + x * (315.0 / 352.0 + x * (3465.0 / 3328.0 + x * (3003.0 / 2560.0 + x * 1.293802))))
        )
        f1 = (0.5 / (w * w * w) - x * f2) / 1.5
        return 2.0 / w - 2.0 * x * f1, f1, f2
    root = math.sqrt(x)
    f = 2.0 * math.atan2(root, w) / root
    f1 = (1.0 / w - 0.5 * f) / x
    return f, f1, (0.5 / (w * w * w) - 1.5 * f1) / x


@inlined
def relative(q1: Quaternion, q2: Quaternion) -> tuple[Vector, float]:
    """Vector and scalar part of conj(q1) q2, the scalar part made non-negative."""
    p = qmul(qconj(q1), q2)
    if p[3] < 0.0:
        return (-p[0], -p[1], -p[2]), -p[3]
    return (p[0], p[1], p[2]), p[3]


@inlined
def midpoint(q1: Quaternion, v: Vector, w: float) -> Matrix:
    """The rotation halfway along the element, as a matrix."""
    f = 1.0 / math.sqrt(2.0 * (1.0 + w))
    return rotation(qmul(q1, (f * v[0], f * v[1], f * v[2], f * (1.0 + w))))


@inlined
def section_force(q: Quaternion, n: Vector) -> tuple[Matrix, Vector]:
    """R and N = R^T n."""
    R = rotation(q)
    return R, tapply(R, n)


@inlined
def bowed(h: float) -> float:
    """b [m^2], of what swings."""
    return 4.0 * 0.1 * h * h


@inlined
def firmness(h: float, K: Vector, g: Vector, N: Vector, firmer: Pair) -> tuple[float, float, float, float]:
    """[N m^2], of what swings: A and sqrt(A^2 + b^2 g^2 + D) in both directions across."""
    slope = 0.1 * h * h
    b, A, B = bowed(h), K[0] + slope * N[2] + firmer[0], K[1] + slope * N[2] + firmer[1]
    a, c = b * g[0], b * g[1]
    return (
        A,
        B,
        math.sqrt(A * A + a * a + crooked(A, K[0])[0]),
        math.sqrt(B * B + c * c + crooked(B, K[1])[0]),
    )


@inlined
def crooked(A: float, K: float) -> Vector:
    """D, and its first and second derivative in A."""
    x = A / (NARROW * K)
    r = 1.0 / (1.0 + x * x)
    most, r4 = CROOKED * CROOKED, r * r * r * r
    first, second = -8.0 * x * r4 * r / NARROW, (80.0 * x * x * r - 8.0) * r4 * r / (NARROW * NARROW)
    return (most * K * K * r4, most * K * first, most * second)


@inlined
def bowing(h: float, g: float, A: float, K: float, s: float) -> tuple[float, float]:
    """(s - A) / b^2, half of what stands for g^2 / A, and minus its derivative in A."""
    b = bowed(h)
    D, D1, _ = crooked(A, K)
    value = (g * g + D / (b * b)) / (s + abs(A)) + 2.0 * max(-A, 0.0) / (b * b)
    return value, (value - 0.5 * D1 / (b * b)) / s


@inlined
def bending(h: float, g: float, A: float, K: float, s: float, c: float) -> Vector:
    """c times its second derivatives: in A twice, in A and g, and in g twice."""
    b, cube = bowed(h), c / (s * s * s)
    D, D1, D2 = crooked(A, K)
    twice = g * g + (D + 0.5 * D2 * s * s - A * D1 - 0.25 * D1 * D1) / (b * b)
    return (cube * twice, -cube * (A + 0.5 * D1) * g, cube * (A * A + D))


@kernel(fastmath=FAST)
def element_gradient(
    h: float, q1: Quaternion, q2: Quaternion, nL: Vector, nM: Vector, nR: Vector,
    k0: Vector, k1: Vector, K: Vector, C: Vector, K1: Vector, firmer: Pair, swings: bool | None,
) -> tuple[float, Vector, Vector, Vector]:  # fmt: skip
    """Value, and gradient in delta_1, delta_2, lambda.

    h [m]; q1, q2 node quaternions; nL, nM, nR [N] world force at the left, middle and right; k0, k1 [1/m, 1/m^2] rest
    curvature at the middle and its slope; K, C stiffness and compliance at the middle; K1 slope of the stiffness.
    swings: True, of what has mass; None at rest. Numba leaves out branches that are not for None. firmer [N m^2]: of
    what swings, what A is more than K + h^2/10 N3 in both directions across.
    """
    v, w = relative(q1, q2)
    return gradient_of(v, w, angle_series(dot(v, v), w), h, q1, q2, nL, nM, nR, k0, k1, K, C, K1, firmer, swings)


@inlined
def gradient_of(
    v: Vector, w: float, series: Vector, h: float, q1: Quaternion, q2: Quaternion, nL: Vector, nM: Vector, nR: Vector,
    k0: Vector, k1: Vector, K: Vector, C: Vector, K1: Vector, firmer: Pair, swings: bool | None,
) -> tuple[float, Vector, Vector, Vector]:  # fmt: skip
    """The same from the `relative` rotation and its `angle_series`, without a branch."""
    f, f1, _ = series
    k = scale(f / h, v)
    bent = subtract(k, k0)
    m = times(K, bent)
    RL, NL = section_force(q1, nL)
    RR, NR = section_force(q2, nR)
    RM = midpoint(q1, v, w)
    N = tapply(RM, nM)
    V = add(E3, times(C, N))
    g = add(subtract(add(cross(k, m), cross(V, N)), times(K, k1)), times(K1, bent))
    size = math.sqrt(dot(nM, nM) + SMALL_FORCE)
    stiff = 0.1 * h * h * size
    c = -h * h * h / 12.0
    y = (c * g[0] / (K[0] + stiff), c * g[1] / (K[1] + stiff), c * g[2] / K[2])
    if swings is not None:
        A, B, sA, sB = firmness(h, K, g, N, firmer)
        y = (c * g[0] / sA, c * g[1] / sB, y[2])
    VL = add(E3, times(C, NL))
    VR = add(E3, times(C, NR))
    value = (
        0.5 * h * dot(m, bent)
        - h / 12.0 * (dot(NL, add(E3, VL)) + 4.0 * dot(N, add(E3, V)) + dot(NR, add(E3, VR)))
        + 0.5 * dot(y, g)
        + c * dot(k1, subtract(times(K1, bent), scale(0.5, times(K, k1))))
    )
    gk = add(scale(h, m), add(cross(m, y), times(K, cross(y, k))))
    gk = add(gk, times(K1, add(y, scale(c, k1))))
    gN = add(scale(-2.0 / 3.0 * h, V), add(cross(y, V), times(C, cross(N, y))))
    if swings is not None:
        (bowA, backA), (bowB, backB) = bowing(h, g[0], A, K[0], sA), bowing(h, g[1], B, K[1], sB)
        value += c * (bowA + bowB - BENT * (K[0] + K[1]) / bowed(h) ** 2) - 0.5 * (y[0] * g[0] + y[1] * g[1])
        gN = (gN[0], gN[1], gN[2] - 0.1 * h * h * c * (backA + backB))
    gL, gR = scale(-h / 6.0, VL), scale(-h / 6.0, VR)
    Mv = scale(1.0 / h, add(scale(f, gk), scale(2.0 * f1 * dot(v, gk), v)))
    torque = cross(gN, N)
    t = scale(1.0 / (1.0 + w), v)
    twist = cross(t, torque)
    spin = cross(v, Mv)
    g1 = add(scale(0.5, subtract(subtract(add(torque, twist), scale(w, Mv)), spin)), cross(gL, NL))
    g2 = add(scale(0.5, add(subtract(torque, twist), subtract(scale(w, Mv), spin))), cross(gR, NR))
    if swings is None:
        # the limiter's own derivative, dE/d|n| / |n|
        y0, y1 = g[0] / (K[0] + stiff), g[1] / (K[1] + stiff)
        e = -0.05 * h * h * c * (y0 * y0 + y1 * y1) / size
        gl = add(add(apply(RM, gN), scale(e, nM)), add(apply(RL, gL), apply(RR, gR)))
    else:
        gl = add(apply(RM, gN), add(apply(RL, gL), apply(RR, gR)))
    return value, g1, g2, gl


@kernel(fastmath=FAST)
def element_hessian(
    h: float, q1: Quaternion, q2: Quaternion, nL: Vector, nM: Vector, nR: Vector,
    k0: Vector, k1: Vector, K: Vector, C: Vector, K1: Vector, firmer: Pair, swings: bool | None,
) -> tuple[Vector, Vector, Vector, Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]:  # fmt: skip
    """Gradient and Hessian: g1, g2, gl, H11, H12, H22, B1 = H1l, B2 = H2l, CC = Hll; arguments as above."""
    v, w = relative(q1, q2)
    elastic = C[0] != 0.0 or C[2] != 0.0
    return hessian_of(
        v, w, angle_series(dot(v, v), w), elastic, h, q1, q2, nL, nM, nR, k0, k1, K, C, K1, firmer, swings
    )


@inlined
def hessian_of(
    v: Vector, w: float, series: Vector, elastic: bool, h: float, q1: Quaternion, q2: Quaternion, nL: Vector,
    nM: Vector, nR: Vector, k0: Vector, k1: Vector, K: Vector, C: Vector, K1: Vector, firmer: Pair, swings: bool | None,
) -> tuple[Vector, Vector, Vector, Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]:  # fmt: skip
    """The same from the `relative` rotation and its `angle_series`; without a branch but for C above 0: `elastic`.

    Exact: the quadratic terms of k, of the rotations at the nodes and of the midpoint rotation in delta_1, delta_2 are
    all there. To second order the midpoint turns by theta + t (|d1|^2 - |d2|^2)/8 + theta t.(d2 - d1)/4 with
    theta = (d1 + d2)/2 + t x (d2 - d1)/2, t = v / (1 + w).
    """
    f, f1, f2 = series
    k = scale(f / h, v)
    bent = subtract(k, k0)
    m = times(K, bent)
    RL, NL = section_force(q1, nL)
    RR, NR = section_force(q2, nR)
    RM = midpoint(q1, v, w)
    N = tapply(RM, nM)
    V = add(E3, times(C, N))
    g = add(subtract(add(cross(k, m), cross(V, N)), times(K, k1)), times(K1, bent))
    size = math.sqrt(dot(nM, nM) + SMALL_FORCE)
    direction = scale(1.0 / size, nM)
    slope = 0.1 * h * h
    c = -h * h * h / 12.0
    W = (1.0 / (K[0] + slope * size), 1.0 / (K[1] + slope * size), 1.0 / K[2])
    a = times(W, g)
    y = scale(c, a)
    if swings is not None:
        A, B, sA, sB = firmness(h, K, g, N, firmer)
        y = (c * g[0] / sA, c * g[1] / sB, y[2])
    VL = add(E3, times(C, NL))
    VR = add(E3, times(C, NR))
    # first derivatives in k, in N at the midpoint and at the ends
    gk = add(scale(h, m), add(cross(m, y), times(K, cross(y, k))))
    gk = add(gk, times(K1, add(y, scale(c, k1))))
    gN = add(scale(-2.0 / 3.0 * h, V), add(cross(y, V), times(C, cross(N, y))))
    gL, gR = scale(-h / 6.0, VL), scale(-h / 6.0, VR)
    e = -0.5 * slope * c * (a[0] * a[0] + a[1] * a[1])  # dE/d|n|
    ee = slope * slope * c * (W[0] * a[0] * a[0] + W[1] * a[1] * a[1])  # d2E/d|n|2
    z = (-slope * c * W[0] * a[0], -slope * c * W[1] * a[1], 0.0)  # d2E/d|n|dg
    # second derivatives in k and N
    cW = scale(c, W)
    if swings is not None:  # N3 in place of |n|
        e = -slope * c * (bowing(h, g[0], A, K[0], sA)[1] + bowing(h, g[1], B, K[1], sB)[1])
        bentA, bentB = bending(h, g[0], A, K[0], sA, c), bending(h, g[1], B, K[1], sB, c)
        ee = slope * slope * (bentA[0] + bentB[0])
        z = (slope * bentA[1], slope * bentB[1], 0.0)
        cW = (bentA[2], bentB[2], cW[2])
        gN = (gN[0], gN[1], gN[2] + e)
    Gk = madd(msub(columns_times(hat(k), K), hat(m)), diagonal(K1))  # dg/dk
    cWGk = rows_times(cW, Gk)
    Ekk = madd(madd(diagonal(scale(h, K)), symmetric(rows_times(K, hat(y)))), tmul(Gk, cWGk))
    if elastic:
        GN = msub(hat(V), columns_times(hat(N), C))  # dg/dN
        EkN = tmul(cWGk, GN)
        ENN = madd(
            madd(diagonal(scale(-2.0 / 3.0 * h, C)), symmetric(columns_times(hat(y), C))),
            tmul(GN, rows_times(cW, GN)),
        )
        zN = tapply(GN, z)
    else:  # V = e3
        EkN = (cWGk[3], -cWGk[0], 0.0, cWGk[4], -cWGk[1], 0.0, cWGk[5], -cWGk[2], 0.0)
        ENN = diagonal((cW[1], cW[0], 0.0))
        zN = (z[1], -z[0], 0.0)
    if swings is not None:
        EkN = madd(EkN, outer(tapply(Gk, z), E3))
        ENN = madd(ENN, symmetric(outer(add(zN, (0.0, 0.0, 0.5 * ee)), E3)))
    # from k to v: dk/dv = a I + b v v^T
    vk = dot(v, gk)
    a_, b_ = f / h, 2.0 * f1 / h
    Mv = add(scale(a_, gk), scale(b_ * vk, v))
    Ev = apply(Ekk, v)
    p = add(scale(a_ * b_, Ev), add(scale(0.5 * b_ * b_ * dot(v, Ev) + 2.0 * f2 / h * vk, v), scale(b_, gk)))
    Evv = mshift(madd(mscale(a_ * a_, Ekk), symmetric(outer(v, p))), b_ * vk)
    EvN = madd(mscale(a_, EkN), outer(scale(b_, v), tapply(EkN, v)))
    # from N to theta and lambda: dN = N x theta + R^T dlambda
    Evt = mul_hat(EvN, N)
    ENt = mul_hat(ENN, N)
    Ett = mshift(msub(mscale(0.5, symmetric(outer(gN, N))), hat_mul(N, ENt)), -dot(gN, N))
    Evl, Etl, Ell = EvN, madd(transpose(ENt), hat(gN)), ENN  # lambda in the frame of the midpoint, for now
    if swings is None:
        zv = tapply(Gk, z)
        zv = add(scale(a_, zv), scale(b_ * dot(v, zv), v))
        pull = tapply(RM, direction)
        Evl = madd(Evl, outer(zv, pull))
        Etl = madd(Etl, outer(cross(zN, N), pull))
        Ell = madd(madd(Ell, symmetric(outer(zN, pull))), mshift(outer(scale(ee - e / size, pull), pull), e / size))
    # to the mean s and the difference d of delta_1 and delta_2: dv = v x s + w/2 d, theta = s + t/2 x d
    t = scale(1.0 / (1.0 + w), v)
    t2 = scale(0.5, t)
    Y1 = madd(mscale(0.5 * w, Evv), mul_hat(Evt, t2))
    Y2 = madd(mscale(0.5 * w, transpose(Evt)), mul_hat(Ett, t2))
    Hss = madd(msub(Ett, hat_mul(v, madd(mul_hat(Evv, v), Evt))), mul_hat(transpose(Evt), v))
    Hsd = msub(Y2, hat_mul(v, Y1))
    Hdd = msub(mscale(0.5 * w, Y1), hat_mul(t2, Y2))
    Bs = mul(msub(Etl, hat_mul(v, Evl)), transpose(RM))
    Bd = mul(msub(mscale(0.5 * w, Evl), hat_mul(t2, Etl)), transpose(RM))
    # to delta_1 and delta_2, with the second-order terms of v and of the midpoint
    torque = cross(gN, N)
    twist = cross(t, torque)
    at, bt = scale(0.5, add(torque, twist)), scale(0.5, subtract(torque, twist))
    vM, tt = dot(v, Mv), dot(torque, t)
    common = madd(mscale(0.25, Hss), Hdd)
    slant = mscale(0.5, symmetric(Hsd))
    H11 = mshift(msub(msub(common, slant), mscale(0.25, symmetric(outer(at, t)))), 0.25 * (tt - vM))
    H22 = mshift(madd(madd(common, slant), mscale(0.25, symmetric(outer(bt, t)))), -0.25 * (tt + vM))
    off = madd(madd(outer(at, t), mscale(-1.0, outer(t, bt))), madd(symmetric(outer(v, Mv)), mscale(w, hat(Mv))))
    H12 = madd(
        madd(msub(mscale(0.25, Hss), Hdd), mscale(0.5, msub(Hsd, transpose(Hsd)))),
        mshift(mscale(0.25, off), -0.25 * vM),
    )
    B1, B2 = msub(mscale(0.5, Bs), Bd), madd(mscale(0.5, Bs), Bd)
    CC = mul(RM, mul(Ell, transpose(RM)))
    # the ends' share of the load
    H11 = madd(H11, node_term(gL, NL))
    H22 = madd(H22, node_term(gR, NR))
    B1 = madd(B1, hat_mul(gL, transpose(RL)))
    B2 = madd(B2, hat_mul(gR, transpose(RR)))
    if elastic:
        ends = diagonal(scale(-h / 6.0, C))
        HL, HR = columns_times(hat(NL), scale(-h / 6.0, C)), columns_times(hat(NR), scale(-h / 6.0, C))
        H11 = msub(H11, mul_hat(HL, NL))
        H22 = msub(H22, mul_hat(HR, NR))
        B1 = msub(B1, mul(HL, transpose(RL)))
        B2 = msub(B2, mul(HR, transpose(RR)))
        CC = madd(CC, madd(mul(RL, mul(ends, transpose(RL))), mul(RR, mul(ends, transpose(RR)))))
    # gradient
    spin = cross(v, Mv)
    g1 = add(subtract(at, scale(0.5, add(scale(w, Mv), spin))), cross(gL, NL))
    g2 = add(add(bt, scale(0.5, subtract(scale(w, Mv), spin))), cross(gR, NR))
    gl = apply(RM, gN)
    if swings is None:
        gl = add(gl, scale(e, direction))
    gl = add(gl, add(apply(RL, gL), apply(RR, gR)))
    return g1, g2, gl, H11, H12, H22, B1, B2, CC


@inlined
def node_term(gN: Vector, N: Vector) -> Matrix:
    """Second derivative in a rotation of a function of N = R^T n that has the gradient gN in N and no curvature."""
    return mshift(mscale(0.5, symmetric(outer(gN, N))), -dot(gN, N))
