"""The quasistatic Cosserat rod: geometrically exact, of sixth order, warm-started (see docs/method.md).

    r' = R V,  R' = R hat(u),  n' + f = 0,  m' + r' x n = 0,
    V = e3 + diag(1/GA, 1/GA, 1/EA) R^T n,  R^T m = diag(EI1, EI2, GJ) (u - u0)

with the frame R (columns d1, d2, d3), the Darboux vector u and the rest curvature u0 in the cable frame, and the force
n and moment m that the far side exerts, in world axes. Unknown are the rotations of the nodes, the force at the end of
every span, and what knots leave free; positions follow. After the geometrically exact rod of Simo, and the discrete
rods on quaternions of Lang, Linn and Arnold; the element is described in :mod:`cable_shape.kernels.rod_element`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.checks import Array
from cable_shape.shape import CableShape, Status
from cable_shape.solve.answers import sensitivity
from cable_shape.solve.moving import settled
from cable_shape.solve.network import Network
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.problem import Problem, longest_delay
from cable_shape.solve.search import FAR, WARM_ITERATIONS, Search

__all__ = ["MODEL", "sensitivity", "smallest_eigenvalue", "solve", "solve_beside"]


def solve(problem: Problem, state: Network | None = None, *, deadline: float = math.inf) -> CableShape:
    """The rod between the problem's ends and in its clips.

    Parameters
    ----------
    problem : Problem
        Its ends may have moved since the last call; it may also be another problem.
    state : Network, optional
        Kept from the last call: warm start. It takes the new solution. None: cold.
    deadline : float
        [s], of ``time.perf_counter``: checked between attempts; after it the best shape is returned, graded BUDGET
        within tolerance and BUDGET_EXCEEDED otherwise.

    Raises
    ------
    ArgumentError
        If the bending stiffness is 0. Never for a physical reason: see `status`.
    """
    if state is None:
        state = Network(problem)
    if problem.velocity is None or problem.lag is not None or longest_delay(problem.cable) == 0.0:
        return _solve(problem, state, deadline)
    return settled(problem, state, lambda one: _solve(one, state, deadline))


def _solve(problem: Problem, state: Network, deadline: float) -> CableShape:
    """The same under damping as it is."""
    began = perf_counter()
    last = state.problem
    if last is not problem:
        state.take(problem)
    poses = state.aim(problem.start, problem.end, trial=state.history > 0)
    search = Search(problem, state, deadline, began, last)
    followed = state.history > 0 and search.call(state.history, WARM_ITERATIONS, far=FAR)
    if followed and search.final:
        state.settle()
        return search.shape(Status.OK, "")
    return search.run(poses, followed)


def solve_beside(
    problem: Problem,
    state: Network,
    frames: Callable[[Array], Array],
    force: ArrayLike = (0.0, 0.0, 0.0),
    *,
    fineness: float = 2.0,
) -> CableShape:
    """The equilibrium next to given frames, stable (OK) or not (UNSTABLE): no branch is sought.

    Parameters
    ----------
    frames : callable
        Arc lengths (k,) [m] to quaternions (k, 4), x y z w, whose signs follow one another along the cable.
    force : (3,) array_like
        [N], world: about the force at the end.
    fineness : float
        Elements of the first mesh in terms of those of a cold start.
    """
    if state.problem is not problem:
        state.take(problem)
    search = Search(problem, state, math.inf, perf_counter())
    return search.beside(frames, np.asarray(force, dtype=np.float64), fineness)


def smallest_eigenvalue(state: Network) -> float:
    """[N], of the last solution's second variation under its constraints, against the integral of |rotation|^2."""
    return state.smallest_eigenvalue()
