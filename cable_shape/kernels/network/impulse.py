"""Impulses along a network: velocities change at once, and elements keep their lengths, or how fast those change.

Of velocities v of nodes, d more than before something stopped, become v + c with

    M c = J^T lam,   J (d + c) = 0,

J the rates of the elements' chords, M the masses, and lam impulses along the elements. That is the network's own system
(`moving`) with bars for elements, which take no impulse but along themselves, and is solved as such.

The velocities of the scheme meet J v = 0 but for an error of the step. A limp cable that was tight and is not in the
next step has to make up for it in as short a time as that is, by forces as large as that is short: where no step leads
anywhere the cable is made taut (`make_taut`), J (v + c) = 0. That is a projection in kinetic energy, which makes none.
"""

from __future__ import annotations

import math

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import (
    KINETIC,
    LAST_DT,
    RADIUS,
    Momentum,
    kinetic,
    momentum_of,
    scheme_of,
)
from cable_shape.kernels.network.motion import FROZEN, LAW, SPENT, Motion, motion_of
from cable_shape.kernels.network.moving import factor, solve
from cable_shape.kernels.network.tables import (
    TRIAL,
    Floats,
    Plan,
    Solution,
    Whole,
    Work,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    dot,
    get3,
    get9,
    mscale,
    msub,
    outer,
    put3,
    put9,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_element import IDENTITY

#: A bar gives, of what a node does: along itself, so that a straight chain between two grips has no impulse too many,
#: and across; no impulse turns a frame.
ALONG, ACROSS, FIRM = 1e-9, 1e6, 1e12
NONE = (0.0, 0.0, 0.0)
#: Shares of impulses that are told more exactly than they are known are further apart than this, beside each other.
NEAR = 1e-2


@viewing
def make_taut(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, dt: float
) -> tuple[float, float]:  # fmt: skip
    """Has no element become shorter or longer, with given knots as fast as on their way to the trial, dt [s] from now.

    Accelerations begin anew. Returns what the knots have worked and what is dissipated [J].
    """
    plan, motion, memory = plan_of(ints), motion_of(ints, moving), momentum_of(ints, remembered)
    energy = memory.par[KINETIC]
    note(plan, motion, memory, True)
    begin_anew(motion, memory)
    go_along(plan, motion, memory, solution_of(ints, sols, TRIAL), dt)
    bars(ints, floats, space, moving, remembered)
    given = spend(ints, floats, space, moving, remembered, energy, 0.0)
    memory.par[KINETIC], _ = kinetic(motion, memory)
    hold_on(motion)
    return given, given + energy - memory.par[KINETIC]


@viewing
def note(plan: Plan, motion: Motion, memory: Momentum, taut: bool) -> None:
    """Before anything stops: velocities, and that masses alone hold nodes."""
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j] + j, plan.first[j + 1] + j
        for node in range(first, last + 1):
            mass = memory.mass[node] + memory.point[node]
            put3(motion.seat, node, 0, NONE if taut else get3(memory.velocity, node))
            motion.origin[node, 0], motion.hold[node] = motion.hold[node], mass
            free = first < node < last or motion.loose[node] != 0.0
            put9(motion.give, node, 0, mscale(1.0 / mass if free else 0.0, IDENTITY))
            put3(motion.push, node, 0, NONE)
        for c in range(24):
            motion.press[j, c] = 0.0
        for c in range(18):
            motion.tilt[j, c] = 0.0


@viewing
def hold_on(motion: Motion) -> None:
    """Takes back what `note` has put for how firmly nodes are held."""
    for node in range(motion.hold.shape[0]):
        motion.hold[node] = motion.origin[node, 0]


@viewing
def begin_anew(motion: Motion, memory: Momentum) -> None:
    """Has masses go as fast as their energy tells (`kinetic`), without what the scheme still owes of accelerations."""
    t = scheme_of(memory.par[RADIUS], memory.par[LAST_DT])
    for node in range(motion.hold.shape[0]):
        owed = scale(0.5 * t.alpha * t.dt, get3(memory.jump, node))
        put3(memory.velocity, node, 0, add(get3(memory.velocity, node), owed))
        for rates in (memory.acceleration, memory.bending, memory.jump):
            put3(rates, node, 0, NONE)


@viewing
def go_along(plan: Plan, motion: Motion, memory: Momentum, sol: Solution, dt: float) -> None:
    """Has elements beside knots that are given feel how fast those go in the next dt [s]."""
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            k, node = plan.ends[j, end], plan.first[j + end] + j
            if plan.vertices[k, 1] < 0 and motion.loose[node] == 0.0:
                rate = scale(1.0 / dt, subtract(take3(sol.pose, k, 0), get3(memory.place, node)))
                put3(motion.seat, node, 0, subtract(get3(memory.velocity, node), rate))


@viewing
def bars(ints: Whole, floats: Floats, space: Floats, moving: Floats, remembered: Floats) -> None:
    """Fills matrix and right-hand side of elements as bars, and factors."""
    stretch(plan_of(ints), work_of(ints, space), motion_of(ints, moving), momentum_of(ints, remembered))
    factor(ints, floats, space, moving, 0.0)


@viewing
def spend(
    ints: Whole, floats: Floats, space: Floats, moving: Floats, remembered: Floats, most: float, given: float
) -> float:  # fmt: skip
    """Passes on what has stopped since `note`, as far as there is no more energy than `most` [J] and what it returns.

    That is what is worked by those that press, `given` [J] by impulses in `push`, and by given knots. What share of
    them that is stands in `SPENT`; where laws are frozen it is all where it was all, and else about as much.
    """
    solve(ints, floats, space, moving)
    plan, work, motion = plan_of(ints), work_of(ints, space), motion_of(ints, moving)
    memory, change = momentum_of(ints, remembered), 0.0
    before, _ = kinetic(motion, memory)
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1]
        for e in range(first, last + 1):
            node = e + j
            v, pull = get3(memory.velocity, node), get3(motion.push, node)
            if first < e < last or motion.loose[node] != 0.0:
                pull = subtract(pull, get3(motion.step, e - 1))
                pull = add(pull, get3(motion.step, e)) if e < last else pull
                c = apply(get9(motion.give, node, 0), pull)
                given += dot(subtract(scale(motion.hold[node], c), pull), v)
            else:
                end = 0 if e == first else 1
                c = take3(work.move, plan.ends[j, end], 3)
                given -= dot(apply(get9(motion.press, j, 12 * end + 3), c), v)
                if plan.vertices[plan.ends[j, end], 1] < 0:
                    pull = get3(motion.step, e) if end == 0 else scale(-1.0, get3(motion.step, e - 1))
                    given -= dot(pull, slowed(motion, memory, node))
            put3(motion.seat, node, 0, c)
            put3(memory.velocity, node, 0, add(v, c))
            change += 0.5 * motion.hold[node] * dot(c, c)
    after, _ = kinetic(motion, memory)
    # with the share x of it: before + b x + change x^2 <= most + given x
    b, room, share = after - before - change - given, max(most - before, 0.0), 1.0
    held = motion.par[LAW] == FROZEN
    if motion.par[SPENT] < 1.0 if held else b + change > room:
        root = math.sqrt(b * b + 4.0 * change * room)
        share = 2.0 * room / (b + root) if b > 0.0 else 0.5 * (root - b) / change
    if held and abs(share - motion.par[SPENT]) > NEAR:
        share = motion.par[SPENT]
    motion.par[SPENT] = share
    if share == 1.0:
        return given
    for node in range(motion.seat.shape[0]):
        put3(memory.velocity, node, 0, add(get3(memory.velocity, node), scale(share - 1.0, get3(motion.seat, node))))
    return share * given


@inline
def stretch(plan: Plan, work: Work, motion: Motion, memory: Momentum) -> None:
    """Fills the matrix of elements as bars, and by how much what has stopped makes them longer [m/s]."""
    total = 0.0
    for k in range(work.D.shape[0]):
        total += motion.hold[k]
        put9(work.D, k, 0, mscale(FIRM, IDENTITY))
        put3(work.G, k, 0, NONE)
    for k in range(work.pull.shape[0]):
        put3(work.pull, k, 0, NONE)
    soft = work.D.shape[0] / total
    for j in range(plan.ends.shape[0]):
        for c in range(6):
            motion.tug[j, c] = 0.0
        for e in range(plan.first[j], plan.first[j + 1]):
            k = e + j
            way = subtract(get3(memory.place, k + 1), get3(memory.place, k))
            t = scale(1.0 / math.sqrt(dot(way, way)), way)
            rate = subtract(slowed(motion, memory, k + 1), slowed(motion, memory, k))
            for c in range(9):
                work.U[e, c] = work.parts[e, 9 + c] = work.parts[e, 18 + c] = 0.0
            put9(work.parts, e, 27, mscale(soft, msub(mscale(ACROSS - ALONG, outer(t, t)), mscale(ACROSS, IDENTITY))))
            put3(motion.slack, e, 0, scale(dot(t, rate), t))


@inline
def slowed(motion: Motion, memory: Momentum, node: int) -> Vector:
    """[m/s], by how much a node has changed its velocity."""
    return subtract(get3(memory.velocity, node), get3(motion.seat, node))
