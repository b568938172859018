"""Where a warm solve in contact starts: the last one or two solutions carried on, along the motion of the grips."""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import BARE, PRESS
from cable_shape.kernels.network.tables import BEFORE, NOW, TRIAL
from cable_shape.kernels.rod_algebra import add, get4, qconj, qexp, qlog, qmul, qnormal, scale
from cable_shape.kernels.rod_guess import angle_axis, tangent


@kernel
def pose_of(grips: Array, j: int) -> tuple[float, float, float, float]:
    """The rotation of what holds the cable."""
    return (grips[j, 3], grips[j, 4], grips[j, 5], grips[j, 6])


@kernel
def pace(grips: Array, length: float) -> float:
    """How far the held supports have moved on from the solution now, as a fraction 0 to 2 of the step before."""
    up = down = 0.0
    for j in range(grips.shape[1]):
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
def predict(
    q: Array, near: Array, on: Array, ends: Array, grips: Array, turns: Array, length: float, history: int
) -> float:
    """Fills the trial from the solution now, extrapolated if there is one before; quaternions' signs by continuity.

    A contact whose force has run out by then, and between the same neighbours, is left out. Returns `pace`.
    """
    last = grips.shape[1] - 1
    for j in range(last + 1):
        product = 0.0
        for i in range(3, 7):
            product += grips[NOW, j, i] * grips[TRIAL, j, i]
        if product < 0.0:
            for i in range(3, 7):
                grips[TRIAL, j, i] = -grips[TRIAL, j, i]
    old = qmul(qconj(pose_of(grips[NOW], 0)), pose_of(grips[NOW], last))
    new = qmul(qconj(pose_of(grips[TRIAL], 0)), pose_of(grips[TRIAL], last))
    turns[TRIAL] = turns[NOW]
    if (old[3] < 0.0) != (new[3] < 0.0):
        turns[TRIAL] += 1.0 if (new[2] > 0.0) == (old[3] >= 0.0) else -1.0
    a = pace(grips, length) if history > 1 else 0.0
    f = 1.0 + a
    for k in range(q.shape[1]):
        q[TRIAL, k, 0], q[TRIAL, k, 1], q[TRIAL, k, 2], q[TRIAL, k, 3] = qnormal((
            f * q[NOW, k, 0] - a * q[BEFORE, k, 0],
            f * q[NOW, k, 1] - a * q[BEFORE, k, 1],
            f * q[NOW, k, 2] - a * q[BEFORE, k, 2],
            f * q[NOW, k, 3] - a * q[BEFORE, k, 3],
        ))  # fmt: skip
        on[TRIAL, k, :] = on[NOW, k]
        near[TRIAL, k, :] = near[NOW, k]
        if on[NOW, k, 0] != BARE and same_around(on, k):
            near[TRIAL, k, PRESS] = f * near[NOW, k, PRESS] - a * near[BEFORE, k, PRESS]
            if near[TRIAL, k, PRESS] < 0.0:
                near[TRIAL, k, PRESS] = 0.0
                on[TRIAL, k, 0] = BARE
    for j in range(last):
        for i in range(3):
            ends[TRIAL, j, i] = f * ends[NOW, j, i] - a * ends[BEFORE, j, i]
    return a


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
        first = where[left] if left >= 0 else 0
        for k in range(first + 1 if left >= 0 else 0, node + 1):
            x = (s[k] - s[first]) / (s[node] - s[first]) if left >= 0 else 1.0
            p = qnormal(qmul(qexp(add(scale(1.0 - x, turn), scale(x, new))), get4(q, k)))
            q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
        if mask[j, 0] == 0.0 and mask[j, 2] == 0.0:
            sign = 1.0 if qmul(qconj(get4(q, node)), pose_of(frames, j))[3] > 0.0 else -1.0
            for i in range(4):
                q[node, i] = sign * frames[j, 3 + i]
        left, turn = j, new
