"""Grips from pose topics, two for each cable, of a harness as many as it has: :class:`PoseSource`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, final

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from cable_shape.errors import ArgumentError, InputError
from cable_shape.messages.pairing import SECOND, FrameGuard, MissedCount, Pair, Pairing, StampGuard
from cable_shape.pose import Pose
from cable_shape.robots.robot import Robot
from cable_shape.ros import conversions
from cable_shape.ros.diagnostics import Complaint
from cable_shape.ros.gathering import Gathering
from cable_shape.ros.holding import Holding
from cable_shape.ros.links import LinkSource
from cable_shape.ros.parameters import Settings
from cable_shape.ros.plausibility import JumpWatch
from cable_shape.ros.publishers import PublisherWatch
from cable_shape.ros.qos import SENSOR
from cable_shape.ros.sources import Ends, Ready, Sink


@final
class _Cable:
    """The topics of one cable, of which left is its start, or of one harness."""

    def __init__(self, node: Node, holding: Holding) -> None:
        self.holding = holding
        self.topics = holding.topics
        self.subscriptions: list[Any] = []
        self.publishers = tuple(PublisherWatch(node, topic, PoseStamped) for topic in self.topics)
        self.guards = tuple(StampGuard(topic) for topic in self.topics)
        self.missed = tuple(MissedCount() for _ in self.topics)
        self.pairing: Pairing[Pose] = Pairing(0, len(self.topics))
        self.jumps = JumpWatch(self.topics)

    def clear(self) -> None:
        self.pairing.clear()
        self.jumps.forget()
        for guard in self.guards:
            guard.forget()
        for watch in self.publishers:
            watch.forget()
        for count in self.missed:
            count.forget()


@final
class PoseSource:
    """PoseStamped topics, paired by stamp. With a robot its links follow joint states.

    One cable listens to left_gripper/pose and right_gripper/pose, several to NAME/left_gripper/pose and so on, a
    harness to NAME/SEGMENT_start/pose or NAME/SEGMENT_end/pose of every end that is held.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        sink: Sink,
        robot: Robot | None,
        holdings: Sequence[Holding],
    ) -> None:
        self._node = node
        self._sink = sink
        self._frame_setting = settings.frame_id
        self._frame = FrameGuard(settings.frame_id)
        self._cables = {holding.cable_id: _Cable(node, holding) for holding in holdings}
        self._gathering: Gathering[Pair[Pose]] = Gathering(self._cables)
        self._links = None if robot is None else LinkSource(node, sink, robot)
        self.apply(settings)
        self.topics = tuple(topic for cable in self._cables.values() for topic in cable.topics)
        self.subscriptions: list[Any] = [] if self._links is None else [self._links.subscription]  # before the poses
        for name, cable in self._cables.items():
            for side, topic in enumerate(cable.topics):
                take = partial(self._take, name, side)
                cable.subscriptions.append(node.create_subscription(PoseStamped, topic, take, SENSOR))
            self.subscriptions += cable.subscriptions

    def apply(self, settings: Settings) -> None:
        """Takes over the parameters that may change while running."""
        for cable in self._cables.values():
            cable.pairing.max_skew = round(settings.max_skew * SECOND)
        self._grips = {name: cable.holding.told(settings) for name, cable in self._cables.items()}
        self._max_age = settings.stale_after

    def clear(self) -> None:
        """Forgets all messages, stamps and the frame."""
        self._frame = FrameGuard(self._frame_setting)
        self._gathering.clear()
        for cable in self._cables.values():
            cable.clear()
        if self._links is not None:
            self._links.clear()

    def counts(self) -> dict[str, int]:
        """For the diagnostics."""
        cables = self._cables.values()
        pairings = [cable.pairing for cable in cables]
        missed = {topic: count for cable in cables for topic, count in zip(cable.topics, cable.missed, strict=True)}
        return {
            "pairs": sum(pairing.pairs for pairing in pairings),
            "messages without a partner": sum(pairing.unpaired for pairing in pairings),
            "pairs older than the cycle before": self._gathering.late,
            **{f"overtaken or lost on {topic}": count.missed for topic, count in missed.items()},
        }

    def hint(self) -> str:
        """Why there are no pairs, if all topics of a cable bring messages."""
        for cable in self._cables.values():
            miss = cable.pairing.nearest_miss()
            if miss is not None:
                limit = cable.pairing.max_skew / SECOND
                return (
                    f"no pair: the newest stamps of {' and '.join(cable.topics)} are {miss / SECOND:.3f} s apart, "
                    f"max_skew = {limit:g} s: nothing is published. Synchronise the clocks of their publishers, or "
                    "raise max_skew."
                )
        return ""

    def publishers(self) -> list[Complaint]:
        """What is wrong with who publishes."""
        found = [] if self._links is None else self._links.publishers()
        for cable in self._cables.values():
            for watch, subscription in zip(cable.publishers, cable.subscriptions, strict=True):
                found += watch.complaints(subscription)
        return found

    def destroy(self) -> None:
        """Takes the subscriptions away."""
        for subscription in self.subscriptions:
            self._node.destroy_subscription(subscription)

    def _take(self, name: str, side: int, message: PoseStamped, info: Mapping[str, Any]) -> None:
        cable, sink, frame_id = self._cables[name], self._sink, message.header.frame_id
        cable.missed[side].take(info)
        if not sink.open():
            return
        topic = cable.topics[side]
        sink.health.arrived(topic, sink.now())
        mixed = cable.publishers[side].mixed(cable.subscriptions[side], info)
        if mixed:
            sink.health.refuse(f"{topic} publishers", mixed, sink.now())
            return
        stamp = conversions.nanoseconds(message.header.stamp)
        reason = "frame"
        try:
            self._frame.check(topic, frame_id)
            reason = "pose"
            pose = conversions.pose_of(message)
            reason = "stamp"
            restarted = cable.guards[side].check(stamp)
        except ArgumentError as error:
            sink.health.refuse(f"{topic} {reason}", f"{topic}: {error}", sink.now())
            return
        except InputError as error:
            sink.health.refuse(f"{topic} {reason}", str(error), sink.now())
            return
        if restarted:
            cable.pairing.clear()
            for other in cable.guards[:side] + cable.guards[side + 1 :]:
                other.forget()
            cable.jumps.forget()
            self._gathering.clear()
            sink.restarted(topic, stamp)
        self._frame.fix(frame_id)
        pair = cable.pairing.put(side, stamp, pose)
        if pair is None:
            return
        odd = cable.jumps.look(pair.values, pair.stamp)
        if odd is not None:
            sink.health.remark(*odd, sink.now())
        for oldest, pairs in self._gathering.put(name, pair.stamp, pair):
            sink.deliver(Ready(oldest, frame_id, partial(self._ends, oldest, pairs)))

    def _ends(self, stamp: int, pairs: Mapping[str, Pair[Pose]]) -> Ends:
        links = None if self._links is None else partial(self._links.at, stamp, self._max_age)
        cables, grips = self._cables, self._grips
        return {name: cables[name].holding.at(grips[name], pair.values) for name, pair in pairs.items()}, links
