"""Steps in time of a network that swings among bodies: planes before every part of a step, and a look after it.

Planes lie where bodies are nearest to nodes (`guard`) and to what is between them (`props`), with all of a convex body
behind. A part of a step is taken if its nodes, in front of all planes, are no further than that has planes for, press
only on what is there, and have passed nothing; else it is tried in half the time. What arrives at a plane stays there:
it takes over the speed of the body along the normal, and where it sticks in every direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.check import buried, carried, passes
from cable_shape.kernels.contact.guard import look_around
from cable_shape.kernels.contact.impact import foresee, stop
from cable_shape.kernels.contact.meeting import find_pairs, parted
from cable_shape.kernels.contact.meeting_again import aim_again, stay_apart, take_again
from cable_shape.kernels.contact.near import NONE
from cable_shape.kernels.contact.points import (
    HELD,
    WENT,
    deepest,
    find_points,
    find_rings,
    heavy_at,
    on_curve,
    put_aside,
)
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.distance.surface import place_bodies, touch
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import (
    ENERGY,
    KINETIC,
    LAST_DT,
    RADIUS,
    Momentum,
    Scheme,
    momentum_of,
    scheme_of,
)
from cable_shape.kernels.network.motion import DEPTH, N_PROPS, N_WALLED, PAIRS, PROP, PROPS, SCRATCH, Motion, motion_of
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GAVE,
    GRIP,
    HOLDER,
    PAIRED,
    PUSH,
    SHARE,
    SOFT,
    place_of,
)
from cable_shape.kernels.network.settle import I_ITERATIONS
from cable_shape.kernels.network.swing_output import tell
from cable_shape.kernels.network.swinging import (
    I_ENERGY,
    I_KINETIC,
    I_PARTS,
    attempt,
    part_way,
)
from cable_shape.kernels.network.tables import (
    LENGTH,
    NOW,
    TRIAL,
    Floats,
    Model,
    Plan,
    Whole,
    copy,
    model_of,
    plan_of,
    solution_of,
    solution_size,
)
from cable_shape.kernels.network.walls import BODY, PUSHED, WALL
from cable_shape.kernels.rod_algebra import Vector, dot, get3, put3, scale, subtract, take3

#: A step goes in parts of this fraction of it at least, each tried from so many of `swing_start.STARTS`.
SHORTEST, TRIES = 1.0 / 256.0, 2
#: [m] planes of bodies that much further away than nodes may get, in units of which way, are known.
MARGIN, AHEAD = 5e-3, 1.5
#: Stiffness of planes and of asperities, in that with which a part of the step holds the node.
FIRM, ASPERITY = 1e4, 10.0
#: Of the length: a node that far off a body is not pressed by it, and a part of the step was too long.
AFLOAT = 2e-4
#: Of the length: that deep the cable may be in a body between its nodes after a part of a step.
DEEP = 2e-4
#: There is room for so many rows in `Skin.log`; in place of the start there.
LOG, BRACED = 1024, -1.0
#: Column of the first one: whether cables have pressed on each other in the step.
MET = 1
#: Times the last one: so much longer a part may be without more ado.
LONGER = 1.5
#: So often points of pairs are found once more, after so many times half the way, if one is further than that, of the
#: length, from where it is to be.
AGAIN, HALF, ON = 6, 4, 5e-6
#: Parts shorter than this go on where the cable is deep, or afloat, for all that.
PATIENT = 1.0 / 16.0


class Skin(NamedTuple):
    """What a network of n nodes is to bodies."""

    thick: Array  # (n,) [m] radius at each node; below 0: what there is of it knows no bodies
    whole: Array  # (n,) [m] length of its cable
    rough: Array  # (n,) coefficient of friction
    knot: Array  # (n,) the knot that moves for which a node stands; INSIDE: for itself; HELD: it has no planes
    clear: Array  # (n,) [m] room: how far each node may go
    kept: Array  # room for a whole state
    links: Array  # (l, 7) where the links were that carry bodies
    rings: Array  # (e, RING) the eyelets, see `points`
    goals: Array  # (e, 3) [m] where those are at the end of the step
    log: Array  # (1 + LOG, 3) how many parts the last step went in, MET; of each where it began, its share, and the
    #             start that led on, see `swing_start.STARTS`; BRACED: what would arrive in it has stopped
    links_then: Array  # (l, 7) links, and
    rings_then: Array  # (e, RING) eyelets, before the last step
    touching: Array  # (p, TOUCHING) what of its cables may touch each other, or itself, see `meeting`


@kernel
def step(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goal: Floats,
    dt: float, kept: Floats, info: Floats, told: Floats, bodies: Bodies, skin: Skin,
) -> int:  # fmt: skip
    """One step dt [s] to the knots `goal` (k, 7), the bodies' links and eyelets; CONVERGED, or nothing has changed.

    kept: room for solutions and memory. `bodies.frames` are those after the step at its end.
    """
    plan = plan_of(ints)
    copy_state(kept, sols, remembered, moving)
    begin = kept[: sols.shape[0]]
    for i in range(info.shape[0]):
        info[i] = 0.0
    then, links = bodies.frames.copy(), np.empty_like(skin.links)
    place_bodies(bodies.table, skin.links, then)
    now = Bodies(
        bodies.table, then.copy(), then, bodies.triangles, bodies.tree, bodies.stack, bodies.links, bodies.measured,
        bodies.counts, bodies.rough,
    )  # fmt: skip
    rings = skin.rings_then
    rings[:, :] = skin.rings
    skin.links_then[:, :] = skin.links
    skin.log[0, 0] = skin.log[0, MET] = 0.0
    rows = np.empty((PAIRS, PROP))
    done, part, sums, braced, minds = 0.0, 1.0, np.empty(info.shape[0]), False, True
    while done < 1.0:
        part = min(part, 1.0 - done) if part < 0.75 * (1.0 - done) else 1.0 - done
        seconds = part * dt
        copy_state(skin.kept, sols, remembered, moving)
        copy(sums, info)
        set_out(skin, bodies, now, links, done, part)
        status = CONVERGED - 1
        for start in range(TRIES):
            if start > 0:
                copy_back(skin.kept, sols, remembered, moving)
            part_way(plan, solution_of(ints, begin, NOW), solution_of(ints, sols, TRIAL), goal, done + part)
            lengthen(momentum_of(ints, remembered), seconds)
            look(ints, floats, sols, moving, remembered, seconds, now, skin, minds)
            status = attempt(ints, floats, sols, space, moving, remembered, seconds, info, told, start)
            for turn in range(AGAIN):
                if (
                    status != CONVERGED
                    or not minds
                    or not come_nearer(ints, floats, moving, remembered, seconds, skin, turn >= HALF, rows)
                ):
                    break
                copy_back(skin.kept, sols, remembered, moving)
                take_back(info, sums)
                part_way(plan, solution_of(ints, begin, NOW), solution_of(ints, sols, TRIAL), goal, done + part)
                lengthen(momentum_of(ints, remembered), seconds)
                look(ints, floats, sols, moving, remembered, seconds, now, skin, minds)
                take_again(motion_of(ints, moving), rows)
                status = attempt(ints, floats, sols, space, moving, remembered, seconds, info, told, start)
            if status == CONVERGED:
                break
        last = part <= SHORTEST
        if status == CONVERGED and fits(ints, floats, moving, remembered, now, skin, part):
            info[I_PARTS] += 1.0
            note_part(skin, done, part, start)
            meets = not minds or press_each_other(motion_of(ints, moving))
            stop(
                ints, floats, sols, space, moving, remembered, seconds, now, skin.knot, skin.kept, skin.rings, info,
                False,
            )  # fmt: skip
            if math.isfinite(momentum_of(ints, remembered).par[KINETIC]):
                skin.log[0, MET] = 1.0 if meets else skin.log[0, MET]
                then[:, :, :] = now.frames
                done += part
                part *= 2.0
                braced, minds = False, True
                continue
            skin.log[0, 0] -= 1.0  # an impact that is no number: on the way there, in shorter parts, are others
        copy_back(skin.kept, sols, remembered, moving)
        take_back(info, sums)
        if last and not braced:
            braced = True
            note_part(skin, done, part, BRACED)
            part_way(plan, solution_of(ints, begin, NOW), solution_of(ints, sols, TRIAL), goal, done + part)
            look(ints, floats, sols, moving, remembered, seconds, now, skin, True)
            foresee(ints, moving, remembered, seconds)
            stop(
                ints, floats, sols, space, moving, remembered, seconds, now, skin.knot, skin.kept, skin.rings, info,
                True,
            )  # fmt: skip
            continue
        if last and minds and skin.touching.shape[0] > 0:
            minds = False  # cables may overlap after so short a part, but not go through each other
            continue
        if last:
            skin.log[0, 0] = 0.0
            copy_back(kept, sols, remembered, moving)
            skin.rings[:, :] = rings
            size = solution_size(ints)
            copy(sols[2 * size : 3 * size], sols[0:size])
            info[I_PARTS] = 0.0
            return status if status != CONVERGED else CONVERGED - 1
        part *= 0.5
    memory = momentum_of(ints, remembered)
    bodies.frames[:, :, :] = now.frames
    skin.links[:, :] = bodies.links
    info[I_ENERGY], info[I_KINETIC] = memory.par[ENERGY], memory.par[KINETIC]
    return CONVERGED


@viewing
def set_out(skin: Skin, bodies: Bodies, now: Bodies, links: Floats, done: float, part: float) -> None:
    """Puts links, the bodies on them and eyelets where they are after this part of the step, that much being done."""
    between(links, skin.links_then, bodies.links, done + part)
    place_bodies(now.table, links, now.frames)
    rings = skin.rings_then
    for k in range(rings.shape[0]):
        for i in range(3):
            skin.rings[k, i] = rings[k, i] + (done + part) * (skin.goals[k, i] - rings[k, i])
            skin.rings[k, WENT + i] = part * (skin.goals[k, i] - rings[k, i])


@inline
def note_part(skin: Skin, done: float, part: float, start: float) -> None:
    """Adds a row to the log."""
    count = min(int(skin.log[0, 0]) + 1, LOG)
    skin.log[0, 0] = count
    skin.log[count, 0], skin.log[count, 1], skin.log[count, 2] = done, part, start


@viewing
def copy_state(kept: Floats, sols: Floats, remembered: Floats, moving: Floats) -> None:
    """Keeps all that a step changes."""
    a, b = sols.shape[0], sols.shape[0] + remembered.shape[0]
    copy(kept[:a], sols)
    copy(kept[a:b], remembered)
    some = moving.shape[0] - SCRATCH
    copy(kept[b : b + some], moving[:some])


@viewing
def copy_back(kept: Floats, sols: Floats, remembered: Floats, moving: Floats) -> None:
    """Takes that back."""
    a, b = sols.shape[0], sols.shape[0] + remembered.shape[0]
    copy(sols, kept[:a])
    copy(remembered, kept[a:b])
    some = moving.shape[0] - SCRATCH
    copy(moving[:some], kept[b : b + some])


@viewing
def press_each_other(motion: Motion) -> bool:
    """Whether cables do, or one does on itself."""
    found = False
    for i in range(int(motion.par[N_PROPS])):
        found = found or (motion.props[i, HOLDER] == PAIRED and motion.props[i, PUSH] > 0.0)
    return found


@inline
def take_back(info: Floats, sums: Floats) -> None:
    """Makes it what it was before a part of a step, but for iterations."""
    iterations = info[I_ITERATIONS]
    copy(info, sums)
    info[I_ITERATIONS] = iterations


@viewing
def come_nearer(
    ints: Whole, floats: Floats, moving: Floats, remembered: Floats, dt: float, skin: Skin, half: bool,
    rows: Floats,
) -> bool:  # fmt: skip
    """Whether cables in a part dt [s] have come nearer than they were to, or press from away; fills `rows`.

    half: with pairs half the way from where they were to where they are nearest now.
    """
    if skin.touching.shape[0] == 0:
        return False
    model, a = model_of(ints, floats), skin.kept.shape[0] - moving.shape[0] - remembered.shape[0]
    before = momentum_of(ints, skin.kept[a : a + remembered.shape[0]])
    off = aim_again(
        plan_of(ints), model, motion_of(ints, moving), momentum_of(ints, remembered), before, skin.touching,
        skin.whole, skin.rough, dt, half, rows,
    )  # fmt: skip
    return bool(off > ON * model.par[LENGTH])


@viewing
def lengthen(memory: Momentum, dt: float) -> float:
    """Scales accelerations for a part dt [s] that is longer than the last one: what of momentum they stand for stays.

    After an impact the scheme gives a mass half of dt a of velocity in the parts to come: in longer ones no more of it.
    Returns by what it scales.
    """
    last = memory.par[LAST_DT]
    if not 0.0 < LONGER * last < dt:
        return 1.0
    for rows in (memory.acceleration, memory.bending, memory.jump):
        for k in range(rows.shape[0]):
            put3(rows, k, 0, scale(last / dt, get3(rows, k)))
    return float(last / dt)


@viewing
def between(links: Floats, then: Floats, now: Floats, x: float) -> None:
    """Fills the poses (l, 7) at the fraction x of the way from `then` to `now`."""
    for k in range(links.shape[0]):
        y, size = x, 0.0
        cosine = 0.0
        for i in range(3, 7):
            cosine += then[k, i] * now[k, i]
        if cosine < 0.0:
            y = -x
        for i in range(7):
            links[k, i] = (1.0 - x) * then[k, i] + (x if i < 3 else y) * now[k, i]
            size += links[k, i] ** 2 if i > 2 else 0.0
        for i in range(3, 7):
            links[k, i] /= math.sqrt(size)


@viewing
def look(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, remembered: Floats, dt: float, bodies: Bodies,
    skin: Skin, minds: bool,
) -> None:  # fmt: skip
    """Gives nodes and points of elements the planes of what they may get to in a part dt [s] of a step.

    minds: cables each other, and themselves.
    """
    plan, model, motion, memory = (
        plan_of(ints),
        model_of(ints, floats),
        motion_of(ints, moving),
        momentum_of(ints, remembered),
    )
    sol, now, t = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW), scheme_of(memory.par[RADIUS], dt)
    farthest = 0.0
    for k in range(memory.mass.shape[0]):
        v, a, p = get3(memory.velocity, k), get3(memory.acceleration, k), get3(memory.place, k)
        farthest = max(farthest, dt * math.sqrt(dot(v, v)) + dt * dt * math.sqrt(dot(a, a)))
        for b in range(bodies.table.shape[0]):
            if bodies.table[b, 11] >= 0.0:
                way = subtract(carried(p, bodies.then[b], bodies.frames[b]), p)
                farthest = max(farthest, math.sqrt(dot(way, way)))
    for k in range(sol.pose.shape[0]):
        way = subtract(take3(sol.pose, k, 0), take3(now.pose, k, 0))
        farthest = max(farthest, math.sqrt(dot(way, way)))
    reach = MARGIN + AHEAD * farthest
    motion.par[N_WALLED] = 0.0
    for j in range(plan.ends.shape[0]):
        for node in range(plan.first[j] + j, plan.first[j + 1] + j + 1):
            skin.clear[node] = math.inf
            if skin.knot[node] == HELD:
                continue
            if motion.loose[node] != 0.0:
                motion.walls[node, 0], skin.clear[node] = 0.0, reach
                continue
            mass, drag = heavy_at(plan, motion, memory, skin.knot[node], node)
            hold = held_by(t, mass, drag)
            skin.clear[node], _ = look_around(
                motion, bodies, bodies.then, node, get3(memory.place, node), model.s[node], skin.thick[node],
                skin.whole[node], reach, FIRM * hold, ASPERITY * hold, False, skin.rough[node],
            )  # fmt: skip
            motion.par[N_WALLED] += 1.0 if motion.walls[node, 0] > 0.0 else 0.0
    room, had = PROPS - skin.rings.shape[0], int(motion.par[N_PROPS])
    find_points(plan, model, motion, memory, bodies, skin.thick, skin.whole, skin.rough, reach, room)
    for i in range(int(motion.par[N_PROPS])):
        node = plan.left[int(motion.props[i, ELEMENT])] + 1
        if motion.props[i, SHARE] == 1.0:
            mass, drag = heavy_at(plan, motion, memory, skin.knot[node], node)
            motion.props[i, SOFT] = 1.0 / (ASPERITY * held_by(t, mass, drag))
            put3(motion.props, i, GAVE, scale(motion.props[i, SOFT], take3(motion.props, i, DRY)))
    find_rings(plan, model, motion, memory, skin.rings, skin.whole)
    if minds and skin.touching.shape[0] > 0:  # what comes together moves from both sides
        both = MARGIN + 2.0 * parted(plan, motion, memory, now, sol, dt)
        find_pairs(plan, model, motion, memory, skin.touching, skin.whole, skin.rough, both, dt, had)


@inline
def held_by(t: Scheme, mass: float, drag: float) -> float:
    """[N/m], how firmly the part of a step at hand holds a mass with its drag."""
    return mass * (1.0 - t.alpha) / (t.beta * t.dt * t.dt) + drag * t.gamma / (t.beta * t.dt)


@kernel
def look_at_rest(
    ints: Whole, floats: Floats, moving: Floats, remembered: Floats, reach: float, stiff: Array, bodies: Bodies,
    skin: Skin,
) -> float:  # fmt: skip
    """Planes of nodes alone, for a step against drag without friction: places and tangents are those remembered.

    stiff (n,) [N/m]: of the planes. Returns how far [m] nodes may move before there may be one in a body that has no
    plane for it.
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    memory, clear = momentum_of(ints, remembered), reach
    for j in range(plan.ends.shape[0]):
        for node in range(plan.first[j] + j, plan.first[j + 1] + j + 1):
            if skin.knot[node] == HELD:
                continue
            own, _ = look_around(
                motion, bodies, bodies.frames, node, get3(memory.place, node), model.s[node], skin.thick[node],
                skin.whole[node], reach, stiff[node], 0.0, True, 0.0,
            )  # fmt: skip
            clear = min(clear, own)
    had, _ = put_aside(motion)
    find_rings(plan, model, motion, memory, skin.rings, skin.whole)
    if skin.touching.shape[0] > 0:
        find_pairs(plan, model, motion, memory, skin.touching, skin.whole, skin.rough, 2.0 * MARGIN, 1.0, had)
        clear = min(clear, MARGIN)
        for i in range(int(motion.par[N_PROPS])):
            motion.props[i, GRIP] *= 1.0 if motion.props[i, HOLDER] < 0.0 else 0.0
    return clear


@kernel
def fits(
    ints: Whole, floats: Floats, moving: Floats, remembered: Floats, bodies: Bodies, skin: Skin, share: float
) -> bool:  # fmt: skip
    """Whether what a part of a step has come to, this share of it, may stand."""
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    a, b = skin.kept.shape[0] - moving.shape[0] - remembered.shape[0], skin.kept.shape[0] - moving.shape[0]
    memory, before = momentum_of(ints, remembered), momentum_of(ints, skin.kept[a:b])
    for j in range(plan.ends.shape[0]):
        for node in range(plan.first[j] + j, plan.first[j + 1] + j + 1):
            way = subtract(get3(motion.place, node), get3(before.place, node))
            if dot(way, way) > skin.clear[node] ** 2:
                return False
            for k in range(int(motion.walls[node, 0]) if share > PATIENT else 0):
                i = 1 + WALL * k
                if (
                    motion.walls[node, i + PUSHED] > 0.0
                    and gap_of(bodies, int(motion.walls[node, i + BODY]), get3(motion.place, node), skin.thick[node])
                    > AFLOAT * skin.whole[node]
                ):
                    return False
    for i in range(int(motion.par[N_PROPS]) if share > PATIENT else 0):
        at = place_of(plan, motion.props, i, motion.place, memory.tangent)
        node = plan.left[int(motion.props[i, 0])]
        if motion.props[i, PUSH] > 0.0 and motion.props[i, HOLDER] != PAIRED:
            gap = gap_of(bodies, int(motion.props[i, HOLDER]), at, skin.thick[node])
            if gap > AFLOAT * skin.whole[node]:
                return False
    deep = deepest(plan, model, motion, memory, bodies, skin.thick, skin.whole)
    motion.par[DEPTH] = max(0.0, -deep)
    if share > PATIENT and deep < -DEEP * model.par[LENGTH]:
        return False
    if skin.touching.shape[0] > 0:
        apart, overlap = stay_apart(
            plan, model, motion, memory, before, skin.touching, skin.whole, AFLOAT, share <= PATIENT
        )  # fmt: skip
        if not apart:
            return False
        motion.par[DEPTH] = max(motion.par[DEPTH], overlap)
    first = 0
    for c in range(plan.cables.shape[0] - 1):  # each cable for itself
        last = plan.first[plan.cables[c + 1]] + plan.cables[c + 1]
        fat = skin.thick[first]
        if fat >= 0.0 and passed(plan, model, motion, memory, before, bodies, first, last, fat):
            return False
        first = last
    return True


@viewing
def gap_of(bodies: Bodies, b: int, at: Vector, thick: float) -> float:
    """[m], from body b to a cable at a place."""
    d, _, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, at, NONE, False, bodies.stack)
    return d - thick


@kernel
def passed(
    plan: Plan, model: Model, motion: Motion, memory: Momentum, before: Momentum, bodies: Bodies, first: int,
    last: int, thick: float,
) -> bool:  # fmt: skip
    """Whether the cable of nodes first to last - 1, or the middle of one of its elements, may have passed a body."""
    count = last - first
    s, old, new = np.empty(2 * count - 1), np.empty((2 * count - 1, 3)), np.empty((2 * count - 1, 3))
    for k in range(count):
        node = first + k
        s[2 * k] = model.s[node]
        put3(old, 2 * k, 0, get3(before.place, node))
        put3(new, 2 * k, 0, get3(motion.place, node))
        if k + 1 < count:
            h = model.s[node + 1] - model.s[node]
            s[2 * k + 1] = model.s[node] + 0.5 * h
            put3(old, 2 * k + 1, 0, middle(before.place, before.tangent, node, h))
            put3(new, 2 * k + 1, 0, middle(motion.place, memory.tangent, node, h))
    found: bool = passes(
        s, old, new, bodies.table, bodies.frames, bodies.then, bodies.triangles, bodies.tree, thick, bodies.stack
    )
    return found


@viewing
def middle(places: Floats, tangents: Floats, node: int, h: float) -> Vector:
    """Of the cubic between a node and the next one."""
    return on_curve(h, 0.5, get3(places, node), get3(places, node + 1), get3(tangents, node), get3(tangents, node + 1))


@kernel
def swing(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goal: Floats,
    dt: float, kept: Floats, info: Floats, scratch: Floats, points: int, out: Floats, velocity: Floats, told: Floats,
    bodies: Bodies, skin: Skin,
) -> int:  # fmt: skip
    """`step`, and what it led to at points, see `swing_output.swing`."""
    status = step(ints, floats, sols, space, moving, remembered, goal, dt, kept, info, scratch, bodies, skin)
    if status == CONVERGED:
        tell(ints, floats, sols, space, moving, remembered, points, out, velocity, told)
    return int(status)


@kernel
def run(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goals: Floats,
    steps: Floats, kept: Floats, info: Floats, scratch: Floats, places: Floats, tangents: Floats, velocities: Floats,
    bodies: Bodies, skin: Skin,
) -> int:  # fmt: skip
    """`swing_run.run` among bodies, which stay where they are."""
    memory = momentum_of(ints, remembered)
    lost = 0
    for i in range(steps.shape[0]):
        code = step(
            ints, floats, sols, space, moving, remembered, goals[i], steps[i], kept, info, scratch, bodies, skin
        )
        lost += 1 if code != CONVERGED else 0
        places[i, :, :], tangents[i, :, :], velocities[i, :, :] = memory.place, memory.tangent, memory.velocity
    return lost


@kernel
def buried_then(
    support: Array, arc: Array, deepest: float, length: float, radius: float, bodies: Bodies
) -> tuple[int, int, float]:  # fmt: skip
    """`check.buried` of one support (1, 7) with the bodies where their links are to be."""
    frames = bodies.frames.copy()
    place_bodies(bodies.table, bodies.links, frames)
    return buried(
        support, arc, 1, deepest, length, bodies.table, frames, bodies.triangles, bodies.tree, radius, bodies.stack
    )  # fmt: skip
