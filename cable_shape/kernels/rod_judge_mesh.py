"""The small mesh on which a closed form is judged: few elements, in pairs, graded to the shape's boundary layers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import Vector, get3, inlined
from cable_shape.kernels.rod_guess import norm
from cable_shape.kernels.rod_mesh import element_loads, element_rest, equidistribute

Array = Any

#: Elements of a boundary layer of three decay lengths, and between the two, at least.
PER_LAYER, BETWEEN = 3.0, 6.0
MOST_ELEMENTS = 64
#: An element h is at most this times (GJ / (|n| curvature^2))^(1/4): from twice that on, a coarse bent element under
#: tension gains energy when its ends roll apart, and the pivots' signs say nothing.
ROLL_LIMIT = 1.4
ABSCISSAE = 65


@inlined
def mesh_parts(mesh: Array, elements: int) -> tuple[Array, Array, Array, Array]:
    """s (N + 1,), h (N,), load (N, 9), rest (N, 6)."""
    n = elements
    return (
        mesh[: n + 1],
        mesh[n + 1 : 2 * n + 1],
        mesh[2 * n + 1 : 11 * n + 1].reshape(n, 9),
        mesh[11 * n + 1 : 17 * n + 1].reshape(n, 6),
    )


@inlined
def layers(buffer: Array, points: int, bend: float, length: float) -> tuple[Vector, float, float]:
    """Force at the end, and the boundary layer sqrt(EI / |n|) at both ends [m], at most the length."""
    forces = buffer[11 * points : 14 * points].reshape(points, 3)
    n0, n1 = get3(forces, 0), get3(forces, points - 1)
    least = bend / (length * length)
    return n1, math.sqrt(bend / max(norm(n0), least)), math.sqrt(bend / max(norm(n1), least))


@kernel
def plan(
    par: Array, buffer: Array, points: int, fineness: float, stops: int, x: Array, density: Array
) -> tuple[int, float]:
    """Where the nodes of a mesh for this shape go: density (ABSCISSAE,) at x.

    Returns the number of elements, even, and the boundary layer [m]. fineness multiplies it; stops: nodes that must be.
    """
    length, bend = par[19], 0.5 * (par[0] + par[1])
    _, l0, l1 = layers(buffer, points, bend, length)
    reach0, reach1 = min(3.0 * l0, length), min(3.0 * l1, length)
    forces = buffer[11 * points : 14 * points].reshape(points, 3)
    curvature = buffer[8 * points : 11 * points].reshape(points, 3)
    total = 0.0
    for i in range(ABSCISSAE):
        x[i] = length * (0.5 - 0.5 * math.cos(math.pi * i / (ABSCISSAE - 1)))
        k = round(x[i] / length * (points - 1))
        u, n = get3(curvature, k), norm(get3(forces, k))
        between = max(BETWEEN / length, (n * (u[0] * u[0] + u[1] * u[1]) / par[2]) ** 0.25 / ROLL_LIMIT)
        layer = math.exp(-x[i] / reach0) / reach0 + math.exp((x[i] - length) / reach1) / reach1
        density[i] = fineness * (between + PER_LAYER * layer)
        if i > 0:
            total += 0.5 * (density[i - 1] + density[i]) * (x[i] - x[i - 1])
    return 2 * (math.ceil(0.5 * min(total, 4.0 * MOST_ELEMENTS)) + stops), min(l0, l1)


@kernel
def lay_out(
    mesh: Array, elements: int, x: Array, density: Array, stops: Array, ends: Array, points: Array, weights: Array,
    tip: Array, table: Array,
) -> None:  # fmt: skip
    """Fills `mesh` (17 N + 1,), each pair of its elements halving one; arguments as in `rod_mesh`."""
    s, h, load, rest = mesh_parts(mesh, elements)
    pairs = elements // 2
    coarse = np.empty(pairs + 1)
    equidistribute(x, density, stops, pairs, coarse)
    for k in range(pairs):
        s[2 * k] = coarse[k]
        s[2 * k + 1] = 0.5 * (coarse[k] + coarse[k + 1])
    s[elements] = coarse[pairs]
    element_loads(s, ends, points, weights, tip, h, load)
    element_rest(s, table, rest)
