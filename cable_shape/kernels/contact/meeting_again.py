"""Pairs of points of cables that touch each other, after a part of a step: found once more, and whether it may stand.

A part that ends with a pair pressed, or with cables that overlap, is taken again with the pairs as they are then. Where
two cables lie along each other the nearest points jump from end to end: points that come to those of another pair stay
where they are on the first cable, and places where cables overlap beside all pairs become pairs. Others go half the way
where they would go to and fro.

Cables that lay one way round each other still do so if no piece of one has gone through one of the other on the
straight way (`distance.passing`).
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.meeting import (
    APART,
    APART_AGAIN,
    ARC,
    JOINED,
    KEEP,
    MEETING,
    MOST,
    ONE,
    OUT,
    PLACE,
    SAME_PLACE,
    SHORTEST,
    TWO,
    approach,
    beside_of,
    meet,
    piece_count,
    pieces_of,
    put_pair,
    shifted,
)
from cable_shape.kernels.contact.points import GAP
from cable_shape.kernels.distance.cable_near import is_joined
from cable_shape.kernels.distance.passing import CROSSING, MOST_CROSSINGS, crossings
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import Momentum
from cable_shape.kernels.network.motion import N_PROPS, PROP, Motion
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GRIP,
    HOLDER,
    LEVEL,
    NORMAL,
    OTHER,
    PAIRED,
    PARTNER,
    PUSH,
    SHARE,
    STUCK,
    WHICH,
    place_of,
)
from cable_shape.kernels.network.tables import LENGTH, Floats, Model, Plan
from cable_shape.kernels.network.walls import along
from cable_shape.kernels.rod_algebra import dot, put3, scale, take3

#: Of the length, and of the distance to be kept: by the smaller of both cables may overlap after a part of a step; if
#: they overlap by more only by a share of it more. Nearer than a share of that distance they are inside each other.
DEEP, THIN, DEEPER, INSIDE = 2e-4, 0.1, 0.2, 0.2


@kernel
def aim_again(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, before: Momentum, touching: Array, whole: Array,
    rough: Array, dt: float, half: bool, rows: Array,
) -> float:  # fmt: skip
    """Fills rows (PAIRS, PROP) with the pairs as they are nearest after a part dt [s] of a step, to be taken once more,
    and with places where cables overlap beside those.

    Returns by how much their distances miss what they were to be [m], 0 if none presses or should.
    """
    props, off, k, meeting = motion.props, 0.0, 0, np.empty(MEETING)
    for i in range(rows.shape[0]):
        rows[i, HOLDER] = 0.0
    for i in range(int(motion.par[N_PROPS])):
        if props[i, HOLDER] != PAIRED:
            continue
        for c in range(PROP):
            rows[k, c] = props[i, c]
        row = touching[int(props[i, WHICH])]
        put_meeting(props, i, meeting)
        near = approach(plan, model, motion.place, memory.tangent, row, meeting, False)
        # a nearest point that has jumped away is a pair of its own, if cables overlap there
        gone = near and away_from(plan, model, props, i, meeting) > same_place(plan, model, row)
        if gone or (near and has_one(plan, model, rows, k, row, int(props[i, WHICH]), meeting)):
            put_meeting(props, i, meeting)
            near = approach(plan, model, motion.place, memory.tangent, row, meeting, True)
        elif near and half:
            go_half_way(plan, model, props, i, row, meeting)
            near = approach(plan, model, motion.place, memory.tangent, row, meeting, True)
        if near and dot((meeting[OUT], meeting[OUT + 1], meeting[OUT + 2]), take3(props, i, NORMAL)) > 0.0:
            put_pair(model, rows, k, meeting)
            put3(rows, k, DRY, along(take3(rows, k, NORMAL), take3(props, i, DRY)))
            put3(rows, k, STUCK, place_of(plan, rows, k, before.place, before.tangent))
            miss = meeting[APART] - props[i, LEVEL]
            off = max(off, abs(miss) if props[i, PUSH] > 0.0 else -miss)
        k += 1
    found = np.empty((MOST, MEETING))
    for which in range(touching.shape[0]):
        row = touching[which]
        count = meet(plan, model, motion.place, memory.tangent, row, row[KEEP], found)
        for j in range(count):
            if k == rows.shape[0] or not is_deep(plan, model, motion, which, row, found[j]):
                continue
            if has_one(plan, model, rows, k, row, which, found[j]):
                continue
            add_pair(plan, model, before, row, which, whole, rough, dt, found[j], rows, k)
            off = max(off, rows[k, LEVEL] - found[j, APART])
            k += 1
    return off


@inline
def put_meeting(props: Floats, i: int, meeting: Floats) -> None:
    """Where pair i is, to approach from."""
    meeting[PLACE], meeting[PLACE + 1] = props[i, ELEMENT], props[i, SHARE]
    meeting[PLACE + 2], meeting[PLACE + 3] = props[i, PARTNER], props[i, OTHER]


@inline
def go_half_way(plan: Plan, model: Model, props: Floats, i: int, row: Floats, meeting: Floats) -> None:
    """Moves a place half the way back to pair i: where one cable winds round another nearest points go to and fro."""
    e, f = int(props[i, ELEMENT]), int(props[i, PARTNER])
    back = 0.5 * (model.s[plan.left[e]] + props[i, SHARE] * model.h[e] - meeting[ARC])
    e, meeting[PLACE + 1] = shifted(plan, model, int(row[ONE]), int(meeting[PLACE]), meeting[PLACE + 1], back)
    back = 0.5 * (model.s[plan.left[f]] + props[i, OTHER] * model.h[f] - meeting[ARC + 1])
    f, meeting[PLACE + 3] = shifted(plan, model, int(row[TWO]), int(meeting[PLACE + 2]), meeting[PLACE + 3], back)
    meeting[PLACE], meeting[PLACE + 2] = e, f


@viewing
def has_one(plan: Plan, model: Model, rows: Floats, count: int, row: Floats, which: int, meeting: Floats) -> bool:
    """Whether one of the first pairs is at the place of this one."""
    found, aside = False, same_place(plan, model, row)
    for i in range(count):
        if int(rows[i, WHICH]) == which:
            found = found or away_from(plan, model, rows, i, meeting) < aside
    return found


@inline
def same_place(plan: Plan, model: Model, row: Floats) -> float:
    """[m], pairs of these cables nearer to each other than that are one."""
    return SAME_PLACE * beside_of(piece_count(plan, model, row)[1], row)


@inline
def away_from(plan: Plan, model: Model, props: Floats, i: int, meeting: Floats) -> float:
    """[m], how far a place is from pair i along the cable along which that is more."""
    e, f = int(props[i, ELEMENT]), int(props[i, PARTNER])
    away = abs(model.s[plan.left[e]] + props[i, SHARE] * model.h[e] - meeting[ARC])
    return max(away, abs(model.s[plan.left[f]] + props[i, OTHER] * model.h[f] - meeting[ARC + 1]))


@inline
def add_pair(
    plan: Plan, model: Model, before: Momentum, row: Floats, which: int, whole: Floats, rough: Floats, dt: float,
    meeting: Floats, rows: Floats, k: int,
) -> None:  # fmt: skip
    """Fills row k with a pair that overlaps after a part dt [s] of a step, as it was before that."""
    for c in range(PROP):
        rows[k, c] = 0.0
    rows[k, HOLDER], rows[k, WHICH] = PAIRED, which
    put_pair(model, rows, k, meeting)
    was = place_of(plan, rows, k, before.place, before.tangent)
    if dot(was, take3(rows, k, NORMAL)) < 0.0:
        put3(rows, k, NORMAL, scale(-1.0, take3(rows, k, NORMAL)))
    put3(rows, k, STUCK, was)
    size, e, f = math.sqrt(dot(was, was)), plan.left[int(rows[k, ELEMENT])], plan.left[int(rows[k, PARTNER])]
    rows[k, GAP] = size - row[KEEP]
    rows[k, LEVEL] = min(row[KEEP], size + APART_AGAIN * dt * whole[e])
    if size < row[KEEP]:
        rows[k, GRIP] = max(rough[e], rough[f])


@viewing
def take_again(motion: Motion, rows: Floats) -> None:
    """Puts those in place of the pairs that `find_pairs` has found again."""
    count, k = 0, 0
    for i in range(int(motion.par[N_PROPS])):
        count += 1 if motion.props[i, HOLDER] != PAIRED else 0
    while k < rows.shape[0] and rows[k, HOLDER] == PAIRED:
        for c in range(PROP):
            motion.props[count + k, c] = rows[k, c]
        k += 1
    motion.par[N_PROPS] = count + k


@kernel
def stay_apart(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, before: Momentum, touching: Array, whole: Array,
    afloat: float, patient: bool,
) -> tuple[bool, float]:  # fmt: skip
    """Whether cables have not gone through each other in a part of a step, and by how much they overlap at most [m].

    Unless `patient` nor may they overlap, or press from further away than `afloat`, of the length.
    """
    found, rows, deepest = np.empty((MOST, MEETING)), np.empty((MOST_CROSSINGS, CROSSING)), 0.0
    for k in range(touching.shape[0]):
        row = touching[k]
        if gone_through(plan, model, motion.place, memory.tangent, before, row, rows):
            return False, 0.0
        count = meet(plan, model, motion.place, memory.tangent, row, row[KEEP], found)
        for j in range(count):
            deepest = max(deepest, row[KEEP] - found[j, APART])
            if not patient and is_deep(plan, model, motion, k, row, found[j]):
                return False, 0.0
    if patient:
        return True, deepest
    meeting = np.empty(MEETING)
    for i in range(int(motion.par[N_PROPS])):
        props = motion.props
        if props[i, HOLDER] == PAIRED and props[i, PUSH] > 0.0:
            put_meeting(props, i, meeting)
            row = touching[int(props[i, WHICH])]
            near = approach(plan, model, motion.place, memory.tangent, row, meeting, False)
            if near and meeting[APART] - row[KEEP] > afloat * whole[plan.left[int(props[i, ELEMENT])]]:
                return False, 0.0
    return True, deepest


@viewing
def is_deep(plan: Plan, model: Model, motion: Motion, which: int, row: Floats, meeting: Floats) -> bool:
    """Whether cables overlap by more at a place than they may after a part of a step."""
    most = min(DEEP * model.par[LENGTH], THIN * row[KEEP])
    level = asked_of(plan, model, motion, which, meeting, row[KEEP])
    return bool(meeting[APART] < min(row[KEEP] - most, level - DEEPER * most))


@viewing
def asked_of(plan: Plan, model: Model, motion: Motion, which: int, meeting: Floats, keep_off: float) -> float:
    """[m], at what distance pairs near this one were to be kept."""
    props, level = motion.props, keep_off
    for i in range(int(motion.par[N_PROPS])):
        if props[i, HOLDER] != PAIRED or int(props[i, WHICH]) != which:
            continue
        if away_from(plan, model, props, i, meeting) < model.h[int(props[i, ELEMENT])]:
            level = min(level, props[i, LEVEL])
    return level


@kernel
def gone_through(
    plan: Plan, model: Model, places: Floats, tangents: Floats, before: Momentum, row: Array, out: Array
) -> bool:  # fmt: skip
    """Whether two cables that may touch have gone through each other since `before`, where they were not inside."""
    one, two = int(row[ONE]), int(row[TWO])
    pieces, _ = piece_count(plan, model, row)
    s, p = pieces_of(plan, model, places, tangents, one, pieces)
    _, p_then = pieces_of(plan, model, before.place, before.tangent, one, pieces)
    u, r, r_then, skipped = s, p, p_then, 0
    if one != two:
        u, r = pieces_of(plan, model, places, tangents, two, pieces)
        _, r_then = pieces_of(plan, model, before.place, before.tangent, two, pieces)
    else:
        skipped = math.ceil(row[SHORTEST] / (s[1] - s[0]))
    joined = row[JOINED:].reshape(2, 2)
    count = crossings(p_then, p, r_then, r, skipped, out)
    for k in range(count):
        i, j = int(out[k, 2]), int(out[k, 3])
        at = s[i] + (out[k, 2] - i) * (s[i + 1] - s[i])
        to = u[j] + (out[k, 3] - j) * (u[j + 1] - u[j])
        if is_joined(at, s[s.shape[0] - 1], to, u[u.shape[0] - 1], joined):
            continue
        x, y, square = out[k, 2] - i, out[k, 3] - j, 0.0
        for c in range(3):
            gap = (1.0 - x) * p_then[i, c] + x * p_then[i + 1, c] - (1.0 - y) * r_then[j, c] - y * r_then[j + 1, c]
            square += gap * gap
        if square > (INSIDE * row[KEEP]) ** 2:
            return True
    return False
