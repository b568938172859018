"""The cable in MoveIt's planning scene: :class:`PlanningScene`, where moveit_msgs is installed."""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Mapping
from typing import Any, final

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from shape_msgs.msg import SolidPrimitive

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.messages.capsules import Capsules
from cable_shape.messages.pairing import SECOND
from cable_shape.ros import conversions
from cable_shape.ros.parameters import Settings
from cable_shape.safety.report import CycleReport

TOPIC = "collision_object"


def moveit_messages() -> Any:
    """The module moveit_msgs.msg.

    Raises
    ------
    ArgumentError
        If it is not installed.
    """
    try:
        return importlib.import_module("moveit_msgs.msg")
    except ImportError as error:
        bound = f"it needs moveit_msgs, which cannot be imported here ({error})"
        remedy = "sudo apt-get install ros-jazzy-moveit-msgs and source ROS, or set moveit_rate to 0."
        raise ArgumentError.of("moveit_rate", "above 0", bound, remedy) from None


@final
class PlanningScene:
    """Publishes every cable as one collision object of a stable id, made of a fixed number of capsules.

    MoveIt handles scene updates slowly, so one is sent only when a cable leaves the capsules that were sent last, which
    are padded, and at most at a set rate.
    """

    def __init__(self, node: LifecycleNode, settings: Settings, cables: Mapping[str, Cable]) -> None:
        self._messages = moveit_messages()
        self._node = node
        self._period = SECOND / settings.moveit_rate
        self._count, self._padding = settings.moveit_capsules, settings.moveit_padding
        self.take(cables)
        self._sent: dict[str, tuple[Capsules, int, str]] = {}  # with stamp [ns] and frame
        qos = QoSProfile(depth=2 * len(cables), reliability=ReliabilityPolicy.RELIABLE)
        self._publisher: LifecyclePublisher = node.create_lifecycle_publisher(
            self._messages.CollisionObject, TOPIC, qos
        )

    def take(self, cables: Mapping[str, Cable]) -> None:
        """The cables are these now."""
        self._diameters = {name: widest(cable) for name, cable in cables.items()}

    def publish(self, report: CycleReport, frame_id: str) -> None:
        """Sends the cables that have left what was sent of them; a shape that cannot be used changes nothing."""
        for name, shape in report.shapes.items():
            diameter = self._diameters[name]
            if not shape.status:
                continue
            if name in self._sent:
                capsules, stamp, frame = self._sent[name]
                if 0 <= report.stamp - stamp < self._period or (frame == frame_id and capsules.hold(shape, diameter)):
                    continue
            capsules = Capsules.around(shape, diameter, self._count, self._padding)
            self._sent[name] = capsules, report.stamp, frame_id
            self._publisher.publish(self._object(name, capsules, report.stamp, frame_id))

    def remove(self) -> None:
        """Takes the cables out of the planning scene."""
        for name, (_, stamp, frame_id) in self._sent.items():
            message = self._messages.CollisionObject(header=conversions.header_of(stamp, frame_id), id=name)
            message.operation = self._messages.CollisionObject.REMOVE
            self._publisher.publish(message)
        self._sent.clear()

    def destroy(self) -> None:
        """Takes the cables out of the planning scene, and the topic away."""
        if self._node.context.ok():
            self.remove()
        self._node.destroy_lifecycle_publisher(self._publisher)

    def _object(self, name: str, capsules: Capsules, stamp: int, frame_id: str) -> Any:
        """A capsule is a cylinder between two spheres, neighbours sharing theirs."""
        points, radius = capsules.points, capsules.radius
        spheres = [SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[radius]) for _ in points]
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1).tolist()
        cylinders = [SolidPrimitive(type=SolidPrimitive.CYLINDER, dimensions=[length, radius]) for length in lengths]
        message = self._messages.CollisionObject(header=conversions.header_of(stamp, frame_id), id=name)
        message.pose.orientation.w = 1.0
        message.primitives = spheres + cylinders
        message.primitive_poses = [_pose(point, (0.0, 0.0, 0.0, 1.0)) for point in points] + [
            _pose(0.5 * (a + b), _upright(b - a)) for a, b in itertools.pairwise(points)
        ]
        message.operation = self._messages.CollisionObject.ADD  # of an id that is there: takes its place
        return message


def _pose(position: Array, quaternion: tuple[float, ...]) -> Pose:
    x, y, z = position.tolist()
    qx, qy, qz, qw = quaternion
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def _upright(axis: Array) -> tuple[float, ...]:
    """x, y, z, w of the shortest turn that brings the z axis to `axis`."""
    length = float(np.linalg.norm(axis))
    x, y, z = (axis / length).tolist() if length > 0.0 else (0.0, 0.0, 1.0)
    w = 1.0 + z
    if w < 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    size = float(np.sqrt(w * w + x * x + y * y))
    return -y / size, x / size, 0.0, w / size
