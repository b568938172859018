"""A gradient cable of given tension: boundary conditions in, rows of the solution out.

Kinds of ends, with their conditions (the third for the 6th order only):
    CLAMPED  x, x', x'' given;
    PINNED   x given, x'' - c x'''' = 0 (no moment), x''' = 0;
    FREE     n = z x' - x''' + c x^(5) = tip force, x'' - c x'''' = tip moment x x', x''' = 0.
PINNED and FREE are the natural conditions of the energy 1/2 (z |x'|^2 + |x''|^2 + c |x'''|^2) less the work of the
loads. Lengths are divided by L, forces by B / L^2, moments by B / L.
"""

from __future__ import annotations

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.gradient_basis import ROW, choose, derivatives_at_ends, functions
from cable_shape.kernels.gradient_rows import anchor, columns, concentrated, distributed, force_columns, spread

CLAMPED, PINNED, FREE = 0, 1, 2

#: Rows of the scratch array of :func:`assemble`, 10 numbers each.
WORK = 9


@kernel
def product(table, i, d, row):
    """Derivative `d` of a row at the end `i`."""
    total = 0.0
    for w in range(ROW):
        total += table[i, d, w] * row[w]
    return total


@kernel
def replace_conditions(kinds, c, table):
    """Conditions 0, 1 and 2 of each end take the places of its derivatives 0, 1 and 2."""
    for i in range(2):
        if kinds[i] != CLAMPED:
            for w in range(ROW):
                table[i, 1, w] = table[i, 2, w] - c * table[i, 4, w]
                table[i, 2, w] = table[i, 3, w]


@kernel
def eliminate(matrix, n, columns):
    """Solves, in place, for the right-hand sides in columns n to n + columns: row scaling, partial pivoting.

    Returns False for a singular matrix.
    """
    width = n + columns
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(matrix[i, j]))
        if not 0.0 < largest < np.inf:
            return False
        scale = 1.0 / largest
        for j in range(width):
            matrix[i, j] *= scale
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[p, k]):
                p = i
        if matrix[p, k] == 0.0:
            return False
        if p != k:
            for j in range(k, width):
                matrix[k, j], matrix[p, j] = matrix[p, j], matrix[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, n):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, width):
                    matrix[i, j] -= factor * matrix[k, j]
    for k in range(n - 1, -1, -1):
        inverse = 1.0 / matrix[k, k]
        for j in range(n, width):
            value = matrix[k, j]
            for i in range(k + 1, n):
                value -= matrix[k, i] * matrix[i, j]
            matrix[k, j] = value * inverse
    return True


@kernel
def assemble(z, c, kinds, given, tip_moment, load, edges, point_load, work, table, par, series, rows, force):
    """The cable for the tension `z`: rows of x on every piece between concentrated loads, and its force.

    Parameters
    ----------
    c : float
        (gradient length / L)^2; 0: 4th order.
    kinds : (2,)
        CLAMPED, PINNED or FREE at the start and the end.
    given : (2, 3, 3)
        [end, condition, component]: right-hand sides, in the order of the module's docstring.
    tip_moment : (3,)
        Of a free end.
    load : (2, 3)
        Distributed load: q0 (at the middle) and q1.
    edges : (pieces + 1,)
        0, the places of the concentrated loads, 1.
    point_load : (pieces - 1, 3)
        Concentrated loads at the inner edges.
    work : (WORK, 10)
        Scratch; rows 0 to 5 are the linear system, then its solution.
    table : (2, 5, ROW)
        Scratch.
    par : (PARAMETERS,), series : (4, SERIES_TERMS)
        Out: the mode's parameters.
    rows : (pieces, 3, ROW)
        Out.
    force : (3,)
        Out: n(s) = force - q0 u - q1 u^2 / 2 - concentrated loads passed.

    Returns
    -------
    int
        The mode; -1 if the conditions are singular.
    """
    mode = choose(z, c, par, series)
    last = len(edges) - 2
    size = 4 if c == 0.0 else 6
    half = size // 2
    row = work[6]
    place, factor, at_middle = distributed(mode, par)
    ends_table(mode, par, series, 1.0, table)
    with_moment = kinds[1] == FREE and (tip_moment[0] != 0.0 or tip_moment[1] != 0.0 or tip_moment[2] != 0.0)
    if with_moment:
        columns(mode, par, table[1, 1], work, 7)
    for k in range(3):
        force[k] = load[1, k] * at_middle
        work[8, k] = factor * (load[0, k] * table[1, 1, place] + load[1, k] * table[1, 1, place + 1])
    replace_conditions(kinds, c, table)
    for i in range(2):
        for r in range(half):
            e = i * half + r
            if r == 0 and kinds[i] == FREE:
                force_columns(mode, par, work, e)
                for k in range(3):
                    work[e, size + k] = given[i, r, k] - load[1, k] * (at_middle - 0.125) + 0.5 * load[0, k]
                continue
            columns(mode, par, table[i, r], work, e)
            v0, v1 = factor * table[i, r, place], factor * table[i, r, place + 1]
            for k in range(3):
                work[e, size + k] = given[i, r, k] - load[0, k] * v0 - load[1, k] * v1
    if last > 0:
        _load_ends(mode, c, kinds, edges, point_load, work, table, par, series, half, force)
    if with_moment:
        work[:6, size + 3] = 0.0
        work[half + 1, size + 3] = 1.0
    if not eliminate(work, size, 4 if with_moment else 3):
        return -1
    if with_moment:
        _turn_tip(size, work, tip_moment)
    for p in range(last + 1):
        for k in range(3):
            n = spread(mode, par, work, size, k, rows[p, k])
            if p == 0:
                force[k] += n
            if last > 0:
                anchor(mode, par, edges[p], edges[p + 1], rows[p, k])
            rows[p, k, place] += factor * load[0, k]
            rows[p, k, place + 1] += factor * load[1, k]
        for j in range(last):
            concentrated(mode, par, series, edges[j + 1], j < p, edges[p], edges[p + 1], row)
            for k in range(3):
                for w in range(ROW):
                    rows[p, k, w] += point_load[j, k] * row[w]
    return mode


@kernel
def ends_table(mode, par, series, reach, table):
    """Derivatives of the 8 functions of a row at both ends of the cable, into `table`.

    The exponentials are anchored at the end itself and at the distance `reach`: 1, the other end, or 0, the same end.
    """
    ends, phi = np.empty((3, 2)), np.zeros((4, 2))
    ends[0, 0], ends[1, 0], ends[2, 0] = -0.5, 0.0, reach
    ends[0, 1], ends[1, 1], ends[2, 1] = 0.5, reach, 0.0
    functions(mode, par, series, ends, 0, 2, phi)
    derivatives_at_ends(mode, par, phi, table)


@kernel
def _load_ends(mode, c, kinds, edges, point_load, work, table, par, series, half, force):
    """What concentrated loads add to the right-hand sides, to the force and (``work[8]``) to the tip's slope."""
    row, size = work[6], 2 * half
    ends_table(mode, par, series, 0.0, table)
    for j in range(len(point_load)):
        concentrated(mode, par, series, edges[j + 1], True, 1.0, 1.0, row)
        slope = product(table, 1, 1, row)
        for k in range(3):
            work[8, k] += point_load[j, k] * slope
    replace_conditions(kinds, c, table)
    for i in range(2):
        for j in range(len(point_load)):
            n = concentrated(mode, par, series, edges[j + 1], i == 1, float(i), float(i), row)
            if i == 0:
                for k in range(3):
                    force[k] += point_load[j, k] * n
            for r in range(half):
                value = n if r == 0 and kinds[i] == FREE else product(table, i, r, row)
                for k in range(3):
                    work[i * half + r, size + k] -= point_load[j, k] * value


@kernel
def _turn_tip(size, work, moment):
    """Adds the response to y = x'' - c x'''' at the tip, y = moment x x', x' = a + b y: linear in y.

    ``work[7]`` has the slopes of the homogeneous solutions at the tip, ``work[8]`` that of the loads' solutions.
    """
    a, b = work[8, :3], 0.0
    for j in range(size):
        b += work[7, j] * work[j, size + 3]
        for k in range(3):
            a[k] += work[7, j] * work[j, size + k]
    square = moment[0] ** 2 + moment[1] ** 2 + moment[2] ** 2
    g = np.cross(moment, a)
    y = (g + b * np.cross(moment, g)) / (1.0 + b * b * square)
    for j in range(size):
        for k in range(3):
            work[j, size + k] += work[j, size + 3] * y[k]
