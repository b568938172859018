"""Where the node's grips come from: joint states by :class:`JointSource`, poses (ros/pose_source.py), or transforms
(ros/transform_source.py).

A source turns messages into :class:`Ready` input and hands each to the node. Bad messages are refused with a text that
names the value, the bound and the remedy; they never reach a cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, final

from rclpy.node import Node
from sensor_msgs.msg import JointState

from cable_shape.checks import Array
from cable_shape.errors import InputError, StaleInputError
from cable_shape.messages.pairing import MissedCount, StampGuard
from cable_shape.pose import Pose
from cable_shape.robots.robot import Robot
from cable_shape.ros import conversions
from cable_shape.ros.diagnostics import Complaint, Health
from cable_shape.ros.holding import Holding
from cable_shape.ros.parameters import Settings
from cable_shape.ros.publishers import PublisherWatch
from cable_shape.ros.qos import JOINT_TOPIC, SENSOR

#: frame of the output for joint input without a frame_id: the robot's root
ROBOT_FRAME = "world"

Links = Callable[[], Mapping[str, Pose] | None]
Ends = tuple[Mapping[str, Any], Links | None]


@final
@dataclass(frozen=True, slots=True)
class Ready:
    """Input for one cycle; `ends` computes grips when they are needed, and gives a function that places the links."""

    stamp: int  # ns
    frame_id: str
    ends: Callable[[], Ends]


@final
@dataclass(frozen=True, slots=True)
class Sink:
    """What a source needs of the node: whom to tell, and when it is."""

    health: Health
    now: Callable[[], int]  # ns
    deliver: Callable[[Ready], None]
    restart: Callable[[], None]  # the input's clock was set back

    def open(self) -> bool:
        """Whether input is used: only while the node is active."""
        return self.health.state == "active"

    def restarted(self, topic: str, stamp: int) -> None:
        """Says so and starts afresh."""
        text = f"{topic}: header.stamp went back by more than a second, to {stamp} ns: taken as a restart of the clock "
        text += "(a bag that loops), the prediction starts afresh. If it is not, look for two publishers."
        self.health.restarted(text, self.now())
        self.restart()


class Source(Protocol):
    """What the node asks of where its grips come from."""

    topics: tuple[str, ...]  # waited for, as the diagnostics call them
    subscriptions: list[Any]

    def apply(self, settings: Settings) -> None: ...
    def clear(self) -> None: ...
    def counts(self) -> dict[str, int]: ...
    def hint(self) -> str: ...
    def publishers(self) -> list[Complaint]: ...
    def destroy(self) -> None: ...


@final
class JointSource:
    """Joint states through the robot's kinematics; of a harness two ends are held, the first by the left gripper."""

    topics: tuple[str, ...] = (JOINT_TOPIC,)

    def __init__(self, node: Node, settings: Settings, sink: Sink, robot: Robot, holding: Holding) -> None:
        self._holding = holding
        self._node = node
        self._sink = sink
        self._robot = robot
        self._frame_id = settings.frame_id or ROBOT_FRAME
        self._guard = StampGuard(JOINT_TOPIC)
        self._publishers = PublisherWatch(node, JOINT_TOPIC, JointState)
        self._missed = MissedCount()
        self._used = 0
        take: Callable[..., None] = self._take
        self.subscriptions: list[Any] = [node.create_subscription(JointState, JOINT_TOPIC, take, SENSOR)]

    def apply(self, settings: Settings) -> None:
        """No parameter of this source may change while running."""

    def clear(self) -> None:
        """Forgets the last stamp."""
        self._guard.forget()
        self._publishers.forget()
        self._missed.forget()

    def counts(self) -> dict[str, int]:
        """For the diagnostics."""
        return {"joint states": self._used, f"overtaken or lost on {JOINT_TOPIC}": self._missed.missed}

    def hint(self) -> str:
        """One topic needs no partner."""
        return ""

    def publishers(self) -> list[Complaint]:
        """What is wrong with who publishes."""
        return self._publishers.complaints(self.subscriptions[0])

    def destroy(self) -> None:
        """Takes the subscription away."""
        for subscription in self.subscriptions:
            self._node.destroy_subscription(subscription)

    def _take(self, message: JointState, info: Mapping[str, Any]) -> None:
        sink = self._sink
        self._missed.take(info)
        if not sink.open():
            return
        sink.health.arrived(JOINT_TOPIC, sink.now())
        mixed = self._publishers.mixed(self.subscriptions[0], info)
        if mixed:
            sink.health.refuse(f"{JOINT_TOPIC} publishers", mixed, sink.now())
            return
        stamp = conversions.nanoseconds(message.header.stamp)
        try:
            q = self._robot.positions(message.name, message.position)
            restarted = self._guard.check(stamp)
        except StaleInputError as error:
            sink.health.refuse(f"{JOINT_TOPIC} stamp", str(error), sink.now())
            return
        except InputError as error:
            sink.health.refuse(f"{JOINT_TOPIC} positions", f"{JOINT_TOPIC}: {error}", sink.now())
            return
        if restarted:
            sink.restarted(JOINT_TOPIC, stamp)
        self._used += 1
        sink.deliver(Ready(stamp, self._frame_id, partial(self._ends, q)))

    def _ends(self, q: Array) -> Ends:
        grips = [known.grip(grip) for known, grip in zip(self._holding.known, self._robot.grips(q), strict=True)]
        return {self._holding.cable_id: self._holding.ends(grips)}, self._robot.link_poses
