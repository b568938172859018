"""The covariance of the points of a line, and the radius of the tube that holds them with a confidence."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel


@kernel
def radius_of(xx: float, xy: float, yy: float, misses: float, squares: Array) -> float:
    """[m], for variances xx, yy and covariance xy [m^2] of two directions across the line.

    misses [m] join in quadrature; squares (r,): of the radius that holds a normal vector in the plane whose larger
    variance is 1, by the ratio of its standard deviations, evenly from 0 to 1.
    """
    apart = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    wide, narrow = 0.5 * (xx + yy) + apart, max(0.5 * (xx + yy) - apart, 0.0)
    cells = squares.shape[0] - 1
    at = cells * math.sqrt(narrow / wide) if wide > 0.0 else 0.0
    k = min(int(at), cells - 1)
    return math.sqrt(misses * misses + (squares[k] + (at - k) * (squares[k + 1] - squares[k])) * wide)


@kernel
def radii(covariance: Array, tangents: Array, misses: float, squares: Array, out: Array) -> None:
    """Fills out (n,) [m] from (n, 3, 3) [m^2] on a line of unit tangents (n, 3), see `radius_of`."""
    a, b = np.empty(3), np.empty(3)  # across
    for i in range(out.shape[0]):
        x, y, z = tangents[i, 0], tangents[i, 1], tangents[i, 2]
        if abs(x) < 0.7:
            size = math.sqrt(y * y + z * z)
            a[0], a[1], a[2] = 0.0, z / size, -y / size
        else:
            size = math.sqrt(x * x + z * z)
            a[0], a[1], a[2] = -z / size, 0.0, x / size
        b[0], b[1], b[2] = y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]
        xx = xy = yy = 0.0
        for j in range(3):
            for k in range(3):
                xx += covariance[i, j, k] * a[j] * a[k]
                xy += covariance[i, j, k] * a[j] * b[k]
                yy += covariance[i, j, k] * b[j] * b[k]
        out[i] = radius_of(xx, xy, yy, misses, squares)


@kernel
def add_moves(moves: Array, ways: Array, covariance: Array) -> None:
    """Adds to covariance (n, 3, 3) that of the columns of moves (n, 3, k) times ways (k, m), which are independent."""
    columns = ways.shape[1]
    first, last = np.full(columns + 1, ways.shape[0]), np.zeros(columns + 1, np.int64)  # of what is not 0 in each
    for c in range(columns):
        for a in range(ways.shape[0]):
            if ways[a, c] != 0.0:
                first[c], last[c] = min(first[c], a), a + 1
    for i in range(moves.shape[0]):
        for c in range(columns):
            x = y = z = 0.0
            for a in range(first[c], last[c]):
                x += moves[i, 0, a] * ways[a, c]
                y += moves[i, 1, a] * ways[a, c]
                z += moves[i, 2, a] * ways[a, c]
            covariance[i, 0, 0] += x * x
            covariance[i, 0, 1] += x * y
            covariance[i, 0, 2] += x * z
            covariance[i, 1, 1] += y * y
            covariance[i, 1, 2] += y * z
            covariance[i, 2, 2] += z * z
        covariance[i, 1, 0], covariance[i, 2, 0] = covariance[i, 0, 1], covariance[i, 0, 2]
        covariance[i, 2, 1] = covariance[i, 1, 2]
