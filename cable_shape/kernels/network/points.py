"""How a network answers the motion of points at which a cable is held: forces and tangents there, their derivatives."""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.graph import solve, step_of_force
from cable_shape.kernels.network.respond import answer, bent, move_knots, slip, still
from cable_shape.kernels.network.tables import (
    TRIAL,
    Floats,
    Whole,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    add,
    apply,
    cross,
    get3,
    get4,
    put3,
    rotation,
    scale,
    subtract,
)
from cable_shape.kernels.rod_element import E3


@kernel
def held_points(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, behind: Whole, force: Array, tangent: Array,
    dforce: Array, dtangent: Array,
) -> None:  # fmt: skip
    """Of points inside a cable, whose places are given: `force` on it (k, 3) [N] and `tangent` (k, 3), world.

    behind (k,): the spans that begin there.

    dforce, dtangent (k, 3, k, 4): their derivatives in each point's place and in the arc length that it holds there;
    other knots stay, those free to move along a surface do. Of the trial, for which the matrix must be factored. A
    point held further on is, for the material, a point moved back by r'.
    """
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    count = behind.shape[0]
    for i in range(count):
        j = behind[i]
        node = plan.first[j] + j
        put3(force, i, 0, subtract(get3(sol.lam, j - 1), add(get3(sol.lam, j), get3(model.weight, j))))
        put3(tangent, i, 0, apply(rotation(get4(sol.q, node)), E3))
    for c in range(count):
        j = behind[c]
        e = plan.first[j]
        for axis in range(4):
            still(ints, space)
            if axis < 3:
                work.sums[j - 1, axis] = 1.0
                work.sums[j, axis] = -1.0
            else:
                before, after, couple = slip(model, sol, work, e + j - 1, e)
                put3(work.G, e + j, 0, couple)
                put3(work.sums, j - 1, 0, scale(-1.0, before))
                put3(work.sums, j, 0, after)
            solve(ints, floats, space)
            for i in range(count):
                other = behind[i]
                node = plan.first[other] + other
                change = subtract(step_of_force(work, other - 1), step_of_force(work, other))
                turn = get3(work.d, node)
                if axis == 3 and i == c:
                    a = e - 1
                    y = 0.5 * model.h[a]
                    turn = add(turn, (bent(model, work, a, 0, y), bent(model, work, a, 1, y), 0.0))
                bend = apply(rotation(get4(sol.q, node)), cross(turn, E3))
                for x in range(3):
                    dforce[i, x, c, axis] = change[x]
                    dtangent[i, x, c, axis] = bend[x]


@kernel
def points_under_motion(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, behind: Whole, motion: Array, dforce: Array,
    dtangent: Array,
) -> None:  # fmt: skip
    """Fills dforce, dtangent (k, 3): change at points, where spans `behind` begin, as both ends move by `motion`.

    motion (2, 6): displacement [m] and rotation [rad] of each, world. The matrix must be factored.
    """
    plan, sol, work = plan_of(ints), solution_of(ints, sols, TRIAL), work_of(ints, space)
    last = plan.ends[plan.ends.shape[0] - 1, 1]
    for k in range(ints[2]):
        for x in range(6):
            work.move[k, x] = motion[0, x] if k == 0 else (motion[1, x] if k == last else 0.0)
    twists = work.move.copy()
    still(ints, space)
    move_knots(ints, floats, sols, space, twists)
    answer(ints, floats, sols, space, twists)
    for i in range(behind.shape[0]):
        j = behind[i]
        node = plan.first[j] + j
        put3(dforce, i, 0, subtract(step_of_force(work, j - 1), step_of_force(work, j)))
        put3(dtangent, i, 0, apply(rotation(get4(sol.q, node)), cross(get3(work.d, node), E3)))
