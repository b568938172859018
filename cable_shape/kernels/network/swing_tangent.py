"""How a swinging network would move if a number were another: tangents, carried from step to step by its factors.

A step in time is F(x, s, p) = 0 with rotations, forces and places x, what is remembered s, and numbers p, such as those
of the cable or where a grip goes. With the matrix M of Newton's method at the solution, the derivative x' follows from

    x' <- x' - M^-1 dF,   dF = (F(x + e x', s + e s', p + e p') - F(x - e x', s - e s', p - e p')) / 2 e,

which ends where dF is zero, however near M is to dF/dx: it may have a shift. It begins with x' of the last step. So
no formula of the step is written down twice.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.momentum import (
    Momentum,
    aim_nodes,
    carry,
    damp,
    momentum_of,
    scheme_of,
    strain_up,
)
from cable_shape.kernels.network.motion import Motion, motion_of, put_places
from cable_shape.kernels.network.moving import factor, solve
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.settle import assemble, balance, load_up
from cable_shape.kernels.network.swinging import I_PARTS, attempt, part_way, step
from cable_shape.kernels.network.system import fold
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    LENGTH,
    NOW,
    SOFTEST,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    dot,
    get3,
    get4,
    put3,
    qexp,
    qmul,
    qnormal,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)

#: Differences go so far, of what changes most: rotations [rad], lengths, FORCES times that in forces, in the largest.
NEAR, FORCES = 2e-6, 0.01
#: Rounds of a step, and of the state at rest; a round after which the next one would change no more, of what changes
#: most, is the last. Less than SMALLEST counts as that. TRUST: so many times slower than others a number may come near.
MOST_ROUNDS, MOST_AT_REST, SAME, SMALLEST, TRUST = 6, 60, 1e-7, 1e-3, 3.0
#: Springs that hold what is at rest meanwhile, of the softest stiffness.
SOFT = 0.03


class Tangent(NamedTuple):
    """Derivatives of a network of N elements, m spans, n nodes and k knots by one number."""

    d: Floats  # (n, 3) rotations of the nodes, own frames, but for what knots are turned by
    lam: Floats  # (N, 3) forces
    move: Floats  # (k, 6) rotation (own frame) and place of knots, where those are unknown
    place: Floats  # (n, 3) what is remembered, see `Momentum`
    velocity: Floats  # (n, 3)
    acceleration: Floats  # (n, 3)
    tangent: Floats  # (n, 3)
    turning: Floats  # (n, 3)
    bending: Floats  # (n, 3)
    strain: Floats  # (N, 6)
    strained: Floats  # (N, 6)
    mass: Floats  # (n,) what the network is made of, see `Momentum`, `Motion` and `Model`
    drag: Floats  # (n,)
    lever: Floats  # (n,)
    delay: Floats  # (N,)
    rest: Floats  # (N, 6)
    section: Floats  # (N, 9)
    load: Floats  # (N, 9)
    weight: Floats  # (m, 3)
    h: Floats  # (N,)


@viewing(forceinline=True)
def tangent_of(ints: Whole, flat: Floats) -> Tangent:
    """The parts of a tangent."""
    n, m = ints[0], ints[1]
    k = n + m
    o1 = 3 * k
    o2 = o1 + 3 * n
    o3 = o2 + 6 * ints[2]
    o4 = o3 + 18 * k
    o5 = o4 + 12 * n
    o6 = o5 + 3 * k
    o7 = o6 + 25 * n
    o8 = o7 + 3 * m
    return Tangent(
        part(flat, 0, (k, 3)),
        part(flat, o1, (n, 3)),
        part(flat, o2, (ints[2], 6)),
        part(flat, o3, (k, 3)),
        part(flat, o3 + 3 * k, (k, 3)),
        part(flat, o3 + 6 * k, (k, 3)),
        part(flat, o3 + 9 * k, (k, 3)),
        part(flat, o3 + 12 * k, (k, 3)),
        part(flat, o3 + 15 * k, (k, 3)),
        part(flat, o4, (n, 6)),
        part(flat, o4 + 6 * n, (n, 6)),
        part(flat, o5, (k,)),
        part(flat, o5 + k, (k,)),
        part(flat, o5 + 2 * k, (k,)),
        part(flat, o6, (n,)),
        part(flat, o6 + n, (n, 6)),
        part(flat, o6 + 7 * n, (n, 9)),
        part(flat, o6 + 16 * n, (n, 9)),
        part(flat, o7, (m, 3)),
        part(flat, o8, (n,)),
    )  # fmt: skip


@viewing
def tangent_size(ints: Whole) -> int:
    """Numbers of a tangent of a network with this head."""
    return 24 * (ints[0] + ints[1]) + 41 * ints[0] + 6 * ints[2] + 3 * ints[1]


class Beside(NamedTuple):
    """Room for the network once more, where its numbers are others, and for two differences."""

    floats: Floats
    sols: Floats
    space: Floats
    moving: Floats
    remembered: Floats
    before: Floats  # what is remembered, before a part of a step
    sums: Floats  # (n + N + 2 m + k, 3): right-hand sides
    move: Floats  # (n, 3), and of the places
    turn: Floats  # (n, 3), tangents
    strain: Floats  # (N, 6), and mean curvatures


@inline
def twist_of(plan: Plan, model: Model, sol: Solution, twists: Floats, k: int) -> Vector:
    """How the frame of knot k is turned by what is given, own frame."""
    q = (sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6])
    t = tapply(rotation(q), take3(twists, k, 3))
    return (t[0] * (1.0 - model.loose[k, 0]), t[1] * (1.0 - model.loose[k, 1]), t[2] * (1.0 - model.loose[k, 2]))


@inline
def turn_of(plan: Plan, model: Model, sol: Solution, twists: Floats, j: int, end: int) -> Vector:
    """How an end of span j is turned by what is given, own frame."""
    k = plan.ends[j, end]
    if plan.tied[j, end] == 0:
        f = model.free
        t = tapply(rotation(get4(sol.q, plan.first[j + end] + j)), take3(twists, k, 3))
        return (t[0] * (1.0 - f[j, end, 0]), t[1] * (1.0 - f[j, end, 1]), t[2] * (1.0 - f[j, end, 2]))
    t = twist_of(plan, model, sol, twists, k)
    if plan.turned[j, end] != 0:
        f = model.frame
        t = tapply(rotation((f[j, end, 0], f[j, end, 1], f[j, end, 2], f[j, end, 3])), t)
    return t


@viewing(forceinline=True)
def soften(model: Model, motion: Motion, memory: Momentum) -> None:
    """Holds the nodes of a network at rest softly to where they are."""
    for i in range(motion.hold.shape[0]):
        motion.hold[i] = SOFT * model.par[SOFTEST] / model.par[LENGTH]
        motion.lever[i] = 0.0
        put3(motion.aim, i, 0, get3(memory.place, i))
        put3(motion.origin, i, 0, get3(memory.place, i))


@viewing
def put_beside(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, before: Floats, dt: float, tangent: Floats,
    twists: Floats, by: float, to: Beside,
) -> None:  # fmt: skip
    """Makes `to` the network at the end of a step dt [s], 0: at rest, `by` times the tangent away."""
    put_made(ints, floats, moving, before, dt, tangent, by, to)
    put_way(ints, floats, sols, moving, tangent, twists, by, to)


@viewing
def put_made(
    ints: Whole, floats: Floats, moving: Floats, before: Floats, dt: float, tangent: Floats, by: float, to: Beside
) -> None:  # fmt: skip
    """The same of what it is made of, and remembers."""
    plan, model, own = plan_of(ints), model_of(ints, floats), model_of(ints, to.floats)
    motion, there, t = motion_of(ints, moving), motion_of(ints, to.moving), tangent_of(ints, tangent)
    memory, then = momentum_of(ints, before), momentum_of(ints, to.remembered)
    for i in range(memory.par.shape[0]):
        then.par[i] = memory.par[i]
    for e in range(model.h.shape[0]):
        own.h[e] = model.h[e] + by * t.h[e]
        then.delay[e] = memory.delay[e] + by * t.delay[e]
        for c in range(9):
            own.section[e, c] = then.section[e, c] = memory.section[e, c] + by * t.section[e, c]
            there.load[e, c] = motion.load[e, c] + by * t.load[e, c]
        for c in range(6):
            own.rest[e, c] = then.rest[e, c] = memory.rest[e, c] + by * t.rest[e, c]
            then.strain[e, c] = memory.strain[e, c] + by * t.strain[e, c]
            then.strained[e, c] = memory.strained[e, c] + by * t.strained[e, c]
    for i in range(memory.mass.shape[0]):
        then.mass[i], then.point[i] = memory.mass[i] + by * t.mass[i], memory.point[i]
        there.drag[i] = motion.drag[i] + by * t.drag[i]
        there.lever[i] = motion.lever[i] + by * t.lever[i]
        for c in range(3):
            then.place[i, c] = memory.place[i, c] + by * t.place[i, c]
            then.velocity[i, c] = memory.velocity[i, c] + by * t.velocity[i, c]
            then.acceleration[i, c] = memory.acceleration[i, c] + by * t.acceleration[i, c]
            then.tangent[i, c] = memory.tangent[i, c] + by * t.tangent[i, c]
            then.turning[i, c] = memory.turning[i, c] + by * t.turning[i, c]
            then.bending[i, c] = memory.bending[i, c] + by * t.bending[i, c]
    for j in range(plan.ends.shape[0]):
        for c in range(3):
            there.weight[j, c] = motion.weight[j, c] + by * t.weight[j, c]
    if dt > 0.0:
        aim_nodes(there, then, dt)
        damp(own, then, dt)
    else:
        soften(own, there, then)


@viewing
def put_way(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, tangent: Floats, twists: Floats, by: float, to: Beside
) -> None:  # fmt: skip
    """The same of its rotations, forces and places."""
    size = solution_size(ints)
    copy(to.sols[2 * size : 3 * size], sols[0:size])
    plan, model, t = plan_of(ints), model_of(ints, floats), tangent_of(ints, tangent)
    motion, there = motion_of(ints, moving), motion_of(ints, to.moving)
    sol, now = solution_of(ints, to.sols, TRIAL), solution_of(ints, sols, NOW)
    for e in range(motion.lam.shape[0]):
        for c in range(3):
            there.lam[e, c] = motion.lam[e, c] + by * t.lam[e, c]
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j] + j, plan.first[j + 1] + j
        for i in range(first, last + 1):
            d = get3(t.d, i)
            if i == first:
                d = add(d, turn_of(plan, model, now, twists, j, 0))
            elif i == last:
                d = add(d, turn_of(plan, model, now, twists, j, 1))
            sol.q[i, 0], sol.q[i, 1], sol.q[i, 2], sol.q[i, 3] = qnormal(qmul(get4(sol.q, i), qexp(scale(by, d))))
    for k in range(sol.pose.shape[0]):
        way = take3(t.move, k, 3) if plan.vertices[k, 1] >= 0 else take3(twists, k, 0)
        turn = twist_of(plan, model, now, twists, k)
        if plan.vertices[k, 0] >= 0:
            turn = add(turn, get3(t.move, k))
        q = (sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6])
        put3(sol.pose, k, 0, add(take3(sol.pose, k, 0), scale(by, way)))
        sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6] = qnormal(qmul(q, qexp(scale(by, turn))))


@inline
def largest_of(rows: Floats) -> float:
    """The largest norm of a row's first three numbers."""
    most = 0.0
    for i in range(rows.shape[0]):
        v = get3(rows, i)
        most = max(most, dot(v, v))
    return math.sqrt(most)


@inline
def farthest(rows: Floats, others: Floats) -> float:
    """The largest norm of a difference."""
    most = 0.0
    for i in range(rows.shape[0]):
        v = subtract(get3(rows, i), get3(others, i))
        most = max(most, dot(v, v))
    return math.sqrt(most)


@viewing
def nearness(
    ints: Whole, floats: Floats, moving: Floats, tangent: Floats, twists: Floats, least: float
) -> float:  # fmt: skip
    """How many times a tangent differences may go; of one that is less than `least` as many as of that."""
    model, motion, t = model_of(ints, floats), motion_of(ints, moving), tangent_of(ints, tangent)
    most = max(least, max(largest_of(t.d), max(largest_of(t.place), largest_of(twists)) / model.par[LENGTH]))
    for k in range(twists.shape[0]):
        w = take3(twists, k, 3)
        most = max(most, math.sqrt(dot(w, w)))
    force = largest_of(motion.lam) + model.par[SOFTEST]
    return NEAR / max(most, FORCES * largest_of(t.lam) / force)


@viewing
def add_sums(ints: Whole, to: Beside, by: float) -> None:
    """Adds `by` times the right-hand side at hand to the sums."""
    work, motion = work_of(ints, to.space), motion_of(ints, to.moving)
    i = 0
    for rows, columns in ((work.G, 3), (motion.slack, 3), (motion.tug, 6), (work.pull, 3)):
        for k in range(rows.shape[0]):
            for c in range(columns):
                to.sums[i + c // 3, c % 3] += by * rows[k, c]
            i += columns // 3


@viewing
def take_sums(ints: Whole, space: Floats, moving: Floats, to: Beside) -> None:
    """Makes the sums the right-hand side."""
    work, motion = work_of(ints, space), motion_of(ints, moving)
    i = 0
    for rows, columns in ((work.G, 3), (motion.slack, 3), (motion.tug, 6), (work.pull, 3)):
        for k in range(rows.shape[0]):
            for c in range(columns):
                rows[k, c] = to.sums[i + c // 3, c % 3]
            i += columns // 3


@viewing
def round_of(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, before: Floats, dt: float,
    tangent: Floats, twists: Floats, to: Beside,
) -> tuple[float, float]:  # fmt: skip
    """Improves x' once; returns by how much, of what changes most, and how many times x' differences went."""
    e = nearness(ints, floats, moving, tangent, twists, 1.0)
    to.sums[:, :] = 0.0
    for sign in (1.0, -1.0):
        put_beside(ints, floats, sols, moving, before, dt, tangent, twists, sign * e, to)
        balance(ints, to.floats, to.sols, to.space, to.moving)
        add_sums(ints, to, 0.5 * sign / e)
    take_sums(ints, space, moving, to)
    solve(ints, floats, space, moving)
    return go(ints, space, moving, tangent), e


@viewing
def go(ints: Whole, space: Floats, moving: Floats, tangent: Floats) -> float:
    """Adds what was solved for to x'; returns how much that is, of what changes most."""
    plan, t = plan_of(ints), tangent_of(ints, tangent)
    work, motion = work_of(ints, space), motion_of(ints, moving)
    for i in range(t.d.shape[0]):
        put3(t.d, i, 0, add(get3(t.d, i), get3(work.d, i)))
    for i in range(t.lam.shape[0]):
        put3(t.lam, i, 0, add(get3(t.lam, i), get3(motion.step, i)))
    for k in range(t.move.shape[0]):
        if plan.vertices[k, 0] >= 0:
            put3(t.move, k, 0, add(get3(t.move, k), get3(work.move, k)))
        if plan.vertices[k, 1] >= 0:
            put3(t.move, k, 3, add(take3(t.move, k, 3), take3(work.move, k, 3)))
    return largest_of(work.d) / max(largest_of(t.d), SMALLEST)


@viewing
def differences(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, before: Floats, dt: float, tangent: Floats,
    twists: Floats, to: Beside, e: float,
) -> None:  # fmt: skip
    """Fills `to.move`, `to.turn` and `to.strain`: change of places, tangents and mean curvatures with x'.

    e: how many times x' the differences of `round_of` went, whose last one `to` still has; 0: it has not.
    """
    known = e > 0.0
    e = e if known else nearness(ints, floats, moving, tangent, twists, 1.0)
    to.move[:, :] = 0.0
    to.turn[:, :] = 0.0
    to.strain[:, :] = 0.0
    for sign in (-1.0, 1.0):
        by = 0.5 * sign / e
        if sign > 0.0 or not known:
            put_made(ints, floats, moving, before, dt, tangent, sign * e, to)
        put_way(ints, floats, sols, moving, tangent, twists, sign * e, to)
        plan, model, work = plan_of(ints), model_of(ints, to.floats), work_of(ints, to.space)
        motion, memory = motion_of(ints, to.moving), momentum_of(ints, to.remembered)
        sol = solution_of(ints, to.sols, TRIAL)
        load_up(plan, model, motion, sol)
        put_places(plan, model, sol, motion)
        fold(plan, model, sol.lam, work.full)
        strain_up(plan, model, work.full, sol, memory, dt)
        for i in range(to.move.shape[0]):
            R = rotation(get4(sol.q, i))
            put3(to.move, i, 0, add(get3(to.move, i), scale(by, get3(motion.place, i))))
            put3(to.turn, i, 0, add(get3(to.turn, i), scale(by, (R[2], R[5], R[8]))))
        for i in range(to.strain.shape[0]):
            for c in range(6):
                to.strain[i, c] += by * memory.strain[i, c]


@viewing
def carry_on(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, before: Floats, dt: float,
    tangents: Floats, twists: Floats, to: Beside,
) -> None:  # fmt: skip
    """Carries tangents (p, size) over the step dt [s] from `before` to the solution now; twists (p, k, 6): of the knots
    at its end, velocity and angular velocity, world."""
    model, motion, memory = model_of(ints, floats), motion_of(ints, moving), momentum_of(ints, before)
    size, scheme = solution_size(ints), scheme_of(0.0, max(dt, 1.0))
    copy(sols[2 * size : 3 * size], sols[0:size])
    if dt > 0.0:
        scheme = scheme_of(memory.par[0], dt)
        aim_nodes(motion, memory, dt)
        damp(model, memory, dt)
    else:
        copy(part(to.before, 0, (motion.lever.shape[0],)), motion.lever)
        soften(model, motion, memory)
    assemble(ints, floats, sols, space, moving)
    factor(ints, floats, space, moving, model.par[BASE_SHIFT])
    copy(to.floats, floats)
    for i in range(motion.loose.shape[0]):
        motion_of(ints, to.moving).loose[i] = motion.loose[i]
    for i in range(motion.push.shape[0]):
        put3(motion_of(ints, to.moving).push, i, 0, get3(motion.push, i))
    rate = 0.0  # of what changes in a round, what does in the next: the most that was seen
    for p in range(tangents.shape[0]):
        t = tangent_of(ints, tangents[p])
        last, e = 1.0, 0.0
        for i in range(MOST_ROUNDS if dt > 0.0 else MOST_AT_REST):
            change, e = round_of(ints, floats, sols, space, moving, before, dt, tangents[p], twists[p], to)
            if dt == 0.0:
                differences(ints, floats, sols, moving, before, dt, tangents[p], twists[p], to, 0.0)
                change = max(change, farthest(t.place, to.move) / max(largest_of(to.move), SMALLEST))
                copy_rows(t.place, to.move, 3)
            if i > 0 and dt > 0.0:
                rate = max(rate, change / last)
            if not change * min(change / last, TRUST * rate if rate > 0.0 else 1.0, 1.0) > SAME:
                break
            last = change
        e = e if dt > 0.0 else 0.0
        differences(ints, floats, sols, moving, before, dt, tangents[p], twists[p], to, e)
        for i in range(t.place.shape[0]):
            if dt > 0.0:
                carry(t.place, t.velocity, t.acceleration, i, get3(to.move, i), scheme)
                carry(t.tangent, t.turning, t.bending, i, get3(to.turn, i), scheme)
            else:
                put3(t.place, i, 0, get3(to.move, i))
                put3(t.tangent, i, 0, get3(to.turn, i))
        copy_rows(t.strained, t.strain if dt > 0.0 else to.strain, 6)
        copy_rows(t.strain, to.strain, 6)
    if dt == 0.0:
        copy(motion.lever, part(to.before, 0, (motion.lever.shape[0],)))


@kernel
def begin(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, tangents: Floats,
    twists: Floats, to: Beside,
) -> None:  # fmt: skip
    """Fills tangents (p, size), in which is what changes of what the network is made of, for the state at rest."""
    carry_on(ints, floats, sols, space, moving, remembered, 0.0, tangents, twists, to)


@kernel
def follow(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goal: Floats,
    dt: float, kept: Floats, info: Floats, told: Floats, tangents: Floats, begun: Floats, twists: Floats, to: Beside,
) -> None:  # fmt: skip
    """Carries tangents over the step that `swinging.step` has just taken, with what it leaves in `kept` and `info`.

    begun, twists (p, k, 6): of the knots before and after it; of the way between, in shorter steps, the same share.
    """
    whole, parts = sols.shape[0], int(info[I_PARTS])
    if parts == 1:
        carry_on(ints, floats, sols, space, moving, kept[whole:], dt, tangents, twists, to)
        return
    plan, size = plan_of(ints), solution_size(ints)
    copy(sols, kept[:whole])
    copy(remembered, kept[whole:])
    mixed, own = twists.copy(), info.copy()
    for i in range(parts):
        x = (i + 1.0) / parts
        copy(to.before, remembered)
        part_way(plan, solution_of(ints, kept, NOW), solution_of(ints, sols, TRIAL), goal, x)
        attempt(ints, floats, sols, space, moving, remembered, dt / parts, own, told, 0)
        mixed[:, :, :] = (1.0 - x) * begun + x * twists
        carry_on(ints, floats, sols, space, moving, to.before, dt / parts, tangents, mixed, to)
    copy(sols[2 * size : 3 * size], sols[0:size])


@kernel
def run(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goals: Floats,
    steps: Floats, kept: Floats, info: Floats, told: Floats, places: Floats, tangents: Floats, velocities: Floats,
    derived: Floats, begun: Floats, twists: Floats, to: Beside, of_places: Floats, of_tangents: Floats,
    of_velocities: Floats,
) -> int:  # fmt: skip
    """`swing_run.run` with tangents `derived` (p, size), and what their knots do, begun (p, k, 6), twists (T, p, k, 6).

    Fills of_places, of_tangents and of_velocities (T, n, 3, p), too.
    """
    memory, lost = momentum_of(ints, remembered), 0
    for i in range(steps.shape[0]):
        code = step(ints, floats, sols, space, moving, remembered, goals[i], steps[i], kept, info, told)
        if code == CONVERGED:
            then = begun if i == 0 else twists[i - 1]
            follow(
                ints, floats, sols, space, moving, remembered, goals[i], steps[i], kept, info, told, derived, then,
                twists[i], to,
            )  # fmt: skip
        else:
            lost += 1
        copy_rows(places[i], memory.place, 3)
        copy_rows(tangents[i], memory.tangent, 3)
        copy_rows(velocities[i], memory.velocity, 3)
        for p in range(derived.shape[0]):
            t = tangent_of(ints, derived[p])
            for k in range(t.place.shape[0]):
                for c in range(3):
                    of_places[i, k, c, p] = t.place[k, c]
                    of_tangents[i, k, c, p] = t.tangent[k, c]
                    of_velocities[i, k, c, p] = t.velocity[k, c]
    return lost
