"""How stable an equilibrium is: the smallest eigenvalue of its second variation.

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
    get4,
    inlined,
    rotation,
    tapply,
    times,
)
from cable_shape.kernels.rod_drive import NOW, mesh_parts, slot
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.rod_factor import border, factor
from cable_shape.kernels.rod_system import assemble
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
