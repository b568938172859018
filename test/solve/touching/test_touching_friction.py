"""Friction with memory: the capstan, loops over a table, what sticks and what slips, by statics and by differences."""

from __future__ import annotations

import math

import contact_routing
import numpy as np
import pytest
from scene_certificate import judged
from scene_random import run

import cable_shape as cs
from cable_shape.kernels.contact import check
from cable_shape.shape import TOUCH
from cable_shape.solve.touching.moments import beyond_cone
from cable_shape.solve.touching.state import TouchState

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.0, 0.1, 2e-3, diameter=0.008)
POST, RADIUS = 0.05, 0.002


def table(friction, link=None):
    return cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), link=link, friction=friction)], contact="solve")


def grips(y, height=0.05, chord=0.93):
    return cs.Pose((0.0, y, height), ALONG_X), cs.Pose((chord, y, height), ALONG_X)


def rubbed(shape):
    """(3,) [N], of all bodies along their surfaces."""
    return sum((contact.tangential_force for contact in shape.contacts), np.zeros(3))


def on_post(friction, degrees, stretch=2.0, axial=500.0):
    """A limp cable wound around a post by this angle, as a helix, and what holds it `pull` further to one side."""
    cable = cs.Cable(1.0, 0.01, 1e-6, diameter=2.0 * RADIUS, axial_stiffness=axial)
    along_y = cs.Pose((0.0, 0.0, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    smooth, rough = (
        cs.Scene(obstacles=[cs.Obstacle("post", cs.Cylinder(POST, 0.5), along_y, friction=mu)], contact="solve")
        for mu in (0.0, friction)
    )
    predictor = cs.Predictor(cable, scene=smooth)
    r = POST + RADIUS
    rise = 3.0 * cable.diameter / (2.0 * math.pi)  # along the post, an angle of one: turns lie side by side

    def ends(first, last, pull):
        free = 0.5 * (1.0 + stretch / axial - r * (first - last))
        touch = np.array((math.cos(first), 0.0, math.sin(first))), np.array((math.cos(last), 0.0, math.sin(last)))
        out = (
            np.array((-math.sin(first), rise / r, math.cos(first))),
            np.array((math.sin(last), -rise / r, -math.cos(last))),
        )
        aside = np.array((0.0, 0.5 * rise * (first - last), 0.0))
        quaternion = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
        places = r * touch[0] + aside + (free + pull) * out[0], r * touch[1] - aside + (free - pull) * out[1]
        return [cs.Grip(cs.Pose(place, quaternion), kind="pinned") for place in places]

    half = 0.5 * math.pi
    wound = math.radians(degrees)
    for x in np.linspace(0.0, 1.0, 41 if degrees <= 180 else 81):
        shape = predictor.predict(*ends(half + (wound - half) * x, half - half * x, 0.0))
    assert shape.usable, shape
    predictor.scene = rough
    return predictor, lambda pull: ends(wound, 0.0, pull)


@pytest.mark.parametrize(
    ("friction", "degrees"),
    [
        (0.1, 45),
        (0.4, 45),
        (0.1, 180),
        (0.2, 180),
        (0.4, 180),
        (0.4, 270),
        (0.1, 360),
        (0.2, 360),
        (0.3, 360),
        (0.4, 360),
    ],
)
def test_a_limp_cable_that_slips_round_a_post_is_a_capstan(friction, degrees):
    """exp(mu times the integral of its curvature), once the larger tension grows no more."""
    predictor, ends = on_post(friction, degrees)
    found = []
    for pull in np.arange(1, 21) * 5e-4:
        shape = predictor.predict(*ends(pull))
        assert shape.usable, (pull, shape)
        assert not shape.frictionless, pull
        contacts = shape.contacts
        # beyond the layer in which the cable, next to its first contact, still bends
        before = np.searchsorted(shape.arc_length, contacts[0].arc_length) - 2
        after = np.searchsorted(shape.arc_length, contacts[-1].arc_length) + 1
        tight, slack = (float(np.linalg.norm(shape.force[k])) for k in (before, after))
        turns = (shape.tangents[before:after] * shape.tangents[before + 1 : after + 1]).sum(axis=1)
        found.append(tight / slack / math.exp(friction * np.arccos(np.clip(turns, -1.0, 1.0)).sum()))
    off = np.sort(np.abs(np.array(found[8:]) - 1.0))
    if degrees == 360 and friction >= 0.3:  # where nodes come or go, some stick for a while: in one step
        off = off[:-1]
    np.testing.assert_allclose(off, 0.0, atol=0.012)
    np.testing.assert_allclose(np.median(found[8:]), 1.0, atol=0.01)


@pytest.mark.parametrize("strain", [0.01, 0.004])
def test_loops_over_a_table_coincide(strain):
    """A taut cable, so that no bow of it flips, dragged across a table to and fro three times."""
    predictor = cs.Predictor(CABLE.replace(axial_stiffness=500.0), scene=table(0.4))
    rows = []
    for _ in range(3):
        rows.append([])
        for at in np.arange(60) / 60.0:
            shape = predictor.predict(*grips(0.02 * math.sin(2.0 * math.pi * at), 0.005, 1.0 + strain))
            assert shape.status is cs.Status.OK
            rows[-1].append(rubbed(shape)[1])
    first, second, third = np.array(rows)
    size = np.abs(second).max()
    assert size > 0.2
    assert np.abs(third - second).max() < 1e-3 * size
    assert np.abs(second - first).max() > 0.1 * size  # the first touch carried nothing
    assert second.max() > 0.2
    assert second.min() < -0.2


@pytest.mark.parametrize(
    ("stiffness", "friction", "seed"),
    [(0.0005, 0.2, 0), (0.002, 0.2, 1), (0.002, 0.4, 2), (0.002, 0.4, 3), (0.002, 0.4, 4)],
)
def test_a_hairpin_that_is_drawn_against_a_rough_post_is_held_in_front_of_it(stiffness, friction, seed):
    """Until it is all but taut, at 0.322; one contact becomes several on the way, and the road leads there."""
    half = math.sqrt(0.5)
    out, back = (0.0, half, 0.0, half), (0.0, -half, 0.0, half)
    post = cs.Obstacle("post", cs.Cylinder(0.04, 2.0), friction=friction)
    scene = cs.Scene(obstacles=[post], contact="solve")
    cable = cs.Cable(0.8, 0.05, stiffness)
    predictor = cs.Predictor(cable, model="cosserat", scene=scene)
    rubs, rng = 0, np.random.default_rng(seed)
    for at in np.arange(0.0, 0.3151, 0.005):
        off = rng.normal(scale=1e-8, size=2)  # where one contact becomes several, rounding leads other ways
        shape = predictor.predict(cs.Pose((-at, -0.12, off[0]), out), cs.Pose((-at, 0.12, off[1]), back))
        assert shape.usable, at
        assert shape.positions[:, 0].max() > 0.04
        rubs += not shape.frictionless
        wrong = [text for text in judged(cable, scene, shape, shape.supports) if not text.startswith("moment")]
        assert not wrong, at
    assert len(shape.contacts) > 1
    assert rubs > 60


def test_the_first_touch_carries_nothing_along_the_surface():
    predictor = cs.Predictor(CABLE, scene=table(0.4))
    first = predictor.predict(*grips(0.0))
    assert first.contacts
    assert first.frictionless
    assert not rubbed(first).any()
    second = predictor.predict(*grips(0.01))
    assert not second.frictionless
    assert rubbed(second)[1] < -0.1
    for contact in second.contacts:
        size = np.linalg.norm(contact.tangential_force)
        assert size <= 0.4 * contact.force * 1.001 + 1e-6
        # what is on its limit to within what the solver asks for, 1e-5 of the largest, may count as either
        assert contact.slips or size < 0.4 * contact.force * (1.0 + 1e-5)


def test_without_friction_its_coefficients_change_no_bit():
    smooth, rough = cs.Predictor(CABLE, scene=table(0.0)), cs.Predictor(CABLE, scene=table(0.4), friction=False)
    for y in np.linspace(0.0, 0.02, 8):
        one, other = smooth.predict(*grips(y)), rough.predict(*grips(y))
        assert np.array_equal(one.buffer, other.buffer)
        assert not one.frictionless
        assert other.frictionless


def test_what_sticks_stays_where_it_is_and_what_has_moved_slips_against_its_way():
    predictor = cs.Predictor(CABLE, scene=table(0.4))
    shape = predictor.predict(*grips(0.0))
    place = shape.positions[75].copy()
    near = predictor.predict(*grips(2e-4))
    assert abs(near.positions[75, 1] - place[1]) < 2e-4
    for y in np.linspace(0.0, 0.03, 16)[1:]:
        far = predictor.predict(*grips(y))
    slips = [contact for contact in far.contacts if contact.slips]
    assert len(slips) > 5
    assert all(contact.tangential_force[1] < 0.0 for contact in slips)


def test_the_larger_coefficient_counts():
    shapes = []
    for cable, scene in ((CABLE.replace(friction=0.4), table(0.1)), (CABLE, table(0.4))):
        predictor = cs.Predictor(cable, scene=scene)
        for y in (0.0, 0.01, 0.02):
            shape = predictor.predict(*grips(y))
        shapes.append(shape)
    assert np.array_equal(shapes[0].buffer, shapes[1].buffer)


def test_a_table_that_moves_takes_the_cable_along():
    predictor = cs.Predictor(CABLE, scene=table(0.4, link="belt"))
    for x in np.linspace(0.0, 0.01, 11):
        shape = predictor.predict(*grips(0.0), links={"belt": cs.Pose((0.0, x, 0.0))})
        assert shape.usable
    assert rubbed(shape)[1] > 0.1
    other = cs.Predictor(CABLE, scene=table(0.4))
    for x in np.linspace(0.0, 0.01, 11):
        fixed = other.predict(*grips(-x))
    np.testing.assert_allclose(rubbed(shape), rubbed(fixed), atol=2e-3)
    np.testing.assert_allclose(shape.positions - (0.0, 0.01, 0.0), fixed.positions, atol=5e-4)


def test_where_all_sticks_derivatives_are_those_of_the_next_step():
    def held():
        predictor = cs.Predictor(CABLE, scene=table(0.9), tolerance=1e-6)
        for y in (0.0, 2e-4, 1e-4):
            shape = predictor.predict(*grips(y))
        assert not any(contact.slips for contact in shape.contacts)
        return predictor

    J = held().sensitivity()
    step = 2e-6
    for axis in (0, 1, 2):
        shapes = []
        for sign in (1.0, -1.0):
            start, end = grips(1e-4)
            moved = cs.Pose(np.array(start.position) + sign * step * np.eye(3)[axis], ALONG_X)
            shapes.append(held().predict(moved, end).positions)
        found = (shapes[0] - shapes[1]) / (2.0 * step)
        assert np.abs(found - J[:, :, axis]).max() < 5e-3 * np.abs(found).max()


def test_what_has_no_past_is_without_friction_and_says_so():
    scene = table(0.4)
    assert cs.predict(CABLE, *grips(0.0), scene=scene).frictionless
    starts, ends = (
        np.array([pose.array for pose in side]) for side in zip(*[grips(y) for y in (0.0, 0.01)], strict=True)
    )
    batch = cs.predict_batch(CABLE, starts, ends, scene=scene)
    for row in (0, 1):
        assert batch[row].contacts
        assert batch[row].frictionless
        assert not rubbed(batch[row]).any()


@pytest.mark.parametrize("number", [1, 3, 6])
def test_random_motions_with_friction_are_in_balance(number):
    found = run("contact with friction", number)
    assert not found.wrong, found.first
    assert found.statuses.total() == sum(found.statuses[name] for name in ("OK", "SNAPPED", "UNSTABLE"))


@pytest.mark.parametrize("value", [-0.1, math.nan, 11.0, "much"])
def test_coefficients_that_make_no_sense_are_refused(value):
    for make in (lambda: CABLE.replace(friction=value), lambda: cs.Obstacle("a", cs.Sphere(0.1), friction=value)):
        with pytest.raises(cs.CableShapeError, match="friction"):
            make()


def test_a_scene_tells_its_friction_as_it_was_told():
    scene = cs.Scene.from_mapping({"obstacles": [{"name": "table", "half_space": True, "friction": 0.3}]})
    assert scene.obstacles[0].friction == 0.3
    assert cs.Scene.from_mapping(scene.as_dict()) == scene
    assert cs.Cable.from_mapping(CABLE.replace(friction=0.2).as_dict()).friction == 0.2


def test_shapes_and_kernels_write_contacts_alike():
    assert check.TOUCH == TOUCH


@pytest.mark.parametrize(("number", "steps"), [(9, 138), (1, 192)])
def test_a_contact_on_an_edge_that_a_node_stops_carries_no_more_than_friction_holds(number, steps):
    """It stood 0.08 mm beside where the cable is nearest, with a tenth more along the wall than friction holds."""
    routed = contact_routing.motion("walls", number)
    ((name, cable),) = routed.cables.items()
    cycle = cs.Cycle(routed.cables, scene=routed.scene, model="cosserat", points=301)
    for k, grips in enumerate(routed.steps[:steps]):
        shape = cycle.step(grips, stamp=10_000_000 * k).shapes[name]
        if shape.usable:
            assert judged(cable, routed.scene, shape, shape.supports) == (), k


def test_what_rubs_by_more_than_it_can_gets_nodes_beside_it():
    """Of a cable dragged over a table, with friction within its limits: of one contact it is then told otherwise."""
    predictor = cs.Predictor(CABLE, scene=table(0.4))
    for y in (0.0, 0.01, 0.02):
        shape = predictor.predict(*grips(y))
    state = predictor.rod_state
    assert isinstance(state, TouchState)
    assert len(shape.contacts) >= 3
    assert any(np.linalg.norm(contact.tangential_force) > 0.3 * contact.force for contact in shape.contacts)
    assert not beyond_cone(state, shape).size
    row = shape.touches[1]
    row[9:12] = 0.41 * row[8], 0.0, 0.0
    before, behind = beyond_cone(state, shape)
    node = int(np.abs(state.nodes - row[0]).argmin())
    np.testing.assert_allclose(
        (before, behind), 0.5 * (state.nodes[node - 1 : node + 1] + state.nodes[node : node + 2])
    )
