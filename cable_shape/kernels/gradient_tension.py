"""The tension of a gradient cable, found by its length (the paper's eq 2), and the places of concentrated loads.

The arc length falls as the tension rises: integral |x'|^2 is the derivative, with respect to the tension, of twice the
least energy, which is concave as a minimum of linear functions, as long as the tension is above the buckling load. So
the root is looked for above it, in y = log(z - z_buckling) and log(excess of length / wanted excess), where the two
limits, taut and buckled, are straight lines.
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.frames import director
from cable_shape.kernels.gradient_basis import MU, MU2, PARAMETERS, ROW, SERIES_TERMS, functions
from cable_shape.kernels.gradient_ends import WORK, assemble
from cable_shape.kernels.gradient_length import (
    MAX_PANELS,
    NODES,
    WEIGHT,
    field,
    integral,
    lay_out,
    put_nodes,
    speeds,
    split,
    tails,
)

FOUND, FAILED, SINGULAR = 0, 1, 2

#: Nearest to the buckling load, as a fraction of it, that the tension may come; nearer the buckled shape is added.
_NEAREST = 1e-7
_LARGEST = 1e45
#: Least of log(excess / wanted) that is solved for, and that a finer quadrature may change; half is the sag's relative
#: error. The tolerance on the speed counts where it is more.
_TOLERANCE, _REFINED = 1e-9, 1e-8
#: Fraction of the arc length to which concentrated loads are placed.
_PLACED = 1e-10
#: Stands for the logarithm of nothing.
_EMPTY = -50.0

#: Panels that are remembered, at most, and numbers a node in their scratch.
KEPT, ROWS = 24, 12
#: What is remembered from one solve to the next, in the order of `memory`: z to start from, first and second derivative
#: of log(excess) by y at the last z, and that; of the panels: mode, decay length that they were made for, how many (0:
#: none), how often they have been used; the panels, one row of KEPT after the other; scratch, nodes first; scratch for
#: the linear system and its table.
WARM, LAID, PANELS, ROOM = 0, 4, 8, 8 + 4 * KEPT
SYSTEM = ROOM + ROWS * NODES * KEPT
TABLE, MEMORY = SYSTEM + 10 * WORK, SYSTEM + 10 * WORK + 10 * ROW
#: Solves after which panels are made anew: they are divided where they have to be, and never joined.
_OLDEST = 32
#: Steps of y from which a difference of log(excess) tells its slope.
_MEASURABLE = 1e-8


@kernel
def measure(mode, par, series, rows, panels, count, edges, direction, nodes, phi, slope, speed, over):
    """x' (3, n), |x'| and |x'| - x' . direction at the nodes of all panels; the integral of the last one."""
    first = 0
    for p in range(len(edges) - 1):
        last = first
        while last < count and panels[3, last] == p:
            last += 1
        functions(mode, par, series, nodes, NODES * first, NODES * last, phi)
        speeds(mode, par, rows[p], nodes, phi, NODES * first, NODES * last, direction, slope, speed, over)
        first = last
    return integral(over, panels, count)


@kernel
def critical(order_c, kinds, start):
    """Buckling tension z (negative): where the compliance under a uniform load changes sign, at or below `start`."""
    z, step = start * (1.0 - 1e-9), 1.05
    if _compliance(z, order_c, kinds) <= 0.0:
        return start
    below = z * step
    while _compliance(below, order_c, kinds) > 0.0:
        z, below = below, below * step
        if below < -_LARGEST:
            return z
    for _ in range(60):
        middle = 0.5 * (z + below)
        if _compliance(middle, order_c, kinds) > 0.0:
            z = middle
        else:
            below = middle
    return z


@kernel
def _compliance(z, c, kinds):
    """Mean of x under the load 1 with homogeneous boundary conditions."""
    par, series, rows = np.empty(PARAMETERS), np.empty((4, SERIES_TERMS)), np.empty((1, 3, ROW))
    load, zero = np.zeros((2, 3)), np.zeros(3)
    load[0, 0] = 1.0
    work, table = np.empty((WORK, 10)), np.empty((2, 5, ROW))
    edges, force, none = np.array([0.0, 1.0]), np.empty(3), np.empty((0, 3))
    mode = assemble(z, c, kinds, np.zeros((2, 3, 3)), zero, load, edges, none, work, table, par, series, rows, force)
    if mode < 0:
        return 0.0
    panels = np.empty((4, MAX_PANELS))
    count = lay_out(mode, par, edges, panels)
    nodes, phi, x = np.empty((3, NODES * count)), np.empty((4, NODES * count)), np.empty((1, NODES * count))
    put_nodes(panels, count, edges, nodes)
    functions(mode, par, series, nodes, 0, NODES * count, phi)
    field(rows[0, :1], c > 0.0, nodes, phi, 0, NODES * count, x)
    return integral(x[0], panels, count)


@kernel
def _first_guess(chord, kinds, given, load, point_load, direction, slack):
    """A tension from the sag of a taut cable, |q| / z = sqrt(24 slack), and from its bent ends, angle^2 / 4 sqrt(z)."""
    q = np.zeros(3)
    bent = 0.0
    for k in range(3):
        q[k] = load[0, k]
        for j in range(len(point_load)):
            q[k] += point_load[j, k]
    if chord < 0.0:
        tip = given[1, 0]
        return 0.5 * math.sqrt(q @ q) + math.sqrt(tip @ tip)
    along = q @ direction
    for i in range(2):
        if kinds[i] == 0:
            for k in range(3):
                bent += (given[i, 1, k] - direction[k]) ** 2
    return max(math.sqrt(max(q @ q - along * along, 0.0) / (24.0 * slack)), (bent / (4.0 * slack)) ** 2)


@kernel
def _aside(start, free, direction, load):
    """Unit vector in which a cable buckles that nothing pushes: across the chord, along the load, else along d1."""
    out = np.empty(3)
    if free:
        out[0], out[1], out[2] = director(start[3:7], 2)
        return out
    for attempt in range(4):
        if attempt == 0:
            out[0], out[1], out[2] = load[0, 0], load[0, 1], load[0, 2]
        elif attempt == 1:
            out[0], out[1], out[2] = load[1, 0], load[1, 1], load[1, 2]
        else:
            out[0], out[1], out[2] = director(start[3:7], attempt - 2)
        before = math.sqrt(out @ out)
        out -= (out @ direction) * direction
        size = math.sqrt(out @ out)
        if size > 1e-3 * before:
            return out / size
    return out


@kernel
def find(
    c, kinds, given, tip_moment, load, places, point_load, direction, chord, eta, buckling, start, finest, memory,
    edges, panels, par, series, rows, force, info,
):  # fmt: skip
    """Finds the tension and leaves the solution in `par`, `series`, `rows`, `force`, `edges` and `panels`.

    Parameters
    ----------
    c, kinds, given, tip_moment, load, point_load
        See :func:`~cable_shape.kernels.gradient_ends.assemble`.
    places : (k,)
        Fractions of the arc length where the concentrated loads are.
    direction : (3,)
        Along the chord; zero for a free end or a chord of zero.
    chord : float
        Chord / L; -1 for a free end.
    eta : float
        B / (L^2 EA); 0: inextensible. The wanted length is 1 + z eta.
    buckling : float
        z below which no tension is looked for.
    start : (7,)
        Cable frame at the start: its d1 is the direction of the buckled shape, where loads and ends choose none.
    finest : float
        Tail of the speed's polynomial (see gradient_length) above which a panel is divided.
    memory : (MEMORY,)
        In and out, see above; NaN: cold.
    edges : (k + 2,), panels : (4, MAX_PANELS)
        Out.
    info : (8,)
        Out: z, iterations, relative excess defect, arc length, wanted length, number of panels, mode, place defect.

    Returns FOUND, FAILED or SINGULAR, and the arrays at the nodes: positions (3, n), phi (4, n), x' (3, n), speed (n,).
    """
    base = 1.0 - max(chord, 0.0)  # wanted excess without stretch: over the chord, or all of the length
    lowest = buckling if eta == 0.0 else max(buckling, -base / eta)
    nearest = _NEAREST * max(abs(buckling), 1.0)
    if lowest > buckling:
        nearest = min(nearest, 1e-12 * max(abs(lowest), 1.0))
    bottom, top = math.log(nearest), math.log(_LARGEST)
    loads = len(places)
    edges[0], edges[loads + 1] = 0.0, 1.0
    edges[1 : loads + 1] = places
    warm, laid_out = memory[WARM:LAID], memory[LAID:PANELS]
    kept = memory[PANELS:ROOM].reshape(4, KEPT)
    bent, straight = False, False
    pushed, plain, aside = load, load, direction
    slope_y, bend_y = -1.0, 0.0
    if lowest + nearest < warm[0] < _LARGEST:
        y = math.log(warm[0] - lowest)
        if -20.0 < warm[1] < -0.05:
            slope_y = warm[1]
            if abs(warm[2]) < 4.0 and warm[3] > lowest + nearest:
                bend_y = warm[2]
                slope_y = min(slope_y + bend_y * (y - math.log(warm[3] - lowest)), -1e-3)
    else:
        guess = _first_guess(chord, kinds, given, plain, point_load, direction, max(base, 1e-12))
        y = math.log(max(guess - lowest, 1.0))
    y = min(max(y, bottom), top)
    work, table = memory[SYSTEM:TABLE].reshape(WORK, 10), memory[TABLE:MEMORY].reshape(2, 5, ROW)
    capacity = NODES * KEPT
    nodes, phi, slope, speed, over = _split_room(memory[ROOM:SYSTEM], capacity)
    tail = np.empty(MAX_PANELS)
    count, mode, laid_mode, laid, age = 0, -1, -2, 0.0, 0.0
    if loads == 0 and laid_out[2] > 0.0 and laid_out[3] < _OLDEST:
        laid_mode, laid, count, age = int(laid_out[0]), laid_out[1], int(laid_out[2]), laid_out[3] + 1.0
        for row in range(4):
            for i in range(count):
                panels[row, i] = kept[row, i]
    close = max(_TOLERANCE, finest)
    evaluations, f, total, wanted, z = 0, 0.0, 0.0, 1.0, 0.0
    status = FAILED
    shift, mover = 0.0, np.zeros((loads + 3, loads))
    for _outer in range(80):
        low, high = bottom, top
        if bent:
            low, high = -math.log(1e9 * nearest) - 40.0, 40.0
        y_before, f_before, found = math.nan, 0.0, False
        secant_before, span = 0.0, 0.0
        for inner in range(100):
            if bent:
                z = lowest + nearest
                for k in range(3):
                    pushed[0, k] = plain[0, k] + math.exp(-y) * aside[k]
            else:
                z = lowest + math.exp(y)
            mode = assemble(
                z, c, kinds, given, tip_moment, pushed, edges, point_load, work, table, par, series, rows, force
            )
            if mode < 0:
                break
            thin = max(par[MU], par[MU2])
            if mode != laid_mode or not 0.66 * laid <= thin <= 1.5 * laid:
                count = lay_out(mode, par, edges, panels)
                laid_mode, laid, age = mode, thin, 0.0
                if count == 0:
                    break
                if NODES * count > capacity:
                    capacity = NODES * (count + 8)
                    nodes, phi, slope, speed, over = _split_room(np.empty(ROWS * capacity), capacity)
                put_nodes(panels, count, edges, nodes)
            total = measure(mode, par, series, rows, panels, count, edges, direction, nodes, phi, slope, speed, over)
            evaluations += 1
            wanted = math.exp(y) * eta if lowest > buckling else base + z * eta
            if not total < math.inf:
                break
            f = math.log(total / wanted) if total > 0.0 and wanted > 0.0 else _EMPTY
            if abs(f) <= close or abs(total - wanted) <= 4e-16:
                found = True
                if abs(y - y_before) > _MEASURABLE and -50.0 < (f - f_before) / (y - y_before) < -1e-3:
                    slope_y = min((f - f_before) / (y - y_before) + 0.5 * bend_y * (y - y_before), -1e-3)
                break
            if f > 0.0:
                low = y
            else:
                high = y
            if high - low <= 2e-15 * max(1.0, abs(y)):
                found = abs(total - wanted) <= 1e-9 or abs(f) <= 1e-6
                break
            if not bent and high <= bottom:  # even at the buckling load the cable is too short: add the buckled shape
                if lowest > buckling:
                    found = straight = True  # and stretched or compressed to the chord
                break
            if y_before == y_before and y != y_before:
                move = y - y_before
                secant = (f - f_before) / move
                if -50.0 < secant < -1e-3:
                    if span != 0.0 and abs(move) > 1e-6:
                        bend_y = min(max(2.0 * (secant - secant_before) / (move + span), -4.0), 4.0)
                    slope_y = min(secant + 0.5 * bend_y * move, -1e-3)
                    secant_before, span = secant, move
            y_before, f_before = y, f
            move = min(max(-f / slope_y, -4.0), 4.0)
            if abs(move) < 0.5:
                move -= 0.5 * bend_y * move * move / slope_y
            y += move
            if not low < y < high or inner % 12 == 11:
                y = bottom if y <= low and low == bottom else (0.5 * (low + high) if high < top or bent else low + 4.0)
        if mode < 0:
            status = SINGULAR
            break
        if not found:
            if not bent and high <= bottom:
                bent = True
                pushed = plain.copy()
                y, slope_y, bend_y = -math.log(nearest), -1.0, 0.0
                aside = _aside(start, chord < 0.0, direction, plain)
                continue
            status = FAILED
            break
        refined = False
        for _ in range(40):  # finer where the speed is not smooth; the tension stays unless the length changes
            tails(speed, panels, count, tail)
            more = split(tail, panels, count, finest)
            if more == count:
                break
            refined, count = True, more
            if NODES * count > capacity:
                capacity = NODES * (count + count // 2)
                nodes, phi, slope, speed, over = _split_room(np.empty(ROWS * capacity), capacity)
            put_nodes(panels, count, edges, nodes)
            total = measure(mode, par, series, rows, panels, count, edges, direction, nodes, phi, slope, speed, over)
        if refined and not straight:
            f = math.log(total / wanted) if total > 0.0 else _EMPTY
            if abs(f) > max(_REFINED, close) and abs(total - wanted) > 4e-16:
                continue
        status = FOUND
        if loads == 0:
            break
        shift = _move_loads(places, speed, panels, count, edges, mover)
        if shift <= _PLACED:
            break
        laid_mode = -2
    if straight:
        f = 0.0
    info[0], info[1], info[2], info[3], info[4] = z, evaluations, f, total + max(chord, 0.0), wanted + max(chord, 0.0)
    info[5], info[6], info[7] = count, mode, shift
    if status == FOUND and not bent:
        warm[0], warm[1], warm[2], warm[3] = z, slope_y, bend_y, z
    else:
        warm[:] = math.nan
    keep = loads == 0 and status == FOUND and capacity == NODES * KEPT
    laid_out[0], laid_out[1], laid_out[2], laid_out[3] = laid_mode, laid, count if keep else 0.0, age
    if keep:
        for row in range(4):
            for i in range(count):
                kept[row, i] = panels[row, i]
    return status, nodes, phi, slope, speed


@kernel
def _split_room(room, capacity):
    """Positions (3, n), phi (4, n), x' (3, n), speed and its excess (n,) in one array of ROWS n numbers."""
    n = capacity
    return (
        room[: 3 * n].reshape(3, n),
        room[3 * n : 7 * n].reshape(4, n),
        room[7 * n : 10 * n].reshape(3, n),
        room[10 * n : 11 * n],
        room[11 * n : 12 * n],
    )


@kernel
def _move_loads(places, speed, panels, count, edges, mover):
    """Moves the inner edges towards where the arc length has the fractions `places`; returns the largest defect.

    Broyden's method. mover : (k + 3, k) inverse Jacobian, last defect, last step, and whether they are there.
    """
    loads = len(places)
    arc, at_edge = 0.0, np.empty(loads + 2)
    at_edge[0] = 0.0
    for i in range(count):
        part = 0.0
        for j in range(NODES):
            part += WEIGHT[j] * speed[NODES * i + j]
        arc += part * panels[2, i]
        at_edge[int(panels[3, i]) + 1] = arc
    defect, step = at_edge[1 : loads + 1] / arc - places, mover[loads + 1]
    worst = np.max(np.abs(defect))
    inverse, before = mover[:loads], mover[loads]
    if mover[loads + 2, 0] == 0.0:
        for p in range(loads):
            inverse[p, p] = 1.0
        mover[loads + 2, 0] = 1.0
    else:
        change = defect - before
        guess = inverse @ change
        scale = step @ guess
        if abs(scale) > 1e-3 * (step @ step):
            left = step @ inverse
            for p in range(loads):
                for r in range(loads):
                    inverse[p, r] += (step[p] - guess[p]) / scale * left[r]
    for p in range(loads):
        before[p] = defect[p]
    step[:] = -(inverse @ defect)
    room = 1.0  # neighbours keep their order
    for p in range(loads + 1):
        closing = (step[p - 1] if p > 0 else 0.0) - (step[p] if p < loads else 0.0)
        gap = edges[p + 1] - edges[p]
        if closing > 0.7 * gap:
            room = min(room, 0.7 * gap / closing)
    step *= room
    edges[1 : loads + 1] += step
    return worst
