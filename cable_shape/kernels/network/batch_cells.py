"""Which rows of a batch start from the same shape: cells of a fixed lattice in the space of grasps.

A grasp is where the end is seen from the start (3), how the start is turned (3), how the end is turned against it (3,
canonical winding) and, where clips hold the cable, where the start is (3), in units in which a cell is about as wide in
each. The cells are those of A9* (A12* in clips), the dual of the root lattice: integer vectors z of one number more,
projected along (1, ..., 1). A grasp's cell depends on nothing else, so
that a row's answer does not depend on the other rows. The nearest point of the lattice is found by sorting the
remainders after rounding (Conway and Sloane, Sphere packings, lattices and groups, chapter 20).
"""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import qconj, qexp, qlog, qmul

DIMENSIONS, IN_CLIPS = 9, 12
#: The widest relative turn [rad] of a cell's centre: half a turn is where windings meet.
WIDEST = 0.98 * math.pi


@kernel
def normalise(poses: Array, off: Array) -> None:
    """Makes the quaternions of poses (k, 7) unit ones; off (k,): by how much their length was not 1, NaN if bad."""
    for i in range(poses.shape[0]):
        x, y, z, w = poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6]
        length = math.sqrt(x * x + y * y + z * z + w * w)
        off[i] = abs(length - 1.0) + 0.0 * (poses[i, 0] + poses[i, 1] + poses[i, 2])
        for j in range(3, 7):
            poses[i, j] /= length


@kernel
def coordinates(start: Array, end: Array, reach: float, turn: float, x: Array) -> None:
    """Fills x (9,) or (12,) from the two poses (7,); reach [m] and turn [rad] are the units."""
    p = (start[3], start[4], start[5], start[6])
    q = (end[3], end[4], end[5], end[6])
    if p[3] < 0.0:
        p = (-p[0], -p[1], -p[2], -p[3])
    relative = qmul(qconj(p), q)
    if relative[3] < 0.0:
        relative = (-relative[0], -relative[1], -relative[2], -relative[3])
    a, b = qlog(p), qlog(relative)
    for i in range(3):
        x[i], x[3 + i], x[6 + i] = (end[i] - start[i]) / reach, a[i] / turn, b[i] / turn
        if x.shape[0] > DIMENSIONS:
            x[DIMENSIONS + i] = start[i] / reach


@kernel
def nearest(x: Array, key: Array) -> None:
    """The lattice point nearest to x (d,) as key (d,) of whole numbers: z_1 - z_0, ..., z_d - z_0."""
    n = x.shape[0] + 1
    y = np.zeros(n)
    for i in range(1, n):  # an orthonormal basis of the plane across (1, ..., 1)
        c = x[i - 1] / math.sqrt(i * (i + 1.0))
        for j in range(i):
            y[j] += c
        y[i] -= i * c
    z = np.rint(y)
    t = y - z
    order = np.arange(n)
    total = best = 0.0
    for i in range(n):
        total += t[i]
        k = i
        while k > 0 and t[order[k - 1]] < t[i]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = i
    # raising the k largest remainders' coordinates by one: the square of the distance, less what does not change
    change, count = 0.0, 0
    best = -total * total / n
    for k in range(n - 1):
        total -= 1.0
        change += 1.0 - 2.0 * t[order[k]]
        square = change - total * total / n
        if square < best:
            best, count = square, k + 1
    for k in range(count):
        z[order[k]] += 1.0
    for i in range(key.shape[0]):
        key[i] = int(z[i + 1] - z[0])


@kernel
def centre(key: Array, x: Array) -> None:
    """The coordinates x (d,) of a lattice point."""
    n = x.shape[0] + 1
    for i in range(1, n):
        total = 0.0
        for j in range(1, i):
            total += key[j - 1]
        x[i - 1] = (total - i * key[i - 1]) / math.sqrt(i * (i + 1.0))


@kernel(nogil=True)
def keys(starts: Array, ends: Array, reach: float, turn: float, cells: Array) -> None:
    """Fills cells (k, d) with each row's cell."""
    x = np.empty(cells.shape[1])
    for i in range(cells.shape[0]):
        coordinates(starts[i], ends[i], reach, turn, x)
        nearest(x, cells[i])


@kernel
def grasp(key: Array, reach: float, turn: float, longest: float, start: Array, end: Array) -> None:
    """Fills the poses (7,) of a cell's centre, whose chord is at most `longest` [m]; the start is at the origin, or
    where twelve numbers tell."""
    x = np.empty(key.shape[0])
    centre(key, x)
    p = qexp((turn * x[3], turn * x[4], turn * x[5]))
    angle = turn * math.sqrt(x[6] ** 2 + x[7] ** 2 + x[8] ** 2)
    less = turn * min(1.0, WIDEST / angle) if angle > 0.0 else turn
    q = qmul(p, qexp((less * x[6], less * x[7], less * x[8])))
    chord = reach * math.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    near = reach * min(1.0, longest / chord) if chord > 0.0 else reach
    for i in range(3):
        start[i] = reach * x[DIMENSIONS + i] if x.shape[0] > DIMENSIONS else 0.0
        end[i] = start[i] + near * x[i]
    for i in range(4):
        start[3 + i], end[3 + i] = p[i], q[i]
