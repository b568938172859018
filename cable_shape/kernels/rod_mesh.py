"""Where the nodes go, and the loads and rest curvature of every element.

A mesh is equidistributed: every element gets the same share of a density that rises towards the ends, where the
boundary layer sqrt(EI/|n|) is, or that an error indicator of an earlier solution asks for. Arc lengths where the
internal force jumps are nodes.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import inlined


@kernel
def equidistribute(x: Array, density: Array, stops: Array, elements: int, s: Array) -> None:
    """Fills s (elements + 1,) with nodes of equal share of the density, given at x and linear between.

    stops: ascending arc lengths inside that must be nodes; there must be more elements than stops.
    """
    k = x.shape[0]
    share = np.empty(k)
    share[0] = 0.0
    for i in range(k - 1):
        share[i + 1] = share[i] + 0.5 * (density[i] + density[i + 1]) * (x[i + 1] - x[i])
    whole = share[k - 1]
    pieces = stops.shape[0] + 1
    node = 0
    s[0] = x[0]
    a = 0.0
    for p in range(pieces):
        stop = stops[p] if p < pieces - 1 else x[k - 1]
        b = whole
        if p < pieces - 1:
            j = 0
            while j < k - 2 and x[j + 1] < stop:
                j += 1
            t = stop - x[j]
            slope = (density[j + 1] - density[j]) / (x[j + 1] - x[j])
            b = share[j] + density[j] * t + 0.5 * slope * t * t
        rest = pieces - 1 - p
        count = elements - node if rest == 0 else round((elements - node) * (b - a) / (whole - a))
        count = max(1, min(count, elements - node - rest))
        j = 0
        for c in range(1, count):
            target = a + (b - a) * c / count
            while j < k - 2 and share[j + 1] < target:
                j += 1
            over = target - share[j]
            dx = x[j + 1] - x[j]
            slope = (density[j + 1] - density[j]) / dx
            s[node + c] = x[j] + 2.0 * over / (density[j] + math.sqrt(max(density[j] ** 2 + 2.0 * slope * over, 0.0)))
        node += count
        s[node] = stop
        a = b


@kernel
def layered(length: float, layer: float, x: Array, density: Array) -> None:
    """A density with half of the nodes within a few `layer` of the two ends; x becomes graded like it."""
    k = x.shape[0]
    reach = min(3.0 * layer, length)
    tail = 1.0 - math.exp(-length / reach)
    gain = length / (2.0 * reach * tail)
    for i in range(k):
        # abscissae dense at both ends
        c = 0.5 - 0.5 * math.cos(math.pi * i / (k - 1))
        x[i] = length * c
    for i in range(k):
        density[i] = 1.0 + gain * (math.exp(-x[i] / reach) + math.exp(-(length - x[i]) / reach))


@kernel
def spread(s: Array, raw: Array, x: Array, density: Array) -> float:
    """Density of a mesh from one `raw` (N,) in every element, smoothed and nowhere below a quarter of the mean.

    x, density (N+2,). Returns its integral.
    """
    elements = raw.shape[0]
    length = s[elements] - s[0]
    total = 0.0
    for e in range(elements):
        total += raw[e] * (s[e + 1] - s[e])
    for e in range(elements):
        raw[e] = max(raw[e], 0.25 * total / length, 1e-3 / length)
    soft = raw.copy()
    for _ in range(2):
        for e in range(elements):
            a, b = raw[max(e - 1, 0)], raw[min(e + 1, elements - 1)]
            soft[e] = max(raw[e], 0.6 * max(a, b))
        for e in range(elements):
            raw[e] = soft[e]
    x[0], x[elements + 1] = s[0], s[elements]
    density[0], density[elements + 1] = raw[0], raw[elements - 1]
    total = 0.0
    for e in range(elements):
        x[e + 1] = 0.5 * (s[e] + s[e + 1])
        density[e + 1] = raw[e]
        total += raw[e] * (s[e + 1] - s[e])
    return total


@kernel
def indicated(s: Array, q: Array, errors: Array, excess: float, turn: float, x: Array, density: Array) -> float:
    """Density of the mesh that a solution asks for, see `spread`; returns how many elements that makes.

    errors (N,): each element's share of the error, of seventh order; excess: by which factor the whole is above its
    aim; q (N+1, 4): quaternions at the nodes, to turn by at most `turn` [rad] in an element.
    """
    elements = errors.shape[0]
    raw = np.empty(elements)
    worst = whole = 0.0
    for e in range(elements):
        worst = max(worst, errors[e])
        whole += errors[e]
    # with the same share in every element, the largest of now
    grow = (excess * elements * worst / whole) ** (1.0 / 6.0) if worst > 0.0 else 0.0
    for e in range(elements):
        cosine = abs(q[e, 0] * q[e + 1, 0] + q[e, 1] * q[e + 1, 1] + q[e, 2] * q[e + 1, 2] + q[e, 3] * q[e + 1, 3])
        share = grow * (errors[e] / worst) ** (1.0 / 7.0) if worst > 0.0 else 0.0
        raw[e] = max(share, 2.0 * math.acos(min(1.0, cosine)) / turn) / (s[e + 1] - s[e])
    return float(spread(s, raw, x, density))


@inlined
def jumps(load: Array, e: int) -> bool:
    """Whether the internal force jumps where element e > 0 begins."""
    miss = size = 0.0
    for i in range(3):
        miss += abs(load[e, i] - load[e - 1, 6 + i])
        size += abs(load[e, i]) + abs(load[e - 1, i])
    return miss > 1e-9 * size
