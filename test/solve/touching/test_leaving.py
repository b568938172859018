"""A cable that leaves what it lay on goes on from there."""

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.pose import multiply

ALONG_X = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.02, diameter=0.006)
TABLE = cs.Obstacle("table", cs.Box((4.0, 4.0, 0.1)), cs.Pose((0.0, 0.0, 0.7)))


def test_a_wound_cable_is_as_wound_when_it_is_lifted_off_its_table() -> None:
    predictor = cs.Predictor(CABLE, scene=cs.Scene(contact="solve", obstacles=[TABLE]))

    def at(z: float, angle: float) -> cs.CableShape:
        roll = np.array((0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)))
        end = cs.Pose((0.95, 0.0, z), multiply(np.array(ALONG_X), roll))
        return predictor.predict(cs.Pose((0.0, 0.0, z), ALONG_X), end)

    for k in range(21):
        above = at(1.0, 0.1 * math.pi * k)
    assert above.turns == 1
    for z in np.linspace(1.0, 0.84, 17):
        lying = at(float(z), 2.0 * math.pi)
    assert lying.contacts
    for z in np.linspace(0.84, 1.0, 17):
        lifted = at(float(z), 2.0 * math.pi)
    assert lifted.contacts == ()
    assert lifted.turns == 1
    assert lifted.twist == pytest.approx(above.twist, abs=1e-3)
