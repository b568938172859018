"""Newton's method for a network of rods: damped by inertia and step length, finished by chord steps.

Far from an equilibrium the Hessian is shifted until it has the inertia of a minimum and the step is capped in radians.
Close to it the last factors serve for one more step or two, which cost a gradient only. An equilibrium is a strict
minimum iff the whole matrix has three negative eigenvalues for every unknown force: that is what pivots tell.
"""

from __future__ import annotations

import math

from numba import types

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.graph import any_moves, factor, solve, step_of_force
from cable_shape.kernels.network.sliding import (
    columns,
    cut_short,
    move_along,
    run_through,
    slide_step,
    slides_of,
)
from cable_shape.kernels.network.system import FORCE, assemble, energy_left, gradient, release
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    LENGTH,
    SOFTEST,
    TRIAL,
    Floats,
    Model,
    Plan,
    Whole,
    Work,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    dot,
    get3,
    get4,
    get9,
    inverse,
    put3,
    qexp,
    qmul,
    qnormal,
    scale,
    take3,
)

CONVERGED, STALLED, NOT_FINITE = 0, 1, 2
LARGEST_STEP = 0.6  # rad
# rad, and of the moments: below this a full step is followed by chord steps; where junctions are free to move, whose
# forces change by more than anything turns
CHORD_FROM, CHORD_FROM_OF_JUNCTIONS = 3e-3, 6e-3
STEP_TOLERANCE = 1e-5  # rad, of a chord step, which the correction of the discretisation error then includes
FIRST_SHIFT, SHIFT_GROWTH, MOST_SHIFTS = 0.02, 6.0, 16  # the first as a fraction of stiffness / length^2
SADDLE = 1e-5  # rad, a shifted step below this is no progress
KICK = 0.1  # rad
MOST_KICKS = 3
MOST_AVOIDED = 4  # shaky factors are not used so many times
SHAKY = 1e10  # largest^3 / determinant of an inverse pivot: an eigenvalue 1e5 times as small as the others
#: What `newton` tells in `info`: iterations, last step [rad], negative eigenvalues beyond those of the forces (0:
#: stable), shift of the last iteration, assemblies, kicks off a saddle, value of the functional, how much of an error
#: the last step with old factors left.
I_ITERATIONS, I_STEP, I_EXCESS, I_SHIFT, I_ASSEMBLIES, I_KICKS, I_VALUE, I_STALE = 0, 1, 2, 3, 4, 5, 6, 14


@viewing
def advance(ints: Whole, sols: Floats, space: Floats, fraction: float) -> None:
    """Takes `fraction` of the step: q exp(d), forces, places and rotations of the knots."""
    plan, sol, work = plan_of(ints), solution_of(ints, sols, TRIAL), work_of(ints, space)
    q, d = sol.q, work.d
    for k in range(q.shape[0]):
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q, k), qexp(scale(fraction, get3(d, k)))))
    for j in range(sol.lam.shape[0]):
        for i in range(3):
            sol.lam[j, i] += fraction * work.spans[j, FORCE + i]
    if plan.pointer.shape[0] > 1:
        for k in range(sol.pose.shape[0]):
            if plan.vertices[k, 1] >= 0:
                for i in range(3):
                    sol.pose[k, i] += fraction * work.move[k, 3 + i]
            if plan.vertices[k, 0] >= 0:
                p = (sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6])
                p = qnormal(qmul(p, qexp(scale(fraction, get3(work.move, k)))))
                sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6] = p


@inline
def change_of_moment(plan: Plan, model: Model, work: Work, least: float) -> float:
    """Largest change of a moment by the step, relative to the largest moment, or to `least` if that is larger."""
    moment = change = 0.0
    for e in range(model.h.shape[0]):
        node = plan.left[e]
        a, b = 0.0, 0.0
        for i in range(3):
            a += work.first[e, 6 + i] ** 2
            b += (model.section[e, i] * (work.d[node + 1, i] - work.d[node, i]) / model.h[e]) ** 2
        moment, change = max(moment, a), max(change, b)
    return math.sqrt(change) / max(math.sqrt(moment), least)


@inline
def change_of_force(plan: Plan, model: Model, work: Work) -> float:
    """Largest change of a span's force by the step, relative to the force there, or to EI / length^2 if larger."""
    change = 0.0
    for j in range(plan.known.shape[0]):
        if plan.known[j] != 0:
            continue
        force = span = 0.0
        for e in range(plan.first[j], plan.first[j + 1]):
            n = take3(work.full, e, 3)
            force = max(force, dot(n, n))
            span += model.h[e]
        step = step_of_force(work, j)
        bend = max(model.section[plan.first[j], 0], model.section[plan.first[j], 1])
        change = max(change, math.sqrt(dot(step, step)) / max(math.sqrt(force), bend / (span * span)))
    return change


@inline
def shaky(plan: Plan, model: Model, work: Work) -> bool:
    """Whether a pivot is so near to singular that what follows from it is rounding."""
    for j in range(plan.known.shape[0]):
        begin = 1 if plan.tied[j, 0] != 0 else 0
        end = 0 if plan.tied[j, 1] != 0 else 1
        for e in range(plan.first[j] + begin, plan.first[j + 1] + end):
            node = e + j
            row = min(e, plan.first[j + 1] - 1)
            size = 0.0
            for i in range(3):
                for c in range(3):
                    size += model.section[row, i] * model.section[row, c] * work.P[node, 3 * i + c] ** 2
            _, det = inverse(get9(work.P, node, 0))
            det *= model.section[row, 0] * model.section[row, 1] * model.section[row, 2]
            if not size * size * size < (SHAKY * det) ** 2:
                return True
    return False


@inline
def size_at(plan: Plan, model: Model, j: int, e: int) -> float:
    """Half the length of the elements beside the left node of element e of span j, or beside its last node."""
    before = model.h[e - 1] if e > plan.first[j] else 0.0
    after = model.h[e] if e < plan.first[j + 1] else 0.0
    return 0.5 * (before + after)


@viewing(late=types.none)
def kick(ints: Whole, floats: Floats, space: Floats) -> None:
    """Fills d with a turn of KICK rad along the softest shapes of the factored, shifted matrix: away from a saddle."""
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    G, d = work.G, work.d
    work.sums[:, :3] = 0.0
    work.pull[:, :] = 0.0
    for j in range(plan.known.shape[0]):
        first, last = plan.first[j], plan.first[j + 1]
        a0, length = model.s[first + j], model.s[last + j] - model.s[first + j]
        for e in range(first, last + 1):
            x = math.pi * (model.s[e + j] - a0) / length
            size = size_at(plan, model, j, e)
            a, b, c = size * math.sin(x), size * math.sin(2.0 * x), size * math.cos(x)
            f = 1.0 if j % 2 == 0 else 0.7
            put3(
                G, e + j, 0,
                scale(f, (0.8 * a - 0.3 * b + 0.2 * c, 0.5 * a + 0.6 * b - 0.3 * c, 0.2 * a + 0.1 * b + 0.3 * c)),
            )  # fmt: skip
    for _ in range(4):
        release(plan, model, G)
        largest = solve(ints, floats, space)
        for j in range(plan.known.shape[0]):
            for e in range(plan.first[j], plan.first[j + 1] + 1):
                size = size_at(plan, model, j, e)
                for i in range(3):
                    d[e + j, i] *= KICK / largest
                    G[e + j, i] = size * d[e + j, i]
    work.spans[:, FORCE : FORCE + 3] = 0.0
    for k in range(work.move.shape[0]):
        for i in range(6):
            work.move[k, i] = KICK / largest * work.move[k, i] if i < 3 else 0.0


@viewing
def newton(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats, guard: bool, most: int, info: Floats
) -> int:
    """Solves for what is unknown in `sol` from the values it has; returns CONVERGED, STALLED or NOT_FINITE.

    The step that remains is left in the right-hand sides, for `defect.correct` to take. guard: keep to minima; without
    it any equilibrium is accepted. most: iterations allowed. info: see I_ITERATIONS and the rest.
    """
    plan, model, work, slides = plan_of(ints), model_of(ints, floats), work_of(ints, space), slides_of(ints, run)
    length, softest = model.par[LENGTH], model.par[SOFTEST]
    wanted = 0
    for j in range(plan.known.shape[0]):
        wanted += 3 * (1 - plan.known[j])
    several = plan.known.shape[0] > 1
    runs = slides.way.shape[0] > 0
    chord_from = CHORD_FROM_OF_JUNCTIONS if any_moves(plan) else CHORD_FROM
    shift = largest = 0.0
    iterations = avoided = 0
    while iterations < most:
        iterations += 1
        info[I_ASSEMBLIES] += 1.0
        assemble(ints, floats, sols, space)
        # far away the last shift is the best bet; near an equilibrium only the unshifted inertia tells
        trial = shift / SHIFT_GROWTH if largest > chord_from and shift > FIRST_SHIFT * softest else 0.0
        untested = trial > 0.0
        negative = 0
        for _ in range(MOST_SHIFTS):
            negative = factor(ints, floats, space, trial + model.par[BASE_SHIFT])
            if trial == 0.0 or negative == wanted:
                info[I_EXCESS] = negative - wanted
            if not guard:
                break
            if negative == wanted:
                if not several or avoided == MOST_AVOIDED or not shaky(plan, model, work):
                    break
                avoided += 1
            trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
        if guard and negative != wanted:
            return STALLED
        shift = trial
        if runs:
            columns(ints, floats, sols, space, run)
        largest = solve(ints, floats, space)
        fraction = 1.0
        if runs:
            falling = slide_step(ints, floats, sols, space, run, 1.0)
            info[I_EXCESS] += falling
            if guard and falling > 0:
                return STALLED
            fraction = cut_short(ints, floats, sols, run)
            if fraction == 0.0:
                return STALLED
            largest = run_through(ints, floats, sols, space, run)
        info[I_ITERATIONS], info[I_STEP], info[I_SHIFT] = iterations, largest, shift
        if not math.isfinite(largest):
            return NOT_FINITE
        if shift > 0.0 and largest < SADDLE and not untested:
            if info[I_KICKS] >= MOST_KICKS:
                return STALLED
            info[I_KICKS] += 1.0
            kick(ints, floats, space)
            slides.way[:] = 0.0
            largest = KICK
        before = max(largest, change_of_moment(plan, model, work, softest * length))
        if several:
            before = max(before, change_of_force(plan, model, work))
        fraction = min(fraction, LARGEST_STEP / largest) if largest > 0.0 else 1.0
        advance(ints, sols, space, fraction)
        if runs:
            move_along(ints, floats, run, fraction)
        since, stale = before, 0.0
        while shift == 0.0 and fraction == 1.0 and before < chord_from and iterations < most:
            iterations += 1
            info[I_VALUE] = gradient(ints, floats, sols, space)
            largest = solve(ints, floats, space)
            if runs:
                slide_step(ints, floats, sols, space, run, 1.0)
                largest = run_through(ints, floats, sols, space, run)
            info[I_ITERATIONS], info[I_STEP] = iterations, largest
            if not math.isfinite(largest):
                return NOT_FINITE
            if largest < STEP_TOLERANCE:
                info[I_STALE] = max(stale, min(largest / before, since)) if before > 0.0 else stale
                return CONVERGED
            if largest > 0.5 * before:
                if energy_left(work) < STEP_TOLERANCE**2 * softest * length:  # along a neutral mode
                    info[I_STALE] = stale
                    return CONVERGED
                break
            stale = max(stale, min(largest / before, since))
            advance(ints, sols, space, 1.0)
            if runs:
                move_along(ints, floats, run, 1.0)
            before = largest
    return STALLED
