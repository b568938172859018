"""Whether what a part of a step in time among bodies has come to may stand."""

from __future__ import annotations

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.check import passes
from cable_shape.kernels.contact.meeting import keep_off
from cable_shape.kernels.contact.meeting_again import stay_apart
from cable_shape.kernels.contact.near import NONE
from cable_shape.kernels.contact.points import deepest, on_curve
from cable_shape.kernels.contact.tables import Bodies, Skin
from cable_shape.kernels.distance.surface import touch
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.momentum import ENERGY, KINETIC, Momentum, momentum_of
from cable_shape.kernels.network.motion import DEPTH, N_PROPS, Motion, motion_of
from cable_shape.kernels.network.props import HOLDER, PAIRED, PUSH, place_of
from cable_shape.kernels.network.settle import turned
from cable_shape.kernels.network.swinging import I_DISSIPATED, I_WORK
from cable_shape.kernels.network.tables import (
    LENGTH,
    NOW,
    Floats,
    Model,
    Plan,
    Whole,
    model_of,
    plan_of,
    solution_of,
)
from cable_shape.kernels.network.walls import BODY, PUSHED, WALL
from cable_shape.kernels.rod_algebra import Vector, dot, get3, put3, subtract

#: Of the length: a node that far off a body is not pressed by it, and a part of the step was too long.
AFLOAT = 2e-4
#: Of the length: that deep the cable may be in a body between its nodes after a part of a step.
DEEP = 2e-4
#: Parts shorter than this go on where the cable is deep, or afloat, for all that.
PATIENT = 1.0 / 16.0
#: So much more of the kinetic energy than was put in a part may leave where frames turn further than that [rad] in it.
MADE, TURNED = 1e-3, 0.3


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
    touching = skin.touching
    if touching.shape[0] > 0 and (
        press_each_other(motion)
        or not keep_off(plan, model, motion.place, memory.tangent, touching, 0.0, before.place, before.tangent)
    ):
        apart, overlap = stay_apart(
            plan, model, motion, memory, before, touching, skin.whole, AFLOAT, share <= PATIENT
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
def press_each_other(motion: Motion) -> bool:
    """Whether cables do, or one does on itself."""
    found = False
    for i in range(int(motion.par[N_PROPS])):
        found = found or (motion.props[i, HOLDER] == PAIRED and motion.props[i, PUSH] > 0.0)
    return found


@viewing
def makes_energy(
    ints: Whole, floats: Floats, sols: Floats, moving: Floats, remembered: Floats, skin: Skin, info: Floats,
    sums: Floats,
) -> bool:  # fmt: skip
    """Whether frames have turned far in a part of a step and left more energy than was put in: it was too long.

    The trapezoidal rule misses what they do on the way, as where an end comes down upright. info, sums (INFO of
    `swinging`,): after and before it. What moments of their own at free ends do nobody knows: False.
    """
    model, a = model_of(ints, floats), skin.kept.shape[0] - moving.shape[0] - remembered.shape[0]
    then, now = momentum_of(ints, skin.kept[a : a + remembered.shape[0]]).par, momentum_of(ints, remembered).par
    more = now[ENERGY] + now[KINETIC] - then[ENERGY] - then[KINETIC]
    more -= info[I_WORK] - sums[I_WORK] - info[I_DISSIPATED] + sums[I_DISSIPATED]
    if not more > MADE * (now[KINETIC] + then[KINETIC]):
        return False
    for k in range(model.moment.shape[0]):
        if dot(get3(model.moment, k), get3(model.moment, k)) > 0.0:
            return False
    return bool(turned(solution_of(ints, sols, NOW), solution_of(ints, skin.kept, NOW)) > TURNED)


@viewing
def at_rest(skin: Skin, links: Floats) -> bool:
    """Whether links that carry bodies, and eyelets, stay where they are in the step: what moves does work."""
    for k in range(links.shape[0]):
        for i in range(7):
            if links[k, i] != skin.links_then[k, i]:
                return False
    for k in range(skin.goals.shape[0]):
        for i in range(3):
            if skin.goals[k, i] != skin.rings_then[k, i]:
                return False
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
