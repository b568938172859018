"""The worked planner: two arms carry a cable past a post and touch nothing, by checks that are not its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import plan_cable
import plan_run
import pytest

import cable_shape as cs
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")


@pytest.fixture(scope="module")
def found(robot: Robot):
    plan = plan_cable.plan(robot, seed=1, seconds=600.0)
    assert plan is not None
    return plan


def fine(rows: np.ndarray, parts: int) -> np.ndarray:
    """Many places between all waypoints."""
    places = np.arange(len(rows))
    at = np.linspace(0.0, len(rows) - 1.0, parts * (len(rows) - 1) + 1)
    return np.stack([np.interp(at, places, column) for column in rows.T], axis=1)


def test_the_straight_way_is_barred_by_the_post(found) -> None:
    assert found.direct.waypoints == (None, None)
    assert not found.direct.valid
    assert found.direct.first.reason is cs.Reason.CLEARANCE
    assert found.direct.first.other == "post"


def test_the_path_leads_from_one_place_to_the_other(robot: Robot, found) -> None:
    planner = plan_cable
    for row, place in ((0, planner.FROM), (-1, planner.TO)):
        for grip, wanted in zip(robot.grips(found.path.positions[row]), planner.ends(*place), strict=True):
            moved, turned = grip.cable_frame.distance(wanted)
            assert moved < 1e-4
            assert turned < 1e-4
    speed = np.abs(np.diff(found.path.positions, axis=0)) / np.diff(found.path.times)[:, None]
    assert (speed <= robot.velocity_limits).all()


def test_the_cable_keeps_off_all_along(robot: Robot, found) -> None:
    """By cycles a hundred times finer than the waypoints."""
    planner = plan_cable
    assert found.check.valid
    assert found.check.segments.all()
    cycle = cs.Cycle(
        planner.cable(),
        scene=planner.SCENE,
        robot_links=robot.link_geometry,
        gripping_links=robot.gripping_links,
        model="cosserat",
    )
    for k, q in enumerate(fine(found.path.positions, 100)):
        report = cycle.step({"cable": robot.grips(q)}, k, robot.link_poses())
        assert report.shapes["cable"].status is cs.Status.OK
        closest = report.clearance["cable"].closest
        assert closest is None or closest.distance >= planner.SCENE.error_distance
        assert not any(warning.severity is cs.Severity.ERROR for warning in report.warnings)


def test_the_arms_keep_off_all_along(robot: Robot, found) -> None:
    """By Pinocchio's collision library: one arm from the other and both from the post."""
    model = pin.buildModelFromXML(robot.urdf)
    geometry = pin.buildGeomFromUrdfString(model, robot.urdf, pin.GeometryType.COLLISION)
    post = plan_cable.POST
    placed = pin.XYZQUATToSE3(post.pose.array)
    solid = pin.coal.Capsule(post.solid.radius, post.solid.length)
    barrier = geometry.addGeometryObject(pin.GeometryObject("post", 0, placed, solid))
    sides = {side: [i for i, g in enumerate(geometry.geometryObjects) if g.name.startswith(side)] for side in
             ("left", "right")}  # fmt: skip
    assert min(map(len, sides.values())) > 5
    pairs = [(a, b) for a in sides["left"] for b in sides["right"]]
    pairs += [(a, barrier) for side in sides.values() for a in side]
    for pair in pairs:
        geometry.addCollisionPair(pin.CollisionPair(*pair))
    data, distances = model.createData(), geometry.createData()
    least = np.inf
    for q in fine(found.path.positions, 50):
        configuration = pin.neutral(model)
        for name, value in zip(robot.single_joints, robot.single_positions(q), strict=True):
            configuration[model.joints[model.getJointId(name)].idx_q] = value
        pin.computeDistances(model, data, geometry, distances, configuration)
        least = min(least, *(result.min_distance for result in distances.distanceResults))
    assert least > 0.5 * plan_cable.ARMS_APART


def test_arms_that_touch_are_told(robot: Robot) -> None:
    planner = plan_cable
    arms = planner.Arms(robot, planner.SCENE)
    assert arms.apart(robot.home)
    low = robot.home.copy()
    low[robot.joint_names.index("left_shoulder_lift_joint")] += 1.2  # the left hand in the table
    assert not arms.apart(low)
    assert not arms.stay_apart(robot.home, low)
    crossed = robot.home.copy()
    crossed[robot.joint_names.index("left_shoulder_pan_joint")] -= 0.8
    crossed[robot.joint_names.index("right_shoulder_pan_joint")] += 0.8
    assert not arms.stay_apart(robot.home, crossed)


def test_a_wall_all_across_leaves_no_way(robot: Robot) -> None:
    planner = plan_cable
    wall = cs.Obstacle("wall", cs.Box((0.02, 3.0, 4.0)), cs.Pose((0.55, 0.0, 1.0)))
    scene = cs.Scene(obstacles=[planner.TABLE, wall], error_distance=0.01)
    assert planner.plan(robot, scene=scene, seconds=2.0) is None


def test_the_recording_holds_the_whole_motion(robot: Robot, found, tmp_path: Path) -> None:
    out = tmp_path / "plan.rrd"
    reports = plan_run.record(robot, plan_cable.cable(), plan_cable.SCENE, [found.path], out)
    assert out.stat().st_size > 50_000
    assert reports[-1].stamp == pytest.approx(1e9 * found.path.times[-1], abs=1.0)
    assert not any(w.severity is cs.Severity.ERROR for report in reports for w in report.warnings)
