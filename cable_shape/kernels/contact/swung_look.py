"""What bodies and cables a swinging network may get to in a part of a step: planes of nodes and points of elements."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.check import carried
from cable_shape.kernels.contact.guard import look_around
from cable_shape.kernels.contact.meeting import find_pairs, keep_off, parted
from cable_shape.kernels.contact.points import (
    HELD,
    NEARER,
    find_points,
    find_rings,
    heavy_at,
    put_aside,
)
from cable_shape.kernels.contact.tables import Bodies, Skin
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import (
    RADIUS,
    Scheme,
    momentum_of,
    scheme_of,
)
from cable_shape.kernels.network.motion import N_PROPS, N_WALLED, PROPS, motion_of
from cable_shape.kernels.network.props import (
    DRY,
    ELEMENT,
    GAVE,
    GRIP,
    HOLDER,
    SHARE,
    SOFT,
)
from cable_shape.kernels.network.tables import (
    NOW,
    TRIAL,
    Floats,
    Whole,
    model_of,
    plan_of,
    solution_of,
)
from cable_shape.kernels.rod_algebra import dot, get3, put3, scale, subtract, take3

#: [m] planes of bodies that much further away than nodes may get, in units of which way, are known.
MARGIN, AHEAD = 5e-3, 1.5
#: Stiffness of planes and of asperities, in that with which a part of the step holds the node.
FIRM, ASPERITY = 1e4, 10.0


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
    find_points(
        plan, model, motion, memory.place, memory.tangent, bodies, skin.thick, skin.whole, skin.rough, reach, NEARER,
        False, room,
    )  # fmt: skip
    for i in range(int(motion.par[N_PROPS])):
        node = plan.left[int(motion.props[i, ELEMENT])] + 1
        if motion.props[i, SHARE] == 1.0:
            mass, drag = heavy_at(plan, motion, memory, skin.knot[node], node)
            motion.props[i, SOFT] = 1.0 / (ASPERITY * held_by(t, mass, drag))
            put3(motion.props, i, GAVE, scale(motion.props[i, SOFT], take3(motion.props, i, DRY)))
    find_rings(plan, model, motion, memory, skin.rings, skin.whole)
    if minds and skin.touching.shape[0] > 0:  # what comes together moves from both sides
        both = MARGIN + 2.0 * parted(plan, motion, memory, now, sol, dt)
        if not keep_off(plan, model, memory.place, memory.tangent, skin.touching, both, memory.place, memory.tangent):
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
