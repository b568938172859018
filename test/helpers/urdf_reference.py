"""Forward kinematics straight from a URDF's text, in numpy: the independent reference of the robot's tests."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np


def rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    about_x = np.array(((1, 0, 0), (0, cr, -sr), (0, sr, cr)))
    about_y = np.array(((cp, 0, sp), (0, 1, 0), (-sp, 0, cp)))
    about_z = np.array(((cy, -sy, 0), (sy, cy, 0), (0, 0, 1)))
    return about_z @ about_y @ about_x


def origin(element: ElementTree.Element | None) -> np.ndarray:
    """The (4, 4) transformation of an <origin>, the identity without one."""
    out = np.eye(4)
    if element is not None:
        out[:3, :3] = rpy(*map(float, element.get("rpy", "0 0 0").split()))
        out[:3, 3] = list(map(float, element.get("xyz", "0 0 0").split()))
    return out


def moved(joint: ElementTree.Element, value: float) -> np.ndarray:
    """The (4, 4) transformation of a joint's motion by `value` [rad] or [m]."""
    out = np.eye(4)
    axis_element = joint.find("axis")
    axis = np.array((1.0, 0.0, 0.0))
    if axis_element is not None:
        axis = np.array(list(map(float, axis_element.get("xyz", "1 0 0").split())))
    axis = axis / np.linalg.norm(axis)
    if joint.get("type") == "prismatic":
        out[:3, 3] = value * axis
    elif joint.get("type") in ("revolute", "continuous"):
        cross = np.array(((0, -axis[2], axis[1]), (axis[2], 0, -axis[0]), (-axis[1], axis[0], 0)))
        out[:3, :3] = np.eye(3) + np.sin(value) * cross + (1.0 - np.cos(value)) * cross @ cross
    return out


def links(urdf: str, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Link -> (4, 4) in the root's frame, for joint positions by name; joints that mimic follow."""
    root = ElementTree.fromstring(urdf)
    joints = root.findall("joint")
    children = {j.find("child").get("link") for j in joints}
    (top,) = [link.get("name") for link in root.findall("link") if link.get("name") not in children]
    out = {top: np.eye(4)}
    pending = list(joints)
    while pending:
        joint = next(j for j in pending if j.find("parent").get("link") in out)
        pending.remove(joint)
        mimic = joint.find("mimic")
        value = values.get(joint.get("name"), 0.0)
        if mimic is not None:
            leader = values.get(mimic.get("joint"), 0.0)
            value = float(mimic.get("multiplier", 1)) * leader + float(mimic.get("offset", 0))
        parent = out[joint.find("parent").get("link")]
        out[joint.find("child").get("link")] = parent @ origin(joint.find("origin")) @ moved(joint, value)
    return out


def collisions(urdf: str) -> list[tuple[str, np.ndarray, dict[str, list[float]]]]:
    """(link, (4, 4) in the link, {kind of shape and its numbers}) of every collision element, in the file's order."""
    out = []
    for link in ElementTree.fromstring(urdf).findall("link"):
        for collision in link.findall("collision"):
            shape = collision.find("geometry")[0]
            numbers = {k: list(map(float, v.split())) for k, v in shape.attrib.items() if k != "filename"}
            out.append((link.get("name"), origin(collision.find("origin")), {"kind": shape.tag, **numbers}))
    return out
