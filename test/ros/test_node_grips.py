"""The node holds a cable as its file says that a calibration found it held."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from cable_shape_msgs.action import CheckTrajectory
from harness import ALONG_X
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import cable_shape as cs
from cable_shape.messages.fields import shape_from
from cable_shape.robots.robot import Robot
from cable_shape.ros import planning
from cable_shape.ros.assembly import load_cables
from cable_shape.ros.parameters import SPECS, Settings, find_file
from cable_shape.ros.planning import Planner
from cable_shape.ros.serving import Gate
from cable_shape.ros.workers import PlannerSetup

GRIPS = """
grips:
  start: {kind: clamped, correction: {position: [0.003, -0.002, 0.001], quaternion: [0.0, 0.06, 0.0, 0.998198]}}
  end: {kind: swivel, correction: {quaternion: [0.05, 0.0, 0.0, 0.998749]}}
"""
LEFT, ROLLED = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0, 0.0, math.sin(0.5), math.cos(0.5)]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("grips") / "cable.yaml"
    path.write_text("length: 1.2\nlinear_density: 0.1\nbending_stiffness: 0.01\ndiameter: 0.008\n" + GRIPS)
    return path


def expected(file, start, end):
    """The shape between grips as they are without the file."""
    read = cs.CableFile.from_yaml(file)
    return cs.predict(read.cable, read.start.grip(start), read.end.grip(end))


def test_kinds_and_corrections_are_those_of_the_file_unless_told_otherwise(start, file):
    node = start(cable_file=file, left_gripper__offset=LEFT, right_gripper__offset=ROLLED)
    left, right = (
        cs.Grip(cs.Pose(place, ALONG_X), offset=cs.Pose(row[:3], row[3:]))
        for place, row in (((0.0, 0.0, 0.5), LEFT), ((0.8, 0.0, 0.5), ROLLED))
    )
    shape = shape_from(node.predicted())
    np.testing.assert_allclose(shape.positions, expected(file, left, right).positions, rtol=0.0, atol=2e-5)
    assert np.abs(shape.curvature[:, 2]).max() < 1e-4, "a swivel lets go of the roll"
    assert "grips of cable as calibrated: start clamped, corrected by 3.74 mm" in node.process.text()
    assert "was calibrated" not in node.process.text()
    assert node.set(grip_kind_right="clamped").successful
    clamped = shape_from(node.predicted())
    np.testing.assert_allclose(clamped.positions[0], shape.positions[0], rtol=0.0, atol=1e-9)
    assert np.abs(clamped.curvature[:, 2]).max() > 0.5


def test_a_kind_that_is_told_and_is_another_one_is_remarked(start, file):
    node = start(cable_file=file, grip_kind_right="clamped")
    assert "grip_kind_right is clamped, but cable was calibrated swivel there: set it to auto" in node.process.text()


def test_grips_of_a_robot_are_corrected_too(start, file):
    node = start(input="joints", robot_file="robots/dual_arm.yaml", cable_file=file)
    robot = Robot.from_yaml(find_file("robots/dual_arm.yaml"))
    message = JointState(name=list(robot.joint_names), position=robot.home.tolist())

    def came():
        message.header.stamp = Time(sec=(now := node.now()) // 10**9, nanosec=now % 10**9)
        node.joints.publish(message)
        node.spin(0.1)
        return node.shapes and node.shapes[-1]

    found = node.until(came, "shape")
    np.testing.assert_allclose(
        shape_from(found).positions, expected(file, *robot.grips(robot.home)).positions, rtol=0.0, atol=2e-5
    )


def test_settings_hold_as_told_else_as_the_file_says_else_clamped():
    values = {spec.name: spec.default for spec in SPECS}
    held = cs.Held("swivel"), cs.Held()
    assert [grip.kind for grip in Settings.of(values).grips(held)] == ["swivel", "clamped"]
    told = Settings.of({**values, "grip_kind_left": "pinned"})
    assert [grip.kind for grip in told.grips(held)] == ["pinned", "clamped"]


def test_several_cables_have_grips_of_their_own(file, tmp_path):
    several = tmp_path / "several.yaml"
    plain = "{length: 1.0, linear_density: 0.1, bending_stiffness: 0.01, grips: {start: {kind: pinned}}}"
    several.write_text(f"cables:\n  a: {file}\n  b: {plain}\n")
    cables = load_cables(several)
    assert [held.kind for cable in cables.values() for held in cable.held] == ["clamped", "swivel", "pinned", None]
    assert cables["a"] == cs.CableFile.from_yaml(file)


def test_the_planner_corrects_the_grips_of_the_robot(file):
    cable, robot = cs.CableFile.from_yaml(file), find_file("robots/dual_arm.yaml")
    setup = PlannerSetup(
        "p", "/", "s", "a", {"cable": cable.as_dict()}, cs.Scene(), str(robot), "auto", (0.0, 0.0, -9.81), 20, 0.0, 10,
        1, 5.0, True,
    )  # fmt: skip
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("corrects", context=context)
    try:
        seen = []
        planner = Planner(node, PlannerSetup.from_json(setup.to_json()), Gate())
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(planning, "check_laid", lambda layout, name, robot, *_, **__: seen.append(robot))
            points = [JointTrajectoryPoint(positions=Robot.from_yaml(robot).home.tolist())] * 2
            names = list(Robot.from_yaml(robot).joint_names)
            goal = CheckTrajectory.Goal(trajectory=JointTrajectory(joint_names=names, points=points))
            planner._checked(SimpleNamespace(request=goal, is_cancel_requested=False))
        plain = Robot.from_yaml(robot)
        for grip, before, held in zip(seen[0].grips(plain.home), plain.grips(plain.home), cable.held, strict=True):
            assert grip.kind == held.kind
            assert grip.cable_frame.distance(held.grip(before).cable_frame) == pytest.approx((0.0, 0.0), abs=1e-9)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
