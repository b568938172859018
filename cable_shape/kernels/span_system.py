"""Newton's system of a rod in spans: gradient, block tridiagonal Hessian, and what couples it to each span's force.

Between two supports the internal force is n(s) = loads beyond s + lambda_j: a free constant of its own in every span,
for a support may push as it likes. The force by which support j acts on the cable is lambda_j - lambda_{j+1}.
Stationary is the elements' functional plus sum lambda_j . (y_j - y_{j-1}), with the places y of the supports:

    full   (N, 9)    internal force at the left, middle and right of each element [N]
    D      (N+1, 9)  diagonal blocks            U  (N, 9)  blocks right of the diagonal
    G      (N+1, 3)  gradient in the rotations
    parts  (N, 36)   per element: H22, B1, B2, CC; B couples its two rotations to the force of its span
    first  (N, 9)    per element: derivatives in the force (minus the step in position), delta_1, delta_2 (-M, +M)
    sums   (m, 21)   per span: sums of the derivatives in its force (3) and of CC (9), and the first diagonal block
                     of its first element alone (9)

where (m+1,): node of each support. mask (m+1, 3): rotations there, 1 free and 0 held.
"""

from __future__ import annotations

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import add, get3, get4, hat, inlined, put3, rotation, tapply
from cable_shape.kernels.rod_lanes import (
    B1,
    B2,
    CC,
    G1,
    G2,
    GL,
    H11,
    H12,
    H22,
    LANES,
    ROWS,
    VALUE,
    gather,
    gradients,
    hessians,
    lane3,
    one_section,
)

NONE = (0.0, 0.0, 0.0)  # the spans' forces are folded into `full`


@kernel
def fold(load: Array, lam: Array, where: Array, full: Array) -> None:
    """full = load + the force of the span."""
    for j in range(lam.shape[0]):
        for e in range(where[j], where[j + 1]):
            for c in range(3):
                full[e, c] = load[e, c] + lam[j, c]
                full[e, 3 + c] = load[e, 3 + c] + lam[j, c]
                full[e, 6 + c] = load[e, 6 + c] + lam[j, c]


@kernel
def assemble(
    q: Array, full: Array, h: Array, rest: Array, stiff: Array, moment: Array, where: Array, mask: Array,
    D: Array, U: Array, G: Array, parts: Array, first: Array, sums: Array,
) -> None:  # fmt: skip
    """Fills D, U, G, parts, first and sums; D and G without the rotations that are held.

    stiff (6,): stiffness and compliance. moment (3,) [N m], world: dead moment at s = L; it makes the last diagonal
    block unsymmetric.
    """
    spans = sums.shape[0]
    elements = h.shape[0]
    for c in range(9):
        D[0, c] = 0.0
    put3(G, 0, 0, NONE)
    sums[:, :12] = 0.0
    j = 0
    lanes = np.empty(ROWS * LANES)
    one_section(stiff, lanes)
    elastic = stiff[3] != 0.0 or stiff[5] != 0.0
    for begin in range(0, elements, LANES):
        count = gather(begin, q, NONE, h, full, rest, lanes)
        hessians(lanes, elastic)
        for k in range(count):
            e = begin + k
            if e == where[j + 1]:
                j += 1
            for c in range(9):
                i = c * LANES + k
                D[e, c] += lanes[H11 * LANES + i]
                D[e + 1, c] = parts[e, c] = lanes[H22 * LANES + i]
                U[e, c] = lanes[H12 * LANES + i]
                parts[e, 9 + c] = lanes[B1 * LANES + i]
                parts[e, 18 + c] = lanes[B2 * LANES + i]
                parts[e, 27 + c] = lanes[CC * LANES + i]
                sums[j, 3 + c] += lanes[CC * LANES + i]
                if e == where[j]:
                    sums[j, 12 + c] = lanes[H11 * LANES + i]
            g1, g2, gl = lane3(lanes, G1, k), lane3(lanes, G2, k), lane3(lanes, GL, k)
            put3(G, e, 0, add(get3(G, e), g1))
            put3(G, e + 1, 0, g2)
            put3(first, e, 0, gl)
            put3(first, e, 3, g1)
            put3(first, e, 6, g2)
            for i in range(3):
                sums[j, i] += gl[i]
    if moment[0] != 0.0 or moment[1] != 0.0 or moment[2] != 0.0:
        M = tapply(rotation(get4(q, elements)), (moment[0], moment[1], moment[2]))
        spin = hat(M)
        for c in range(9):
            D[elements, c] -= spin[c]
        for i in range(3):
            G[elements, i] -= M[i]
    for j in range(spans + 1):
        hold(D, G, mask, where[j], j)


@inlined
def hold(D: Array, G: Array, mask: Array, node: int, support: int) -> None:
    """Replaces the rows and columns of held rotations by those of the identity."""
    for i in range(3):
        if mask[support, i] == 0.0:
            for c in range(3):
                D[node, 3 * i + c] = 0.0
                D[node, 3 * c + i] = 0.0
            D[node, 4 * i] = 1.0
            G[node, i] = 0.0


@kernel
def gradient(
    q: Array, full: Array, h: Array, rest: Array, stiff: Array, moment: Array, where: Array, mask: Array,
    G: Array, first: Array, sums: Array,
) -> float:  # fmt: skip
    """Fills G, first and sums[:, :3]; returns the value of the elements' functional."""
    elements = h.shape[0]
    value = 0.0
    left = NONE
    sums[:, :3] = 0.0
    j = 0
    lanes = np.empty(ROWS * LANES)
    one_section(stiff, lanes)
    for begin in range(0, elements, LANES):
        count = gather(begin, q, NONE, h, full, rest, lanes)
        gradients(lanes)
        for k in range(count):
            e = begin + k
            if e == where[j + 1]:
                j += 1
            g1, g2, gl = lane3(lanes, G1, k), lane3(lanes, G2, k), lane3(lanes, GL, k)
            value += lanes[VALUE * LANES + k]
            put3(G, e, 0, add(left, g1))
            put3(first, e, 0, gl)
            put3(first, e, 3, g1)
            put3(first, e, 6, g2)
            left = g2
            for i in range(3):
                sums[j, i] += gl[i]
    M = tapply(rotation(get4(q, elements)), (moment[0], moment[1], moment[2]))
    put3(G, elements, 0, (left[0] - M[0], left[1] - M[1], left[2] - M[2]))
    release(G, where, mask)
    return value


@kernel
def release(G: Array, where: Array, mask: Array) -> None:
    """Takes the held rotations out of a right-hand side G (N+1, 3)."""
    for j in range(where.shape[0]):
        for i in range(3):
            G[where[j], i] *= mask[j, i]
