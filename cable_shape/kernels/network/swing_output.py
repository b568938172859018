"""What is told of a swinging network at points: shape, internal force and moment, and velocity."""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.momentum import Momentum, force_of_mass, momentum_of, of_mass
from cable_shape.kernels.network.motion import N_PROPS, Motion, lever_torque, motion_of
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.props import (
    COUNTER,
    DRY,
    ELEMENT,
    HOLDER,
    NORMAL,
    OTHER,
    PAIRED,
    PARTNER,
    PUSH,
    SHARE,
    WEIGHTS,
    half_now,
)
from cable_shape.kernels.network.swinging import step
from cable_shape.kernels.network.tables import (
    ELASTIC,
    NOW,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    Work,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    cross,
    get3,
    get4,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)
from cable_shape.kernels.rod_output import INTERPOLATION, S_GAP, S_TWIST, SUMS, sample_cable


@kernel
def swing(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goal: Floats,
    dt: float, kept: Floats, info: Floats, scratch: Floats, points: int, out: Floats, velocity: Floats, told: Floats,
) -> int:  # fmt: skip
    """`swinging.step`, and what it led to at points: `tell`."""
    status = step(ints, floats, sols, space, moving, remembered, goal, dt, kept, info, scratch)
    if status == CONVERGED:
        tell(ints, floats, sols, space, moving, remembered, points, out, velocity, told)
    return status


@viewing
def tell(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, points: int,
    out: Floats, velocity: Floats, told: Floats,
) -> None:  # fmt: skip
    """Fills `out` (17 points a cable, as CableShape.buffer) and velocity (points a cable, 3) of the last step.

    told (2 a cable): twist [rad], and what the interpolation between nodes misses [m]. Once after every step.
    """
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    memory, sol = momentum_of(ints, remembered), solution_of(ints, sols, NOW)
    elastic = model.par[ELASTIC] != 0.0
    for j in range(plan.ends.shape[0]):
        share_forces(plan, work, motion, memory, sol, j)
    for c in range(plan.cables.shape[0] - 1):
        sums = work.sums_of[:SUMS]
        sums[:] = 0.0
        first, last = plan.cables[c], plan.cables[c + 1] - 1
        a, b = plan.first[first], plan.first[last + 1]
        apart = model.s[plan.first[last + 1] + last] / (points - 1)
        sample_cable(
            plan.left[a:b], sol.q, work.moments[a:b], model.s, model.h[a:b], work.full[a:b], model.rest[a:b],
            model.section[a:b], get3(motion.place, plan.first[first] + first), get3(model.heavy, c), elastic,
            work.first[a:b], apart, points, out[17 * points * c : 17 * points * (c + 1)], sums, work.lanes,
        )  # fmt: skip
        told[2 * c], told[2 * c + 1] = sums[S_TWIST], INTERPOLATION * math.sqrt(sums[S_GAP])
        i = 0
        for e in range(a, b):
            node = plan.left[e]
            to = points if e == b - 1 else min(points, math.ceil(model.s[node + 1] / apart - 1e-9))
            for k in range(i, to):
                x = (k * apart - model.s[node]) / model.h[e]
                put3(velocity, points * c + k, 0, between(memory, node, model.h[e], x))
            i = max(i, to)
    for k in range(int(motion.par[N_PROPS])):
        tell_inside(plan, model, motion, sol, k, ELEMENT, WEIGHTS, points, out)
        if motion.props[k, HOLDER] == PAIRED:
            tell_inside(plan, model, motion, sol, k, PARTNER, COUNTER, points, out)


@viewing
def tell_inside(
    plan: Plan, model: Model, motion: Motion, sol: Solution, k: int, element: int, w: int, points: int, out: Floats
) -> None:  # fmt: skip
    """Has forces and moments, and what those bend, jump where what holds a point inside an element acts, not at nodes.

    element, w: the columns of point k, see `props`, of the element and its weights. Elsewhere both are the same.
    """
    props = motion.props
    e = int(props[k, element])
    c = 0
    for cable in range(plan.cables.shape[0] - 1):
        c = cable if plan.first[plan.cables[cable]] <= e else c
    last = plan.cables[c + 1] - 1
    node = plan.left[e]
    F = add(scale(props[k, PUSH], take3(props, k, NORMAL)), take3(props, k, DRY))
    at = half_now(plan, motion, sol, k, element, w)
    whole = props[k, w] + props[k, w + 1]  # 1, or of the second element of a pair -1
    R = rotation(get4(sol.q, node))
    M = scale(props[k, w + 2], cross((R[2], R[5], R[8]), F))
    origin, stiff = get3(motion.place, node), take3(model.section, e, 0)
    apart = model.s[plan.first[last + 1] + last] / (points - 1)
    share = props[k, SHARE if element == ELEMENT else OTHER]
    begin = 17 * points * c
    places, frames = part(out, begin + points, (points, 3)), part(out, begin + 4 * points, (points, 4))
    bends, forces = part(out, begin + 8 * points, (points, 3)), part(out, begin + 11 * points, (points, 3))
    moments = part(out, begin + 14 * points, (points, 3))
    a, h = model.s[node], model.h[e]
    i = math.ceil(a / apart - 1e-9)
    to = points if e == plan.first[last + 1] - 1 else min(points, math.ceil((a + h) / apart - 1e-9))
    while i < to:
        r = get3(places, i)
        f = scale(props[k, w], F)
        m = subtract(M, cross(subtract(r, origin), f))
        if i * apart > a + share * h:
            f = subtract(f, scale(whole, F))
            m = add(m, cross(subtract(scale(whole, r), at), F))
        put3(forces, i, 0, add(get3(forces, i), f))
        put3(moments, i, 0, add(get3(moments, i), m))
        own = tapply(rotation(get4(frames, i)), m)
        put3(bends, i, 0, add(get3(bends, i), (own[0] / stiff[0], own[1] / stiff[1], own[2] / stiff[2])))
        i += 1


@inline
def between(memory: Momentum, node: int, h: float, x: float) -> Vector:
    """[m/s], velocity at the share x of the element right of a node: the cubic by that of both and their turning."""
    a, b = get3(memory.velocity, node), get3(memory.velocity, node + 1)
    da, db = get3(memory.turning, node), get3(memory.turning, node + 1)
    y = 1.0 - x
    v = add(scale(y * y * (1.0 + 2.0 * x), a), scale(x * x * (1.0 + 2.0 * y), b))
    return add(v, add(scale(h * x * y * y, da), scale(-h * x * x * y, db)))


@inline
def share_forces(plan: Plan, work: Work, motion: Motion, memory: Momentum, sol: Solution, j: int) -> None:
    """Forces, moments and steps of the elements of span j, the inertia of its nodes spread along the cable."""
    first, last = plan.first[j], plan.first[j + 1] - 1
    for e in range(first, last + 1):
        put3(work.moments, e, 0, scale(-1.0, take3(work.first, e, 3)))
        put3(work.moments, e, 3, take3(work.first, e, 6))
        node = e + j
        put3(work.first, e, 0, subtract(get3(motion.place, node), get3(motion.place, node + 1)))
        for end in range(2):
            k = node + end
            if end == 0:
                share = 1.0 if e == first else 0.5
                f = scale(-share, spread(motion, memory, sol, k))
                put3(work.full, e, 0, add(take3(work.full, e, 0), f))
            else:
                share = 1.0 if e == last else 0.5
                f = scale(share, spread(motion, memory, sol, k))
                put3(work.full, e, 6, add(take3(work.full, e, 6), f))
    put3(work.moments, first, 0, subtract(take3(work.moments, first, 0), lever_torque(motion, sol, first + j)))
    end = last + 1 + j
    put3(work.moments, last, 3, add(take3(work.moments, last, 3), lever_torque(motion, sol, end)))


@inline
def spread(motion: Motion, memory: Momentum, sol: Solution, node: int) -> Vector:
    """[N], what inertia and drag of the cable around a node take, without those of a point mass."""
    f = force_of_mass(motion, sol, node)
    if memory.point[node] == 0.0:
        return f
    return subtract(f, scale(memory.point[node], of_mass(motion, memory.acceleration, memory.bending, node)))
