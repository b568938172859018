"""A shape in contact solved again on finer meshes, each starting from the last one: the same branch, to judge it by."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import cable_shape as cs
from cable_shape.kernels.network.tables import NOW
from cable_shape.solve.network import Network
from cable_shape.solve.touching import touching
from cable_shape.solve.touching.touch_state import TouchState

NEARBY = 0.05  # rad that a frame may turn where a mesh is halved, at least: further away lies another branch
ITERATIONS = 100


def finer(state: TouchState, halvings: int, nearby: float = NEARBY) -> cs.CableShape | None:
    """The last solution of `state`, which stays as it is, on a mesh halved so often; None if its branch is lost."""
    problem = state.problem
    fine = TouchState(problem)
    fine.aim(problem.start, problem.end)
    fine.restore(state.copy())
    frames = fine.grips[NOW].copy()
    solver = touching.Solve(problem, fine, Network(problem), math.inf, 0.0)
    for _ in range(halvings):
        nodes = fine.nodes
        fine.lay_out(np.sort(np.concatenate((nodes, 0.5 * (nodes[1:] + nodes[:-1])))))
        fine.target(frames)
        if not (solver.steps.again(ITERATIONS, far=nearby) and solver.steps.settle(frames)):
            return None
    return solver._finish(cs.Status.OK)


def force_on(shape: cs.CableShape) -> dict[str, Any]:
    """Force of each body on the cable [N], (3,)."""
    sums: dict[str, Any] = {}
    for contact in shape.contacts:
        sums[contact.body] = sums.get(contact.body, 0.0) + contact.force * contact.normal
    return sums


def compared(shape: cs.CableShape, fine: cs.CableShape) -> tuple[float, float]:
    """Largest distance [m] at equal arc length, and largest difference of a body's force over the largest force."""
    a, b = force_on(shape), force_on(fine)
    size = max((float(np.linalg.norm(force)) for force in b.values()), default=math.inf)
    apart = max((float(np.linalg.norm(a.get(name, 0.0) - b.get(name, 0.0))) for name in a | b), default=0.0)
    return float(np.linalg.norm(shape.positions - fine.positions, axis=1).max()), apart / size
