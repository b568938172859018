"""Where a network that moves starts from, and its energy: see `settle`."""

from __future__ import annotations

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.motion import Motion, motion_of
from cable_shape.kernels.network.tables import (
    SWINGS,
    TRIAL,
    Floats,
    Model,
    Solution,
    Whole,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
)
from cable_shape.kernels.rod_algebra import Vector, add, dot, get3, get4, put3, scale, subtract, take3
from cable_shape.kernels.rod_element import element_gradient


@viewing
def energy(ints: Whole, floats: Floats, sols: Floats, moving: Floats) -> float:
    """[J], elastic energy less loads . places of the trial with its nodes where they are."""
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    sol = solution_of(ints, sols, TRIAL)
    total = 0.0
    for j in range(plan.ends.shape[0]):
        first = plan.first[j]
        total -= dot(get3(motion.weight, j), get3(motion.place, first + j))
        for e in range(first, plan.first[j + 1]):
            value, _ = of_element(model, motion, get3(motion.lam, e), sol, e, e + j)
            way = subtract(get3(motion.place, e + j + 1), get3(motion.place, e + j))
            total += value + dot(get3(motion.lam, e), way)
    for k in range(sol.pose.shape[0]):
        total -= dot(get3(model.force, k), take3(sol.pose, k, 0))
    return total


@inline
def of_element(model: Model, motion: Motion, n: Vector, sol: Solution, e: int, node: int) -> tuple[float, Vector]:
    """Value of an element's functional [J] under the force n besides its loads, and minus its step [m]."""
    given = (
        model.h[e], get4(sol.q, node), get4(sol.q, node + 1), add(take3(motion.load, e, 0), n),
        add(take3(motion.load, e, 3), n), add(take3(motion.load, e, 6), n), take3(model.rest, e, 0),
        take3(model.rest, e, 3), take3(model.section, e, 0), take3(model.section, e, 3), take3(model.section, e, 6),
        (model.firmer[e, 0], model.firmer[e, 1]),
    )  # fmt: skip
    if model.par[SWINGS] != 0.0:
        value, _, _, back = element_gradient(*given, True)
    else:
        value, _, _, back = element_gradient(*given, None)
    return value, back


@viewing
def way_of(ints: Whole, floats: Floats, sols: Floats, moving: Floats, j: int) -> Vector:
    """[m], from the start of span j to its end, as the trial's rotations and its force lead."""
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    sol = solution_of(ints, sols, TRIAL)
    way = (0.0, 0.0, 0.0)
    for e in range(plan.first[j], plan.first[j + 1]):
        _, back = of_element(model, motion, get3(sol.lam, j), sol, e, e + j)
        way = subtract(way, back)
    return way


@viewing
def begin(ints: Whole, floats: Floats, sols: Floats, moving: Floats) -> None:
    """Places of the nodes for the trial's rotations and forces, those of each span as its elements lead.

    What is missing to the span's end is spread along it. The trial becomes the solution now.
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    sol = solution_of(ints, sols, TRIAL)
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1]
        place = take3(sol.pose, plan.ends[j, 0], 0)
        put3(motion.place, first + j, 0, place)
        for e in range(first, last):
            put3(motion.lam, e, 0, get3(sol.lam, j))
            _, back = of_element(model, motion, get3(motion.lam, e), sol, e, e + j)
            place = subtract(place, back)
            put3(motion.place, e + j + 1, 0, place)
        missing = subtract(take3(sol.pose, plan.ends[j, 1], 0), place)
        f = 1.0 / (model.s[last + j] - model.s[first + j])
        for k in range(first + j, last + j + 1):
            part = scale(f * (model.s[k] - model.s[first + j]), missing)
            put3(motion.place, k, 0, add(get3(motion.place, k), part))
    copy_rows(motion.kept, motion.lam, 3)
    copy_rows(motion.origin, motion.place, 3)
    size = solution_size(ints)
    copy(sols[0:size], sols[2 * size : 3 * size])
    copy(sols[size : 2 * size], sols[0:size])
