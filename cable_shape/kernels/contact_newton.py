"""Newton's method for a rod pressed on bodies: which nodes touch is found along with the shape.

A contact is a support whose place is free along the surface. Its force is p n, so that the unknowns are the rotations,
the force at the end and every p; the place is that of the node. An iteration

1. drops contacts that pull, adds nodes that are inside a body, takes gaps, normals and curvatures where they are now,
2. solves the linear system of `span_factor` for rotations, forces, and places that close the gaps along the normals,
3. goes at most 0.6 rad, and carries no node further than its gap and 0.6 of a body's thickness.

Through eyelets the cable runs along with every iteration, as `span_slide` has it.

If the set of contacts does not settle, one contact is changed at a time.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact_near import (
    NORMAL,
    PRESS,
    ROUND,
    STEP,
    allowed,
    couple,
    forces_of,
    lean,
    look,
    supports,
    totals,
    walk,
)
from cable_shape.kernels.contact_set import drop, grow, misplaced, spare_clips
from cable_shape.kernels.contact_slide import slide
from cable_shape.kernels.contact_step import eyelets_at, gaps, hold_back, moves, run_on
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get3,
    get4,
    put3,
    qexp,
    qmul,
    qnormal,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.span_factor import FORCE, backward, factor, forward
from cable_shape.kernels.span_newton import (
    CHORD_FROM,
    CONVERGED,
    FIRST_SHIFT,
    KICK,
    LARGEST_STEP,
    MOST_KICKS,
    MOST_SHIFTS,
    NOT_FINITE,
    SADDLE,
    SHIFT_GROWTH,
    STALLED,
    kick,
    longest,
)
from cable_shape.kernels.span_slide import columns_of, farthest_way, load_elements, respace, settle
from cable_shape.kernels.span_system import assemble, fold, gradient
from cable_shape.kernels.span_work import joints_of, matrices, mesh_parts, vectors

# [m] a node deeper inside becomes a contact: far from and at the solution, for a step misses by its square
MOST, ADD = 2e-5, 1e-6
PULL = 1e-5  # of weight + EI / L^2: a contact that pulls by more is dropped
STEP_TOLERANCE = 3e-7  # rad
NEUTRAL_TOLERANCE = 1e-6
RUNNING = 14  # iterations in which contacts on bodies that are not sharp run along the cable
COUPLED = 19  # of `info`
BLOCK = 8  # iterations in which all contacts that are wrong change at once
RESTLESS = 1e-4  # of the length: contacts that run further along the cable have changed the system
CHORD_TOLERANCE, SURE = 2e-6, 0.05  # rad, of a step with old factors that is so much shorter than the one before
LIMP = 2e-3  # EI / (w L^3): in softer cables errors of rotation carry nodes of steep legs far off their places
CALM = 0.1  # rad: contacts are dropped after steps below this only


@kernel
def press(
    q: Array, ends: Array, near: Array, on: Array, par: Array, mesh: Array, elements: int, held: Array,
    held_mask: Array, places: Array, forces: int, where: Array, mask: Array, place: Array, lam: Array, base: Array,
    bodies: Array, frames: Array, triangles: Array, nodes: Array, radius: float, sunk: float, stack: Array,
    acts: Array, points: Array, table: Array, rings: Array, knots: Array,
    slides: tuple[Array, Array, Array, Array, Array], guard: bool, most: int, drag: float, factored: int, work: Array,
    info: Array,
) -> int:  # fmt: skip
    """Solves for q, the forces `ends` between held supports and the contacts; CONVERGED, STALLED or NOT_FINITE.

    forces: how many of `ends` are unknown. guard: keep to minima. drag [N]: moment per length and angle that holds the
    rotations back from the start in `work`. info as in `span_newton`, and 3 the number of spans,
    14 changes of the set of contacts, 15 the largest gap at a contact [m]. acts, points, table: of the cable, as
    `span_slide` has them. rings (k,): held supports that are eyelets; knots: nodes of held supports and masses;
    slides: turn, push, slope, J and way of `span_slide`, which go with the factors in `work`.
    factored: spans of the factors in `work`, which are a nearby solution's and serve while steps are short; 0: none.
    info 19: not 0 if contacts that run have a part in the matrix. Else it is factored anew as it is where only the set
    of contacts has changed.
    """
    s, h, load, rest, _ = mesh_parts(mesh, elements)
    D, U, parts, P, Y, W = matrices(work, elements)
    first, full, _, G, d, start = vectors(work, elements)
    stiff, moment, length = par[0:6], par[6:9], s[elements]
    softest = min(stiff[0], stiff[1], stiff[2]) / (length * length)
    weight = math.sqrt(par[9] ** 2 + par[10] ** 2 + par[11] ** 2) * length
    least = PULL * (weight + softest)
    flex = 2.0 / (stiff[0] + stiff[1])
    limp = flex * LIMP * weight * length * length > 1.0
    last_node = elements - 1
    turn, push, slope, J, way = slides
    runs_through = rings.shape[0] > 0
    at = rings.copy()
    way[:] = 0.0
    falling = 0
    shift = largest = before = 0.0
    iterations = 0
    reuse = factored > 0
    built = factored
    coupled = False
    gone = 0.0 if reuse else math.inf  # rad, since the matrix was assembled
    changed = 0
    spans = 0
    while iterations < most:
        iterations += 1
        one = iterations > BLOCK
        if iterations > 1 and largest < (CALM if not one else LARGEST_STEP):
            changed += drop(near, on, least, one)
        runs = ROUND / length if iterations <= RUNNING else math.inf
        slid = slide(q, start, near, on, s, h, load, rest, acts[0:2], table, runs, flex)
        still = slid < RESTLESS * length
        reuse = reuse and changed == 0 and still
        keep = still and gone < CHORD_FROM and drag == 0.0 and shift == 0.0 and not coupled and iterations <= BLOCK
        spans = supports(q, h, near, on, held, held_mask, where, mask, place, base, runs, flex, False)
        reuse = reuse and spans == built
        joints, sums, pull, given = joints_of(work, elements, spans)
        forces_of(near, NORMAL, ends, where, base, spans, lam)
        fold(load, lam[:spans], where, full)
        if reuse or keep:
            info[6] = gradient(q, full, h, rest, stiff, moment, where[: spans + 1], mask, G, first, sums)
        else:
            info[4] += 1.0
            gone = 0.0
            assemble(q, full, h, rest, stiff, moment, where[: spans + 1], mask, D, U, G, parts, first, sums)
        fresh = not (reuse or keep)
        built = spans
        walk(first, held, places, near)
        look(s, near, on, 1, last_node, bodies, frames, triangles, nodes, radius, sunk, stack)
        spare_clips(near, on, held)
        off = misplaced(near, on) if limp else 0.0
        added = grow(near, on, min(ADD + length * largest * largest, MOST), off, one)
        changed += added
        spans = supports(q, h, near, on, held, held_mask, where, mask, place, base, runs, flex, True)
        joints, sums, pull, given = joints_of(work, elements, spans)
        if spans != built + added:  # a node has left a body
            changed += 1
        if added > 0 or spans != built:
            built = spans
            forces_of(near, STEP, ends, where, base, spans, lam)
            if reuse and not keep:
                fresh = True
                info[4] += 1.0
                gone = 0.0
                assemble(q, full, h, rest, stiff, moment, where[: spans + 1], mask, D, U, G, parts, first, sums)
            reuse = False
        if not reuse:
            totals(first, parts, where, spans, sums)
        unknown = spans if forces == held.shape[0] - 1 else spans - 1
        eyelets_at(base, spans, rings, at)
        info[15] = gaps(near, where, base, spans, places, sums, pull, given)
        for j in range(1, spans):
            k = where[j]
            if base[j] < 0:  # the force still has the direction that the normal was expected to have
                put3(pull, j, 0, scale(near[k, PRESS], subtract(take3(near, k, STEP), take3(near, k, NORMAL))))
                run_on(q, h, near, on, k, runs, flex, place, j, G, pull)
        info[14] += changed
        info[3] = spans
        if drag > 0.0:
            hold_back(q, start, h, drag, where[: spans + 1], mask, G)
            for j in range(1, spans):
                for c in (1, 5, 9):  # what `factor` adds for the drag
                    place[j, c] -= drag / length
        if not reuse:
            runs_on = couple(place, where, base, spans, D)
            coupled = runs_on or (coupled and not fresh)
            info[COUPLED] = 1.0 if coupled else 0.0
            trial = shift / SHIFT_GROWTH if largest > CHORD_FROM and shift > FIRST_SHIFT * softest else 0.0
            untested = trial > 0.0
            negative = 0
            wanted = 3 * unknown
            for _ in range(MOST_SHIFTS):
                negative = factor(
                    D, U, parts, sums, where, mask, place, unknown, trial + drag + par[12], h, P, Y, W, joints
                )  # fmt: skip
                if trial == 0.0 or negative == wanted:
                    info[2] = negative - wanted
                if negative == wanted or not guard or not fresh:
                    break
                trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
            if not fresh and negative != wanted:
                gone, largest, changed = math.inf, 0.0, 0
                continue
            if guard and negative != wanted:
                return STALLED
            shift = trial
            if runs_through:
                columns_of(
                    q, lam[:spans], s, rest, stiff, where[: spans + 1], mask, place, unknown, knots, at, acts, points,
                    table, first, P, Y, W, joints, turn, push, slope, J,
                )  # fmt: skip
        forward(G, sums, pull, given, where, place, unknown, P, Y, W, joints)
        before = largest
        largest = backward(where, place, unknown, P, Y, W, joints, d)
        if runs_through:
            falling = settle(q, lam[:spans], where, at, turn, push, J, 1.0, d, joints, way)
            largest = longest(d, joints, way, length)
            if not reuse:
                info[2] += falling
                if guard and falling > 0:
                    return STALLED
        moves(parts, d, joints, where, base, spans, slope, way, near)
        for j in range(1, spans + 1):
            move = take3(near, where[j], STEP)
            largest = max(largest, 2.0 * math.sqrt(dot(move, move)) / length)
        info[0], info[1] = iterations, largest
        if iterations == 1 and not fresh and not largest < CHORD_FROM:
            reuse = False
            gone, largest, changed = math.inf, 0.0, 0
            continue
        gone += largest
        if not math.isfinite(largest):
            return NOT_FINITE
        if shift > 0.0 and largest < SADDLE and not untested and changed == 0:
            if info[11] >= MOST_KICKS:
                return STALLED
            info[11] += 1.0
            kick(s, h, sums, pull, given, where[: spans + 1], mask, place, unknown, P, Y, W, joints, G, d)
            largest = KICK
            way[:] = 0.0
            moves(parts, d, joints, where, base, spans, slope, way, near)
        fraction = min(1.0, LARGEST_STEP / largest) if largest > 0.0 else 1.0
        fraction = min(fraction, allowed(near, on, bodies, radius))
        if runs_through:
            fraction = min(fraction, farthest_way(s, places, where, knots, at, 0, False, way))
            if fraction == 0.0:
                return STALLED
        for j in range(spans):
            k = where[j + 1]
            if base[j + 1] >= 0:
                if j < unknown:
                    for c in range(3):
                        ends[base[j + 1] - 1, c] += fraction * joints[j, FORCE + c]
            else:
                n = take3(near, k, NORMAL)
                jump = subtract(get3(lam, j), get3(lam, j + 1))
                jump = add(jump, take3(joints, j, FORCE))
                if j + 1 < unknown:
                    jump = subtract(jump, take3(joints, j + 1, FORCE))
                near[k, PRESS] += fraction * (dot(jump, n) - near[k, PRESS])
                lean(near, k, fraction)
        for k in range(elements + 1):
            q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q, k), qexp(scale(fraction, get3(d, k)))))
        if runs_through:
            respace(s, knots, where, at, way, fraction)
            load_elements(s, acts, points, table, h, load, rest)
        info[17] = slid
        if fraction == 1.0 and shift == 0.0 and changed == 0 and slid < RESTLESS * length:
            pulling = False
            for j in range(1, spans):
                if base[j] < 0 and near[where[j], PRESS] < -least:
                    pulling = True
            again = not fresh and iterations > 1
            small = slid < STEP_TOLERANCE * length and (
                largest < STEP_TOLERANCE
                or (again and max(largest, before) < NEUTRAL_TOLERANCE)
                or (again and largest < CHORD_TOLERANCE and largest < SURE * before)
            )
            if small and not pulling:
                if fresh:  # no gradient was taken on the way
                    info[6] = gradient(q, full, h, rest, stiff, moment, where[: spans + 1], mask, G, first, sums)
                return CONVERGED
            if again and largest > 0.3 * before:
                gone = math.inf
            reuse = largest < CHORD_FROM and not pulling and gone < math.inf
        else:
            reuse = False
        changed = 0
    return STALLED
