"""How far a shape in closed form is from the Cosserat rod, found when it is asked for."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import partial

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip
from cable_shape.solve import cosserat
from cable_shape.solve.problem import NAMED_TOLERANCE, Problem


def rod_distance(problem: Problem, own: float) -> Callable[[Array], float]:
    """What gives the distance to the rod between the ends that the problem has now, wherever they are when it is asked.

    own : float
        [m], error of the closed form's own discretisation.
    """
    return partial(_measured, problem, problem.start, problem.end, own)


def _measured(problem: Problem, start: Grip, end: Grip | FreeEnd, own: float, positions: Array) -> float:
    """[m], of points (n, 3) uniform in arc length: the largest, and the errors of both; infinite: there is no rod.

    The rod is that of model="cosserat" from nothing, at its default tolerance or the problem's, the finer one, and
    counted as off by all of it.
    """
    there = copy.copy(problem).move(start, end)
    there.tolerance = min(problem.tolerance, NAMED_TOLERANCE * problem.cable.length)
    rod = cosserat.solve(there)
    if not rod.status:
        return math.inf
    apart = np.linalg.norm(rod.positions - positions, axis=1).max()
    return float(apart) + there.tolerance + own
