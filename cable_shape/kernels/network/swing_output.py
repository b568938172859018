"""What is told of a swinging network at points: shape, internal force and moment, and velocity."""

from __future__ import annotations

import math

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import Momentum, force_of_mass, momentum_of, of_mass
from cable_shape.kernels.network.motion import Motion, lever_torque, motion_of
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.swinging import step
from cable_shape.kernels.network.tables import (
    ELASTIC,
    NOW,
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
from cable_shape.kernels.rod_algebra import Vector, add, get3, put3, scale, subtract, take3
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
