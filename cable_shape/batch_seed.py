"""The shape that the rows of a batch in one coarse cell start from: :func:`seed_at`."""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import response, rod_drive
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.models import cosserat
from cable_shape.models.rod_state import RodState
from cable_shape.pose import Pose
from cable_shape.problem import Problem
from cable_shape.shape import Status

#: A cell's mesh is made for this fraction of the tolerance, so that it does for the rows around, too.
MESH_TOLERANCE = 0.4
#: Guesses (see `rod_drive.guess`) that tell of other stable shapes; those whose frames differ by so much [rad] are.
GUESSES = ((0, 0.0), (1, 0.3))
OTHER = 0.2
_MOST_ITERATIONS = 80
_ANYWHERE = 7.0  # rad
_MODE_STEPS = 20


class Seed(NamedTuple):
    """One solved shape: its memory with fresh factors, its softest mode, and whether there are other stable shapes."""

    state: RodState
    mode: Array  # (N+1, 3)
    loads: tuple[Array, ...]  # what `rod_drive.lay_out` takes from `stops` on
    several: bool


def seed_at(problem: Problem, start: Array, end: Array) -> Seed | None:
    """The shape between two poses (7,), from nothing; None if there is no stable one within tolerance."""
    problem = copy.copy(problem)  # several threads may make one at once
    state = RodState(problem)
    if cosserat.solve(problem.move(Pose.trusted(start), Pose.trusted(end)), state).status is not Status.OK:
        return None
    several = _has_several(state)
    mode = np.random.default_rng(0).normal(size=(state.elements + 1, 3))
    rod = state.par, state.mesh, state.sol, state.work, state.elements, state.width
    response.smallest_eigenvalue(*rod, mode, _MODE_STEPS, True)
    kept = (state.stops, problem.load, state.points, state.weights, np.zeros(3), state.table)
    return Seed(state, mode, tuple(np.array(a, dtype=np.float64, order="C") for a in kept), several)


def _has_several(state: RodState) -> bool:
    """Whether guesses lead to other stable shapes between the ends of the last solution than to that one."""
    n = state.elements
    kept, mesh = state.sol.copy(), state.mesh.copy()
    info, ends = np.empty(rod_drive.INFO), state.ends.copy()
    frames = kept[: 4 * n + 4].reshape(n + 1, 4)
    force, _ = state.hanging(ends)
    found = False
    for kind, sag in GUESSES:
        state.sol[:] = kept
        state.start_from(ends, force, kind, sag)
        if _solved(state, info):
            other = state.sol[: 4 * n + 4].reshape(n + 1, 4)
            found = found or float(np.abs((other * frames).sum(axis=1)).min()) < math.cos(0.5 * OTHER)
    state.sol[:], state.mesh[:] = kept, mesh  # the mesh has the error of each element
    return found


def _solved(state: RodState, info: Array) -> bool:
    """Whether the trial leads to a stable shape, which then is the solution now."""
    code = rod_drive.solve(
        state.par, state.mesh, state.sol, state.work, np.empty(0), info, state.elements, state.width, 0, 0, True,
        _MOST_ITERATIONS, _ANYWHERE,
    )  # fmt: skip
    return bool(code == CONVERGED) and info[rod_drive.EXCESS] == 0.0
