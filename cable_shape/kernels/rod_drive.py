"""One solve, warm or from a guess, in one compiled call: predict, Newton, judge, sample.

Flat arrays, with N elements and nodes N + 1:

    par   (21,)      stiffness 3, compliance 3, dead end moment 3, mask 6, weight [N/m] 3, base shift, length, turn
                     [rad] of frames that needs no motion of the ends, infinite where loads may have changed
    mesh  (21 N + 1) s N+1 | h N | load 9N | rest 6N | scratch 3N | error indicator N
    sol   3 x (4 nodes + 18): now, before, trial; each q 4 nodes | lambda 3 | start 7 | end 7 | turns
    info  (18,)      0 iterations, 1 last step [rad], 2 excess of negative eigenvalues, 3 shift, 4 assemblies,
                     5 kicks off a saddle, 6 value, 7 estimate [m], 8 energy without masses [J], 9 twist [rad],
                     10 error of the interpolation [m], 11 residual,
                     12 turning of the solution against its prediction [rad], 13 largest rotation of an element [rad],
                     14 share of an error that the factors, being old, leave, 15 error that was taken off [m],
                     16 what that leaves [m], 17 turns
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get4,
    inlined,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    scale,
    subtract,
)
from cable_shape.kernels.rod_defect import correct
from cable_shape.kernels.rod_guess import (
    angle_axis,
    bezier_tangents,
    carry_frames,
    hanging_force,
    hanging_tangents,
    natural_frames,
    norm,
    perpendicular,
    tangent,
)
from cable_shape.kernels.rod_mesh import element_loads, element_rest, equidistribute
from cable_shape.kernels.rod_newton import CONVERGED, newton
from cable_shape.kernels.rod_output import all_finite, sample
from cable_shape.kernels.rod_work import vectors

Array = Any
NOW, BEFORE, TRIAL = 0, 1, 2
BROKEN = 3  # a number in the output is not finite
FAR = 4  # an equilibrium further from the prediction than asked for
TOO_FAR = 5  # the ends are as far apart as an inextensible cable is long, or further
STRAIGHT = 1.0 - 1e-9  # chord / length from which it is
PAR, INFO = 21, 18
ITERATIONS, EXCESS, RESIDUAL, ESTIMATE, ENERGY, TWIST, TURNED, TURN, TURNS = 0, 2, 11, 7, 8, 9, 12, 13, 17  # in info
LARGEST_TURN = 0.7  # rad, of an element: coarser ones misjudge stability
TURN_OF_MOTION = 12.0  # largest turn of a frame from its prediction [rad] by motion of the ends [lengths, rad]
# The estimated error is so many times what the correction leaves and what the interpolation misses: both are judged by
# their leading term. Set so that on random grasps it is above the true error in 99 of 100 at any tolerance.
LEFT, INTERPOLATED = 14.0, 0.45


@kernel
def mesh_size(elements: int) -> int:
    """Numbers in `mesh`."""
    return 21 * elements + 1


@kernel
def slot_size(elements: int) -> int:
    """Numbers in one of the three parts of `sol`."""
    return 4 * (elements + 1) + 18


@inlined
def slot(sol: Array, elements: int, which: int) -> tuple[Array, Array, Array]:
    """q, lambda, and ends with turns (15,) of one part of `sol`."""
    nodes = elements + 1
    a = which * (4 * nodes + 18)
    b = a + 4 * nodes
    return sol[a:b].reshape(nodes, 4), sol[b : b + 3], sol[b + 3 : b + 18]


@inlined
def mesh_parts(mesh: Array, elements: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """s, h, load, rest, slack, errors."""
    n = elements
    return (
        mesh[: n + 1],
        mesh[n + 1 : 2 * n + 1],
        mesh[2 * n + 1 : 11 * n + 1].reshape(n, 9),
        mesh[11 * n + 1 : 17 * n + 1].reshape(n, 6),
        mesh[17 * n + 1 : 20 * n + 1].reshape(n, 3),
        mesh[20 * n + 1 : 21 * n + 1],
    )


@kernel
def wind(before: Array, ends: Array) -> None:
    """Chooses the signs of the quaternions and the turns of `ends` (15,) by continuity with those of `before`.

    The relative quaternion conj(start) end moves continuously; where its scalar part changes sign a turn is counted,
    in the direction in which the end rolls.
    """
    if before[3] * ends[3] + before[4] * ends[4] + before[5] * ends[5] + before[6] * ends[6] < 0.0:
        for i in range(3, 7):
            ends[i] = -ends[i]
    a = qmul(qconj((before[3], before[4], before[5], before[6])), (before[10], before[11], before[12], before[13]))
    b = qmul(qconj((ends[3], ends[4], ends[5], ends[6])), (ends[10], ends[11], ends[12], ends[13]))
    if a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0.0:
        for i in range(10, 14):
            ends[i] = -ends[i]
        b = (-b[0], -b[1], -b[2], -b[3])
    turns = before[14]
    if (a[3] < 0.0) != (b[3] < 0.0):
        # a roll angle grows through pi where the roll part of the quaternion has the sign of its old scalar part
        forward = (b[2] > 0.0) == (a[3] >= 0.0)
        turns += 1.0 if forward else -1.0
    ends[14] = turns


@kernel
def turn_ends(q: Array, s: Array, ends: Array, mask: Array) -> None:
    """Turns the frames so that held rotations at the ends are met, the turn changing linearly along the cable."""
    last = q.shape[0] - 1
    length = s[last]
    turn0 = turn1 = (0.0, 0.0, 0.0)
    for end in range(2):
        k = 0 if end == 0 else last
        o = 3 if end == 0 else 10
        target = (ends[o], ends[o + 1], ends[o + 2], ends[o + 3])
        a = (0.0, 0.0, 0.0)
        if mask[end, 0] == 0.0:
            if mask[end, 2] == 0.0:
                miss = qmul(target, qconj(get4(q, k)))
                if end == 0 and miss[3] < 0.0:
                    miss = (-miss[0], -miss[1], -miss[2], -miss[3])
                a = qlog(miss)
            else:
                angle, axis = angle_axis(tangent(get4(q, k)), tangent(target))
                a = scale(angle, axis)
        if end == 0:
            turn0 = a
        else:
            turn1 = a
    if mask[0, 0] != 0.0:
        turn0 = turn1
    if mask[1, 0] != 0.0:
        turn1 = turn0
    for k in range(last + 1):
        x = s[k] / length
        p = qnormal(qmul(qexp(add(scale(1.0 - x, turn0), scale(x, turn1))), get4(q, k)))
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = p
    if mask[0, 2] == 0.0:
        q[0, 0], q[0, 1], q[0, 2], q[0, 3] = ends[3], ends[4], ends[5], ends[6]
    if mask[1, 2] == 0.0:
        # the sign of the last node follows the chain of frames
        q[last, 0], q[last, 1], q[last, 2], q[last, 3] = ends[10], ends[11], ends[12], ends[13]


@kernel
def extrapolate(sol: Array, elements: int, history: int, length: float) -> None:
    """Fills q and lambda of the trial from the last one or two solutions, along the motion of the ends."""
    q, lam, ends = slot(sol, elements, TRIAL)
    q1, lam1, ends1 = slot(sol, elements, NOW)
    q0, lam0, ends0 = slot(sol, elements, BEFORE)
    a = 0.0
    if history > 1:
        up = down = 0.0
        for i in range(14):
            f = 1.0 / (length * length) if i % 7 < 3 else 1.0
            old = ends1[i] - ends0[i]
            up += f * old * (ends[i] - ends1[i])
            down += f * old * old
        if down > 1e-16:
            a = min(max(up / down, 0.0), 2.0)
    for k in range(elements + 1):
        f = 1.0 + a
        p = (
            f * q1[k, 0] - a * q0[k, 0],
            f * q1[k, 1] - a * q0[k, 1],
            f * q1[k, 2] - a * q0[k, 2],
            f * q1[k, 3] - a * q0[k, 3],
        )
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(p)
    for i in range(3):
        lam[i] = (1.0 + a) * lam1[i] - a * lam0[i]


@inlined
def prediction(work: Array, elements: int) -> Array:
    """(N+1, 4), in `work`: the frames that a solve starts from."""
    return work[-4 * (elements + 1) :].reshape(elements + 1, 4)


@kernel
def reach(far: float, par: Array, before: Array, ends: Array) -> float:
    """`far`, or less: how far [rad] a frame may turn from its prediction while the ends move from `before` to `ends`.

    A cable that snaps turns its frames by a jump however little its ends move.
    """
    way = turn0 = turn1 = 0.0
    for i in range(3):
        way += (ends[7 + i] - ends[i] - before[7 + i] + before[i]) ** 2
    for i in range(3, 7):
        turn0 += (ends[i] - before[i]) ** 2
        turn1 += (ends[7 + i] - before[7 + i]) ** 2
    motion = math.sqrt(way) / par[19] + 2.0 * (math.sqrt(turn0) + math.sqrt(turn1))
    return min(far, par[20] + TURN_OF_MOTION * motion)


@kernel
def solve(
    par: Array, mesh: Array, sol: Array, work: Array, out: Array, info: Array, elements: int, width: int, points: int,
    history: int, guard: bool, most: int, far: float,
) -> int:  # fmt: skip
    """Solves for the ends in the trial part of `sol`; returns CONVERGED, STALLED, NOT_FINITE, BROKEN, FAR or TOO_FAR.

    history: 0 the trial's frames are a guess; 1 or 2 start from so many solutions. far [rad]: largest turn of a frame
    from its prediction that is accepted, less where the ends move little, see `reach`. After CONVERGED the trial has
    become the solution now, the one now the one before. `points` 0: no output.
    """
    s, h, load, rest, _, _ = mesh_parts(mesh, elements)
    q, lam, ends = slot(sol, elements, TRIAL)
    stiff, moment, mask = par[0:6], par[6:9], par[9:15].reshape(2, 3)
    span = ends[7:10] - ends[0:3]
    if width > 1 and par[5] == 0.0 and span[0] ** 2 + span[1] ** 2 + span[2] ** 2 >= (STRAIGHT * par[19]) ** 2:
        return TOO_FAR
    if history > 0:
        _, _, ends1 = slot(sol, elements, NOW)
        wind(ends1, ends)
        extrapolate(sol, elements, history, par[19])
        turn_ends(q, s, ends, mask)
        far = reach(far, par, ends1, ends)
    if width == 1:
        lam[0] = lam[1] = lam[2] = 0.0
    prediction(work, elements)[:, :] = q
    info[:] = 0.0
    status = newton(q, lam, s, h, load, rest, stiff, moment, mask, span, par[18], guard, most, work, width, info)
    if status != CONVERGED:
        return status
    return finish(par, mesh, sol, work, out, info, elements, width, points, far)


@kernel
def finish(
    par: Array, mesh: Array, sol: Array, work: Array, out: Array, info: Array, elements: int, width: int, points: int,
    far: float,
) -> int:  # fmt: skip
    """Judges and samples the equilibrium that Newton's method has left in the trial part of `sol`; returns as `solve`.

    work: with its factors, its gradient and the `prediction`, which is overwritten.
    """
    s, h, load, rest, slack, errors = mesh_parts(mesh, elements)
    q, lam, ends = slot(sol, elements, TRIAL)
    stiff, mask, weight = par[0:6], par[9:15].reshape(2, 3), par[15:18]
    start = prediction(work, elements)
    largest = 0.0
    for k in range(elements + 1):
        miss = qmul(qconj(get4(start, k)), get4(q, k))
        largest = max(largest, miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2])
    info[12] = 2.0 * math.asin(min(1.0, math.sqrt(largest)))
    if not info[12] <= far:
        return FAR
    moments = np.empty((elements, 6))
    off, left = correct(q, lam, h, load, rest, stiff, mask, work, width, slack, errors, moments, start)
    info[7], info[15], info[16], info[17] = LEFT * left + 2.0 * info[14] * off, off, left, ends[14]
    cosine = 1.0
    for k in range(elements):
        cosine = min(cosine, abs(qmul(qconj(get4(q, k)), get4(q, k + 1))[3]))
    info[13] = 2.0 * math.acos(cosine)
    if points > 0:
        _, first, _, _, _, total, _ = vectors(work, elements, width)
        totals = np.empty(5)
        sample(start, total[:3], moments, s, h, load, rest, stiff, ends[0:3], weight, first, points, out, totals)
        info[8:12] = totals[:4]
        info[7] += INTERPOLATED * info[10]
        if width > 1:  # met to the closure's rounding, and exactly where the grip is
            for i in range(3):
                out[4 * points - 3 + i] = ends[7 + i]
        if not all_finite(info):
            return BROKEN
    size = sol.shape[0] // 3
    sol[size : 2 * size] = sol[0:size]
    sol[0:size] = sol[2 * size : 3 * size]
    return CONVERGED


@kernel
def hang(par: Array, ends: Array, load: Array, force: Array) -> float:
    """Force at the end of a hanging cable into force (3,); returns its boundary layer, see `hanging_force`."""
    held = np.empty(2)
    held[0], held[1] = 1.0 - par[9], 1.0 - par[12]
    t0 = tangent((ends[3], ends[4], ends[5], ends[6]))
    t1 = tangent((ends[10], ends[11], ends[12], ends[13]))
    bend = 0.5 * (par[0] + par[1])
    return hanging_force(ends[7:10] - ends[0:3], load, par[19], par[5], bend, t0, t1, held, force)


@kernel
def guess(
    par: Array, mesh: Array, sol: Array, elements: int, span: Array, load: Array, force: Array, kind: int, sag: float
) -> None:  # fmt: skip
    """Fills q and lambda of the trial, whose ends are given. kind: 0 hanging, 1 Bezier, 2 natural shape.

    load (3,): mean distributed load [N/m]; force (3,): from `hanging_force`; sag: tilt of the Bezier curve's handles.
    """
    s, h, _, rest, _, _ = mesh_parts(mesh, elements)
    q, lam, ends = slot(sol, elements, TRIAL)
    mask = par[9:15].reshape(2, 3)
    bend = 0.5 * (par[0] + par[1])
    for i in range(4):
        q[0, i], q[elements, i] = ends[3 + i], ends[10 + i]
    if kind == 2:
        natural_frames(h, rest, q)
        return
    t = np.empty((elements + 1, 3))
    held = np.empty(2)
    held[0], held[1] = 1.0 - mask[0, 0], 1.0 - mask[1, 0]
    t0, t1 = tangent(get4(q, 0)), tangent(get4(q, elements))
    f = (load[0], load[1], load[2])
    for i in range(3):
        lam[i] = force[i]
    if kind == 0:
        hanging_tangents(s, load, force, bend, t0, t1, held, t)
    else:
        c = (span[0], span[1], span[2])
        chord = norm(c)
        along = scale(1.0 / chord, c) if chord > 0.0 else perpendicular(t0)
        if held[0] == 0.0:
            t0 = along
        if held[1] == 0.0:
            t1 = along
        down = subtract(f, scale(dot(f, along), along))
        size = norm(down)
        down = scale(1.0 / size, down) if size > 0.0 else perpendicular(along)
        bezier_tangents(s, span, t0, t1, scale(sag, down), t)
        for i in range(3):
            lam[i] = -0.5 * par[19] * f[i]
    carry_frames(s, t, mask, q)


@kernel
def lay_out(
    mesh: Array, elements: int, x: Array, density: Array, stops: Array, ends: Array, points: Array, weights: Array,
    tip: Array, table: Array,
) -> None:  # fmt: skip
    """Fills `mesh`: nodes of equal share of the density given at x, their loads and rest curvature."""
    s, h, load, rest, _, _ = mesh_parts(mesh, elements)
    equidistribute(x, density, stops, elements, s)
    element_loads(s, ends, points, weights, tip, h, load)
    element_rest(s, table, rest)


@kernel
def carry_over(s: Array, sol: Array, elements: int, s_new: Array, sol_new: Array, elements_new: int) -> None:
    """Copies `sol` to another mesh: frames are interpolated linearly."""
    for which in range(3):
        q, lam, ends = slot(sol, elements, which)
        p, lam_new, ends_new = slot(sol_new, elements_new, which)
        lam_new[:] = lam
        ends_new[:] = ends
        e = 0
        for k in range(elements_new + 1):
            while e < elements - 1 and s_new[k] > s[e + 1]:
                e += 1
            x = (s_new[k] - s[e]) / (s[e + 1] - s[e])
            sign = 1.0
            if q[e, 0] * q[e + 1, 0] + q[e, 1] * q[e + 1, 1] + q[e, 2] * q[e + 1, 2] + q[e, 3] * q[e + 1, 3] < 0.0:
                sign = -1.0
            a, b = 1.0 - x, sign * x
            size = 0.0
            for i in range(4):
                p[k, i] = a * q[e, i] + b * q[e + 1, i]
                size += p[k, i] ** 2
            if size > 0.0:
                for i in range(4):
                    p[k, i] /= math.sqrt(size)


@kernel
def steps(work: Array, elements: int, width: int) -> Array:
    """(N, 9): minus each element's step in position in the first three columns, see `rod_system`."""
    return vectors(work, elements, width)[1]
