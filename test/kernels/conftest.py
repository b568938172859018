"""What tests of planes share: a thick cable that hangs between two grips, in motion against drag."""

from __future__ import annotations

import pytest

import cable_shape as cs
from cable_shape.kernels.network.tables import NOW
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.settle import Settling

ALONG_X = (0.5, 0.5, 0.5, 0.5)


@pytest.fixture(scope="module")
def settling() -> Settling:
    cable = cs.Cable(1.0, 0.05, 2e-3, diameter=0.008)
    problem = Problem(cable).move(cs.Pose((0, 0, 0), ALONG_X), cs.Pose((0.7, 0.1, 0.1), ALONG_X))
    state = Network(problem)
    assert cosserat.solve(problem, state).status is cs.Status.OK
    return Settling(state.ints, state.floats, state.sols, NOW)
