"""How the last solution answers what moves or changes, and how stable it is: all from the factors of its matrix.

A change enters as a right-hand side: the derivative of the gradient. The answer of rotations, forces and places is
`graph.solve`'s; between nodes positions follow the cubic through the nodes' changes of r and r'. In eyelets the cable
runs on: each is one more unknown, its arc length sigma, with F . d3 = 0 for its equation.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.drive import strip
from cable_shape.kernels.network.graph import factor, lead, solve, step_of_force
from cable_shape.kernels.network.gripping import change_of_limit, holds, law
from cable_shape.kernels.network.newton import size_at
from cable_shape.kernels.network.sliding import columns, slide_step
from cable_shape.kernels.network.system import NONE, assemble, gradient, release
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    LENGTH,
    STIFFEST,
    TRIAL,
    UNKNOWN,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    Work,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    get9,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
    times,
)
from cable_shape.kernels.rod_defect import node_slope
from cable_shape.kernels.rod_element import E3

#: Noise in the mode that inverse iteration starts from: without it a mode of another symmetry would be overlooked.
NOISE = 0.02
#: Of the shift that is always there: enough to leave a neutral mode finite, far below what else is accurate.
SLIGHT = 1e-4


@viewing
def refresh(ints: Whole, floats: Floats, sols: Floats, space: Floats, factored: bool) -> None:
    """Assembles, and factors if asked, the matrix of the solution now, which becomes the trial, too."""
    at_rest(ints, sols)
    assemble(ints, floats, sols, space)
    if factored:
        factor(ints, floats, space, SLIGHT * model_of(ints, floats).par[BASE_SHIFT])


@viewing
def at_rest(ints: Whole, sols: Floats) -> None:
    """Makes the solution now the trial, too."""
    size = solution_size(ints)
    copy(sols[2 * size : 3 * size], sols[0:size])


@viewing
def still(ints: Whole, space: Floats) -> None:
    """Makes the right-hand side zero."""
    work = work_of(ints, space)
    work.G[:, :] = 0.0
    work.sums[:, :3] = 0.0
    work.pull[:, :] = 0.0
    work.slack[:, :] = 0.0


# -- what moves


@inline
def turn_end(plan: Plan, model: Model, work: Work, j: int, end: int, turn: Vector, goes_along: float) -> None:
    """Adds to the right-hand side what turning an end of span j (own frame) changes, but for the turn itself.

    goes_along: 0.5 where the frame in which this node's free rotations are in balance turns, too; -0.5 where it stays,
    that of a knot in which the end turns.
    """
    first, last = plan.first[j], plan.first[j + 1] - 1
    if end == 0:
        node, beside, e = first + j, first + j + 1, first
        across = tapply(get9(work.U, e, 0), turn)
        change = tapply(get9(work.parts, e, 9), turn)
        reaction = take3(work.first, e, 3)
        own = apply(get9(work.sums, j, 12), turn)
    else:
        node, beside, e = last + j + 1, last + j, last
        across = apply(get9(work.U, e, 0), turn)
        change = tapply(get9(work.parts, e, 18), turn)
        reaction = take3(work.first, e, 6)
        own = apply(get9(work.parts, e, 0), turn)
    put3(work.G, beside, 0, add(get3(work.G, beside), across))
    put3(work.G, node, 0, add(get3(work.G, node), add(own, scale(goes_along, cross(reaction, turn)))))
    put3(work.sums, j, 0, add(get3(work.sums, j), change))


@inline
def given_turn(plan: Plan, model: Model, sol: Solution, j: int, end: int, spin: Vector) -> Vector:
    """How an end of span j turns (own frame) as its knot is turned by `spin` (world), where its rotation is held."""
    node = plan.first[j + end] + j
    if plan.tied[j, end] == 0:
        t = tapply(rotation(get4(sol.q, node)), spin)
        f = model.free
        return (t[0] * (1.0 - f[j, end, 0]), t[1] * (1.0 - f[j, end, 1]), t[2] * (1.0 - f[j, end, 2]))
    k = plan.ends[j, end]
    t = tapply(rotation((sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6])), spin)
    t = (t[0] * (1.0 - model.loose[k, 0]), t[1] * (1.0 - model.loose[k, 1]), t[2] * (1.0 - model.loose[k, 2]))
    if plan.turned[j, end] != 0:
        f = model.frame
        t = tapply(rotation((f[j, end, 0], f[j, end, 1], f[j, end, 2], f[j, end, 3])), t)
    return t


@viewing
def move_knots(ints: Whole, floats: Floats, sols: Floats, space: Floats, twists: Floats) -> None:
    """Adds to the right-hand side how knots move, twists (k, 6): velocity and angular velocity about the knot, world.

    Only what is given of a knot counts. `Work.move` and `d` must take the motion in afterwards, see `answer`.
    """
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            k = plan.ends[j, end]
            if plan.vertices[k, 1] < 0 and plan.known[j] == 0:
                sign = 1.0 if end == 1 else -1.0
                put3(work.sums, j, 0, add(get3(work.sums, j), scale(sign, take3(twists, k, 0))))
            turn = given_turn(plan, model, sol, j, end, take3(twists, k, 3))
            if turn != NONE:
                turn_end(plan, model, work, j, end, turn, 0.5)


@viewing
def answer(ints: Whole, floats: Floats, sols: Floats, space: Floats, twists: Floats) -> None:
    """Solves for the answer to the right-hand side, and adds the motion of the knots themselves to it."""
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    release(plan, model, work.G)
    solve(ints, floats, space)
    for j in range(plan.ends.shape[0]):
        for end in range(2):
            k = plan.ends[j, end]
            turn = given_turn(plan, model, sol, j, end, take3(twists, k, 3))
            if turn != NONE:
                node = plan.first[j + end] + j
                put3(work.d, node, 0, add(get3(work.d, node), turn))
            if plan.vertices[k, 1] < 0:
                put3(work.move, k, 3, take3(twists, k, 0))
    lead(plan, work)


@inline
def slope_at(q: Floats, k: int, n: Vector, C: Vector) -> Vector:
    """r' = R V at node k under the force n."""
    R = rotation(get4(q, k))
    return apply(R, add(E3, times(C, tapply(R, n))))


@viewing
def spread(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, points: int, out: Floats, column: int, jumps: Floats,
    ds: Floats, dv: Floats,
) -> None:  # fmt: skip
    """Fills out[:, :, column] (c points, 3, m) with the change of the positions that d, forces and places make.

    jumps (m, 3): by how much more the cable moves where a span begins than its knot does. `Work.slack`: what else
    changes of the elements' steps in position. ds (n,), dv (N, 6): change of the arc length of the nodes, and what else
    changes of r' at the left and right of the elements, points keeping their share of the length; ds (0,): nothing.
    """
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    stretched = ds.shape[0] > 0
    for c in range(plan.cables.shape[0] - 1):
        last = plan.cables[c + 1] - 1
        far = plan.first[last + 1] + last
        length = model.s[far]
        i = 0
        r = NONE
        for j in range(plan.cables[c], last + 1):
            r = add(take3(work.move, plan.ends[j, 0], 3), get3(jumps, j))
            dl = step_of_force(work, j)
            for e in range(plan.first[j], plan.first[j + 1]):
                node = e + j
                da, db = get3(work.d, node), get3(work.d, node + 1)
                change = add(
                    add(tapply(get9(work.parts, e, 9), da), tapply(get9(work.parts, e, 18), db)),
                    add(apply(get9(work.parts, e, 27), dl), get3(work.slack, e)),
                )
                rb = subtract(r, change)
                C = take3(model.section, e, 3)
                left, right = take3(work.full, e, 0), take3(work.full, e, 6)
                va = node_slope(sol.q, node, da, left, dl, C)
                vb = node_slope(sol.q, node + 1, db, right, dl, C)
                h, s0 = model.h[e], model.s[node]
                dh, ta, tb = 0.0, NONE, NONE
                if stretched:
                    dh = ds[node + 1] - ds[node]
                    ta, tb = slope_at(sol.q, node, left, C), slope_at(sol.q, node + 1, right, C)
                    va = add(va, add(take3(dv, e, 0), scale(dh / h, ta)))
                    vb = add(vb, add(take3(dv, e, 3), scale(dh / h, tb)))
                ends = e == plan.first[last + 1] - 1
                while i < points:
                    share = i / (points - 1)
                    at = share * length
                    if at >= model.s[node + 1] and not ends:
                        break
                    x = (at - s0) / h
                    p = cubic(x, h, r, va, rb, vb)
                    if stretched:  # the point moves in its element where nodes do not keep their share of the length
                        shift = share * ds[far] - ds[node] - x * dh
                        p = add(p, scale(shift, cubic_slope(x, scale(-1.0 / h, get3(work.first, e)), ta, tb)))
                    row = c * points + i
                    out[row, 0, column], out[row, 1, column], out[row, 2, column] = p
                    i += 1
                r = rb


@inline
def cubic(x: float, h: float, r: Vector, va: Vector, rb: Vector, vb: Vector) -> Vector:
    """The cubic through values and slopes at both ends of an element, at the fraction x of it."""
    z = 1.0 - x
    return add(
        add(scale(z * z * (1.0 + 2.0 * x), r), scale(z * z * x * h, va)),
        add(scale(x * x * (3.0 - 2.0 * x), rb), scale(-x * x * z * h, vb)),
    )


@inline
def cubic_slope(x: float, mean: Vector, va: Vector, vb: Vector) -> Vector:
    """The slope of that cubic, of which `mean` is the mean."""
    z = 1.0 - x
    return add(scale(6.0 * x * z, mean), add(scale(z * (1.0 - 3.0 * x), va), scale(x * (3.0 * x - 2.0), vb)))


@viewing
def velocities(ints: Whole, floats: Floats, sols: Floats, space: Floats, at: Floats, out: Floats) -> None:
    """Fills out (k, 3) [m/s] with the velocities at the ascending arc lengths `at` (k,) [m] of the first cable."""
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    for i in range(at.shape[0]):
        j = 0
        while j < plan.cables[1] - 1 and at[i] >= model.s[plan.first[j + 1] + j]:
            j += 1
        r = take3(work.move, plan.ends[j, 0], 3)
        dl = step_of_force(work, j)
        for e in range(plan.first[j], plan.first[j + 1]):
            node = e + j
            da, db = get3(work.d, node), get3(work.d, node + 1)
            change = add(
                add(tapply(get9(work.parts, e, 9), da), tapply(get9(work.parts, e, 18), db)),
                apply(get9(work.parts, e, 27), dl),
            )
            rb = subtract(r, change)
            if at[i] < model.s[node + 1] or e == plan.first[j + 1] - 1:
                C = take3(model.section, e, 3)
                va = node_slope(sol.q, node, da, take3(work.full, e, 0), dl, C)
                vb = node_slope(sol.q, node + 1, db, take3(work.full, e, 6), dl, C)
                put3(out, i, 0, cubic((at[i] - model.s[node]) / model.h[e], model.h[e], r, va, rb, vb))
                break
            r = rb


# -- eyelets


@inline
def slip(model: Model, sol: Solution, work: Work, node: int, e: int) -> tuple[Vector, Vector, Vector]:
    """r' (world) just before and just after the node between elements e - 1 and e, of an eyelet, and by how much V x N
    (cable frame) is larger after it."""
    R = rotation(get4(sol.q, node))
    a, b = tapply(R, take3(work.full, e - 1, 6)), tapply(R, take3(work.full, e, 0))
    va, vb = add(E3, times(take3(model.section, e - 1, 3), a)), add(E3, times(take3(model.section, e, 3), b))
    return apply(R, va), apply(R, vb), subtract(cross(vb, b), cross(va, a))


@inline
def bent(model: Model, work: Work, e: int, i: int, y: float) -> float:
    """[1/m], component i of the Darboux vector at the end of element e, y from its middle."""
    stiff = model.section[e, i] + y * model.section[e, 6 + i]
    return float(work.first[e, 6 + i] / stiff + model.rest[e, i] + y * model.rest[e, 3 + i])


@inline
def pull_change(plan: Plan, model: Model, sol: Solution, work: Work, c: int) -> float:
    """Change of F . d3 [N] at eyelet c by the answer at hand, the eyelet staying where it is on the cable.

    With friction, by how much more that is than the change of it: what slips goes on, what sticks gives as it does.
    """
    j = plan.rings[c, 1]
    node = plan.first[j + 1] + j
    R = rotation(get4(sol.q, node))
    F = subtract(get3(sol.lam, j), add(get3(sol.lam, j + 1), get3(model.weight, j + 1)))
    dF = subtract(step_of_force(work, j), step_of_force(work, j + 1))
    return (
        dot(dF, apply(R, E3))
        + dot(F, apply(R, cross(get3(work.d, node), E3)))
        - friction_change(plan, model, sol, work, c, NONE, NONE, NONE)
    )


@inline
def friction_change(
    plan: Plan, model: Model, sol: Solution, work: Work, c: int, more: Vector, both: Vector, turn: Vector
) -> float:
    """Change of the friction of eyelet c by that of its limit, see `gripping.change_of_limit`."""
    if not holds(model, sol, c):
        return 0.0
    limit, change = change_of_limit(plan, model, sol, work, c, more, both, turn)
    return law(plan, model, sol, c, limit)[2] * change


@viewing
def eyelets(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, f: Floats, J: Floats, points: int, out: Floats,
    jumps: Floats,
) -> None:  # fmt: skip
    """How the eyelets pull along the cable, f (e,) [N], and J = df/dsigma (e, e), at the solution just refreshed.

    out (c points, 3, e): change of the positions at fixed arc length with sigma; points 0: none. jumps (m, 3): scratch.
    Moving the eyelet on by d sigma is, for the material, to move the point at the eyelet back by r' d sigma, with the
    difference of the moments that the two forces exert over that length.
    """
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    for c in range(f.shape[0]):
        j = plan.rings[c, 1]
        e = plan.first[j + 1]
        before, after, couple = slip(model, sol, work, e + j, e)
        still(ints, space)
        put3(work.G, e + j + 1, 0, couple)
        put3(work.sums, j, 0, scale(-1.0, before))
        put3(work.sums, j + 1, 0, after)
        solve(ints, floats, space)
        for i in range(f.shape[0]):
            J[i, c] = pull_change(plan, model, sol, work, i)
        R = rotation(get4(sol.q, e + j))
        F = subtract(get3(sol.lam, j), add(get3(sol.lam, j + 1), get3(model.weight, j + 1)))
        f[c] = dot(F, apply(R, E3)) + model.draw[c]
        # the tangent at the eyelet changes by the curvature, too
        a = e - 1
        y = 0.5 * model.h[a]
        u = (bent(model, work, a, 0, y), bent(model, work, a, 1, y), 0.0)
        J[c, c] += dot(F, apply(R, cross(u, E3)))
        if holds(model, sol, c):
            # forces on both sides change by the load over the way, too
            load = scale(1.0 / model.h[a], subtract(take3(model.load, a, 6), take3(model.load, a, 0)))
            J[c, c] += friction_change(plan, model, sol, work, c, NONE, NONE, NONE)
            J[c, c] -= friction_change(plan, model, sol, work, c, NONE, load, u)
            pull, firm, _, _ = law(plan, model, sol, c, change_of_limit(plan, model, sol, work, c, NONE, NONE, NONE)[0])
            f[c] -= pull
            J[c, c] -= firm
        if points > 0:
            jumps[:, :] = 0.0
            put3(jumps, j + 1, 0, scale(-1.0, after))
            for k in range(work.move.shape[0]):
                if plan.vertices[k, 1] < 0:
                    put3(work.move, k, 3, NONE)
            lead(plan, work)
            spread(ints, floats, sols, space, points, out, c, jumps, part(space, 0, (0,)), part(space, 0, (0, 6)))


# -- columns


@kernel
def sensitivities(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, points: int, knots: Whole, out: Floats, df: Floats
) -> None:
    """Fills out (c points, 3, 6 g): change of the positions at fixed arc length with the poses of `knots` (g,).

    Columns: velocity and angular velocity of each knot, world axes, about the knot. df (e, 6 g): change of the pull of
    the eyelets, see `eyelets`. The matrix must be factored (`refresh`).
    """
    twists, jumps = np.zeros((ints[2], 6)), np.zeros((ints[1], 3))
    for g in range(knots.shape[0]):
        for axis in range(6):
            twists[:, :] = 0.0
            twists[knots[g], axis] = 1.0
            column_of(ints, floats, sols, space, points, twists, jumps, 6 * g + axis, out, df)


@viewing
def column_of(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, points: int, twists: Floats, jumps: Floats, column: int,
    out: Floats, df: Floats,
) -> None:  # fmt: skip
    """One column of `sensitivities`."""
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    still(ints, space)
    move_knots(ints, floats, sols, space, twists)
    answer(ints, floats, sols, space, twists)
    for c in range(df.shape[0]):
        df[c, column] = pull_change(plan, model, sol, work, c)
    spread(ints, floats, sols, space, points, out, column, jumps, part(space, 0, (0,)), part(space, 0, (0, 6)))


@viewing
def add_gradient(ints: Whole, floats: Floats, sols: Floats, space: Floats, by: float, kept: Floats) -> None:
    """Adds `by` times the gradient of a model at the solution to `kept`, see `differ`.

    Forces of spans beyond which nothing holds a place are those that the model makes them carry.
    """
    strip(ints, floats, sols)
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    gradient(ints, floats, sols, space)
    n, m = ints[0], ints[1]
    dv, slack, G = part(kept, 0, (n, 6)), part(kept, 6 * n, (n, 3)), part(kept, 9 * n, (n + m, 3))
    closure, pull = part(kept, 12 * n + 3 * m, (m, 3)), part(kept, 12 * n + 6 * m, (ints[2], 3))
    for e in range(n):
        node, C = plan.left[e], take3(model.section, e, 3)
        put3(slack, e, 0, add(get3(slack, e), scale(by, get3(work.first, e))))
        left = slope_at(sol.q, node, take3(work.full, e, 0), C)
        right = slope_at(sol.q, node + 1, take3(work.full, e, 6), C)
        put3(dv, e, 0, add(take3(dv, e, 0), scale(by, left)))
        put3(dv, e, 3, add(take3(dv, e, 3), scale(by, right)))
    for k in range(n + m):
        put3(G, k, 0, add(get3(G, k), scale(by, get3(work.G, k))))
    for j in range(m):
        put3(closure, j, 0, add(get3(closure, j), scale(by, get3(work.sums, j))))
    for k in range(ints[2]):
        put3(pull, k, 0, add(get3(pull, k), scale(by, get3(work.pull, k))))


@viewing
def differ(
    ints: Whole, floats: Floats, plus: Floats, minus: Floats, step: float, sols: Floats, space: Floats, kept: Floats
) -> None:
    """Makes the right-hand side the derivative of the gradient by a number of which two models are 2 `step` apart.

    kept (12 N + 6 m + 3 k,): change of r' at the left and right of the elements (N, 6); and of their steps in position,
    which `Work.slack` takes; the right-hand side.
    """
    kept[:] = 0.0
    add_gradient(ints, plus, sols, space, 0.5 / step, kept)
    add_gradient(ints, minus, sols, space, -0.5 / step, kept)
    strip(ints, floats, sols)
    gradient(ints, floats, sols, space)  # for forces and moments as they are
    n, m, work = ints[0], ints[1], work_of(ints, space)
    copy_rows(work.slack, part(kept, 6 * n, (n, 3)), 3)
    copy_rows(work.G, part(kept, 9 * n, (n + m, 3)), 3)
    closure = part(kept, 12 * n + 3 * m, (m, 3))
    for j in range(m):
        put3(work.sums, j, 0, get3(closure, j))
    copy_rows(work.pull, part(kept, 12 * n + 6 * m, (ints[2], 3)), 3)


@kernel
def answers(
    ints: Whole, floats: Floats, models: Floats, steps: Floats, sols: Floats, space: Floats, points: int, out: Floats,
    df: Floats,
) -> None:  # fmt: skip
    """Fills out (c points, 3, m): change of the positions with each of m numbers, points keeping their share of length.

    models (2 m, size of a model): for each number one above and one below, steps (m,) of it away. df (e, m): change of
    the pull of the eyelets. The matrix must be factored (`refresh`).
    """
    kept = np.empty(12 * ints[0] + 6 * ints[1] + 3 * ints[2])
    jumps, ds = np.zeros((ints[1], 3)), np.empty(ints[0] + ints[1])
    for i in range(steps.shape[0]):
        one_answer(
            ints, floats, models[2 * i], models[2 * i + 1], steps[i], sols, space, points, kept, jumps, ds, i, out, df
        )


@viewing
def one_answer(
    ints: Whole, floats: Floats, plus: Floats, minus: Floats, step: float, sols: Floats, space: Floats, points: int,
    kept: Floats, jumps: Floats, ds: Floats, column: int, out: Floats, df: Floats,
) -> None:  # fmt: skip
    """One column of `answers`."""
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    differ(ints, floats, plus, minus, step, sols, space, kept)
    solve(ints, floats, space)
    for k in range(work.move.shape[0]):
        if plan.vertices[k, 1] < 0:
            put3(work.move, k, 3, NONE)
    lead(plan, work)
    above, below = model_of(ints, plus), model_of(ints, minus)
    for k in range(ds.shape[0]):
        ds[k] = 0.5 / step * (above.s[k] - below.s[k])
    for c in range(df.shape[0]):
        j = plan.rings[c, 1]
        node = plan.first[j + 1] + j
        dw = scale(0.5 / step, subtract(get3(above.weight, j + 1), get3(below.weight, j + 1)))
        t = apply(rotation(get4(sol.q, node)), E3)
        df[c, column] = pull_change(plan, model, sol, work, c) - dot(dw, t)
        if holds(model, sol, c):
            df[c, column] += friction_change(plan, model, sol, work, c, NONE, NONE, NONE)
            df[c, column] -= friction_change(plan, model, sol, work, c, dw, NONE, NONE)
    spread(ints, floats, sols, space, points, out, column, jumps, ds, part(kept, 0, (ints[0], 6)))


# -- stability


@viewing
def negative_below(ints: Whole, floats: Floats, space: Floats, shift: float) -> int:
    """How many eigenvalues of the second variation lie below minus `shift` [N]."""
    return int(factor(ints, floats, space, shift) - ints[UNKNOWN])


@viewing
def smallest_eigenvalue(ints: Whole, floats: Floats, sols: Floats, space: Floats) -> float:
    """Smallest eigenvalue [N] of the second variation of the solution now, to 1e-3 of itself, by bisection.

    Under the conditions that close the spans, against the integral of |rotation|^2.
    """
    refresh(ints, floats, sols, space, False)
    model = model_of(ints, floats)
    unstable = negative_below(ints, floats, space, model.par[BASE_SHIFT]) > 0
    # grow a shift until it changes the verdict: up if unstable, down if stable; then bisect
    sign = 1.0 if unstable else -1.0
    low, high = 0.0, 1e-3 * model.par[STIFFEST] / model.par[LENGTH] ** 2
    changed = False
    for _ in range(100):
        shift = 0.5 * (low + high) if changed else high
        if (negative_below(ints, floats, space, sign * shift) > 0) != unstable:
            high = shift
            changed = True
        else:
            low = shift
            high = high if changed else 4.0 * high
        if changed and high - low < 1e-3 * high:
            break
    return -sign * 0.5 * (low + high)


@viewing
def softest_mode(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats, mode: Floats, steps: int, fresh: bool,
    told: Floats,
) -> None:  # fmt: skip
    """told: eigenvalue [N] nearest to zero, and the arc length [m] at which its mode turns most.

    By inverse iteration from `mode` (n, 3), which it improves: the eigenvalue is Rayleigh's quotient. NaN if the
    iteration breaks down. With fresh factors, or those that the last solve left, which are of a point as near to the
    solution as `newton.CHORD_FROM` says. run: see `sliding.new_slides`; with eyelets factors are always fresh.
    """
    slides = run.shape[0] > 0
    if fresh or slides:
        refresh(ints, floats, sols, space, True)
    if slides:
        columns(ints, floats, sols, space, run)
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    told[0], told[1] = math.nan, 0.0
    disturb(mode, NOISE / math.sqrt(model.par[LENGTH]))
    for _ in range(steps):
        work.sums[:, :3] = 0.0
        work.pull[:, :] = 0.0
        for j in range(plan.ends.shape[0]):
            for e in range(plan.first[j], plan.first[j + 1] + 1):
                size = size_at(plan, model, j, e)
                put3(work.G, e + j, 0, scale(-size, get3(mode, e + j)))
        release(plan, model, work.G)
        solve(ints, floats, space)
        if slides:
            slide_step(ints, floats, sols, space, run, 0.0)
        up = down = largest = 0.0
        for j in range(plan.ends.shape[0]):
            for e in range(plan.first[j], plan.first[j + 1] + 1):
                d = get3(work.d, e + j)
                turn = dot(d, d)
                up -= dot(d, get3(work.G, e + j))
                down += size_at(plan, model, j, e) * turn
                if turn > largest:
                    largest, told[1] = turn, model.s[e + j]
        if not (down > 0.0 and math.isfinite(down)):
            told[0], told[1] = math.nan, 0.0
            return
        told[0] = up / down
        unit = 1.0 / math.sqrt(down)
        for k in range(mode.shape[0]):
            put3(mode, k, 0, scale(unit, get3(work.d, k)))


@viewing
def disturb(mode: Floats, amplitude: float) -> None:
    """Adds noise up to `amplitude` to mode (n, 3), the same each time."""
    random = 1
    for k in range(mode.shape[0]):
        for i in range(3):
            random = (random * 1103515245 + 12345) & 0x7FFFFFFF
            mode[k, i] += amplitude * (random * (1.0 / 0x40000000) - 1.0)
