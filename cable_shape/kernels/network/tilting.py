"""How the last solution answers what turns ends of spans in the knots that they are tied to, see :mod:`.respond`."""

from __future__ import annotations

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import part, viewing
from cable_shape.kernels.network.graph import lead, solve
from cable_shape.kernels.network.respond import pull_change, spread, still, turn_end
from cable_shape.kernels.network.system import NONE, release
from cable_shape.kernels.network.tables import TRIAL, Floats, Whole, model_of, plan_of, solution_of, work_of
from cable_shape.kernels.rod_algebra import add, get3, put3


@kernel
def tilts(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, points: int, ends: Whole, out: Floats, df: Floats
) -> None:
    """Fills out (c points, 3, 3 g): change of the positions at fixed arc length with the frames of `ends` (g, 2).

    ends: span, and 0 for its start, 1 for its end, which is tied to its knot. Columns: the end turning in the knot,
    angular velocity in its own frame. df (e, 3 g): change of the pull of the eyelets, see `respond.eyelets`. The matrix
    must be factored (`respond.refresh`).
    """
    jumps = np.zeros((ints[1], 3))
    for g in range(ends.shape[0]):
        for axis in range(3):
            column_of(ints, floats, sols, space, points, ends[g, 0], ends[g, 1], axis, jumps, 3 * g + axis, out, df)


@viewing
def column_of(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, points: int, j: int, end: int, axis: int, jumps: Floats,
    column: int, out: Floats, df: Floats,
) -> None:  # fmt: skip
    """One column of `tilts`."""
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    turn = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
    node = plan.first[j + end] + j
    still(ints, space)
    turn_end(plan, model, work, j, end, turn, -0.5)
    release(plan, model, work.G)
    solve(ints, floats, space)
    put3(work.d, node, 0, add(get3(work.d, node), turn))
    for k in range(work.move.shape[0]):
        if plan.vertices[k, 1] < 0:
            put3(work.move, k, 3, NONE)
    lead(plan, work)
    for c in range(df.shape[0]):
        df[c, column] = pull_change(plan, model, sol, work, c)
    spread(ints, floats, sols, space, points, out, column, jumps, part(space, 0, (0,)), part(space, 0, (0, 6)))
