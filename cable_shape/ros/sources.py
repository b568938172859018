"""Where the node's grips come from: :class:`PoseSource` (two topics) and :class:`JointSource` (joint states).

A source turns messages into :class:`Ready` input and hands each to the node. Bad messages are refused with a text that
names the value, the bound and the remedy; they never reach a cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import final

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, InputError, StaleInputError
from cable_shape.pose import Grip, Pose
from cable_shape.robot import Robot
from cable_shape.ros import conversions
from cable_shape.ros.diagnostics import Health
from cable_shape.ros.inputs import SECOND, FrameGuard, Pair, Pairing, StampGuard
from cable_shape.ros.parameters import Settings

#: Best-effort matches every publisher; depth 1: a busy node takes the newest message and never falls behind.
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

POSE_TOPICS = ("left_gripper/pose", "right_gripper/pose")
JOINT_TOPIC = "joint_states"

#: frame of the output for joint input without a frame_id: the robot's root
ROBOT_FRAME = "world"

Ends = tuple[Grip, Grip, Mapping[str, Pose] | None]


@final
@dataclass(frozen=True, slots=True)
class Ready:
    """Input for one cycle; `ends` computes grips and links when they are needed."""

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


@final
class PoseSource:
    """Two PoseStamped topics, paired by stamp; left is the cable's start."""

    topics = POSE_TOPICS

    def __init__(self, node: Node, settings: Settings, sink: Sink) -> None:
        self._node = node
        self._sink = sink
        self._frame = FrameGuard(settings.frame_id)
        self._guards = tuple(StampGuard(topic) for topic in POSE_TOPICS)
        self._pairing: Pairing[Pose] = Pairing(0)
        self.apply(settings)
        self._frame_setting = settings.frame_id
        self._subscriptions = [
            node.create_subscription(PoseStamped, topic, partial(self._take, side), SENSOR)
            for side, topic in enumerate(POSE_TOPICS)
        ]

    def apply(self, settings: Settings) -> None:
        """Takes over the parameters that may change while running."""
        self._pairing.max_skew = round(settings.max_skew * SECOND)
        self._grips = settings.grips()

    def clear(self) -> None:
        """Forgets all messages, stamps and the frame."""
        self._frame = FrameGuard(self._frame_setting)
        self._pairing.clear()
        for guard in self._guards:
            guard.forget()

    def counts(self) -> dict[str, int]:
        """For the diagnostics."""
        return {"pairs": self._pairing.pairs, "messages without a partner": self._pairing.unpaired}

    def hint(self) -> str:
        """Why there are no pairs, if both topics bring messages."""
        miss = self._pairing.nearest_miss()
        if miss is None:
            return ""
        limit = self._pairing.max_skew / SECOND
        return (
            f"no pair: the newest stamps of {' and '.join(POSE_TOPICS)} are {miss / SECOND:.3f} s apart, max_skew = "
            f"{limit:g} s: nothing is published. Synchronise the clocks of their publishers, or raise max_skew."
        )

    def destroy(self) -> None:
        """Takes the subscriptions away."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _take(self, side: int, message: PoseStamped) -> None:
        sink, topic, frame_id = self._sink, POSE_TOPICS[side], message.header.frame_id
        if not sink.open():
            return
        sink.health.arrived(topic, sink.now())
        stamp = conversions.nanoseconds(message.header.stamp)
        reason = "frame"
        try:
            self._frame.check(topic, frame_id)
            reason = "pose"
            pose = conversions.pose_of(message)
            reason = "stamp"
            restarted = self._guards[side].check(stamp)
        except ArgumentError as error:
            sink.health.refuse(f"{topic} {reason}", f"{topic}: {error}", sink.now())
            return
        except InputError as error:
            sink.health.refuse(f"{topic} {reason}", str(error), sink.now())
            return
        if restarted:
            self._pairing.clear()
            self._guards[1 - side].forget()
            sink.restarted(topic, stamp)
        self._frame.fix(frame_id)
        pair = self._pairing.put(side, stamp, pose)
        if pair is not None:
            sink.deliver(Ready(pair.stamp, frame_id, partial(self._ends, pair)))

    def _ends(self, pair: Pair[Pose]) -> Ends:
        start, end = self._grips
        return start.at(pair.start), end.at(pair.end), None


@final
class JointSource:
    """Joint states through the robot's kinematics."""

    topics = (JOINT_TOPIC,)

    def __init__(self, node: Node, settings: Settings, sink: Sink, robot: Robot) -> None:
        self._node = node
        self._sink = sink
        self._robot = robot
        self._frame_id = settings.frame_id or ROBOT_FRAME
        self._guard = StampGuard(JOINT_TOPIC)
        self._used = 0
        self._subscription = node.create_subscription(JointState, JOINT_TOPIC, self._take, SENSOR)

    def apply(self, settings: Settings) -> None:
        """No parameter of this source may change while running."""

    def clear(self) -> None:
        """Forgets the last stamp."""
        self._guard.forget()

    def counts(self) -> dict[str, int]:
        """For the diagnostics."""
        return {"joint states": self._used}

    def hint(self) -> str:
        """One topic needs no partner."""
        return ""

    def destroy(self) -> None:
        """Takes the subscription away."""
        self._node.destroy_subscription(self._subscription)

    def _take(self, message: JointState) -> None:
        sink = self._sink
        if not sink.open():
            return
        sink.health.arrived(JOINT_TOPIC, sink.now())
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
        start, end = self._robot.grips(q)
        return start, end, self._robot.link_poses()
