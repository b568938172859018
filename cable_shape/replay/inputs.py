"""From the messages of a recording to ends: the poses of the grippers, or joint states through a robot.

Stamps and pairs follow the same rules as in the node (:mod:`cable_shape.messages.pairing`). A message that cannot be
used is refused and counted by reason; it never ends the replay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, final

import numpy as np

from cable_shape.checks import MOST, Array
from cable_shape.errors import ArgumentError, InputError, StaleInputError
from cable_shape.messages.pairing import SECOND, Pairing, StampGuard
from cable_shape.pose import Pose
from cable_shape.replay.carried import Carried

if TYPE_CHECKING:
    from cable_shape.robots.robot import Robot

POSE_TYPE = "geometry_msgs/msg/PoseStamped"
JOINTS_TYPE = "sensor_msgs/msg/JointState"
MARKERS_TYPE = "geometry_msgs/msg/PoseArray"


@final
@dataclass(frozen=True, slots=True)
class Sample:
    """What one cycle is fed with; `stamp` [ns], `ends` as a cycle takes them, `links` None without a robot."""

    stamp: int
    ends: Any
    links: Mapping[str, Pose] | None


@final
@dataclass(slots=True)
class Refused:
    """How often messages of one topic were refused for one reason, with the first example in full."""

    topic: str
    reason: str
    example: str
    count: int = 0


@final
class Refusals:
    """All refused messages, by topic and reason."""

    def __init__(self) -> None:
        self._by_reason: dict[tuple[str, str], Refused] = {}

    def add(self, topic: str, reason: str, example: object) -> None:
        """Counts one more."""
        entry = self._by_reason.setdefault((topic, reason), Refused(topic, reason, str(example)))
        entry.count += 1

    def __iter__(self) -> Any:
        return iter(self._by_reason[key] for key in sorted(self._by_reason))

    @property
    def total(self) -> int:
        """Number of messages refused."""
        return sum(entry.count for entry in self._by_reason.values())


class Source(Protocol):
    """Turns messages into samples."""

    topics: tuple[str, ...]
    frame_id: str | None  # of the samples; None until the first message
    restarted: bool  # the clock was set back by the last message

    @property
    def unpaired(self) -> int: ...  # messages given up without a partner

    def feed(self, topic: str, message: Any) -> Sample | None: ...  # a sample if the message completes one

    def finish(self) -> None: ...  # no message comes any more


@final
class PoseSource:
    """The poses of the grippers, paired within `max_skew` [s]."""

    def __init__(self, carried: Carried, max_skew: float, refusals: Refusals) -> None:
        self.topics = carried.topics
        self.frame_id: str | None = None
        self.restarted = False
        self._carried = carried
        self._refusals = refusals
        self._guards = tuple(StampGuard(topic) for topic in self.topics)
        self._pairing: Pairing[Pose] = Pairing(round(max_skew * SECOND), len(self.topics))

    @property
    def unpaired(self) -> int:
        """Messages given up without a partner."""
        return self._pairing.unpaired

    def feed(self, topic: str, message: Any) -> Sample | None:
        """Takes a PoseStamped; a sample if it completes a pair."""
        side = self.topics.index(topic)
        self.restarted = False
        frame, stamp = message.header.frame_id, stamp_of(message)
        if self.frame_id is not None and frame != self.frame_id:
            self._refusals.add(topic, "other frame", other_frame(topic, frame, self.frame_id))
            return None
        pose = self._pose(topic, message.pose)
        if pose is None:
            return None
        try:
            self.restarted = self._guards[side].check(stamp)
        except StaleInputError as error:
            self._refusals.add(topic, "stamp not newer than the last", error)
            return None
        self.frame_id = frame
        if self.restarted:
            for other in self._guards[:side] + self._guards[side + 1 :]:
                other.forget()
            self._pairing.clear()
        pair = self._pairing.put(side, stamp, pose)
        if pair is None:
            return None
        return Sample(pair.stamp, self._carried.at(pair.values), links=None)

    def finish(self) -> None:
        """Counts the messages that still wait for a partner."""
        self._pairing.clear()

    def _pose(self, topic: str, pose: Any) -> Pose | None:
        """The pose of a message, None if it is refused."""
        p, q = pose.position, pose.orientation
        position, quaternion = (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)
        try:
            return Pose(position, quaternion)
        except ArgumentError as error:
            finite = (np.abs((*position, *quaternion)) <= MOST).all()
            reason = "quaternion not of unit length" if finite else "pose not finite"
            self._refusals.add(topic, reason, f"{topic}: {error}")
            return None


@final
class JointSource:
    """Joint states, turned into grips by a robot's kinematics."""

    def __init__(self, topic: str, robot: Robot, carried: Carried, refusals: Refusals) -> None:
        self.topics: tuple[str, ...] = (topic,)
        self.frame_id: str | None = "world"
        self.restarted = False
        self._robot = robot
        self._carried = carried
        self._refusals = refusals
        self._guard = StampGuard(topic)

    @property
    def unpaired(self) -> int:
        """A joint state needs no partner."""
        return 0

    def feed(self, topic: str, message: Any) -> Sample | None:
        """Takes a JointState."""
        self.restarted = False
        try:
            q = self._robot.positions(message.name, message.position)
            self.restarted = self._guard.check(stamp_of(message))
        except StaleInputError as error:
            self._refusals.add(topic, "stamp not newer than the last", error)
            return None
        except InputError as error:
            self._refusals.add(topic, "joint state not usable", error)
            return None
        return Sample(stamp_of(message), self._carried.held(self._robot.grips(q)), self._robot.link_poses())

    def finish(self) -> None:
        """Nothing waits."""


def stamp_of(message: Any) -> int:
    """header.stamp [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def other_frame(topic: str, frame: str, expected: str) -> str:
    """Why a message in another frame is refused."""
    return (
        f"{topic}: header.frame_id = {frame!r} is not allowed: it must be {expected!r} as in the first message. "
        "Frames are not transformed here; record all poses in one frame."
    )


def positions_of(poses: Any) -> Array:
    """(m, 3) [m], positions of the poses of a PoseArray."""
    return np.array([(p.position.x, p.position.y, p.position.z) for p in poses], dtype=np.float64).reshape(-1, 3)
