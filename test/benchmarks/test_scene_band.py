"""The bound on length of the benches, against tangents and arcs, and where clips hold the band."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scene_band import LONGER, POINTS, drawn

import cable_shape as cs

CABLE = cs.Cable(1.0, 0.05, 0.001, diameter=0.006)
POST, RADIUS = np.array((0.4, 0.05)), 0.04
SCENE = cs.Scene(obstacles=[cs.Obstacle("post", cs.Cylinder(RADIUS, 4.0), cs.Pose((*POST, 0.0)))], contact="solve")
START, BELOW, BESIDE = np.zeros(3), POST - np.array((0.0, 0.2)), POST + np.array((0.2, 0.0))


def round_the_post(end):
    """[m], the shortest way from the start below the post, counterclockwise, to `end`, and the angle along it."""
    near = RADIUS + 0.5 * CABLE.diameter
    a, b = START[:2] - POST, end[:2] - POST
    far = math.hypot(*a), math.hypot(*b)
    turn = math.atan2(a[0] * b[1] - a[1] * b[0], a @ b) % math.tau
    along = max(turn - math.acos(near / far[0]) - math.acos(near / far[1]), 0.0)
    flat = sum(math.sqrt(x**2 - near**2) for x in far) + near * along
    return math.hypot(flat, end[2] - START[2]), along


def laid(*corners):
    """A shape whose points are evenly spaced between corners (k, 3) [m]."""
    at = np.linspace(0.0, 1.0, 301)
    places = np.stack([np.interp(at, np.linspace(0.0, 1.0, len(corners)), x) for x in np.transpose(corners)], axis=1)
    return cs.CableShape.of_points(places, CABLE.length)


@pytest.mark.parametrize(
    "end", [(0.45, 0.6, 0.0), (0.1, 0.5, 0.2), (0.7, 0.3, -0.1), (0.7, 0.16, 0.0), (-0.1, 0.12, 0.1)]
)
def test_is_as_long_as_tangents_and_arc(end):
    end = np.array(end)
    exact, along = round_the_post(end)
    below = laid(START, (*BELOW, 0.3 * end[2]), (*BESIDE, 0.6 * end[2]), end)
    band, lacks = drawn(CABLE, SCENE, [], below, cs.Pose(START), cs.Pose(end))
    assert len(band) == POINTS
    # its corners are on the body and its edges beneath: an arc a is longer than its chord by a^3 / 24
    chords = along * (RADIUS + 0.003) / (24.0 * RADIUS**2) * (exact / (POINTS - 1)) ** 2
    assert -1.5 * chords - LONGER < CABLE.length + lacks - exact < LONGER


@pytest.mark.parametrize("end", [(0.3, 0.7, 0.1), (0.45, 0.62, 0.1), (0.12, 0.51, 0.2)])
def test_settles_where_it_was_drawn_before(end):
    first, end = np.array((0.45, 0.6, 0.0)), np.array(end)
    below = laid(START, (*BELOW, 0.0), (*BESIDE, 0.0), first)
    band, _ = drawn(CABLE, SCENE, [], below, cs.Pose(START), cs.Pose(first))
    _, lacks = drawn(CABLE, SCENE, [], below, cs.Pose(START), cs.Pose(end), band)
    assert_allclose(CABLE.length + lacks, round_the_post(end)[0], rtol=0.0, atol=1e-4)


def test_clip_holds_the_cable_and_a_slide_lets_it_run():
    place, end = np.array((0.3, -0.2, 0.1)), np.array((0.7, 0.0, 0.0))
    by_clip = laid(START, place, end)
    ways = [math.dist(START, place), math.dist(place, end)]
    for kind, lacking in (("slide", sum(ways) - 1.0), ("ball", max(ways[0] - 0.2, ways[1] - 0.8))):
        clip = cs.Clip(0.2, cs.Pose(place), kind=kind)
        _, lacks = drawn(CABLE, cs.Scene(contact="solve"), [clip], by_clip, cs.Pose(START), cs.Pose(end))
        assert_allclose(lacks, lacking, rtol=0.0, atol=LONGER)
