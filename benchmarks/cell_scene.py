"""The cell that nodes are measured and soaked in: a cable between two arms, twenty bodies on a table, and a motion."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from sensor_msgs.msg import JointState

from cable_shape.robots.robot import Robot

CONFIG = Path(__file__).resolve().parents[1] / "config"
OBSTACLES = 20


def scene() -> dict[str, Any]:
    """Twenty bodies on a table, the nearest some centimetres from the cable."""
    bodies: list[dict[str, Any]] = [{"name": "table", "box": [1.2, 1.8, 0.04], "position": [0.35, 0.0, -0.02]}]
    for i in range(OBSTACLES - 1):
        place = [0.25 + 0.03 * i, -0.36 + 0.04 * i, 0.06 + 0.015 * (i % 3)]
        solid = ({"box": [0.03, 0.04, 0.12]}, {"sphere": 0.04}, {"cylinder": {"radius": 0.02, "length": 0.12}})[i % 3]
        bodies.append({"name": f"body_{i}", **solid, "position": place})
    return {"obstacles": bodies}


def motion(robot: Robot, count: int) -> Callable[[int], tuple[Any, ...]]:
    """What is fed at a stamp: the two tool poses and the joint states of a path around home of so many samples."""
    rows = []
    for k in range(count):
        q = robot.home.copy()
        for j in range(len(q)):
            if "finger" not in robot.joint_names[j]:
                q[j] += 0.03 * np.sin(2.0 * np.pi * (1 + j % 3) * k / count)
        rows.append(given_at(robot, q))
    turning = itertools.cycle(rows)
    return lambda _: next(turning)


def given_at(robot: Robot, q: np.ndarray) -> tuple[Any, ...]:
    """The two tool poses at joint positions, and these as a message."""
    robot.update(q)
    poses = robot.gripper_poses()
    joints = JointState(name=list(robot.joint_names), position=q.tolist())
    return [poses[side].array.tolist() for side in ("left", "right")], joints


def node_parameters(folder: Path, view: str) -> dict[str, Any]:
    """Of the node under test; writes its scene."""
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene()))
    half = float(np.sqrt(0.5))
    crosswise = [0.0, 0.0, 0.0, -half, 0.0, 0.0, half]
    return {
        "cable_file": CONFIG / "cables" / "demo.yaml",
        "scene_file": folder / "scene.yaml",
        "robot_file": CONFIG / "robots" / "dual_arm.yaml",
        "left_gripper.offset": crosswise,
        "right_gripper.offset": crosswise,
        "view": view,
        "output_folder": folder,
    }
