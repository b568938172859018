"""How well a shape is known, point by point, to first order: the radius of its tube."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.respond import answers, refresh, sensitivities
from cable_shape.kernels.network.tables import NOW, Floats, Whole, solution_of
from cable_shape.kernels.rod_algebra import apply, get4, rotation
from cable_shape.kernels.safety.spread import radius_of


class Known(NamedTuple):
    """What makes up a tube, the same for all rows of a batch."""

    poses: Floats  # (12, p) steps of one standard deviation of both ends' twists, world axes
    twists: Floats  # (12, k) of further directions, in the cable frames; the first of them change the cable, too
    steps: Floats  # (c,) steps by which they do
    models: Floats  # (2 c, size) models with one element a span of a cable above and one below, see `respond.answers`
    before: Floats  # (a,) [m] arc lengths that stay at supports and loads, or at their share of the length
    after: Floats  # (2 c, a) [m] where they are on the changed cables
    squares: Floats  # (r,) of the radius that holds a normal vector by the ratio of its standard deviations, 0 to 1
    misses: float  # [m], which join in quadrature


@viewing
def to_world(twists: Floats, ints: Whole, sols: Floats, out: Floats) -> None:
    """Fills out (12, k) with twists (12, k) of both ends, cable frames, in world axes."""
    q = solution_of(ints, sols, NOW).q
    for end in range(2):
        R = rotation(get4(q, end * (q.shape[0] - 1)))
        for part in range(2):
            o = 6 * end + 3 * part
            for c in range(twists.shape[1]):
                out[o, c], out[o + 1, c], out[o + 2, c] = apply(R, (twists[o, c], twists[o + 1, c], twists[o + 2, c]))


@kernel
def tube(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, buffer: Floats, points: int, known: Known, models: Floats,
    moves: Floats, shifts: Floats, radius: Floats,
) -> None:  # fmt: skip
    """Fills radius (points,) [m] of the solution now, sampled in `buffer` (17 points); refreshes the factors.

    models (2 c, size): those of `known` on the mesh at hand. moves (points, 3, 12) and shifts (points, 3, c): room for
    the sensitivities.
    """
    poses, twists = known.poses, known.twists
    free, total = poses.shape[1], poses.shape[1] + twists.shape[1]
    ways = np.zeros((12, total))
    ways[:, :free] = poses
    to_world(twists, ints, sols, ways[:, free:])
    first, last = np.full(total + 1, 12), np.zeros(total + 1, np.int64)  # of what is not 0 in each
    for c in range(total):
        for a in range(12):
            if ways[a, c] != 0.0:
                first[c], last[c] = min(first[c], a), a + 1
    refresh(ints, floats, sols, space, True)
    if last.max() > 0:
        knots = np.array((0, ints[2] - 1))
        sensitivities(ints, floats, sols, space, points, knots, moves, np.empty((0, 12)))
    if known.steps.shape[0] > 0:
        answers(ints, floats, models, known.steps, sols, space, points, shifts, np.empty((0, known.steps.shape[0])))
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
            if 0 <= c - free < known.steps.shape[0]:
                m0 += shifts[i, 0, c - free]
                m1 += shifts[i, 1, c - free]
                m2 += shifts[i, 2, c - free]
            x, y = R[0] * m0 + R[3] * m1 + R[6] * m2, R[1] * m0 + R[4] * m1 + R[7] * m2
            xx += x * x
            xy += x * y
            yy += y * y
        radius[i] = radius_of(xx, xy, yy, known.misses, known.squares)
