"""What models of the rod share: the straight line, sensitivities about grippers, patience with what takes long."""

from __future__ import annotations

import math
from time import perf_counter
from typing import final

from cable_shape.checks import Array
from cable_shape.kernels.frames import straight
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem

MODEL = "cosserat"
_LONGEST_WAIT = 16


def straight_line(
    problem: Problem,
    buffer: Array,
    first: Array,
    last: Array,
    status: Status,
    detail: str,
    iterations: int,
    began: float,
) -> CableShape:
    """The straight line from frame `first` (7,) to `last` (7,), for want of a shape; `buffer` becomes its own."""
    roll = straight(first, last, problem.cable.length, problem.points, buffer)
    return CableShape(
        buffer,
        problem.points,
        length=problem.cable.length,
        model=MODEL,
        status=status,
        detail=detail,
        error_estimate=math.inf,
        residual=math.inf,
        iterations=iterations,
        solve_time=perf_counter() - began,
        roll_error=float(roll),
    )


@final
class Patience:
    """How many solves pass before what takes long is tried again where it has failed: 1, 2, 4, at most 16."""

    def __init__(self) -> None:
        self.left = 0  #: solves that are still to pass
        self._next = 1

    def fail(self) -> None:
        """It has failed once more."""
        self.left, self._next = self._next, min(2 * self._next, _LONGEST_WAIT)

    def succeed(self) -> None:
        """It has not failed, or is to be tried again at once."""
        self.left, self._next = 0, 1
