"""How a network that swings among bodies would move if a number were another: `swing_tangent` through contact.

The parts in which a step went are gone through once more (`Skin.log`), each with its x' and s' as there. Beside it, the
planes are laid anew where nodes, and the same points of elements, are then; what is pressed, sticks or slips stays so,
and nothing else comes to be (`walls.frozen`). Forces on points are unknown, too: they follow from the network's answers
to each. Friction remembers, so s' has it; and an impact is the difference of two, with as large a share of its
impulses (`impulse.spend`). So derivatives are those of a motion that touches the same in the same parts. How often
something else is touched is counted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.held import (
    FIRMER,
    Felt,
    changes,
    close,
    feel,
    lay_again,
    lay_at_rest,
    misses,
    steady,
    yield_points,
)
from cable_shape.kernels.contact.impact import foresee, stop
from cable_shape.kernels.contact.swung import BRACED, MET, copy_back, copy_state, lengthen, set_out, step
from cable_shape.kernels.contact.swung_look import look
from cable_shape.kernels.contact.tables import Bodies, Skin
from cable_shape.kernels.distance.surface import place_bodies
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.momentum import (
    KINETIC,
    LAST_DT,
    aim_nodes,
    damp,
    kinetic,
    momentum_of,
    move_on,
    strain_up,
)
from cable_shape.kernels.network.motion import N_PROPS, ROWS, Motion, motion_of, put_places
from cable_shape.kernels.network.moving import factor, solve
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.props import HOLDER, PAIRED, answer, lean
from cable_shape.kernels.network.settle import assemble, balance, load_up
from cable_shape.kernels.network.swing_tangent import (
    MOST_AT_REST,
    SAME,
    TRUST,
    Beside,
    Tangent,
    add_sums,
    go,
    nearness,
    put_beside,
    soften,
    take_sums,
    tangent_of,
)
from cable_shape.kernels.network.swinging import attempt, part_way
from cable_shape.kernels.network.system import fold
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    LENGTH,
    NOW,
    TRIAL,
    Floats,
    Whole,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
    work_of,
)
from cable_shape.kernels.rod_algebra import add, get3, get4, put3, rotation, scale, take3

#: Rounds of a part of a step: the matrix does not know how friction grows with the push, which makes more of them; at
#: rest there is none.
MOST_ROUNDS, MOST_SETTLED = 40, 6
#: Differences of a tangent smaller than this go as far as those of one as large: planes are stiff, and rounding counts.
SMALL = 0.003


class Aside(NamedTuple):
    """Room for what bodies do to the network beside."""

    kept: Array  # as `Skin.kept`
    rings: Array  # as `Skin.rings`
    info: Array
    rows: Array  # (ROWS, ROWS + 2) equations of the forces on points
    change: Array  # (ROWS,) [N], of those
    next: Array  # (size,) a tangent after a part
    rub: Array  # of that, see `Felt`
    dry: Array
    jump: Array


@viewing
def beside(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, before: Floats, dt: float, tangent: Floats,
    twists: Floats, by: float, to: Beside, bodies: Bodies, skin: Skin, felt: Felt, p: int,
) -> None:  # fmt: skip
    """`swing_tangent.put_beside`, with what bodies do to it."""
    put_beside(ints, floats, sols, moving, before, dt, tangent, twists, by, to)
    if dt > 0.0:
        old = skin.kept[skin.kept.shape[0] - moving.shape[0] :]
        lay_again(ints, moving, old, dt, to, bodies, skin, felt.rub[p], felt.dry[p], felt.push[p], by)
    else:
        lay_at_rest(ints, moving, to, bodies, skin, felt.push[p], by)


@viewing
def round_of(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, before: Floats, dt: float,
    tangent: Floats, twists: Floats, to: Beside, bodies: Bodies, skin: Skin, felt: Felt, p: int, aside: Aside,
) -> float:  # fmt: skip
    """`swing_tangent.round_of`, forces on points with it."""
    e = nearness(ints, floats, moving, tangent, twists, SMALL)
    count = int(motion_of(ints, moving).par[N_PROPS])
    to.sums[:, :] = 0.0
    for row in range(3 * count):
        aside.rows[row, ROWS] = 0.0
    for sign in (1.0, -1.0):
        beside(ints, floats, sols, moving, before, dt, tangent, twists, sign * e, to, bodies, skin, felt, p)
        balance(ints, to.floats, to.sols, to.space, to.moving)
        add_sums(ints, to, 0.5 * sign / e)
        misses(ints, to.sols, moving, to.moving, aside.rows, 0.5 * sign / e)
    take_sums(ints, space, moving, to)
    if count > 0:
        solve(ints, floats, space, moving)
        yield_points(ints, sols, space, moving, aside.rows, aside.change)
        take_sums(ints, space, moving, to)
        steady(ints, floats, sols, space, moving, aside.change)
        for i in range(count):
            for c in range(3):
                felt.push[p, i, c] += aside.change[3 * i + c]
    solve(ints, floats, space, moving)
    return float(go(ints, space, moving, tangent))


@viewing
def lead(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, before: Floats, dt: float, tangent: Floats,
    twists: Floats, to: Beside, bodies: Bodies, skin: Skin, felt: Felt, p: int, aside: Aside, braced: bool,
) -> None:  # fmt: skip
    """Fills `next`, and what is felt with it: the difference of what x' and s' lead to in a part dt [s], 0: at rest.

    With what stops after it; braced: what would arrive in it stops ahead of it, and nothing else.
    """
    e = nearness(ints, floats, moving, tangent, twists, SMALL)
    plan, t = plan_of(ints), tangent_of(ints, aside.next)
    copy(aside.next, tangent)
    for rows in (
        t.place,
        t.velocity,
        t.acceleration,
        t.tangent,
        t.turning,
        t.bending,
        aside.rub,
        aside.dry,
        aside.jump,
    ):
        rows[:, :] = 0.0
    for rows in (t.strain, t.strained):
        rows[:, :] = 0.0
    a = aside.kept.shape[0] - moving.shape[0] - before.shape[0]
    for sign in (1.0, -1.0):
        by = 0.5 * sign / e
        beside(ints, floats, sols, moving, before, dt, tangent, twists, sign * e, to, bodies, skin, felt, p)
        model, work, sol = model_of(ints, to.floats), work_of(ints, to.space), solution_of(ints, to.sols, TRIAL)
        there, then = motion_of(ints, to.moving), momentum_of(ints, to.remembered)
        copy_rows(then.jump, momentum_of(ints, before).jump, 3)
        for k in range(then.jump.shape[0]):
            put3(then.jump, k, 0, add(get3(then.jump, k), scale(sign * e, get3(felt.jump[p], k))))
        copy(aside.kept[a : a + before.shape[0]], to.remembered)
        copy_rows(aside.rings, skin.rings, aside.rings.shape[1])
        if braced:
            copy_rows(there.place, then.place, 3)
            given = solution_of(ints, sols, TRIAL)
            for k in range(sol.pose.shape[0]):
                if plan.vertices[k, 1] < 0:
                    put3(sol.pose, k, 0, add(take3(given.pose, k, 0), scale(sign * e, take3(twists, k, 0))))
        else:
            load_up(plan, model, there, sol)
            lean(plan, model, sol, work, there)
            put_places(plan, model, sol, there)
            fold(plan, model, sol.lam, work.full)
            strain_up(plan, model, work.full, sol, then, dt)
            if dt > 0.0:
                move_on(there, sol, then, dt)
                then.par[LAST_DT] = dt
                then.par[KINETIC], _ = kinetic(there, then)
        if dt > 0.0:
            stop(
                ints, to.floats, to.sols, to.space, to.moving, to.remembered, dt, bodies, skin.knot, aside.kept,
                aside.rings, aside.info, braced,
            )  # fmt: skip
        gather(t.strain, then.strain, by)
        gather(t.strained, then.strained, by)
        if dt == 0.0:
            for k in range(t.place.shape[0]):
                R = rotation(get4(sol.q, k))
                put3(then.tangent, k, 0, (R[2], R[5], R[8]))
            copy_rows(then.place, there.place, 3)
        gather(t.place, then.place, by)
        gather(t.velocity, then.velocity, by)
        gather(t.acceleration, then.acceleration, by)
        gather(t.tangent, then.tangent, by)
        gather(t.turning, then.turning, by)
        gather(t.bending, then.bending, by)
        feel(ints, to.moving, to.remembered, aside.rub, aside.dry, aside.jump, by)


@viewing
def gather(rows: Floats, others: Floats, by: float) -> None:
    """Adds `by` times other rows."""
    for k in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            rows[k, c] += by * others[k, c]


@viewing
def arrive(tangent: Floats, felt: Felt, p: int, aside: Aside) -> None:
    """Makes what `lead` has found the tangent."""
    copy(tangent, aside.next)
    copy_rows(felt.rub[p], aside.rub, 3)
    copy_rows(felt.dry[p], aside.dry, 3)
    copy_rows(felt.jump[p], aside.jump, 3)


@viewing
def hold_beside(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, to: Beside) -> None:
    """Factors the matrix of the solution now, and finds what it answers to forces on points."""
    model, motion, size = model_of(ints, floats), motion_of(ints, moving), solution_size(ints)
    copy(sols[2 * size : 3 * size], sols[0:size])
    assemble(ints, floats, sols, space, moving)
    factor(ints, floats, space, moving, model.par[BASE_SHIFT])
    answer(ints, floats, sols, space, moving)
    copy(to.floats, floats)
    there = motion_of(ints, to.moving)
    for i in range(motion.loose.shape[0]):
        there.loose[i] = motion.loose[i]
        put3(there.push, i, 0, get3(motion.push, i))


@viewing
def carry_on(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, before: Floats, dt: float,
    tangents: Floats, twists: Floats, to: Beside, bodies: Bodies, skin: Skin, felt: Felt, aside: Aside,
) -> None:  # fmt: skip
    """Carries rotations, forces and knots of tangents (p, size) over a part dt [s] that has led to the solution now."""
    model, motion, memory = model_of(ints, floats), motion_of(ints, moving), momentum_of(ints, before)
    aim_nodes(motion, memory, dt)
    damp(model, memory, dt)
    hold_beside(ints, floats, sols, space, moving, to)
    felt.push[:, :, :] = 0.0
    rate = 0.0
    for p in range(tangents.shape[0]):
        last = 1.0
        for i in range(MOST_ROUNDS):
            change = round_of(
                ints, floats, sols, space, moving, before, dt, tangents[p], twists[p], to, bodies, skin, felt, p, aside
            )
            if i > 0:
                rate = max(rate, change / last)
            if not change * min(change / last, TRUST * rate if rate > 0.0 else 1.0, 1.0) > SAME:
                break
            last = change


@viewing
def settled(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, tangent: Floats,
    twists: Floats, to: Beside, bodies: Bodies, skin: Skin, felt: Felt, p: int, aside: Aside,
) -> None:  # fmt: skip
    """Fills `next` with where x' leads at rest if planes, points and springs go with the places of the tangent."""
    for _ in range(MOST_SETTLED):
        change = round_of(
            ints, floats, sols, space, moving, remembered, 0.0, tangent, twists, to, bodies, skin, felt, p, aside
        )
        if not change > SAME:
            break
    lead(
        ints, floats, sols, moving, remembered, 0.0, tangent, twists, to, bodies, skin, felt, p, aside, False
    )  # fmt: skip


@viewing
def leave_pairs(motion: Motion) -> float:
    """Leaves out pairs, which are last: where cables press on each other no derivative is told. Returns how many
    points there were with them."""
    count = motion.par[N_PROPS]
    while motion.par[N_PROPS] > 0.0 and motion.props[int(motion.par[N_PROPS]) - 1, HOLDER] == PAIRED:
        motion.par[N_PROPS] -= 1.0
    return float(count)


@kernel
def begin(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, tangents: Floats,
    twists: Floats, to: Beside, bodies: Bodies, skin: Skin, felt: Felt, aside: Aside,
) -> None:  # fmt: skip
    """`swing_tangent.begin` among bodies, where nothing rubs.

    Planes and points lie where nodes are, and the springs that hold those meanwhile: places u lead to others, g(u). Of
    u = g(u) what is missed is made least in the ways gone so far (the method of conjugate residuals).
    """
    model, motion, memory = model_of(ints, floats), motion_of(ints, moving), momentum_of(ints, remembered)
    lever, n = motion.lever.copy(), motion.lever.shape[0]
    leave_pairs(motion)
    close(motion, memory)
    soften(model, motion, memory)
    for k in range(n):
        motion.hold[k] *= FIRMER
    hold_beside(ints, floats, sols, space, moving, to)
    felt.push[:, :, :] = 0.0
    ways, answers = np.empty((MOST_AT_REST, 6 * n)), np.empty((MOST_AT_REST, 6 * n))
    u, miss, length = np.empty(6 * n), np.empty(6 * n), model.par[LENGTH]
    for p in range(tangents.shape[0]):
        t, there = tangent_of(ints, tangents[p]), tangent_of(ints, aside.next)
        u[:] = 0.0
        for k in range(-1, MOST_AT_REST):
            way = u if k < 0 else u + miss
            put_places_of(t, way, length)
            settled(
                ints, floats, sols, space, moving, remembered, tangents[p], twists[p], to, bodies, skin, felt, p, aside
            )  # fmt: skip
            take_places_of(there, ways[max(k, 0)], length)
            if k < 0:
                miss[:] = ways[0]
                continue
            answers[k] = miss - (ways[k] - way)
            ways[k] = miss
            for j in range(k):
                share = np.sum(answers[k] * answers[j])
                answers[k] -= share * answers[j]
                ways[k] -= share * ways[j]
            size = math.sqrt(np.sum(answers[k] ** 2))
            if not size > 0.0:
                break
            answers[k] /= size
            ways[k] /= size
            share = np.sum(miss * answers[k])
            u += share * ways[k]
            miss -= share * answers[k]
            if not np.sum(miss**2) > SAME**2 * np.sum(u**2):
                break
        put_places_of(t, u, length)
        settled(
            ints, floats, sols, space, moving, remembered, tangents[p], twists[p], to, bodies, skin, felt, p, aside
        )  # fmt: skip
        arrive(tangents[p], felt, p, aside)
    felt.rub[:, :, :] = 0.0
    felt.dry[:, :, :] = 0.0
    felt.jump[:, :, :] = 0.0
    motion.lever[:] = lever


@viewing
def put_places_of(t: Tangent, u: Floats, length: float) -> None:
    """Puts places, in lengths, and tangents u (6 n,) into a tangent."""
    n = t.place.shape[0]
    for k in range(n):
        for c in range(3):
            t.place[k, c], t.tangent[k, c] = length * u[3 * k + c], u[3 * (n + k) + c]


@viewing
def take_places_of(t: Tangent, u: Floats, length: float) -> None:
    """Takes them from there."""
    n = t.place.shape[0]
    for k in range(n):
        for c in range(3):
            u[3 * k + c], u[3 * (n + k) + c] = t.place[k, c] / length, t.tangent[k, c]


@kernel
def follow(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goal: Floats,
    dt: float, kept: Floats, info: Floats, told: Floats, tangents: Floats, begun: Floats, twists: Floats, to: Beside,
    bodies: Bodies, skin: Skin, felt: Felt, aside: Aside,
) -> int:  # fmt: skip
    """Carries tangents over the step that `swung.step` has just taken, see `swing_tangent.follow`.

    Returns in how many parts something else was touched than before, or otherwise.
    """
    plan, whole, found = plan_of(ints), sols.shape[0], 0
    b = whole + remembered.shape[0]
    after, touched = np.empty_like(kept), np.empty_like(moving)
    copy_state(after, sols, remembered, moving)
    rings = skin.rings.copy()
    skin.rings[:, :] = skin.rings_then
    then, links = bodies.frames.copy(), np.empty_like(skin.links)
    place_bodies(bodies.table, skin.links_then, then)
    now = Bodies(
        bodies.table, then.copy(), then, bodies.triangles, bodies.tree, bodies.stack, bodies.links, bodies.measured,
        bodies.counts, bodies.rough,
    )  # fmt: skip
    own, mixed = info.copy(), twists.copy()
    copy_back(kept, sols, remembered, moving)
    for row in range(1, int(skin.log[0, 0]) + 1):
        done, share, start = skin.log[row, 0], skin.log[row, 1], skin.log[row, 2]
        seconds, x, braced = share * dt, done + share, start == BRACED
        copy_state(skin.kept, sols, remembered, moving)
        set_out(skin, bodies, now, links, done, share)
        mixed[:, :, :] = (1.0 - x) * begun + x * twists
        part_way(plan, solution_of(ints, kept, NOW), solution_of(ints, sols, TRIAL), goal, x)
        if not braced:
            scaled = lengthen(momentum_of(ints, remembered), seconds)
            for p in range(tangents.shape[0]):
                t = tangent_of(ints, tangents[p])
                t.acceleration[:, :] *= scaled
                t.bending[:, :] *= scaled
                felt.jump[p] *= scaled
        look(ints, floats, sols, moving, remembered, seconds, now, skin, True)
        copy(to.before, remembered)
        if braced:
            foresee(ints, moving, remembered, seconds)
            felt.push[:, :, :] = 0.0
        else:
            attempt(ints, floats, sols, space, moving, remembered, seconds, own, told, int(start))
            copy(touched, moving)
            leave_pairs(motion_of(ints, moving))
            carry_on(
                ints, floats, sols, space, moving, to.before, seconds, tangents, mixed, to, now, skin, felt, aside
            )  # fmt: skip
            copy(moving, touched)
        stop(
            ints, floats, sols, space, moving, remembered, seconds, now, skin.knot, skin.kept, skin.rings, own, braced,
        )  # fmt: skip
        points = leave_pairs(motion_of(ints, moving))
        for p in range(tangents.shape[0]):
            lead(
                ints, floats, sols, moving, to.before, seconds, tangents[p], mixed[p], to, now, skin, felt, p, aside,
                braced,
            )  # fmt: skip
            arrive(tangents[p], felt, p, aside)
        motion_of(ints, moving).par[N_PROPS] = points
        found += 1 if braced or changes(ints, skin.kept[b:], moving) else 0
        if not braced:
            then[:, :, :] = now.frames
    copy_back(after, sols, remembered, moving)
    skin.rings[:, :] = rings
    return found


@kernel
def run(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goals: Floats,
    steps: Floats, kept: Floats, info: Floats, told: Floats, places: Floats, tangents: Floats, velocities: Floats,
    derived: Floats, begun: Floats, twists: Floats, to: Beside, of_places: Floats, of_tangents: Floats,
    of_velocities: Floats, bodies: Bodies, skin: Skin, felt: Felt, aside: Aside,
) -> int:  # fmt: skip
    """`swing_tangent.run` among bodies, which stay where they are."""
    memory, lost, met = momentum_of(ints, remembered), 0, 0.0
    for i in range(steps.shape[0]):
        code = step(
            ints, floats, sols, space, moving, remembered, goals[i], steps[i], kept, info, told, bodies, skin
        )  # fmt: skip
        if code == CONVERGED:
            follow(
                ints, floats, sols, space, moving, remembered, goals[i], steps[i], kept, info, told, derived,
                begun if i == 0 else twists[i - 1], twists[i], to, bodies, skin, felt, aside,
            )  # fmt: skip
        else:
            lost += 1
        met = max(met, skin.log[0, MET])
        places[i, :, :], tangents[i, :, :], velocities[i, :, :] = memory.place, memory.tangent, memory.velocity
        for p in range(derived.shape[0]):
            t = tangent_of(ints, derived[p])
            of_places[i, :, :, p], of_tangents[i, :, :, p], of_velocities[i, :, :, p] = t.place, t.tangent, t.velocity
    skin.log[0, MET] = met
    return lost
