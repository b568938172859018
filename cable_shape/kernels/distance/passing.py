"""Where one cable goes through another on the straight way from two shapes to the next two, counted with signs.

Two pieces cross when their ends lie in one plane, which is a cubic in time, and the point where they meet is on both.
The sign tells from which side. For ends that do not go round each other the sum of signs is the same on every way, so
it is 0 where there is a way on which no cable goes through the other, and otherwise there is none: two strings with
held ends are told apart by their linking alone, up to crossings of each with itself (Habegger and Lin, The
classification of links up to link-homotopy, 1990).
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.cable_near import CHUNK, bound, spheres_around

MOST_CROSSINGS = 64
CROSSING = 4  # time from 0 to 1, sign, and where on the first and the second cable in pieces
# m: the second cable is put aside by this, so that points of both that stand in one place by symmetry do not
_ASIDE = (1.1e-9, 0.7e-9, 1.3e-9)
_BISECTIONS = 60


@kernel
def crossings(a: Array, a_then: Array, b: Array, b_then: Array, apart: int, out: Array) -> int:
    """Fills `out` (MOST_CROSSINGS, 4) for centrelines a (n, 3) -> a_then, b (m, 3) -> b_then; returns how many.

    apart: 0 for two cables; of one with itself, b = a, only pieces j >= i + apart > i are looked at.
    """
    b, b_then = b + np.array(_ASIDE), b_then + np.array(_ASIDE)
    u, v = spheres_around(a), spheres_around(b)
    far, other_far = _ways(a, a_then, u.shape[0]), _ways(b, b_then, v.shape[0])
    count = 0
    for k in range(u.shape[0]):
        for m in range(k if apart > 0 else 0, v.shape[0]):
            if bound(u, v, k, m) > far[k] + other_far[m]:
                continue
            for i in range(k * CHUNK, min((k + 1) * CHUNK, a.shape[0] - 1)):
                for j in range(max(m * CHUNK, i + apart if apart > 0 else 0), min((m + 1) * CHUNK, b.shape[0] - 1)):
                    if not _swept_apart(a, a_then, b, b_then, i, j):
                        count = _add(a, a_then, b, b_then, i, j, out, count)
    return count


@kernel
def _ways(p: Array, then: Array, chunks: int) -> Array:
    """(chunks,) [m]: how far the points of each chunk go at most."""
    out = np.zeros(chunks)
    for k in range(chunks):
        for i in range(k * CHUNK, min((k + 1) * CHUNK, p.shape[0] - 1) + 1):
            x, y, z = then[i, 0] - p[i, 0], then[i, 1] - p[i, 1], then[i, 2] - p[i, 2]
            out[k] = max(out[k], math.sqrt(x * x + y * y + z * z))
    return out


@kernel
def _swept_apart(a: Array, a_then: Array, b: Array, b_then: Array, i: int, j: int) -> bool:
    """Whether boxes around two pieces on all their way are apart."""
    for c in range(3):
        low = min(min(a[i, c], a[i + 1, c]), min(a_then[i, c], a_then[i + 1, c]))
        high = max(max(a[i, c], a[i + 1, c]), max(a_then[i, c], a_then[i + 1, c]))
        other_low = min(min(b[j, c], b[j + 1, c]), min(b_then[j, c], b_then[j + 1, c]))
        other_high = max(max(b[j, c], b[j + 1, c]), max(b_then[j, c], b_then[j + 1, c]))
        if low > other_high or other_low > high:
            return True
    return False


@kernel
def _add(a: Array, a_then: Array, b: Array, b_then: Array, i: int, j: int, out: Array, count: int) -> int:
    """The crossings of two pieces, put to those of `out`."""
    e, f, w = np.empty(3), np.empty(3), np.empty(3)
    v0 = _volume(a, a_then, b, b_then, i, j, 0.0, e, f, w)
    v1 = _volume(a, a_then, b, b_then, i, j, 1.0 / 3.0, e, f, w)
    v2 = _volume(a, a_then, b, b_then, i, j, 2.0 / 3.0, e, f, w)
    v3 = _volume(a, a_then, b, b_then, i, j, 1.0, e, f, w)
    # its slope p t^2 + q t + r, whose zeros part the way into pieces on which the volume grows or falls
    p = 13.5 * (v3 - 3.0 * v2 + 3.0 * v1 - v0)
    q = 9.0 * (2.0 * v0 - 5.0 * v1 + 4.0 * v2 - v3)
    r = -5.5 * v0 + 9.0 * v1 - 4.5 * v2 + v3
    times = np.array((0.0, 1.0, 1.0, 1.0))
    under = q * q - 4.0 * p * r
    if under > 0.0:
        half = -0.5 * (q + math.copysign(math.sqrt(under), q))
        first = min(max(half / p, 0.0), 1.0) if p != 0.0 else 1.0
        second = min(max(r / half, 0.0), 1.0) if half != 0.0 else 1.0
        times[1], times[2] = min(first, second), max(first, second)
    for k in range(3):
        low, high = times[k], times[k + 1]
        at_low = _volume(a, a_then, b, b_then, i, j, low, e, f, w)
        at_high = _volume(a, a_then, b, b_then, i, j, high, e, f, w)
        if (at_low > 0.0) == (at_high > 0.0):
            continue
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if (_volume(a, a_then, b, b_then, i, j, middle, e, f, w) > 0.0) == (at_low > 0.0):
                low = middle
            else:
                high = middle
        _volume(a, a_then, b, b_then, i, j, low, e, f, w)
        ee, ef, ff, ew, fw = (e * e).sum(), (e * f).sum(), (f * f).sum(), (e * w).sum(), (f * w).sum()
        across = ee * ff - ef * ef
        if across <= 0.0:
            continue
        x, y = (ew * ff - fw * ef) / across, (ew * ef - fw * ee) / across
        if 0.0 <= x < 1.0 and 0.0 <= y < 1.0 and count < out.shape[0]:
            out[count, 0], out[count, 1] = low, 1.0 if at_high > at_low else -1.0
            out[count, 2], out[count, 3] = i + x, j + y
            count += 1
    return count


@kernel
def _volume(
    a: Array, a_then: Array, b: Array, b_then: Array, i: int, j: int, t: float, e: Array, f: Array, w: Array
) -> float:  # fmt: skip
    """Six times that between two pieces at a time, which come to be in e and f (3,), from one to the other w (3,)."""
    for c in range(3):
        p, q = (1.0 - t) * a[i, c] + t * a_then[i, c], (1.0 - t) * b[j, c] + t * b_then[j, c]
        e[c] = (1.0 - t) * a[i + 1, c] + t * a_then[i + 1, c] - p
        f[c] = (1.0 - t) * b[j + 1, c] + t * b_then[j + 1, c] - q
        w[c] = q - p
    return float(
        (e[1] * f[2] - e[2] * f[1]) * w[0] + (e[2] * f[0] - e[0] * f[2]) * w[1] + (e[0] * f[1] - e[1] * f[0]) * w[2]
    )
