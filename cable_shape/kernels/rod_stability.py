"""How stable an equilibrium is: the smallest eigenvalue of its second variation, and how it answers the ends.

The second variation is that of the energy under the closure condition, against the integral of |delta|^2; eigenvalues
are in N (N m per rad^2 and m). The inertia of the shifted factors tells how many lie below minus the shift.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
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
    times,
)
from cable_shape.kernels.rod_drive import NOW, mesh_parts, slot
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.rod_factor import backward, border, factor, forward
from cable_shape.kernels.rod_system import assemble, forces
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any


@kernel
def refresh(par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, factored: bool) -> None:
    """Assembles, and factors if asked, the Newton matrix of the solution now."""
    _, h, load, rest, _, _ = mesh_parts(mesh, elements)
    q, lam, _ = slot(sol, elements, NOW)
    mask = par[9:15].reshape(2, 3)
    D, U, X, P, Y, W = matrices(work, elements, width)
    parts, first, _, _, gram, total, _ = vectors(work, elements, width)
    assemble(q, lam, h, load, rest, par[0:6], par[6:9], mask, D, U, X, parts, first, total)
    if factored:
        # far below what else is accurate, yet enough to leave a neutral mode finite
        factor(D, U, X, mask, 1e-4 * par[18], h, P, Y, W, gram)


@kernel
def smallest_eigenvalue(par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int) -> float:
    """Smallest eigenvalue [N] of the second variation of the solution now, to 1e-3 of itself, by bisection."""
    refresh(par, mesh, sol, work, elements, width, False)
    h = mesh_parts(mesh, elements)[1]
    D, U, X, P, Y, W = matrices(work, elements, width)
    _, _, _, _, gram, total, step = vectors(work, elements, width)
    mask = par[9:15].reshape(2, 3)
    unit = max(par[0], par[1], par[2]) / par[19] ** 2
    low = high = 0.0
    closure = np.zeros(3)
    for sign in (1.0, -1.0):
        # grow a shift until it changes the verdict: up if unstable, down if stable
        reach = 1e-3 * unit
        negative = factor(D, U, X, mask, par[18], h, P, Y, W, gram) + border(gram, total[3:], closure, step)
        if (negative > width - 1) != (sign > 0.0):
            continue
        low = 0.0
        for _ in range(60):
            negative = factor(D, U, X, mask, sign * reach, h, P, Y, W, gram) + border(gram, total[3:], closure, step)
            if (negative > width - 1) != (sign > 0.0):
                high = reach
                break
            low = reach
            reach *= 4.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            negative = factor(D, U, X, mask, sign * middle, h, P, Y, W, gram) + border(gram, total[3:], closure, step)
            if (negative > width - 1) != (sign > 0.0):
                high = middle
            else:
                low = middle
            if high - low < 1e-3 * high:
                break
        return -sign * 0.5 * (low + high)
    return math.nan


@inlined
def node_slope(q: Array, k: int, d: Vector, n: Vector, dl: Vector, C: Vector) -> Vector:
    """Change of r' = R V at node k under the rotation d (cable frame) and the change dl of the force."""
    R = rotation(get4(q, k))
    N = tapply(R, n)
    dN = add(cross(N, d), tapply(R, dl))
    return apply(R, add(cross(d, add(E3, times(C, N))), times(C, dN)))


@kernel
def sensitivity(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, points: int, out: Array
) -> None:  # fmt: skip
    """Fills out (points, 3, 12): change of the positions at fixed arc length with the two end frames.

    Columns: velocity and angular velocity of the start, then of the end; world axes. From the factors of the solution
    now: one back substitution a column. Between nodes by the cubic through the nodes' changes of r and r'.
    """
    refresh(par, mesh, sol, work, elements, width, True)
    s, h, load, _, _, _ = mesh_parts(mesh, elements)
    q, lam, _ = slot(sol, elements, NOW)
    mask = par[9:15].reshape(2, 3)
    C = (par[3], par[4], par[5])
    l3 = (lam[0], lam[1], lam[2])
    _, U, _, P, Y, W = matrices(work, elements, width)
    parts, first, G, d, gram, total, step = vectors(work, elements, width)
    closure = np.zeros(3)
    length = s[elements]
    for column in range(12):
        end = column // 6
        axis = column % 3
        turning = column % 6 >= 3
        e = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
        G[:, :] = 0.0
        closure[:] = 0.0
        held = (0.0, 0.0, 0.0)
        node = elements if end == 1 else 0
        if turning:
            local = tapply(rotation(get4(q, node)), e)
            held = (
                local[0] * (1.0 - mask[end, 0]),
                local[1] * (1.0 - mask[end, 1]),
                local[2] * (1.0 - mask[end, 2]),
            )
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
        elif width > 1:
            closure[axis] = 1.0 if end == 1 else -1.0
        forward(G, P, Y, W, gram)
        border(gram, total[3:], closure, step)
        backward(P, Y, W, step, d)
        dl = (step[0], step[1], step[2]) if width > 1 else (0.0, 0.0, 0.0)
        for i in range(3):
            d[node, i] += held[i]
        # from nodes to points
        r = e if (end == 0 and not turning) else (0.0, 0.0, 0.0)
        i = 0
        for k in range(elements):
            change = add(
                add(tapply(get9(parts, k, 9), get3(d, k)), tapply(get9(parts, k, 18), get3(d, k + 1))),
                apply(get9(parts, k, 27), dl),
            )
            rb = (r[0] - change[0], r[1] - change[1], r[2] - change[2])
            nL, _, nR = forces(load, k, l3)
            va, vb = node_slope(q, k, get3(d, k), nL, dl, C), node_slope(q, k + 1, get3(d, k + 1), nR, dl, C)
            while i < points:
                at = i * length / (points - 1)
                if at >= s[k + 1] and k < elements - 1:
                    break
                x = (at - s[k]) / h[k]
                z = 1.0 - x
                p = add(
                    add(scale(z * z * (1.0 + 2.0 * x), r), scale(z * z * x * h[k], va)),
                    add(scale(x * x * (3.0 - 2.0 * x), rb), scale(-x * x * z * h[k], vb)),
                )
                out[i, 0, column], out[i, 1, column], out[i, 2, column] = p
                i += 1
            r = rb
