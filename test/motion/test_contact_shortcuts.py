"""What is not looked at, or not made anew, where cables that swing touch: as if it were."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.kernels.contact.meeting import KEEP, MEETING, MOST, keep_off, meet
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.settle import I_OWN
from cable_shape.kernels.network.tables import model_of, plan_of

X = (0.5, 0.5, 0.5, 0.5)  # d3 along x
CABLE = cs.Cable(1.0, linear_density=0.1, bending_stiffness=0.003, diameter=0.01, drag=0.05, retardation_time=0.02)


@viewing
def keeps(ints: Any, floats: Any, places: Any, tangents: Any, touching: Any, reach: float) -> bool:
    """Whether nothing of a cable is near itself, at first sight."""
    return keep_off(plan_of(ints), model_of(ints, floats), places, tangents, touching, reach, places, tangents)


def test_a_cable_straight_enough_is_nowhere_near_itself():
    """Of curves that wind at random those of which that is said at first sight have no two places that meet."""
    motion = cs.Motion(CABLE, cs.Scene(contact="solve"), elements=20)
    motion.begin(cs.Pose((0.0, 0.0, 0.0), X), cs.Pose((0.7, 0.0, 0.0), X))
    swing: Any = motion._swing
    touching, rng, kept, near = swing.among.skin.touching, np.random.default_rng(3), 0, 0
    found, fine = np.empty((MOST, MEETING)), 32
    for _ in range(400):
        turns = (
            rng.uniform(0.0, 30.0)
            * rng.normal(size=(3, 3))
            @ np.sin(np.arange(1, 4)[:, None] * np.linspace(0.0, np.pi, 20 * fine + 1))
        )
        angles = np.cumsum(turns[:2], axis=1) / (20 * fine)
        (cos, cos_up), (sin, sin_up) = np.cos(angles), np.sin(angles)
        tangents = np.stack((cos * cos_up, sin, cos * sin_up), axis=1)
        ways = 0.5 * (tangents[1:] + tangents[:-1]) / (20 * fine)
        places = np.concatenate((np.zeros((1, 3)), np.cumsum(ways, axis=0)))
        at, along, reach = places[::fine].copy(), tangents[::fine].copy(), rng.uniform(0.0, 0.05)
        count = meet(swing.plan, swing.model, at, along, touching[0], touching[0, KEEP] + reach, found)
        said = keeps(swing.ints, swing.floats, at, along, touching, reach)
        assert not (said and count)
        kept, near = kept + said, near + bool(count)
    assert kept > 50
    assert near > 50


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_cable_swept_over_a_table_keeps_its_factors(friction: float):
    """In most iterations of a step in contact, which go where those with factors of their own do."""
    table = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.15)))], contact="solve")
    motion = cs.Motion(CABLE.replace(friction=friction), table, elements=20)
    motion.begin(cs.Pose((0.0, 0.0, 0.0), X), cs.Pose((0.7, 0.0, 0.0), X))
    own, iterations = 0.0, 0
    for k in range(1, 101):
        y = 0.05 * np.sin(0.06 * k)
        shape = motion.step(cs.Pose((0.0, y, 0.0), X), cs.Pose((0.7, 0.5 * y, 0.0), X), 0.01)
        assert shape.usable
        if shape.iterations < 20:  # in one part
            own, iterations = own + motion._swing._scratch[I_OWN], iterations + shape.iterations
    assert len(shape.contacts) > 2
    assert own < (0.75 if friction == 0.0 else 0.5) * iterations
