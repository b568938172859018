"""One solve of a cable pressed on bodies, in one compiled call: predict, Newton, judge, sample, look, accept.

Solutions are kept in three slots, of which NOW and BEFORE are solutions and TRIAL is solved for:

    q (3, N+1, 4) | near (3, N+1, 20) | on (3, N+1, 2) | ends (3, b, 3) | grips (3, b+1, 7) | turns (3,)
    slid (3, b+1), arc lengths at the held supports [m]
    par (14,) as in `span_drive`      info (20,) as in `contact_newton`, 5 and 7 to 13 as in `span_drive`, and
    16 the part of the error estimate that is the contacts' [m], 17 how far the node that slid furthest slid last [m],
    18 how far frames have turned since the factors in `work` [rad], infinite: none to start from, 19 as in
    `contact_newton`
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.bounds import closest_points
from cable_shape.kernels.contact_check import passes
from cable_shape.kernels.contact_error import AMISS, SAFETY, contact_error, position_error
from cable_shape.kernels.contact_near import BARE, GRIP_EXCLUSION, PRESS, ROUND, couple
from cable_shape.kernels.contact_newton import COUPLED, RUNNING, press
from cable_shape.kernels.contact_slide import any_crowded
from cable_shape.kernels.contact_step import eyelets_at
from cable_shape.kernels.rod_algebra import get4, put3, qconj, qmul, qnormal
from cable_shape.kernels.rod_output import all_finite, sample
from cable_shape.kernels.span_drive import BROKEN, FAR, take4, turn_supports
from cable_shape.kernels.span_factor import factor
from cable_shape.kernels.span_newton import CONVERGED
from cable_shape.kernels.span_slide import farthest_way, load_elements, respace
from cable_shape.kernels.span_system import NONE, assemble, fold
from cable_shape.kernels.span_work import BEFORE, NOW, TRIAL, joints_of, matrices, mesh_parts, vectors

INFO = 20
AGE = 18  # of `info`
OLDEST = 0.03  # rad: factors from further away serve no more
QUICK = 3  # iterations: after more of them the factors are too old
UNSETTLED = 8  # an equilibrium, but something is left to be done about it


@kernel
def pace(grips: Array, length: float) -> float:
    """How far the held supports have moved on from the solution now, as a fraction 0 to 2 of the step before."""
    up = down = 0.0
    for j in range(grips.shape[1]):
        for i in range(7):
            f = 1.0 / (length * length) if i < 3 else 1.0
            old = grips[NOW, j, i] - grips[BEFORE, j, i]
            up += f * old * (grips[TRIAL, j, i] - grips[NOW, j, i])
            down += f * old * old
    return min(max(up / down, 0.0), 2.0) if down > 1e-16 else 0.0


@kernel
def same_around(on: Array, k: int) -> bool:
    """Whether node k and its neighbours touched what they touch now in the solution before, too."""
    then, now = on[BEFORE], on[NOW]
    return bool(then[k - 1, 0] == now[k - 1, 0] and then[k, 0] == now[k, 0] and then[k + 1, 0] == now[k + 1, 0])


@kernel
def predict(
    q: Array, near: Array, on: Array, ends: Array, grips: Array, turns: Array, length: float, history: int
) -> float:
    """Fills the trial from the solution now, extrapolated if there is one before; quaternions' signs by continuity.

    A contact whose force has run out by then, and between the same neighbours, is left out. Returns `pace`.
    """
    last = grips.shape[1] - 1
    for j in range(last + 1):
        product = 0.0
        for i in range(3, 7):
            product += grips[NOW, j, i] * grips[TRIAL, j, i]
        if product < 0.0:
            for i in range(3, 7):
                grips[TRIAL, j, i] = -grips[TRIAL, j, i]
    old = qmul(qconj(take4(grips[NOW], 0)), take4(grips[NOW], last))
    new = qmul(qconj(take4(grips[TRIAL], 0)), take4(grips[TRIAL], last))
    turns[TRIAL] = turns[NOW]
    if (old[3] < 0.0) != (new[3] < 0.0):
        turns[TRIAL] += 1.0 if (new[2] > 0.0) == (old[3] >= 0.0) else -1.0
    a = pace(grips, length) if history > 1 else 0.0
    f = 1.0 + a
    for k in range(q.shape[1]):
        q[TRIAL, k, 0], q[TRIAL, k, 1], q[TRIAL, k, 2], q[TRIAL, k, 3] = qnormal((
            f * q[NOW, k, 0] - a * q[BEFORE, k, 0],
            f * q[NOW, k, 1] - a * q[BEFORE, k, 1],
            f * q[NOW, k, 2] - a * q[BEFORE, k, 2],
            f * q[NOW, k, 3] - a * q[BEFORE, k, 3],
        ))  # fmt: skip
        on[TRIAL, k, :] = on[NOW, k]
        near[TRIAL, k, :] = near[NOW, k]
        if on[NOW, k, 0] != BARE and same_around(on, k):
            near[TRIAL, k, PRESS] = f * near[NOW, k, PRESS] - a * near[BEFORE, k, PRESS]
            if near[TRIAL, k, PRESS] < 0.0:
                near[TRIAL, k, PRESS] = 0.0
                on[TRIAL, k, 0] = BARE
    for j in range(last):
        for i in range(3):
            ends[TRIAL, j, i] = f * ends[NOW, j, i] - a * ends[BEFORE, j, i]
    return a


@kernel
def run_through(
    slid: Array, mesh: Array, elements: int, held: Array, grips: Array, rings: Array, knots: Array, acts: Array,
    stops: Array, table: Array, way: Array, a: float,
) -> None:  # fmt: skip
    """Lets the cable run on through its eyelets by `a` times its last step."""
    s, h, load, rest, _ = mesh_parts(mesh, elements)
    for c in range(rings.shape[0]):
        way[c] = a * (slid[NOW, rings[c]] - slid[BEFORE, rings[c]])
    respace(s, knots, held, rings, way, farthest_way(s, grips, held, knots, rings, 0, False, way))
    load_elements(s, acts, stops, table, h, load, rest)


@kernel
def turned(p: Array, q: Array) -> float:
    """Largest angle between the frames p and q (N+1, 4) of a node [rad]."""
    largest = 0.0
    for k in range(q.shape[0]):
        miss = qmul(qconj(get4(p, k)), get4(q, k))
        largest = max(largest, miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
    return 2.0 * math.asin(min(1.0, math.sqrt(largest)))


@kernel
def solve(
    par: Array, mesh: Array, elements: int, q: Array, near: Array, on: Array, ends: Array, grips: Array, turns: Array,
    held: Array, held_mask: Array, forces: int, where: Array, mask: Array, place: Array, lam: Array, base: Array,
    bodies: Array, frames: Array, triangles: Array, nodes: Array, radius: float, sunk: float, stack: Array,
    acts: Array, stops: Array, table: Array, slid: Array, rings: Array, knots: Array,
    slides: tuple[Array, Array, Array, Array, Array], work: Array, out: Array, info: Array, points: int, history: int,
    most: int, far: float, drag: float, mesh_then: Array, before: Array, frames_then: Array, links: Array,
    horizon: float, measured: Array, counts: Array, deepest: float, fine: float,
) -> int:  # fmt: skip
    """Solves for the held supports in the trial of `grips`, to an equilibrium in the trial: CONVERGED or UNSETTLED.

    Else STALLED, NOT_FINITE, BROKEN or FAR. history: so many solutions, 1 or 2, to start from. far [rad]: largest turn
    of a frame from its prediction that is accepted. drag and acts to slides: see `press`; stops: where masses are [m].
    mesh_then takes the mesh, which contacts that
    run change and a failure puts back. UNSETTLED is what a `look_over` with the last arguments says; if it finds
    nothing, the trial has become the solution now.
    """
    s, h, _, rest, errors = mesh_parts(mesh, elements)
    stiff = par[0:6]
    mesh_then[:] = mesh
    a = predict(q, near, on, ends, grips, turns, par[13], history)
    if a != 0.0 and rings.shape[0] > 0:
        run_through(slid, mesh, elements, held, grips[TRIAL], rings, knots, acts, stops, table, slides[4], a)
    turn_supports(q[TRIAL], s, grips[TRIAL], held, held_mask)
    first, full, _, _, _, start = vectors(work, elements)
    if forces < held.shape[0] - 1:
        put3(ends[TRIAL], forces, 0, NONE)
    start[:, :] = q[TRIAL]
    age = info[AGE] + turned(q[NOW], q[TRIAL])
    serves = history > 1 and drag == 0.0 and info[2] == 0.0 and info[COUPLED] == 0.0 and age < OLDEST
    factored = int(info[3]) if serves else 0
    info[:] = 0.0
    info[AGE] = math.inf
    status = press(
        q[TRIAL], ends[TRIAL], near[TRIAL], on[TRIAL], par, mesh, elements, held, held_mask, grips[TRIAL], forces,
        where, mask, place, lam, base, bodies, frames, triangles, nodes, radius, sunk, stack, acts, stops,
        table, rings, knots, slides, True, most, drag, factored, work, info,
    )  # fmt: skip
    if status != CONVERGED:
        mesh[:] = mesh_then
        return status
    info[12] = turned(start, q[TRIAL])
    if not info[12] <= far:
        mesh[:] = mesh_then
        return FAR
    spans = int(info[3])
    unknown = spans if forces == held.shape[0] - 1 else spans - 1
    slid[TRIAL] = s[held]
    at = rings.copy()
    eyelets_at(base, spans, rings, at)
    through = (s, knots, at, lam, slides)
    info[7] = position_error(
        q[TRIAL], h, rest, stiff, where[: spans + 1], mask, place, base, unknown, through, near[TRIAL], work, errors
    )  # fmt: skip
    info[16] = contact_error(
        q[TRIAL], near[TRIAL], on[TRIAL], h, where[: spans + 1], mask, place, base, unknown, through,
        ROUND / par[13], 2.0 / (par[0] + par[1]), work,
    )  # fmt: skip
    for k in range(elements):
        cosine = abs(qmul(qconj(get4(q[TRIAL], k)), get4(q[TRIAL], k + 1))[3])
        info[13] = max(info[13], 2.0 * math.acos(min(1.0, cosine)))
    moments = np.empty((elements, 6))
    for e in range(elements):
        for i in range(3):
            moments[e, i], moments[e, 3 + i] = -first[e, 3 + i], first[e, 6 + i]
    sums = np.empty(5)
    sample(
        q[TRIAL], np.zeros(3), moments, s, h, full, rest, stiff, grips[TRIAL, 0], par[9:12], first, points, out, sums
    )  # fmt: skip
    info[8], info[9], info[10], info[5] = info[6] + sums[4], sums[1], sums[2], sums[3]
    info[7] = SAFETY * (info[7] + info[10]) + AMISS * info[16]
    if not all_finite(out) or not all_finite(info[0:5]) or not all_finite(info[8:14]):
        mesh[:] = mesh_then
        return BROKEN
    if drag == 0.0:
        info[AGE] = 0.0 if info[4] > 0.0 else (age if info[0] <= QUICK else math.inf)
    if look_over(
        q[TRIAL], near[TRIAL], on[TRIAL], h, 0.5 * (par[0] + par[1]), out, points, info, bodies, frames, triangles,
        nodes, radius, sunk, stack, before, frames_then, links, horizon, measured, counts, deepest, fine,
    ):  # fmt: skip
        return UNSETTLED
    accept(q, near, on, ends, grips, turns, slid, False)
    return CONVERGED


@kernel
def look_over(
    q: Array, near: Array, on: Array, h: Array, bend: float, out: Array, points: int, info: Array, bodies: Array,
    frames: Array, triangles: Array, nodes: Array, radius: float, sunk: float, stack: Array, before: Array,
    frames_then: Array, links: Array, horizon: float, measured: Array, counts: Array, deepest: float, fine: float,
) -> bool:  # fmt: skip
    """Whether anything is left to be done about a solution.

    That is the cable deeper in a body than `deepest` [m], see `closest_points` for its arguments up to `counts`; a
    body that it may have passed since it was at `before` (n, 3; n = 0: anywhere) and the bodies in `frames_then`;
    contacts whose part of the error [m] is above `fine` (infinite: may be), or AMISS times that in all; contacts that
    were stopped while they ran, or that have come up to a node. A negative `deepest`: who calls will see.
    """
    if deepest < 0.0:
        return True
    if fine < math.inf and (info[0] > RUNNING or info[16] > fine or info[7] > AMISS * fine):
        return True
    s, positions = out[:points], out[points : 4 * points].reshape(points, 3)
    closest_points(
        positions, s, radius, horizon, GRIP_EXCLUSION, True, bodies, links, triangles, nodes, measured, counts
    )
    for m in range(measured.shape[0]):
        if measured[m, 0] + sunk < -deepest:
            return True
    if before.shape[0] > 0 and passes(
        s, before, positions, bodies, frames, frames_then, triangles, nodes, radius, stack
    ):  # fmt: skip
        return True
    return bool(any_crowded(near, on, q, h, 1.0 / bend))


@kernel
def accept(q: Array, near: Array, on: Array, ends: Array, grips: Array, turns: Array, slid: Array, again: bool) -> None:
    """Makes the trial the solution now, and what was now the one before; `again`: it is the same one, solved again."""
    if not again:
        q[BEFORE], near[BEFORE], on[BEFORE] = q[NOW], near[NOW], on[NOW]
        ends[BEFORE], grips[BEFORE], turns[BEFORE] = ends[NOW], grips[NOW], turns[NOW]
        slid[BEFORE] = slid[NOW]
    q[NOW], near[NOW], on[NOW] = q[TRIAL], near[TRIAL], on[TRIAL]
    ends[NOW], grips[NOW], turns[NOW] = ends[TRIAL], grips[TRIAL], turns[TRIAL]
    slid[NOW] = slid[TRIAL]


@kernel
def refresh(
    par: Array, mesh: Array, elements: int, q: Array, lam: Array, where: Array, mask: Array, place: Array, base: Array,
    forces: int, work: Array,
) -> None:  # fmt: skip
    """Assembles and factors the Newton matrix of a solution with its contacts; forces: how many of lam are unknown."""
    _, h, load, rest, _ = mesh_parts(mesh, elements)
    spans = where.shape[0] - 1
    D, U, parts, P, Y, W = matrices(work, elements)
    first, full, _, G, _, _ = vectors(work, elements)
    joints, sums, _, _ = joints_of(work, elements, spans)
    fold(load, lam, where, full)
    assemble(q, full, h, rest, par[0:6], par[6:9], where, mask, D, U, G, parts, first, sums)
    couple(place, where, base, spans, D)
    factor(D, U, parts, sums, where, mask, place, forces, 1e-2 * par[12], h, P, Y, W, joints)
