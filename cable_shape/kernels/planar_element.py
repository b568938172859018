"""The rod's element (see :mod:`cable_shape.kernels.rod_element`) in a plane that it neither leaves nor twists out of.

The frame is one angle theta about the plane's normal e: with the tangent t = (cos, sin) and nu = (-sin, cos) in the
plane's axes, N = (n.t, n.nu), r' = Vt t + Vn nu, Vt = 1 + Nt/EA, Vn = Nn/GA and the torque on the section
tau = (r' x n).e = Vt Nn - Vn Nt, the element's part of the functional is

    h/2 K (k - k0)^2 - h/6 (psi_left + 4 psi_mid + psi_right) - h^3/24 (tau - K k0')^2 / (K + h^2/10 |n|),
    psi = Nt + Nt^2 / 2 EA + Nn^2 / 2 GA,  k = (theta_2 - theta_1) / h,  theta_mid = (theta_1 + theta_2) / 2,

with d psi / d theta = tau and d psi / dn = r'. An angle is kept as the unit complex number z = exp(i theta / 2), the
part of the quaternion that changes: z^2 is the tangent, z_1 z_2 that of the middle.
"""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_element import SMALL_FORCE, angle_series

#: A vector in the plane's axes, or a complex number
Pair = tuple[float, float]
#: xx, xy, yy of a symmetric matrix in the plane's axes
Symmetric = tuple[float, float, float]


@inlined
def product(a: Pair, b: Pair) -> Pair:
    """a b of complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


@inlined
def quotient(a: Pair, b: Pair) -> Pair:
    """a / b of complex numbers, b of length 1: a turned back by b."""
    return a[0] * b[0] + a[1] * b[1], a[1] * b[0] - a[0] * b[1]


@inlined
def unit(a: Pair) -> Pair:
    """a scaled to length 1."""
    f = 1.0 / math.sqrt(a[0] * a[0] + a[1] * a[1])
    return f * a[0], f * a[1]


@inlined
def half_turn(x: float) -> Pair:
    """exp(i x / 2), with the series of `rod_algebra.qexp`."""
    y = x * x
    if y < 1e-3:
        return 1.0 - y / 8.0 * (1.0 - y / 48.0 * (1.0 - y / 120.0)), (0.5 - y / 48.0 * (1.0 - y / 80.0)) * x
    return math.cos(0.5 * x), math.sin(0.5 * x)


@inlined
def relative(z1: Pair, z2: Pair) -> tuple[Pair, Pair]:
    """z2 with the sign that is nearer to z1, and z2 / z1."""
    d = quotient(z2, z1)
    if d[0] < 0.0:
        return (-z2[0], -z2[1]), (-d[0], -d[1])
    return z2, d


@inlined
def turn_of(d: Pair) -> float:
    """[rad], of d = exp(i turn / 2) with a real part that is not negative."""
    return angle_series(d[1] * d[1], d[0])[0] * d[1]


@inlined
def section(t: Pair, n: Pair, C: Pair) -> tuple[float, float, Pair]:
    """Nt, Nn and r' of the section with tangent t under the force n; C: 1/EA, 1/GA."""
    a, b = n[0] * t[0] + n[1] * t[1], n[1] * t[0] - n[0] * t[1]
    Vt, Vn = 1.0 + C[0] * a, C[1] * b
    return a, b, (Vt * t[0] - Vn * t[1], Vt * t[1] + Vn * t[0])


@inlined
def psi_of(a: float, b: float, C: Pair) -> float:
    """psi of N = (a, b)."""
    return a + 0.5 * (C[0] * a * a + C[1] * b * b)


@kernel(fastmath=FAST)
def element_gradient(
    h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, C: Pair
) -> tuple[float, float, float, Pair]:
    """Value, and gradient in theta_1, theta_2, lambda.

    h [m]; nL, nM, nR [N] force at the left, middle and right; k0, k1 [1/m, 1/m^2] rest curvature at the middle and its
    slope; K [N m^2]; C [1/N].
    """
    z2, d = relative(z1, z2)
    return gradient_of(turn_of(d), h, z1, z2, nL, nM, nR, k0, k1, K, C)


@inlined
def gradient_of(
    turn: float, h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, C: Pair
) -> tuple[float, float, float, Pair]:
    """The same from theta_2 - theta_1, z2 having the sign nearer to z1, without a branch."""
    bent = turn / h - k0
    m = K * bent
    c = C[0] - C[1]
    aL, bL, rL = section(product(z1, z1), nL, C)
    aR, bR, rR = section(product(z2, z2), nR, C)
    t = product(z1, z2)
    a, b, r = section(t, nM, C)
    g = b * (1.0 + c * a) - K * k1
    size = math.sqrt(nM[0] * nM[0] + nM[1] * nM[1] + SMALL_FORCE)
    c0 = -h * h * h / 12.0
    W = 1.0 / (K + 0.1 * h * h * size)
    y = c0 * W * g
    f = -h / 6.0
    value = (
        0.5 * h * m * bent
        + f * (psi_of(aL, bL, C) + 4.0 * psi_of(a, b, C) + psi_of(aR, bR, C))
        + 0.5 * y * g
        - 0.5 * c0 * K * k1 * k1
    )
    torque = 4.0 * f * (g + K * k1) + y * (c * (b * b - a * a) - a)
    e = -0.05 * h * h * c0 * W * W * g * g / size
    p, q = -y * (1.0 + c * a), y * c * b  # y d tau / dn = q t - p nu
    gl = (
        f * (rL[0] + 4.0 * r[0] + rR[0]) + q * t[0] + p * t[1] + e * nM[0],
        f * (rL[1] + 4.0 * r[1] + rR[1]) + q * t[1] - p * t[0] + e * nM[1],
    )
    return value, 0.5 * torque - m + f * bL * (1.0 + c * aL), 0.5 * torque + m + f * bR * (1.0 + c * aR), gl


@kernel(fastmath=FAST)
def element_hessian(
    h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, C: Pair
) -> tuple[float, float, Pair, float, float, float, Pair, Pair, Symmetric]:
    """Gradient and Hessian: g1, g2, gl, H11, H12, H22, B1 = H1l, B2 = H2l, CC = Hll; arguments as above. Exact."""
    z2, d = relative(z1, z2)
    return hessian_of(turn_of(d), h, z1, z2, nL, nM, nR, k0, k1, K, C)


@inlined
def hessian_of(
    turn: float, h: float, z1: Pair, z2: Pair, nL: Pair, nM: Pair, nR: Pair, k0: float, k1: float, K: float, C: Pair
) -> tuple[float, float, Pair, float, float, float, Pair, Pair, Symmetric]:
    """The same from theta_2 - theta_1, as above."""
    m = K * (turn / h - k0)
    c = C[0] - C[1]
    tL, tR, t = product(z1, z1), product(z2, z2), product(z1, z2)
    aL, bL, rL = section(tL, nL, C)
    aR, bR, rR = section(tR, nR, C)
    a, b, r = section(t, nM, C)
    g = b * (1.0 + c * a) - K * k1
    tau1 = c * (b * b - a * a) - a  # d tau / d theta
    tau2 = -b - 4.0 * c * a * b
    size = math.sqrt(nM[0] * nM[0] + nM[1] * nM[1] + SMALL_FORCE)
    x0, x1 = nM[0] / size, nM[1] / size
    slope = 0.1 * h * h
    c0 = -h * h * h / 12.0
    W = 1.0 / (K + slope * size)
    y = c0 * W * g
    f = -h / 6.0
    e = -0.5 * slope * y * W * g  # dE/d|n|
    ee = slope * slope * W * W * y * g  # d2E/d|n|2
    z = -slope * W * y  # d2E/d|n|dg
    # tau_n = d tau / dn = p nu + q t, tau1_n = d tau' / dn = 2 c (b nu - a t) - t
    p, q = 1.0 + c * a, c * b
    n0, n1 = q * t[0] - p * t[1], q * t[1] + p * t[0]
    s, u = -1.0 - 2.0 * c * a, 2.0 * c * b
    torque = 4.0 * f * (g + K * k1) + y * tau1
    bow = 4.0 * f * tau1 + c0 * W * tau1 * tau1 + y * tau2
    w = 4.0 * f + c0 * W * tau1
    l0 = 0.5 * (w * n0 + y * (s * t[0] - u * t[1]) + z * tau1 * x0)
    l1 = 0.5 * (w * n1 + y * (s * t[1] + u * t[0]) + z * tau1 * x1)
    pL, pR = f * (1.0 + c * aL), f * (1.0 + c * aR)
    qL, qR = f * c * bL, f * c * bR
    H = 0.25 * bow
    stiff = K / h
    # d2 psi / dn2 = C0 t t + C1 nu nu = C1 I + c t t
    wide, even = ee - e / size, 6.0 * f * C[1] + e / size
    fc = f * c
    y2 = 2.0 * y * c
    CC = (
        even + fc * (tL[0] * tL[0] + 4.0 * t[0] * t[0] + tR[0] * tR[0])
        + c0 * W * n0 * n0 - y2 * t[0] * t[1] + 2.0 * z * n0 * x0 + wide * x0 * x0,
        fc * (tL[0] * tL[1] + 4.0 * t[0] * t[1] + tR[0] * tR[1])
        + c0 * W * n0 * n1 + 0.5 * y2 * (t[0] * t[0] - t[1] * t[1]) + z * (n0 * x1 + n1 * x0) + wide * x0 * x1,
        even + fc * (tL[1] * tL[1] + 4.0 * t[1] * t[1] + tR[1] * tR[1])
        + c0 * W * n1 * n1 + y2 * t[0] * t[1] + 2.0 * z * n1 * x1 + wide * x1 * x1,
    )  # fmt: skip
    return (
        0.5 * torque - m + pL * bL,
        0.5 * torque + m + pR * bR,
        (
            f * (rL[0] + 4.0 * r[0] + rR[0]) + y * n0 + e * x0,
            f * (rL[1] + 4.0 * r[1] + rR[1]) + y * n1 + e * x1,
        ),
        stiff + H + f * (c * (bL * bL - aL * aL) - aL),
        H - stiff,
        stiff + H + f * (c * (bR * bR - aR * aR) - aR),
        (l0 + qL * tL[0] - pL * tL[1], l1 + qL * tL[1] + pL * tL[0]),
        (l0 + qR * tR[0] - pR * tR[1], l1 + qR * tR[1] + pR * tR[0]),
        CC,
    )
