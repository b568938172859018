"""A cable in contact of which the length is another one than before, by a little: it is followed, not laid anew."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.prediction import solvers
from cable_shape.solve.problem import Problem

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.0, 0.1, 0.01, 0.008, diameter=0.008)
POST = cs.Obstacle("post", cs.Cylinder(0.015, 2.0), cs.Pose((0.35, 0.0, 1.0)), friction=0.2)


def behind(solver: solvers.Rod, cable: cs.Cable, scene: cs.Scene) -> cs.CableShape:
    """The shape of a cable that has come to hang behind a post from beside it."""
    for k in range(31):
        shape = led(solver, cable, scene, -0.12 + 0.01 * k)
    return shape


def led(solver: solvers.Rod, cable: cs.Cable, scene: cs.Scene, y: float) -> cs.CableShape:
    problem = Problem(cable, scene=scene, points=101)
    problem.move(*(cs.Pose((x, y, 1.0), ALONG_X) for x in (0.0, 0.7)))
    shape: cs.CableShape = solver.solve(problem)
    assert shape.usable
    return shape


@pytest.mark.parametrize("share", [0.985, 1.0003, 1.015])
@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("masses", [(), (cs.PointMass(0.02, 0.3),)])
def test_it_stays_behind_its_post(share: float, rough: bool, masses: tuple[cs.PointMass, ...]) -> None:
    post = POST if rough else cs.Obstacle("post", POST.solid, POST.pose)
    scene = cs.Scene(obstacles=[post], contact="solve", masses=masses)
    other = CABLE.replace(length=share * CABLE.length)
    solver = solvers.Rod()
    assert behind(solver, CABLE, scene).contacts
    shape = led(solver, other, scene, 0.18)
    assert shape.contacts
    assert shape.positions[50, 1] < -0.01
    if not rough:  # what it is dragged by is of the way that led there
        straight = behind(solvers.Rod(), other, scene)
        assert np.abs(shape.positions - straight.positions).max() < 2e-4


def test_one_that_is_much_longer_is_looked_for_from_nothing() -> None:
    scene, other = cs.Scene(obstacles=[POST], contact="solve"), CABLE.replace(length=1.3)
    solver = solvers.Rod()
    behind(solver, CABLE, scene)
    found, anew = led(solver, other, scene, 0.18), led(solvers.Rod(), other, scene, 0.18)
    assert np.array_equal(found.positions, anew.positions)
