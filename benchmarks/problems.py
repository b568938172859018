"""The problems that models and simulators are compared on: the grasps A to D, and two motions of 200 steps."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
START = cs.Pose((0, 0, 0), ALONG_X)
TURNED = (
    Rotation.from_euler("z", 45, degrees=True) * Rotation.from_euler("y", 30, degrees=True)
    * Rotation.from_quat(ALONG_X) * Rotation.from_euler("z", 90, degrees=True)
)  # fmt: skip
END = cs.Pose((0.7, 0.3, -0.1), TURNED.as_quat())
R = np.sqrt(0.5)
GRASPS = {
    "A": (CABLE, START, cs.Pose((0.8, 0, 0), ALONG_X)),
    "B": (CABLE, START, END),
    "C": (CABLE, START, cs.Pose((1.15, 0, 0), ALONG_X)),
    "D": (CABLE.replace(bending_stiffness=0.2), cs.Pose((0, 0, 0), (0, 0, R, R)), cs.Pose((0.5, 0, 0), (R, R, 0, 0))),
}


def motion(steps: int = 200) -> list[cs.Pose]:
    """End poses of a smooth lift, swing and turn."""
    axis = np.array((1.0, 2.0, 1.0)) / np.sqrt(6.0)
    poses = []
    for t in np.arange(1, steps + 1) / steps:
        x = 10 * t**3 - 15 * t**4 + 6 * t**5
        shift = np.array((-0.15 * x, 0.15 * np.sin(np.pi * x) - 0.10 * x, 0.20 * x))
        turn = Rotation.from_rotvec(np.radians(40) * x * axis)
        poses.append(cs.Pose(END.position + shift, (turn * TURNED).as_quat()))
    return poses


def planar_motion(steps: int = 200) -> list[cs.Pose]:
    """End poses in the plane of START and gravity, lifting and pitching."""
    poses = []
    for x in np.arange(1, steps + 1) / steps:
        pitch = Rotation.from_euler("y", -40 * x, degrees=True) * Rotation.from_quat(ALONG_X)
        poses.append(cs.Pose((0.8 - 0.2 * x, 0, 0.1 * np.sin(np.pi * x) + 0.1 * x), pitch.as_quat()))
    return poses
