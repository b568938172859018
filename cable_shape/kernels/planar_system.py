"""Newton's system of the rod in a plane: one angle a node, two multipliers; blocks are numbers.

The counterpart of :mod:`cable_shape.kernels.rod_system` and `rod_factor`, laid out in the work space of the spatial
solver, for N elements:

    z      (N+1, 2)   cos and sin of half the angle, see `planar_element`
    guess  (N+1, 2)   the z that the solve began with
    load   (N, 6)     force in the plane at the left, middle and right of each element, lambda not included [N]
    rest   (N, 2)     rest curvature at the middle and its slope [1/m, 1/m^2]
    rows   (N+1, 9)   of a node: D, 1/pivot, gradient or right-hand side, border 2, eliminated 3, change
    parts  (N, 16)    of an element: H12, H12/pivot, H22, B1 2, B2 2, CC 3, derivatives in lambda 2, theta_1, theta_2,
                      and what a rule of integration misses 2
    side   (N, 4)     slack 2, moments at the left and right of an element [N m]
    sums   (12,)      gram 5 (00, 01, 11, 0g, 1g), x of the normal in the cable frame, CC 3, closure 2, y of the normal

The start is clamped, the end clamped or free: node 0, and with a held end node N, are no unknowns.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels import planar_lanes
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_element import Pair
from cable_shape.kernels.planar_lanes import ROWS, VALUE, gather, gradients, hessians, lane2
from cable_shape.kernels.rod_algebra import FAST, inlined
from cable_shape.kernels.rod_lanes import LANES

Array = Any
D, INVERSE, G, B, W, CHANGE = 0, 1, 2, 3, 5, 8  # columns of rows
NORMAL_X, NORMAL_Y = 5, 11  # of sums
H12, Y, H22, B1, B2, CC, GL, G1, G2, MISSED = 0, 1, 2, 3, 5, 7, 10, 12, 13, 14  # of parts


@inlined
def layout(work: Array, elements: int) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:
    """z, guess, load, rest, rows, parts, side, sums."""
    n, nodes = elements, elements + 1
    a = 2 * nodes
    b = a + 2 * nodes
    c = b + 6 * n
    d = c + 2 * n
    e = d + 9 * nodes
    f = e + 16 * n
    g = f + 4 * n
    return (
        work[:a].reshape(nodes, 2),
        work[a:b].reshape(nodes, 2),
        work[b:c].reshape(n, 6),
        work[c:d].reshape(n, 2),
        work[d:e].reshape(nodes, 9),
        work[e:f].reshape(n, 16),
        work[f:g].reshape(n, 4),
        work[g : g + 12],
    )


@inlined
def behind(work: Array, elements: int, columns: int) -> Array:
    """(N+1, columns), what follows in the work space."""
    first = 41 * elements + 25
    return work[first : first + columns * (elements + 1)].reshape(elements + 1, columns)


@inlined
def forces(load: Array, e: int, lam: Pair) -> tuple[Pair, Pair, Pair]:
    """The internal force at the left, middle and right of element e."""
    return (
        (load[e, 0] + lam[0], load[e, 1] + lam[1]),
        (load[e, 2] + lam[0], load[e, 3] + lam[1]),
        (load[e, 4] + lam[0], load[e, 5] + lam[1]),
    )


@inlined
def jumps(load: Array, e: int) -> bool:
    """Whether the internal force jumps where element e > 0 begins."""
    miss = abs(load[e, 0] - load[e - 1, 4]) + abs(load[e, 1] - load[e - 1, 5])
    size = abs(load[e, 0]) + abs(load[e - 1, 0]) + abs(load[e, 1]) + abs(load[e - 1, 1])
    return miss > 1e-9 * size


@kernel(fastmath=FAST)
def assemble(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, C: Pair, rows: Array, parts: Array, sums: Array
) -> None:  # fmt: skip
    """Fills D, B and G of rows, parts, and the sums over elements of CC and of the derivatives in lambda."""
    elements = h.shape[0]
    c00 = c01 = c11 = r0 = r1 = 0.0
    d = g = x0 = x1 = 0.0  # what the element before gives to the node
    lanes = np.empty(ROWS * LANES)
    for begin in range(0, elements, LANES):
        count = gather(begin, z, lam, h, load, rest, lanes)
        hessians(lanes, K, C)
        for k in range(count):
            e = begin + k
            (g1, g2), gl = lane2(lanes, planar_lanes.G1, k), lane2(lanes, planar_lanes.GL, k)
            (h11, h12), h22 = lane2(lanes, planar_lanes.H11, k), lanes[planar_lanes.H22 * LANES + k]
            b1, b2 = lane2(lanes, planar_lanes.B1, k), lane2(lanes, planar_lanes.B2, k)
            (cc0, cc1), cc2 = lane2(lanes, planar_lanes.CC, k), lanes[(planar_lanes.CC + 2) * LANES + k]
            rows[e, D], rows[e, G], rows[e, B], rows[e, B + 1] = d + h11, g + g1, x0 + b1[0], x1 + b1[1]
            parts[e, H12], parts[e, H22] = h12, h22
            parts[e, B1], parts[e, B1 + 1], parts[e, B2], parts[e, B2 + 1] = b1[0], b1[1], b2[0], b2[1]
            parts[e, CC], parts[e, CC + 1], parts[e, CC + 2] = cc0, cc1, cc2
            parts[e, GL], parts[e, GL + 1], parts[e, G1], parts[e, G2] = gl[0], gl[1], g1, g2
            d, g, x0, x1 = h22, g2, b2[0], b2[1]
            c00, c01, c11 = c00 + cc0, c01 + cc1, c11 + cc2
            r0, r1 = r0 + gl[0], r1 + gl[1]
    rows[elements, D], rows[elements, G], rows[elements, B], rows[elements, B + 1] = d, g, x0, x1
    sums[6], sums[7], sums[8], sums[9], sums[10] = c00, c01, c11, r0, r1


@kernel(fastmath=FAST)
def gradient(
    z: Array, lam: Pair, h: Array, load: Array, rest: Array, K: float, C: Pair, rows: Array, parts: Array, sums: Array
) -> float:  # fmt: skip
    """Fills G of rows, first derivatives of parts and the sum of those in lambda; returns the functional's value."""
    elements = h.shape[0]
    value = g = r0 = r1 = 0.0
    lanes = np.empty(ROWS * LANES)
    for begin in range(0, elements, LANES):
        count = gather(begin, z, lam, h, load, rest, lanes)
        gradients(lanes, K, C)
        for k in range(count):
            e = begin + k
            (g1, g2), gl = lane2(lanes, planar_lanes.G1, k), lane2(lanes, planar_lanes.GL, k)
            rows[e, G] = g + g1
            parts[e, GL], parts[e, GL + 1], parts[e, G1], parts[e, G2] = gl[0], gl[1], g1, g2
            g = g2
            value, r0, r1 = value + lanes[VALUE * LANES + k], r0 + gl[0], r1 + gl[1]
    rows[elements, G] = g
    sums[9], sums[10] = r0, r1
    return value


@kernel(fastmath=FAST)
def factor(h: Array, shift: float, last: int, rows: Array, parts: Array, sums: Array) -> int:
    """Factors H + shift diag(mean element length) of nodes 1 to last; returns the number of negative eigenvalues."""
    elements = h.shape[0]
    negative = 0
    pivot = rows[1, D]
    w0, w1, wg = rows[1, B], rows[1, B + 1], rows[1, G]
    s00 = s01 = s11 = s0g = s1g = 0.0
    for k in range(1, last + 1):
        pivot += 0.5 * shift * (h[k - 1] + (h[k] if k < elements else 0.0))
        if pivot < 0.0:
            negative += 1
        inverse = 1.0 / pivot
        rows[k, INVERSE], rows[k, W], rows[k, W + 1], rows[k, W + 2] = inverse, w0, w1, wg
        y0, y1 = inverse * w0, inverse * w1
        s00, s01, s11, s0g, s1g = s00 + y0 * w0, s01 + y0 * w1, s11 + y1 * w1, s0g + y0 * wg, s1g + y1 * wg
        if k < last:
            y = inverse * parts[k, H12]
            parts[k, Y] = y
            pivot = rows[k + 1, D] - y * parts[k, H12]
            w0, w1, wg = rows[k + 1, B] - y * w0, rows[k + 1, B + 1] - y * w1, rows[k + 1, G] - y * wg
    sums[0], sums[1], sums[2], sums[3], sums[4] = s00, s01, s11, s0g, s1g
    return negative


@kernel(fastmath=FAST)
def forward(last: int, rows: Array, parts: Array, sums: Array) -> None:
    """Eliminates another right-hand side, G of rows, with the factors at hand."""
    s0 = s1 = w = 0.0
    for k in range(1, last + 1):
        w = rows[k, G] - (parts[k - 1, Y] * w if k > 1 else 0.0)
        rows[k, W + 2] = w
        y = rows[k, INVERSE] * w
        s0, s1 = s0 + rows[k, W] * y, s1 + rows[k, W + 1] * y
    sums[3], sums[4] = s0, s1


@kernel
def border(held: bool, sums: Array) -> tuple[Pair, int]:
    """The change of lambda, and the number of negative eigenvalues of the Schur complement; nothing at a free end."""
    if not held:
        return (0.0, 0.0), 0
    a, b, c = sums[6] - sums[0], sums[7] - sums[1], sums[8] - sums[2]
    f, g = sums[3] - sums[9], sums[4] - sums[10]
    det = a * c - b * b
    negative = 1 if det < 0.0 else 2 if a + c < 0.0 else 0
    return ((c * f - b * g) / det, (a * g - b * f) / det), negative


@kernel(fastmath=FAST)
def backward(last: int, step: Pair, rows: Array, parts: Array) -> float:
    """Fills the change, -H^-1 (G + B step), by back substitution; returns its largest size."""
    largest = d = 0.0
    for k in range(last, 0, -1):
        x = rows[k, INVERSE] * (rows[k, W + 2] + rows[k, W] * step[0] + rows[k, W + 1] * step[1])
        d = -x - (parts[k, Y] * d if k < last else 0.0)
        rows[k, CHANGE] = d
        if not abs(d) <= largest:  # NaN is the largest of all
            largest = abs(d)
    rows[0, CHANGE] = 0.0
    if last < rows.shape[0] - 1:
        rows[last + 1, CHANGE] = 0.0
    return largest


@inlined
def respond(last: int, held: bool, rows: Array, parts: Array, sums: Array) -> Pair:
    """Solves for the change of the angles and of lambda, which is returned, with the factors at hand."""
    forward(last, rows, parts, sums)
    step, _ = border(held, sums)
    backward(last, step, rows, parts)
    return step
