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
from cable_shape.kernels.gradient_tension import FAILED, FOUND, find
from cable_shape.kernels.gradient_tension import MEMORY as OF_TENSION

OVERSTRETCHED, NOT_FINITE = 3, 4
#: As in cable_shape.shape.
NUMBERS_PER_POINT = 17

# Places in `numbers`.
LENGTH, STIFFNESS, GRADIENT, ETA, WEIGHT_FORCE, LOAD, FINEST, NUMBERS = 0, 1, 2, 3, 4, 7, 13, 14

# Places in `held`.
KIND0, KIND1, BUCKLING, CURVATURE0, CURVATURE1, TIP, HELD = 0, 1, 2, 3, 6, 9, 18

# Places in `memory`: results of the last solve, what the next one starts from, scratch for 41 numbers that are zero
# first and for the mode, then see gradient_tension.
ITERATIONS, RESIDUAL, ERROR, ENERGY, ROLL, CHORD, RESAMPLING = 0, 1, 2, 3, 4, 5, 6
RESULTS = 7
BEFORE, ENDS, MOVED, ZEROS, MODE = 7, 8, 17, 26, 67
TENSION = MODE + PARAMETERS + 4 * SERIES_TERMS
MEMORY = TENSION + OF_TENSION

#: Chords nearer than this to the length count as longer than an inextensible cable.
_TAUT = 1e-12
#: A point this close before a concentrated load (fraction of the arc length) counts as just behind it.
_AT_LOAD = 1e-9
#: Least speed |x'| with which tangents and curvatures are formed: at a cusp they have none.
_SLOWEST = 1e-6


@kernel
def solve(start, end, held, numbers, memory, buffer):
    """Solves one gradient cable and fills a shape's buffer.

    Parameters
    ----------
    start, end : (7,)
        Cable frames at the ends: position [m], quaternion. `end` is ignored for kind FREE.
    held : (HELD,)
        Kinds of start and end (CLAMPED, PINNED, FREE), the buckling tension from
        :func:`~cable_shape.kernels.gradient_tension.critical`, x'' [1/m] at both ends (for the 6th order), and of a
        free end force [N] with the plug's weight, moment [N m], the plug's weight [N].
    numbers : (NUMBERS + 4 k,)
        L [m], B [N m^2], (gradient length / L)^2 (0: 4th order), B / (L^2 EA) (0: inextensible), weight [N/m] (3),
        distributed load [N/m] at both ends (3 + 3), fraction of the length to which the speed is resolved on each panel
        (see gradient_length.tails); then of the concentrated loads all fractions of the length, ascending, strictly
        inside, and all forces [N].
    memory : (MEMORY,)
        Results, and what the next solve starts from; NaN: cold.
    buffer : (17 n,)
        Out: see CableShape.

    Returns FOUND, FAILED, SINGULAR, OVERSTRETCHED or NOT_FINITE.
    """
    length, stiffness, c, eta = numbers[LENGTH], numbers[STIFFNESS], numbers[GRADIENT], numbers[ETA]
    points, loads = len(buffer) // NUMBERS_PER_POINT, (len(numbers) - NUMBERS) // 4
    load_place = numbers[NUMBERS : NUMBERS + loads]
    load_force = numbers[NUMBERS + loads : NUMBERS + 4 * loads].reshape(loads, 3)
    kind0, kind1, tip = int(held[KIND0]), int(held[KIND1]), held[TIP:HELD]
    result = memory[:RESULTS]
    free = kind1 == FREE
    kinds = np.empty(2, np.int64)
    kinds[0], kinds[1] = kind0, kind1
    zeros = memory[ZEROS:MODE]
    zeros[:] = 0.0
    given, load = zeros[:18].reshape(2, 3, 3), zeros[18:24].reshape(2, 3)
    tip_moment, direction, force, info = zeros[24:27], zeros[27:30], zeros[30:33], zeros[33:41]
    if kind0 == CLAMPED:
        given[0, 1, 0], given[0, 1, 1], given[0, 1, 2] = director(start[3:7], 2)
    if kind1 == CLAMPED:
        given[1, 1, 0], given[1, 1, 1], given[1, 1, 2] = director(end[3:7], 2)
    to_force = length * length / stiffness
    square = 0.0
    for k in range(3):
        if kind0 == CLAMPED:
            given[0, 2, k] = held[CURVATURE0 + k] * length
        if kind1 == CLAMPED:
            given[1, 2, k] = held[CURVATURE1 + k] * length
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
    edges, panels = np.empty(loads + 2), np.empty((4, MAX_PANELS))
    par, series = memory[MODE : MODE + PARAMETERS], memory[MODE + PARAMETERS : TENSION].reshape(4, SERIES_TERMS)
    rows = np.empty((loads + 1, 3, ROW))
    _guess_ahead(given, held[BUCKLING], memory)
    point_load = load_force * to_force
    status, nodes, phi, slope, speed = find(
        c, kinds, given, tip_moment, load, load_place, point_load, direction, chord, eta, held[BUCKLING], start,
        numbers[FINEST], memory[TENSION:], edges, panels, par, series, rows, force, info,
    )  # fmt: skip
    _remember(status == FOUND, given, memory)
    result[ITERATIONS] = info[1]
    mode, count = int(info[6]), int(info[5])
    if mode < 0 or not info[3] < math.inf:
        result[ROLL] = straight(start, start if free else end, length, points, buffer)
        return status
    if not info[3] > _TAUT:  # compressed to nothing
        result[ROLL] = straight(start, start if free else end, length, points, buffer)
        return FAILED
    arc = _fill(
        mode, count, start, end, kinds, given, length, stiffness, load, point_load, edges, panels, par, series, rows,
        force, speed, points, buffer, result,
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
def _of_ends(given, i):
    """Number i of 9 that say where the ends are: the chord, and the tangents at both ends."""
    return given[1, 0, i] if i < 3 else (given[0, 1, i - 3] if i < 6 else given[1, 1, i - 6])


@kernel
def _guess_ahead(given, buckling, memory):
    """Moves the tension that the next solve starts from along the last step's change, as far as the ends went on."""
    along = size = 0.0
    for i in range(9):
        along += memory[MOVED + i] * (_of_ends(given, i) - memory[ENDS + i])
        size += memory[MOVED + i] ** 2
    z = memory[TENSION]
    change = min(max(along / size, 0.0), 2.0) * (z - memory[BEFORE]) if size > 0.0 else 0.0
    memory[BEFORE] = z
    if abs(change) < 0.3 * (z - buckling):  # not where one of them is NaN
        memory[TENSION] = z + change


@kernel
def _remember(found, given, memory):
    """Keeps the ends of this solve, and how far they are from those of the last one; NaN after a failure."""
    for i in range(9):
        now = _of_ends(given, i)
        memory[MOVED + i] = now - memory[ENDS + i] if found else math.nan
        memory[ENDS + i] = now if found else math.nan


@kernel(fastmath={"reassoc"})
def _finite(buffer):
    """Whether every number is finite: 0 times it is NaN otherwise."""
    total = 0.0
    for k in range(len(buffer)):
        total += 0.0 * buffer[k]
    return total == 0.0


@kernel
def _fill(
    mode, count, start, end, kinds, given, length, stiffness, load, point_load, edges, panels, par, series, rows,
    force, speed, points, buffer, result,
):  # fmt: skip
    """Shape, frames and loads at uniform arc length; residual and resampling defect go to `result`. The arc length."""
    n, pieces = points, len(edges) - 1
    power, begin = np.empty((count, NODES + 3)), np.empty(count + 1)
    arc = measured(speed, panels, count, power, begin)
    room = np.empty(22 * n + 2 * AHEAD)
    at, jet, phi = room[: 3 * n].reshape(3, n), room[3 * n : 15 * n].reshape(12, n), room[15 * n : 19 * n].reshape(4, n)
    turning, t, moved = room[19 * n : 20 * n], room[20 * n : 21 * n + AHEAD], room[21 * n + AHEAD : 22 * n + 2 * AHEAD]
    behind = np.full(pieces + 1, n)  # the first point of each piece
    behind[0] = 0
    worst, step, first = 0.0, arc / (n - 1.0), 0
    for i in range(count):
        last = n
        if i < count - 1:
            early = _AT_LOAD * arc if panels[3, i + 1] != panels[3, i] else 0.0
            last = min(n - 1, max(first, math.ceil((begin[i + 1] - early) / step)))
            if i == 0:
                last = max(last, 1)
        worst = max(worst, invert(power, i, step, begin[i], first, last, begin[i + 1] - begin[i], moved, t))
        if i > 0 and panels[3, i] != panels[3, i - 1]:
            behind[int(panels[3, i])] = first
        if i == 0:
            t[0] = -1.0
        if i == count - 1:
            t[n - 1] = 1.0
        put(panels, i, edges, t, first, last, at)
        first = last
    d, rest = np.empty((12, ROW)), length / (n - 1.0)
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
