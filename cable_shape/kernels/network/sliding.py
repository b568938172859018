"""Eyelets inside Newton's method: the arc length sigma of the cable at each is an unknown, F . d3 = f - r its equation.

F is the force of the eyelet on the cable, d3 the tangent at its node, f its friction, see `gripping`, or 0, r the force
by which it draws the cable towards its start. The nodes between an eyelet and the next knots or point loads keep their
shares of that stretch, so that all of the discrete system depends on sigma, by what the elements are made of:
differences of the gradient are the columns of sigma, and what the factors answer to them reduces the system to one
equation an eyelet.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.graph import solve, step_of_force
from cable_shape.kernels.network.gripping import any_holds, change_of_limit, holds, law, short_of_turning
from cable_shape.kernels.network.material import fill_span
from cable_shape.kernels.network.system import FORCE, NONE, release
from cable_shape.kernels.network.tables import (
    LENGTH,
    N_RINGS,
    RIGID,
    TRIAL,
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
    work_of,
)
from cable_shape.kernels.rod_algebra import add, apply, cross, dot, get3, get4, rotation, subtract, take3
from cable_shape.kernels.rod_element import E3, element_gradient

DIFFERENCE = 1e-6  # of the length, between two values of sigma
REACH = 0.5  # of the slack of a span, or of the way to the next knot, that one step may use up
LEAST = 2e-3  # of the length: an eyelet this near to a knot has been run through
FINELY = 100.0  # see `hardly_gives`
FIRST_PRESSED = 14  # of a plan's head: the first of the knots that bodies press on, where any can be


class Slides(NamedTuple):
    """What e eyelets add."""

    turn: Floats  # (e, n, 3) change of the rotations with each sigma [rad/m]
    push: Floats  # (e, m, 3) change of the spans' forces [N/m]
    move: Floats  # (e, k, 6) change of rotation and place of the knots
    slope: Floats  # (e, N, 9) change of `first`
    heavy: Floats  # (e, m, 3) change of the spans' whole loads [N/m]
    J: Floats  # (e, e) change of F . d3 [N/m]
    lift: Floats  # (e, e) change of the limits of friction [N/m]
    way: Floats  # (e,) step of sigma [m]
    pull: Floats  # (e,) F . d3 - f + r, which is to vanish [N]
    A: Floats  # (e, e) scratch, as are the rest
    s: Floats  # (n,)
    weight: Floats  # (m, 3)
    G: Floats  # (n, 3)
    closure: Floats  # (m, 3)
    places: Floats  # (k, 3)
    still: Floats  # (m, 3) zeros
    used: Floats  # (m,)


@kernel
def new_slides(ints: Whole, sliding: bool) -> Floats:
    """Room for `Slides`; none if the network has no eyelets, or they hold the cable."""
    n, m, k, e = ints[0], ints[1], ints[2], ints[N_RINGS]
    if e == 0 or not sliding:
        return np.zeros(0)
    return np.zeros(e * (12 * n + 9 * m + 6 * k + 3 * e + 2) + 4 * n + 14 * m + 3 * k)


@viewing(forceinline=True)
def slides_of(ints: Whole, run: Floats) -> Slides:
    """The parts of what eyelets add; of none if there is no room."""
    n, m, k = ints[0], ints[1], ints[2]
    e = ints[N_RINGS] if run.shape[0] > 0 else 0
    o1 = e * (n + m) * 3
    o2 = o1 + e * m * 3
    o3 = o2 + e * k * 6
    o4 = o3 + e * n * 9
    o5 = o4 + e * m * 3
    o6a = o5 + e * e
    o6 = o6a + e * e
    o7 = o6 + e
    o8 = o7 + e
    o9 = o8 + e * e
    f = 1 if e > 0 else 0
    o10 = o9 + f * (n + m)
    o11 = o10 + f * m * 3
    o12 = o11 + f * (n + m) * 3
    o13 = o12 + f * m * 3
    o14 = o13 + f * k * 3
    o15 = o14 + f * m * 3
    return Slides(
        part(run, 0, (e, n + m, 3)), part(run, o1, (e, m, 3)), part(run, o2, (e, k, 6)),
        part(run, o3, (e, n, 9)), part(run, o4, (e, m, 3)), part(run, o5, (e, e)), part(run, o6a, (e, e)),
        part(run, o6, (e,)),
        part(run, o7, (e,)), part(run, o8, (e, e)), part(run, o9, (f * (n + m),)), part(run, o10, (f * m, 3)),
        part(run, o11, (f * (n + m), 3)),
        part(run, o12, (f * m, 3)), part(run, o13, (f * k, 3)), part(run, o14, (f * m, 3)),
        part(run, o15, (f * m,)),
    )  # fmt: skip


@inline
def cable_of(plan: Plan, j: int) -> int:
    """The cable of span j."""
    c = 0
    while plan.cables[c + 1] <= j:
        c += 1
    return c


@viewing(forceinline=True)
def stop_beside(plan: Plan, model: Model, j: int, near_end: bool) -> int:
    """The node nearest to the end of span j, or to its start, that carries a point load or is held by a knot.

    The nodes up to there, and knots that bodies press on with them, keep their shares of that stretch of the cable:
    but those that carry a point load, too.
    """
    c = cable_of(plan, j)
    least = 1e-9 * model.par[LENGTH]
    while True:
        first, last = plan.first[j] + j, plan.first[j + 1] + j
        found = first if near_end else last
        loaded = 0
        for k in range(plan.points[c], plan.points[c + 1]):
            for node in range(first, last) if near_end else range(first + 1, last + 1):
                if abs(model.s[node] - model.at[k]) < least:
                    found = max(found, node) if near_end else min(found, node)
                    loaded += 1
        knot = plan.ends[j, 0 if near_end else 1]
        if loaded > 0 or model.along.shape[0] == 0 or knot < plan.head[FIRST_PRESSED] or plan.vertices[knot, 1] < 0:
            return found
        j += -1 if near_end else 1


@viewing(forceinline=True)
def stretch(plan: Plan, model: Model, c: int) -> tuple[int, int]:
    """First and last of the spans that change as the cable moves through eyelet c."""
    low, high = plan.rings[c, 1], plan.rings[c, 1] + 1
    a, b = stop_beside(plan, model, low, True), stop_beside(plan, model, high, False)
    while plan.first[low] + low > a:
        low -= 1
    while plan.first[high + 1] + high < b:
        high += 1
    return low, high


@viewing
def respace(ints: Whole, floats: Floats, c: int, shift: float) -> None:
    """Moves the cable by `shift` through eyelet c: its node and those beside it, in proportion."""
    plan, model = plan_of(ints), model_of(ints, floats)
    s = model.s
    j = plan.rings[c, 1]
    a, ring = stop_beside(plan, model, j, True), plan.first[j + 1] + j
    stretch = (s[ring] + shift - s[a]) / (s[ring] - s[a])
    for k in range(a + 1, ring):
        s[k] = s[a] + (s[k] - s[a]) * stretch
    b = stop_beside(plan, model, j + 1, False)
    stretch = (s[b] - s[ring] - shift) / (s[b] - s[ring])
    for k in range(ring + 2, b):
        s[k] = s[b] - (s[b] - s[k]) * stretch
    s[ring] += shift
    s[ring + 1] = s[ring]


@viewing(late=types.none)
def move_along(ints: Whole, floats: Floats, run: Floats, fraction: float) -> None:
    """Moves the cable through its eyelets by `fraction` of the steps `way`, and the mesh with it."""
    plan, slides = plan_of(ints), slides_of(ints, run)
    for c in range(slides.way.shape[0]):
        if slides.way[c] != 0.0:
            respace(ints, floats, c, fraction * slides.way[c])
            low, high = stretch(plan, model_of(ints, floats), c)
            for j in range(low, high + 1):
                fill_span(ints, floats, cable_of(plan, j), j)


@viewing(forceinline=True)
def pull_along(plan: Plan, model: Model, sol: Solution, work: Work, heavy: Floats, c: int) -> tuple[float, float]:
    """F . d3 [N] at eyelet c, F the force of the eyelet on the cable, and its change by the step at hand.

    heavy (m, 3): change of the spans' loads that comes with the step.
    """
    j = plan.rings[c, 1]
    node = plan.first[j + 1] + j
    R = rotation(get4(sol.q, node))
    t = apply(R, E3)
    F = subtract(get3(sol.lam, j), add(get3(sol.lam, j + 1), get3(model.weight, j + 1)))
    dF = subtract(step_of_force(work, j), add(step_of_force(work, j + 1), get3(heavy, j + 1)))
    return dot(F, t), dot(dF, t) + dot(F, apply(R, cross(get3(work.d, node), E3)))


@viewing(late=types.none)
def columns(ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats) -> None:
    """Fills turn, push, move, slope, heavy and J, with the factors at hand; `first` is that of now."""
    plan, model, sol, work, slides = (
        plan_of(ints),
        model_of(ints, floats),
        solution_of(ints, sols, TRIAL),
        work_of(ints, space),
        slides_of(ints, run),
    )
    copy(slides.s, model.s)
    given = slides.way.shape[0]
    slides.slope[:, :, :] = 0.0
    slides.heavy[:, :, :] = 0.0
    slides.still[:, :] = 0.0  # in contact the room is shared out anew with every network
    weight = slides.weight
    copy_rows(weight, model.weight, 3)
    copy_rows(slides.G, work.G, 3)
    copy_rows(slides.closure, work.sums, 3)
    copy_rows(slides.places, work.pull, 3)
    for c in range(given):
        low, high = stretch(plan, model, c)
        cable = cable_of(plan, low)
        delta = DIFFERENCE * model.par[LENGTH]
        respace(ints, floats, c, delta)
        for i in range(low, high + 1):
            fill_span(ints, floats, cable, i)
        f = 1.0 / delta
        work.G[:, :] = 0.0
        work.sums[:, :3] = 0.0
        work.pull[:, :] = 0.0
        for i in range(low, high + 1):
            for x in range(3):
                slides.heavy[c, i, x] = f * (model.weight[i, x] - weight[i, x])
                work.pull[plan.ends[i, 0], x] -= slides.heavy[c, i, x]
            for e in range(plan.first[i], plan.first[i + 1]):
                differ(model, sol, work, slides, c, i, e, f)
        copy(model.s, slides.s)
        for i in range(low, high + 1):
            fill_span(ints, floats, cable, i)
        release(plan, model, work.G)
        solve(ints, floats, space)
        copy_rows(slides.turn[c], work.d, 3)
        copy_rows(slides.push[c], work.spans[:, FORCE : FORCE + 3], 3)
        copy_rows(slides.move[c], work.move, 6)
        for i in range(given):
            slides.J[i, c] = pull_along(plan, model, sol, work, slides.heavy[c], i)[1]
            if holds(model, sol, i):
                more = get3(slides.heavy[c], plan.rings[i, 1] + 1)
                slides.lift[i, c] = change_of_limit(plan, model, sol, work, i, more, NONE, NONE)[1]
    copy_rows(work.G, slides.G, 3)
    copy_rows(work.sums, slides.closure, 3)
    copy_rows(work.pull, slides.places, 3)


@inline
def differ(model: Model, sol: Solution, work: Work, slides: Slides, c: int, j: int, e: int, f: float) -> None:
    """Adds what element e of span j changes with sigma of eyelet c; f: 1 / difference."""
    node = e + j
    l = get3(sol.lam, j)  # noqa: E741
    nL, nM, nR = add(take3(model.load, e, 0), l), add(take3(model.load, e, 3), l), add(take3(model.load, e, 6), l)
    _, g1, g2, gl = element_gradient(
        model.h[e], get4(sol.q, node), get4(sol.q, node + 1), nL, nM, nR, take3(model.rest, e, 0),
        take3(model.rest, e, 3), take3(model.section, e, 0), take3(model.section, e, 3), take3(model.section, e, 6),
        (0.0, 0.0), None,
    )  # fmt: skip
    for x in range(3):
        slides.slope[c, e, x] = f * (gl[x] - work.first[e, x])
        slides.slope[c, e, 3 + x] = f * (g1[x] - work.first[e, 3 + x])
        slides.slope[c, e, 6 + x] = f * (g2[x] - work.first[e, 6 + x])
        work.sums[j, x] += slides.slope[c, e, x]
        work.G[node, x] += slides.slope[c, e, 3 + x]
        work.G[node + 1, x] += slides.slope[c, e, 6 + x]


@viewing(forceinline=True)
def balanced(J: Floats, f: Floats, way: Floats, A: Floats) -> int:
    """Solves f + J way = 0; returns how many eigenvalues of -J, the energy's second derivative, are negative."""
    k = f.shape[0]
    negative = 0
    for i in range(k):
        for c in range(k):
            A[i, c] = -J[i, c]
    copy(way, f)
    for i in range(k):
        if not A[i, i] > 0.0:
            negative += 1
        for r in range(i + 1, k):
            x = A[r, i] / A[i, i]
            for c in range(i, k):
                A[r, c] -= x * A[i, c]
            way[r] -= x * way[i]
    for i in range(k - 1, -1, -1):
        for c in range(i + 1, k):
            way[i] -= A[i, c] * way[c]
        way[i] /= A[i, i]
    return negative


@viewing
def rubbed(plan: Plan, model: Model, sol: Solution, work: Work, slides: Slides, pulls: float) -> int:
    """`balanced` with friction, where the directions in which the energy falls are counted as if limits were given.

    A step that would take an eyelet from slipping one way to slipping the other ends where it sticks: Newton's method
    would go to and fro between the two for ever.
    """
    f, J, way, lifted = slides.pull, slides.J, slides.way, slides.closure
    count = f.shape[0]
    for i in range(count):
        if holds(model, sol, i):
            limit, change = change_of_limit(plan, model, sol, work, i, NONE, NONE, NONE)
            pull, firm, lifts, _ = law(plan, model, sol, i, limit)
            f[i] -= pulls * pull + lifts * change
            J[i, i] -= firm
            lifted[i, 0], lifted[i, 1] = firm, lifts
        else:
            lifted[i, 0] = lifted[i, 1] = 0.0
    negative = balanced(J, f, way, slides.A)
    for i in range(count):
        for c in range(count):
            J[i, c] -= lifted[i, 1] * slides.lift[i, c]
    balanced(J, f, way, slides.A)
    for i in range(count):
        for c in range(count):
            J[i, c] += lifted[i, 1] * slides.lift[i, c]
        J[i, i] += lifted[i, 0]
        if pulls != 0.0 and lifted[i, 0] == 0.0 and lifted[i, 1] != 0.0:  # it slips
            way[i] = short_of_turning(plan, model, sol, i, way[i], lifted[i, 1])
    return negative


@viewing(late=types.int64)
def slide_step(ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats, pulls: float) -> int:
    """Adds the steps of sigma, into `way`, and the answer to them to the step at hand.

    pulls: 1 if the eyelets pull as they do, 0 if only what the step changes counts. Returns in how many directions of
    sigma the energy falls.
    """
    plan, model, sol, work, slides = (
        plan_of(ints),
        model_of(ints, floats),
        solution_of(ints, sols, TRIAL),
        work_of(ints, space),
        slides_of(ints, run),
    )
    f = slides.pull
    for i in range(f.shape[0]):
        pull, change = pull_along(plan, model, sol, work, slides.still, i)
        f[i] = pulls * (pull + model.draw[i]) + change
    if any_holds(model, sol):
        negative = rubbed(plan, model, sol, work, slides, pulls)
    else:
        negative = balanced(slides.J, f, slides.way, slides.A)
    for c in range(f.shape[0]):
        way = slides.way[c]
        for k in range(work.d.shape[0]):
            for i in range(3):
                work.d[k, i] += way * slides.turn[c, k, i]
        for j in range(work.spans.shape[0]):
            for i in range(3):
                work.spans[j, FORCE + i] += way * slides.push[c, j, i]
        for k in range(work.move.shape[0]):
            for i in range(6):
                work.move[k, i] += way * slides.move[c, k, i]
    return negative


@viewing(late=types.float64)
def cut_short(ints: Whole, floats: Floats, sols: Floats, run: Floats) -> float:
    """What fraction of the steps `way` the slack of the spans and the next knots allow; 0: an eyelet has no room."""
    plan, model, sol, slides = (
        plan_of(ints),
        model_of(ints, floats),
        solution_of(ints, sols, TRIAL),
        slides_of(ints, run),
    )
    fraction = 1.0
    length, s = model.par[LENGTH], model.s
    used = slides.used
    used[:] = 0.0
    for c in range(slides.way.shape[0]):
        way, j = slides.way[c], plan.rings[c, 1]
        ring = plan.first[j + 1] + j
        used[j] -= way
        used[j + 1] += way
        if way > 0.0:
            room = s[stop_beside(plan, model, j + 1, False)] - s[ring]
        else:
            room = s[ring] - s[stop_beside(plan, model, j, True)]
        if room < LEAST * length:
            return 0.0
        if abs(way) > REACH * room:
            fraction = min(fraction, REACH * room / abs(way))
    for j in range(used.shape[0]):
        if used[j] <= 0.0 or plan.known[j] != 0 or model.par[RIGID] == 0.0:
            continue
        chord = subtract(get3(sol.pose, plan.ends[j, 1]), get3(sol.pose, plan.ends[j, 0]))
        room = s[plan.first[j + 1] + j] - s[plan.first[j] + j] - math.sqrt(dot(chord, chord))
        if room <= 0.0:
            return 0.0
        if used[j] > REACH * room:
            fraction = min(fraction, REACH * room / used[j])
    return fraction


@viewing(late=types.float64)
def run_through(ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats) -> float:
    """The largest step: a rotation, or twice that of a place or along the cable / length; see `hardly_gives`, too."""
    model, work, slides = model_of(ints, floats), work_of(ints, space), slides_of(ints, run)
    sol = solution_of(ints, sols, TRIAL)
    largest = 0.0
    for k in range(work.d.shape[0]):
        size = math.sqrt(dot(get3(work.d, k), get3(work.d, k)))
        if not size <= largest:
            largest = size
    length = model.par[LENGTH]
    for k in range(work.move.shape[0]):
        y = take3(work.move, k, 3)
        largest = max(largest, 2.0 * math.sqrt(dot(y, y)) / length)
    for c in range(slides.way.shape[0]):
        largest = max(largest, 2.0 * abs(slides.way[c]) / length)
    return max(largest, hardly_gives(model, sol, slides))


@viewing(forceinline=True)
def hardly_gives(model: Model, sol: Solution, slides: Slides) -> float:
    """The largest step of an eyelet in which the cable sticks, FINELY times, / length: a hair counts there."""
    largest = 0.0
    for c in range(slides.way.shape[0]):
        if holds(model, sol, c) and slides.closure[c, 0] > 0.0:
            largest = max(largest, FINELY * abs(slides.way[c]) / model.par[LENGTH])
    return largest


@inline
def carried(slides: Slides, e: int, o: int) -> tuple[float, float, float]:
    """Change of three columns of `first` of element e by the steps of sigma."""
    total = (0.0, 0.0, 0.0)
    for c in range(slides.way.shape[0]):
        way = slides.way[c]
        x = (way * slides.slope[c, e, o], way * slides.slope[c, e, o + 1], way * slides.slope[c, e, o + 2])
        total = add(total, x)
    return total
