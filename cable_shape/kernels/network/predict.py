"""Where a warm solve starts: the last one or two solutions carried on, along the motion of the supports."""

from __future__ import annotations

import math

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.tables import LENGTH, TURN_AT_REST, Floats, Model, Plan, Solution
from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    add,
    get4,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    scale,
)
from cable_shape.kernels.rod_guess import angle_axis, tangent

TURN_OF_MOTION = 12.0  # largest turn of a frame from its prediction [rad] by motion of the supports [lengths, rad]


@inline
def rotation_of(pose: Floats, k: int) -> Quaternion:
    """The rotation of a knot."""
    return (pose[k, 3], pose[k, 4], pose[k, 5], pose[k, 6])


@inline
def put_rotation(pose: Floats, k: int, q: Quaternion) -> None:
    """Writes the rotation of a knot."""
    pose[k, 3], pose[k, 4], pose[k, 5], pose[k, 6] = q


@inline
def negative(q: Quaternion) -> Quaternion:
    """-q, the same rotation."""
    return (-q[0], -q[1], -q[2], -q[3])


@inline
def product(p: Quaternion, q: Quaternion) -> float:
    """p . q as four numbers."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]


@viewing(forceinline=True)
def follow(plan: Plan, before: Solution, sol: Solution) -> None:
    """Chooses the signs of the knots' quaternions by continuity, and counts the turns of the cables' ends.

    The relative quaternion between the two knots of `Plan.roll` moves continuously; where its scalar part changes sign
    a turn is counted, in the direction in which the end rolls.
    """
    for k in range(sol.pose.shape[0]):
        p = rotation_of(sol.pose, k)
        if product(rotation_of(before.pose, k), p) < 0.0:
            put_rotation(sol.pose, k, negative(p))
    for c in range(sol.turns.shape[0]):
        first, last = plan.roll[c, 0], plan.roll[c, 1]
        a = qmul(qconj(rotation_of(before.pose, first)), rotation_of(before.pose, last))
        b = qmul(qconj(rotation_of(sol.pose, first)), rotation_of(sol.pose, last))
        if product(a, b) < 0.0:
            put_rotation(sol.pose, last, negative(rotation_of(sol.pose, last)))
            b = negative(b)
        sol.turns[c] = before.turns[c]
        if (a[3] < 0.0) != (b[3] < 0.0):
            # a roll angle grows through pi where the roll part of the quaternion has the sign of its old scalar part
            sol.turns[c] += 1.0 if (b[2] > 0.0) == (a[3] >= 0.0) else -1.0


@viewing(forceinline=True)
def pace(plan: Plan, before: Solution, now: Solution, sol: Solution, length: float) -> float:
    """How far the knots that are given have moved on, as a fraction 0 to 2 of the step before."""
    up = down = 0.0
    for k in range(sol.pose.shape[0]):
        first = 3 if plan.vertices[k, 1] >= 0 or is_leaf(plan, k) else 0
        last = 3 if plan.vertices[k, 0] >= 0 else 7
        for i in range(first, last):
            f = 1.0 / (length * length) if i < 3 else 1.0
            old = now.pose[k, i] - before.pose[k, i]
            up += f * old * (sol.pose[k, i] - now.pose[k, i])
            down += f * old * old
    return min(max(up / down, 0.0), 2.0) if down > 1e-16 else 0.0


@inline
def is_leaf(plan: Plan, k: int) -> bool:
    """Whether the place of knot k follows from those of others."""
    leaves = 0
    for i in range(plan.stripped.shape[0]):
        leaves += plan.ends[plan.stripped[i, 0], plan.stripped[i, 1]] == k
    return leaves > 0


@viewing(forceinline=True)
def extrapolate(plan: Plan, before: Solution, now: Solution, sol: Solution, a: float) -> None:
    """Fills the trial's rotations, forces and unknown knots: the solution now plus `a` times the last step."""
    f = 1.0 + a
    for k in range(sol.q.shape[0]):
        p = (
            f * now.q[k, 0] - a * before.q[k, 0],
            f * now.q[k, 1] - a * before.q[k, 1],
            f * now.q[k, 2] - a * before.q[k, 2],
            f * now.q[k, 3] - a * before.q[k, 3],
        )
        sol.q[k, 0], sol.q[k, 1], sol.q[k, 2], sol.q[k, 3] = qnormal(p)
    for j in range(sol.lam.shape[0]):
        for i in range(3):
            sol.lam[j, i] = f * now.lam[j, i] - a * before.lam[j, i]
    for k in range(sol.pose.shape[0]):
        if plan.vertices[k, 1] >= 0 or is_leaf(plan, k):
            for i in range(3):
                sol.pose[k, i] = f * now.pose[k, i] - a * before.pose[k, i]


@viewing(forceinline=True)
def turn_knots(plan: Plan, model: Model, before: Solution, now: Solution, sol: Solution, a: float) -> None:
    """Rotations of the knots that turn: carried on; those that turn about d3 alone keep the d3 that is given."""
    f = 1.0 + a
    for k in range(sol.pose.shape[0]):
        if plan.vertices[k, 0] < 0:
            continue
        given = rotation_of(sol.pose, k)
        x, y = rotation_of(now.pose, k), rotation_of(before.pose, k)
        p = qnormal((f * x[0] - a * y[0], f * x[1] - a * y[1], f * x[2] - a * y[2], f * x[3] - a * y[3]))
        if model.loose[k, 0] == 0.0:
            angle, axis = angle_axis(tangent(p), tangent(given))
            p = qnormal(qmul(qexp(scale(angle, axis)), p))
        put_rotation(sol.pose, k, p)


@inline
def wanted_turn(plan: Plan, model: Model, sol: Solution, j: int, end: int) -> tuple[bool, bool, Vector, Quaternion]:
    """Whether an end's tangent is given, and its roll; the turn (world) from the trial's rotation to it; that frame."""
    knot = plan.ends[j, end]
    node = plan.first[j + end] + j
    target = rotation_of(sol.pose, knot)
    if plan.turned[j, end] != 0:
        target = qmul(target, (model.frame[j, end, 0], model.frame[j, end, 1], model.frame[j, end, 2],
                               model.frame[j, end, 3]))  # fmt: skip
    own = plan.tied[j, end] == 0
    if own and model.free[j, end, 0] != 0.0:
        return False, False, (0.0, 0.0, 0.0), target
    q = get4(sol.q, node)
    if own and model.free[j, end, 2] != 0.0:
        angle, axis = angle_axis(tangent(q), tangent(target))
        return True, False, scale(angle, axis), target
    miss = qmul(target, qconj(q))
    if miss[3] < 0.0:
        miss, target = negative(miss), negative(target)
    return True, True, qlog(miss), target


@viewing(forceinline=True)
def turn_ends(plan: Plan, model: Model, sol: Solution) -> None:
    """Turns the rotations of every span so that those given at its ends are met, linearly along it."""
    q, s = sol.q, model.s
    for j in range(sol.lam.shape[0]):
        first, last = plan.first[j] + j, plan.first[j + 1] + j
        held0, roll0, turn0, target0 = wanted_turn(plan, model, sol, j, 0)
        held1, roll1, turn1, target1 = wanted_turn(plan, model, sol, j, 1)
        if not held0:
            turn0 = turn1
        if not held1:
            turn1 = turn0
        if turn0 != (0.0, 0.0, 0.0) or turn1 != (0.0, 0.0, 0.0):
            f = 1.0 / (s[last] - s[first])
            for k in range(first, last + 1):
                x = f * (s[k] - s[first])
                p = qnormal(qmul(qexp(add(scale(1.0 - x, turn0), scale(x, turn1))), get4(q, k)))
                q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
        if roll0:
            q[first, 0], q[first, 1], q[first, 2], q[first, 3] = target0
        if roll1:
            q[last, 0], q[last, 1], q[last, 2], q[last, 3] = target1


@viewing(forceinline=True)
def reach(plan: Plan, model: Model, now: Solution, sol: Solution, far: float) -> float:
    """`far`, or less: how far [rad] a frame may turn from its prediction as the knots move as they do.

    A cable that snaps turns its frames by a jump however little its supports move.
    """
    motion = 0.0
    for k in range(sol.pose.shape[0]):
        if plan.vertices[k, 1] >= 0 or is_leaf(plan, k):
            continue
        way = turn = 0.0
        for i in range(3):
            way += (sol.pose[k, i] - sol.pose[0, i] - now.pose[k, i] + now.pose[0, i]) ** 2
        if plan.vertices[k, 0] < 0:
            for i in range(3, 7):
                turn += (sol.pose[k, i] - now.pose[k, i]) ** 2
        motion += math.sqrt(way) / model.par[LENGTH] + 2.0 * math.sqrt(turn)
    return min(far, model.par[TURN_AT_REST] + TURN_OF_MOTION * motion)
