"""How an equilibrium answers its two end frames: the twelve columns of its Jacobian, from one factorisation.

Moving both ends alike moves the cable with them, so that the columns of the start's velocity follow from the end's;
those need no forward elimination, being a change of the closure alone. Nine back substitutions are left.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.dead_moment import add_moment
from cable_shape.kernels.rod_algebra import (
    FAST,
    Matrix,
    Vector,
    add,
    apply,
    cross,
    get3,
    get4,
    get9,
    inlined,
    put3,
    rotation,
    scale,
    tapply,
)
from cable_shape.kernels.rod_drive import NOW, mesh_parts, slot
from cable_shape.kernels.rod_factor import backward, border, forward
from cable_shape.kernels.rod_stability import node_slope, refresh
from cable_shape.kernels.rod_system import forces
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any
COLUMNS = 12
START, START_TURN, END = 0, 3, 6  # first column of each end's velocity and angular velocity


@kernel
def sensitivity(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, points: int, out: Array
) -> None:  # fmt: skip
    """Fills out (points, 3, 12): change of the positions at fixed arc length with the two end frames.

    Columns: velocity and angular velocity of the start, then of the end; world axes.
    """
    refresh(par, mesh, sol, work, elements, width, True)
    s, h, load, _, _, _ = mesh_parts(mesh, elements)
    q, lam, _ = slot(sol, elements, NOW)
    l3 = (lam[0], lam[1], lam[2])
    parts = vectors(work, elements, width)[0]
    turns = np.zeros((COLUMNS, elements + 1, 3))  # of the nodes, cable frame
    pull = np.zeros((COLUMNS, 3))  # change of lambda
    solve_columns(q, par[6:9], par[9:15].reshape(2, 3), work, elements, width, turns, pull)
    places = np.zeros((elements + 1, 3, COLUMNS))
    slopes = np.empty((2, elements, 3, COLUMNS))
    for i in range(3):
        places[0, i, START + i] = 1.0
    C = (par[3], par[4], par[5])
    for k in range(elements):
        nL, _, nR = forces(load, k, l3)
        for c in range(START_TURN, COLUMNS):
            da, db, dl = get3(turns[c], k), get3(turns[c], k + 1), get3(pull, c)
            step = add(
                add(tapply(get9(parts, k, 9), da), tapply(get9(parts, k, 18), db)), apply(get9(parts, k, 27), dl)
            )
            va, vb = node_slope(q, k, da, nL, dl, C), node_slope(q, k + 1, db, nR, dl, C)
            for i in range(3):
                places[k + 1, i, c] = places[k, i, c] - step[i]
                slopes[0, k, i, c], slopes[1, k, i, c] = va[i], vb[i]
        for i in range(3):
            for c in range(3):
                places[k + 1, i, START + c] = (1.0 if i == c else 0.0) - places[k + 1, i, END + c]
                slopes[0, k, i, START + c] = -slopes[0, k, i, END + c]
                slopes[1, k, i, START + c] = -slopes[1, k, i, END + c]
    wide = 3 * COLUMNS
    spread(
        s, h, places.reshape(elements + 1, wide), slopes.reshape(2, elements, wide), points, out.reshape(points, wide)
    )  # fmt: skip


@kernel
def solve_columns(
    q: Array, moment: Array, mask: Array, work: Array, elements: int, width: int, turns: Array, pull: Array
) -> None:  # fmt: skip
    """The columns from START_TURN on: turns (12, N+1, 3) of the nodes, change of lambda (12, 3); both zero at first."""
    _, U, _, P, Y, W = matrices(work, elements, width)
    parts, first, G, _, gram, total, step = vectors(work, elements, width)
    closure = np.zeros(3)
    G[:, :] = 0.0
    if width > 1:
        forward(G, P, Y, W, gram)
        for i in range(3):
            closure[:] = 0.0
            closure[i] = 1.0
            border(gram, total[3:], closure, step)
            backward(P, Y, W, step, turns[END + i])
            pull[END + i] = step[:3]
    for end in range(2):
        node = elements * end
        R = rotation(get4(q, node))
        for axis in range(3):
            column = START_TURN + 6 * end + axis
            held = own_turn(R, axis, mask[end])
            if held == (0.0, 0.0, 0.0):
                continue
            if end == 0:
                put3(G, 1, 0, tapply(get9(U, 0, 0), held))
                change = tapply(get9(parts, 0, 9), held)
                reaction = (first[0, 3], first[0, 4], first[0, 5])
                own = apply(get9(total[12:21].reshape(1, 9), 0, 0), held)
            else:
                put3(G, elements - 1, 0, apply(get9(U, elements - 1, 0), held))
                change = tapply(get9(parts, elements - 1, 18), held)
                reaction = (first[elements - 1, 6], first[elements - 1, 7], first[elements - 1, 8])
                own = apply(get9(parts, elements - 1, 0), held)
            # the frame in which the free rotations of this node are in balance turns, too
            put3(G, node, 0, add(own, scale(0.5, cross(reaction, held))))
            for i in range(3):
                closure[i] = change[i]
                G[0, i] *= mask[0, i]
                G[elements, i] *= mask[1, i]
            forward(G, P, Y, W, gram)
            border(gram, total[3:], closure, step)
            backward(P, Y, W, step, turns[column])
            if width == 1 and add_moment(q, moment, P, G, turns[column]):
                forward(G, P, Y, W, gram)
                backward(P, Y, W, step, turns[column])
            for i in range(3):
                turns[column, node, i] += held[i]
                G[0, i] = G[1, i] = G[elements - 1, i] = G[elements, i] = 0.0
            if width > 1:
                pull[column] = step[:3]


@inlined
def own_turn(R: Matrix, axis: int, free: Array) -> Vector:
    """A turn about a world axis in the cable frame, without the parts that a grip leaves free."""
    x = (R[3 * axis], R[3 * axis + 1], R[3 * axis + 2])
    return x[0] * (1.0 - free[0]), x[1] * (1.0 - free[1]), x[2] * (1.0 - free[2])


@kernel(fastmath=FAST)
def spread(s: Array, h: Array, places: Array, slopes: Array, points: int, out: Array) -> None:
    """From nodes to points: the cubic through the nodes' changes of r (N+1, m) and r' (2, N, m), left and right."""
    elements, columns = h.shape[0], out.shape[1]
    apart = s[elements] / (points - 1)
    k = 0
    for i in range(points):
        at = i * apart
        while k < elements - 1 and at >= s[k + 1]:
            k += 1
        x = (at - s[k]) / h[k]
        z = 1.0 - x
        a, b = z * z * (1.0 + 2.0 * x), z * z * x * h[k]
        c, d = x * x * (3.0 - 2.0 * x), -x * x * z * h[k]
        for j in range(columns):
            out[i, j] = a * places[k, j] + b * slopes[0, k, j] + c * places[k + 1, j] + d * slopes[1, k, j]
