"""A cable that no small steps lead on goes on as one that moves: `prediction.sliding`, `motion.rest`."""

from itertools import pairwise

import numpy as np
import pytest
from contact_routing import motion
from scene_certificate import judged, passed

import cable_shape as cs
from cable_shape.motion.rest import led_to_rest
from cable_shape.prediction.sliding import Sliding

AHEAD = (0.5, 0.5, 0.5, 0.5)
LAID, STUCK = 38, 60  # steps of a cable laid into a channel, without friction, and pressed lengthwise there


def shapes(given, first, last):
    """Of the steps up to `last`, those from `first` on."""
    predictor = cs.Predictor(given.cables["cable"], scene=given.scene, points=301)
    out = [predictor.predict(*step["cable"]) for step in given.steps[:last]]
    return out[first:]


@pytest.fixture(scope="module")
def given():
    return motion("channel", 10)


@pytest.fixture(scope="module")
def slid(given):
    return shapes(given, LAID, STUCK)


def test_what_is_pressed_in_a_channel_has_a_shape_in_every_step(given, slid):
    """Each is an equilibrium by its own numbers, and none has come past a wall."""
    assert all(shape.usable for shape in slid), [shape.detail for shape in slid if not shape.usable]
    cable = given.cables["cable"]
    for shape in slid:
        assert judged(cable, given.scene, shape, shape.supports) == ()
    for before, after in pairwise(slid):
        assert passed(given.scene, 0.5 * cable.diameter, before, after) == ""


def test_it_would_have_none_without(given, monkeypatch):
    monkeypatch.setattr(Sliding, "_followed", lambda self, shape, problem: shape)
    assert sum(not shape.usable for shape in shapes(given, LAID, STUCK)) >= 3


def test_it_comes_to_rest_where_statics_have_it():
    """A cable on a table: all meshes of the motion, and the solver, agree."""
    cable = cs.Cable(1.0, 0.1, 0.02, 0.015, diameter=0.008)
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.1)))
    scene = cs.Scene(obstacles=[table], contact="solve")
    start, (then, now) = cs.Pose((0, 0, 0), AHEAD), [cs.Pose((x, 0, 0), AHEAD) for x in (0.72, 0.7)]
    predictor = cs.Predictor(cable, scene=scene)
    last = predictor.predict(start, then)
    exact = predictor.predict(start, now)
    found = list(led_to_rest(cable, last, ((start, then), None), ((start, now), None), scene, {}))
    assert len(found) == 4
    for shape in found:
        assert np.abs(shape.positions - exact.positions).max() < 2e-4
        off = np.abs(shape.force - exact.force)[[0, -1]]  # between, a row's first and last push are at other nodes
        assert off.max() < 5e-3 * np.abs(exact.force).max()


def test_forces_of_a_motion_jump_where_bodies_push_it_inside_elements():
    """On a wall's edge: told at the nodes beside, they and the moments would miss the certificate."""
    cable = cs.Cable(1.0, 0.1, 0.02, 0.015, diameter=0.008)
    wall = cs.Obstacle("wall", cs.Box((0.02, 2.0, 0.2)), cs.Pose((0.3037, 0.0, -0.3)))
    scene = cs.Scene(obstacles=[wall], contact="solve")
    start, (then, now) = cs.Pose((0, 0, 0), AHEAD), [cs.Pose((x, 0, 0), AHEAD) for x in (0.72, 0.7)]
    last = cs.predict(cable, start, then, scene=scene, points=301)
    shape = next(led_to_rest(cable, last, ((start, then), None), ((start, now), None), scene, {}))
    assert judged(cable, scene, shape, shape.supports) == ()
    (push,) = shape.contacts
    assert 0.2 < push.arc_length / cable.length * 120 % 1.0 < 0.8
