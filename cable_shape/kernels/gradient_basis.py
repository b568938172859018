"""Solutions of the gradient cable's equation in closed form, in a basis that stays well conditioned for any tension.

Dimensionless, with s = l / L from 0 to 1 and u = s - 1/2:

    z x'' - x'''' + c x^(6) + q0 + q1 u + sum Q_j delta(s - a_j) = 0,    z = T L^2 / B, c = (l_g / L)^2.

Its exponents are +-mu with m = mu^2 a root of c m^2 - m + z = 0: m1 = 2 z / (1 + D), m2 = (1 + D) / 2c,
D = sqrt(1 - 4 z c). Large exponents become exponentials that decay from either end, small ones entire functions

    c_n(u) = sum_k m^k u^(n+2k) / (n+2k)!    with c_n' = c_(n-1), c_n = u^n / n! + m c_(n+2),

which are even in mu and need no branch at m = 0 or below. Six modes:

    LOW4     c = 0, small z      x in 1, u, c2, c3
    HIGH4    c = 0, large z      x in 1, u, exp(-mu s), exp(-mu (1 - s))
    SPLIT6   m1 small, m2 large  x in 1, u, c2, c3 of m1 and the exponentials of mu2
    REAL6    both large, apart   x in 1, u and the exponentials of mu1 and of mu2
    PAIR6    both large, close   x in 1, u, P, Q from either end; P = exp(-k s) cosh(d s), Q = exp(-k s) sinh(d s) / d,
             or complex          k, d = (mu2 +- mu1) / 2: d^2 > 0 real roots, 0 a double root, < 0 complex roots
    SERIES6  both small          x in 1, u, e2 .. e5 with e_n = u^n / n! + (m1 + m2) e_(n+2) - m1 m2 e_(n+4)

Every x and each of its derivatives is then one "row" of 8 numbers: a cubic a0 + a1 u + a2 u^2/2 + a3 u^3/6 plus up to
4 mode functions W0 .. W3 (see :func:`functions`); differentiation maps rows onto rows (:func:`differentiate`).
Between concentrated loads exponentials are anchored at the ends of the piece [sl, sr], so that none grows.
"""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.exponential import decay

LOW4, HIGH4, SPLIT6, REAL6, PAIR6, SERIES6 = 0, 1, 2, 3, 4, 5

#: m = mu^2 up to which the entire functions are used; beyond it exp(-mu) is small enough for exponentials.
LOW_LIMIT = 16.0

#: |m| of both roots up to which the 6th order uses one series: |mu u| <= 4, where 20 terms reach rounding.
SERIES_LIMIT = 64.0
SERIES_TERMS = 20

#: d^2 / k^2 above which real roots are far enough apart for plain exponentials.
_APART = 0.25

#: Below this |d^2| / k^2 the roots count as nearly double: P and Q by their series in d^2 s^2 (0.01 where k s = 10).
_DOUBLE = 1e-4

# Places in the parameters of a mode.
Z, C, M, MU, MU2, D2, SIGMA, PI = 0, 1, 2, 3, 4, 5, 6, 7
PARAMETERS = 8
ROW = 8  # a0 .. a3, W0 .. W3


@kernel
def choose(z, c, par, series):
    """Chooses the mode for tension `z` and parameter `c` (0: 4th order); fills `par` and `series` (4, SERIES_TERMS)."""
    par[Z], par[C], par[M], par[MU], par[MU2], par[D2], par[SIGMA], par[PI] = z, c, z, 0.0, 0.0, 0.0, 0.0, 0.0
    if c == 0.0:
        if z <= LOW_LIMIT:
            return LOW4
        par[MU] = math.sqrt(z)
        return HIGH4
    square = 1.0 - 4.0 * z * c
    if square >= 0.0:
        root = math.sqrt(square)
        low, high = 2.0 * z / (1.0 + root), (1.0 + root) / (2.0 * c)
        size = max(abs(low), high)
    else:
        low, high = math.inf, math.inf
        size = math.sqrt(z / c)
    if size <= SERIES_LIMIT:
        par[SIGMA], par[PI] = 1.0 / c, z / c
        _series(1.0 / c, z / c, series)
        return SERIES6
    if low <= LOW_LIMIT:
        par[M], par[MU2] = low, math.sqrt(high)
        return SPLIT6
    total = 1.0 / c + 2.0 * math.sqrt(z / c)  # (mu1 + mu2)^2
    d2 = 0.25 * square / (c * c) / total
    if d2 > _APART * 0.25 * total:
        par[MU], par[MU2] = math.sqrt(low), math.sqrt(high)
        return REAL6
    par[MU], par[D2] = 0.5 * math.sqrt(total), d2
    return PAIR6


@kernel
def _series(sigma, pi, series):
    """Coefficients of e4 .. e7 in powers of u^2: series[i, k] u^(4+i+2k)."""
    before, now = 0.0, 1.0
    f4, f5, f6, f7 = 24.0, 120.0, 720.0, 5040.0
    for k in range(SERIES_TERMS):
        series[0, k], series[1, k], series[2, k], series[3, k] = now / f4, now / f5, now / f6, now / f7
        before, now = now, sigma * now - pi * before
        n = 6.0 + 2.0 * k
        f4, f5, f6, f7 = f6, f7, f6 * (n + 1.0) * (n + 2.0), f7 * (n + 2.0) * (n + 3.0)


@kernel
def pair(mu, d2, s):
    """P and Q of mode PAIR6 at the distance `s` >= 0 from their end."""
    if abs(d2) < _DOUBLE * mu * mu:
        e, x = math.exp(-mu * s), d2 * s * s
        p = 1.0 + x * (0.5 + x * (1.0 / 24.0 + x * (1.0 / 720.0 + x / 40320.0)))
        q = 1.0 + x * (1.0 / 6.0 + x * (1.0 / 120.0 + x * (1.0 / 5040.0 + x / 362880.0)))
        return e * p, e * q * s
    if d2 > 0.0:
        d = math.sqrt(d2)
        slow, fast = math.exp(-(mu - d) * s), math.exp(-(mu + d) * s)
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / d
    d, e = math.sqrt(-d2), math.exp(-mu * s)
    return e * math.cos(d * s), e * math.sin(d * s) / d


@kernel(fastmath={"contract"})
def entire(m, u):
    """c4 and c5 at `u`: 13 terms, coefficients 1 / (4 + 2k)! and 1 / (5 + 2k)!, enough for |m| u^2 <= 25."""
    v = u * u
    x = m * v
    a = 3.279889237069838e-30
    a = 1.6117375710961184e-24 + x * (2.4795962632247976e-27 + x * a)
    a = 4.110317623312165e-19 + x * (8.896791392450574e-22 + x * a)
    a = 4.779477332387385e-14 + x * (1.5619206968586225e-16 + x * a)
    a = 2.08767569878681e-09 + x * (1.1470745597729725e-11 + x * a)
    a = 2.48015873015873e-05 + x * (2.755731922398589e-07 + x * a)
    a = 0.041666666666666664 + x * (0.001388888888888889 + x * a)
    b = 1.1309962886447716e-31
    b = 6.446950284384474e-26 + x * (9.183689863795546e-29 + x * b)
    b = 1.9572941063391263e-20 + x * (3.868170170630684e-23 + x * b)
    b = 2.8114572543455206e-15 + x * (8.22063524662433e-18 + x * b)
    b = 1.6059043836821613e-10 + x * (7.647163731819816e-13 + x * b)
    b = 2.7557319223985893e-06 + x * (2.505210838544172e-08 + x * b)
    b = 0.008333333333333333 + x * (0.0001984126984126984 + x * b)
    return v * v * a, v * v * u * b


@kernel
def summed(series, u):
    """e4, e5, e6 and e7 at `u`."""
    v = u * u
    e4, e5, e6, e7 = 0.0, 0.0, 0.0, 0.0
    for k in range(SERIES_TERMS - 1, -1, -1):
        e4 = e4 * v + series[0, k]
        e5 = e5 * v + series[1, k]
        e6 = e6 * v + series[2, k]
        e7 = e7 * v + series[3, k]
    return v * v * e4, v * v * u * e5, v * v * v * e6, v * v * v * u * e7


@kernel(fastmath={"contract"})
def functions(mode, par, series, points, first, last, phi):
    """The functions of W0 .. W3 at points `first` to `last`.

    LOW4: c4, c5. HIGH4: exponentials from the left, right. SPLIT6: c4, c5 and exponentials of mu2. REAL6: exponentials
    of mu1, of mu2. PAIR6: P, Q from the left, P, Q from the right. SERIES6: e4, e5, e6, e7.

    points : (3, n)
        u, position from the middle of the cable, and distances from the ends of the piece, each exact near its zero.
    phi : (4, n)
        Out; rows 2 and 3 are untouched in modes LOW4 and HIGH4.
    """
    u, left, right = points[0, first:last], points[1, first:last], points[2, first:last]
    p0, p1, p2, p3 = phi[0, first:last], phi[1, first:last], phi[2, first:last], phi[3, first:last]
    if mode == LOW4 or mode == SPLIT6:
        m = par[M]
        for i in range(last - first):
            p0[i], p1[i] = entire(m, u[i])
    elif mode == HIGH4 or mode == REAL6:
        decay(par[MU], left, p0)
        decay(par[MU], right, p1)
    elif mode == PAIR6:
        for i in range(last - first):
            p0[i], p1[i] = pair(par[MU], par[D2], left[i])
            p2[i], p3[i] = pair(par[MU], par[D2], right[i])
    else:
        for i in range(last - first):
            p0[i], p1[i], p2[i], p3[i] = summed(series, u[i])
    if mode == SPLIT6 or mode == REAL6:
        decay(par[MU2], left, p2)
        decay(par[MU2], right, p3)


@kernel
def derivatives_at_ends(mode, par, phi, table):
    """Derivatives 0 to 4 of the 8 functions of a row at both ends of the cable, from the mode functions there.

    phi : (4, 2)
        Mode functions at the start and the end.
    table : (2, 5, ROW)
        Out. A derivative of x at an end is the product of its entry with the row of x.
    """
    mu, mu2, m, d2, sigma, pi = par[MU], par[MU2], par[M], par[D2], par[SIGMA], par[PI]
    for e in range(2):
        u = e - 0.5
        table[e, 0, 0], table[e, 0, 1], table[e, 0, 2], table[e, 0, 3] = 1.0, u, 0.5 * u * u, u * u * u / 6.0
        table[e, 0, 4], table[e, 0, 5], table[e, 0, 6], table[e, 0, 7] = phi[0, e], phi[1, e], phi[2, e], phi[3, e]
        for d in range(4):
            v0, v1, v2, v3 = table[e, d, 0], table[e, d, 1], table[e, d, 2], table[e, d, 3]
            v4, v5, v6, v7 = table[e, d, 4], table[e, d, 5], table[e, d, 6], table[e, d, 7]
            w6, w7 = 0.0, 0.0
            if mode == LOW4 or mode == SPLIT6:
                w4, w5 = v3 + m * v5, v4
            elif mode == HIGH4 or mode == REAL6:
                w4, w5 = -mu * v4, mu * v5
            elif mode == PAIR6:
                w4, w5, w6, w7 = d2 * v5 - mu * v4, v4 - mu * v5, mu * v6 - d2 * v7, mu * v7 - v6
            else:
                w4, w5, w6, w7 = v3 + sigma * v5 - pi * v7, v4, v5, v6
            if mode == SPLIT6 or mode == REAL6:
                w6, w7 = -mu2 * v6, mu2 * v7
            table[e, d + 1, 0], table[e, d + 1, 1], table[e, d + 1, 2], table[e, d + 1, 3] = 0.0, v0, v1, v2
            table[e, d + 1, 4], table[e, d + 1, 5], table[e, d + 1, 6], table[e, d + 1, 7] = w4, w5, w6, w7


@kernel
def differentiate(mode, par, row, out):
    """The row of dx/ds from the row of x; `out` must be another array."""
    out[0], out[1], out[2], out[3] = row[1], row[2], row[3], 0.0
    out[6], out[7] = 0.0, 0.0
    mu, mu2 = par[MU], par[MU2]
    if mode == LOW4 or mode == SPLIT6:  # c4' = c3 = u^3 / 6 + m c5, c5' = c4
        out[3], out[4], out[5] = row[4], row[5], par[M] * row[4]
    elif mode == HIGH4 or mode == REAL6:
        out[4], out[5] = -mu * row[4], mu * row[5]
    elif mode == PAIR6:  # P' = -k P + d^2 Q, Q' = P - k Q, with the other sign from the right
        d2 = par[D2]
        out[4], out[5] = row[5] - mu * row[4], d2 * row[4] - mu * row[5]
        out[6], out[7] = mu * row[6] - row[7], mu * row[7] - d2 * row[6]
    else:  # e4' = e3 = u^3 / 6 + sigma e5 - pi e7
        out[3] = row[4]
        out[4], out[5], out[6], out[7] = row[5], row[6] + par[SIGMA] * row[4], row[7], -par[PI] * row[4]
    if mode == SPLIT6 or mode == REAL6:
        out[6], out[7] = -mu2 * row[6], mu2 * row[7]
