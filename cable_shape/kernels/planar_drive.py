"""One solve of the rod in one compiled call: in its plane if it has one, else in space.

A clamped start, a clamped or free end, loads and rest curvature may leave the rod in a plane, whose normal is then one
of the frame's axes all along the cable. What is kept from solve to solve is that of the spatial solver, quaternions and
all, so that a motion comes into its plane and leaves it without ado. Whatever the planar solver cannot finish, or finds
unstable out of its plane, is the spatial solver's.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels import rod_drive
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.planar_across import COLUMNS, excess_across
from cable_shape.kernels.planar_defect import correct
from cable_shape.kernels.planar_element import Pair, half_turn, product, quotient, unit
from cable_shape.kernels.planar_loads import FLAT
from cable_shape.kernels.planar_newton import newton
from cable_shape.kernels.planar_output import sample
from cable_shape.kernels.planar_system import GL, NORMAL_X, NORMAL_Y, behind, layout
from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    cross,
    dot,
    get4,
    inlined,
    qmul,
    rotation,
    scale,
    subtract,
    tapply,
)
from cable_shape.kernels.rod_drive import (
    BEFORE,
    FAR,
    INTERPOLATED,
    LEFT,
    NOW,
    STRAIGHT,
    TOO_FAR,
    TRIAL,
    mesh_parts,
    reach,
    slot,
    wind,
)
from cable_shape.kernels.rod_guess import tangent
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.kernels.rod_output import all_finite
from cable_shape.kernels.rod_work import vectors

Array = Any
#: info has one number more than that of `rod_drive`: 18, not zero where the planar solver gave the shape. It tells what
#: factors are in `work` then: those of the planar solver, or spatial ones that someone has put there since, or none.
INFO, PLANAR = rod_drive.INFO + 1, rod_drive.INFO
IN_PLANE, FACTORED, UNFACTORED = 1.0, 2.0, 3.0
NOT_PLANAR, BUCKLED = 6, 7
#: rad: nothing turns further out of its plane that is solved for in it.
STRAY = 1e-3
#: Directions that are nearer to each other [rad] span no plane.
ALONG = 1e-3


@inlined
def normal_of(t0: Vector, t1: Vector, span: Vector, plane: Array) -> Vector:
    """Unit normal of the plane of the tangents, the chord (in lengths) and the loads; zero if there is none."""
    g1, g2 = (plane[1], plane[2], plane[3]), (plane[4], plane[5], plane[6])
    best, most = (0.0, 0.0, 0.0), ALONG * ALONG
    for v in (g1, g2, t1, span):
        c = cross(t0, v)
        size = dot(c, c)
        if size > most:
            best, most = c, size
    e = scale(1.0 / math.sqrt(most), best)
    for v in (g1, g2, t1, span):
        if not abs(dot(e, v)) <= FLAT:
            return (0.0, 0.0, 0.0)
    return e


@inlined
def local_normal(par: Array, ends: Array, width: int, e: Vector, plane: Array) -> Vector:
    """The normal in the cable frame, which is the same at both ends; zero if it is not, or no axis of the section."""
    none = (0.0, 0.0, 0.0)
    local = tapply(rotation((ends[3], ends[4], ends[5], ends[6])), e)
    if width > 1:
        off = subtract(local, tapply(rotation((ends[10], ends[11], ends[12], ends[13])), e))
        if not dot(off, off) <= FLAT * FLAT:
            return none
    off = cross(local, (plane[7], plane[8], plane[9]))
    if not dot(off, off) <= FLAT * FLAT or (par[0] != par[1] and min(abs(local[0]), abs(local[1])) > FLAT):
        return none
    return local


@inlined
def plane_of(par: Array, ends: Array, width: int, plane: Array) -> tuple[Vector, Vector]:
    """Unit normal of the plane in which ends, loads and section leave the rod: in the world, in the cable frame.

    Zero, both or the latter, if there is none.
    """
    t0 = tangent((ends[3], ends[4], ends[5], ends[6]))
    chord = t1 = (0.0, 0.0, 0.0)
    if width > 1:
        chord = (ends[7] - ends[0], ends[8] - ends[1], ends[9] - ends[2])
        t1 = tangent((ends[10], ends[11], ends[12], ends[13]))
    e = normal_of(t0, t1, scale(1.0 / par[19], chord), plane)
    if e == (0.0, 0.0, 0.0):
        return e, e
    return e, local_normal(par, ends, width, e, plane)


@kernel
def has_plane(par: Array, ends: Array, width: int, plane: Array) -> bool:
    """Whether there is such a plane between `ends` (15,): then the planar solver is asked first."""
    if plane[0] == 0.0 or par[6] != 0.0 or par[7] != 0.0 or par[8] != 0.0:
        return False
    return plane_of(par, ends, width, plane)[1] != (0.0, 0.0, 0.0)


@inlined
def dot4(p: Quaternion, q: Quaternion) -> float:
    """p . q."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]


@inlined
def half_turned(q0: Quaternion, local: Vector) -> Quaternion:
    """q0 turned by pi about `local`: with q0 itself it spans all that is turned about that axis."""
    return qmul(q0, (local[0], local[1], local[2], 0.0))


@inlined
def angle_part(q: Quaternion, q0: Quaternion, opposite: Quaternion) -> Pair:
    """Cosine and sine of half the angle from q0 to q, `opposite` being q0 half turned; not of unit length."""
    return dot4(q, q0), dot4(q, opposite)


@kernel
def strays(q: Array, local: Vector) -> bool:
    """Whether frames turn, against the first one, about another axis than `local`, too."""
    first = get4(q, 0)
    opposite = half_turned(first, local)
    for k in range(1, q.shape[0]):
        p = get4(q, k)
        c, d = angle_part(p, first, opposite)
        if not dot4(p, p) - c * c - d * d <= STRAY * STRAY:
            return True
    return False


@kernel
def extrapolate(
    sol: Array, elements: int, history: int, length: float, start: Quaternion, opposite: Quaternion, e1: Vector,
    e2: Vector, z: Array,
) -> Pair:  # fmt: skip
    """Fills z from the last one or two solutions as `rod_drive.extrapolate` does, or from the trial; returns lambda."""
    q1, lam1, ends1 = slot(sol, elements, NOW if history > 0 else TRIAL)
    q0, lam0, ends0 = slot(sol, elements, BEFORE)
    _, _, ends = slot(sol, elements, TRIAL)
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
        x = angle_part(get4(q1, k), start, opposite)
        if a != 0.0:
            y = angle_part(get4(q0, k), start, opposite)
            x = ((1.0 + a) * x[0] - a * y[0], (1.0 + a) * x[1] - a * y[1])
        z[k, 0], z[k, 1] = unit(x)
    n = (
        (1.0 + a) * lam1[0] - a * lam0[0],
        (1.0 + a) * lam1[1] - a * lam0[1],
        (1.0 + a) * lam1[2] - a * lam0[2],
    )
    return dot(n, e1), dot(n, e2)


@kernel
def turn_ends(z: Array, s: Array, held: bool, target: Pair) -> None:
    """Turns the frames so that held ends are met, as `rod_drive.turn_ends` does: z is 1 first, and `target` last."""
    last = z.shape[0] - 1
    miss = quotient((1.0, 0.0), (z[0, 0], z[0, 1]))
    if miss[0] < 0.0:
        miss = (-miss[0], -miss[1])
    turn0 = turn1 = 2.0 * math.atan2(miss[1], miss[0])
    if held:
        miss = quotient(target, (z[last, 0], z[last, 1]))
        turn1 = 2.0 * math.atan2(miss[1], miss[0])
    for k in range(last + 1):
        x = s[k] / s[last]
        z[k, 0], z[k, 1] = product((z[k, 0], z[k, 1]), half_turn((1.0 - x) * turn0 + x * turn1))
    z[0, 0], z[0, 1] = 1.0, 0.0
    if held:
        z[last, 0], z[last, 1] = target


@kernel
def solve_in_plane(
    par: Array, mesh: Array, sol: Array, work: Array, out: Array, info: Array, elements: int, width: int, points: int,
    history: int, most: int, far: float, plane: Array,
) -> int:  # fmt: skip
    """As `rod_drive.solve` with a guard; anything but CONVERGED has left `sol` as it was but for signs of the trial."""
    q, lam, ends = slot(sol, elements, TRIAL)
    if history > 0:
        before = slot(sol, elements, NOW)[2]
        wind(before, ends)
        far = reach(far, par, before, ends)
    held, length = width > 1, par[19]
    q0, q1 = (ends[3], ends[4], ends[5], ends[6]), (ends[10], ends[11], ends[12], ends[13])
    e1, chord = tangent(q0), (0.0, 0.0, 0.0)
    if held:
        chord = (ends[7] - ends[0], ends[8] - ends[1], ends[9] - ends[2])
        if par[5] == 0.0 and dot(chord, chord) >= (STRAIGHT * length) ** 2:
            return TOO_FAR
    e, local = plane_of(par, ends, width, plane)
    if local == (0.0, 0.0, 0.0) or strays(slot(sol, elements, NOW if history > 0 else TRIAL)[0], local):
        return NOT_PLANAR
    e2 = cross(e, e1)
    s, h, load, rest, _, errors = mesh_parts(mesh, elements)
    z, guess, force, bow, rows, parts, side, sums = layout(work, elements)
    for k in range(elements):
        for j in range(3):
            n = (load[k, 3 * j], load[k, 3 * j + 1], load[k, 3 * j + 2])
            force[k, 2 * j], force[k, 2 * j + 1] = dot(n, e1), dot(n, e2)
        bow[k, 0] = dot(local, (rest[k, 0], rest[k, 1], rest[k, 2]))
        bow[k, 1] = dot(local, (rest[k, 3], rest[k, 4], rest[k, 5]))
    opposite = half_turned(q0, local)
    lam2 = extrapolate(sol, elements, history, length, q0, opposite, e1, e2, z)
    if history > 0:
        turn_ends(z, s, held, unit(angle_part(q1, q0, opposite)))
    if not held:
        lam2 = (0.0, 0.0)
    guess[:, :] = z
    info[:] = 0.0
    first = abs(local[0]) > abs(local[1])  # bends about d1
    K, across = (par[0], par[1]) if first else (par[1], par[0])
    soft, C = min(par[0], par[1]), (par[5], par[3])
    span = (dot(chord, e1), dot(chord, e2))
    softest = min(soft, par[2]) / (length * length)
    code, lam2 = newton(z, lam2, s, h, force, bow, K, C, softest, span, held, par[18], most, rows, parts, sums, info)
    if code != CONVERGED:
        return code
    largest = 0.0
    for k in range(elements + 1):
        largest = max(largest, abs(quotient((z[k, 0], z[k, 1]), (guess[k, 0], guess[k, 1]))[1]))
    info[12] = 2.0 * math.asin(min(1.0, largest))
    if not info[12] <= far:
        return FAR
    kept = behind(work, elements, COLUMNS)
    if excess_across(z, lam2, h, force, bow, K, across, par[2], C, par[18], held, kept) != 0:
        return BUCKLED
    sums[NORMAL_X], sums[NORMAL_Y] = local[0], local[1]
    better, off, left = correct(
        z, lam2, h, force, bow, K, soft, C, max(soft, K, across, par[2]), held, rows, parts, side, sums, errors, guess
    )
    info[7], info[15], info[16], info[17] = LEFT * left + 2.0 * info[14] * off, off, left, ends[14]
    cosine = 1.0
    for k in range(elements):
        cosine = min(cosine, abs(z[k, 0] * z[k + 1, 0] + z[k, 1] * z[k + 1, 1]))
    info[13] = 2.0 * math.acos(cosine)
    if points > 0:
        start, weight = (ends[0], ends[1], ends[2]), (par[15], par[16], par[17])
        totals = np.empty(4)
        sample(
            guess, better, side, parts, s, h, force, bow, K, soft, C, (dot(weight, e1), dot(weight, e2)), start, e1, e2,
            e, local, q0, opposite, points, out, totals,
        )  # fmt: skip
        totals[0] -= length * dot(weight, start)
        info[8:12] = totals
        info[7] += INTERPOLATED * info[10]
        if held:
            for i in range(3):
                out[4 * points - 3 + i] = ends[7 + i]
        if not all_finite(info):
            return NOT_PLANAR
    # what the spatial solver keeps: frames, force, and minus the steps in position
    steps = vectors(work, elements, width)[1]
    for k in range(elements):
        for i in range(3):
            steps[k, i] = parts[k, GL] * e1[i] + parts[k, GL + 1] * e2[i]
    for k in range(elements + 1):
        for i in range(4):
            q[k, i] = z[k, 0] * q0[i] + z[k, 1] * opposite[i]
    for i in range(3):
        lam[i] = lam2[0] * e1[i] + lam2[1] * e2[i]
    size = sol.shape[0] // 3
    sol[size : 2 * size] = sol[0:size]
    sol[0:size] = sol[2 * size : 3 * size]
    info[PLANAR] = IN_PLANE
    return CONVERGED


@kernel
def solve(
    par: Array, mesh: Array, sol: Array, work: Array, out: Array, info: Array, elements: int, width: int, points: int,
    history: int, guard: bool, most: int, far: float, plane: Array,
) -> int:  # fmt: skip
    """`rod_drive.solve`, but in the plane of ends, loads and frames where there is one and a minimum is asked for.

    plane (10,): from `planar_loads.allow_plane`. A dead moment at the end is left to the spatial solver.
    """
    if guard and plane[0] != 0.0 and par[6] == 0.0 and par[7] == 0.0 and par[8] == 0.0:
        code = solve_in_plane(par, mesh, sol, work, out, info, elements, width, points, history, most, far, plane)
        if code == CONVERGED:
            return code
    return rod_drive.solve(par, mesh, sol, work, out, info, elements, width, points, history, guard, most, far)
