"""How far a cable and the bodies around it come between two solved places of a motion: `cable_shape.planning`."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import get3, qconj, qlog, qmul, rotation, subtract, tapply

#: A cubic with slopes a and b beyond its chord deviates from it by at most this fraction of |a| + |b|.
CUBIC = 4.0 / 27.0
#: So many times what a cubic deviates is allowed for.
SAFETY = 2.0


@kernel
def twist(a: Array, b: Array, out: Array) -> None:
    """Fills out (6,) with the motion from pose a to pose b (7,): shift [m], rotation vector [rad], world axes."""
    turn = qmul((b[3], b[4], b[5], b[6]), qconj((a[3], a[4], a[5], a[6])))
    if turn[3] < 0.0:
        turn = (-turn[0], -turn[1], -turn[2], -turn[3])
    w = qlog(turn)
    for i in range(3):
        out[i], out[3 + i] = b[i] - a[i], w[i]


@kernel
def motion(
    first: Array, last: Array, slopes_a: Array, slopes_b: Array, ends_a: Array, ends_b: Array, bend: float, reach: float
) -> tuple[float, float]:  # fmt: skip
    """[m]: how far the cable's points move at most from positions `first` to `last` (n, 3), and off that chord.

    slopes (n, 3, 6 k): sensitivities at both; ends (k, 7): the cable's ends, and clips that move. bend [rad]: by how
    much their frames turn off the straight motion between, times `reach` [m] they shift.
    """
    t = np.empty(6 * ends_a.shape[0])
    for k in range(ends_a.shape[0]):
        twist(ends_a[k], ends_b[k], t[6 * k : 6 * k + 6])
    way = off = 0.0
    for i in range(first.shape[0]):
        far = a = b = shifted = turned = 0.0
        for j in range(3):
            chord = last[i, j] - first[i, j]
            va = vb = 0.0
            for k in range(t.size):
                va += slopes_a[i, j, k] * t[k]
                vb += slopes_b[i, j, k] * t[k]
                if k % 6 < 3:
                    shifted += slopes_a[i, j, k] ** 2 + slopes_b[i, j, k] ** 2
                else:
                    turned += slopes_a[i, j, k] ** 2 + slopes_b[i, j, k] ** 2
            far += chord * chord
            a += (va - chord) ** 2
            b += (vb - chord) ** 2
        way = max(way, far)
        path = bend * (reach * math.sqrt(shifted) + math.sqrt(turned))
        off = max(off, SAFETY * CUBIC * (math.sqrt(a) + math.sqrt(b)) + path)
    return math.sqrt(way), off


@kernel
def load_changes(a: Array, b: Array, points: int) -> tuple[float, float, float]:
    """Largest change between two shapes' buffers of the force, the bending and the twist rate, as vectors at the same
    arc length, relative to the largest of each.
    """
    force = bend = twist = most_force = most_bend = most_twist = 0.0
    for i in range(points):
        u, n = 8 * points + 3 * i, 11 * points + 3 * i
        change = one = other = 0.0
        for j in range(3):
            change += (b[n + j] - a[n + j]) ** 2
            one += a[n + j] ** 2
            other += b[n + j] ** 2
        force, most_force = max(force, change), max(most_force, one, other)
        bend = max(bend, (b[u] - a[u]) ** 2 + (b[u + 1] - a[u + 1]) ** 2)
        most_bend = max(most_bend, a[u] ** 2 + a[u + 1] ** 2, b[u] ** 2 + b[u + 1] ** 2)
        twist, most_twist = max(twist, abs(b[u + 2] - a[u + 2])), max(most_twist, abs(a[u + 2]), abs(b[u + 2]))
    return (
        math.sqrt(force / most_force) if most_force > 0.0 else 0.0,
        math.sqrt(bend / most_bend) if most_bend > 0.0 else 0.0,
        twist / most_twist if most_twist > 0.0 else 0.0,
    )


@kernel
def relative_way(first: Array, last: Array, a: Array, b: Array) -> float:
    """[m], how far the points (n, 3) move at most as seen from a link that moves from pose a to pose b (7,)."""
    A, B = rotation((a[3], a[4], a[5], a[6])), rotation((b[3], b[4], b[5], b[6]))
    pa, pb = (a[0], a[1], a[2]), (b[0], b[1], b[2])
    most = 0.0
    for i in range(first.shape[0]):
        p, q = tapply(A, subtract(get3(first, i), pa)), tapply(B, subtract(get3(last, i), pb))
        most = max(most, (q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
    return math.sqrt(most)


@kernel
def least_left(
    first: Array, last: Array, distances_a: Array, distances_b: Array, limits: Array, on_link: Array, links_a: Array,
    links_b: Array, way: float, off: float, bend: float, resolution: float,
) -> float:  # fmt: skip
    """[m], by how much every body stays above its limit between two places, or more; 0 where what may hide is small.

    distances, limits (m,) [m]; on_link (m,): row in links (l, 7) of each body, -1 for none; bend [m]: by how much a
    link moves off the straight.
    """
    least = math.inf
    ways = np.full(links_a.shape[0], -1.0)
    for m in range(distances_a.shape[0]):
        k = on_link[m]
        between, aside = way, off
        if k >= 0:
            if k >= links_a.shape[0]:
                continue
            if ways[k] < 0.0:
                ways[k] = relative_way(first, last, links_a[k], links_b[k])
            between, aside = ways[k], off + bend
        left = 0.5 * (distances_a[m] + distances_b[m] - between) - aside - limits[m]
        if left < 0.0 and between + 2.0 * aside <= resolution:
            left = 0.0
        least = min(least, left)
    return least
