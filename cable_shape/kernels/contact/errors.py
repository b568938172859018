"""How far a shape in contact may be from the exact one: defects of elements, and contacts that should be elsewhere."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels.contact.knots import slot_of
from cable_shape.kernels.contact.near import BARE, NORMAL, PRESS, STEP, parting, tangent_of
from cable_shape.kernels.contact.press import moves
from cable_shape.kernels.contact.tables import Net
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.graph import lead, solve, step_of_force
from cable_shape.kernels.network.respond import still
from cable_shape.kernels.network.sliding import carried, slide_step, slides_of
from cable_shape.kernels.network.system import release
from cable_shape.kernels.network.tables import (
    N_KNOTS,
    STIFFEST,
    TRIAL,
    Plan,
    model_of,
    plan_of,
    solution_of,
    still_knots,
    work_of,
)
from cable_shape.kernels.rod_algebra import add, dot, get3, get4, put3, rotation, scale, subtract, take3, tapply
from cable_shape.kernels.rod_defect import change_of_step, defects

# Of the discretisation error as corrected: a body may press all along a cable where nodes alone are pressed, and of
# that the correction knows nothing.
SAFETY = 1.5
AMISS = 2.5  # of `contact_error`


@viewing
def position_error(net: Net, errors: Array) -> float:
    """Estimated largest position error of the network's solution at hand [m]; infinite if it cannot be judged.

    The defects of `rod_defect`, solved with the factors at hand: good enough to tell the size of the error, but not to
    take it off where they are of another place, for the forces between contacts are stiff. errors (N,): takes each
    element's share, a guide for the next mesh. Of the right-hand side nothing is left.
    """
    plan, model = plan_of(net.ints), model_of(net.ints, net.floats)
    sol, work = solution_of(net.ints, net.sols, TRIAL), work_of(net.ints, net.space)
    still(net.ints, net.space)
    still_knots(model)
    defects(
        plan.left, sol.q, model.h, work.full, model.rest, model.section, work.U, work.parts, work.first, work.G,
        work.slack, work.moments, work.sums, work.missing, work.lanes,
    )  # fmt: skip
    for e in range(errors.shape[0]):
        t, g = get3(work.slack, e), get3(work.G, plan.left[e])
        errors[e] = math.sqrt(dot(t, t)) + model.h[e] ** 2 * math.sqrt(dot(g, g)) / model.par[STIFFEST]
    release(plan, model, work.G)
    solve(net.ints, net.floats, net.space)
    lead(plan, work)
    runs = net.run.shape[0] > 0
    slides = slides_of(net.ints, net.run)
    if runs:
        slide_step(net.ints, net.floats, net.sols, net.space, net.run, 0.0)
    largest = 0.0
    for j in range(plan.ends.shape[0]):
        off = take3(work.move, plan.ends[j, 0], 3)
        dl = step_of_force(work, j)
        for e in range(plan.first[j], plan.first[j + 1]):
            change = change_of_step(work.parts, e, get3(work.d, e + j), get3(work.d, e + j + 1), dl)
            off = subtract(off, add(change, get3(work.slack, e)))
            if runs:
                off = subtract(off, carried(slides, e, 0))
            size = dot(off, off)
            if not size <= largest:  # NaN is the largest of all
                largest = size
    if runs:
        slides.way[:] = 0.0
    return math.sqrt(largest) if math.isfinite(largest) else math.inf


@viewing
def shift_of(
    q: Array, near: Array, on: Array, h: Array, k: int, least: float, flex: Array, before: float, behind: float
) -> tuple[float, float]:
    """How far along the cable from node k its contact's force should act, and how far the node should be off [m].

    A contact alone, or the last of a row, belongs where the cable is nearest to the body; inside a row, nothing is
    known to be amiss. before, behind [m]: how far it may belong there, see `beyond`. least [1/m]: no less curved is the
    gap.
    """
    left, right = on[k - 1, 0] != BARE, on[k + 1, 0] != BARE
    slope = dot(tangent_of(q, k), take3(near, k, NORMAL))
    if (left and right) or slope == 0.0:
        return 0.0, 0.0
    second, _ = parting(q, h, near, k, flex)
    way = -slope / max(second, abs(slope) / (behind if slope < 0.0 else before), least)
    return way, -way * (slope + 0.5 * second * way)


@inline
def beyond(plan: Plan, h: Array, k: int, x: int, end: int, known: int) -> float:
    """[m] how far the contact at node k may belong along span x, at whose other end it is.

    What lies beyond half an element is the next node's, unless that is none to touch anything, a knot: then what is
    beyond, if the cable goes on in one with what it is tied to there, or all up to it.
    """
    own = h[k - 1 + end]
    if not (plan.first[x + 1] == plan.first[x] + 1 and plan.ends[x, end] < known and plan.known[x] == 0):
        return 0.5 * own
    return 0.5 * (h[k - 1] + h[k]) if plan.tied[x, end] != 0 else own


@viewing
def contact_error(net: Net, q: Array, near: Array, on: Array, h: Array, least: float, flex: Array) -> float:
    """Estimated error [m] from contacts at nodes, whose forces should act elsewhere, with the factors at hand.

    Leaves the change of the nodes' places in `near`, and nothing of the right-hand side.
    """
    model, work = model_of(net.ints, net.floats), work_of(net.ints, net.space)
    still(net.ints, net.space)
    still_knots(model)
    amiss = False
    plan, known = plan_of(net.ints), net.bare[N_KNOTS]
    for i in range(known, net.ints[N_KNOTS]):
        k = net.where[i]
        if on[k, 0] == BARE:
            continue
        x = net.span[i]
        before, behind = beyond(plan, h, k, x, 0, known), beyond(plan, h, k, x + 1, 1, known)
        way, off = shift_of(q, near, on, h, k, least, flex, before, behind)
        if way == 0.0:
            continue
        amiss = True
        n = take3(near, k, NORMAL)
        N = tapply(rotation(get4(q, k)), n)
        f = near[k, PRESS] * way
        put3(work.G, slot_of(net, i), 0, (f * N[1], -f * N[0], 0.0))
        put3(model.given, i, 0, scale(off, n))
    if not amiss:
        return 0.0
    solve(net.ints, net.floats, net.space)
    if net.run.shape[0] > 0:
        slide_step(net.ints, net.floats, net.sols, net.space, net.run, 0.0)
    moves(net, near)
    if net.run.shape[0] > 0:
        slides_of(net.ints, net.run).way[:] = 0.0
    still_knots(model)
    largest = 0.0
    for k in range(q.shape[0]):
        move = take3(near, k, STEP)
        size = dot(move, move)
        if not size <= largest:  # NaN is the largest of all
            largest = size
    return math.sqrt(largest) if math.isfinite(largest) else math.inf
