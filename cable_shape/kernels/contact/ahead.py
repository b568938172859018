"""Where a warm solve in contact starts: the last one or two solutions carried on, along the motion of the grips."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import ACTIVE, BARE, LINK, LINKED, MATE, PRESS, PUSH, RUB, TOWARD, let_go
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network.tables import BEFORE, LENGTH, NOW, TRIAL, copy, model_of, plan_of
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get4,
    put3,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_guess import angle_axis, tangent

STEADY = 0.1  # of the largest force that rubs a contact: if one has changed by less, all go on as before


@kernel
def pose_of(grips: Array, j: int) -> tuple[float, float, float, float]:
    """The rotation of what holds the cable."""
    return (grips[j, 3], grips[j, 4], grips[j, 5], grips[j, 6])


@kernel
def pace(grips: Array, moves: Array, length: float) -> float:
    """How far what holds the cables has moved on from the solution now, as a fraction 0 to 2 of the step before.

    moves (k,): 1 where nothing holds a place.
    """
    up = down = 0.0
    for j in range(grips.shape[1]):
        if moves[j] != 0:
            continue
        for i in range(7):
            f = 1.0 / (length * length) if i < 3 else 1.0
            old = grips[NOW, j, i] - grips[BEFORE, j, i]
            up += f * old * (grips[TRIAL, j, i] - grips[NOW, j, i])
            down += f * old * old
    return min(max(up / down, 0.0), 2.0) if down > 1e-16 else 0.0


@kernel
def same_around(on: Array, k: int) -> bool:
    """Whether node k and its neighbours touched what they touch now in the solution before, too."""
    then, now = on[BEFORE], on[NOW]
    return bool(then[k - 1, 0] == now[k - 1, 0] and then[k, 0] == now[k, 0] and then[k + 1, 0] == now[k + 1, 0])


@kernel
def rubbed_before(near: Array, k: int) -> bool:
    """Whether node k has been rubbed by the same body in the last two solutions."""
    return bool(near[NOW, k, MATE] != 0.0 and near[NOW, k, MATE] == near[BEFORE, k, MATE])


@kernel
def rubs_on(near: Array) -> bool:
    """Whether what rubs contacts has changed by a small part of the largest in the last step: so it goes on."""
    change = largest = 0.0
    for k in range(near.shape[1]):
        if rubbed_before(near, k):
            now = take3(near[NOW], k, RUB)
            off = subtract(now, take3(near[BEFORE], k, RUB))
            change, largest = max(change, dot(off, off)), max(largest, dot(now, now))
    return bool(0.0 < change < STEADY * STEADY * largest)


@kernel
def predict(lying: Lying, net: Net, history: int) -> float:
    """Fills the trial from the solution now, extrapolated if there is one before; quaternions' signs by continuity.

    So are what presses and rubs contacts between the same neighbours; one whose force has run out by then is left out.
    Returns `pace`.
    """
    q, near, on, ends, grips, turns = lying.q, lying.near, lying.on, lying.ends, lying.grips, lying.turns
    plan, length = plan_of(net.bare), model_of(net.bare, net.made).par[LENGTH]
    for j in range(grips.shape[1]):
        product = 0.0
        for i in range(3, 7):
            product += grips[NOW, j, i] * grips[TRIAL, j, i]
        if product < 0.0:
            for i in range(3, 7):
                grips[TRIAL, j, i] = -grips[TRIAL, j, i]
    for c in range(plan.roll.shape[0]):
        first, last = plan.cables[c], plan.cables[c + 1] - 1
        start, end = plan.ends[first, 0], plan.ends[last, 1]
        old = qmul(qconj(pose_of(grips[NOW], start)), pose_of(grips[NOW], end))
        new = qmul(qconj(pose_of(grips[TRIAL], start)), pose_of(grips[TRIAL], end))
        turns[TRIAL, c] = turns[NOW, c]
        if (old[3] < 0.0) != (new[3] < 0.0):
            turns[TRIAL, c] += 1.0 if (new[2] > 0.0) == (old[3] >= 0.0) else -1.0
    a = pace(grips, net.moves, length) if history > 1 else 0.0
    f = 1.0 + a
    rubs = a > 0.0 and rubs_on(near)
    for j in range(grips.shape[1]):
        if net.moves[j] == 0:
            continue
        for i in range(3):
            grips[TRIAL, j, i] = f * grips[NOW, j, i] - a * grips[BEFORE, j, i]
        turn = qnormal((
            f * grips[NOW, j, 3] - a * grips[BEFORE, j, 3],
            f * grips[NOW, j, 4] - a * grips[BEFORE, j, 4],
            f * grips[NOW, j, 5] - a * grips[BEFORE, j, 5],
            f * grips[NOW, j, 6] - a * grips[BEFORE, j, 6],
        ))  # fmt: skip
        grips[TRIAL, j, 3], grips[TRIAL, j, 4], grips[TRIAL, j, 5], grips[TRIAL, j, 6] = turn
    for k in range(q.shape[1]):
        q[TRIAL, k, 0], q[TRIAL, k, 1], q[TRIAL, k, 2], q[TRIAL, k, 3] = qnormal((
            f * q[NOW, k, 0] - a * q[BEFORE, k, 0],
            f * q[NOW, k, 1] - a * q[BEFORE, k, 1],
            f * q[NOW, k, 2] - a * q[BEFORE, k, 2],
            f * q[NOW, k, 3] - a * q[BEFORE, k, 3],
        ))  # fmt: skip
        copy(on[TRIAL, k], on[NOW, k])
        copy(near[TRIAL, k], near[NOW, k])
        if on[NOW, k, 0] != BARE and same_around(on, k):
            near[TRIAL, k, PRESS] = f * near[NOW, k, PRESS] - a * near[BEFORE, k, PRESS]
            if near[TRIAL, k, PRESS] < 0.0:
                near[TRIAL, k, PRESS] = 0.0
                on[TRIAL, k, 0] = BARE
                let_go(near[TRIAL], k)
            elif rubs and rubbed_before(near, k):
                for i in range(RUB, RUB + 3):
                    near[TRIAL, k, i] = f * near[NOW, k, i] - a * near[BEFORE, k, i]
        if on[NOW, k, LINKED] == ACTIVE and on[BEFORE, k, LINK] == on[NOW, k, LINK]:
            push_on(near, on, k, a if on[BEFORE, k, LINKED] == ACTIVE else 0.0)
    for i in range(lying.rubs.shape[1]):
        copy(lying.rubs[TRIAL, i], lying.rubs[NOW, i])
    for j in range(ends.shape[1]):
        for i in range(3):
            ends[TRIAL, j, i] = f * ends[NOW, j, i] - a * ends[BEFORE, j, i]
    return a


@kernel
def push_on(near: Array, on: Array, k: int, a: float) -> None:
    """Extrapolates what another cable presses node k with; a push that has run out by then is ended."""
    n = subtract(scale(1.0 + a, take3(near[NOW], k, TOWARD)), scale(a, take3(near[BEFORE], k, TOWARD)))
    put3(near[TRIAL], k, TOWARD, scale(1.0 / math.sqrt(dot(n, n)), n))
    near[TRIAL, k, PUSH] = (1.0 + a) * near[NOW, k, PUSH] - a * near[BEFORE, k, PUSH]
    if near[TRIAL, k, PUSH] < 0.0:
        near[TRIAL, k, PUSH] = 0.0
        on[TRIAL, k, LINKED] = BARE


@kernel
def meet_supports(lying: Lying, net: Net) -> None:
    """Turns the trial's rotations so that those held at supports are met; fills `frames` with what these are."""
    plan, model, grips, frames = plan_of(net.bare), model_of(net.bare, net.made), lying.grips[TRIAL], lying.frames
    for c in range(plan.cables.shape[0] - 1):
        for j in range(plan.cables[c], plan.cables[c + 1]):
            for end in range(2):
                knot, i = plan.ends[j, end], j + c + end
                for x in range(7):
                    frames[i, x] = grips[knot, x]
                if plan.turned[j, end] != 0:
                    turn = qmul(pose_of(grips, knot), get4(model.frame[j], end))
                    frames[i, 3], frames[i, 4], frames[i, 5], frames[i, 6] = turn
        a, b = plan.cables[c] + c, plan.cables[c + 1] + c + 1
        turn_supports(lying.q[TRIAL], lying.s, frames[a:b], lying.held[a:b], lying.mask[a:b])


@kernel
def turn_supports(q: Array, s: Array, frames: Array, where: Array, mask: Array) -> None:
    """Turns the rotations so that those held at supports are met, the turn changing linearly between such supports."""
    left = -1
    turn = (0.0, 0.0, 0.0)
    for j in range(where.shape[0]):
        if mask[j, 0] != 0.0 and j + 1 < where.shape[0]:
            continue
        node = where[j]
        new = turn
        if mask[j, 0] == 0.0:
            target = pose_of(frames, j)
            if mask[j, 2] == 0.0:
                miss = qmul(target, qconj(get4(q, node)))
                new = qlog((-miss[0], -miss[1], -miss[2], -miss[3]) if miss[3] < 0.0 else miss)
            else:
                angle, axis = angle_axis(tangent(get4(q, node)), tangent(target))
                new = scale(angle, axis)
        first = where[max(left, 0)]
        for k in range(first + 1 if left >= 0 else first, node + 1):
            x = (s[k] - s[first]) / (s[node] - s[first]) if left >= 0 else 1.0
            p = qnormal(qmul(qexp(add(scale(1.0 - x, turn), scale(x, new))), get4(q, k)))
            q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
        if mask[j, 0] == 0.0 and mask[j, 2] == 0.0:
            sign = 1.0 if qmul(qconj(get4(q, node)), pose_of(frames, j))[3] > 0.0 else -1.0
            for i in range(4):
                q[node, i] = sign * frames[j, 3 + i]
        left, turn = j, new
