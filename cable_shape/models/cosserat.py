"""A rod of a batch, solved by itself: for the tube beside a row and the seed of a table (see docs/planning.md).

Every other rod is solved by :mod:`cable_shape.solve`; this goes when batches do, too.
"""

from __future__ import annotations

import math
from time import perf_counter

from cable_shape.models.rod_call import RodCall
from cable_shape.models.rod_solve import Solve
from cable_shape.models.rod_state import RodState
from cable_shape.problem import Problem
from cable_shape.shape import CableShape


def solve(problem: Problem, state: RodState) -> CableShape:
    """The plain rod between the problem's ends from nothing, never for a physical reason without a `status`.

    state : RodState
        A new one of this problem; it takes the solution.
    """
    rod = RodCall(problem, state, math.inf, perf_counter())
    return Solve(rod).run(state.aim(problem.start, problem.end))
