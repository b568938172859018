"""Cables between two bodies: grooves and channels, by statics, by a table, by balance and by differences."""

from __future__ import annotations

import math

import contact_routing
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scene_certificate import judged, passed
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.contact.near import BARE, NEAR, NORMAL, ON, PRESS
from cable_shape.solve.touching import mesh
from cable_shape.solve.touching.step import Steps

ALONG_X = (0.5, 0.5, 0.5, 0.5)
HALF = math.sqrt(0.5)
CABLE = cs.Cable(1.0, 0.1, 2e-3, diameter=0.008)
RADIUS = 0.004
HEIGHTS = np.linspace(0.3, 0.21, 10)  # from the air to where some of the cable lies, and does not yet bow aside


def tilted(name, degrees):
    """A plane through the x axis, turned about it."""
    turn = Rotation.from_euler("x", degrees, degrees=True).as_quat()
    return cs.Obstacle(name, cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.0), tuple(turn)))


def groove(left, right):
    return cs.Scene(obstacles=[tilted("left", -left), tilted("right", right)], contact="solve")


def lowered(scene, heights=HEIGHTS, lift=0.0, **options):
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat", **options)
    for z in heights:
        shape = predictor.predict(cs.Pose((0.0, 0.0, z + lift), ALONG_X), cs.Pose((0.85, 0.0, z + lift), ALONG_X))
        assert shape.usable, (z, shape)
    return shape, predictor


def carried(shape):
    """[N], by body, along its normal."""
    out: dict[str, float] = {}
    for contact in shape.contacts:
        out[contact.body] = out.get(contact.body, 0.0) + contact.force
    return out


def test_in_a_groove_a_cable_lies_as_on_a_table():
    scene = groove(45, 45)
    found, _ = lowered(scene, lift=math.sqrt(2.0) * RADIUS - RADIUS)
    table, _ = lowered(cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve"))
    lifted = table.positions + np.array((0.0, 0.0, math.sqrt(2.0) * RADIUS - RADIUS))
    apart = np.linalg.norm(found.positions - lifted, axis=1).max()
    assert apart <= found.error_estimate + table.error_estimate
    forces = carried(found)
    assert forces["left"] == pytest.approx(forces["right"], rel=1e-4)
    assert forces["left"] == pytest.approx(carried(table)["table"] / math.sqrt(2.0), rel=1e-2)
    assert judged(CABLE, scene, found, found.supports) == ()


def test_walls_of_a_groove_carry_as_statics_have_it():
    scene = groove(30, 60)
    shape, _ = lowered(scene)
    by_place: dict[float, dict[str, float]] = {}
    for contact in shape.contacts:
        by_place.setdefault(round(contact.arc_length, 9), {})[contact.body] = contact.force
    both = [row for row in by_place.values() if len(row) == 2]
    assert len(both) > 5
    walls = {name: sum(row[name] for row in both) for name in ("left", "right")}
    assert walls["left"] / walls["right"] == pytest.approx(math.tan(math.radians(60.0)), rel=0.02)
    assert judged(CABLE, scene, shape, shape.supports) == ()


def test_derivatives_in_a_groove_are_those_of_differences():
    scene = groove(40, 50)
    step = 1e-6

    def at(z=0.2, y=0.0, moved=0.0):
        scene_then = scene
        if moved:
            first, second = scene.obstacles
            place = cs.Pose((0.0, moved, 0.0), first.pose.quaternion)
            scene_then = cs.Scene(obstacles=[cs.Obstacle("left", first.solid, place), second], contact="solve")
        predictor.scene = scene_then
        return predictor.predict(cs.Pose((0.0, y, z), ALONG_X), cs.Pose((0.85, 0.0, z), ALONG_X)).positions

    _, predictor = lowered(scene, np.linspace(0.3, 0.2, 11), tolerance=1e-9)
    at()
    columns = predictor.sensitivity(("start", "body:left"))
    shape = lowered(scene, np.linspace(0.3, 0.2, 11), tolerance=1e-9)[0]
    arcs = [contact.arc_length for contact in shape.contacts]
    assert len(set(arcs)) < len(arcs)
    for column, change in ((1, {"y": step}), (6 + 1, {"moved": step})):
        ahead, behind = at(**change), at(**{name: -value for name, value in change.items()})
        turned = (ahead - behind) / (2.0 * step)
        assert np.abs(columns[:, :, column] - turned).max() < 2e-2 * np.abs(turned).max()


@pytest.mark.parametrize("width", [0.012, 0.03])
def test_a_cable_is_laid_into_a_channel_and_taken_out(width):
    wall = cs.Box((1.2, 0.02, 0.03))
    scene = cs.Scene(
        obstacles=[
            cs.Obstacle("floor", cs.HalfSpace()),
            cs.Obstacle("near", wall, cs.Pose((0.4, -0.5 * width - 0.01, 0.015))),
            cs.Obstacle("far", wall, cs.Pose((0.4, 0.5 * width + 0.01, 0.015))),
        ],
        contact="solve",
    )
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat", points=301)
    way = [(0.0, z) for z in np.linspace(0.3, 0.21, 19)]
    way += [(y, 0.21) for y in np.linspace(0.0, 0.02, 9)] + [(0.02, z) for z in np.linspace(0.21, 0.3, 10)]
    usable, walls = 0, set()
    for y, z in way:
        shape = predictor.predict(cs.Pose((0.0, y, z), ALONG_X), cs.Pose((0.85, y, z), ALONG_X))
        usable += shape.usable
        if shape.usable:
            assert judged(CABLE, scene, shape, shape.supports) == (), (y, z)
            walls |= {contact.body for contact in shape.contacts}
    assert usable >= 0.95 * len(way)
    assert walls == {"floor", "far"} | ({"near"} & walls)
    assert "floor" in walls


def test_a_cable_that_buckles_in_a_channel_with_friction_comes_to_rest_there():
    """Floor and both walls, and over their edges: contacts come and go by dozens while it moves."""
    routed = contact_routing.motion("channel", 3)
    cycle = cs.Cycle(routed.cables, scene=routed.scene, model="cosserat", points=301)
    (name,) = routed.cables
    shapes = [cycle.step(grips, stamp=10_000_000 * k).shapes[name] for k, grips in enumerate(routed.steps[:34])]
    lost = [k for k, shape in enumerate(shapes) if not shape.usable]
    assert len(lost) <= 2, lost  # all from 22 on, where its last solution could not be followed
    last = [shape for shape in shapes if shape.usable][-1]
    assert {contact.body for contact in last.contacts} == {"floor", "near", "far"}
    assert judged(routed.cables[name], routed.scene, last, last.supports) == ()


@pytest.mark.parametrize(
    ("kind", "number", "last", "stride"), [("posts", 34, 91, 3), ("posts", 34, 91, 5), ("channel", 0, 38, 12)]
)
def test_what_is_too_short_or_crammed_comes_past_nothing(kind, number, last, stride):
    """Where contacts stand, Newton's method would find shapes behind the post; a road over the wall is a snap."""
    routed = contact_routing.motion(kind, number)
    ((name, cable),) = routed.cables.items()
    predictor, before = cs.Predictor(cable, scene=routed.scene, model="cosserat", points=301), None
    for k in range(last % stride, last + 1, stride):
        shape = predictor.predict(*routed.steps[k][name])
        if shape.usable:
            snapped = kind == "channel" and shape.status is cs.Status.SNAPPED
            assert before is None or snapped or passed(routed.scene, 0.5 * cable.diameter, before, shape) == ""
            before = shape


def test_steps_that_lead_past_a_body_leave_where_the_cable_goes_on_from(monkeypatch):
    """Roads between contacts that stand had moved that behind the post: from there the next step passed nothing."""
    routed = contact_routing.motion("posts", 29)
    ((name, cable),) = routed.cables.items()
    predictor = cs.Predictor(cable, scene=routed.scene, model="cosserat", points=301)
    before, failed, go = None, 0, Steps.go

    def watched(steps, *way, **options):
        nonlocal failed
        there, then = steps.state.positions, steps.state.bodies.frames_then
        found = go(steps, *way, **options)
        if not found:
            failed += 1
            assert np.array_equal(steps.state.positions, there)
            assert np.array_equal(steps.state.bodies.frames_then, then)
        return found

    monkeypatch.setattr(Steps, "go", watched)
    for step in routed.steps[:60]:
        shape = predictor.predict(*step[name])
        if shape.usable:
            assert before is None or passed(routed.scene, 0.5 * cable.diameter, before, shape) == ""
            before = shape
    assert failed > 0


def test_neighbours_at_both_sides_of_an_edge_become_one_contact_there():
    nodes = np.linspace(0.0, 0.1, 11)
    q, near, on = np.tile((0.0, HALF, 0.0, HALF), (11, 1)), np.zeros((11, NEAR)), np.full((11, ON), BARE)
    on[[4, 5, 6], :2] = 3
    for k, (leaning, press) in zip((4, 5, 6), ((-0.7, 0.2), (-0.1, 0.1), (0.6, 0.3)), strict=True):
        near[k, NORMAL : NORMAL + 3] = leaning, 0.0, math.sqrt(1.0 - leaning**2)
        near[k, PRESS] = press
    drum = near.copy(), on.copy()
    mesh.join_over_edges(nodes, q, *drum, np.full(11, 1e-3), 0.3)  # as thin a cable does not know it for an edge
    assert np.array_equal(drum[1], on)
    mesh.join_over_edges(nodes, q, near, on, np.full(11, 0.01), 0.3)
    assert np.flatnonzero(on[:, 0] != BARE).tolist() == [5]
    assert near[5, PRESS] == pytest.approx(0.6)
    assert near[[4, 6], PRESS].tolist() == [0.0, 0.0]


@given(some.integers(0, 10**6))
def test_a_mesh_that_is_evened_keeps_what_presses_and_has_no_short_elements_beside_other_nodes(seed):
    rng = np.random.default_rng(seed)
    nodes = np.unique(np.concatenate(([0.0, 1.0], rng.uniform(0.0, 1.0, rng.integers(5, 60)))))
    free = rng.random(nodes.size) < 0.8
    free[[0, -1]] = False
    stops = rng.choice(nodes[1:-1], 2)
    middles, spacing = np.array((0.25, 0.75)), np.array((0.05, 0.1))
    evened = mesh.evened(nodes, free, spacing, middles, stops)
    if evened is None:
        evened = nodes
    kept = np.isin(nodes, evened)
    assert np.isin(evened, nodes).all()
    assert kept[~free].all()
    assert np.isin(stops, evened).all()
    loose = np.flatnonzero(np.isin(evened, nodes[free]) & ~np.isin(evened, stops))
    h = np.diff(evened)
    wanted = mesh.EVEN * np.interp(evened, middles, spacing)
    assert all(min(h[k - 1], h[k]) >= wanted[k] for k in loose)
