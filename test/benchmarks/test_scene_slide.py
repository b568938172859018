"""The chain that slides, which judges shapes that snapped: it rests where a cable does, and passes no body."""

from __future__ import annotations

import functools

import numpy as np
from scene_slide import ELEMENTS, slid, slid_there

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.0, 0.1, 0.01, 0.01, diameter=0.008)
WALL = cs.Obstacle("wall", cs.Box((0.05, 0.4, 0.1)), cs.Pose((0.4, 0.0, -0.24)))
SCENE = cs.Scene(obstacles=[WALL], contact="solve")


def held(height, aside=0.0):
    """The grips at this height, that far aside."""
    return cs.Pose((0.0, aside, height), ALONG_X), cs.Pose((0.8, aside, height), ALONG_X)


@functools.cache
def laid():
    """A cable that hangs over a wall, its grips coming down."""
    predictor = cs.Predictor(CABLE, scene=SCENE, model="cosserat", points=301)
    shapes = [predictor.predict(*held(height)) for height in np.arange(0.1, -0.0001, -0.01)]
    assert all(shape.usable for shape in shapes)
    assert shapes[-1].contacts
    return shapes


def points(shape):
    arcs = np.linspace(0.0, CABLE.length, ELEMENTS[0] + 1)
    return np.stack([np.interp(arcs, shape.arc_length, p) for p in shape.positions.T], axis=1)


def test_it_rests_where_a_cable_does():
    before, after = laid()[-3], laid()[-1]
    x, rest = slid(CABLE, SCENE, points(before), [held(0.02), held(0.01), held(0.0)])
    assert rest
    assert np.linalg.norm(x - points(after), axis=1).max() < 3e-3
    assert slid_there(CABLE, SCENE, before, after, [held(0.02), held(0.0)])


def test_a_shape_below_the_wall_is_none_that_it_slides_to():
    before = laid()[-1]
    through = before.again()
    through.buffer = before.buffer.copy()
    through.positions[50:-50, 2] -= 0.3
    assert not slid_there(CABLE, SCENE, before, through, [held(0.0), held(0.0)])
