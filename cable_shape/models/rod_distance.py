"""How far a shape in closed form is from the Cosserat rod, found when it is asked for: :class:`RodDistance`."""

from __future__ import annotations

import copy
import math
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.problem import NAMED_TOLERANCE, Problem
from cable_shape.solve import cosserat


@final
class RodDistance:
    """The distance to the rod between the ends that the problem has now, wherever they are when it is asked for.

    own : float
        [m], error of the closed form's own discretisation.
    """

    __slots__ = ("_end", "_own", "_problem", "_start")

    def __init__(self, problem: Problem, own: float) -> None:
        self._problem, self._start, self._end, self._own = problem, problem.start, problem.end, own

    def __call__(self, positions: Array) -> float:
        """[m], of points (n, 3) uniform in arc length: the largest, and the errors of both; infinite: there is no rod.

        The rod is that of model="cosserat" from nothing, at its default tolerance or the problem's, the finer one, and
        counted as off by all of it.
        """
        problem = copy.copy(self._problem).move(self._start, self._end)
        problem.tolerance = min(problem.tolerance, NAMED_TOLERANCE * problem.cable.length)
        rod = cosserat.solve(problem)
        if not rod.status:
            return math.inf
        apart = np.linalg.norm(rod.positions - positions, axis=1).max()
        return float(apart) + problem.tolerance + self._own
