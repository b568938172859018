"""Asked of every shape in contact: which nodes it lacks, which it could do without, by how much it is stretched."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import BARE, GAP, SHARP, is_knot, sharpness
from cable_shape.kernels.rod_algebra import get4, qconj, qmul

CLOSE = 1.2  # of the spacing: two elements that are no longer together can be one
WIDE, FOLDED = 0.2, 0.4  # [rad] an element turns by at most: between two contacts, and beside one on an edge
LYING = 2e-6  # [m] nodes nearer to a body than this lie on it, pressed or not


@kernel
def touches(near: Array, on: Array, k: int, full: bool) -> bool:
    """Whether node k is pressed on a body or, where that counts, lies on one."""
    return is_knot(on, k) or (full and on[k, 1] != BARE and near[k, GAP] < LYING)


@kernel
def steep(nodes: Array, h: Array, q: Array, near: Array, on: Array, layer: float, least: float, out: Array) -> int:
    """Fills `out` with the middles of elements beside contacts that are too long, and returns how many there are.

    They are longer than `layer` [m] and turn by more than `least` [rad], or lie between two contacts and turn by more
    than WIDE; beside contacts that run over edges they are longer than `layer` and turn by more than FOLDED.
    """
    count = 0
    for e in range(h.shape[0]):
        left, right = on[e, 0] != BARE, on[e + 1, 0] != BARE
        if not (left or right):
            continue
        turn = 2.0 * math.acos(min(1.0, abs(qmul(qconj(get4(q, e)), get4(q, e + 1))[3])))
        long, wide = h[e] > layer and turn > least, left and right and turn > WIDE
        if not (long or wide):
            continue
        if not (long and turn > FOLDED):
            left = left and not on_edge(q, h, near, e)
            right = right and not on_edge(q, h, near, e + 1)
            if not (left and right) and not (long and (left or right)):
                continue
        out[count] = 0.5 * (nodes[e] + nodes[e + 1])
        count += 1
    return count


@kernel
def on_edge(q: Array, h: Array, near: Array, k: int) -> bool:
    """Whether a contact is on an edge, as long as the elements beside it are."""
    return bool(sharpness(q, near, k) * (h[k - 1] + h[k]) > SHARP)


@kernel
def spare(
    nodes: Array, near: Array, on: Array, spacing: Array, middles: Array, stops: Array, full: bool, coarse: bool,
    away: Array,
) -> int:  # fmt: skip
    """Fills `away` with every other node far from where a row ends that is closer to the next than it need be.

    spacing (m,) [m] at `middles` (m,), linear between: what is close enough. stops (p,): stay. full: what lies in a row
    without being pressed does not end it. coarse: only inside of rows. Returns how many there are.
    """
    count = 0
    j = 0
    for k in range(3, nodes.shape[0] - 3):
        around = 0
        for i in range(k - 2, k + 3):
            around += touches(near, on, i, full)
        if around != 5 and (around != 0 or coarse):
            continue
        x = nodes[k]
        while j < middles.shape[0] and middles[j] < x:
            j += 1
        wide = spacing[min(j, middles.shape[0] - 1)]
        if 0 < j < middles.shape[0]:
            wide += (spacing[j - 1] - wide) * (middles[j] - x) / (middles[j] - middles[j - 1])
        if not nodes[k + 1] - nodes[k - 1] < CLOSE * wide:
            continue
        stays = count > 0 and away[count - 1] == k - 1
        for stop in stops:
            stays = stays or stop == x
        if not stays:
            away[count] = k
            count += 1
    return count


@kernel
def stretched(out: Array, points: int, stretch: float, bounds: Array) -> tuple[float, float]:
    """[m] by how much a cable that gives by `stretch` [1/N] is off: longer or shorter in all, and what it lacks.

    It lacks what each part is longer by, from one of the arc lengths `bounds` (b,) [m] to the next: through what holds
    it there it does not run. out: as CableShape.buffer; the integral of the tension by the trapezoidal rule.
    """
    whole = missing = part = before = 0.0
    b = 0
    for k in range(points):
        i, f = 4 * points + 4 * k, 11 * points + 3 * k
        x, y, z, w = out[i], out[i + 1], out[i + 2], out[i + 3]
        along = out[f] * 2.0 * (x * z + w * y) + out[f + 1] * 2.0 * (y * z - w * x)
        tension = along + out[f + 2] * (1.0 - 2.0 * (x * x + y * y))
        if k > 0:
            own = 0.5 * stretch * (before + tension) * (out[k] - out[k - 1])
            whole += abs(own)
            while b < bounds.shape[0] and out[k] > bounds[b]:
                missing, part, b = missing + max(part, 0.0), 0.0, b + 1
            if b < bounds.shape[0]:
                part += own
        before = tension
    return whole, missing + max(part, 0.0)
