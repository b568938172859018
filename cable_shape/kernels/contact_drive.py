"""One solve of a cable pressed on bodies, in one compiled call: predict, Newton, judge, sample.

Solutions are kept in three slots, of which NOW and BEFORE are solutions and TRIAL is solved for:

    q (3, N+1, 4) | near (3, N+1, 20) | on (3, N+1, 2) | ends (3, b, 3) | grips (3, b+1, 7) | turns (3,)
    par (14,) as in `span_drive`      info (18,) as in `contact_newton`, 5 and 7 to 13 as in `span_drive`, and
    16 the part of the error estimate that is the contacts' [m], 17 how far the node that slid furthest slid last [m]
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact_near import BARE, CURVED, NORMAL, PRESS, ROUND, along_cable, couple, tangent_of
from cable_shape.kernels.contact_newton import press
from cable_shape.kernels.rod_algebra import apply, dot, get4, get9, put3, qconj, qmul, qnormal
from cable_shape.kernels.rod_output import all_finite, sample
from cable_shape.kernels.span_drive import BROKEN, FAR, SAFETY, position_error, take4, turn_supports
from cable_shape.kernels.span_factor import factor, take3
from cable_shape.kernels.span_newton import CONVERGED
from cable_shape.kernels.span_system import NONE, assemble, fold
from cable_shape.kernels.span_work import BEFORE, NOW, TRIAL, joints_of, matrices, mesh_parts, vectors

Array = Any
INFO = 18
ENDS, LOOSE, STRAIGHT = 48.0, 4e-4, 1e-5


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
def predict(
    q: Array, near: Array, on: Array, ends: Array, grips: Array, turns: Array, length: float, history: int
) -> None:
    """Fills the trial from the solution now, extrapolated if there is one before; quaternions' signs by continuity."""
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
        if on[NOW, k, 0] != BARE and on[BEFORE, k, 0] == on[NOW, k, 0]:
            near[TRIAL, k, PRESS] = max(f * near[NOW, k, PRESS] - a * near[BEFORE, k, PRESS], 0.0)
    for j in range(last):
        for i in range(3):
            ends[TRIAL, j, i] = f * ends[NOW, j, i] - a * ends[BEFORE, j, i]


@kernel
def contact_error(q: Array, near: Array, on: Array, h: Array, bend: float, length: float) -> float:
    """Estimated error [m] from contacts at nodes: their forces act up to half an element from where they should.

    A contact that runs along the cable on a curved body is where it should be. Of others no closer estimate is known
    than LOOSE, which most stay far below and a few exceed, and where a row ends p h^3 / ENDS EI if that is larger.
    """
    worst = 0.0
    for k in range(1, h.shape[0]):
        if on[k, 0] == BARE:
            continue
        t = tangent_of(q, k)
        curved = dot(t, apply(get9(near, k, CURVED), t)) > 0.0
        if curved and along_cable(q, h, near, k, ROUND) > 0.0 and abs(dot(t, take3(near, k, NORMAL))) < STRAIGHT:
            continue
        worst = max(worst, LOOSE * length)
        if on[k - 1, 0] == BARE or on[k + 1, 0] == BARE:
            size = max(h[k - 1], h[k])
            worst = max(worst, min(abs(near[k, PRESS]) * size**3 / (ENDS * bend), size))
    return worst


@kernel
def solve(
    par: Array, mesh: Array, elements: int, q: Array, near: Array, on: Array, ends: Array, grips: Array, turns: Array,
    held: Array, held_mask: Array, forces: int, where: Array, mask: Array, place: Array, lam: Array, base: Array,
    bodies: Array, frames: Array, triangles: Array, nodes: Array, radius: float, sunk: float, stack: Array,
    ends_load: Array, table: Array, work: Array, out: Array, info: Array, points: int, history: int, guard: bool,
    most: int, far: float,
) -> int:  # fmt: skip
    """Solves for the held supports in the trial of `grips`; returns CONVERGED, STALLED, NOT_FINITE, BROKEN or FAR.

    history: 0 the trial is a guess; 1 or 2 start from so many solutions. far [rad]: largest turn of a frame from its
    prediction that is accepted. points 0: no output. After CONVERGED the trial is the solution now.
    """
    s, h, _, rest, errors = mesh_parts(mesh, elements)
    stiff = par[0:6]
    if history > 0:
        predict(q, near, on, ends, grips, turns, par[13], history)
        turn_supports(q[TRIAL], s, grips[TRIAL], held, held_mask)
    first, full, _, _, _, start = vectors(work, elements)
    if forces < held.shape[0] - 1:
        put3(ends[TRIAL], forces, 0, NONE)
    start[:, :] = q[TRIAL]
    info[:] = 0.0
    status = press(
        q[TRIAL], ends[TRIAL], near[TRIAL], on[TRIAL], par, mesh, elements, held, held_mask, grips[TRIAL], forces,
        where, mask, place, lam, base, bodies, frames, triangles, nodes, radius, sunk, stack, ends_load,
        table, guard, most, work, info,
    )  # fmt: skip
    if status != CONVERGED:
        return status
    largest = 0.0
    for k in range(elements + 1):
        miss = qmul(qconj(get4(start, k)), get4(q[TRIAL], k))
        largest = max(largest, miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
    info[12] = 2.0 * math.asin(min(1.0, math.sqrt(largest)))
    if not info[12] <= far:
        return FAR
    spans = int(info[3])
    unknown = spans if forces == held.shape[0] - 1 else spans - 1
    info[7] = position_error(
        q[TRIAL], h, rest, stiff, where[: spans + 1], mask, place, unknown, work, errors
    )  # fmt: skip
    info[16] = contact_error(q[TRIAL], near[TRIAL], on[TRIAL], h, 0.5 * (par[0] + par[1]), par[13])
    for k in range(elements):
        cosine = abs(qmul(qconj(get4(q[TRIAL], k)), get4(q[TRIAL], k + 1))[3])
        info[13] = max(info[13], 2.0 * math.acos(min(1.0, cosine)))
    if points > 0:
        moments = np.empty((elements, 6))
        for e in range(elements):
            for i in range(3):
                moments[e, i], moments[e, 3 + i] = -first[e, 3 + i], first[e, 6 + i]
        sums = np.empty(5)
        sample(
            q[TRIAL], np.zeros(3), moments, s, h, full, rest, stiff, grips[TRIAL, 0], par[9:12], first, points, out,
            sums,
        )  # fmt: skip
        info[8], info[9], info[10], info[5] = info[6] + sums[4], sums[1], sums[2], sums[3]
        info[7] = max(SAFETY * (info[7] + info[10]), info[16])
        if not all_finite(out) or not all_finite(info[0:5]) or not all_finite(info[8:14]):
            return BROKEN
    for which in range(2):
        to, source = (BEFORE, NOW) if which == 0 else (NOW, TRIAL)
        q[to], near[to], on[to], ends[to], grips[to] = q[source], near[source], on[source], ends[source], grips[source]
        turns[to] = turns[source]
    return CONVERGED


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
