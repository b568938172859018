"""The gradient cable from end to end: dimensionless problem, tension, and the shape at uniform arc length."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.frames import align, darboux, director, roll, straight, transport
from cable_shape.kernels.gradient_basis import PARAMETERS, ROW, SERIES_TERMS, functions
from cable_shape.kernels.gradient_ends import CLAMPED, FREE
from cable_shape.kernels.gradient_length import (
    AHEAD,
    MAX_PANELS,
    NODES,
    derivatives,
    field,
    integral,
    invert,
    measured,
    put,
    tails,
)
from cable_shape.kernels.gradient_tension import FAILED, find

OVERSTRETCHED, NOT_FINITE = 3, 4

# Places in `numbers`.
LENGTH, STIFFNESS, GRADIENT, ETA, WEIGHT_FORCE, LOAD = 0, 1, 2, 3, 4, 7

# Places in `result`.
ITERATIONS, RESIDUAL, ERROR, ENERGY, ROLL, CHORD, RESAMPLING = 0, 1, 2, 3, 4, 5, 6
RESULTS = 7

#: Chords nearer than this to the length count as longer than an inextensible cable.
_TAUT = 1e-12
#: A point this close before a concentrated load (fraction of the arc length) counts as just behind it.
_AT_LOAD = 1e-9
#: Least speed |x'| with which tangents and curvatures are formed: at a cusp they have none.
_SLOWEST = 1e-6


@kernel
def solve(
    start, start_curvature, kind0, end, end_curvature, kind1, tip, numbers, load_place, load_force, buckling, finest,
    points, warm, buffer, result,
):  # fmt: skip
    """Solves one gradient cable and fills a shape's buffer.

    Parameters
    ----------
    start, end : (7,)
        Cable frames at the ends: position [m], quaternion. `end` is ignored for kind FREE.
    start_curvature, end_curvature : (3,)
        x'' [1/m], for the 6th order.
    kind0, kind1 : int
        CLAMPED, PINNED, FREE.
    tip : (9,)
        Force [N] with the plug's weight, moment [N m], the plug's weight [N], of a free end.
    numbers : (13,)
        L [m], B [N m^2], (gradient length / L)^2 (0: 4th order), B / (L^2 EA) (0: inextensible), weight [N/m] (3),
        distributed load [N/m] at both ends (3 + 3).
    load_place : (k,), load_force : (k, 3)
        Concentrated loads: fraction of the length, ascending, strictly inside; force [N].
    buckling : float
        From :func:`~cable_shape.kernels.gradient_tension.critical`.
    finest : float
        Fraction of the length to which the speed is resolved on each panel, see gradient_length.tails.
    points : int
    warm : (4,)
        Warm start, in and out.
    buffer : (17 points,)
        Out: see CableShape.
    result : (RESULTS,)
        Out.

    Returns FOUND, FAILED, SINGULAR, OVERSTRETCHED or NOT_FINITE.
    """
    length, stiffness, c, eta = numbers[LENGTH], numbers[STIFFNESS], numbers[GRADIENT], numbers[ETA]
    free = kind1 == FREE
    kinds = np.empty(2, np.int64)
    kinds[0], kinds[1] = kind0, kind1
    given, load = np.zeros((2, 3, 3)), np.empty((2, 3))
    tip_moment, direction = np.zeros(3), np.zeros(3)
    if kind0 == CLAMPED:
        given[0, 1, 0], given[0, 1, 1], given[0, 1, 2] = director(start[3:7], 2)
    if kind1 == CLAMPED:
        given[1, 1, 0], given[1, 1, 1], given[1, 1, 2] = director(end[3:7], 2)
    to_force = length * length / stiffness
    square = 0.0
    for k in range(3):
        if kind0 == CLAMPED:
            given[0, 2, k] = start_curvature[k] * length
        if kind1 == CLAMPED:
            given[1, 2, k] = end_curvature[k] * length
        if free:
            given[1, 0, k] = tip[k] * to_force
            tip_moment[k] = tip[3 + k] * length / stiffness
        else:
            given[1, 0, k] = (end[k] - start[k]) / length
            square += given[1, 0, k] ** 2
        load[0, k] = 0.5 * (numbers[LOAD + k] + numbers[LOAD + 3 + k]) * length * to_force
        load[1, k] = (numbers[LOAD + 3 + k] - numbers[LOAD + k]) * length * to_force
    chord = -1.0 if free else math.sqrt(square)
    result[:] = 0.0
    result[CHORD] = chord * length
    if not free:
        if eta == 0.0 and chord >= 1.0 - _TAUT:
            result[ROLL] = straight(start, end, length, points, buffer)
            return OVERSTRETCHED
        if chord > 1e-9:
            for k in range(3):
                direction[k] = given[1, 0, k] / chord
    loads = len(load_place)
    edges, panels = np.empty(loads + 2), np.empty((4, MAX_PANELS))
    par, series, rows = np.empty(PARAMETERS), np.empty((4, SERIES_TERMS)), np.empty((loads + 1, 3, ROW))
    force, info = np.empty(3), np.zeros(8)
    status, nodes, phi, slope, speed = find(
        c, kinds, given, tip_moment, load, load_place, load_force * to_force, direction, chord, eta, buckling, start,
        finest, warm, edges, panels, par, series, rows, force, info,
    )  # fmt: skip
    result[ITERATIONS] = info[1]
    mode, count = int(info[6]), int(info[5])
    if mode < 0 or not info[3] < math.inf:
        result[ROLL] = straight(start, start if free else end, length, points, buffer)
        return status
    if not info[3] > _TAUT:  # compressed to nothing
        result[ROLL] = straight(start, start if free else end, length, points, buffer)
        return FAILED
    arc = _fill(
        mode, count, start, end, kinds, given, length, stiffness, load, load_force * to_force, edges, panels, par,
        series, rows, force, speed, points, buffer, result,
    )  # fmt: skip
    _grade(info, speed, panels, count, length, result)
    result[ENERGY] = _energy(
        mode, count, start, length, stiffness, eta, arc, numbers, load_force, tip, kind1, edges, panels, par,
        series, rows, nodes, phi, slope, speed, buffer, points,
    )  # fmt: skip
    if not _finite(buffer):
        result[ROLL] = straight(start, start if free else end, length, points, buffer)
        return NOT_FINITE
    return status


@kernel
def _finite(buffer):
    """Whether every number is finite: 0 times it is NaN otherwise. Four sums, to keep the processor busy."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    last = len(buffer) - 3
    k = 0
    while k < last:
        a += 0.0 * buffer[k]
        b += 0.0 * buffer[k + 1]
        c += 0.0 * buffer[k + 2]
        d += 0.0 * buffer[k + 3]
        k += 4
    while k < len(buffer):
        a += 0.0 * buffer[k]
        k += 1
    return a + b + c + d == 0.0


@kernel
def _fill(
    mode, count, start, end, kinds, given, length, stiffness, load, point_load, edges, panels, par, series, rows,
    force, speed, points, buffer, result,
):  # fmt: skip
    """Shape, frames and loads at uniform arc length; residual and resampling defect go to `result`. The arc length."""
    n, pieces = points, len(edges) - 1
    power, begin = np.empty((count, NODES + 3)), np.empty(count + 1)
    arc = measured(speed, panels, count, power, begin)
    at = np.empty((3, n))
    behind = np.full(pieces + 1, n)  # the first point of each piece
    behind[0] = 0
    worst, step, first = 0.0, arc / (n - 1.0), 0
    t = np.empty(n + AHEAD)
    for i in range(count):
        last = n
        if i < count - 1:
            early = _AT_LOAD * arc if panels[3, i + 1] != panels[3, i] else 0.0
            last = min(n - 1, max(first, math.ceil((begin[i + 1] - early) / step)))
            if i == 0:
                last = max(last, 1)
        worst = max(worst, invert(power, i, step, begin[i], first, last, begin[i + 1] - begin[i], t))
        if i > 0 and panels[3, i] != panels[3, i - 1]:
            behind[int(panels[3, i])] = first
        if i == 0:
            t[0] = -1.0
        if i == count - 1:
            t[n - 1] = 1.0
        put(panels, i, edges, t, first, last, at)
        first = last
    jet, phi, d, rest = np.empty((12, n)), np.empty((4, n)), np.empty((12, ROW)), length / (n - 1.0)
    wide, unit = par[1] > 0.0, stiffness / (length * length)
    for p in range(pieces):
        first, last = behind[p], behind[p + 1]
        functions(mode, par, series, at, first, last, phi)
        d[0:3] = rows[p]
        derivatives(mode, par, d[0:3], d[3:6])
        derivatives(mode, par, d[3:6], d[6:9])
        derivatives(mode, par, d[6:9], d[9:12])
        field(d, wide, at, phi, first, last, jet)
        for k in range(3):
            base = force[k]
            for j in range(p):
                base -= point_load[j, k]
            a0, a1, a2 = unit * base, unit * load[0, k], 0.5 * unit * load[1, k]
            for m in range(first, last):
                u = at[0, m]
                buffer[11 * n + 3 * m + k] = a0 - u * (a1 + u * a2)
    for k in range(n):
        buffer[k] = rest * k
    buffer[n - 1] = length
    x, d1, d2, d3 = jet[0:3], jet[3:6], jet[6:9], jet[9:12]
    residual = 0.0  # boundary defects, before the ends are put exactly where they belong
    for k in range(3):
        residual = max(residual, abs(x[k, 0]))
        if kinds[1] != FREE:
            residual = max(residual, abs(x[k, n - 1] - given[1, 0, k]))
        for e in range(2):
            if kinds[e] == CLAMPED:
                residual = max(residual, abs(d1[k, e * (n - 1)] - given[e, 1, k]))
    result[RESIDUAL], result[RESAMPLING] = residual, worst
    turning = np.empty(n)
    _bend(d1, d2, d3, arc / length, turning)
    _still(d1, start)
    for m in range(n):
        tx, ty, tz, bx, by, bz = d1[0, m], d1[1, m], d1[2, m], d2[0, m], d2[1, m], d2[2, m]
        buffer[14 * n + 3 * m] = stiffness * (ty * bz - tz * by)
        buffer[14 * n + 3 * m + 1] = stiffness * (tz * bx - tx * bz)
        buffer[14 * n + 3 * m + 2] = stiffness * (tx * by - ty * bx)
        buffer[n + 3 * m] = start[0] + length * x[0, m]
        buffer[n + 3 * m + 1] = start[1] + length * x[1, m]
        buffer[n + 3 * m + 2] = start[2] + length * x[2, m]
    buffer[n : n + 3] = start[0:3]
    if kinds[1] != FREE:
        buffer[4 * n - 3 : 4 * n] = end[0:3]
    frames = buffer[4 * n : 8 * n]
    frames[0:4] = start[3:7]
    align(frames, d1[0, 0], d1[1, 0], d1[2, 0])
    transport(d1, turning, step, frames)
    darboux(d2, frames, buffer[8 * n : 11 * n])
    if kinds[1] == CLAMPED:
        result[ROLL] = roll(frames[4 * n - 4 : 4 * n], end[3:7])
    return arc


@kernel(fastmath={"contract"})
def _bend(d1, d2, d3, stretch, turning):
    """From derivatives of x by l / L to the tangent (in `d1`), the curvature vector (in `d2`) and t . (t' x t'').

    stretch : arc length / L^2: the curvature comes out per stress-free length. `turning` is per arc length / L.
    """
    vx, vy, vz, ax, ay, az = d1[0], d1[1], d1[2], d2[0], d2[1], d2[2]
    jx, jy, jz = d3[0], d3[1], d3[2]
    for m in range(len(turning)):
        x, y, z = vx[m], vy[m], vz[m]
        square = x * x + y * y + z * z
        inverse = 1.0 / math.sqrt(max(square, 1e-300))
        slow = 1.0 / max(square, _SLOWEST * _SLOWEST)
        cx, cy, cz = y * az[m] - z * ay[m], z * ax[m] - x * az[m], x * ay[m] - y * ax[m]
        turning[m] = (cx * jx[m] + cy * jy[m] + cz * jz[m]) * slow * slow * slow
        x, y, z = x * inverse, y * inverse, z * inverse
        along = ax[m] * x + ay[m] * y + az[m] * z
        scale = stretch * slow
        ax[m], ay[m], az[m] = scale * (ax[m] - along * x), scale * (ay[m] - along * y), scale * (az[m] - along * z)
        vx[m], vy[m], vz[m] = x, y, z


@kernel
def _still(tangents, start):
    """Gives points where the curve stands still (a cusp) the tangent of the point before, or of the start frame."""
    for m in range(tangents.shape[1]):
        if not tangents[0, m] ** 2 + tangents[1, m] ** 2 + tangents[2, m] ** 2 > 0.5:
            if m == 0:
                tangents[0, 0], tangents[1, 0], tangents[2, 0] = director(start[3:7], 2)
            else:
                tangents[:, m] = tangents[:, m - 1]


@kernel
def _grade(info, speed, panels, count, length, result):
    """Error estimate [m] and residual from the length's defect, the speed's polynomials, resampling and load places.

    A relative error f of the excess of length is f / 2 of the sag, which is at most half of the length, and an error
    of the excess changes the sag by at most its square root.
    """
    tail = np.empty(count)
    total = tails(speed, panels, count, tail)
    missed = abs(info[3] - info[4])
    sag = min(0.25 * abs(info[2]), math.sqrt(missed)) + missed
    result[ERROR] = length * (sag + total + result[RESAMPLING] + info[7])
    result[RESIDUAL] = max(result[RESIDUAL], missed)


@kernel(fastmath={"contract"})
def _integrands(slope, bend, speed, height, n):
    """Squared curvature (into ``bend[0]``) and height (in place), both times the speed."""
    vx, vy, vz, ax, ay, az = slope[0], slope[1], slope[2], bend[0], bend[1], bend[2]
    for k in range(n):
        x, y, z = vx[k], vy[k], vz[k]
        cx, cy, cz = y * az[k] - z * ay[k], z * ax[k] - x * az[k], x * ay[k] - y * ax[k]
        v = max(speed[k], _SLOWEST)
        square = v * v
        ax[k] = (cx * cx + cy * cy + cz * cz) / (square * square * v)
        height[k] *= speed[k]


@kernel
def _energy(
    mode, count, start, length, stiffness, eta, arc, numbers, load_force, tip, kind1, edges, panels, par, series,
    rows, nodes, phi, slope, speed, buffer, points,
):  # fmt: skip
    """[J] bending and stretching less the work of the weights, with the origin of the world as zero."""
    n = NODES * count
    wide = par[1] > 0.0
    jet, d, e = np.empty((4, n)), np.empty((3, ROW)), np.empty((4, ROW))
    first = 0
    for p in range(len(edges) - 1):
        last = first
        while last < count and panels[3, last] == p:
            last += 1
        derivatives(mode, par, rows[p], d)
        derivatives(mode, par, d, e[0:3])
        for w in range(ROW):
            e[3, w] = 0.0
            for k in range(3):
                e[3, w] += numbers[WEIGHT_FORCE + k] * rows[p, k, w]
        field(e, wide, nodes, phi, NODES * first, NODES * last, jet)
        first = last
    bend, height = jet[0:3], jet[3]
    _integrands(slope, bend, speed, height, n)
    bending, moment = integral(bend[0], panels, count), integral(height, panels, count)
    energy = 0.5 * stiffness * arc * bending / length - length * length * moment / arc
    for k in range(3):
        energy -= length * numbers[WEIGHT_FORCE + k] * start[k]
    if eta > 0.0:
        energy += 0.5 * stiffness / (length * eta) * (arc - 1.0) ** 2
    ends, there, value = np.zeros((3, 1)), np.zeros((4, 1)), np.empty((3, 1))
    for j in range(len(load_force)):  # masses
        ends[0, 0], ends[1, 0], ends[2, 0] = edges[j + 1] - 0.5, edges[j + 1] - edges[j], 0.0
        functions(mode, par, series, ends, 0, 1, there)
        field(rows[j], wide, ends, there, 0, 1, value)
        for k in range(3):
            energy -= load_force[j, k] * (start[k] + length * value[k, 0])
    if kind1 == FREE:
        for k in range(3):
            energy -= tip[6 + k] * buffer[4 * points - 3 + k]
    return energy
