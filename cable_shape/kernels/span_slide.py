"""Eyelets inside Newton's method: the arc length sigma of the cable at each is an unknown, F . d3 = 0 its equation.

F is the force of the eyelet on the cable, d3 the tangent at its node. The nodes between an eyelet and the next knots
(supports, point masses) keep their shares of that stretch, so that all of the discrete system depends on sigma, by the
lengths, loads and rest curvature of the elements: differences of the gradient are the columns of sigma, and what the
factors answer to them reduces the system to one equation an eyelet. With k eyelets, N elements and m spans:

    turn   (k (N+1), 3)  change of the node rotations with each sigma [rad/m]
    push   (k m, 6)      change of the spans' forces [N/m] and of their far supports' places
    slope  (k N, 9)      change of `first`
    J      (k, k)        change of F . d3 [N/m]
    way    (k,)          step of sigma [m]
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    rotation,
    subtract,
    take3,
)
from cable_shape.kernels.rod_element import E3, element_gradient
from cable_shape.kernels.rod_mesh import element_loads, element_rest
from cable_shape.kernels.rod_mesh import forces as forces_at
from cable_shape.kernels.span_factor import FORCE, backward, forward
from cable_shape.kernels.span_system import NONE, release

DIFFERENCE = 1e-6  # of the length, between two values of sigma
REACH = 0.5  # of the slack of a span, or of the way to the next knot, that one step may use up
LEAST = 2e-3  # of the length: an eyelet this near to a knot has been run through


@kernel
def respace(s: Array, knots: Array, where: Array, rings: Array, way: Array, fraction: float) -> None:
    """Moves the eyelets' nodes by `fraction` of `way` along the cable, the nodes beside them in proportion.

    knots (p,): nodes of the supports and of the point masses, ascending; rings (k,): supports that are eyelets.
    """
    ring = 0
    old = s[0]
    for i in range(1, knots.shape[0]):
        a, b = knots[i - 1], knots[i]
        shift = 0.0
        while ring < rings.shape[0] and where[rings[ring]] < b:
            ring += 1
        if ring < rings.shape[0] and where[rings[ring]] == b:
            shift = fraction * way[ring]
        far = s[b]
        if shift != 0.0 or s[a] != old:
            stretch = (far + shift - s[a]) / (far - old)
            for k in range(a + 1, b):
                s[k] = s[a] + (s[k] - old) * stretch
            s[b] = far + shift
        old = far


@kernel
def load_elements(s: Array, acts: Array, points: Array, table: Array, h: Array, load: Array, rest: Array) -> None:
    """Lengths, loads and rest curvature of the elements between the nodes s.

    acts (3 + p, 3): distributed load at both ends [N/m], load on a free end [N], concentrated loads at `points` [N].
    """
    element_loads(s, acts[0:2], points, acts[3:], acts[2], h, load)
    element_rest(s, table, rest)


@kernel
def grip(lam: Array, q: Array, joints: Array, d: Array, where: Array, j: int) -> tuple[float, float]:
    """F . d3 [N], F the force of support j on the cable, and its change by d and joints."""
    node = where[j]
    R = rotation(get4(q, node))
    t = apply(R, E3)
    F = subtract(get3(lam, j - 1), get3(lam, j))
    dF = subtract(take3(joints, j - 1, FORCE), take3(joints, j, FORCE))
    return dot(F, t), dot(dF, t) + dot(F, apply(R, cross(get3(d, node), E3)))


@kernel
def columns_of(
    q: Array, lam: Array, s: Array, rest: Array, stiff: Array, where: Array, mask: Array, place: Array, forces: int,
    knots: Array, rings: Array, acts: Array, points: Array, table: Array, first: Array, P: Array, Y: Array, W: Array,
    joints: Array, turn: Array, push: Array, slope: Array, J: Array,
) -> None:  # fmt: skip
    """Fills turn, push, slope and J, with the factors at hand; `first` is that of now."""
    elements, spans, length = first.shape[0], lam.shape[0], s[s.shape[0] - 1]
    K, C = (stiff[0], stiff[1], stiff[2]), (stiff[3], stiff[4], stiff[5])
    h, load, bent = np.empty(elements), np.empty((elements, 9)), np.empty((elements, 6))
    G, closure = np.empty((elements + 1, 3)), np.empty((spans, 3))
    still = np.zeros((spans + 1, 3))
    way = np.zeros(rings.shape[0])
    slope[:, :] = 0.0
    for c in range(rings.shape[0]):
        node = where[rings[c]]
        i = 0
        while knots[i] < node:
            i += 1
        way[:] = 0.0
        way[c] = DIFFERENCE * length
        moved = s.copy()
        respace(moved, knots, where, rings, way, 1.0)
        load_elements(moved, acts, points, table, h, load, bent)
        G[:, :] = 0.0
        closure[:, :] = 0.0
        f = 1.0 / way[c]
        j = rings[c] - 1
        while where[j] > knots[i - 1]:  # supports that may slip lie between
            j -= 1
        for e in range(knots[i - 1], knots[i + 1]):
            if where[j + 1] <= e:
                j += 1
            nL, nM, nR = forces_at(load, e, get3(lam, j))
            k0, k1 = (bent[e, 0], bent[e, 1], bent[e, 2]), (bent[e, 3], bent[e, 4], bent[e, 5])
            _, g1, g2, gl = element_gradient(h[e], get4(q, e), get4(q, e + 1), nL, nM, nR, k0, k1, K, C, NONE)
            for x in range(3):
                slope[c * elements + e, x] = f * (gl[x] - first[e, x])
                slope[c * elements + e, 3 + x] = f * (g1[x] - first[e, 3 + x])
                slope[c * elements + e, 6 + x] = f * (g2[x] - first[e, 6 + x])
                closure[j, x] += slope[c * elements + e, x]
                G[e, x] += slope[c * elements + e, 3 + x]
                G[e + 1, x] += slope[c * elements + e, 6 + x]
        release(G, where, mask)
        d = turn[c * (elements + 1) : (c + 1) * (elements + 1)]
        forward(G, closure, still, still, where, place, forces, P, Y, W, joints)
        backward(where, place, forces, P, Y, W, joints, d)
        push[c * spans : (c + 1) * spans] = joints[:, FORCE : FORCE + 6]
        for i in range(rings.shape[0]):
            J[i, c] = grip(lam, q, joints, d, where, rings[i])[1]


@kernel
def balance_eyelets(J: Array, f: Array, way: Array) -> int:
    """Solves f + J way = 0; returns how many eigenvalues of -J, the energy's second derivative, are negative."""
    k = f.shape[0]
    A = -J
    negative = 0
    way[:] = f
    for i in range(k):
        if not A[i, i] > 0.0:
            negative += 1
        for r in range(i + 1, k):
            x = A[r, i] / A[i, i]
            for c in range(i, k):
                A[r, c] -= x * A[i, c]
            way[r] -= x * way[i]
    for i in range(k - 1, -1, -1):
        for c in range(i + 1, k):
            way[i] -= A[i, c] * way[c]
        way[i] /= A[i, i]
    return negative


@kernel
def settle(
    q: Array, lam: Array, where: Array, rings: Array, turn: Array, push: Array, J: Array, pulls: float, d: Array,
    joints: Array, way: Array,
) -> int:  # fmt: skip
    """Adds the steps of sigma, into `way`, and the answer to them to the step in d and joints.

    pulls: 1 if the eyelets pull as they do, 0 if only what the step changes counts. Returns in how many directions of
    sigma the energy falls.
    """
    elements, spans = d.shape[0] - 1, lam.shape[0]
    f = np.empty(rings.shape[0])
    for i in range(rings.shape[0]):
        pull, change = grip(lam, q, joints, d, where, rings[i])
        f[i] = pulls * pull + change
    negative = balance_eyelets(J, f, way)
    for c in range(rings.shape[0]):
        for k in range(elements + 1):
            for i in range(3):
                d[k, i] += way[c] * turn[c * (elements + 1) + k, i]
        for j in range(spans):
            for i in range(6):
                joints[j, FORCE + i] += way[c] * push[c * spans + j, i]
    return negative


@kernel
def farthest_way(
    s: Array, frames: Array, where: Array, knots: Array, rings: Array, forces: int, rigid: bool, way: Array
) -> float:
    """What fraction of the steps `way` the slack of the spans and the next knots allow; 0: an eyelet has no room.

    rigid: whether the cable cannot stretch.
    """
    fraction = 1.0
    length = s[s.shape[0] - 1]
    moves = np.zeros(where.shape[0])
    for c in range(rings.shape[0]):
        node = where[rings[c]]
        moves[rings[c]] = way[c]
        i = 0
        while knots[i] < node:
            i += 1
        room = s[knots[i + 1]] - s[node] if way[c] > 0.0 else s[node] - s[knots[i - 1]]
        if room < LEAST * length:
            return 0.0
        if abs(way[c]) > REACH * room:
            fraction = min(fraction, REACH * room / abs(way[c]))
    for j in range(forces if rigid else 0):
        used = moves[j] - moves[j + 1]
        if used <= 0.0:
            continue
        chord = subtract(get3(frames, j + 1), get3(frames, j))
        room = s[where[j + 1]] - s[where[j]] - math.sqrt(dot(chord, chord))
        if room <= 0.0:
            return 0.0
        if used > REACH * room:
            fraction = min(fraction, REACH * room / used)
    return fraction


@kernel
def carried(slope: Array, way: Array, e: int, o: int, elements: int) -> tuple[float, float, float]:
    """Change of three columns of `first` of element e by the steps of sigma."""
    total = (0.0, 0.0, 0.0)
    for c in range(way.shape[0]):
        row = c * elements + e
        total = add(total, (way[c] * slope[row, o], way[c] * slope[row, o + 1], way[c] * slope[row, o + 2]))
    return total
