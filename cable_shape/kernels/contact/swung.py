"""Steps in time of a network that swings among bodies: planes before every part of a step, and a look after it.

Planes lie where bodies are nearest to nodes (`guard`) and to what is between them (`props`), with all of a convex body
behind. A part of a step is taken if its nodes, in front of all planes, are no further than that has planes for, press
only on what is there, and have passed nothing; else it is tried in half the time. What arrives at a plane stays there:
it takes over the speed of the body along the normal, and where it sticks in every direction.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.check import buried
from cable_shape.kernels.contact.impact import foresee, stop
from cable_shape.kernels.contact.meeting import keep_off
from cable_shape.kernels.contact.meeting_again import aim_again, take_again
from cable_shape.kernels.contact.points import (
    WENT,
)
from cable_shape.kernels.contact.swung_fits import PATIENT, at_rest, fits, makes_energy, press_each_other
from cable_shape.kernels.contact.swung_look import look
from cable_shape.kernels.contact.tables import Bodies, Skin
from cable_shape.kernels.distance.surface import place_bodies
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import (
    ENERGY,
    KINETIC,
    LAST_DT,
    Momentum,
    momentum_of,
)
from cable_shape.kernels.network.motion import N_PROPS, PAIRS, PROP, SCRATCH, motion_of
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.props import (
    HOLDER,
    PAIRED,
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
    Whole,
    copy,
    model_of,
    plan_of,
    solution_of,
    solution_size,
)
from cable_shape.kernels.rod_algebra import get3, put3, scale

#: A step goes in parts of this fraction of it at least, each tried from so many of `swing_start.STARTS`.
SHORTEST, TRIES = 1.0 / 256.0, 4
#: Parts that are no shorter than this are tried from the first of them alone: half the part is the better try.
SHORT = 0.3
#: Where halves of halves lead nowhere the step is tried once more with these fractions of it as the first part, one
#: after the other: where many ways to fold are near each other what leads on in other parts is no better, nor worse.
UNEVEN = (0.37, 0.61, 0.23)
#: There is room for so many rows in `Skin.log`; in place of the start there.
LOG, BRACED = 1024, -1.0
#: Column of the first one: whether cables have pressed on each other in the step.
MET = 1
#: Times the last one: so much longer a part may be without more ado.
LONGER = 1.5
#: So often points of pairs are found once more, after so many times half the way, if one is further than that, of the
#: length, from where it is to be.
AGAIN, HALF, ON = 6, 4, 5e-6


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
    still = at_rest(skin, bodies.links)
    skin.log[0, 0] = skin.log[0, MET] = 0.0
    rows = np.empty((PAIRS, PROP))
    done, part, sums, braced, minds = 0.0, 1.0, np.empty(info.shape[0]), False, True
    again = 0
    while done < 1.0:
        part = min(part, 1.0 - done) if part < 0.75 * (1.0 - done) else 1.0 - done
        seconds = part * dt
        copy_state(skin.kept, sols, remembered, moving)
        copy(sums, info)
        set_out(skin, bodies, now, links, done, part)
        status = CONVERGED - 1
        for start in range(TRIES if part < SHORT else 1):
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
        fitting = status == CONVERGED and fits(ints, floats, moving, remembered, now, skin, part)
        if fitting and still and part > PATIENT:
            fitting = not makes_energy(ints, floats, sols, moving, remembered, skin, info, sums)
        if fitting:
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
        if last and again < len(UNEVEN):
            copy_back(kept, sols, remembered, moving)
            take_back(info, np.zeros(info.shape[0]))
            skin.log[0, 0] = skin.log[0, MET] = 0.0
            place_bodies(bodies.table, skin.links_then, then)
            done, part, braced, minds = 0.0, UNEVEN[again], False, True
            again += 1
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
    plan, motion, memory = plan_of(ints), motion_of(ints, moving), momentum_of(ints, remembered)
    model, a = model_of(ints, floats), skin.kept.shape[0] - moving.shape[0] - remembered.shape[0]
    before = momentum_of(ints, skin.kept[a : a + remembered.shape[0]])
    touching, paired = skin.touching, False
    for i in range(int(motion.par[N_PROPS])):
        paired = paired or motion.props[i, HOLDER] == PAIRED
    if not paired and keep_off(plan, model, motion.place, memory.tangent, touching, 0.0, motion.place, memory.tangent):
        return False
    off = aim_again(plan, model, motion, memory, before, touching, skin.whole, skin.rough, dt, half, rows)
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
