"""How an equilibrium answers its moving ends, and how stable it is, at the price of a few back substitutions.

The cheap counterpart of :mod:`cable_shape.kernels.rod_stability`: one back substitution for the motion that the ends
make, instead of twelve for all that they could make; inverse iteration instead of bisection; and no factorisation where
that of the last solve will do.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.dead_moment import add_moment
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    cross,
    get3,
    get4,
    get9,
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
#: Noise in the mode that the iteration starts from: without it a mode of another symmetry would be overlooked.
NOISE = 0.02


@kernel
def smallest_eigenvalue(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, mode: Array, steps: int,
    fresh: bool,
) -> tuple[float, float]:  # fmt: skip
    """[N], of the second variation of the solution now, and the arc length [m] at which its mode turns most.

    By inverse iteration from `mode` (N+1, 3), which it improves: the eigenvalue nearest to zero, as Rayleigh's quotient
    in the measure of `rod_factor.factor`. NaN if the iteration breaks down. With fresh factors, or those that the last
    solve left in `work`, which are of a point within `rod_newton.CHORD_FROM` of the solution.
    """
    if fresh:
        refresh(par, mesh, sol, work, elements, width, True)
    s, h, _, _, _, _ = mesh_parts(mesh, elements)
    mask = par[9:15].reshape(2, 3)
    _, _, _, P, Y, W = matrices(work, elements, width)
    _, _, G, d, gram, total, step = vectors(work, elements, width)
    closure = total[:3]
    closure[:] = 0.0
    value, at = math.nan, 0.0
    disturb(mode, NOISE / math.sqrt(par[19]))
    for _ in range(steps):
        for k in range(elements + 1):
            size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < elements else 0.0))
            G[k, 0], G[k, 1], G[k, 2] = -size * mode[k, 0], -size * mode[k, 1], -size * mode[k, 2]
        for i in range(3):
            G[0, i] *= mask[0, i]
            G[elements, i] *= mask[1, i]
        forward(G, P, Y, W, gram)
        border(gram, total[3:], closure, step)
        backward(P, Y, W, step, d)
        up = down = largest = 0.0
        for k in range(elements + 1):
            size = 0.5 * ((h[k - 1] if k > 0 else 0.0) + (h[k] if k < elements else 0.0))
            turn = d[k, 0] * d[k, 0] + d[k, 1] * d[k, 1] + d[k, 2] * d[k, 2]
            up -= d[k, 0] * G[k, 0] + d[k, 1] * G[k, 1] + d[k, 2] * G[k, 2]
            down += size * turn
            if turn > largest:
                largest, at = turn, s[k]
        if not (down > 0.0 and math.isfinite(down)):
            return math.nan, 0.0
        value, unit = up / down, 1.0 / math.sqrt(down)
        for k in range(elements + 1):
            mode[k, 0], mode[k, 1], mode[k, 2] = unit * d[k, 0], unit * d[k, 1], unit * d[k, 2]
    return value, at


@kernel
def disturb(mode: Array, amplitude: float) -> None:
    """Adds noise up to `amplitude` to mode (N+1, 3), the same each time."""
    random = 1
    for k in range(mode.shape[0]):
        for i in range(3):
            random = (random * 1103515245 + 12345) & 0x7FFFFFFF
            mode[k, i] += amplitude * (random * (1.0 / 0x40000000) - 1.0)


@kernel
def velocities(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, twists: Array, at: Array
) -> Array:  # fmt: skip
    """(k, 3) [m/s]: how fast the points at arc lengths `at` (k,) [m] move with the ends.

    twists (12,): velocity [m/s] and angular velocity [rad/s] of the start, then of the end, world axes, about that
    cable end. With the factors in `work`, see `smallest_eigenvalue`. Between nodes by the cubic through the nodes'
    changes of r and r', as in `rod_sensitivity`.
    """
    q, _, _ = slot(sol, elements, NOW)
    mask = par[9:15].reshape(2, 3)
    _, U, _, P, Y, W = matrices(work, elements, width)
    parts, first, G, d, gram, total, step = vectors(work, elements, width)
    closure = total[:3]
    closure[:] = 0.0
    G[:, :] = 0.0
    held0 = held1 = (0.0, 0.0, 0.0)
    for end in range(2):
        node = elements if end == 1 else 0
        o = 6 * end
        local = tapply(rotation(get4(q, node)), (twists[o + 3], twists[o + 4], twists[o + 5]))
        held = (local[0] * (1.0 - mask[end, 0]), local[1] * (1.0 - mask[end, 1]), local[2] * (1.0 - mask[end, 2]))
        if end == 0:
            held0 = held
            put3(G, 1, 0, tapply(get9(U, 0, 0), held))
            change = tapply(get9(parts, 0, 9), held)
            reaction = (first[0, 3], first[0, 4], first[0, 5])
            own = apply(get9(total[12:21].reshape(1, 9), 0, 0), held)
        else:
            held1 = held
            put3(G, elements - 1, 0, add(get3(G, elements - 1), apply(get9(U, elements - 1, 0), held)))
            change = tapply(get9(parts, elements - 1, 18), held)
            reaction = (first[elements - 1, 6], first[elements - 1, 7], first[elements - 1, 8])
            own = apply(get9(parts, elements - 1, 0), held)
        # the frame in which the free rotations of this node are in balance turns, too
        put3(G, node, 0, add(own, scale(0.5, cross(reaction, held))))
        for i in range(3):
            closure[i] += change[i]
            G[node, i] *= mask[end, i]
            if width > 1:
                closure[i] += twists[o + i] if end == 1 else -twists[o + i]
    forward(G, P, Y, W, gram)
    border(gram, total[3:], closure, step)
    backward(P, Y, W, step, d)
    if width == 1 and add_moment(q, par[6:9], P, G, d):
        forward(G, P, Y, W, gram)
        backward(P, Y, W, step, d)
    dl = (step[0], step[1], step[2]) if width > 1 else (0.0, 0.0, 0.0)
    for i in range(3):
        d[0, i] += held0[i]
        d[elements, i] += held1[i]
    G[0, 0], G[0, 1], G[0, 2] = twists[0], twists[1], twists[2]
    for k in range(elements):
        change = add(
            add(tapply(get9(parts, k, 9), get3(d, k)), tapply(get9(parts, k, 18), get3(d, k + 1))),
            apply(get9(parts, k, 27), dl),
        )
        for i in range(3):
            G[k + 1, i] = G[k, i] - change[i]
    return between(par, mesh, sol, elements, d, dl, G, at)


@kernel
def between(
    par: Array, mesh: Array, sol: Array, elements: int, turns: Array, dl: Vector, moves: Array, at: Array
) -> Array:  # fmt: skip
    """(k, 3) [m/s]: the velocities at arc lengths `at` (k,) [m] from those of the nodes.

    turns (N+1, 3) [rad/s], cable frame, and moves (N+1, 3) [m/s] of the nodes; dl [N/s]: change of lambda.
    """
    s, h, load, _, _, _ = mesh_parts(mesh, elements)
    q, lam, _ = slot(sol, elements, NOW)
    C = (par[3], par[4], par[5])
    l3 = (lam[0], lam[1], lam[2])
    out = np.empty((at.shape[0], 3))
    for i in range(at.shape[0]):
        k = 0
        while k < elements - 1 and at[i] >= s[k + 1]:
            k += 1
        nL, _, nR = forces(load, k, l3)
        va = node_slope(q, k, get3(turns, k), nL, dl, C)
        vb = node_slope(q, k + 1, get3(turns, k + 1), nR, dl, C)
        x = (at[i] - s[k]) / h[k]
        z = 1.0 - x
        a, b = z * z * (1.0 + 2.0 * x), z * z * x * h[k]
        c, d = x * x * (3.0 - 2.0 * x), -x * x * z * h[k]
        for j in range(3):
            out[i, j] = a * moves[k, j] + b * va[j] + c * moves[k + 1, j] + d * vb[j]
    return out
