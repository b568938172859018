"""The answers of :mod:`cable_shape.kernels.response` after a planar solve, from the factors that it has left.

Rotations about the plane's normal and those about nu and t decouple, see :mod:`cable_shape.kernels.planar_across`, so
that each back substitution is one in scalars and one in 2x2 blocks. The factors are of a point within
`rod_newton.CHORD_FROM` of the solution in the plane, and of the solution itself out of it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_across import (
    B11,
    B12,
    B21,
    B22,
    CC,
    COLUMNS,
    D1,
    D2,
    G1,
    G2,
    Y11,
    Y12,
    Y21,
    Y22,
    respond_across,
)
from cable_shape.kernels.planar_system import B1, B2, CHANGE, H12, NORMAL_X, NORMAL_Y, G, behind, layout, respond
from cable_shape.kernels.planar_system import CC as CC_IN
from cable_shape.kernels.response import NOISE, between, disturb
from cable_shape.kernels.rod_algebra import Vector, add, apply, cross, dot, get4, inlined, rotation, scale, tapply
from cable_shape.kernels.rod_drive import NOW, mesh_parts, slot

Array = Any


@inlined
def parts_of(v: Vector, x: float, y: float) -> Vector:
    """The parts of a rotation in the cable frame about the normal (x, y, 0), about nu and about the tangent."""
    return (x * v[0] + y * v[1], y * v[0] - x * v[1], v[2])


@kernel
def smallest_eigenvalue(
    par: Array, mesh: Array, work: Array, elements: int, width: int, mode: Array, steps: int
) -> tuple[float, float]:  # fmt: skip
    """As `response.smallest_eigenvalue` with the factors at hand."""
    s, h, _, _, _, _ = mesh_parts(mesh, elements)
    _, _, _, _, rows, parts, _, sums = layout(work, elements)
    across = behind(work, elements, COLUMNS)
    held = width > 1
    last = elements - 1 if held else elements
    x, y = sums[NORMAL_X], sums[NORMAL_Y]
    value, at = math.nan, 0.0
    disturb(mode, NOISE / math.sqrt(par[19]))
    for _ in range(steps):
        for k in range(1, last + 1):
            size = 0.5 * (h[k - 1] + (h[k] if k < elements else 0.0))
            a, b, c = parts_of((mode[k, 0], mode[k, 1], mode[k, 2]), x, y)
            rows[k, G], across[k, G1], across[k, G2] = -size * a, -size * b, -size * c
        sums[9] = sums[10] = 0.0
        respond(last, held, rows, parts, sums)
        respond_across(last, held, 0.0, across)
        up = down = largest = 0.0
        for k in range(1, last + 1):
            size = 0.5 * (h[k - 1] + (h[k] if k < elements else 0.0))
            d, d1, d2 = rows[k, CHANGE], across[k, D1], across[k, D2]
            a, b, c = parts_of((mode[k, 0], mode[k, 1], mode[k, 2]), x, y)
            up += size * (d * a + d1 * b + d2 * c)
            turn = d * d + d1 * d1 + d2 * d2
            down += size * turn
            if turn > largest:
                largest, at = turn, s[k]
        if not (down > 0.0 and math.isfinite(down)):
            return math.nan, 0.0
        value, unit = up / down, 1.0 / math.sqrt(down)
        for k in range(1, last + 1):
            d, d1, d2 = unit * rows[k, CHANGE], unit * across[k, D1], unit * across[k, D2]
            mode[k, 0], mode[k, 1], mode[k, 2] = x * d + y * d1, y * d - x * d1, d2
        mode[0, :] = 0.0
        if held:
            mode[elements, :] = 0.0
    return value, at


@kernel
def velocities(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, twists: Array, at: Array
) -> Array:  # fmt: skip
    """As `response.velocities`."""
    q, _, _ = slot(sol, elements, NOW)
    _, _, _, _, rows, parts, _, sums = layout(work, elements)
    across = behind(work, elements, COLUMNS)
    held = width > 1
    last = elements - 1 if held else elements
    x, y = sums[NORMAL_X], sums[NORMAL_Y]
    R = rotation(get4(q, 0))
    e1, e = (R[2], R[5], R[8]), apply(R, (x, y, 0.0))
    e2 = cross(e, e1)
    first = parts_of(tapply(R, (twists[3], twists[4], twists[5])), x, y)
    rows[:, G] = 0.0
    across[:, G1] = 0.0
    across[:, G2] = 0.0
    rows[1, G] = parts[0, H12] * first[0]
    across[1, G1] = across[0, Y11] * first[1] + across[0, Y21] * first[2]
    across[1, G2] = across[0, Y12] * first[1] + across[0, Y22] * first[2]
    end = (0.0, 0.0, 0.0)
    gap = 0.0
    if held:
        k = elements - 1
        end = parts_of(tapply(rotation(get4(q, elements)), (twists[9], twists[10], twists[11])), x, y)
        rows[k, G] += parts[k, H12] * end[0]
        across[k, G1] += across[elements, Y11] * end[1] + across[elements, Y12] * end[2]
        across[k, G2] += across[elements, Y21] * end[1] + across[elements, Y22] * end[2]
        apart = (twists[6] - twists[0], twists[7] - twists[1], twists[8] - twists[2])
        sums[9] = parts[0, B1] * first[0] + parts[k, B2] * end[0] + dot(apart, e1)
        sums[10] = parts[0, B1 + 1] * first[0] + parts[k, B2 + 1] * end[0] + dot(apart, e2)
        gap = across[0, B11] * first[1] + across[0, B12] * first[2] + dot(apart, e)
        gap += across[k, B21] * end[1] + across[k, B22] * end[2]
    l1, l2 = respond(last, held, rows, parts, sums)
    l3 = respond_across(last, held, gap, across)
    rows[0, CHANGE], across[0, D1], across[0, D2] = first
    if held:
        rows[elements, CHANGE], across[elements, D1], across[elements, D2] = end
    turns, moves = np.empty((elements + 1, 3)), np.empty((elements + 1, 3))
    moves[0, 0], moves[0, 1], moves[0, 2] = twists[0], twists[1], twists[2]
    for k in range(elements + 1):
        d, d1, d2 = rows[k, CHANGE], across[k, D1], across[k, D2]
        turns[k, 0], turns[k, 1], turns[k, 2] = x * d + y * d1, y * d - x * d1, d2
    for k in range(elements):
        a, b = rows[k, CHANGE], rows[k + 1, CHANGE]
        c1 = parts[k, B1] * a + parts[k, B2] * b + parts[k, CC_IN] * l1 + parts[k, CC_IN + 1] * l2
        c2 = parts[k, B1 + 1] * a + parts[k, B2 + 1] * b + parts[k, CC_IN + 1] * l1 + parts[k, CC_IN + 2] * l2
        c3 = across[k, B11] * across[k, D1] + across[k, B12] * across[k, D2] + across[k, CC] * l3
        c3 += across[k, B21] * across[k + 1, D1] + across[k, B22] * across[k + 1, D2]
        for i in range(3):
            moves[k + 1, i] = moves[k, i] - (c1 * e1[i] + c2 * e2[i] + c3 * e[i])
    dl = add(add(scale(l1, e1), scale(l2, e2)), scale(l3, e))
    return between(par, mesh, sol, elements, turns, dl, moves, at)
