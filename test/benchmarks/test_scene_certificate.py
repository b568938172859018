"""The certificate of shapes in contact: right ones pass, wrong ones are caught; motions are drawn by their number."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_certificate import crossed, crossings, distances, judged, outward, passed
from scene_random import KINDS, motion, run, short
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.2, 0.1, 0.01, 0.008, diameter=0.008)
SOLIDS = [
    cs.HalfSpace(), cs.Sphere(0.1), cs.Cylinder(0.05, 0.4), cs.Capsule(0.04, 0.3), cs.Box((0.2, 0.1, 0.3)),
]  # fmt: skip
NONE = np.empty((0, 7))


@functools.cache
def laid(height=0.0):
    """A cable on a table, and what it is in."""
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, height)))], contact="solve")
    ends = cs.Pose((0.0, 0.0, 0.2), ALONG_X), cs.Pose((0.7, 0.0, 0.2), ALONG_X)
    return scene, cs.predict(CABLE, *ends, scene=scene, model="cosserat", points=301)


def changed(shape, **arrays):
    """The same shape with other numbers."""
    other = shape.again()
    other.buffer = shape.buffer.copy()
    for name, values in arrays.items():
        getattr(other, name)[...] = values
    return other


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: type(solid).__name__)
@settings(max_examples=30, deadline=None, derandomize=True)
@given(place=st.tuples(*[st.floats(-0.6, 0.6)] * 3), seed=st.integers(0, 1000))
def test_distances_are_those_of_the_clearance_checker(solid, place, seed):
    pose = cs.Pose(place, Rotation.random(random_state=seed).as_quat())
    scene = cs.Scene(obstacles=[cs.Obstacle("body", solid, pose)])
    _, shape = laid(-5.0)
    found = distances(solid, pose, shape.positions).min()
    (told,) = ClearanceChecker(scene, radius=0.0).check(shape).bodies or (None,)
    if told is None:
        assert found > 0.05
    elif found > 0.0:
        assert told.distance == pytest.approx(found, abs=2e-4)
    else:
        assert told.distance <= 1e-9


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: type(solid).__name__)
def test_the_normal_leads_out_of_the_body(solid):
    pose, point = cs.Pose((0.1, 0.2, 0.3), Rotation.random(random_state=3).as_quat()), np.array((0.5, 0.6, 0.9))
    n, at = outward(solid, pose, point), distances(solid, pose, point[None])[0]
    assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-6)
    assert distances(solid, pose, (point + 1e-3 * n)[None])[0] == pytest.approx(at + 1e-3, abs=1e-8)


def test_a_shape_on_a_table_passes_and_wrong_ones_do_not():
    scene, shape = laid()
    assert shape.status is cs.Status.OK
    assert shape.contacts
    assert judged(CABLE, scene, shape, NONE) == ()
    down = shape.positions - (0.0, 0.0, 0.002)
    kinds = [text.split(":")[0] for text in judged(CABLE, scene, changed(shape, positions=down), NONE)]
    assert "inside" in kinds
    assert "off" in kinds
    for arrays, kind in (
        ({"force": shape.force + np.linspace(0.0, 0.01, 301)[:, None]}, "force"),
        ({"moment": shape.moment * np.linspace(1.0, 1.5, 301)[:, None]}, "moment"),
        ({"force": shape.force + 0.01 * np.sin(np.linspace(0.0, math.pi, 301))[:, None]}, "jump"),
    ):
        assert kind in [text.split(":")[0] for text in judged(CABLE, scene, changed(shape, **arrays), NONE)]
    heavier = CABLE.replace(linear_density=0.11)
    assert any(text.startswith("force") for text in judged(heavier, scene, shape, NONE))


def test_a_cable_that_comes_out_on_the_other_side_has_passed():
    scene = cs.Scene(obstacles=[cs.Obstacle("post", cs.Cylinder(0.04, 2.0), cs.Pose((0.35, 0.1, 0.0)))])
    _, shape = laid(-5.0)
    beyond = changed(shape, positions=shape.positions + np.array((0.0, 0.2, 0.0)))
    aside = changed(shape, positions=shape.positions - np.array((0.0, 0.2, 0.0)))
    assert passed(scene, 0.004, shape, beyond) == "through: post"
    assert passed(scene, 0.004, shape, aside) == ""
    assert passed(scene, 0.004, shape, shape) == ""


def test_cables_that_change_sides_have_gone_through_each_other():
    _, one = laid(-5.0)
    turn = Rotation.from_euler("z", 80.0, degrees=True)
    place = one.positions - one.positions.mean(axis=0)
    over = changed(one, positions=turn.apply(place) + one.positions.mean(axis=0) + (0.0, 0.0, 0.02))
    under = changed(over, positions=over.positions - (0.0, 0.0, 0.04))
    assert crossed((one, over), (one, under), 0.008, False)
    assert not crossed((one, over), (one, changed(over, positions=over.positions + 0.02)), 0.008, False)
    assert not crossed((one, one), (one, one), 0.008, True)


def over_each_other(height):
    """Two lines (61, 3) with ends far apart, the second one above the first in the middle, or below."""
    x = np.linspace(-1.0, 1.0, 61)
    bump = np.exp(-20.0 * x**2)
    return np.column_stack((x, 0.1 * x**2, 0.0 * x)), np.column_stack((0.1 * x, x, height * bump))


def wound(line, axis, angle):
    """Space turned about an axis through the origin, the less the further from it: nothing goes through anything."""
    turns = angle * np.exp(-6.0 * (line**2).sum(axis=1))
    return Rotation.from_rotvec(turns[:, None] * axis).apply(line)


def test_only_what_no_way_avoids_counts_as_gone_through():
    rng = np.random.default_rng(3)
    through_and_back = 0
    for _ in range(20):
        axis = rng.normal(size=3)
        axis, angle = axis / np.linalg.norm(axis), rng.uniform(-6.0, 6.0)
        (a, b), (_, below) = over_each_other(0.02), over_each_other(-0.02)
        a_now, b_now, below_now = (wound(line, axis, angle) for line in (a, b, below))
        signs = crossings(a, a_now, b, b_now)
        assert sum(signs) == 0
        assert abs(sum(crossings(a, a_now, b, below_now))) == 1
        through_and_back += len(signs) > 0
    assert through_and_back > 3  # which looks at the straight way take for gone through


def test_a_cable_is_too_short_between_its_supports_or_not():
    start, end = cs.Pose((0, 0, 0)), cs.Pose((1.0, 0, 0))
    clip = [cs.Clip(0.5, cs.Pose((0.5, 0.4, 0.0)), kind="ball")]
    assert not short([], 1.1, start, end)
    assert short([], 1.0, start, end)
    assert short(clip, 1.2, start, end)
    assert not short([cs.Clip(0.65, cs.Pose((0.5, 0.4, 0.0)), kind="slide")], 1.3, start, end)


@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_depends_on_its_number_alone_and_its_shapes_are_right(kind):
    one, again, other = motion(kind, 3), motion(kind, 3), motion(kind, 4)
    assert one.cables == again.cables != other.cables
    assert one.steps[7] == again.steps[7]
    found = run(kind, 1)
    assert not found.wrong, found.first
    assert found.statuses["OK"] > 10
