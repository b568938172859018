"""How well a shape is known, point by point, to first order: the radius of its tube."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import apply, get4, rotation
from cable_shape.kernels.rod_answer import answers
from cable_shape.kernels.rod_drive import NOW, slot
from cable_shape.kernels.rod_sensitivity import sensitivity
from cable_shape.kernels.rod_stability import refresh
from cable_shape.kernels.tube import radius_of

Array = Any
#: Known: what makes up a tube, the same for all rows of a batch.
POSES, TWISTS, STIFF, LENGTHS, TABLES, STEPS, SQUARES, MISSES = 0, 1, 2, 3, 4, 5, 6, 7


@kernel
def to_world(twists: Array, q: Array, elements: int, out: Array) -> None:
    """Fills out (12, k) with twists (12, k) of both ends, cable frames, in world axes."""
    for end in range(2):
        R = rotation(get4(q, elements * end))
        for part in range(2):
            o = 6 * end + 3 * part
            for c in range(twists.shape[1]):
                out[o, c], out[o + 1, c], out[o + 2, c] = apply(R, (twists[o, c], twists[o + 1, c], twists[o + 2, c]))


@kernel
def tube(
    par: Array, mesh: Array, sol: Array, work: Array, elements: int, width: int, buffer: Array, points: int,
    known: tuple[Array, ...], meshes: Array, moves: Array, shifts: Array, radius: Array,
) -> None:  # fmt: skip
    """Fills radius (points,) [m] of the solution now, sampled in `buffer` (17 points); refreshes the factors.

    known: see POSES to MISSES: steps of one standard deviation of both ends' twists (12, p), world axes, and of further
    directions (12, k), in the cable frames, the first of which change the cable, too, as `stiff`, meshes and steps say
    (see `rod_answer.answers`; lengths and rest curvature are in `meshes`); squares (r,) of the radius that holds a
    normal vector by the ratio of its standard deviations, 0 to 1; misses (1,) [m], which join in quadrature.
    moves (points, 3, 12) and shifts (points, 3, k): room for the sensitivities.
    """
    poses, twists, steps, squares = known[POSES], known[TWISTS], known[STEPS], known[SQUARES]
    q, _, _ = slot(sol, elements, NOW)
    free, total = poses.shape[1], poses.shape[1] + twists.shape[1]
    ways = np.zeros((12, total))
    ways[:, :free] = poses
    to_world(twists, q, elements, ways[:, free:])
    first, last = np.full(total + 1, 12), np.zeros(total + 1, np.int64)  # of what is not 0 in each
    for c in range(total):
        for a in range(12):
            if ways[a, c] != 0.0:
                first[c], last[c] = min(first[c], a), a + 1
    if last.max() > 0:
        sensitivity(par, mesh, sol, work, elements, width, points, moves)
    else:
        refresh(par, mesh, sol, work, elements, width, True)
    answers(par, mesh, sol, work, elements, width, known[STIFF], meshes, steps, points, shifts)
    for i in range(points):
        j = 4 * points + 4 * i
        R = rotation((buffer[j], buffer[j + 1], buffer[j + 2], buffer[j + 3]))
        xx = xy = yy = 0.0
        for c in range(total):
            m0 = m1 = m2 = 0.0
            for a in range(first[c], last[c]):
                m0 += moves[i, 0, a] * ways[a, c]
                m1 += moves[i, 1, a] * ways[a, c]
                m2 += moves[i, 2, a] * ways[a, c]
            if 0 <= c - free < steps.shape[0]:
                m0 += shifts[i, 0, c - free]
                m1 += shifts[i, 1, c - free]
                m2 += shifts[i, 2, c - free]
            x, y = R[0] * m0 + R[3] * m1 + R[6] * m2, R[1] * m0 + R[4] * m1 + R[7] * m2
            xx += x * x
            xy += x * y
            yy += y * y
        radius[i] = radius_of(xx, xy, yy, known[MISSES][0], squares)
