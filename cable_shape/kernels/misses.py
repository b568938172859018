"""How far observed points are from a centreline, as vectors: what a calibration makes small."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import Vector, add, cross, dot, inlined, scale, subtract

Array = Any


@inlined
def tangent_of(buffer: Array, points: int, i: int) -> Vector:
    """Third axis of the cable frame at point i of a shape's buffer."""
    j = 4 * points + 4 * i
    x, y, z, w = buffer[j], buffer[j + 1], buffer[j + 2], buffer[j + 3]
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@inlined
def place_of(buffer: Array, points: int, i: int) -> Vector:
    """Position of point i of a shape's buffer."""
    j = points + 3 * i
    return buffer[j], buffer[j + 1], buffer[j + 2]


@inlined
def on_curve(h: float, a: Vector, ta: Vector, b: Vector, tb: Vector, x: float) -> tuple[Vector, Vector]:
    """Place and derivative in x = 0 .. 1 of the cubic between two points [m] of tangents ta, tb, h [m] apart in s."""
    y = 1.0 - x
    d = subtract(b, a)
    place = add(
        add(scale(y * y * (1.0 + 2.0 * x), a), scale(x * x * (3.0 - 2.0 * x), b)),
        add(scale(h * x * y * y, ta), scale(-h * x * x * y, tb)),
    )
    slope = add(scale(6.0 * x * y, d), add(scale(h * y * (1.0 - 3.0 * x), ta), scale(h * x * (3.0 * x - 2.0), tb)))
    return place, slope


@kernel
def misses(buffer: Array, points: int, seen: Array, arc: Array, out: Array) -> None:
    """Observed points minus the centreline, out (m, 3) [m].

    buffer: of a shape of so many `points`; seen (m, 3) [m]; arc (m,) [m]: where on the cable a point is. Where that is
    NaN, the closest point of the cable is taken, and what is out across the cable.
    """
    h = buffer[1] - buffer[0]
    for k in range(seen.shape[0]):
        p = (seen[k, 0], seen[k, 1], seen[k, 2])
        known = not math.isnan(arc[k])
        if known:
            i = max(0, min(int(arc[k] / h), points - 2))
            x = arc[k] / h - i
        else:
            least, i, x = math.inf, 0, 0.0
            for j in range(points - 1):
                a, b = place_of(buffer, points, j), place_of(buffer, points, j + 1)
                step, to = subtract(b, a), subtract(p, a)
                t = min(1.0, max(0.0, dot(to, step) / dot(step, step)))
                miss = subtract(to, scale(t, step))
                if dot(miss, miss) < least:
                    least, i, x = dot(miss, miss), j, t
        a, b = place_of(buffer, points, i), place_of(buffer, points, i + 1)
        ta, tb = tangent_of(buffer, points, i), tangent_of(buffer, points, i + 1)
        c, dc = on_curve(h, a, ta, b, tb, x)
        if not known:
            for _ in range(2):
                x += dot(subtract(p, c), dc) / dot(dc, dc)
                if x < 0.0 and i == 0:
                    x = 0.0  # beyond the start
                if x > 1.0 and i == points - 2:
                    x = 1.0
                c, dc = on_curve(h, a, ta, b, tb, x)
        miss = subtract(p, c)
        if not known and not (x == 0.0 or x == 1.0):
            miss = scale(1.0 / dot(dc, dc), cross(cross(dc, miss), dc))
        out[k, 0], out[k, 1], out[k, 2] = miss
