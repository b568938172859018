"""How far observed points are from a centreline, as vectors: what a calibration makes small."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import Vector, add, cross, dot, inlined, scale, subtract


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


@inlined
def interval(buffer: Array, points: int, i: int) -> tuple[Vector, Vector, Vector, Vector]:
    """Place and tangent at point i of a shape's buffer, and at the next."""
    a, b = place_of(buffer, points, i), place_of(buffer, points, i + 1)
    return a, tangent_of(buffer, points, i), b, tangent_of(buffer, points, i + 1)


@inlined
def place_of_point(buffer: Array, points: int, p: Vector, arc: float) -> tuple[int, float, bool]:
    """Where on the curve a point is: interval, 0 .. 1 in it, and whether what is out is across the cable.

    arc [m]: known; NaN: the closest point is sought.
    """
    h = buffer[1] - buffer[0]
    if not math.isnan(arc):
        i = max(0, min(int(arc / h), points - 2))
        return i, arc / h - i, False
    least, i, x = math.inf, 0, 0.0
    for j in range(points - 1):
        a, b = place_of(buffer, points, j), place_of(buffer, points, j + 1)
        step, to = subtract(b, a), subtract(p, a)
        t = min(1.0, max(0.0, dot(to, step) / dot(step, step)))
        miss = subtract(to, scale(t, step))
        if dot(miss, miss) < least:
            least, i, x = dot(miss, miss), j, t
    a, ta, b, tb = interval(buffer, points, i)
    for _ in range(2):
        c, dc = on_curve(h, a, ta, b, tb, x)
        x += dot(subtract(p, c), dc) / dot(dc, dc)
        if x < 0.0 and i == 0:
            x = 0.0  # beyond the start
        if x > 1.0 and i == points - 2:
            x = 1.0
    return i, x, not (x == 0.0 or x == 1.0)


@kernel
def misses(buffer: Array, points: int, seen: Array, arc: Array, out: Array) -> None:
    """Observed points minus the centreline, out (m, 3) [m].

    buffer: of a shape of so many `points`; seen (m, 3) [m]; arc (m,) [m]: where on the cable a point is. Where that is
    NaN, the closest point of the cable is taken, and what is out across the cable.
    """
    h = buffer[1] - buffer[0]
    for k in range(seen.shape[0]):
        p = (seen[k, 0], seen[k, 1], seen[k, 2])
        i, x, across = place_of_point(buffer, points, p, arc[k])
        c, dc = on_curve(h, *interval(buffer, points, i), x)
        miss = subtract(p, c)
        if across:
            miss = scale(1.0 / dot(dc, dc), cross(cross(dc, miss), dc))
        out[k, 0], out[k, 1], out[k, 2] = miss


@kernel
def changes(buffer: Array, points: int, seen: Array, arc: Array, moves: Array, out: Array) -> None:
    """Change of the misses, out (m, 3, k), where the centreline's points move by `moves` (points, 3, k).

    The closest point moves along the curve, too, so that the miss stays across it.
    """
    h = buffer[1] - buffer[0]
    for k in range(seen.shape[0]):
        p = (seen[k, 0], seen[k, 1], seen[k, 2])
        i, x, across = place_of_point(buffer, points, p, arc[k])
        a, ta, b, tb = interval(buffer, points, i)
        c, dc = on_curve(h, a, ta, b, tb, x)
        miss = subtract(p, c)
        bend = add(
            scale(6.0 - 12.0 * x, subtract(b, a)), scale(h, add(scale(6.0 * x - 4.0, ta), scale(6.0 * x - 2.0, tb)))
        )
        for j in range(moves.shape[2]):
            before = (moves[i, 0, j], moves[i, 1, j], moves[i, 2, j])
            after = (moves[i + 1, 0, j], moves[i + 1, 1, j], moves[i + 1, 2, j])
            move = add(scale(1.0 - x, before), scale(x, after))
            if across:
                on = (dot(miss, subtract(after, before)) - dot(move, dc)) / (dot(dc, dc) - dot(miss, bend))
                move = add(move, scale(on, dc))
            out[k, 0, j], out[k, 1, j], out[k, 2, j] = -move[0], -move[1], -move[2]
