"""A whole motion of a swinging network in one call: where its nodes are after each step."""

from __future__ import annotations

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.momentum import momentum_of
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.kernels.network.swinging import step
from cable_shape.kernels.network.tables import Floats, Whole, copy_rows


@kernel
def run(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, remembered: Floats, goals: Floats,
    steps: Floats, kept: Floats, info: Floats, scratch: Floats, places: Floats, tangents: Floats, velocities: Floats,
) -> int:  # fmt: skip
    """Steps steps (T,) [s] to the knots goals (T, k, 7); returns how many were lost, with the state kept.

    Fills places (T, n, 3), tangents (T, n, 3) and velocities (T, n, 3) of the nodes after each.
    """
    memory = momentum_of(ints, remembered)
    lost = 0
    for i in range(steps.shape[0]):
        if step(ints, floats, sols, space, moving, remembered, goals[i], steps[i], kept, info, scratch) != CONVERGED:
            lost += 1
        copy_rows(places[i], memory.place, 3)
        copy_rows(tangents[i], memory.tangent, 3)
        copy_rows(velocities[i], memory.velocity, 3)
    return lost
