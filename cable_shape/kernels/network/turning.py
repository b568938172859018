"""How the frames of the last solution turn with what holds the cable: beside `respond`, which tells how points move."""

from __future__ import annotations

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.respond import answer, move_knots, still
from cable_shape.kernels.network.tables import Floats, Whole, work_of
from cable_shape.kernels.rod_algebra import get3


@kernel
def turns(ints: Whole, floats: Floats, sols: Floats, space: Floats, knots: Whole, out: Floats) -> None:
    """Fills out (6 g, nodes, 3): rotation of the nodes, own frames, with the poses of `knots` (g,).

    Rows: velocity and angular velocity of each knot, world axes, about the knot. The matrix must be factored
    (`respond.refresh`). Eyelets stay where they are on the cable.
    """
    twists = np.zeros((ints[2], 6))
    for g in range(knots.shape[0]):
        for axis in range(6):
            twists[:, :] = 0.0
            twists[knots[g], axis] = 1.0
            row_of(ints, floats, sols, space, twists, 6 * g + axis, out)


@viewing
def row_of(ints: Whole, floats: Floats, sols: Floats, space: Floats, twists: Floats, row: int, out: Floats) -> None:
    """One row of `turns`."""
    still(ints, space)
    move_knots(ints, floats, sols, space, twists)
    answer(ints, floats, sols, space, twists)
    work = work_of(ints, space)
    for k in range(out.shape[1]):
        d = get3(work.d, k)
        out[row, k, 0], out[row, k, 1], out[row, k, 2] = d
