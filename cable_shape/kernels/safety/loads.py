"""Where a shape is loaded most."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.safety.stress import most_stressed

Extremes = tuple[int, float, int, float, int, float, int, float]


@kernel
def chord_of(buffer: Array, points: int) -> float:
    """[m], distance of the ends of a shape's buffer."""
    first, last = points, 4 * points - 3
    return math.sqrt(
        (buffer[last] - buffer[first]) ** 2
        + (buffer[last + 1] - buffer[first + 1]) ** 2
        + (buffer[last + 2] - buffer[first + 2]) ** 2
    )


@kernel
def most_loaded(buffer: Array, points: int, begin: int, end: int, section: Array) -> Extremes:
    """Index and value of the greatest tension [N], bending curvature [1/m], |twist rate| [rad/m] and von Mises stress
    [Pa] of the points from begin to end - 1 of a shape's buffer. An area of 0 in `section` (see `stress`) leaves the
    stress out.
    """
    i = j = k = m = begin
    tension, square, twist, stress = -math.inf, -math.inf, -math.inf, 0.0
    for p in range(begin, end):
        q, u, n = 4 * points + 4 * p, 8 * points + 3 * p, 11 * points + 3 * p
        x, y, z, w = buffer[q], buffer[q + 1], buffer[q + 2], buffer[q + 3]
        along = (
            2.0 * (x * z + w * y) * buffer[n]
            + 2.0 * (y * z - w * x) * buffer[n + 1]
            + (1.0 - 2.0 * (x * x + y * y)) * buffer[n + 2]
        )
        if along > tension:
            i, tension = p, along
        bent = buffer[u] * buffer[u] + buffer[u + 1] * buffer[u + 1]
        if bent > square:
            j, square = p, bent
        twisted = abs(buffer[u + 2])
        if twisted > twist:
            k, twist = p, twisted
    if section[0] > 0.0:
        m, stress = most_stressed(buffer, points, begin, end, section)
    return i, tension, j, math.sqrt(square), k, twist, m, stress
