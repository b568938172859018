"""Contact with bodies on robot links, which move from one shape to the next."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.solve.touching.touching import DEEPEST

ROOT = Path(__file__).resolve().parents[3]
ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
START, END = cs.Pose((0, 0, 0.5), ALONG_X), cs.Pose((0.8, 0, 0.5), ALONG_X)
SPHERE = cs.Obstacle("tool", cs.Sphere(0.06), cs.Pose((0.02, 0, 0)), link="tool")
ROD = cs.Obstacle("tool", cs.Capsule(0.002, 1.0), link="tool")  # upright


def scene(*bodies):
    return cs.Scene(obstacles=bodies, contact="solve")


def at(height, side=0.01):
    return {"tool": cs.Pose((0.4, side, height), (0.0, 0.0, math.sin(0.2), math.cos(0.2)))}


def depth(shape, surroundings, links, **robot):
    """[m], of the cable in all bodies, between the points, too."""
    found = ClearanceChecker(surroundings, radius=0.004, **robot).check(shape, links)
    return max((-body.distance for body in found.bodies), default=0.0)


def test_a_body_on_a_link_is_as_good_as_one_in_the_world_at_the_same_place():
    linked = cs.Predictor(CABLE, model="cosserat", scene=scene(SPHERE))
    fixed = cs.Predictor(CABLE, model="cosserat")
    touched = 0
    for height in np.arange(0.0, 0.1, 0.005):
        links = at(height)
        fixed.scene = scene(cs.Obstacle("tool", SPHERE.solid, links["tool"] * SPHERE.pose))
        a, b = fixed.predict(START, END), linked.predict(START, END, links)
        assert a.status is b.status is cs.Status.OK
        assert a.positions == pytest.approx(b.positions, abs=2e-6)
        assert depth(b, linked.scene, links) < 2.0 * DEEPEST
        touched += len(b.contacts)
    assert touched > 10


@pytest.mark.parametrize("step", [0.005, 0.04])
def test_a_thin_rod_that_moves_into_the_cable_takes_it_along(step):
    predictor = cs.Predictor(CABLE, model="cosserat", scene=scene(ROD))
    for side in np.arange(-0.06, 0.101, step):  # from the side, with 0.04 further at a time than both are thick
        links = {"tool": cs.Pose((0.38, side, 0.3))}
        shape = predictor.predict(START, END, links)
        assert shape.status is cs.Status.OK, (side, shape)
        assert depth(shape, predictor.scene, links) < 2.0 * DEEPEST
    assert all(contact.normal[1] > 0.9 for contact in shape.contacts)
    assert shape.positions[np.abs(shape.positions[:, 0] - 0.38).argmin(), 1] > side


def test_a_rod_that_turns_with_its_link_is_followed():
    arm = cs.Obstacle("tool", cs.Capsule(0.005, 0.6), cs.Pose((0.0, 0.0, 0.35)), link="tool")  # upright above the joint
    predictor = cs.Predictor(CABLE, model="cosserat", scene=scene(arm))
    for angle in np.radians(np.arange(0.0, 31.0, 7.5)):  # its tip moves by 6 cm at a time, into the cable's side
        links = {"tool": cs.Pose((0.4, -0.05, -0.2), (-math.sin(0.5 * angle), 0.0, 0.0, math.cos(0.5 * angle)))}
        shape = predictor.predict(START, END, links)
        assert shape.status is cs.Status.OK, (angle, shape)
        assert depth(shape, predictor.scene, links) < 2.0 * DEEPEST
    assert shape.contacts
    assert shape.positions[75, 1] > 0.03


def test_links_that_are_not_known_keep_nothing_out_and_missing_ones_are_named():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=scene(SPHERE))
    free = predictor.predict(START, END)
    assert free.contacts == ()
    assert predictor.predict(START, END, at(0.1)).contacts
    assert predictor.predict(START, END).positions == pytest.approx(free.positions, abs=1e-7)
    with pytest.raises(cs.ArgumentError, match=r"link 'tool' is missing, which carries 'tool'"):
        predictor.predict(START, cs.Pose((0.79, 0, 0.5), ALONG_X), {"base": cs.Pose()})


def test_a_link_that_moves_alone_is_no_reason_to_give_the_last_shape_again():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=scene(SPHERE))
    first = predictor.predict(START, END, at(0.06))
    assert predictor.predict(START, END, at(0.06)).reused
    second = predictor.predict(START, END, at(0.07))
    assert not second.reused
    assert np.abs(second.positions - first.positions).max() > 1e-3


def test_what_grips_the_cable_keeps_it_out_only_beyond_the_grip():
    palm = cs.Obstacle("palm", cs.Box((0.08, 0.04, 0.04)), link="palm")  # 0.04 m along the cable
    plate = cs.Obstacle("plate", cs.Box((0.02, 0.2, 0.2)), cs.Pose((0.1, 0.0, -0.11)), link="palm")
    links = {"palm": cs.Pose(START.position)}
    held = cs.Predictor(CABLE, model="cosserat", scene=scene(), robot_links=[palm, plate], gripping_links=["palm"])
    shape = held.predict(START, END, links)
    assert shape.status is cs.Status.OK
    assert {contact.body for contact in shape.contacts} == {"plate"}
    assert min(contact.arc_length for contact in shape.contacts) > 0.05
    robot = {"robot_links": [palm, plate], "gripping_links": ["palm"]}
    assert depth(shape, held.scene, links, **robot) < 2.0 * DEEPEST
    in_the_way = cs.Predictor(CABLE, model="cosserat", scene=scene(), robot_links=[palm, plate])
    refused = in_the_way.predict(START, END, links)
    assert refused.status is cs.Status.NOT_CONVERGED
    assert "start grip" in refused.detail
    assert "'palm'" in refused.detail


def test_sensitivity_with_a_body_on_a_link_is_that_of_finite_differences():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=scene(SPHERE), tolerance=1e-6)
    for height in np.arange(0.0, 0.09, 0.01):
        predictor.predict(START, END, at(height, 0.03))
    links = at(height, 0.03)
    columns = predictor.sensitivity()
    step = 1e-4
    for axis in (0, 2):
        shapes = []
        for sign in (1.0, -1.0):
            moved = END.position.copy()
            moved[axis] += sign * step
            shapes.append(predictor.predict(START, cs.Pose(moved, END.quaternion), links))
        assert shapes[0].contacts
        difference = (shapes[0].positions - shapes[1].positions) / (2.0 * step)
        assert columns[:, :, 6 + axis] == pytest.approx(difference, abs=5e-3)


@pytest.mark.parametrize(("seed", "body"), [(29, "left_shoulder/1"), (38, "right_upper_arm/1"), (47, "right_wrist_2")])
def test_a_cable_rests_on_the_arms_of_a_robot(seed, body):
    """Random motions of a dual-arm robot whose own links would be in the cable's way."""
    robot = Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")
    cable = cs.Cable.from_yaml(ROOT / "config/cables/demo.yaml")
    moving = [i for i, name in enumerate(robot.joint_names) if "finger" not in name]
    rng = np.random.default_rng(3)
    for _ in range(seed + 1):
        turn = rng.uniform(-0.9, 0.9, len(moving))
    on_robot = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    surroundings = cs.Scene(contact="solve")
    cycle = cs.Cycle(cable, scene=surroundings, model="cosserat", **on_robot)
    plain = cs.Predictor(cable, model="cosserat")
    deepest, touched = 0.0, set()
    for k in range(101):
        q = robot.home.copy()
        q[moving] += turn * (k / 100)
        grips, links = robot.grips(q), robot.link_poses()
        report = cycle.step({"cable": grips}, stamp=10_000_000 * k, links=links)
        shape = report.shapes["cable"]
        assert shape.status is cs.Status.OK, (k, shape)
        assert depth(shape, surroundings, links, **on_robot) < 2.0 * DEEPEST
        touched |= {contact.body for contact in shape.contacts}
        deepest = max(deepest, depth(plain.predict(*grips), surroundings, links, **on_robot))
        for contact in shape.contacts:
            margin = next(m for m in report.margins["cable"] if m.other == contact.body)
            assert abs(margin.value) < 2.0 * DEEPEST
            said = [warning.text for warning in report.warnings if warning.other == contact.body]
            assert len(said) == 1
            assert "rests on" in said[0]
    assert deepest > 0.005
    assert body in touched


def test_from_nothing_arms_above_a_table_stay_above_the_cable():
    """The table comes from below; what is on links and in nobody's way does not come with it."""
    table = cs.Obstacle("table", cs.Box((3.0, 3.0, 0.1)), cs.Pose((0.4, 0.0, 0.3)))
    bar = cs.Obstacle("tool", cs.Box((0.3, 2.0, 0.02)), link="tool")
    alone = cs.predict(CABLE, START, END, scene=scene(table))
    assert alone.status is cs.Status.OK
    predictor = cs.Predictor(CABLE, model="cosserat", scene=scene(table), robot_links=[bar])
    shape = predictor.predict(START, END, {"tool": cs.Pose((0.4, 0.0, 0.45))})
    assert shape.status is cs.Status.OK
    assert {contact.body for contact in shape.contacts} == {"table"}
    assert np.abs(shape.positions) == pytest.approx(np.abs(alone.positions), abs=1e-3)  # it bows to either side
