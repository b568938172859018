"""How far the discrete network is from the continuous one, and its correction: `rod_defect`, span by span.

At a knot force and moment may jump, so that no defect is carried across one; the answer of the whole network to the
defects of all spans comes from the factors at hand, and that of the eyelets with it.
"""

from __future__ import annotations

import math

from numba import types

from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.graph import any_moves, lead, solve, solve_forces, step_of_force
from cable_shape.kernels.network.sliding import carried, slide_step, slides_of
from cable_shape.kernels.network.system import release
from cable_shape.kernels.network.tables import (
    STIFFEST,
    TRIAL,
    Floats,
    Plan,
    Whole,
    Work,
    model_of,
    plan_of,
    solution_of,
    still_knots,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    FAST,
    add,
    apply,
    cross,
    dot,
    get3,
    get9,
    put3,
    scale,
    subtract,
    take3,
    tapply,
)
from cable_shape.kernels.rod_defect import defects, left_over, take_off

#: What `correct` tells: the largest error that is taken off and that is left of a position [m], a force [N] and a
#: moment [N m].
OFF, LEFT, OFF_FORCE, LEFT_FORCE, OFF_MOMENT, LEFT_MOMENT = 0, 1, 2, 3, 4, 5
ERRORS = 6
#: Forces at knots that nothing holds are balanced so many times at most, or until they change by this fraction.
BALANCINGS, BALANCED = 4, 1e-10
#: So many times the last change may be what is left where it is no smaller than the one before.
REMAINING = 10.0


@viewing(fastmath=FAST)
def correct(ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats, told: Floats) -> None:
    """The solution at hand without its discretisation error, to first order in it.

    `work.start` takes the rotations, `moments` the moments in the cable frame, `pulled` the forces of the spans,
    `place` the places of the knots, the first three columns of `first` minus the steps in position, the last of
    `slides` how far the cable runs through its eyelets, `model.errors` each element's share of what is left. told
    (ERRORS,): see OFF and the rest; infinite if they cannot be judged.
    """
    plan, model, sol, work, slides = (
        plan_of(ints),
        model_of(ints, floats),
        solution_of(ints, sols, TRIAL),
        work_of(ints, space),
        slides_of(ints, run),
    )
    U, parts, first, G, slack = work.U, work.parts, work.first, work.G, work.slack
    sums, moments = work.sums, work.moments
    elements, spans = model.h.shape[0], sol.lam.shape[0]
    missing = work.missing
    defects(
        plan.left, sol.q, model.h, work.full, model.rest, model.section, U, parts, first, G, slack, moments, sums,
        missing, work.lanes,
    )  # fmt: skip
    release(plan, model, G)
    solve(ints, floats, space)
    runs = slides.way.shape[0] > 0
    if runs:
        slide_step(ints, floats, sols, space, run, 1.0)
    lead(plan, work)
    largest = left = force = moment = 0.0
    for k in range(sol.pose.shape[0]):
        step = take3(work.move, k, 3)
        put3(work.place, k, 0, add(get3(sol.pose, k), step))
    for j in range(spans):
        a, b = plan.first[j], plan.first[j + 1]
        dl = step_of_force(work, j)
        force = max(force, dot(dl, dl))
        put3(work.pulled, j, 0, add(get3(sol.lam, j), dl))
        r = scale(-1.0, take3(work.move, plan.ends[j, 0], 3))  # elements tell minus their steps
        _, far, closure = take_off(
            sol.q[a + j : b + j + 1], U[a:b], parts[a:b], get9(sums, j, 12), work.d[a + j : b + j + 1], dl, slack[a:b],
            first[a:b], moments[a:b], G[a + j : b + j + 1], work.start[a + j : b + j + 1], r,
        )  # fmt: skip
        moment = max(moment, change_of_moments(plan, work, j))
        largest = max(largest, dot(r, r), far)
        put3(sums, j, 0, closure)
        put3(G, b + j, 0, get3(missing, j))
    if runs:
        for e in range(elements):
            put3(first, e, 0, add(take3(first, e, 0), carried(slides, e, 0)))
            put3(moments, e, 0, subtract(take3(moments, e, 0), carried(slides, e, 3)))
            put3(moments, e, 3, add(take3(moments, e, 3), carried(slides, e, 6)))
    told[OFF], told[OFF_FORCE], told[OFF_MOMENT] = math.sqrt(largest), math.sqrt(force), math.sqrt(moment)
    # what the rule itself misses
    work.pull[:, :] = 0.0
    still_knots(model)
    release(plan, model, G)
    solve(ints, floats, space)
    along = 0.0
    if runs:
        taken = slides.used
        for c in range(slides.way.shape[0]):
            taken[c] = slides.way[c]
        slide_step(ints, floats, sols, space, run, 0.0)
        for c in range(slides.way.shape[0]):
            along += abs(slides.way[c])
            slides.way[c] = taken[c]
    if plan.stripped.shape[0] > 0:
        for e in range(elements):
            put3(slack, e, 0, take3(first, e, 6))
        lead(plan, work)
    force = moment = 0.0
    for j in range(spans):
        a, b = plan.first[j], plan.first[j + 1]
        dl = step_of_force(work, j)
        force = max(force, dot(dl, dl))
        r = scale(-1.0, take3(work.move, plan.ends[j, 0], 3))
        _, far = left_over(
            model.h[a:b], parts[a:b], work.d[a + j : b + j + 1], dl, first[a:b], model.par[STIFFEST],
            model.errors[a:b], r,
        )  # fmt: skip
        moment = max(moment, change_of_moments(plan, work, j))
        left = max(left, dot(r, r), far)
    for j in range(spans):  # what `respond` reads: the moments at the ends of spans, as derivatives
        a, b = plan.first[j], plan.first[j + 1] - 1
        put3(first, a, 3, scale(-1.0, take3(moments, a, 0)))
        put3(first, b, 6, take3(moments, b, 3))
    rough = 0.0
    for e in range(elements):
        rough = max(rough, model.rough[e])
        model.errors[e] += model.rough[e]
    told[LEFT], told[LEFT_FORCE], told[LEFT_MOMENT] = (
        math.sqrt(left) + along + rough,
        math.sqrt(force),
        math.sqrt(moment),
    )
    if any_moves(plan):
        told[LEFT_FORCE] += balance(ints, floats, space)
    total = 0.0
    for i in range(ERRORS):
        total += told[i]
    if not math.isfinite(total):
        told[:] = math.inf


@viewing(late=types.float64)
def balance(ints: Whole, floats: Floats, space: Floats) -> float:
    """Balances the forces of the spans at knots that nothing holds; returns how uncertain they were, and are [N].

    Next to straight, spans that do not stretch are so stiff that rounding of places makes forces: of what the gaps
    between places leave of a balance only this is asked, how the forces share it.
    """
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    first = last = math.inf
    largest = 0.0
    for _ in range(BALANCINGS):
        for k in range(plan.vertices.shape[0]):
            put3(work.pull, k, 0, scale(-1.0, get3(model.force, k)))
        for j in range(plan.ends.shape[0]):
            a, b = plan.ends[j, 0], plan.ends[j, 1]
            n = get3(work.pulled, j)
            put3(work.pull, a, 0, subtract(get3(work.pull, a), add(n, get3(model.weight, j))))
            put3(work.pull, b, 0, add(get3(work.pull, b), n))
        solve_forces(ints, floats, space)
        largest, strongest = 0.0, 0.0
        for j in range(plan.ends.shape[0]):
            dl, n = step_of_force(work, j), get3(work.pulled, j)
            largest, strongest = max(largest, dot(dl, dl)), max(strongest, dot(n, n))
        if not largest < last:  # nothing more is to be had
            break
        for j in range(plan.ends.shape[0]):
            put3(work.pulled, j, 0, add(get3(work.pulled, j), step_of_force(work, j)))
        if not first < math.inf:
            first = math.sqrt(largest)
        last = largest
        if not largest > BALANCED * BALANCED * strongest:
            break
    return first + REMAINING * math.sqrt(largest)


@viewing(fastmath=FAST, forceinline=True)
def change_of_moments(plan: Plan, work: Work, j: int) -> float:
    """Square of the largest change of a moment of span j by the step at hand."""
    largest = 0.0
    dl = step_of_force(work, j)
    for e in range(plan.first[j], plan.first[j + 1]):
        node = e + j
        d1, d2 = get3(work.d, node), get3(work.d, node + 1)
        M = take3(work.moments, e, 3)
        t = add(tapply(get9(work.U, e, 0), d1), apply(get9(work.parts, e, 0), d2))
        t = add(add(t, apply(get9(work.parts, e, 18), dl)), scale(0.5, cross(M, d2)))
        largest = max(largest, dot(t, t))
    return largest
