"""Whether a shape is clear of the bodies, and whether it has got past one since the last shape."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import (
    BARE,
    EXACT,
    GRIP_EXCLUSION,
    MATE,
    NONE,
    NORMAL,
    RUB,
    SECOND,
    SECOND_EXACT,
    SECOND_NORMAL,
    SLIPS,
    SPOT,
    THIRD,
    THIRD_EXACT,
    THIRD_NORMAL,
    TILT,
)
from cable_shape.kernels.distance.surface import reach_of, touch
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    dot,
    get3,
    put3,
    scale,
    subtract,
    take3,
)

TOUCH = 13  # numbers of a contact: arc length, body, point 3, normal 3, force, force along the surface 3, 1: slips
ASIDE = 0.1  # of the largest push on a node, what others may pull together that is told with it
SIDES = (0, EXACT, NORMAL), (SECOND, SECOND_EXACT, SECOND_NORMAL), (THIRD, THIRD_EXACT, THIRD_NORMAL)


@kernel
def depth_of(
    point: Array, arc: float, length: float, bodies: Array, frames: Array, triangles: Array, nodes: Array,
    radius: float, stack: Array,
) -> tuple[float, int]:  # fmt: skip
    """The gap of the cable's point at `arc` [m] to the nearest body, and that body; infinite and -1 without one."""
    least, at = math.inf, -1
    p = (point[0], point[1], point[2])
    for b in range(bodies.shape[0]):
        exclusion = GRIP_EXCLUSION if bodies[b, 12] != 0.0 else 0.0
        if arc < exclusion or arc > length - exclusion:
            continue
        d, _, _ = touch(bodies[b], frames[b], triangles, nodes, p, NONE, False, stack)
        if d - radius < least:
            least, at = d - radius, b
    return least, at


@kernel
def buried(
    supports: Array, arcs: Array, count: int, deepest: float, length: float, bodies: Array, frames: Array,
    triangles: Array, nodes: Array, radius: float, stack: Array,
) -> tuple[int, int, float]:  # fmt: skip
    """The first of `count` supports (k, 7) at `arcs` [m] deeper in a body, that body and the gap; -1, -1, 0: none."""
    for i in range(count):
        gap, body = depth_of(supports[i], arcs[i], length, bodies, frames, triangles, nodes, radius, stack)
        if gap < -deepest:
            return i, body, gap
    return -1, -1, 0.0


@kernel
def carried(p: Vector, then: Array, now: Array) -> Vector:
    """Where a point of a body that went from frame `then` (4, 3) to frame `now` is."""
    local = subtract(p, get3(then, 3))
    out = get3(now, 3)
    for i in range(3):
        out = add(out, scale(dot(local, get3(then, i)), get3(now, i)))
    return out


@kernel
def passes(
    s: Array, before: Array, after: Array, bodies: Array, frames: Array, then: Array, triangles: Array, nodes: Array,
    radius: float, stack: Array,
) -> bool:  # fmt: skip
    """Whether a point of the cable came so far from `before` to `after` (n, 3) that it may be past a body.

    That is further, as the body sees it, than its gap and 0.6 of half the body's thickness and the cable's. The bodies
    were in the frames `then` (m, 4, 3) and are in `frames`.
    """
    count = s.shape[0]
    start = np.empty((count, 3))
    for b in range(bodies.shape[0]):
        exclusion = GRIP_EXCLUSION if bodies[b, 12] != 0.0 else 0.0
        moved = False
        for i in range(12):
            moved = moved or then[b, i // 3, i % 3] != frames[b, i // 3, i % 3]
        largest = 0.0
        for k in range(count):
            p = get3(before, k)
            put3(start, k, 0, carried(p, then[b], frames[b]) if moved else p)
            way = subtract(get3(after, k), get3(start, k))
            largest = max(largest, dot(way, way))
        largest = math.sqrt(largest)
        thick = 0.6 * (reach_of(bodies[b]) + radius)
        if largest <= thick:
            continue
        k = 0
        while k < count:
            if s[k] < exclusion or s[k] > s[count - 1] - exclusion:
                k += 1
                continue
            p = get3(start, k)
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
def touches(s: Array, near: Array, on: Array, thick: Array, out: Array) -> int:
    """Fills out (3 N, TOUCH) with the contacts of a solution, see TOUCH; returns how many there are.

    What a node is pulled along by is shared by the bodies that press on it as they push. One of several that would pull
    by next to nothing is not told: the push of the one that presses most is turned by it.
    """
    count = 0
    for k in range(s.shape[0]):
        if on[k, 0] == BARE:
            continue
        whole, most, rest = 0.0, 0.0, NONE
        for column, exact, normal in SIDES:
            push = near[k, exact] if on[k, column] != BARE else 0.0
            whole, most = whole + max(push, 0.0), max(most, push)
            rest = add(rest, scale(min(push, 0.0), take3(near, k, normal)))
        if dot(rest, rest) > ASIDE * ASIDE * most * most:
            rest = NONE
        for column, exact, normal in SIDES:
            if on[k, column] == BARE or not near[k, exact] > 0.0:
                continue
            n, force = take3(near, k, normal), near[k, exact]
            if on[k, SECOND] == BARE:
                n = add(n, take3(near, k, TILT))
            elif force == most:
                n = add(n, scale(1.0 / force, rest))
            size = math.sqrt(dot(n, n))
            n, force = scale(1.0 / size, n), size * force
            out[count, 0], out[count, 1], out[count, 8] = s[k], on[k, column], force
            put3(out, count, 2, subtract(take3(near, k, SPOT), scale(thick[k], n)))
            put3(out, count, 5, n)
            rub = take3(near, k, RUB)
            if on[k, SECOND] == BARE:  # the surface may have turned a little with the last step
                rub = subtract(rub, scale(dot(rub, n), n))
            put3(out, count, 9, scale(near[k, exact] / whole, rub))
            out[count, 12] = near[k, SLIPS] if near[k, MATE] != 0.0 else 0.0
            count += 1
    return count
