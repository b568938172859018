"""Where a cable in contact cannot have gone: behind a body, and further than it is long."""

from __future__ import annotations

import functools
import math
from itertools import pairwise

import numpy as np
import pytest
from scene_random import run

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.warnings import warnings_of
from cable_shape.solve.search import between
from cable_shape.solve.touching.road import TAUT

HALF = math.sqrt(0.5)
OUT, BACK = (0.0, HALF, 0.0, HALF), (0.0, -HALF, 0.0, HALF)  # leaves along x, comes back against it
POST = cs.Obstacle("post", cs.Cylinder(0.04, 2.0))
RADIUS = 0.04
MID = (0.0, 0.0, 0.0, 1.0)
#: EI [N m^2], EA [N], step [m]: a hairpin that is drawn against a post
CASES = [(ei, ea, step) for ei in (0.0005, 0.002, 0.01) for ea in (None, 2000.0) for step in (0.005, 0.002)]


def hairpin(stiffness, axial=None):
    cable = cs.Cable(0.8, 0.05, stiffness, axial_stiffness=axial)
    return cs.Predictor(cable, model="cosserat", scene=cs.Scene(obstacles=[POST], contact="solve"))


def drawn(predictor, back, links=None):
    """The shape with both grips that far back; the post is between the two halves of the cable."""
    return predictor.predict(cs.Pose((-back, -0.12, 0.0), OUT), cs.Pose((-back, 0.12, 0.0), BACK), links)


@functools.cache
def way_back(stiffness, axial, step):
    """How far back it was drawn, and the shapes, from nothing to beyond what the cable is long enough for."""
    predictor, way = hairpin(stiffness, axial), np.arange(0.0, 0.45, step)
    return way, [drawn(predictor, back) for back in way], drawn(predictor, 0.45)


def in_front(shape, post=0.0):
    return shape.positions[:, 0].max() > post + RADIUS


@pytest.mark.parametrize(("stiffness", "axial", "step"), CASES)
def test_a_cable_that_is_drawn_against_a_post_is_never_taken_to_be_behind_it(stiffness, axial, step):
    way, shapes, last = way_back(stiffness, axial, step)
    lost = []
    for back, shape in zip(way, shapes, strict=True):
        assert not shape.usable or in_front(shape), back
        if not shape.usable:
            assert shape.status is cs.Status.NOT_CONVERGED or shape.missing_length > 0.0
            lost.append(back)
    assert not lost or lost[0] > 0.316  # round the post the cable is taut at 0.322
    assert not last.usable or (axial is not None and in_front(last))


@pytest.mark.parametrize("stiffness", [0.0005, 0.002, 0.01])
def test_two_ways_to_a_post_lead_to_the_same_shape_within_what_each_may_be_off(stiffness):
    shapes = []
    for step in (0.005, 0.002):
        way, found, _ = way_back(stiffness, None, step)
        assert way[round(0.31 / step)] == pytest.approx(0.31)
        shapes.append(found[round(0.31 / step)])
    assert all(shape.contacts and shape.error_estimate < 5e-4 * shape.length for shape in shapes)
    apart = np.linalg.norm(shapes[0].positions - shapes[1].positions, axis=1).max()
    assert apart <= sum(shape.error_estimate for shape in shapes)


def test_back_where_it_was_the_cable_is_in_front_of_the_post_again():
    predictor = hairpin(0.002)
    for back in np.arange(0.0, 0.4, 0.005):
        shape = drawn(predictor, back)
    assert not shape.usable
    assert "past an obstacle" in shape.detail or shape.missing_length > 0.0
    for back in np.arange(0.4, 0.1, -0.005):
        shape = drawn(predictor, back)
    assert shape.status is cs.Status.OK
    assert in_front(shape)
    assert shape.contacts == () or shape.contacts[0].body == "post"


def test_after_reset_any_shape_is_taken():
    predictor = hairpin(0.002)
    for back in np.arange(0.0, 0.4, 0.005):
        drawn(predictor, back)
    predictor.reset()
    shape = drawn(predictor, 0.395)
    assert shape.status is cs.Status.OK
    assert not in_front(shape)


def test_a_post_that_is_drawn_through_the_cable_is_never_taken_to_have_passed():
    scene = cs.Scene(obstacles=[cs.Obstacle("post", cs.Cylinder(RADIUS, 2.0), link="arm")], contact="solve")
    predictor = cs.Predictor(cs.Cable(0.8, 0.05, 0.002), model="cosserat", scene=scene)
    usable = []
    for ahead in np.arange(0.0, 0.45, 0.005):
        shape = drawn(predictor, 0.0, {"arm": cs.Pose((ahead, 0.0, 0.0))})
        assert not shape.usable or in_front(shape, ahead), ahead
        usable.append(shape.usable)
    assert usable[:50] == [True] * 50
    assert not any(usable[70:])


def test_ends_too_far_apart_for_a_while_do_not_bring_the_cable_behind_the_post():
    predictor = hairpin(0.01)
    for back in np.arange(0.0, 0.3, 0.005):
        shape = drawn(predictor, back)
    assert shape.contacts
    start, end = cs.Pose((-0.3, -0.5, 0.0), OUT), cs.Pose((-0.3, 0.5, 0.0), BACK)
    assert not predictor.predict(start, end).usable
    again = drawn(predictor, 0.29)
    assert not again.usable or in_front(again)


def test_a_cable_that_hangs_free_remembers_its_side_while_it_has_no_shape():
    scene = cs.Scene(obstacles=[cs.Obstacle("bar", cs.Cylinder(0.02, 2.0), cs.Pose((0.0, 0.0, 0.05)))], contact="solve")
    predictor = cs.Predictor(cs.Cable(0.5, 0.05, 0.002), model="cosserat", scene=scene)

    def held(y):  # level, the cable hangs beside an upright bar
        return predictor.predict(cs.Pose((-0.2, y, 0.0), MID), cs.Pose((0.2, y, 0.0), MID))

    first = held(-0.1)
    assert first.status is cs.Status.OK
    assert not first.contacts
    assert not predictor.predict(cs.Pose((-0.4, -0.1, 0.0), MID), cs.Pose((0.4, -0.1, 0.0), MID)).usable
    beyond = held(0.1)  # the bar stands between where it was and where it would hang
    assert not beyond.usable or beyond.contacts
    assert held(-0.1).status is cs.Status.OK


def wrapped(lift, radius):
    """[m], a string from (-0.3, lift) under a cylinder at the origin to (0.3, lift)."""
    far = math.hypot(0.3, lift)
    tangent = math.sqrt(far**2 - radius**2)
    return 2.0 * (tangent + radius * (math.pi - math.acos(radius / far) - math.atan2(0.3, lift)))


def test_a_cable_too_short_for_its_way_round_a_body_is_overstretched_by_what_it_lacks():
    cable = cs.Cable(0.75, 0.05, 1e-3, diameter=0.004)
    across = cs.Pose((0.0, 0.0, 0.0), (HALF, 0.0, 0.0, HALF))
    scene = cs.Scene(obstacles=[cs.Obstacle("drum", cs.Cylinder(0.1, 1.0), across)], contact="solve")
    predictor = cs.Predictor(cable, model="cosserat", scene=scene, points=400)
    checker = ClearanceChecker(scene, radius=0.002)
    told = []
    for lift in np.arange(0.0, 0.1255, 0.0025):
        shape = predictor.predict(*(cs.Grip(cs.Pose((x, 0.0, lift), OUT), kind="pinned") for x in (-0.3, 0.3)))
        lacks = wrapped(lift, 0.102) - cable.length
        if lacks < -1e-3:
            assert shape.status is cs.Status.OK
            assert shape.missing_length == 0.0
            assert np.linalg.norm(np.diff(shape.positions, axis=0), axis=1).sum() < 1.0002 * cable.length
        elif lacks > 1e-3 and shape.status is not cs.Status.NOT_CONVERGED:
            assert shape.status is cs.Status.OVERSTRETCHED
            assert shape.missing_length == pytest.approx(lacks, rel=2e-3)
            assert "too short for its way" in shape.detail
            told += warnings_of("cable", cable, scene, shape, checker.check(shape))
    overstretched = [w for w in told if w.kind is cs.WarningKind.OVERSTRETCHED]
    assert overstretched
    assert all(w.margin > 1.0 and w.severity is cs.Severity.ERROR for w in overstretched)


@pytest.mark.parametrize("stiffness", [0.0005, 0.002, 0.01])
def test_a_cable_drawn_beyond_its_length_round_a_post_comes_back_to_where_it_was(stiffness):
    """From forces of tons hardly a step leads back: its last solution is that from before."""
    predictor = hairpin(stiffness)
    there = {round(back, 2): drawn(predictor, back) for back in np.arange(0.0, 0.3101, 0.01)}
    beyond = [drawn(predictor, back) for back in np.arange(0.33, 0.3801, 0.01)]
    assert all(shape.status in (cs.Status.OVERSTRETCHED, cs.Status.NOT_CONVERGED) for shape in beyond)
    for back in (0.31, 0.30, 0.25, 0.20):
        shape, before = drawn(predictor, back), there[back]
        assert shape.status is cs.Status.OK, back
        apart = np.linalg.norm(shape.positions - before.positions, axis=1).max()
        assert apart <= shape.error_estimate + before.error_estimate


@pytest.mark.parametrize("stiffness", [0.0005, 0.002, 0.01])
def test_a_cable_drawn_beyond_its_length_aside_and_back_elsewhere_is_as_if_it_never_was(stiffness):
    """It gives as long as it is too short, so that it knows on which side of the post it lies, wherever grips go."""
    predictor, other = hairpin(stiffness), hairpin(stiffness)

    def held(one, back, aside):
        return one.predict(*(cs.Pose((-back, y + aside, 0.0), q) for y, q in ((-0.12, OUT), (0.12, BACK))))

    for back in np.arange(0.0, 0.3601, 0.005):
        held(predictor, back, 0.0)
    beyond = [held(predictor, 0.36, aside) for aside in np.arange(0.0, 0.1001, 0.005)]
    assert {shape.status for shape in beyond} == {cs.Status.OVERSTRETCHED}
    lacks, seems = [shape.missing_length for shape in beyond], TAUT * beyond[0].length
    assert all(b > a > 0.05 for a, b in pairwise(lacks[::4]))  # further aside is further from the post
    assert all(b > a - seems for a, b in pairwise(lacks))  # by so much a taut one may seem to stretch
    for back in np.arange(0.36, 0.1499, -0.005):
        shape = held(predictor, back, 0.1)
    for aside in np.arange(0.0, 0.1001, 0.005):
        held(other, 0.0, aside)
    for back in np.arange(0.0, 0.1501, 0.005):
        before = held(other, back, 0.1)
    assert shape.status is before.status is cs.Status.OK
    apart = np.linalg.norm(shape.positions - before.positions, axis=1).max()
    assert apart <= shape.error_estimate + before.error_estimate


def test_a_cable_that_a_thin_rod_kinks_is_followed_until_it_is_all_but_taut():
    """Its layers beside the rod are as thin as those at the grips: elements there must be, too."""
    cable = cs.Cable(1.2, 0.1, 0.01, diameter=0.008)
    across = cs.Pose((0.4, 0.0, 0.0), (HALF, 0.0, 0.0, HALF))
    scene = cs.Scene(obstacles=[cs.Obstacle("rod", cs.Capsule(0.002, 0.8), across)], contact="solve")
    predictor = cs.Predictor(cable, scene=scene, model="cosserat")
    level = (0.5, 0.5, 0.5, 0.5)
    for x in np.arange(0.0, 0.2961, 0.001):
        ends = cs.Pose((x, 0.0, 0.38), level), cs.Pose((x + 0.795, 0.0, 0.38), level)
        shape = predictor.predict(*ends)
        assert shape.status is cs.Status.OK, x
    assert [contact.body for contact in shape.contacts] == ["rod"]
    assert shape.contacts[0].force > 50.0


def test_a_cable_that_a_force_pulls_round_a_drum_is_as_long_as_it_is():
    cable = cs.Cable(0.8, 0.1, 1e-3, diameter=0.004)
    across = cs.Pose((0.0, 0.0, 0.0), (HALF, 0.0, 0.0, HALF))
    scene = cs.Scene(obstacles=[cs.Obstacle("drum", cs.Cylinder(0.1, 0.6), across)], contact="solve")
    predictor = cs.Predictor(cable, model="cosserat", scene=scene, gravity=(0.0, 0.0, 0.0))
    start = cs.Grip(cs.Pose((-0.3, 0.0, 0.09), OUT), kind="pinned")
    for angle in np.radians(np.arange(-20.0, 41.0, 2.0)):
        shape = predictor.predict(start, cs.FreeEnd(force=(20.0 * math.cos(angle), 0.0, -20.0 * math.sin(angle))))
        assert shape.status is cs.Status.OK, (angle, shape)
        assert shape.missing_length == 0.0


def test_the_way_between_two_signs_of_one_rotation_is_that_rotation():
    pose = np.array([[0.1, 0.2, 0.3, *OUT]])
    other = pose * np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
    for at in (0.25, 0.5, 0.75):
        assert between(pose, other, at) == pytest.approx(pose)


def turned(*quaternion):
    """Four numbers as a unit quaternion."""
    return np.array(quaternion) / np.linalg.norm(quaternion)


def test_bodies_that_leave_no_way_from_below_or_above_come_from_a_side():
    """A cable in an eyelet among three bars that cross below it, with a shape from nothing."""
    bars = (
        cs.Obstacle(
            "a", cs.Capsule(0.0694, 0.936), cs.Pose((0.237, 0.072, -0.302), turned(-0.0257, 0.2851, -0.9472, 0.1445))
        ),
        cs.Obstacle(
            "b",
            cs.Cylinder(0.1131, 0.85),
            cs.Pose((-0.1196, -0.2213, -0.3045), turned(0.1135, -0.6616, -0.5109, -0.5370)),
        ),
        cs.Obstacle(
            "c",
            cs.Capsule(0.0544, 0.8586),
            cs.Pose((-0.0785, 0.1336, -0.3735), turned(0.0413, -0.6728, 0.4762, -0.5646)),
        ),
    )
    clip = cs.Clip(0.83385, cs.Pose((0.20118, 0.14935, -0.21836)), kind="slide")
    cable = cs.Cable(1.17211, 0.039871, 0.003554, 0.003554, diameter=0.006111)
    start = cs.Pose((-0.41899, -0.24916, 0.0), turned(0.28977, 0.57052, 0.59802, 0.4826))
    end = cs.Pose((0.41899, 0.24916, 0.0), turned(0.3763, 0.4332, 0.65395, 0.4930))
    shape = cs.predict(
        cable, start, end, scene=cs.Scene(obstacles=bars, clips=[clip], contact="solve"), model="cosserat"
    )
    assert shape.status is cs.Status.OK
    assert shape.contacts
    clearance = ClearanceChecker(cs.Scene(obstacles=bars), cable=cable).check(shape)
    assert min(body.distance for body in clearance.bodies) > -3e-4


@pytest.mark.parametrize("number", [62, 95])
def test_a_cable_in_a_clip_and_in_contact_that_is_all_but_taut_has_moments_that_balance_its_forces(number):
    found = run("clips and contact", number)
    assert not found.wrong, found.first
    assert found.statuses["OK"] >= 7
