"""How an equilibrium answers a change of its cable: its positions by stiffness, length and rest curvature.

The gradient F(q, lambda; p) is zero at an equilibrium, so that a parameter p moves it by -(dF/d(q, lambda))^-1 dF/dp:
one back substitution with the factors at hand. dF/dp is the difference of F between two cables beside this one, at the
same frames and force on the same nodes: no equilibrium of theirs is sought, and what it leaves is rounding.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.dead_moment import add_moment
from cable_shape.kernels.inertia import add_inertia
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    get3,
    get4,
    get9,
    inlined,
    rotation,
    scale,
    subtract,
    tapply,
    times,
)
from cable_shape.kernels.rod_drive import NOW, mesh_parts, slot
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.rod_factor import backward, border, forward
from cable_shape.kernels.rod_mesh import element_loads, element_rest
from cable_shape.kernels.rod_stability import node_slope
from cable_shape.kernels.rod_system import forces, gradient
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any
_SAME = 1e-9  # of the length: a node nearer to a concentrated load carries it


@kernel
def neighbours(
    mesh: Array, elements: int, lengths: Array, tables: Array, ends: Array, points: Array, weights: Array,
    swing: Array, density: float,
) -> Array:  # fmt: skip
    """(k, 21 N + 1): the meshes of k cables of `lengths` (k,) [m] and rest curvature `tables` (k, m, 3) [1/m].

    Nodes keep their share of the length, those that carry a concentrated load their arc length. ends, points, weights:
    as of `rod_mesh.element_loads`; swing (j, 3) [m/s^2]: of `inertia.add_inertia`, without rows if there is none;
    density [kg/m].
    """
    s, _, load, _, _, _ = mesh_parts(mesh, elements)
    out = np.zeros((lengths.shape[0], mesh.shape[0]))
    tip = load[elements - 1, 6:9].copy()  # all that hangs beyond the last element
    for c in range(lengths.shape[0]):
        own, h, own_load, rest, _, _ = mesh_parts(out[c], elements)
        for k in range(elements + 1):
            own[k] = s[k] * (lengths[c] / s[elements])
            for p in range(points.shape[0]):
                if abs(s[k] - points[p]) < _SAME * s[elements]:
                    own[k] = s[k]
        own[elements] = lengths[c]
        element_loads(own, ends, points, weights, tip, h, own_load)
        if swing.shape[0] > 0:
            add_inertia(own, swing, density, own_load)
        element_rest(own, tables[c], rest)
    return out


@inlined
def slope_at(q: Array, k: int, n: Vector, C: Vector) -> Vector:
    """r' = R V at node k under the force n."""
    R = rotation(get4(q, k))
    return apply(R, add(E3, times(C, tapply(R, n))))


@kernel
def answers(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, stiff: Array, meshes: Array,
    steps: Array, points: int, out: Array,
) -> None:  # fmt: skip
    """Fills out (points, 3, k): change of the positions at the same share of the length, the ends being held still.

    stiff (2 k, 6), meshes (2 k, 21 N + 1): K and C, and the mesh (see `neighbours`) of two cables for each parameter,
    steps (k,) of it above and below this one. work: with fresh factors of the solution now.
    """
    s, h, load, _, _, _ = mesh_parts(mesh, elements)
    q, lam, _ = slot(sol, elements, NOW)
    mask, C = par[9:15].reshape(2, 3), (par[3], par[4], par[5])
    l3 = (lam[0], lam[1], lam[2])
    _, _, _, P, Y, W = matrices(work, elements, width)
    parts, first, G, d, gram, total, step = vectors(work, elements, width)
    pull, along, closure = np.empty((2, elements + 1, 3)), np.empty((2, elements, 9)), np.empty((2, 3))
    places, slopes = np.zeros((elements + 1, 3)), np.empty((2, elements, 3))
    for j in range(steps.shape[0]):
        f = 0.5 / steps[j]
        a, b = 2 * j, 2 * j + 1
        sa, ha, load_a, rest_a, _, _ = mesh_parts(meshes[a], elements)
        sb, hb, load_b, rest_b, _, _ = mesh_parts(meshes[b], elements)
        gradient(q, lam, ha, load_a, rest_a, stiff[a], par[6:9], mask, pull[0], along[0], closure[0])
        gradient(q, lam, hb, load_b, rest_b, stiff[b], par[6:9], mask, pull[1], along[1], closure[1])
        for k in range(elements + 1):
            for i in range(3):
                G[k, i] = f * (pull[0, k, i] - pull[1, k, i])
        for i in range(3):
            closure[0, i] = f * (closure[0, i] - closure[1, i])
        forward(G, P, Y, W, gram)
        border(gram, total[3:], closure[0], step)
        backward(P, Y, W, step, d)
        if width == 1 and add_moment(q, par[6:9], P, G, d):
            forward(G, P, Y, W, gram)
            backward(P, Y, W, step, d)
        dl = (step[0], step[1], step[2]) if width > 1 else (0.0, 0.0, 0.0)
        Ca, Cb = (stiff[a, 3], stiff[a, 4], stiff[a, 5]), (stiff[b, 3], stiff[b, 4], stiff[b, 5])
        for k in range(elements):
            da, db = get3(d, k), get3(d, k + 1)
            change = add(
                add(tapply(get9(parts, k, 9), da), tapply(get9(parts, k, 18), db)), apply(get9(parts, k, 27), dl)
            )
            change = add(change, scale(f, subtract(get3(along[0], k), get3(along[1], k))))
            nL, _, nR = forces(load, k, l3)
            la, _, ra = forces(load_a, k, l3)
            lb, _, rb = forces(load_b, k, l3)
            left = add(
                node_slope(q, k, da, nL, dl, C), scale(f, subtract(slope_at(q, k, la, Ca), slope_at(q, k, lb, Cb)))
            )
            right = add(
                node_slope(q, k + 1, db, nR, dl, C),
                scale(f, subtract(slope_at(q, k + 1, ra, Ca), slope_at(q, k + 1, rb, Cb))),
            )
            for i in range(3):
                places[k + 1, i] = places[k, i] - change[i]
                slopes[0, k, i], slopes[1, k, i] = left[i], right[i]
        k, met = 0, -1
        ta = tb = (0.0, 0.0, 0.0)
        dh = 0.0
        for m in range(points):
            share = m / (points - 1)
            at = share * s[elements]
            while k < elements - 1 and at >= s[k + 1]:
                k += 1
            if k != met:
                nL, _, nR = forces(load, k, l3)
                ta, tb, dh, met = slope_at(q, k, nL, C), slope_at(q, k + 1, nR, C), f * (ha[k] - hb[k]), k
            x = (at - s[k]) / h[k]
            z = 1.0 - x
            # the point moves in its element where nodes do not keep their share of the length
            shift = f * (share * (sa[elements] - sb[elements]) - (sa[k] - sb[k])) - x * dh
            for i in range(3):
                value = z * z * (1.0 + 2.0 * x) * places[k, i] + x * x * (3.0 - 2.0 * x) * places[k + 1, i]
                value += z * z * x * (h[k] * slopes[0, k, i] + dh * ta[i])
                value -= x * x * z * (h[k] * slopes[1, k, i] + dh * tb[i])
                slope = -6.0 * x * z * first[k, i] / h[k] + z * (1.0 - 3.0 * x) * ta[i] + x * (3.0 * x - 2.0) * tb[i]
                out[m, i, j] = value + shift * slope
