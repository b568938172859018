"""A rod of a batch, solved by itself: for the tube beside a row and the seed of a table (see docs/planning.md).

Every other rod is solved by :mod:`cable_shape.solve`; this goes when batches do, too.
"""

from __future__ import annotations

import math
from time import perf_counter

from cable_shape.errors import ArgumentError
from cable_shape.models.rod_call import FAR, WARM_ITERATIONS, RodCall
from cable_shape.models.rod_common import MODEL
from cable_shape.models.rod_solve import Solve
from cable_shape.models.rod_state import RodState
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status

__all__ = ["MODEL", "solve"]


def solve(problem: Problem, state: RodState | None = None, *, deadline: float = math.inf) -> CableShape:
    """The rod between the problem's ends.

    Parameters
    ----------
    problem : Problem
        Its ends may have moved since the last call; it may also be another problem.
    state : RodState, optional
        Kept from the last call: warm start. It takes the new solution. None: cold.
    deadline : float
        [s], of ``time.perf_counter``: checked between attempts; after it the best shape is returned, graded BUDGET
        within tolerance and BUDGET_EXCEEDED otherwise.

    Raises
    ------
    ArgumentError
        If the bending stiffness is 0, or the scene has clips. Never for a physical reason: see `status`.
    """
    began = perf_counter()
    if problem.scene is not None and problem.scene.clips:
        raise ArgumentError.of(
            "scene.clips", len(problem.scene.clips), "this solver knows none", "Give the scene to a Predictor."
        )
    if state is None:
        state = RodState(problem)
    elif state.problem is not problem:
        state.take(problem)
    rod = RodCall(problem, state, deadline, began)
    ends = state.aim(problem.start, problem.end, trial=state.history > 0)
    followed = state.history > 0 and rod.solve(state.history, WARM_ITERATIONS, far=FAR)
    if followed and rod.final:
        state.settle()
        return rod.shape(Status.OK, "")
    return Solve(rod).run(ends, followed)
