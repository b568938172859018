"""How far a shape in contact may be from the exact one: defects of elements, and contacts that should be elsewhere.

What the cable does in its eyelets comes as `through`: arc lengths of the nodes, nodes of held supports and masses,
supports that are eyelets, the spans' forces, and the columns of `span_slide`.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact_near import BARE, NORMAL, PRESS, STEP, parting, tangent_of
from cable_shape.kernels.contact_step import moves
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get3,
    get4,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)
from cable_shape.kernels.rod_defect import defects
from cable_shape.kernels.rod_lanes import sections
from cable_shape.kernels.span_factor import backward, forward
from cable_shape.kernels.span_slide import respace, settle
from cable_shape.kernels.span_system import NONE, release
from cable_shape.kernels.span_work import joints_of, matrices, vectors

Through = tuple[Array, Array, Array, Array, tuple[Array, Array, Array, Array, Array]]
SAFETY = 1.5  # of `position_error`, which by itself is right to a few percent on resolved meshes, either way
AMISS = 2.5  # of `contact_error`


@kernel
def position_error(
    q: Array, h: Array, rest: Array, stiff: Array, where: Array, mask: Array, place: Array, base: Array, forces: int,
    through: Through, near: Array, work: Array, errors: Array,
) -> float:  # fmt: skip
    """Estimated largest position error of the solution at hand [m]; infinite if it cannot be judged.

    The local defects of `rod_defect`, solved with the factors at hand. errors (N,): takes each element's share, a
    guide for the next mesh.
    """
    elements, spans = h.shape[0], where.shape[0] - 1
    _, U, parts, _, _, _ = matrices(work, elements)
    first, full, slack, G, _, _ = vectors(work, elements)
    _, sums, pull, given = joints_of(work, elements, spans)
    G[:, :] = 0.0
    missed = first.copy()
    defects(
        q, np.zeros(3), h, full, rest, sections(stiff, elements), U, parts, missed, G, slack, np.empty((elements, 6)),
        np.zeros(3),
    )  # fmt: skip
    release(G, where, mask)
    stiffest = max(stiff[0], stiff[1], stiff[2])
    pull[:, :] = 0.0
    given[:, :] = 0.0
    for j in range(spans):
        total = NONE
        for e in range(where[j], where[j + 1]):
            a, b = get3(slack, e), get3(G, e)
            errors[e] = math.sqrt(dot(a, a)) + h[e] * math.sqrt(dot(b, b)) / stiffest * h[e]
            total = add(total, a)
        put3(sums, j, 0, total)
    answer(q, where, mask, place, base, forces, through, near, work)
    largest = 0.0
    off = NONE
    for j in range(spans):
        for e in range(where[j], where[j + 1]):
            off = subtract(off, get3(slack, e))
            miss = add(off, take3(near, e + 1, STEP))
            size = dot(miss, miss)
            if not size <= largest:  # NaN is the largest of all
                largest = size
        if base[j + 1] >= 0:
            off = NONE
    return math.sqrt(largest) if math.isfinite(largest) else math.inf


@kernel
def answer(
    q: Array, where: Array, mask: Array, place: Array, base: Array, forces: int, through: Through, near: Array,
    work: Array,
) -> None:  # fmt: skip
    """The change of the cable's places at the nodes' arc lengths, into `near`, that the right-hand sides cause."""
    s, knots, rings, lam, (turn, push, slope, J, way) = through
    elements, spans = q.shape[0] - 1, where.shape[0] - 1
    _, _, parts, P, Y, W = matrices(work, elements)
    _, _, _, G, d, _ = vectors(work, elements)
    joints, sums, pull, given = joints_of(work, elements, spans)
    release(G, where, mask)
    forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
    backward(where, place, forces, P, Y, W, joints, d)
    if rings.shape[0] > 0:
        settle(q, lam[:spans], where, rings, turn, push, J, 0.0, d, joints, way)
    moves(parts, d, joints, where, base, spans, slope, way, near)
    if rings.shape[0] > 0:  # a node runs along the cable, of which it is another point then
        moved = s.copy()
        respace(moved, knots, where, rings, way, 1.0)
        for k in range(elements + 1):
            put3(near, k, STEP, subtract(take3(near, k, STEP), scale(moved[k] - s[k], tangent_of(q, k))))


@kernel
def shift_of(q: Array, near: Array, on: Array, h: Array, k: int, least: float, flex: float) -> tuple[float, float]:
    """How far along the cable from node k its contact's force should act, and how far the node should be off [m].

    A contact alone, or the last of a row, belongs where the cable is nearest to the body; inside a row, nothing is
    known to be amiss. What lies beyond half an element is the next node's. least [1/m]: no less curved is the gap.
    """
    left, right = on[k - 1, 0] != BARE, on[k + 1, 0] != BARE
    slope = dot(tangent_of(q, k), take3(near, k, NORMAL))
    if (left and right) or slope == 0.0:
        return 0.0, 0.0
    second, _ = parting(q, h, near, k, flex)
    limit = 0.5 * (h[k] if slope < 0.0 else h[k - 1])
    way = -slope / max(second, abs(slope) / limit, least)
    return way, -way * (slope + 0.5 * second * way)


@kernel
def contact_error(
    q: Array, near: Array, on: Array, h: Array, where: Array, mask: Array, place: Array, base: Array, forces: int,
    through: Through, least: float, flex: float, work: Array,
) -> float:  # fmt: skip
    """Estimated error [m] from contacts at nodes, whose forces should act elsewhere, with the factors at hand."""
    elements, spans = h.shape[0], where.shape[0] - 1
    _, _, _, G, _, _ = vectors(work, elements)
    _, sums, pull, given = joints_of(work, elements, spans)
    G[:, :] = 0.0
    sums[:, :3] = 0.0
    pull[:, :] = 0.0
    given[:, :] = 0.0
    amiss = False
    for j in range(1, spans):
        k = where[j]
        if base[j] >= 0:
            continue
        way, off = shift_of(q, near, on, h, k, least, flex)
        if way == 0.0:
            continue
        amiss = True
        n = take3(near, k, NORMAL)
        N = tapply(rotation(get4(q, k)), n)
        f = near[k, PRESS] * way
        put3(G, k, 0, (f * N[1], -f * N[0], 0.0))
        put3(given, j, 0, scale(off, n))
    if not amiss:
        return 0.0
    answer(q, where, mask, place, base, forces, through, near, work)
    largest = 0.0
    for k in range(elements + 1):
        move = take3(near, k, STEP)
        size = dot(move, move)
        if not size <= largest:
            largest = size
    return math.sqrt(largest) if math.isfinite(largest) else math.inf
