"""Whether a shape is clear of the bodies, and whether it has got past one since the last shape."""

from __future__ import annotations

import math
from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact_near import BARE, NONE, NORMAL, PRESS, SPOT
from cable_shape.kernels.rod_algebra import dot, get3, put3, scale, subtract
from cable_shape.kernels.span_factor import take3
from cable_shape.kernels.surface import reach_of, touch

Array = Any
TOUCH = 9  # numbers of a contact: arc length, body, point 3, normal 3, force


@kernel
def depth_of(
    point: Array, bodies: Array, frames: Array, triangles: Array, nodes: Array, radius: float, stack: Array
) -> tuple[float, int]:
    """The gap of one point of the cable to the nearest body, and that body."""
    least, at = math.inf, -1
    p = (point[0], point[1], point[2])
    for b in range(bodies.shape[0]):
        d, _, _ = touch(bodies[b], frames[b], triangles, nodes, p, NONE, False, stack)
        if d - radius < least:
            least, at = d - radius, b
    return least, at


@kernel
def passes(
    s: Array, before: Array, after: Array, bodies: Array, frames: Array, triangles: Array, nodes: Array, radius: float,
    stack: Array,
) -> bool:  # fmt: skip
    """Whether a point of the cable came so far from `before` to `after` (n, 3) that it may be past a body.

    That is further than its gap and 0.6 of half the body's thickness and the cable's.
    """
    count = s.shape[0]
    largest = 0.0
    for k in range(count):
        way = subtract(get3(after, k), get3(before, k))
        largest = max(largest, dot(way, way))
    largest = math.sqrt(largest)
    for b in range(bodies.shape[0]):
        thick = 0.6 * (reach_of(bodies[b]) + radius)
        if largest <= thick:
            continue
        k = 0
        while k < count:
            p = get3(before, k)
            d, n, _ = touch(bodies[b], frames[b], triangles, nodes, p, NONE, False, stack)
            gap = max(d - radius, 0.0)
            way = subtract(get3(after, k), p)
            towards = -dot(way, n)
            if towards > gap + thick or math.sqrt(dot(way, way)) > gap + 4.0 * thick:
                return True
            clear = s[k] + gap - largest
            k += 1
            while k < count and s[k] < clear:
                k += 1
    return False


@kernel
def touches(s: Array, near: Array, on: Array, radius: float, out: Array) -> int:
    """Fills out (N, 9) with the contacts of a solution, see TOUCH; returns how many there are."""
    count = 0
    for k in range(s.shape[0]):
        if on[k, 0] == BARE or not near[k, PRESS] > 0.0:
            continue
        n = take3(near, k, NORMAL)
        out[count, 0] = s[k]
        out[count, 1] = on[k, 0]
        put3(out, count, 2, subtract(take3(near, k, SPOT), scale(radius, n)))
        put3(out, count, 5, n)
        out[count, 8] = near[k, PRESS]
        count += 1
    return count
