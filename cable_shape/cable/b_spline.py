"""Uniform B-splines without clamped ends, as CAD writes them into KBL: :func:`span`.

With the cardinal B-spline N_p(t) = (1 / p!) sum_k (-1)^k C(p + 1, k) (t - k)_+^p of degree p (I. J. Schoenberg,
Cardinal Spline Interpolation, 1973) one span between the knots 0 and 1 is c(u) = sum_i P_i N_p(u + p - i), u in 0 .. 1:
a polynomial, which neither begins nor ends at a control point. n control points make n - p spans.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from cable_shape.checks import Array


@lru_cache(maxsize=32)
def basis(degree: int) -> Array:
    """(p + 1, p + 1): coefficient of u^(p - row) in the share of control point `column` in a span."""
    p = degree
    out = np.zeros((p + 1, p + 1))
    for i in range(p + 1):
        for k in range(p - i + 1):  # of N_p(u + p - i), all terms (u + p - i - k)^p whose foot is at or below 0
            sign = (-1) ** k * math.comb(p + 1, k) / math.factorial(p)
            out[:, i] += [sign * math.comb(p, row) * float(p - i - k) ** row for row in range(p + 1)]
    out.flags.writeable = False
    return out


@lru_cache(maxsize=32)
def clamped(degree: int) -> Array:
    """The same of a Bezier curve, which begins and ends at its first and last control points."""
    p = degree
    out = np.zeros((p + 1, p + 1))
    for i in range(p + 1):
        for j in range(p - i + 1):
            out[p - i - j, i] += math.comb(p, i) * math.comb(p - i, j) * (-1) ** j
    out.flags.writeable = False
    return out


def spans(points: Array, degree: int, of: Array) -> Array:
    """Coefficients (p + 1, n - p, 3), highest power first, of the spans that control points (n, 3) make."""
    windows = np.lib.stride_tricks.sliding_window_view(points, degree + 1, axis=0)  # (n - p, 3, p + 1)
    return np.asarray(np.einsum("ki,mci->kmc", of, windows))
