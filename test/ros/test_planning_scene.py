"""The cable in MoveIt's planning scene, over DDS where moveit_msgs is installed, which is not on PyPI."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from harness import nanoseconds
from rclpy.qos import QoSProfile, ReliabilityPolicy

INSTALLED = importlib.util.find_spec("moveit_msgs") is not None


@pytest.mark.skipif(INSTALLED, reason="moveit_msgs is installed")
def test_without_moveit_the_node_says_what_to_do_and_stays(start):
    cell = start(moveit_rate=5.0, active=False)
    status = cell.diagnosis("lifecycle", "moveit_rate")
    assert "needs moveit_msgs" in status.message
    assert "ros-jazzy-moveit-msgs" in status.message
    assert cell.state() == "unconfigured"
    assert cell.set(moveit_rate=0.0).successful
    assert cell.transition(1)
    assert cell.transition(3)
    assert cell.predicted() is not None


@pytest.mark.skipif(not INSTALLED, reason="moveit_msgs, which is not on PyPI, is not installed")
def test_few_updates_of_one_object_that_always_holds_the_cable(start):
    from moveit_msgs.msg import CollisionObject

    cell = start(moveit_rate=5.0, moveit_capsules=6, moveit_padding=0.02)
    objects = cell.listen(
        CollisionObject, "collision_object", QoSProfile(depth=9, reliability=ReliabilityPolicy.RELIABLE)
    )
    cell.until(lambda: cell.node.count_publishers("collision_object"), "collision_object")
    stamp, side = nanoseconds(cell.predicted().header.stamp), 0.0

    def moved():  # what it sends first may be lost
        nonlocal stamp, side
        stamp, side = stamp + 10**9, 0.1 - side
        cell.shape_at(stamp, None, (0.8, side, 0.5))

    cell.send_until(moved, lambda: objects and nanoseconds(objects[-1].header.stamp) == stamp, "object")
    before = len(objects)
    for _ in range(30):
        stamp += 10**8
        cell.shape_at(stamp, None, (0.8, side, 0.5))
    for k in range(1, 11):  # 3 cm every 0.1 s
        stamp += 10**8
        cell.shape_at(stamp, None, (0.8 - 0.03 * k, side, 0.5))
    cell.until(lambda: len(objects) > before + 1, "objects")
    cell.spin(0.2)
    sent = [nanoseconds(o.header.stamp) for o in objects[before:]]
    assert sent[0] > stamp - 10 * 10**8, "one was sent although nothing had moved"
    assert 2 <= len(sent) <= 6
    assert {o.id for o in objects} == {"cable"}
    last = objects[-1]
    assert last.operation == CollisionObject.ADD
    assert [p.type for p in last.primitives] == 7 * [p.SPHERE for p in last.primitives[:1]] + 6 * [
        p.CYLINDER for p in last.primitives[:1]
    ]
    centres = np.array([(p.position.x, p.position.y, p.position.z) for p in last.primitive_poses])
    for k in range(6):  # the cylinder lies between its spheres
        q = last.primitive_poses[7 + k].orientation
        length, radius = last.primitives[7 + k].dimensions
        up = np.array((2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x), 1 - 2 * (q.x**2 + q.y**2)))
        assert centres[7 + k] - 0.5 * length * up == pytest.approx(centres[k], abs=1e-12)
        assert centres[7 + k] + 0.5 * length * up == pytest.approx(centres[k + 1], abs=1e-12)
        assert radius == last.primitives[0].dimensions[0]
    assert cell.transition(4)
    cell.until(lambda: objects[-1].operation == CollisionObject.REMOVE, "removal")
