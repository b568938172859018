"""Where two cables come nearest, or one cable itself, as rows of straight pieces, with bounds that cull.

Two pieces are no nearer than the spheres around their chunks. Of a cable with itself two pieces count if the cable
between their middles is at least `shortest` long and its chord is at most 2/pi of that, as on half a circle: a straight
or gently bent cable is not near itself, a loop and a hairpin are.

A piece of cable that turns by theta < pi in all has a chord of at least cos(theta / 2) of its length, since no tangent
is more than theta / 2 off that in the middle of the turning. What has not turned far enough is culled by that.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel

CHUNK = 8  # pieces in one bounding sphere
HALF_CIRCLE = 2.0 / math.pi  # chord / arc length
SLACK = 1e-9  # m, of bounds against rounding
TURN = 2.0 * math.acos(1.01 * HALF_CIRCLE)  # rad, less turning leaves a chord longer than that
SPOT = 9  # distance of the centrelines, arc length on the first and on the second, point on the first and on the second
MOST_SPOTS = 64
APART = 0.05  # of the distance to be kept: nearer points tell no direction in which to part


@kernel
def between_pieces(a: Array, i: int, b: Array, j: int) -> tuple[float, float, float]:
    """Square of the distance [m^2] of the pieces a[i], a[i + 1] and b[j], b[j + 1], and where on each it is, 0 to 1."""
    dd = de = ee = dw = ew = 0.0
    for c in range(3):
        d, e, w = a[i + 1, c] - a[i, c], b[j + 1, c] - b[j, c], a[i, c] - b[j, c]
        dd += d * d
        de += d * e
        ee += e * e
        dw += d * w
        ew += e * w
    across = dd * ee - de * de
    x = 0.0
    if across > 1e-12 * dd * ee:
        x = min(max((de * ew - ee * dw) / across, 0.0), 1.0)
    y = (de * x + ew) / ee if ee > 0.0 else 0.0
    if y < 0.0 or y > 1.0 or ee == 0.0:
        y = min(max(y, 0.0), 1.0)
        x = min(max((de * y - dw) / dd, 0.0), 1.0) if dd > 0.0 else 0.0
    square = 0.0
    for c in range(3):
        gap = a[i, c] + x * (a[i + 1, c] - a[i, c]) - b[j, c] - y * (b[j + 1, c] - b[j, c])
        square += gap * gap
    return square, x, y


@kernel
def spheres_around(points: Array) -> Array:
    """(chunks, 4): centre and radius of a sphere around every CHUNK pieces."""
    pieces = points.shape[0] - 1
    out = np.zeros(((pieces + CHUNK - 1) // CHUNK, 4))
    for k in range(out.shape[0]):
        first, last = k * CHUNK, min((k + 1) * CHUNK, pieces)
        for c in range(3):
            low = high = points[first, c]
            for i in range(first, last + 1):
                low, high = min(low, points[i, c]), max(high, points[i, c])
            out[k, c] = 0.5 * (low + high)
        for i in range(first, last + 1):
            x, y, z = points[i, 0] - out[k, 0], points[i, 1] - out[k, 1], points[i, 2] - out[k, 2]
            out[k, 3] = max(out[k, 3], math.sqrt(x * x + y * y + z * z))
    return out


@kernel
def turning(p: Array) -> Array:
    """(chunks + 1,) [rad]: by how much a centreline has turned at most, where its chunks begin and at its end."""
    pieces = p.shape[0] - 1
    out = np.zeros((pieces + CHUNK - 1) // CHUNK + 1)
    total = x0 = y0 = z0 = 0.0
    for i in range(pieces):
        x, y, z = p[i + 1, 0] - p[i, 0], p[i + 1, 1] - p[i, 1], p[i + 1, 2] - p[i, 2]
        size = math.sqrt(x * x + y * y + z * z)
        f = 1.0 / size if size > 0.0 else 0.0
        x, y, z = f * x, f * y, f * z
        if i > 0:
            square = (x - x0) ** 2 + (y - y0) ** 2 + (z - z0) ** 2
            total += math.sqrt(square) * (1.0 + 0.15 * square)  # above the angle with this chord
        if i % CHUNK == 0:
            out[i // CHUNK] = total
        x0, y0, z0 = x, y, z
    out[-1] = total
    return out


@kernel
def counts_as_near(p: Array, s: Array, i: int, j: int, shortest: float) -> bool:
    """Whether the pieces i < j of one cable may be near each other, see the module."""
    arc = 0.5 * (s[j] + s[j + 1] - s[i] - s[i + 1])
    if arc < shortest:
        return False
    square = 0.0
    for c in range(3):
        gap = 0.5 * (p[j, c] + p[j + 1, c] - p[i, c] - p[i + 1, c])
        square += gap * gap
    return square <= (HALF_CIRCLE * arc) ** 2


@kernel
def bound(u: Array, v: Array, k: int, m: int) -> float:
    """A lower bound on the distance of chunk k of one cable and chunk m of the other."""
    x, y, z = u[k, 0] - v[m, 0], u[k, 1] - v[m, 1], u[k, 2] - v[m, 2]
    return math.sqrt(x * x + y * y + z * z) - u[k, 3] - v[m, 3]


@kernel
def apart_for_good(low: float, s: Array, turned: Array, k: int, m: int, shortest: float, more: float) -> bool:
    """Whether no pieces of the chunks k and m of one cable, at least `low` apart, count as near each other.

    more [rad]: by how much it may be turned besides.
    """
    arc = s[min((m + 1) * CHUNK, s.shape[0] - 1)] - s[k * CHUNK]
    return turned[m + 1] - turned[k] + more < TURN or arc < shortest or low > HALF_CIRCLE * arc + SLACK


@kernel
def fill(a: Array, sa: Array, b: Array, sb: Array, i: int, j: int, spot: Array) -> None:
    """The nearest points of two pieces as a row of SPOT."""
    square, x, y = between_pieces(a, i, b, j)
    spot[0] = math.sqrt(square)
    spot[1] = sa[i] + x * (sa[i + 1] - sa[i])
    spot[2] = sb[j] + y * (sb[j + 1] - sb[j])
    for c in range(3):
        spot[3 + c] = a[i, c] + x * (a[i + 1, c] - a[i, c])
        spot[6 + c] = b[j, c] + y * (b[j + 1, c] - b[j, c])


@kernel
def nearest(
    a: Array, sa: Array, b: Array, sb: Array, own: bool, shortest: float, reach: float, cull: bool, spot: Array,
    counts: Array, other_counts: Array,
) -> bool:  # fmt: skip
    """Fills `spot` with the nearest points of two centrelines a (n, 3) and b (m, 3); False if all are beyond `reach`.

    own: b is a. counts, other_counts (2,): pairs of pieces culled and solved are added, once where own.
    """
    pieces, others = a.shape[0] - 1, b.shape[0] - 1
    turned = turning(a) if own else np.zeros(1)
    if cull and own and turned[-1] < TURN:
        counts[0] += pieces * (pieces - 1) // 2
        return False
    u = spheres_around(a)
    v = u if own else spheres_around(b)
    best, at, to = reach * reach, -1, -1
    within = reach
    k0 = m0 = 0
    if cull:
        least = math.inf
        for k in range(u.shape[0]):
            for m in range(k if own else 0, v.shape[0]):
                low = bound(u, v, k, m)
                if low < least and not (own and apart_for_good(low, sa, turned, k, m, shortest, 0.0)):
                    least, k0, m0 = low, k, m
    solved = total = 0
    for first in range(2 if cull else 1):  # the most promising chunks first
        for k in range(u.shape[0]):
            for m in range(k if own else 0, v.shape[0]):
                if cull and (first == 0) != (k == k0 and m == m0):
                    continue
                end, other_end = min((k + 1) * CHUNK, pieces), min((m + 1) * CHUNK, others)
                size = end - k * CHUNK
                total += size * (size - 1) // 2 if own and m == k else size * (other_end - m * CHUNK)
                if cull:
                    low = bound(u, v, k, m)
                    if low > within + SLACK or (own and apart_for_good(low, sa, turned, k, m, shortest, 0.0)):
                        continue
                for i in range(k * CHUNK, end):
                    for j in range(max(m * CHUNK, i + 1 if own else 0), other_end):
                        if own and not counts_as_near(a, sa, i, j, shortest):
                            continue
                        solved += 1
                        square = between_pieces(a, i, b, j)[0]
                        if square < best or (square == best and (at < 0 or i < at or (i == at and j < to))):
                            best, at, to = square, i, j
                            within = math.sqrt(best)
    counts[0] += total - solved
    counts[1] += solved
    if not own:
        other_counts[0] += total - solved
        other_counts[1] += solved
    if at < 0:
        return False
    fill(a, sa, b, sb, at, to, spot)
    return True


@kernel
def alongside(a: Array, sa: Array, b: Array, sb: Array, spot: Array, reach: float) -> tuple[float, float, float, float]:
    """How two centrelines lie to each other at a place, a row of SPOT: cosine of the angle between them, those between
    each and the way from the second to the first, and the determinant of the second derivatives of their distance by
    both arc lengths, times `reach` [m] squared: 0 where they lie along each other, less where it is no minimum.
    """
    k = min(max(node_at(sa, spot[1]), 1), sa.shape[0] - 2)
    m = min(max(node_at(sb, spot[2]), 1), sb.shape[0] - 2)
    tt = uu = tu = nn = nt = nu = na = nb = 0.0
    d, e = 0.5 * (sa[k + 1] - sa[k - 1]), 0.5 * (sb[m + 1] - sb[m - 1])
    for c in range(3):
        t, u, n = a[k + 1, c] - a[k - 1, c], b[m + 1, c] - b[m - 1, c], spot[3 + c] - spot[6 + c]
        tt += t * t
        uu += u * u
        tu += t * u
        nn += n * n
        nt += n * t
        nu += n * u
        na += n * (a[k + 1, c] - 2.0 * a[k, c] + a[k - 1, c]) / (d * d)
        nb += n * (b[m + 1, c] - 2.0 * b[m, c] + b[m - 1, c]) / (e * e)
    cosine = tu / math.sqrt(max(tt * uu, 1e-300))
    size = math.sqrt(nn)
    if size < APART * reach:  # the way from one to the other tells nothing
        return cosine, 0.0, 0.0, 1.0 - cosine * cosine
    rise, fall = nt / (size * math.sqrt(max(tt, 1e-300))), -nu / (size * math.sqrt(max(uu, 1e-300)))
    one, other = 1.0 - rise * rise + reach * na / size, 1.0 - fall * fall - reach * nb / size
    det = one * other - (cosine + rise * fall) ** 2 if one > 0.0 else -1.0
    return cosine, rise, -fall, det


@kernel
def node_at(s: Array, x: float) -> int:
    """The first node of ascending arc lengths s (n,) that is at x or beyond; n if none is."""
    low, high = 0, s.shape[0]
    while low < high:
        middle = (low + high) // 2
        if s[middle] < x:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def is_joined(x: float, length: float, y: float, other: float, joined: Array) -> bool:
    """Whether points at arc lengths x and y of two cables, so long, are so near to ends that hang together that it is
    no contact. joined (2, 2) [m]: below so much from an end of the first and one of the second together it is not."""
    near = x + y < joined[0, 0] or x + (other - y) < joined[0, 1]
    return near or (length - x) + y < joined[1, 0] or (length - x) + (other - y) < joined[1, 1]


@kernel
def spots(
    a: Array, sa: Array, b: Array, sb: Array, own: bool, shortest: float, joined: Array, reach: float, apart: float,
    out: Array,
) -> int:  # fmt: skip
    """Fills `out` (MOST_SPOTS, 9) with the places where two centrelines are within `reach`; returns how many.

    Of pairs of points that are within `apart` [m] of each other along both cables only the nearest is a place. joined:
    as for `is_joined`.
    """
    u = spheres_around(a)
    v = u if own else spheres_around(b)
    turned = turning(a) if own else np.zeros(1)
    pieces, others = a.shape[0] - 1, b.shape[0] - 1
    spot = np.empty(SPOT)
    count = 0
    length, other, hang = sa[pieces], sb[others], joined.any()
    for k in range(u.shape[0]):
        for m in range(k if own else 0, v.shape[0]):
            low = bound(u, v, k, m)
            if low > reach or (own and apart_for_good(low, sa, turned, k, m, shortest, 0.0)):
                continue
            for i in range(k * CHUNK, min((k + 1) * CHUNK, pieces)):
                for j in range(max(m * CHUNK, i + 1 if own else 0), min((m + 1) * CHUNK, others)):
                    if own and not counts_as_near(a, sa, i, j, shortest):
                        continue
                    if between_pieces(a, i, b, j)[0] > reach * reach:
                        continue
                    fill(a, sa, b, sb, i, j, spot)
                    if hang and is_joined(spot[1], length, spot[2], other, joined):
                        continue
                    count = keep(spot, apart, out, count)
    return count


@kernel
def keep(spot: Array, apart: float, out: Array, count: int) -> int:
    """Puts a place among those of `out`, unless a nearer one is beside it; returns how many there are."""
    left = 0
    for r in range(count):
        beside = abs(out[r, 1] - spot[1]) < apart and abs(out[r, 2] - spot[2]) < apart
        if beside and out[r, 0] <= spot[0]:
            return count
    for r in range(count):
        beside = abs(out[r, 1] - spot[1]) < apart and abs(out[r, 2] - spot[2]) < apart
        if not beside:
            out[left] = out[r]
            left += 1
    if left < out.shape[0]:
        out[left] = spot
        left += 1
    return left
