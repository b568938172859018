"""The node holds a cable as its file says that a calibration found it held."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from harness import ALONG_X
from sensor_msgs.msg import JointState

import cable_shape as cs
from cable_shape.fields import shape_from
from cable_shape.robot import Robot
from cable_shape.ros.parameters import SPECS, Settings, find_file

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
