"""The node over DDS, fed with joint states of the dual-arm robot."""

import json
import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableWarnings
from clouds import cloud
from diagnostic_msgs.msg import DiagnosticStatus
from harness import LATCHED, cloud_message, nanoseconds
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2

import cable_shape as cs
from cable_shape.cable.cable_file import CableFile
from cable_shape.messages.fields import shape_from
from cable_shape.robots.robot import Robot
from cable_shape.ros.parameters import find_file

ERROR = DiagnosticStatus.ERROR


@pytest.fixture(scope="module")
def robot():
    return Robot.from_yaml(find_file("robots/dual_arm.yaml"))


@pytest.fixture(scope="module")
def arms(start_for_all):
    return start_for_all(input="joints", robot_file="robots/dual_arm.yaml", cable_file="cables/demo.yaml")


def publish(cell, robot, stamp=None, drop=(), **changes):
    """A joint state at home, without the joints in `drop`, with some positions changed."""
    stamp = cell.now() if stamp is None else stamp
    positions = {**dict(zip(robot.joint_names, robot.home.tolist(), strict=True)), **changes}
    message = JointState(name=[n for n in positions if n not in drop])
    message.position = [float(positions[n]) for n in message.name]
    message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
    cell.joints.publish(message)
    return stamp


def answered(cell, robot, **changes):
    """The shape for a joint state that is published until it is answered; none before it is under way."""
    stamp = 0

    def send():
        nonlocal stamp
        stamp = publish(cell, robot, **changes)

    return cell.send_until(send, lambda: cell.shape_of(stamp), "shape")


def test_joint_states_become_a_shape_between_the_grippers(arms, robot):
    message = answered(arms, robot, left_wrist_1_joint=-1.0, right_shoulder_pan_joint=0.0)
    assert message.header.frame_id == "world"
    names = list(reversed(robot.joint_names))  # the order of a message is free
    q = dict(zip(robot.joint_names, robot.home.tolist(), strict=True))
    q.update(left_wrist_1_joint=-1.0, right_shoulder_pan_joint=0.0)
    start, end = robot.grips(robot.positions(names, [q[n] for n in names]))
    shape = shape_from(message)
    assert shape.positions[0] == pytest.approx(start.cable_frame.position, abs=1e-9)
    assert shape.positions[-1] == pytest.approx(end.cable_frame.position, abs=1e-9)


def test_clearance_to_the_robot_is_checked(arms, robot):
    stamp = nanoseconds(answered(arms, robot).header.stamp)
    warnings = arms.listen(CableWarnings, "cable/warnings", LATCHED)
    arms.until(lambda: any(nanoseconds(m.header.stamp) >= stamp for m in warnings), "warnings")
    assert warnings[-1].robot_checked is True


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"drop": ["right_elbow_joint"]}, "joint_states: joint state: right_elbow_joint missing"),
        ({"left_elbow_joint": math.nan}, "position of 'left_elbow_joint' is nan, it must be finite"),
    ],
)
def test_bad_joint_states_are_refused(arms, robot, changes, text):
    answered(arms, robot)
    arms.shapes.clear()
    arms.diagnosis("input", text, ERROR, lambda: publish(arms, robot, **changes))
    assert arms.shapes == []
    assert arms.process.alive
    answered(arms, robot)


def test_a_repeated_stamp_is_refused(arms, robot):
    last = nanoseconds(answered(arms, robot).header.stamp)
    text = f"joint_states: header.stamp = {last} ns is repeated"
    arms.diagnosis("input", text, ERROR, lambda: publish(arms, robot, last))
    answered(arms, robot)


def test_a_robot_file_that_does_not_exist_fails_configure(start):
    node = start(input="joints", robot_file="robots/none.yaml", active=False)
    node.diagnosis("lifecycle", "robots/none.yaml: no such file", ERROR)
    assert node.process.stop() == 0


def test_a_clip_on_a_link_goes_with_the_joints(start, robot, tmp_path):
    """One on the left tool, which has no collision geometry; what the node says is what a predictor says."""
    scene = cs.Scene(clips=[cs.Clip(0.3, cs.Pose((0.02, 0.15, 0.05)), name="guide", link="left_tool")])
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(scene.as_dict()))
    files = {"robot_file": "robots/dual_arm.yaml", "cable_file": "cables/demo.yaml", "scene_file": file}
    node = start(input="joints", model="cosserat", **files)
    predictor = cs.Predictor(CableFile.from_yaml(find_file("cables/demo.yaml")).cable, model="cosserat", scene=scene)
    for angle in (-1.0, -0.9):
        message = shape_from(answered(node, robot, left_wrist_1_joint=angle))
        q = dict(zip(robot.joint_names, robot.home.tolist(), strict=True)) | {"left_wrist_1_joint": angle}
        grips = robot.grips(robot.positions(list(q), list(q.values())))
        own = predictor.predict(*grips, robot.link_poses())
        assert message.status is own.status is cs.Status.OK
        assert message.positions == pytest.approx(own.positions, abs=2e-5)
        there = [np.interp(0.3, message.arc_length, x) for x in message.positions.T]
        assert there == pytest.approx((robot.link_poses()["left_tool"] * scene.clips[0].pose).position, abs=1e-4)
    assert node.process.stop() == 0


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_what_is_seen_of_a_cable_in_a_clip_on_a_link_corrects_its_shape(start, robot, tmp_path, contact):
    """As the clip goes with the joints, a cloud is compared with where it was then."""
    scene = cs.Scene(clips=[cs.Clip(0.3, cs.Pose((0.02, 0.15, 0.05)), name="guide", link="left_tool")], contact=contact)
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(scene.as_dict()))
    files = {"robot_file": "robots/dual_arm.yaml", "cable_file": "cables/demo.yaml", "scene_file": file}
    node = start(input="joints", model="cosserat", points_seen="true", **files)
    sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = node.node.create_publisher(PointCloud2, "cable/points_seen", sensor)
    node.until(publisher.get_subscription_count, "subscription to cable/points_seen")
    known = CableFile.from_yaml(find_file("cables/demo.yaml")).cable
    true = known.replace(bending_stiffness=(2.0 * np.array(known.bending_stiffness)).tolist())
    keywords = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    given, there = (cs.Predictor(c, model="cosserat", scene=scene, **keywords) for c in (known, true))
    told: dict[int, tuple[cs.CableShape, cs.CableShape]] = {}

    def send():
        angle = -1.0 + 0.002 * len(told)
        q = dict(zip(robot.joint_names, robot.home.tolist(), strict=True)) | {"left_wrist_1_joint": angle}
        ends = (*robot.grips(robot.positions(list(q), list(q.values()))), robot.link_poses())
        stamp = publish(node, robot, left_wrist_1_joint=angle)
        told[stamp] = given.predict(*ends), there.predict(*ends)
        stamps = list(told)
        if len(stamps) > 1:
            publisher.publish(cloud_message(cloud(told[stamps[-2]][1], len(stamps)), stamps[-2]))

    def near():
        message = next((m for s in reversed(told) for m in node.shapes if nanoseconds(m.header.stamp) == s), None)
        if message is None:
            return False
        plain, seen = told[nanoseconds(message.header.stamp)]
        before, now = (
            float(np.linalg.norm(x - seen.positions, axis=1).mean())
            for x in (plain.positions, shape_from(message).positions)
        )
        return now < 0.4 * before

    node.send_until(send, near, "shape that is corrected")
    assert node.process.stop() == 0


def test_a_clip_on_a_link_that_is_not_there_is_told_at_configure(start, tmp_path):
    scene = cs.Scene(clips=[cs.Clip(0.3, cs.Pose(), name="guide", link="left_tol")])
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(scene.as_dict()))
    files = {"robot_file": "robots/dual_arm.yaml", "cable_file": "cables/demo.yaml", "scene_file": file}
    node = start(input="joints", model="cosserat", active=False, **files)
    text = "'guide' is on a link of the scene: the URDF has no link 'left_tol'. The nearest is 'left_tool'"
    node.until(lambda: text in node.process.text(), "why it cannot be configured")
    assert node.state() == "unconfigured"
