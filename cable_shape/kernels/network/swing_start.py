"""Where Newton's method starts in a step in time: the last two steps, and what they swerved by, carried on.

Of solutions x_1, x_2, ... in equal steps, the last first, x = 2 x_1 - x_2 + a d_1, with d = x_1 - 2 x_2 + x_3 and the
share a of it that came again the last time: <d_1, d_2> / <d_2, d_2>, 0 to 1. It is near to 1 in what moves smoothly, so
that the error is of third order in the step, and less in what does not.
"""

from __future__ import annotations

import math

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.momentum import LAST_DT, LIKE, LIKE_FORCE, Momentum
from cable_shape.kernels.network.motion import Motion
from cable_shape.kernels.network.predict import extrapolate, follow, is_leaf, turn_ends, turn_knots
from cable_shape.kernels.network.tables import (
    BEFORE,
    NOW,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    solution_of,
    solution_size,
)
from cable_shape.kernels.rod_algebra import get4, qmul, qnormal

#: What is started from: so much of how forces and shape changed in the last step is added to them. What changes fast is
#: no guess: where one does not lead anywhere, the next one may.
STARTS = ((1.0, 1.0), (0.0, 1.0), (-0.5, 1.0), (0.0, 0.0))
SHAKEN = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.01, 1.0, 1.7), (0.1, 2.9, 2.7))  # so among bodies, see `shake`
EQUAL = 1e-9  # of a step in time: such steps are equal


@inline
def is_equal(memory: Momentum, dt: float) -> bool:
    """Whether a step dt [s] is as long as the last one."""
    return abs(dt - memory.par[LAST_DT]) < EQUAL * dt


@viewing(forceinline=True)
def start_from(
    ints: Whole, sols: Floats, plan: Plan, model: Model, motion: Motion, memory: Momentum, forces: float,
    shape: float, swerves: bool,
) -> None:  # fmt: skip
    """Fills the trial, but for the knots that are given, and the forces: the last ones, and so much of their change.

    swerves: and of how that changed.
    """
    sol, now, before = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW), solution_of(ints, sols, BEFORE)
    for e in range(motion.lam.shape[0]):
        for c in range(3):
            motion.lam[e, c] = memory.lam[e, c] + forces * (memory.lam[e, c] - memory.before[e, c])
    follow(plan, now, sol)
    turn_knots(plan, model, before, now, sol, shape)
    extrapolate(plan, before, now, sol, shape)
    if swerves:
        swerve(plan, model, motion, memory, solution_of(ints, memory.swerve, 0), sol)
    turn_ends(plan, model, sol)


@inline
def swerve(plan: Plan, model: Model, motion: Motion, memory: Momentum, way: Solution, sol: Solution) -> None:
    """Adds what is likely to come again of the second differences."""
    a, b = memory.par[LIKE], memory.par[LIKE_FORCE]
    for e in range(motion.lam.shape[0]):
        for c in range(3):
            motion.lam[e, c] += b * memory.swerving[e, c]
    for k in range(sol.q.shape[0]):
        turn_on(sol.q, k, 0, way.q, a)
    for k in range(sol.pose.shape[0]):
        if plan.vertices[k, 1] >= 0 or is_leaf(plan, k):
            for i in range(3):
                sol.pose[k, i] += a * way.pose[k, i]
        if plan.vertices[k, 0] >= 0 and model.loose[k, 0] != 0.0:
            turn_on(sol.pose, k, 3, way.pose, a)


@inline
def shake(plan: Plan, sol: Solution, size: float, one: float, other: float) -> None:
    """Turns the trial's frames inside spans by up to `size` [rad] to and fro, each another way.

    What is straight and pressed buckles, but Newton's method does not leave it: to which side nothing tells. one,
    other: how far [rad] the turns about both directions across are apart from node to node.
    """
    for j in range(plan.ends.shape[0]):
        for node in range(plan.first[j] + j + 1, plan.first[j + 1] + j):
            turn = (0.5 * size * math.sin(one * node), 0.5 * size * math.cos(other * node), 0.0, 1.0)
            q = qnormal(qmul(get4(sol.q, node), turn))
            sol.q[node, 0], sol.q[node, 1], sol.q[node, 2], sol.q[node, 3] = q


@inline
def turn_on(rows: Floats, k: int, c: int, ways: Floats, a: float) -> None:
    """Adds a times a difference to the quaternion in row k from column c on."""
    x, y, z, w = rows[k, c], rows[k, c + 1], rows[k, c + 2], rows[k, c + 3]
    p = (x + a * ways[k, c], y + a * ways[k, c + 1], z + a * ways[k, c + 2], w + a * ways[k, c + 3])
    rows[k, c], rows[k, c + 1], rows[k, c + 2], rows[k, c + 3] = qnormal(p)


@viewing(forceinline=True)
def note_swerve(ints: Whole, sols: Floats, motion: Motion, memory: Momentum, dt: float) -> None:
    """Takes over how the trial, after a step dt [s], and its forces differ from the last two carried on straight."""
    size = solution_size(ints)
    even = 1.0 if is_equal(memory, dt) else 0.0
    both = old = 0.0
    for i in range(size):
        d = even * (sols[2 * size + i] - 2.0 * sols[i] + sols[size + i])
        both, old = both + d * memory.swerve[i], old + memory.swerve[i] * memory.swerve[i]
        memory.swerve[i] = d
    memory.par[LIKE] = share(both, old)
    both = old = 0.0
    for e in range(motion.lam.shape[0]):
        for c in range(3):
            d = even * (motion.lam[e, c] - 2.0 * memory.lam[e, c] + memory.before[e, c])
            both, old = both + d * memory.swerving[e, c], old + memory.swerving[e, c] * memory.swerving[e, c]
            memory.swerving[e, c] = d
    memory.par[LIKE_FORCE] = share(both, old)


@inline
def share(both: float, old: float) -> float:
    """both / old, 0 to 1."""
    return min(max(both / old, 0.0), 1.0) if old > 0.0 else 0.0
