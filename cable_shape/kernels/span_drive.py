"""One solve of a cable in spans, warm or from a guess, in one compiled call: predict, Newton, correct, sample.

    par   (14,)  stiffness 3, compliance 3, dead end moment 3, weight [N/m] 3, base shift, length
    info  (18,)  see ITERATIONS and the rest

and the arrays of `span_work`, `span_factor` and `span_slide`.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.drive import STRAIGHT
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get3,
    get4,
    put3,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    scale,
    subtract,
)
from cable_shape.kernels.rod_guess import angle_axis, tangent
from cable_shape.kernels.rod_output import all_finite, sample
from cable_shape.kernels.span_defect import correct, support_loads
from cable_shape.kernels.span_newton import CONVERGED, newton
from cable_shape.kernels.span_slide import farthest_way, load_elements, respace
from cable_shape.kernels.span_system import NONE, fold
from cable_shape.kernels.span_work import BEFORE, NOW, TRIAL, mesh_parts, slot, vectors

BROKEN = 3  # a number in the output is not finite
FAR = 4  # an equilibrium further from the prediction than asked for
TAUT = 5  # a span that cannot stretch is shorter than its chord, or as long
PAR, INFO = 14, 18
ITERATIONS, ESTIMATE, TURNED, TURN = 0, 7, 12, 13  # in info
# The estimate's factors, as in `network.drive`, set in the same way on random scenes with clips.
LEFT, INTERPOLATED = 21.0, 0.7


@kernel
def pace(sol: Array, elements: int, spans: int, length: float) -> float:
    """How far the supports have moved on from the solution now, as a fraction 0 to 2 of the step before."""
    now = slot(sol, elements, spans, NOW)[2]
    before = slot(sol, elements, spans, BEFORE)[2]
    trial = slot(sol, elements, spans, TRIAL)[2]
    up = down = 0.0
    for j in range(spans + 1):
        for i in range(7):
            f = 1.0 / (length * length) if i < 3 else 1.0
            old = now[j, i] - before[j, i]
            up += f * old * (trial[j, i] - now[j, i])
            down += f * old * old
    return min(max(up / down, 0.0), 2.0) if down > 1e-16 else 0.0


@kernel
def follow(sol: Array, elements: int, spans: int, roll: int) -> None:
    """Chooses the signs of the trial's support quaternions by continuity, and counts the turns of the end.

    A turn is counted where the scalar part of the end's rotation against support `roll`, the last that holds the
    cable's roll before it, changes its sign.
    """
    frames, turns = slot(sol, elements, spans, TRIAL)[2], slot(sol, elements, spans, TRIAL)[4]
    old, old_turns = slot(sol, elements, spans, NOW)[2], slot(sol, elements, spans, NOW)[4]
    for j in range(spans + 1):
        product = 0.0
        for i in range(3, 7):
            product += old[j, i] * frames[j, i]
        if product < 0.0:
            for i in range(3, 7):
                frames[j, i] = -frames[j, i]
    a = qmul(qconj(take4(old, roll)), take4(old, spans))
    b = qmul(qconj(take4(frames, roll)), take4(frames, spans))
    turns[0] = old_turns[0]
    if (a[3] < 0.0) != (b[3] < 0.0):
        # a roll angle grows through pi where the roll part of the quaternion has the sign of its old scalar part
        turns[0] += 1.0 if (b[2] > 0.0) == (a[3] >= 0.0) else -1.0


@kernel(forceinline=True)
def take4(frames: Array, j: int) -> tuple[float, float, float, float]:
    """The quaternion of a frame."""
    return (frames[j, 3], frames[j, 4], frames[j, 5], frames[j, 6])


@kernel
def extrapolate(sol: Array, elements: int, spans: int, place: Array, a: float) -> None:
    """Fills the trial's rotations, forces and unknown places: the solution now plus `a` times the last step."""
    q, lam, frames, _, _ = slot(sol, elements, spans, TRIAL)
    q1, lam1, frames1, _, _ = slot(sol, elements, spans, NOW)
    q0, lam0, frames0, _, _ = slot(sol, elements, spans, BEFORE)
    f = 1.0 + a
    for k in range(elements + 1):
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal((
            f * q1[k, 0] - a * q0[k, 0],
            f * q1[k, 1] - a * q0[k, 1],
            f * q1[k, 2] - a * q0[k, 2],
            f * q1[k, 3] - a * q0[k, 3],
        ))  # fmt: skip
    for j in range(spans):
        for i in range(3):
            lam[j, i] = f * lam1[j, i] - a * lam0[j, i]
            if place[j, 0] > 0.0:
                frames[j, i] = f * frames1[j, i] - a * frames0[j, i]


@kernel
def turn_supports(q: Array, s: Array, frames: Array, where: Array, mask: Array) -> None:
    """Turns the rotations so that those held at supports are met, the turn changing linearly between such supports."""
    left = -1
    turn = (0.0, 0.0, 0.0)
    for j in range(where.shape[0]):
        if mask[j, 0] != 0.0 and j + 1 < where.shape[0]:
            continue
        node = where[j]
        new = turn
        if mask[j, 0] == 0.0:
            target = take4(frames, j)
            if mask[j, 2] == 0.0:
                miss = qmul(target, qconj(get4(q, node)))
                new = qlog((-miss[0], -miss[1], -miss[2], -miss[3]) if miss[3] < 0.0 else miss)
            else:
                angle, axis = angle_axis(tangent(get4(q, node)), tangent(target))
                new = scale(angle, axis)
        first = where[left] if left >= 0 else 0
        for k in range(first + 1 if left >= 0 else 0, node + 1):
            x = (s[k] - s[first]) / (s[node] - s[first]) if left >= 0 else 1.0
            p = qnormal(qmul(qexp(add(scale(1.0 - x, turn), scale(x, new))), get4(q, k)))
            q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
        if mask[j, 0] == 0.0 and mask[j, 2] == 0.0:
            sign = 1.0 if qmul(qconj(get4(q, node)), take4(frames, j))[3] > 0.0 else -1.0
            for i in range(4):
                q[node, i] = sign * frames[j, 3 + i]
        left, turn = j, new


@kernel
def predict(
    sol: Array, elements: int, mesh: tuple[Array, Array, Array, Array], par: Array, where: Array, mask: Array,
    place: Array, forces: int, roll: int, knots: Array, rings: Array, acts: Array, points: Array, table: Array,
    way: Array, history: int,
) -> None:  # fmt: skip
    """Fills the trial from the last one or two solutions; the cable runs on through the eyelets `rings`."""
    s, h, load, rest = mesh
    spans = where.shape[0] - 1
    q, _, frames, _, _ = slot(sol, elements, spans, TRIAL)
    follow(sol, elements, spans, roll)
    a = pace(sol, elements, spans, par[13]) if history > 1 else 0.0
    extrapolate(sol, elements, spans, place, a)
    if rings.shape[0] > 0 and a != 0.0:
        now, before = slot(sol, elements, spans, NOW)[3], slot(sol, elements, spans, BEFORE)[3]
        for c in range(rings.shape[0]):
            way[c] = a * (now[rings[c]] - before[rings[c]])
        respace(s, knots, where, rings, way, farthest_way(s, frames, where, knots, rings, forces, par[5] == 0.0, way))
        load_elements(s, acts, points, table, h, load, rest)
    turn_supports(q, s, frames, where, mask)


@kernel
def any_taut(frames: Array, s: Array, where: Array, forces: int) -> bool:
    """Whether the chord of a span is as long as the span."""
    for j in range(forces):
        chord = subtract(get3(frames, j + 1), get3(frames, j))
        length = STRAIGHT * (s[where[j + 1]] - s[where[j]])
        if dot(chord, chord) >= length * length:
            return True
    return False


@kernel
def give_back(
    mesh: tuple[Array, Array, Array, Array], before: Array, acts: Array, points: Array, table: Array, status: int
) -> int:
    """Puts nodes that ran along the cable back to where they were; returns `status`."""
    s, h, load, rest = mesh
    moved = False
    for i in range(s.shape[0]):
        moved = moved or s[i] != before[i]
    if moved:
        s[:] = before
        load_elements(s, acts, points, table, h, load, rest)
    return status


@kernel
def solve(
    par: Array, mesh: Array, sol: Array, work: Array, out: Array, info: Array, where: Array, mask: Array, place: Array,
    knots: Array, rings: Array, acts: Array, stops: Array, table: Array, elements: int, forces: int, roll: int,
    points: int, history: int, again: bool, sliding: bool, guard: bool, most: int, far: float, loads: Array,
) -> int:  # fmt: skip
    """Solves for the supports in the trial slot of `sol`; returns CONVERGED, STALLED, NOT_FINITE, BROKEN, FAR or TAUT.

    history: 0 the trial's rotations are a guess; 1 or 2 start from so many solutions. sliding: the cable runs through
    the eyelets `rings`, and the mesh with it; else they hold it. far [rad]: largest turn of a frame from its prediction
    that is accepted. After CONVERGED the trial has become the solution now; the one now has become the one before,
    unless the trial solves for the same ends `again`. `points` 0: no output. loads: see `support_loads`.
    """
    spans = where.shape[0] - 1
    s, h, load, rest, errors = mesh_parts(mesh, elements)
    nodes = (s, h, load, rest)
    q, lam, frames, arcs, _ = slot(sol, elements, spans, TRIAL)
    stiff = par[0:6]
    moving = rings if sliding else rings[:0]
    k = moving.shape[0]
    slides = (
        np.empty((k * (elements + 1), 3)), np.empty((k * spans, 6)), np.empty((k * elements, 9)), np.empty((k, k)),
        np.zeros(k),
    )  # fmt: skip
    if k == 0 and par[5] == 0.0 and any_taut(frames, s, where, forces):
        return TAUT
    before = s.copy()
    if history > 0:
        predict(
            sol, elements, nodes, par, where, mask, place, forces, roll, knots, moving, acts, stops, table, slides[4],
            history,
        )  # fmt: skip
    if forces < spans:
        put3(lam, forces, 0, NONE)
    first, full, _, _, _, start = vectors(work, elements)
    start[:, :] = q
    info[:] = 0.0
    status = newton(
        q, lam, frames, nodes, par, where, mask, place, forces, knots, moving, acts, stops, table, slides, guard, most,
        work, info,
    )  # fmt: skip
    if status == CONVERGED:
        largest = 0.0
        for i in range(elements + 1):
            miss = qmul(qconj(get4(start, i)), get4(q, i))
            largest = max(largest, miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
        info[12] = 2.0 * math.asin(min(1.0, math.sqrt(largest)))
        if not info[12] <= far:
            status = FAR
    if status != CONVERGED:
        return give_back(nodes, before, acts, stops, table, status)
    moments, pulled = np.empty((elements, 6)), np.empty((spans, 3))
    off, left = correct(
        q, lam, frames, h, rest, stiff, where, mask, place, forces, moving, slides, work, errors, moments, start, pulled
    )  # fmt: skip
    info[7], info[15], info[16] = LEFT * left + 2.0 * info[14] * off, off, left
    info[17] = slot(sol, elements, spans, TRIAL)[4][0]
    cosine = 1.0
    for i in range(elements):
        cosine = min(cosine, abs(qmul(qconj(get4(q, i)), get4(q, i + 1))[3]))
    info[13] = 2.0 * math.acos(cosine)
    for i in range(k):
        arcs[moving[i]] = s[where[moving[i]]]
    if points > 0:
        totals = np.empty(5)
        if k > 0:  # the mesh stays that of the solution that is corrected
            s, h, load, rest = s.copy(), h.copy(), load.copy(), rest.copy()
            respace(s, knots, where, moving, slides[4], 1.0)
            load_elements(s, acts, stops, table, h, load, rest)
        fold(load, pulled, where, full)
        sample(start, np.zeros(3), moments, s, h, full, rest, stiff, frames[0], par[9:12], first, points, out, totals)
        support_loads(start, pulled, moments, s, where, loads)
        info[8:12] = totals[:4]
        info[7] += INTERPOLATED * info[10]
        if forces == spans:  # met to the closure's rounding, and exactly where the grip is
            for i in range(3):
                out[4 * points - 3 + i] = frames[spans, i]
        if not all_finite(info):
            return give_back(nodes, before, acts, stops, table, BROKEN)
    size = sol.shape[0] // 3
    if not again:
        sol[size : 2 * size] = sol[0:size]
    sol[0:size] = sol[2 * size : 3 * size]
    return CONVERGED
