"""The rod's Newton system on a mesh of N elements: gradient, block tridiagonal Hessian and border.

Arrays, for nb border columns (3: the multiplier lambda of a held end; 0: a free end, where the force is known):

    q      (N+1, 4)         node quaternions
    h      (N,)             element lengths [m]
    load   (N, 9)           world force at the left, middle and right of each element, lambda not included [N]
    rest   (N, 6)           rest curvature at the middle and its slope [1/m, 1/m^2]
    stiff  (6,)             K and C
    D      (N+1, 9)         diagonal blocks
    U      (N, 9)           blocks right of the diagonal
    X      (N+1, 3 (nb+1))  rows of the border columns, then of the gradient: column c of row i is X[:, (nb+1) i + c]
    parts  (N, 36)          per element: H22, B1, B2, CC
    first  (N, 9)           per element: derivatives in lambda (minus the step in position), delta_1, delta_2 (-M, +M)

Rotations held at an end are taken out by a mask (2, 3) of ones (free) and zeros (held).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    get4,
    hat,
    inlined,
    put3,
    rotation,
    tapply,
)
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

Array = Any


@inlined
def forces(load: Array, e: int, lam: Vector) -> tuple[Vector, Vector, Vector]:
    """The internal force at the left, middle and right of element e."""
    return (
        (load[e, 0] + lam[0], load[e, 1] + lam[1], load[e, 2] + lam[2]),
        (load[e, 3] + lam[0], load[e, 4] + lam[1], load[e, 5] + lam[2]),
        (load[e, 6] + lam[0], load[e, 7] + lam[1], load[e, 8] + lam[2]),
    )


@inlined
def jumps(load: Array, e: int) -> bool:
    """Whether the internal force jumps where element e > 0 begins."""
    miss = size = 0.0
    for i in range(3):
        miss += abs(load[e, i] - load[e - 1, 6 + i])
        size += abs(load[e, i]) + abs(load[e - 1, i])
    return miss > 1e-9 * size


@kernel
def assemble(
    q: Array, lam: Array, h: Array, load: Array, rest: Array, stiff: Array, moment: Array, mask: Array,
    D: Array, U: Array, X: Array, parts: Array, first: Array, total: Array,
) -> None:  # fmt: skip
    """Fills D, U, X, parts, first, and total (21,): the sum over elements of the lambda
    derivative and of CC, and the first diagonal block as it is before held rotations are taken out.

    moment (3,) [N m], world: dead moment at s = L; it makes the last diagonal block unsymmetric.
    """
    elements = h.shape[0]
    width = X.shape[1] // 3
    nb = width - 1
    l3 = (lam[0], lam[1], lam[2])
    total[:] = 0.0
    for c in range(9):
        D[0, c] = 0.0
    for c in range(3 * width):
        X[0, c] = 0.0
    lanes = np.empty(ROWS * LANES)
    one_section(stiff, lanes)
    elastic = stiff[3] != 0.0 or stiff[5] != 0.0
    for begin in range(0, elements, LANES):
        count = gather(begin, q, l3, h, load, rest, lanes)
        hessians(lanes, elastic)
        for k in range(count):
            e = begin + k
            for c in range(9):
                i = c * LANES + k
                D[e, c] += lanes[H11 * LANES + i]
                D[e + 1, c] = parts[e, c] = lanes[H22 * LANES + i]
                U[e, c] = lanes[H12 * LANES + i]
                parts[e, 9 + c] = lanes[B1 * LANES + i]
                parts[e, 18 + c] = lanes[B2 * LANES + i]
                parts[e, 27 + c] = lanes[CC * LANES + i]
                total[3 + c] += lanes[CC * LANES + i]
            g1, g2, gl = lane3(lanes, G1, k), lane3(lanes, G2, k), lane3(lanes, GL, k)
            for i in range(3):
                if nb > 0:
                    for c in range(3):
                        X[e, width * i + c] += lanes[(B1 + 3 * i + c) * LANES + k]
                        X[e + 1, width * i + c] = lanes[(B2 + 3 * i + c) * LANES + k]
                X[e, width * i + nb] += g1[i]
                X[e + 1, width * i + nb] = g2[i]
                total[i] += gl[i]
            put3(first, e, 0, gl)
            put3(first, e, 3, g1)
            put3(first, e, 6, g2)
    for c in range(9):
        total[12 + c] = D[0, c]
    end_moment(q, moment, D, X, elements, width)
    hold(D, X, mask, 0, 0)
    hold(D, X, mask, elements, 1)


@inlined
def end_moment(q: Array, moment: Array, D: Array, X: Array, node: int, width: int) -> None:
    """A dead moment: minus R^T moment in the gradient, and its derivative."""
    if moment[0] != 0.0 or moment[1] != 0.0 or moment[2] != 0.0:
        M = tapply(rotation(get4(q, node)), (moment[0], moment[1], moment[2]))
        spin = hat(M)
        for c in range(9):
            D[node, c] -= spin[c]
        for i in range(3):
            X[node, width * i + width - 1] -= M[i]


@inlined
def hold(D: Array, X: Array, mask: Array, node: int, end: int) -> None:
    """Replaces the rows and columns of held rotations by those of the identity."""
    width = X.shape[1] // 3
    for i in range(3):
        if mask[end, i] == 0.0:
            for j in range(3):
                D[node, 3 * i + j] = 0.0
                D[node, 3 * j + i] = 0.0
            D[node, 4 * i] = 1.0
            for c in range(width):
                X[node, width * i + c] = 0.0


@kernel
def gradient(
    q: Array, lam: Array, h: Array, load: Array, rest: Array, stiff: Array, moment: Array, mask: Array,
    G: Array, first: Array, total: Array,
) -> float:  # fmt: skip
    """Fills G (N+1, 3), first, total[:3]; returns the value of the functional without lambda . (r_L - r_0)."""
    elements = h.shape[0]
    l3 = (lam[0], lam[1], lam[2])
    t0 = t1 = t2 = value = 0.0
    left = (0.0, 0.0, 0.0)
    lanes = np.empty(ROWS * LANES)
    one_section(stiff, lanes)
    for begin in range(0, elements, LANES):
        count = gather(begin, q, l3, h, load, rest, lanes)
        gradients(lanes)
        for k in range(count):
            e = begin + k
            g1, g2, gl = lane3(lanes, G1, k), lane3(lanes, G2, k), lane3(lanes, GL, k)
            value += lanes[VALUE * LANES + k]
            put3(G, e, 0, add(left, g1))
            put3(first, e, 0, gl)
            put3(first, e, 3, g1)
            put3(first, e, 6, g2)
            left = g2
            t0 += gl[0]
            t1 += gl[1]
            t2 += gl[2]
    M = tapply(rotation(get4(q, elements)), (moment[0], moment[1], moment[2]))
    put3(G, elements, 0, (left[0] - M[0], left[1] - M[1], left[2] - M[2]))
    for i in range(3):
        G[0, i] *= mask[0, i]
        G[elements, i] *= mask[1, i]
    total[0], total[1], total[2] = t0, t1, t2
    return value
