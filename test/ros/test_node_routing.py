"""The worked routing task, driven through the node: joint states along its paths, requests where it has edits."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import route_cable as task
from builtin_interfaces.msg import Time
from cable_shape_msgs.srv import EditCable
from harness import Cell
from recordings import BEGIN
from sensor_msgs.msg import JointState

import cable_shape as cs
from cable_shape.messages.fields import shape_from
from cable_shape.robots.robot import Robot
from cable_shape.ros import conversions

ROBOT = Path(__file__).resolve().parents[2] / "config/robots/dual_arm.yaml"
RATE = 20.0  # Hz, of joint states


def answered(cell: Cell, robot: Robot, q: np.ndarray, stamp: int) -> cs.CableShape:
    """What the node says of one joint state."""
    message = JointState(name=list(robot.joint_names), position=q.tolist())
    message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
    shape = cell.send_until(lambda: cell.joints.publish(message), lambda: cell.shape_of(stamp), "shape")
    return shape_from(shape)


def test_the_node_goes_through_the_routing_task_as_a_cycle_does(start, tmp_path: Path) -> None:
    robot = Robot.from_yaml(ROBOT)
    planned = task.plan(robot, seconds=600.0)
    assert planned is not None
    files = {"cable_file": tmp_path / "cable.yaml", "scene_file": tmp_path / "scene.yaml"}
    files["cable_file"].write_text(json.dumps(task.CABLE.as_dict()))
    files["scene_file"].write_text(json.dumps(task.SCENE.as_dict()))
    node = start(input="joints", robot_file=ROBOT, model="cosserat", **files)
    links = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    cycle = cs.Cycle(task.CABLE, scene=task.SCENE, model="cosserat", **links)
    stamp, edits = BEGIN, 0
    for part in planned.parts:
        if not isinstance(part, cs.JointPath):
            request = EditCable.Request(edits=[conversions.edit_message(part)])
            answer = node.call(EditCable, "edit", request)
            assert answer.done, answer.reason
            edits += 1
            assert answer.number == edits
            assert cycle.edit(part)
            continue
        times = part.times
        assert times is not None
        for t in np.linspace(times[0], times[-1], 2 + math.ceil((times[-1] - times[0]) * RATE)):
            q = np.array([np.interp(t, times, column) for column in part.positions.T])
            stamp += round(1e9 / RATE)
            told = answered(node, robot, q, stamp)
            own = cycle.step({"cable": robot.grips(q)}, stamp, robot.link_poses()).shapes["cable"]
            assert told.status is own.status is cs.Status.OK
            assert told.positions == pytest.approx(own.positions, abs=1e-6)
    assert told.length == pytest.approx(task.THROUGH)
    assert edits == 3
    assert node.process.stop() == 0
