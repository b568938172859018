"""One solve of a network, warm or from a guess, in one compiled call: predict, Newton, correct, sample."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.correct import (
    ERRORS,
    LEFT,
    LEFT_FORCE,
    LEFT_MOMENT,
    OFF,
    OFF_FORCE,
    OFF_MOMENT,
    correct,
)
from cable_shape.kernels.network.graph import any_moves
from cable_shape.kernels.network.gripping import SLIPPED, begin_grips, end_grips
from cable_shape.kernels.network.material import add_up, fill
from cable_shape.kernels.network.newton import CONVERGED, I_STALE, newton
from cable_shape.kernels.network.predict import (
    extrapolate,
    follow,
    pace,
    reach,
    turn_ends,
    turn_knots,
)
from cable_shape.kernels.network.sliding import cut_short, move_along, new_slides, slides_of
from cable_shape.kernels.network.system import NONE
from cable_shape.kernels.network.tables import (
    BEFORE,
    ELASTIC,
    LENGTH,
    N_STRIPPED,
    NOW,
    RIGID,
    SOFT,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
    work_of,
)
from cable_shape.kernels.rod_algebra import add, apply, dot, get3, get4, put3, qconj, qmul, rotation, subtract, take3
from cable_shape.kernels.rod_output import (
    INTERPOLATION,
    S_BENT,
    S_GAP,
    S_MOMENT,
    S_TURN,
    S_TWIST,
    S_WORK,
    SUMS,
    all_finite,
    sample_cable,
)

BROKEN = 3  # a number in the output is not finite
FAR = 4  # an equilibrium further from the prediction than asked for
TAUT = 5  # a span that cannot stretch is shorter than its chord, or as long
STRAIGHT = 1.0 - 1e-9  # chord / length from which it is
# What a solve tells: see `newton` for the first seven and I_STALE; then the estimated error [m], elastic energy less
# weight . r [J], error of the interpolation [m], largest turn of a frame against its prediction [rad] and largest
# rotation of an element [rad], error taken off and left [m], errors of force [N] and moment [N m], residual, and how
# much the error may be above its estimate where a correction is large [m].
I_ESTIMATE, I_ENERGY, I_INTERPOLATION, I_RESIDUAL, I_TURNED, I_TURN = 7, 8, 10, 11, 12, 13
I_OFF, I_LEFT, I_FORCE, I_MOMENT, I_DOUBT = 15, 16, 17, 18, 19
#: then two numbers of each cable: its twist [rad] and turns; and, where there is room, one of each: its energy [J]
INFO = 20
LARGEST_TURN = 0.7  # rad, of an element: coarser ones misjudge stability
# The estimated error is so many times what the correction leaves and what the interpolation misses: both are judged by
# their leading term. Set so that on random scenes it is above the true error in 99 of 100 at any tolerance.
MARGIN, MARGIN_OF_KNOTS = 14.0, 21.0
# So many times what the last step with old factors left of an error they leave of the correction, too: where junctions
# are free to move up to 19, when measured.
STALE, STALE_OF_JUNCTIONS = 2.0, 20.0
MOMENTS = 1.5  # times as much for moments, largest in layers of which the leading term is less sure
INTERPOLATED, INTERPOLATED_OF_KNOTS = 0.45, 0.7
# The correction is of first order: of a small one it may leave the fraction STRAYS times its size over the length, of
# a large one MOST_STRAYING; where supports leave rotations free, which makes for soft modes, so many times
# `par[SOFT]`. It seldom leaves as much: that is no part of the estimate, but a mesh for which both exceed the
# tolerance is too coarse.
STRAYS, MOST_STRAYING = 1.5e4, 0.3


@viewing
def refill(ints: Whole, floats: Floats) -> None:
    """Lengths, loads, rest curvature and section of the elements between the nodes as they are."""
    add_up(ints, floats)
    fill(ints, floats)


@viewing
def pace_of(ints: Whole, floats: Floats, sols: Floats) -> float:
    """`predict.pace` of the trial."""
    plan, length = plan_of(ints), model_of(ints, floats).par[LENGTH]
    sol, now, before = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW), solution_of(ints, sols, BEFORE)
    return pace(plan, before, now, sol, length)


@viewing
def strip(ints: Whole, floats: Floats, sols: Floats) -> None:
    """Forces of spans beyond which nothing holds a place: they carry what hangs on them."""
    if ints[N_STRIPPED] != 0:
        strip_all(ints, floats, sols)


@viewing(late=types.none)
def strip_all(ints: Whole, floats: Floats, sols: Floats) -> None:
    """`strip`, of which there are some."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    carried = model.carried
    copy_rows(carried, model.force, 3)
    for i in range(plan.stripped.shape[0]):
        j, end = plan.stripped[i, 0], plan.stripped[i, 1]
        leaf, other = plan.ends[j, end], plan.ends[j, 1 - end]
        for x in range(3):
            if end == 1:
                sol.lam[j, x] = carried[leaf, x]
                carried[other, x] += carried[leaf, x] + model.weight[j, x]
            else:
                sol.lam[j, x] = -carried[leaf, x] - model.weight[j, x]
                carried[other, x] -= sol.lam[j, x]


@viewing
def any_taut(ints: Whole, floats: Floats, sols: Floats) -> bool:
    """Whether the chord of a span between given places is as long as the span."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    for j in range(plan.known.shape[0]):
        a, b = plan.ends[j, 0], plan.ends[j, 1]
        if plan.known[j] != 0 or plan.vertices[a, 1] >= 0 or plan.vertices[b, 1] >= 0:
            continue
        chord = subtract(get3(sol.pose, b), get3(sol.pose, a))
        length = STRAIGHT * (model.s[plan.first[j + 1] + j] - model.s[plan.first[j] + j])
        if dot(chord, chord) >= length * length:
            return True
    return False


@viewing
def give_back(floats: Floats, kept: Floats, status: int) -> int:
    """Puts the model back to what it was, if it was kept; returns `status`."""
    for i in range(kept.shape[0] // 2):
        floats[i] = kept[i]
    return status


@viewing(forceinline=True)
def predict(
    plan: Plan, model: Model, before: Solution, now: Solution, sol: Solution, way: Floats, history: int
) -> None:
    """Fills the trial from the last one or two solutions; way (e,): how far the cable runs on through its eyelets."""
    follow(plan, now, sol)
    a = pace(plan, before, now, sol, model.par[LENGTH]) if history > 1 else 0.0
    if plan.pointer.shape[0] > 1:
        turn_knots(plan, model, before, now, sol, a)
    extrapolate(plan, before, now, sol, a)
    for c in range(way.shape[0]):
        sticks = model.friction[c] > 0.0 and now.grip[c, SLIPPED] == 0.0
        way[c] = 0.0 if sticks else a * (now.arc[c] - before.arc[c])


@kernel
def solve(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, out: Floats, info: Floats, loads: Floats, points: int,
    history: int, again: bool, sliding: bool, guard: bool, most: int, far: float,
) -> int:  # fmt: skip
    """Solves for the knots in the trial of `sols`; returns CONVERGED, STALLED, NOT_FINITE, BROKEN, FAR or TAUT.

    history: 0 the trial's rotations and unknown places are a guess; 1 or 2 start from so many solutions. sliding: the
    cables run through their eyelets, and the mesh with them; else they are held there. far [rad]: largest turn of a
    frame from its prediction that is accepted, less where supports move little, see `predict.reach`. After CONVERGED
    the trial has become the solution now; the one now has become the one before, unless the trial solves for the same
    knots `again`. out: 17 points a cable, as CableShape.buffer; `points` 0: none. loads (k, 7): see
    `knot_loads`; no rows: none.
    """
    run = new_slides(ints, sliding)
    kept = np.empty(2 * floats.shape[0] if run.shape[0] > 0 else 0)
    return attempt(ints, floats, sols, space, run, kept, out, info, loads, points, history, again, guard, most, far)


@viewing
def attempt(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats, kept: Floats, out: Floats, info: Floats,
    loads: Floats, points: int, history: int, again: bool, guard: bool, most: int, far: float,
) -> int:  # fmt: skip
    """`solve` with room for the eyelets' columns, and for the model as it was before the mesh moved with them."""
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    sol, now, before = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW), solution_of(ints, sols, BEFORE)
    slides = slides_of(ints, run)
    runs = run.shape[0] > 0
    info[:] = 0.0
    if not runs and model.par[RIGID] != 0.0 and any_taut(ints, floats, sols):
        return TAUT
    half = kept.shape[0] // 2
    copy(kept[:half], floats)
    rubs = 0
    for c in range(model.friction.shape[0]):
        rubs += model.friction[c] > 0.0
    if rubs > 0:
        begin_grips(ints, floats, sols, history > 0 and not again)
    if history > 0:
        predict(plan, model, before, now, sol, slides.way, history)
        if runs:
            move_along(ints, floats, run, cut_short(ints, floats, sols, run))
        turn_ends(plan, model, sol)
        far = reach(plan, model, now, sol, far)
    strip(ints, floats, sols)
    start = work.start
    copy_rows(start, sol.q, 4)
    status = newton(ints, floats, sols, space, run, guard, most, info)
    if status == CONVERGED:
        largest = 0.0
        for k in range(sol.q.shape[0]):
            miss = qmul(qconj(get4(start, k)), get4(sol.q, k))
            largest = max(largest, miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
        info[I_TURNED] = 2.0 * math.asin(min(1.0, math.sqrt(largest)))
        if not info[I_TURNED] <= far:
            status = FAR
    if status != CONVERGED:
        return give_back(floats, kept, status)
    told = work.sums_of[SUMS : SUMS + ERRORS]
    correct(ints, floats, sols, space, run, told)
    several = plan.known.shape[0] > 1
    margin = MARGIN_OF_KNOTS if several else MARGIN
    stale = (STALE_OF_JUNCTIONS if any_moves(plan) else STALE) * info[I_STALE]
    soft = model.par[SOFT]
    strays = min(STRAYS * soft * soft * told[OFF] / model.par[LENGTH], MOST_STRAYING * soft)
    info[I_DOUBT] = strays * told[OFF]
    info[I_ESTIMATE] = margin * told[LEFT] + stale * told[OFF]
    info[I_FORCE] = margin * told[LEFT_FORCE] + stale * told[OFF_FORCE]
    info[I_MOMENT] = MOMENTS * margin * told[LEFT_MOMENT] + stale * told[OFF_MOMENT]
    info[I_OFF], info[I_LEFT] = told[OFF], told[LEFT]
    cosine = 1.0
    for e in range(model.h.shape[0]):
        node = plan.left[e]
        cosine = min(cosine, abs(qmul(qconj(get4(sol.q, node)), get4(sol.q, node + 1))[3]))
    info[I_TURN] = 2.0 * math.acos(cosine)
    for c in range(slides.way.shape[0]):
        sol.arc[c] = model.s[plan.first[plan.rings[c, 1] + 1] + plan.rings[c, 1]]
    if runs and rubs > 0:
        end_grips(ints, floats, sols)
    if plan.stripped.shape[0] > 0:
        settle_leaves(ints, floats, sols, space)
    for c in range(sol.turns.shape[0]):
        info[INFO + 2 * c + 1] = sol.turns[c]
    if points > 0:
        if runs:  # the mesh stays that of the solution that is corrected
            copy(kept[half:], floats)
            move_along(ints, floats, run, 1.0)
        sample(ints, floats, sols, space, points, out, info)
        info[I_ESTIMATE] += (INTERPOLATED_OF_KNOTS if several else INTERPOLATED) * info[I_INTERPOLATION]
        if loads.shape[0] > 0:
            knot_loads(ints, floats, space, loads)
        if runs:
            copy(floats, kept[half:])
        if not all_finite(info):
            return give_back(floats, kept, BROKEN)
    size = solution_size(ints)
    if not again:
        copy(sols[size : 2 * size], sols[0:size])
    copy(sols[0:size], sols[2 * size : 3 * size])
    return CONVERGED


@viewing(late=types.none)
def settle_leaves(ints: Whole, floats: Floats, sols: Floats, space: Floats) -> None:
    """Places of the knots that nothing holds, in the solution and corrected: where the spans lead from those held."""
    plan, sol, work = plan_of(ints), solution_of(ints, sols, TRIAL), work_of(ints, space)
    for i in range(plan.stripped.shape[0] - 1, -1, -1):
        j, end = plan.stripped[i, 0], plan.stripped[i, 1]
        leaf, other = plan.ends[j, end], plan.ends[j, 1 - end]
        way = NONE
        for e in range(plan.first[j], plan.first[j + 1]):
            way = subtract(way, take3(work.first, e, 0))
        if end == 0:
            way = (-way[0], -way[1], -way[2])
        put3(work.place, leaf, 0, add(get3(work.place, other), way))
        put3(sol.pose, leaf, 0, get3(work.place, leaf))
    # an end that turns freely leaves its knot's rotation as it was given


@viewing
def sample(ints: Whole, floats: Floats, sols: Floats, space: Floats, points: int, out: Floats, info: Floats) -> None:
    """Fills `out` from the corrected solution, and what `info` tells of it."""
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    elastic = model.par[ELASTIC] != 0.0
    full = work.full
    cables = plan.cables.shape[0] - 1
    for j in range(work.pulled.shape[0]):
        for e in range(plan.first[j], plan.first[j + 1]):
            for c in range(9):
                full[e, c] = model.load[e, c] + work.pulled[j, c % 3]
    for c in range(cables):
        sums = work.sums_of[:SUMS]
        sums[:] = 0.0
        first, last = plan.cables[c], plan.cables[c + 1] - 1
        length = model.s[plan.first[last + 1] + last]
        own = out[17 * points * c : 17 * points * (c + 1)]
        a, b = plan.first[first], plan.first[last + 1]
        sample_cable(
            plan.left[a:b], work.start, work.moments[a:b], model.s, model.h[a:b], full[a:b], model.rest[a:b],
            model.section[a:b], get3(work.place, plan.ends[first, 0]), get3(model.heavy, c), elastic, work.first[a:b],
            length / (points - 1), points, own, sums, work.lanes,
        )  # fmt: skip
        if plan.known[last] == 0:  # met to the closure's rounding, and exactly where the knot is
            end = get3(work.place, plan.ends[last, 1])
            own[4 * points - 3], own[4 * points - 2], own[4 * points - 1] = end
        soft = 1e-3 * min(model.section[plan.first[first], 0], model.section[plan.first[first], 1]) / length
        bent = max(sums[S_BENT], soft * soft)
        info[I_ENERGY] += sums[S_WORK]
        info[I_INTERPOLATION] = max(info[I_INTERPOLATION], INTERPOLATION * math.sqrt(sums[S_GAP]))
        info[I_MOMENT] += INTERPOLATION * math.sqrt(sums[S_MOMENT])
        residual = max(2.0 * math.sqrt(sums[S_TURN]), math.sqrt(sums[S_MOMENT] / bent), math.sqrt(sums[S_GAP]) / length)
        info[I_RESIDUAL] = max(info[I_RESIDUAL], residual)
        info[INFO + 2 * c] = sums[S_TWIST]
        if info.shape[0] > INFO + 2 * cables:
            info[INFO + 2 * cables + c] = sums[S_WORK]


@viewing(late=types.none)
def knot_loads(ints: Whole, floats: Floats, space: Floats, loads: Floats) -> None:
    """loads (k, 7): what the cables do to each knot: arc length [m] there, force [N] and moment [N m], world.

    Dead forces on the knot are part of it; the moment is about the knot.
    """
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    for k in range(loads.shape[0]):
        loads[k, 0] = 0.0
        put3(loads, k, 1, get3(model.force, k))
        put3(loads, k, 4, NONE)
    for j in range(work.pulled.shape[0]):
        first, last = plan.first[j], plan.first[j + 1]
        a, b = plan.ends[j, 0], plan.ends[j, 1]
        n = get3(work.pulled, j)
        put3(loads, a, 1, add(take3(loads, a, 1), add(n, get3(model.weight, j))))
        put3(loads, b, 1, subtract(take3(loads, b, 1), n))
        M = apply(rotation(get4(work.start, first + j)), take3(work.moments, first, 0))
        put3(loads, a, 4, add(take3(loads, a, 4), M))
        M = apply(rotation(get4(work.start, last + j)), take3(work.moments, last - 1, 3))
        put3(loads, b, 4, subtract(take3(loads, b, 4), M))
        loads[b, 0] = model.s[last + j]


@viewing
def energy_of_masses(ints: Whole, floats: Floats, space: Floats, masses: Floats) -> float:
    """[J], potential energy of the last solution's point masses (j, 4): arc length [m] and weight [N] of each."""
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    energy = 0.0
    for i in range(masses.shape[0]):
        near, place = math.inf, NONE
        for j in range(plan.cables[1]):
            r = get3(work.place, plan.ends[j, 0])
            for e in range(plan.first[j], plan.first[j + 1] + 1):
                off = abs(model.s[e + j] - masses[i, 0])
                if off < near:
                    near, place = off, r
                if e < plan.first[j + 1]:
                    r = subtract(r, take3(work.first, e, 0))
        energy -= dot((masses[i, 1], masses[i, 2], masses[i, 3]), place)
    return energy
