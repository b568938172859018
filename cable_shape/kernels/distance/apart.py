"""Which cables cannot have touched since their last shapes, by bounds that never rule out one that has."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.cable_near import (
    CHUNK,
    HALF_CIRCLE,
    TURN,
    apart_for_good,
    between_pieces,
    bound,
    is_joined,
    spheres_around,
    turning,
)


@kernel
def leans(p: Array, x: float, y: float, z: float) -> bool:
    """Whether every piece of a centreline leads so far along a direction that no two of them can count as near.

    Chords of at least 2/pi of their length along one direction leave one of at least that to all that lies between.
    """
    for i in range(p.shape[0] - 1):
        a, b, c = p[i + 1, 0] - p[i, 0], p[i + 1, 1] - p[i, 1], p[i + 1, 2] - p[i, 2]
        if not a * x + b * y + c * z >= 1.01 * HALF_CIRCLE * math.sqrt(a * a + b * b + c * c):
            return False
    return True


@kernel
def way_of(p: Array, p_then: Array, far: float) -> float:
    """[m], how far a point has moved at most; 0 if that is less than `far`."""
    largest = 0.0
    for i in range(p.shape[0]):
        x, y, z = p[i, 0] - p_then[i, 0], p[i, 1] - p_then[i, 1], p[i, 2] - p_then[i, 2]
        largest = max(largest, x * x + y * y + z * z)
    return math.sqrt(largest) if largest >= far * far else 0.0


@kernel
def swing_of(p: Array, p_then: Array) -> float:
    """[rad], above the largest angle by which a piece has turned; infinite where one may have turned by more than 1."""
    largest = 0.0
    for i in range(p.shape[0] - 1):
        square = now = then = 0.0
        for c in range(3):
            a, b = p[i + 1, c] - p[i, c], p_then[i + 1, c] - p_then[i, c]
            square, now, then = square + (a - b) ** 2, now + a * a, then + b * b
        if not square < 0.7 * min(now, then):
            return math.inf
        largest = max(largest, square / min(now, then))
    return 1.2 * math.sqrt(largest)  # the sine of that angle is at most the root


@kernel
def apart_from_itself(p: Array, s: Array, p_then: Array, shortest: float, reach: float, far: float) -> bool:
    """Whether a cable cannot have come near itself since then.

    It cannot if both shapes lean along their chord, for so do all shapes between them, linear in time; nor if no chunks
    of it are within `reach` [m], see `cable_near`, and what both may have come nearer; below `far` [m] that is none.
    """
    last = p.shape[0] - 1
    x, y, z = p[last, 0] - p[0, 0], p[last, 1] - p[0, 1], p[last, 2] - p[0, 2]
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0 and leans(p, x / size, y / size, z / size) and leans(p_then, x / size, y / size, z / size):
        return True
    way = way_of(p, p_then, far)
    turned, swing = turning(p), swing_of(p, p_then) if way > 0.0 else 0.0
    if turned[-1] + 2.0 * swing < TURN:
        return True
    u = spheres_around(p)
    for k in range(u.shape[0]):
        for m in range(k, u.shape[0]):
            low = bound(u, u, k, m) - 2.0 * way
            if low <= reach and not apart_for_good(low, s, turned, k, m, shortest, 2.0 * swing):
                return False
    return True


@kernel
def box(p: Array, p_then: Array, out: Array) -> None:
    """Fills `out` (6,) with the corners of the box around both shapes (n, 3) of a cable."""
    for c in range(3):
        out[c], out[3 + c] = math.inf, -math.inf
        for shape in (p, p_then):
            for k in range(shape.shape[0]):
                out[c], out[3 + c] = min(out[c], shape[k, c]), max(out[3 + c], shape[k, c])


@kernel
def apart_but_joined(
    p: Array, s: Array, p_then: Array, r: Array, u: Array, r_then: Array, joined: Array, reach: float, far: float
) -> bool:  # fmt: skip
    """Whether two cables that hang together, see `cable_near.is_joined`, cannot have come near each other elsewhere.

    They cannot if no pieces of them are within `reach` [m], and what they may have come nearer, but such as are joined;
    below `far` [m] that is none.
    """
    reach += way_of(p, p_then, far) + way_of(r, r_then, far)
    a, b = spheres_around(p), spheres_around(r)
    pieces, others = p.shape[0] - 1, r.shape[0] - 1
    length, other = s[pieces], u[others]
    for k in range(a.shape[0]):
        for m in range(b.shape[0]):
            if bound(a, b, k, m) > reach:
                continue
            for i in range(k * CHUNK, min((k + 1) * CHUNK, pieces)):
                for j in range(m * CHUNK, min((m + 1) * CHUNK, others)):
                    square, x, y = between_pieces(p, i, r, j)
                    if square > reach * reach:
                        continue
                    at, to = s[i] + x * (s[i + 1] - s[i]), u[j] + y * (u[j + 1] - u[j])
                    if not is_joined(at, length, to, other, joined):
                        return False
    return True
