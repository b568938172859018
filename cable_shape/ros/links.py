"""Where the robot's links are while the grips come as poses: :class:`LinkSource`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, final

from rclpy.node import Node
from sensor_msgs.msg import JointState

from cable_shape.errors import InputError
from cable_shape.messages.pairing import SECOND, StampGuard
from cable_shape.pose import Pose
from cable_shape.robots.robot import Robot
from cable_shape.ros import conversions
from cable_shape.ros.diagnostics import Complaint
from cable_shape.ros.publishers import PublisherWatch
from cable_shape.ros.qos import JOINT_TOPIC, SENSOR

if TYPE_CHECKING:
    from cable_shape.ros.sources import Sink


@final
class LinkSource:
    """The newest joint state, from which the links are placed when a pair of poses is predicted.

    It completes no pair: a cell whose joint states fail goes on, with clearance to the robot not checked.
    """

    def __init__(self, node: Node, sink: Sink, robot: Robot) -> None:
        self._sink = sink
        self._robot = robot
        self._guard = StampGuard(JOINT_TOPIC)
        self._publishers = PublisherWatch(node, JOINT_TOPIC, JointState)
        self._newest: tuple[int, JointState] | None = None
        take: Callable[..., None] = self._take
        self.subscription = node.create_subscription(JointState, JOINT_TOPIC, take, SENSOR)

    def clear(self) -> None:
        """Forgets the last joint state."""
        self._guard.forget()
        self._publishers.forget()
        self._newest = None

    def publishers(self) -> list[Complaint]:
        """What is wrong with who publishes."""
        return self._publishers.complaints(self.subscription)

    def at(self, stamp: int, max_age: float) -> Mapping[str, Pose] | None:
        """The links; None if no joint state stamped within `max_age` [s] of `stamp` [ns] can be used."""
        if self._newest is None or abs(stamp - self._newest[0]) > max_age * SECOND:
            return None
        message = self._newest[1]
        try:
            self._robot.update(self._robot.positions(message.name, message.position))
        except InputError as error:
            self._newest = None
            self._sink.health.refuse(f"{JOINT_TOPIC} positions", f"{JOINT_TOPIC}: {error}", self._sink.now())
            return None
        return self._robot.link_poses()

    def _take(self, message: JointState, info: Mapping[str, Any]) -> None:
        sink = self._sink
        if not sink.open():
            return
        mixed = self._publishers.mixed(self.subscription, info)
        if mixed:
            sink.health.refuse(f"{JOINT_TOPIC} publishers", mixed, sink.now())
            return
        stamp = conversions.nanoseconds(message.header.stamp)
        try:
            self._guard.check(stamp)
        except InputError as error:
            sink.health.refuse(f"{JOINT_TOPIC} stamp", str(error), sink.now())
            return
        self._newest = (stamp, message)
