"""The least that a node in Python can do with the messages of cable_shape_node: it answers with a ready-made shape."""

from __future__ import annotations

import contextlib

import numpy as np
import rclpy
from cable_shape_msgs.msg import CableShape, CableWarnings
from cell_node import SENSOR
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
POINTS = 150
WIDTHS = {"arc_length": 1, "positions": 3, "quaternions": 4, "curvature": 3, "force": 3, "moment": 3}


def main() -> None:
    """Answers the second pose until a signal comes."""
    rclpy.init()
    node = rclpy.create_node("echo")
    shape, warnings = CableShape(cable_id="cable", model="cosserat", usable=True, length=1.0), CableWarnings()
    for name, width in WIDTHS.items():
        setattr(shape, name, np.zeros(width * POINTS))
    shapes = node.create_publisher(CableShape, "cable/shape", RELIABLE)
    warned = node.create_publisher(CableWarnings, "cable/warnings", LATCHED)

    def answer(message: PoseStamped) -> None:
        shape.header = warnings.header = message.header
        shapes.publish(shape)
        warned.publish(warnings)

    node.create_subscription(JointState, "joint_states", lambda _: None, SENSOR)
    node.create_subscription(PoseStamped, "left_gripper/pose", lambda _: None, SENSOR)
    node.create_subscription(PoseStamped, "right_gripper/pose", answer, SENSOR)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
