"""Rows (see gradient_basis) of the parts that make up a gradient cable: homogeneous solutions and responses to loads.

The force of the model, n = z x' - x''' + c x^(5), of each part is returned in closed form: it is constant for a
homogeneous solution, and taking it from third and fifth derivatives would lose digits.
"""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.gradient_basis import (
    D2,
    HIGH4,
    LOW4,
    MU,
    MU2,
    PAIR6,
    PI,
    REAL6,
    SERIES6,
    SIGMA,
    SPLIT6,
    C,
    M,
    Z,
    entire,
    pair,
    summed,
)


@kernel
def spread(mode, par, amplitude, first, k, row):
    """Row, anchored at the ends of the cable, of the homogeneous solutions with ``amplitude[:, first + k]``.

    Returns its force n. The order of the solutions is that of the list in gradient_basis.
    """
    j = first + k
    row[0], row[1] = amplitude[0, j], amplitude[1, j]
    a, b = amplitude[2, j], amplitude[3, j]
    n = par[Z] * row[1]
    if mode == LOW4 or mode == SPLIT6:  # c2 = u^2 / 2 + m c4, c3 = u^3 / 6 + m c5
        row[2], row[3], row[4], row[5], row[6], row[7] = a, b, par[M] * a, par[M] * b, 0.0, 0.0
        n += b * (par[C] * par[M] - 1.0)
    elif mode == SERIES6:  # e2 = u^2 / 2 + sigma e4 - pi e6, e3 = u^3 / 6 + sigma e5 - pi e7
        row[2], row[3], row[4], row[5] = a, b, par[SIGMA] * a + amplitude[4, j], par[SIGMA] * b + amplitude[5, j]
        row[6], row[7] = -par[PI] * a, -par[PI] * b
        return n + par[C] * amplitude[5, j]
    else:
        row[2], row[3], row[4], row[5], row[6], row[7] = 0.0, 0.0, a, b, 0.0, 0.0
    if mode == SPLIT6 or mode == REAL6 or mode == PAIR6:
        row[6], row[7] = amplitude[4, j], amplitude[5, j]
    return n


@kernel
def columns(mode, par, values, matrix, i):
    """Row `i` of the linear system: the value of each homogeneous solution from the `values` of a row's 8 functions."""
    matrix[i, 0], matrix[i, 1] = values[0], values[1]
    if mode == LOW4 or mode == SPLIT6:
        matrix[i, 2], matrix[i, 3] = values[2] + par[M] * values[4], values[3] + par[M] * values[5]
        matrix[i, 4], matrix[i, 5] = values[6], values[7]
    elif mode == SERIES6:
        matrix[i, 2] = values[2] + par[SIGMA] * values[4] - par[PI] * values[6]
        matrix[i, 3] = values[3] + par[SIGMA] * values[5] - par[PI] * values[7]
        matrix[i, 4], matrix[i, 5] = values[4], values[5]
    else:
        matrix[i, 2], matrix[i, 3], matrix[i, 4], matrix[i, 5] = values[4], values[5], values[6], values[7]


@kernel
def force_columns(mode, par, matrix, i):
    """Row `i` of the linear system for the force n, which is constant for each homogeneous solution."""
    matrix[i, :6] = 0.0
    matrix[i, 1] = par[Z]
    if mode == LOW4 or mode == SPLIT6:
        matrix[i, 3] = par[C] * par[M] - 1.0
    elif mode == SERIES6:
        matrix[i, 5] = par[C]


@kernel
def anchor(mode, par, sl, sr, row):
    """Re-anchors the exponentials of a row from the ends of the cable to those of the piece [sl, sr]."""
    if mode == PAIR6:  # P(s + t) = P(s) P(t) + d^2 Q(s) Q(t), Q(s + t) = P(s) Q(t) + Q(s) P(t)
        d2 = par[D2]
        p, q = pair(par[MU], d2, sl)
        row[4], row[5] = row[4] * p + row[5] * q, row[4] * d2 * q + row[5] * p
        p, q = pair(par[MU], d2, 1.0 - sr)
        row[6], row[7] = row[6] * p + row[7] * q, row[6] * d2 * q + row[7] * p
    if mode == HIGH4 or mode == REAL6:
        row[4] *= math.exp(-par[MU] * sl)
        row[5] *= math.exp(-par[MU] * (1.0 - sr))
    if mode == SPLIT6 or mode == REAL6:
        row[6] *= math.exp(-par[MU2] * sl)
        row[7] *= math.exp(-par[MU2] * (1.0 - sr))


@kernel
def distributed(mode, par):
    """A solution under the load q0 + q1 u: place k and factor g of its row, row[k] = g q0, row[k + 1] = g q1.

    Returns k, g and h: its force n is h q1 - q0 u - q1 u^2 / 2.
    """
    if mode == LOW4 or mode == SPLIT6:
        g = 1.0 / (1.0 - par[C] * par[M])
        return 4, g, par[C] * g
    if mode == SERIES6:
        return 6, -1.0 / par[C], 0.0
    return 2, -1.0 / par[Z], 1.0 / par[Z]


@kernel
def concentrated(mode, par, series, a, behind, sl, sr, row):
    """Row, on the piece [sl, sr], of a solution under a unit load at `a`; returns its force n there.

    behind : whether the piece lies behind the load, where n is lower by 1 than before it.
    """
    row[:] = 0.0
    z, c, mu, mu2 = par[Z], par[C], par[MU], par[MU2]
    b = a - 0.5
    if mode == LOW4:  # c3(u - b) behind the load, 0 before it
        if behind:
            _shifted(par[M], b, 1.0, row)
            return -1.0
        return 0.0
    if mode == SERIES6:  # -e5(u - b) / c behind the load, 0 before it
        if behind:
            _shifted_series(par, series, b, -1.0 / c, row)
            return -1.0
        return 0.0
    gap = sl - a if behind else a - sr  # from the load to the nearer end of the piece
    near = 0 if behind else 1  # which of two exponentials decays away from the load
    sign = 1.0 if behind else -1.0
    if mode == HIGH4:
        _decaying(mu, gap, 4 + near, sign, b, 1.0, row)
        return -0.5 * sign
    if mode == SPLIT6 or mode == REAL6:  # partial fractions of 1 / (c (m - m1) (m - m2))
        low = par[M] if mode == SPLIT6 else mu * mu
        scale = -1.0 / (c * (mu2 * mu2 - low))
        _decaying(mu2, gap, 6 + near, sign, b, scale, row)
        if mode == REAL6:
            _decaying(mu, gap, 4 + near, sign, b, -scale, row)
            return -0.5 * sign
        if behind:
            _shifted(low, b, -scale, row)
            return scale * (1.0 - 1.5 * c * low)
        return 0.5 * scale * c * low
    # PAIR6: x'' = -(P + k Q) / (4 c k mu1 mu2), integrated twice by the inverse of the map of differentiate
    d2 = par[D2]
    product = mu * mu - d2
    p, q = -1.0 / (4.0 * c * mu * product), -1.0 / (4.0 * c * product)
    for _ in range(2):
        p, q = -(mu * p + q) / product, -(d2 * p + mu * q) / product
    pg, qg = pair(mu, d2, gap)
    k = 4 + 2 * near
    row[k], row[k + 1] = p * pg + q * qg, p * d2 * qg + q * pg
    row[0], row[1] = sign * b / (2.0 * z), -sign / (2.0 * z)
    return -0.5 * sign


@kernel
def _decaying(mu, gap, place, sign, b, scale, row):
    """Adds scale times -(exp(-mu |s - a|) / mu + |s - a|) / 2 mu^2, |s - a| = sign (u - b)."""
    half = 0.5 * scale / (mu * mu)
    row[place] -= half / mu * math.exp(-mu * gap)
    row[0] += half * sign * b
    row[1] -= half * sign


@kernel
def _shifted(m, b, scale, row):
    """Adds scale times c3(u - b) = -c3(b) + c2(b) u - c1(b) c2(u) + c0(b) c3(u)."""
    c4, c5 = entire(m, b)
    c2, c3 = 0.5 * b * b + m * c4, b * b * b / 6.0 + m * c5
    c0, c1 = 1.0 + m * c2, b + m * c3
    row[0] -= scale * c3
    row[1] += scale * c2
    row[2] -= scale * c1
    row[3] += scale * c0
    row[4] -= scale * m * c1
    row[5] += scale * m * c0


@kernel
def _shifted_series(par, series, b, scale, row):
    """Adds scale times e5(u - b), whose Taylor row at u = 0 is e_(5-k)(-b)."""
    sigma, pi = par[SIGMA], par[PI]
    e4, e5, e6, e7 = summed(series, b)
    e2, e3 = 0.5 * b * b + sigma * e4 - pi * e6, b * b * b / 6.0 + sigma * e5 - pi * e7
    e0, e1 = 1.0 + sigma * e2 - pi * e4, b + sigma * e3 - pi * e5
    row[0] -= scale * e5
    row[1] += scale * e4
    row[2] -= scale * e3
    row[3] += scale * e2
    row[4] -= scale * e1
    row[5] += scale * e0
    row[6] += scale * pi * e3
    row[7] -= scale * pi * e2
