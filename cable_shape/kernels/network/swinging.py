"""A network that swings: one implicit step in time, and the same in shorter ones where Newton's method stalls.

A step is a minimum, or at least stationary, of the network's energy and

    sum over nodes of 1/2 hold |x - aim|^2

with the places x of the masses, see `momentum`: settling (`settle`) with other numbers. A node has the mass of half of
the elements beside it. That is of fourth order in the elements' length inside a span, since the elements' own error is
as large, and opposite; what is left at its ends is that of the trapezoidal rule, -rho h^2 / 12 v . v' of the kinetic
energy, which the mass of the last node takes off by lying h / 6 inside.
"""

from __future__ import annotations

import math

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.impulse import make_taut
from cable_shape.kernels.network.momentum import (
    ENERGY,
    KINETIC,
    LAST_DT,
    LOSING,
    PERIOD,
    Momentum,
    aim_nodes,
    damp,
    force_of_mass,
    kinetic,
    momentum_of,
    move_on,
    strain_up,
)
from cable_shape.kernels.network.motion import N_PROPS, N_WALLED, Motion, lever_torque, motion_of, put_places
from cable_shape.kernels.network.newton import CONVERGED, STALLED
from cable_shape.kernels.network.settle import I_EXCESS, I_ITERATIONS, I_LAST, load_up, newton
from cable_shape.kernels.network.swing_start import SHAKEN, STARTS, is_equal, note_swerve, shake, start_from
from cable_shape.kernels.network.system import gradient
from cable_shape.kernels.network.tables import (
    NOW,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    Work,
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
    apply,
    dot,
    get3,
    get4,
    put3,
    qconj,
    qlog,
    qmul,
    qnormal,
    rotation,
    scale,
    subtract,
    take3,
)

#: An iteration of a step that changes no more [rad] is the last: the next one would change its square. In short steps
#: less, so that rates are as right: in units of the square of dt over sqrt(rho L^4 / EI).
LEAST, LEAST_SHORT, SHORTEST = 3e-6, 0.3, 1e-8
MOST_ITERATIONS, MOST_TOUCHED = 40, 60  # the latter where nodes may be pressed
#: What `step` tells in `info`: iterations of all its parts, into how many it went (0: it was not taken), work of the
#: knots, dissipated by drag and damping, energy and kinetic energy after it [J].
I_PARTS, I_WORK, I_DISSIPATED, I_ENERGY, I_KINETIC = 1, 2, 3, 4, 5
INFO = 8


@viewing
def take_stock(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, dt: float
) -> None:
    """Energy, forces of the knots and rates after a step dt to the trial; 0: at rest, as it is."""
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    memory, sol = momentum_of(ints, remembered), solution_of(ints, sols, TRIAL)
    load_up(plan, model, motion, sol)
    value = gradient(ints, floats, sols, space)
    put_places(plan, model, sol, motion)
    for j in range(plan.ends.shape[0]):
        value -= dot(get3(motion.weight, j), get3(motion.place, plan.first[j] + j))
        for e in range(plan.first[j], plan.first[j + 1]):
            way = subtract(get3(motion.place, e + j + 1), get3(motion.place, e + j))
            value += dot(get3(motion.lam, e), way)
    for k in range(sol.pose.shape[0]):
        value -= dot(get3(model.force, k), take3(sol.pose, k, 0))
    change, power = strain_up(plan, model, work.full, sol, memory, dt)
    react(plan, model, work, motion, memory, sol)
    if dt > 0.0:
        move_on(motion, sol, memory, dt)
        copy_rows(memory.before, memory.lam, 3)
    else:
        copy_rows(memory.before, motion.lam, 3)
    copy_rows(memory.lam, motion.lam, 3)
    memory.par[LAST_DT] = dt
    energy, drag = kinetic(motion, memory)
    memory.par[ENERGY], memory.par[KINETIC], memory.par[LOSING] = value + change, energy, power + drag


@inline
def react(plan: Plan, model: Model, work: Work, motion: Motion, memory: Momentum, sol: Solution) -> None:
    """Fills `reaction`."""
    for k in range(sol.pose.shape[0]):
        put3(memory.reaction, k, 0, scale(-1.0, get3(model.force, k)))
        put3(memory.reaction, k, 3, (0.0, 0.0, 0.0))
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1] - 1
        for end in range(2):
            k = plan.ends[j, end]
            node = first + j if end == 0 else last + j + 1
            n = subtract(force_of_mass(motion, sol, node), get3(motion.push, node))
            if end == 0:
                n = subtract(n, add(get3(motion.lam, first), get3(motion.weight, j)))
                g = take3(work.first, first, 3)
            else:
                n = add(n, get3(motion.lam, last))
                g = take3(work.first, last, 6)
            g = add(g, lever_torque(motion, sol, node))
            put3(memory.reaction, k, 0, add(take3(memory.reaction, k, 0), n))
            M = apply(rotation(get4(sol.q, node)), g)
            put3(memory.reaction, k, 3, add(take3(memory.reaction, k, 3), M))


@inline
def way_of_knot(a: Solution, b: Solution, k: int) -> tuple[Vector, Vector]:
    """By how much knot k has moved [m] and turned [rad] from a to b."""
    p = (a.pose[k, 3], a.pose[k, 4], a.pose[k, 5], a.pose[k, 6])
    q = (b.pose[k, 3], b.pose[k, 4], b.pose[k, 5], b.pose[k, 6])
    turn = qmul(q, qconj(p))
    if turn[3] < 0.0:
        turn = (-turn[0], -turn[1], -turn[2], -turn[3])
    return subtract(take3(b.pose, k, 0), take3(a.pose, k, 0)), qlog(turn)


@inline
def is_loose(plan: Plan, motion: Motion, k: int) -> bool:
    """Whether knot k is an end that nothing holds."""
    loose = False
    for j in range(plan.ends.shape[0]):
        loose = loose or (plan.ends[j, 1] == k and motion.loose[plan.first[j + 1] + j] != 0.0)
    return loose


@inline
def worked(plan: Plan, motion: Motion, memory: Momentum, now: Solution, sol: Solution) -> float:
    """[J], half the work of the given knots under their forces as they are, from now to the trial."""
    work = 0.0
    for k in range(sol.pose.shape[0]):
        if plan.vertices[k, 1] >= 0 or is_loose(plan, motion, k):
            continue
        way, turn = way_of_knot(now, sol, k)
        work += 0.5 * dot(take3(memory.reaction, k, 0), way)
        if plan.vertices[k, 0] < 0:
            work += 0.5 * dot(take3(memory.reaction, k, 3), turn)
    return work


@viewing
def attempt(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, dt: float,
    info: Floats, told: Floats, start: int,
) -> int:  # fmt: skip
    """One step dt [s] to the knots that are given in the trial; CONVERGED, and the trial is the solution now, or not.

    info (INFO,) adds up; told (INFO of `settle`,): scratch. start: the first of STARTS; among bodies the only one.
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    memory = momentum_of(ints, remembered)
    sol, now = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW)
    aim_nodes(motion, memory, dt)
    damp(model, memory, dt)
    last = memory.par[LAST_DT]
    a = min(dt / last, 2.0) if last > 0.0 else 0.0
    least = min(LEAST, max(SHORTEST, LEAST_SHORT * dt * dt / memory.par[PERIOD]))
    touched = motion.par[N_WALLED] > 0.0 or motion.par[N_PROPS] > 0.0
    most = MOST_TOUCHED if touched else MOST_ITERATIONS
    status, i = STALLED, start
    swerves = start == 0 and is_equal(memory, dt)
    while i < len(STARTS):
        forces, shape = STARTS[i]
        start_from(ints, sols, plan, model, motion, memory, forces * a, shape * a, swerves)
        size, one, other = SHAKEN[i]
        if touched and size > 0.0:
            shake(plan, sol, size, one, other)
        status = newton(ints, floats, sols, space, moving, math.inf, most, least, told)
        info[I_ITERATIONS] += told[I_ITERATIONS]
        if status == STALLED and told[I_EXCESS] == 0.0 and told[I_LAST] < LEAST:
            status = CONVERGED
        if status == CONVERGED or touched or a == 0.0:
            break
        i, swerves = (i, False) if swerves else (i + 1, False)
    if status != CONVERGED:
        return status
    info[I_WORK] += worked(plan, motion, memory, now, sol)
    info[I_DISSIPATED] += 0.5 * dt * memory.par[LOSING]
    note_swerve(ints, sols, motion, memory, dt)
    take_stock(ints, floats, sols, space, moving, remembered, dt)
    info[I_WORK] += worked(plan, motion, memory, now, sol)
    info[I_DISSIPATED] += 0.5 * dt * memory.par[LOSING]
    size = solution_size(ints)
    copy(sols[size : 2 * size], sols[0:size])
    copy(sols[0:size], sols[2 * size : 3 * size])
    return CONVERGED


@viewing
def step(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goal: Floats,
    dt: float, kept: Floats, info: Floats, told: Floats,
) -> int:  # fmt: skip
    """One step dt [s] to the knots `goal` (k, 7), in 1, 4, 8 or 16 parts; CONVERGED, or nothing has changed.

    Where none leads anywhere so once more from the cable made taut. kept: room for solutions and twice the memory.
    """
    plan, size, whole = plan_of(ints), solution_size(ints), sols.shape[0]
    both = whole + remembered.shape[0]
    copy(kept[:whole], sols)
    copy(kept[whole:both], remembered)
    status, given, gone = CONVERGED, 0.0, 0.0
    info[I_ITERATIONS] = 0.0
    for taut in range(2):
        if taut == 1:
            copy(kept[both : both + remembered.shape[0]], remembered)
            part_way(plan, solution_of(ints, kept, NOW), solution_of(ints, sols, TRIAL), goal, 1.0)
            given, gone = make_taut(ints, floats, sols, space, moving, remembered, dt)
            copy(kept[whole:both], remembered)
        parts = 1
        while parts <= 16:
            for i in range(info.shape[0]):
                if i != I_ITERATIONS:
                    info[i] = 0.0
            info[I_WORK], info[I_DISSIPATED] = given, gone
            for i in range(parts):
                part_way(plan, solution_of(ints, kept, NOW), solution_of(ints, sols, TRIAL), goal, (i + 1.0) / parts)
                status = attempt(ints, floats, sols, space, moving, remembered, dt / parts, info, told, 0)
                if status != CONVERGED:
                    break
            if status == CONVERGED:
                memory = momentum_of(ints, remembered)
                info[I_PARTS], info[I_ENERGY], info[I_KINETIC] = parts, memory.par[ENERGY], memory.par[KINETIC]
                return CONVERGED
            copy(sols, kept[:whole])
            copy(remembered, kept[whole:both])
            parts = 4 if parts == 1 else 2 * parts
    copy(remembered, kept[both : both + remembered.shape[0]])
    copy(sols[2 * size : 3 * size], sols[0:size])
    return status


@inline
def part_way(plan: Plan, now: Solution, sol: Solution, goal: Floats, x: float) -> None:
    """Puts the knots that are given into the trial: at the fraction x from where they were to `goal`."""
    for k in range(goal.shape[0]):
        if plan.vertices[k, 1] < 0:
            for i in range(3):
                sol.pose[k, i] = (1.0 - x) * now.pose[k, i] + x * goal[k, i]
        y = x
        cosine = 0.0
        for i in range(3, 7):
            cosine += now.pose[k, i] * goal[k, i]
        if cosine < 0.0:
            y = -x
        q = (
            (1.0 - x) * now.pose[k, 3] + y * goal[k, 3],
            (1.0 - x) * now.pose[k, 4] + y * goal[k, 4],
            (1.0 - x) * now.pose[k, 5] + y * goal[k, 5],
            (1.0 - x) * now.pose[k, 6] + y * goal[k, 6],
        )
        sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6] = qnormal(q)
