"""How far a shape in closed form is from the Cosserat rod, judged by its residual in the rod's equations.

Newton's method for the rod, on a small mesh, starts from the shape: from its tangents (with the exact bent end of a
taut rod where they miss a held grip), from frames that follow them without twist, the roll that is missing at the end
being spread, and from its force. One full step and one more with the same factors lead beside the rod. How far the
shape is from there is its model error, the second step says what is left, and the pivots' signs whether that rod is
stable.

The small mesh's own share comes from pairs of elements. Each pair halves one element of a mesh of half as many, whose
gradient, less that of the two, is a multiple of the pair's defect. Solved for with the factors at hand it gives the
error in position.
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
    dot,
    get3,
    get4,
    get9,
    inlined,
    put3,
    scale,
    subtract,
    tapply,
)
from cable_shape.kernels.rod_drive import wind
from cable_shape.kernels.rod_element import element_gradient
from cable_shape.kernels.rod_factor import backward, border, factor, forward
from cable_shape.kernels.rod_guess import angle_axis, carry_frames, norm, tangent, turned
from cable_shape.kernels.rod_judge_mesh import layers, mesh_parts
from cable_shape.kernels.rod_newton import advance
from cable_shape.kernels.rod_system import assemble, gradient
from cable_shape.kernels.rod_work import matrices, vectors

Array = Any

JUDGED, UNFIT, OTHER_MESH = 0, 1, 2
# Places in `verdict`.
DISTANCE, REMAINDER, MESH, STEP, LAYER, ASSEMBLIES = 0, 1, 2, 3, 4, 5
VERDICT = 6

#: Newton steps with new factors; they end when what is left is below CLOSE of the distance, and must reach ENOUGH.
MOST_STEPS, CLOSE, ENOUGH = 3, 0.1, 0.3
#: [rad], longest step from which the next is trusted. What is left after it limits estimates long before: few come with
#: a last step above 0.2, too few to say more than that none of those was too low.
LONGEST_STEP = 1.0
#: Of the length, or rad: an end that moves further between two shapes may have led to another branch.
JUMP = 0.2
#: Another mesh is asked for when the boundary layer has changed by this factor.
CHANGED = 1.3
#: Distance of a shape's points in boundary layers beyond which the layer falls between them.
COARSE = 0.8
#: Turns of a tangent below SEEN [rad] are left out, and boundary layers beyond PASSED decay lengths.
SEEN, PASSED = 1e-7, 20.0
#: What a pair of elements is off by, as a fraction of what one in its place is off from the pair: Richardson's 1/15
#: twice, since boundary layers of so few elements are not yet resolved to fourth order.
PAIR = 2.0 / 15.0


@kernel
def read_off(buffer: Array, points: int, s: Array, l0: float, l1: float, t: Array, x: Array, there: Array) -> None:
    """Unit tangents t and positions x (N+1, 3) of a shape at arc lengths s: cubic between its points.

    Where a boundary layer falls between two points, the tangents are those outside of it, along the force, and `there`
    is 0 at nodes without a position.
    """
    last = points - 1
    step = buffer[last] / last
    positions = buffer[points : 4 * points].reshape(points, 3)
    frames = buffer[4 * points : 8 * points].reshape(points, 4)
    forces = buffer[11 * points : 14 * points].reshape(points, 3)
    coarse0, coarse1 = step > COARSE * l0, step > COARSE * l1
    for k in range(s.shape[0]):
        i = min(int(s[k] / step), last - 1)
        y = s[k] / step - i
        z = 1.0 - y
        a, b = get3(positions, i), get3(positions, i + 1)
        chord = subtract(b, a)
        size = norm(chord)
        v, w = scale(size, tangent(get4(frames, i))), scale(size, tangent(get4(frames, i + 1)))
        p = add(scale(z * z * (1.0 + 2.0 * y), a), scale(y * y * (3.0 - 2.0 * y), b))
        put3(x, k, 0, add(p, subtract(scale(z * z * y, v), scale(y * y * z, w))))
        d = add(scale(6.0 * y * z, chord), add(scale(z * (1.0 - 3.0 * y), v), scale(y * (3.0 * y - 2.0), w)))
        if coarse0 if 2 * i < last else coarse1:
            d = add(scale(z, get3(forces, i)), scale(y, get3(forces, i + 1)))
        put3(t, k, 0, scale(1.0 / max(norm(d), 1e-300), d))
        hidden = (coarse0 and i == 0 and y < 1.0) or (coarse1 and i == last - 1 and y > 0.0)
        there[k] = 0.0 if hidden else 1.0


@kernel
def bend_ends(s: Array, t: Array, t0: Vector, t1: Vector, l0: float, l1: float, held: Array) -> None:
    """Turns tangents t so that held ends have t0 and t1, as a taut rod with boundary layers l0 and l1 [m] bends."""
    last = s.shape[0] - 1
    a0, axis0 = angle_axis(get3(t, 0), t0)
    a1, axis1 = angle_axis(get3(t, last), t1)
    for end in range(2):
        angle, axis, layer = (a0, axis0, l0) if end == 0 else (a1, axis1, l1)
        if held[end] == 0.0 or angle < SEEN:
            continue
        b = math.tan(0.25 * angle)
        for k in range(last + 1):
            away = s[k] if end == 0 else s[last] - s[k]
            if away < PASSED * layer:
                put3(t, k, 0, turned(get3(t, k), axis, 4.0 * math.atan(b * math.exp(-away / layer))))


@inlined
def shifted(load: Array, e: int, o: int, lam: Array) -> Vector:
    """The internal force from column o of element e's load."""
    return (load[e, o] + lam[0], load[e, o + 1] + lam[1], load[e, o + 2] + lam[2])


@kernel
def pair_defects(
    q: Array, lam: Array, h: Array, load: Array, rest: Array, stiff: Array, mask: Array, first: Array, G: Array,
    slack: Array, total: Array,
) -> None:  # fmt: skip
    """Fills G (N+1, 3), slack (N, 3) and total[:3] with the defects of the pairs of elements, as in `rod_defect`."""
    elements = h.shape[0]
    K, C = (stiff[0], stiff[1], stiff[2]), (stiff[3], stiff[4], stiff[5])
    left = gap = none = (0.0, 0.0, 0.0)
    for e in range(0, elements, 2):
        f = e + 1
        ka, kb = (rest[e, 0], rest[e, 1], rest[e, 2]), (rest[f, 0], rest[f, 1], rest[f, 2])
        g1, g2, gl = element_gradient(
            h[e] + h[f], get4(q, e), get4(q, e + 2), shifted(load, e, 0, lam), shifted(load, e, 6, lam),
            shifted(load, f, 6, lam), scale(0.5, add(ka, kb)), scale(1.0 / h[e], subtract(kb, ka)), K, C, none,
        )[1:]  # fmt: skip
        g1 = scale(PAIR, subtract(g1, (first[e, 3], first[e, 4], first[e, 5])))
        g2 = scale(PAIR, subtract(g2, (first[f, 6], first[f, 7], first[f, 8])))
        gl = scale(PAIR, subtract(gl, add(get3(first, e), get3(first, f))))
        put3(G, e, 0, add(left, g1))
        put3(G, f, 0, none)
        put3(slack, e, 0, none)
        put3(slack, f, 0, gl)
        left, gap = g2, add(gap, gl)
    put3(G, elements, 0, left)
    for i in range(3):
        G[0, i] *= mask[0, i]
        G[elements, i] *= mask[1, i]
    total[0], total[1], total[2] = gap


@inlined
def change_of_step(parts: Array, e: int, d: Array, dl: Vector) -> Vector:
    """Minus how the step in position over element e changes with the rotations d and the force dl."""
    return add(
        add(tapply(get9(parts, e, 9), get3(d, e)), tapply(get9(parts, e, 18), get3(d, e + 1))),
        apply(get9(parts, e, 27), dl),
    )


@inlined
def jumped(before: Array, ends: Array, length: float) -> bool:
    """Whether an end has moved too far at once to say along which branch: JUMP of the length, or JUMP rad."""
    for o in (0, 7):
        distance = turn = 0.0
        for i in range(3):
            distance += (ends[o + i] - before[o + i]) ** 2
        for i in range(3, 7):
            turn += (ends[o + i] - before[o + i]) ** 2
        if distance > (JUMP * length) ** 2 or 4.0 * turn > JUMP * JUMP:
            return True
    return False


@kernel
def judge(
    par: Array, mesh: Array, elements: int, width: int, buffer: Array, points: int, laid: float, before: Array,
    ends: Array, q: Array, lam: Array, work: Array, verdict: Array,
) -> int:  # fmt: skip
    """Judges the shape in `buffer` (17 points,) between `ends` (15,); returns JUDGED, UNFIT or OTHER_MESH.

    Parameters
    ----------
    par
        As in :mod:`~cable_shape.kernels.rod_drive`.
    laid : float [m]
        Boundary layer that the mesh was made for. OTHER_MESH: it is another one now.
    before : (15,)
        Ends with turns that were judged last: signs and turns of `ends` are made to follow; empty: none.
    q, lam : (N+1, 4), (3,)
        Out: the rod beside the shape.
    verdict : (VERDICT,)
        Out: DISTANCE [m] of the shape from that rod, the REMAINDER [m] that another step would move it, the MESH's own
        error [m], the last full STEP [rad], the boundary LAYER [m], ASSEMBLIES. UNFIT: there is no stable rod beside
        it, the ends are wound or have jumped, or something is not finite.
    """
    s, h, load, rest = mesh_parts(mesh, elements)
    stiff, moment, mask = par[0:6], par[6:9], par[9:15].reshape(2, 3)
    D, U, X, P, Y, W = matrices(work, elements, width)
    parts, first, G, d, gram, total, step = vectors(work, elements, width)
    nodes, nb = elements + 1, width - 1
    n1, l0, l1 = layers(buffer, points, 0.5 * (stiff[0] + stiff[1]), par[19])
    verdict[LAYER] = min(l0, l1)
    if not laid < CHANGED * verdict[LAYER] or not verdict[LAYER] < CHANGED * laid:
        return OTHER_MESH
    if before.shape[0] > 0:
        wind(before, ends)
        if ends[14] != 0.0 or jumped(before, ends, par[19]):
            return UNFIT
    elif ends[3] * ends[10] + ends[4] * ends[11] + ends[5] * ends[12] + ends[6] * ends[13] < 0.0:
        for i in range(10, 14):
            ends[i] = -ends[i]
    t, x, there, held = np.empty((nodes, 3)), np.empty((nodes, 3)), np.empty(nodes), np.empty(2)
    held[0], held[1] = 1.0 - mask[0, 0], 1.0 - mask[1, 0]
    for i in range(4):
        q[0, i], q[elements, i] = ends[3 + i], ends[10 + i]
    read_off(buffer, points, s, l0, l1, t, x, there)
    bend_ends(s, t, tangent(get4(q, 0)), tangent(get4(q, elements)), l0, l1, held)
    carry_frames(s, t, mask, q)
    dl = (0.0, 0.0, 0.0)
    lam[0], lam[1], lam[2] = n1 if nb > 0 else dl
    distance = remainder = 0.0
    for attempt in range(MOST_STEPS):
        if attempt > 0:
            advance(q, lam, d, step, 1.0)
        verdict[ASSEMBLIES] = attempt + 1.0
        assemble(q, lam, h, load, rest, stiff, moment, mask, D, U, X, parts, first, total)
        for i in range(nb):
            total[i] += ends[7 + i] - ends[i]
        negative = factor(D, U, X, mask, par[18], h, P, Y, W, gram)
        negative += border(gram, total[3:], total[:3], step)
        verdict[STEP] = backward(P, Y, W, step, d)
        if negative != nb or not verdict[STEP] < LONGEST_STEP:
            return UNFIT
        advance(q, lam, d, step, 1.0)
        gradient(q, lam, h, load, rest, stiff, moment, mask, G, first, total)
        for i in range(nb):
            total[i] += ends[7 + i] - ends[i]
        forward(G, P, Y, W, gram)
        border(gram, total[3:], total[:3], step)
        backward(P, Y, W, step, d)
        if nb > 0:
            dl = (step[0], step[1], step[2])
        r, moved = (ends[0], ends[1], ends[2]), (0.0, 0.0, 0.0)
        distance = remainder = 0.0
        for e in range(elements):
            change = change_of_step(parts, e, d, dl)
            moved = add(moved, change)
            r = subtract(r, add(get3(first, e), change))
            apart = subtract(r, get3(x, e + 1))
            distance, remainder = max(distance, there[e + 1] * dot(apart, apart)), max(remainder, dot(moved, moved))
        if remainder <= CLOSE * CLOSE * distance:
            break
    if not remainder <= ENOUGH * ENOUGH * distance:
        return UNFIT
    slack = np.empty((elements, 3))
    pair_defects(q, lam, h, load, rest, stiff, mask, first, G, slack, total)
    forward(G, P, Y, W, gram)
    border(gram, total[3:], total[:3], step)
    backward(P, Y, W, step, d)
    if nb > 0:
        dl = (step[0], step[1], step[2])
    moved = (0.0, 0.0, 0.0)
    own = 0.0
    for e in range(elements):
        moved = subtract(moved, add(get3(slack, e), change_of_step(parts, e, d, dl)))
        own = max(own, dot(moved, moved))
    verdict[DISTANCE], verdict[REMAINDER], verdict[MESH] = math.sqrt(distance), math.sqrt(remainder), math.sqrt(own)
    return JUDGED if math.isfinite(distance + remainder + own) else UNFIT
