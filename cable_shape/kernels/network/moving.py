"""The elimination of a network that moves: spans condensed by `chain`, knots by the same `graph` as at rest.

:func:`factor` and :func:`solve` stand in for those of `graph`: knots, links and the graph do not know which it was.
"""

from __future__ import annotations

from cable_shape.kernels.network.chain import (
    GYA,
    TAYA,
    TAYB,
    YAYA,
    YBYA,
    YBYB,
    condense,
    expand,
    reduce,
)
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.graph import (
    add9,
    add_block,
    eliminate,
    hold_knots,
    spread,
    steps_of_ends,
    substitute,
    to_knot,
)
from cable_shape.kernels.network.graph import collect as collect_at_rest
from cable_shape.kernels.network.graph import scatter as scatter_at_rest
from cable_shape.kernels.network.motion import Motion, motion_of
from cable_shape.kernels.network.tables import (
    LENGTH,
    Floats,
    Model,
    Plan,
    Whole,
    Work,
    model_of,
    plan_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import FAST, Matrix, add, get3, get9, mul, put3, take3, transpose


@viewing(fastmath=FAST)
def factor(ints: Whole, floats: Floats, space: Floats, moving: Floats, shift: float) -> int:
    """`graph.factor` of a network that moves; shift: of the rotations, as there."""
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    negative = 0
    work.size[:, :] = 0.0
    work.block[:, :] = 0.0
    for j in range(plan.ends.shape[0]):
        negative += condense(plan, model, work, motion, j, shift)
        scatter_at_rest(plan, model, work, j)
        scatter(plan, model, work, motion, j)
    hold_knots(plan, model, work, shift)
    return negative + eliminate(plan, work.size, work.block, work.diagonal)


@viewing(fastmath=FAST)
def solve(ints: Whole, floats: Floats, space: Floats, moving: Floats) -> float:
    """Minus the inverse times the right-hand side G, slack, pull, with the factors at hand.

    Fills d, the steps of the forces and of the knots; returns the largest step: of a rotation, or twice that of a place
    / length.
    """
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    for j in range(plan.ends.shape[0]):
        reduce(plan, work, motion, j)
    collect_at_rest(plan, model, work)
    for j in range(plan.ends.shape[0]):
        collect(plan, work, motion, j)
    substitute(plan, work)
    farthest, largest = spread(plan, model, work), 0.0
    for j in range(plan.ends.shape[0]):
        ta, ya, tb, yb = steps_of_ends(plan, model, work, j, True)
        size = expand(plan, work, motion, j, ta, ya, tb, yb)
        if not size <= largest:
            largest = size
    return max(largest**0.5, 2.0 * farthest**0.5 / model.par[LENGTH])


@viewing(fastmath=FAST, forceinline=True)
def scatter(plan: Plan, model: Model, work: Work, motion: Motion, j: int) -> None:
    """Adds to the graph what of span j concerns the places of its ends."""
    rows, size, block = motion.ends, work.size, work.block
    ta, ya, tb, yb = plan.corners[j, 0], plan.corners[j, 1], plan.corners[j, 2], plan.corners[j, 3]
    for end in range(2):
        way, turn = (ya, ta) if end == 0 else (yb, tb)
        if way >= 0:
            add9(size, way, get9(rows, j, YAYA if end == 0 else YBYB))
        if turn >= 0:
            T = to_knot(plan, model, j, end)
            if ya >= 0:
                add_turn(block, plan.blocks[j, 0 if end == 0 else 3], end, mul(T, get9(rows, j, TAYA + 18 * end)))
            if yb >= 0:
                add_turn(block, plan.blocks[j, 2 if end == 0 else 5], 0, mul(T, get9(rows, j, TAYB + 18 * end)))
    if ya >= 0 and yb >= 0:
        add_block(block, plan.blocks[j, 4], transpose(get9(rows, j, YBYA)))


@inline
def add_turn(block: Floats, place: int, turned: int, M: Matrix) -> None:
    """Adds a block of a rotation's rows and a place's columns; turned: the plan has the place first."""
    add_block(block, place, transpose(M) if turned != 0 else M)


@viewing(fastmath=FAST, forceinline=True)
def collect(plan: Plan, work: Work, motion: Motion, j: int) -> None:
    """Adds to the graph's right-hand side how span j pulls at the places of its ends."""
    for end in range(2):
        way = plan.corners[j, 1 + 2 * end]
        if way >= 0:
            put3(work.gap, way, 0, add(get3(work.gap, way), take3(motion.ends, j, GYA + 3 * end)))
