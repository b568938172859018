"""What arrives at a body stops there, and what hangs on it stops with it: an impact runs along the cable.

A node that stops changes how fast the elements beside it become shorter. They do not, so the next part of a step would
have to make up for it, by forces that grow as it becomes shorter, until elements buckle under them. Instead the
velocities v of nodes, d more than before they stopped, become v + c with

    M c = J^T lam,   J (d + c) = 0,

J the rates of the elements' chords, M the masses, of those that bodies press along the surface alone, and lam impulses
along the elements. That is the network's own system (`moving`) with bars for elements, which take no impulse but along
themselves, and is solved as such, knots and points of elements that bodies press with it.

Nodes, and points between them, first stop as if nothing hung on them: their velocities become the nearest by masses,
which is the projection in kinetic energy, and so do accelerations, of which the scheme's energy has sums of squares
(`momentum`). Frames have no inertia, and are no part of it. An element whose chord became shorter does so on. Impulses
may work on that: of c only so much is taken that there is no more energy than before, but for the work of bodies that
move. Where all chords stay as they are (`taut`), c is all of such a projection.

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
from cable_shape.kernels.network.momentum import (
    KINETIC,
    LAST_DT,
    RADIUS,
    Momentum,
    kinetic,
    momentum_of,
    scheme_of,
)
from cable_shape.kernels.network.motion import N_PROPS, Motion, motion_of
from cable_shape.kernels.network.moving import factor, solve
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GAVE,
    GRIP,
    HOLDER,
    LEVEL,
    NORMAL,
    PUSH,
    SOFT,
    STUCK,
    WEIGHTS,
    brace,
    give_way,
    now_at,
    place_of,
    sticks,
)
from cable_shape.kernels.network.swinging import I_DISSIPATED, I_WORK
from cable_shape.kernels.network.tables import (
    TRIAL,
    Floats,
    Plan,
    Solution,
    Whole,
    Work,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.network.walls import AT, BODY, OUT, PUSHED, ROUGH, RUB, WALL, across
from cable_shape.kernels.rod_algebra import (
    Matrix,
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
#: and across. A knot that a body stops has so many times its mass; no impulse turns a frame.
ALONG, ACROSS, STOPPED, FIRM = 1e-9, 1e6, 1e9, 1e12
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

    knots, kept, rings: of `swung.Skin`; in `kept` is what was remembered before the step dt [s].
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
    given += pass_on(ints, floats, sols, space, moving, remembered, energy + given)
    memory.par[KINETIC], _ = kinetic(motion, memory)
    info[I_WORK] += work + given
    info[I_DISSIPATED] += taken + given + energy - memory.par[KINETIC]
    for node in range(motion.hold.shape[0]):
        motion.hold[node] = motion.origin[node, 0]


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


@viewing
def pass_on(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, most: float
) -> float:  # fmt: skip
    """Passes on what has stopped since `note`, as far as there is no more energy than `most` [J] and what it returns.

    That is what bodies work which impulses press on them [J].
    """
    plan, work, motion = plan_of(ints), work_of(ints, space), motion_of(ints, moving)
    memory = momentum_of(ints, remembered)
    stretch(plan, work, motion, memory)
    factor(ints, floats, space, moving, 0.0)
    given = 0.0
    if motion.par[N_PROPS] > 0.0:
        given = shove(ints, floats, sols, space, moving, memory)
    solve(ints, floats, space, moving)
    change = 0.0
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
    b, room = after - before - change - given, max(most - before, 0.0)
    if b + change <= room:
        return given
    root = math.sqrt(b * b + 4.0 * change * room)
    share = 2.0 * room / (b + root) if b > 0.0 else 0.5 * (root - b) / change
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
            way = subtract(get3(motion.place, k + 1), get3(motion.place, k))
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
    brace(ints, floats, sols, space, moving)
    give_way(ints, motion, 1.0)
    for i in range(int(motion.par[N_PROPS])):
        F = add(scale(props[i, PUSH], take3(props, i, NORMAL)), take3(props, i, DRY))
        held = subtract(speed_of(plan, motion, memory, i, False), speed_of(plan, motion, memory, i, True))
        given += dot(F, subtract(take3(props, i, GAVE), held))
        node = plan.left[int(props[i, ELEMENT])]
        for side in range(2):
            own = scale(props[i, WEIGHTS + side], F)
            put3(motion.push, node + side, 0, add(get3(motion.push, node + side), own))
        for c in range(SPARE):
            props[i, LEVEL + c] = props[i, KEPT + c]
    return given
