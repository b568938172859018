"""Steps from the last shape that take little: contacts that stand stand on, what friction carries goes on."""

import math

import numpy as np
from scene_certificate import judged

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.2, 0.1, 0.003, 0.003, diameter=0.004)


def on_table(friction):
    return cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), friction=friction)], contact="solve")


def ends(k):
    """Smooth steps of 0.1 mm; the cable lies on the table between the grips."""
    t = 5e-3 * k
    start = cs.Pose((0, 0.002 * math.sin(t), 0.03 + 0.02 * math.sin(t)), ALONG_X)
    return start, cs.Pose((1.13 + 0.01 * math.sin(1.4 * t), *start.position[1:]), ALONG_X)


def test_what_friction_carries_goes_on_from_step_to_step():
    """From what it carried last alone, steps took five iterations."""
    scene = on_table(0.4)
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    took = []
    for k in range(100):
        shape = predictor.predict(*ends(k))
        assert shape.status is cs.Status.OK
        assert not judged(CABLE, scene, shape, shape.supports)
        took.append(shape.iterations)
    assert not shape.frictionless
    assert len(shape.contacts) > 15
    assert np.median(took[10:]) <= 3.0
