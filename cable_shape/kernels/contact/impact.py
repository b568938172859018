"""What arrives at a body stops there, and what hangs on it stops with it: an impact runs along the cable.

A node that stops changes how fast the elements beside it become shorter. They do not, so the next part of a step would
have to make up for it, by forces that grow as it becomes shorter, until elements buckle under them. Instead impulses
run along the cable (`impulse`), of masses that bodies press along the surface alone, with knots and points of elements
that bodies press.

Nodes, and points between them, first stop as if nothing hung on them: their velocities become the nearest by masses,
which is the projection in kinetic energy, and so do accelerations, of which the scheme's energy has sums of squares
(`momentum`). Frames have no inertia, and are no part of it. An element whose chord became shorter does so on. Impulses
may work on that: of them only so much is taken that there is no more energy than before, but for the work of bodies
that move. Where all chords stay as they are (`taut`), they are all of such a projection.

Where a step does not lead anywhere although it is as short as may be, what would arrive in it stops ahead of it
(`foresee`): a straight cable that comes down on its end would have to buckle in that time.
"""

from __future__ import annotations

import math

from cable_shape.kernels.contact.check import carried
from cable_shape.kernels.contact.near import NONE
from cable_shape.kernels.contact.points import heavy_at, note_rings, rates_at, speed_of, stop_points
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.impulse import bars, begin_anew, go_along, hold_on, note, spend
from cable_shape.kernels.network.momentum import (
    KINETIC,
    Momentum,
    kinetic,
    momentum_of,
)
from cable_shape.kernels.network.motion import N_PROPS, Motion, motion_of
from cable_shape.kernels.network.props import (
    DRY,
    GAVE,
    GRIP,
    HOLDER,
    LEVEL,
    NORMAL,
    PUSH,
    SOFT,
    STUCK,
    brace,
    give_way,
    now_at,
    place_of,
    side_of,
    sides,
    sticks,
)
from cable_shape.kernels.network.swinging import I_DISSIPATED, I_WORK
from cable_shape.kernels.network.tables import (
    TRIAL,
    Floats,
    Plan,
    Whole,
    model_of,
    plan_of,
    solution_of,
)
from cable_shape.kernels.network.walls import AT, BODY, OUT, PUSHED, ROUGH, RUB, WALL, across
from cable_shape.kernels.rod_algebra import (
    Matrix,
    add,
    apply,
    dot,
    get3,
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

#: A knot that a body stops has so many times its mass.
STOPPED = 1e9
#: Columns of a point for what it was before the impact, so many from LEVEL on; friction of one that sticks, and gap of
#: one that nothing presses.
KEPT, SPARE, FAST = 20, 9, 1e9
FAINT = 1e-30  # [N]


@viewing
def stop(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, dt: float,
    bodies: Bodies, knots: Whole, kept: Floats, rings: Floats, info: Floats, taut: bool,
) -> None:  # fmt: skip
    """Gives what is pressed the speed of what presses it, and adds up work and what is dissipated.

    taut: no element becomes shorter or longer after it, not only not by it, with given knots as fast as on their way to
    the trial, dt [s] from now; and accelerations begin anew.

    knots, kept, rings: of `tables.Skin`; in `kept` is what was remembered before the step dt [s].
    """
    plan, model = plan_of(ints), model_of(ints, floats)
    motion, memory = motion_of(ints, moving), momentum_of(ints, remembered)
    a, b = kept.shape[0] - moving.shape[0] - remembered.shape[0], kept.shape[0] - moving.shape[0]
    before = momentum_of(ints, kept[a:b])
    energy = memory.par[KINETIC]
    if not taut and not pressed(motion):
        return
    note(plan, motion, memory, taut)
    if taut:
        begin_anew(motion, memory)
        go_along(plan, motion, memory, solution_of(ints, sols, TRIAL), dt)
    work, given, taken = stop_points(plan, motion, memory, before, bodies, rings, dt)
    note_rings(plan, model, motion, rings)
    for node in range(motion.walls.shape[0]):
        if motion.walls[node, 0] > 0.0:
            mass, _ = heavy_at(plan, motion, memory, knots[node], node)
            own, impact, lost = stop_node(plan, motion, memory, before, bodies, knots[node], node, mass, dt)
            work, given, taken = work + own, given + impact, taken + lost
    bars(ints, floats, space, moving, remembered)
    pushed = shove(ints, floats, sols, space, moving, memory) if motion.par[N_PROPS] > 0.0 else 0.0
    given += spend(ints, floats, space, moving, remembered, energy + given, pushed)
    memory.par[KINETIC], _ = kinetic(motion, memory)
    info[I_WORK] += work + given
    info[I_DISSIPATED] += taken + given + energy - memory.par[KINETIC]
    hold_on(motion)


@viewing
def foresee(ints: Whole, moving: Floats, remembered: Floats, dt: float) -> None:
    """Has planes press, by next to nothing, on what gets to them in dt [s], and slip there; and on nothing else."""
    plan, motion, memory = plan_of(ints), motion_of(ints, moving), momentum_of(ints, remembered)
    for node in range(motion.walls.shape[0]):
        x = add(get3(memory.place, node), scale(dt, get3(memory.velocity, node)))
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            n = take3(motion.walls, node, i + OUT)
            push = FAINT if dot(n, x) < motion.walls[node, i + AT] else 0.0
            motion.walls[node, i + PUSHED] = push
            put3(motion.walls, node, i + RUB, scale(push * motion.walls[node, i + ROUGH], across(n)))
    props = motion.props
    for i in range(int(motion.par[N_PROPS])):
        n = take3(props, i, NORMAL)
        if props[i, HOLDER] >= 0.0:
            x = add(
                place_of(plan, props, i, memory.place, memory.tangent),
                scale(dt, speed_of(plan, motion, memory, i, False)),
            )
            push = FAINT if dot(n, x) < props[i, LEVEL] else 0.0
            props[i, PUSH] = push
            put3(props, i, DRY, scale(push * props[i, GRIP], across(n)))


@viewing
def pressed(motion: Motion) -> bool:
    """Whether a body, or an eyelet, acts on anything."""
    found = False
    for node in range(motion.walls.shape[0]):
        for k in range(int(motion.walls[node, 0])):
            found = found or motion.walls[node, 1 + WALL * k + PUSHED] > 0.0
    for i in range(int(motion.par[N_PROPS])):
        found = found or motion.props[i, HOLDER] < 0.0 or motion.props[i, PUSH] > 0.0
    return found


@inline
def stop_node(
    plan: Plan, motion: Motion, memory: Momentum, before: Momentum, bodies: Bodies, knot: int, node: int, mass: float,
    dt: float,
) -> tuple[float, float, float]:  # fmt: skip
    """The same of a node, or of all that is in the knot for which it stands, with so much mass [kg].

    Masses beside it stop with it: they turn no more the way that is blocked.

    Returns what bodies have worked in the step and at its end, and what friction has taken [J].
    """
    walls, free, stuck, work, given, taken = motion.walls, IDENTITY, False, 0.0, 0.0, 0.0
    old, x = get3(before.place, node), get3(motion.place, node)
    v, _, _ = rates_at(plan, motion, memory, knot, node)
    for k in range(int(walls[node, 0])):
        i = 1 + WALL * k
        push, b = walls[node, i + PUSHED], int(walls[node, i + BODY])
        if not push > 0.0:
            continue
        n, t = take3(walls, node, i + OUT), take3(walls, node, i + RUB)
        went = subtract(carried(old, bodies.then[b], bodies.frames[b]), old)
        speed = scale(1.0 / dt, went)
        work += dot(add(scale(push, n), t), went)
        taken -= dot(t, subtract(subtract(x, old), went))
        limit = walls[node, i + ROUGH] * push
        if limit > 0.0 and dot(t, t) < 0.999 * limit * limit:  # sticks
            given += mass * dot(speed, subtract(speed, v))
            v, stuck = speed, True
        m = apply(free, n)
        size = math.sqrt(dot(m, m))
        if size < 1e-3:
            continue
        m = scale(1.0 / size, m)
        free = msub(free, outer(m, m))
        way = dot(m, subtract(v, speed))
        given -= mass * way * dot(m, speed)
        v = subtract(v, scale(way, m))
    free = mscale(0.0 if stuck else 1.0, free)
    for k in range(plan.ends.shape[0] if knot >= 0 else 1):
        for end in range(2 if knot >= 0 else 1):
            if knot >= 0 and plan.ends[k, end] != knot:
                continue
            one = plan.first[k + end] + k if knot >= 0 else node
            way_on = add(v, apply(free, subtract(get3(memory.velocity, one), v)))
            put3(memory.velocity, one, 0, way_on)
            put3(memory.acceleration, one, 0, apply(free, get3(memory.acceleration, one)))
            put3(memory.jump, one, 0, apply(free, get3(memory.jump, one)))
            if motion.lever[one] != 0.0:
                put3(memory.turning, one, 0, apply(free, get3(memory.turning, one)))
                put3(memory.bending, one, 0, apply(free, get3(memory.bending, one)))
    leave(plan, motion, node, mass, free)
    return work, given, taken


@inline
def leave(plan: Plan, motion: Motion, node: int, mass: float, free: Matrix) -> None:
    """Leaves impulses on a node, with so much mass [kg], the directions of a projection to move it."""
    if motion.give[node, 0] + motion.give[node, 4] + motion.give[node, 8] > 0.0:
        put9(motion.give, node, 0, mscale(1.0 / mass, free))
        return
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            if plan.first[j + end] + j == node:
                put9(motion.press, j, 12 * end + 3, mscale(STOPPED * mass, msub(IDENTITY, free)))


@inline
def shove(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, memory: Momentum
) -> float:  # fmt: skip
    """Holds points of elements as fast as their bodies, by impulses, into `push`; returns their work [J]."""
    plan, motion, sol = plan_of(ints), motion_of(ints, moving), solution_of(ints, sols, TRIAL)
    props, given = motion.props, 0.0
    for i in range(int(motion.par[N_PROPS])):
        for c in range(SPARE):
            props[i, KEPT + c] = props[i, LEVEL + c]
        r = subtract(now_at(plan, motion, sol, i), speed_of(plan, motion, memory, i, False))
        if props[i, HOLDER] >= 0.0:
            props[i, GRIP] = FAST if sticks(props, i) else 0.0
            level = dot(take3(props, i, NORMAL), add(r, take3(props, i, GAVE)))
            props[i, LEVEL] = level if props[i, PUSH] > 0.0 else -FAST
        props[i, PUSH] = props[i, SOFT] = 0.0
        put3(props, i, STUCK, r)
        put3(props, i, DRY, NONE)
    brace(ints, floats, sols, space, moving, False)
    give_way(ints, motion, 1.0)
    for i in range(int(motion.par[N_PROPS])):
        F = add(scale(props[i, PUSH], take3(props, i, NORMAL)), take3(props, i, DRY))
        held = subtract(speed_of(plan, motion, memory, i, False), speed_of(plan, motion, memory, i, True))
        given += dot(F, subtract(take3(props, i, GAVE), held))
        for side in range(sides(props, i)):
            e, end, weight, _ = side_of(props, i, side)
            node = plan.left[e] + end
            put3(motion.push, node, 0, add(get3(motion.push, node), scale(weight, F)))
        for c in range(SPARE):
            props[i, LEVEL + c] = props[i, KEPT + c]
    return given
