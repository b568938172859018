"""Grips from the transforms on /tf and /tf_static, a frame for each: :class:`TransformSource`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, final

from rclpy.node import Node

from cable_shape.errors import ROS, ArgumentError, DependencyError, InputError, StaleInputError, shown
from cable_shape.messages.pairing import SECOND, Pair
from cable_shape.messages.transforms import TransformTree
from cable_shape.pose import Pose
from cable_shape.robots.robot import Robot
from cable_shape.ros import conversions
from cable_shape.ros.diagnostics import Complaint, Level
from cable_shape.ros.gathering import Gathering
from cable_shape.ros.holding import Holding
from cable_shape.ros.links import LinkSource
from cable_shape.ros.parameters import Settings
from cable_shape.ros.plausibility import JumpWatch
from cable_shape.ros.publishers import PublisherWatch
from cable_shape.ros.qos import STATIC_TRANSFORMS, TF_STATIC_TOPIC, TF_TOPIC, TRANSFORMS
from cable_shape.ros.sources import ROBOT_FRAME, Ends, Ready, Sink

try:
    from tf2_msgs.msg import TFMessage
except ImportError as error:
    raise DependencyError(
        f"input = 'tf' needs the messages tf2_msgs, which cannot be imported ({error}). {ROS} With ROS from apt: "
        "sudo apt-get install ros-jazzy-tf2-msgs."
    ) from error


@final
class _Cable:
    """The frames of one cable, of which left is its start, or of one harness."""

    def __init__(self, holding: Holding, settings: Settings) -> None:
        self.holding = holding
        self.frames = holding.frames(settings)
        self.topics = tuple(f"{TF_TOPIC} to {frame}" for frame in self.frames)  # as the diagnostics call them
        self.jumps = JumpWatch(self.topics)
        self.last = 0  # ns, of the last pair
        self.apart = ""  # why the last pair could not be had


@final
class TransformSource:
    """Transforms between `frame_id` and the frames of the grippers, all at the newest time at which all are known.

    One cable takes the frames of the parameters, several NAME/FRAME, a harness NAME/SEGMENT_start or NAME/SEGMENT_end.
    With a robot its links follow joint states. Many nodes send on /tf, so nothing here asks for one publisher.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        sink: Sink,
        robot: Robot | None,
        holdings: Sequence[Holding],
    ) -> None:
        self._node, self._sink = node, sink
        self._base = settings.frame_id.lstrip("/") or ROBOT_FRAME
        self._cables = {holding.cable_id: _Cable(holding, settings) for holding in holdings}
        self._tree = TransformTree(self._base, [frame for cable in self._cables.values() for frame in cable.frames])
        self._gathering: Gathering[Pair[Pose]] = Gathering(self._cables)
        self._links = None if robot is None else LinkSource(node, sink, robot)
        self._pairs = self._transforms = 0
        self.apply(settings)
        self.topics = tuple(topic for cable in self._cables.values() for topic in cable.topics)
        self._watch = PublisherWatch(node, TF_TOPIC, TFMessage)
        take: Callable[..., None] = self._take
        take_static: Callable[..., None] = self._take_static
        self._moving = node.create_subscription(TFMessage, TF_TOPIC, take, TRANSFORMS)
        static = node.create_subscription(TFMessage, TF_STATIC_TOPIC, take_static, STATIC_TRANSFORMS)
        self.subscriptions: list[Any] = [] if self._links is None else [self._links.subscription]
        self.subscriptions += [static, self._moving]

    def apply(self, settings: Settings) -> None:
        """Takes over the parameters that may change while running."""
        self._gap = round(settings.max_skew * SECOND)
        self._grips = {name: cable.holding.told(settings) for name, cable in self._cables.items()}
        self._max_age = settings.stale_after

    def clear(self) -> None:
        """Forgets all but what is static."""
        self._tree.forget()
        self._begin()
        if self._links is not None:
            self._links.clear()

    def _begin(self) -> None:
        """The next pair has none before it."""
        self._gathering.clear()
        for cable in self._cables.values():
            cable.last, cable.apart = 0, ""
            cable.jumps.forget()

    def counts(self) -> dict[str, int]:
        """For the diagnostics."""
        return {
            "pairs": self._pairs,
            "pairs older than the cycle before": self._gathering.late,
            "transforms": self._transforms,
            "transforms repeated": self._tree.repeated,
            "frames": len(self._tree),
        }

    def hint(self) -> str:
        """Why there are no pairs, if all transforms come."""
        return next((cable.apart for cable in self._cables.values() if cable.apart), "")

    def publishers(self) -> list[Complaint]:
        """Frames that cannot be reached, and publishers of another type."""
        found = [] if self._links is None else self._links.publishers()
        found += self._watch.wrong_types()
        for cable in self._cables.values():
            for frame in cable.frames:
                missing = self._tree.missing(frame)
                if missing:
                    found.append(Complaint(f"frame {frame}", Level.WARN, missing))
            if self._tree.newest(cable.frames) == 0:
                text = (
                    f"{TF_STATIC_TOPIC}: {' and '.join(cable.frames)} hang on {self._base} by static transforms alone: "
                )
                text += "nothing is published. Send the frames that move on /tf."
                found.append(Complaint(f"static {cable.frames[0]}", Level.WARN, text))
        return found

    def destroy(self) -> None:
        """Takes the subscriptions away."""
        for subscription in self.subscriptions:
            self._node.destroy_subscription(subscription)

    def _take_static(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        """Heard in every state: it is sent once."""
        for transform in message.transforms:
            pose = partial(conversions.transform_of, transform)
            try:
                self._tree.put_static(_name(transform.header.frame_id), _name(transform.child_frame_id), pose)
            except (ArgumentError, InputError) as error:
                self._refuse(TF_STATIC_TOPIC, transform.child_frame_id, error)

    def _take(self, message: TFMessage, info: Mapping[str, Any]) -> None:
        """Takes what waits besides, too: one cycle with the newest, whatever so many senders have sent meanwhile."""
        if not self._sink.open():
            return
        for transform in self._waiting(message):
            self._transforms += 1
            parent, child = _name(transform.header.frame_id), _name(transform.child_frame_id)
            if self._tree.changes_nothing(parent, child):
                continue
            stamp = conversions.nanoseconds(transform.header.stamp)
            try:
                restarted = self._tree.put(parent, child, stamp, partial(conversions.transform_of, transform))
            except (ArgumentError, InputError) as error:
                self._refuse(TF_TOPIC, child, error)
                continue
            if restarted:
                self._begin()
                self._sink.restarted(f"{TF_TOPIC}: {child}", stamp)
        for name, cable in self._cables.items():
            self._pair(name, cable)

    def _waiting(self, message: TFMessage) -> Iterator[Any]:
        """The transforms of this message and of those behind it."""
        yield from message.transforms
        for _ in range(TRANSFORMS.depth):
            taken = self._moving.handle.take_message(TFMessage, False)
            if taken is None:
                return
            yield from taken[0].transforms

    def _pair(self, name: str, cable: _Cable) -> None:
        """Delivers the grippers of a cable if all transforms to them are newer than those of the last pair."""
        sink, tree = self._sink, self._tree
        for frame, topic in zip(cable.frames, cable.topics, strict=True):
            newest = tree.newest([frame])
            if newest is not None and (newest == 0 or newest > cable.last):
                sink.health.arrived(topic, sink.now())
        stamp = tree.newest(cable.frames)
        if not stamp or stamp <= cable.last:
            return
        try:
            poses = tuple(tree.at(frame, stamp, self._gap) for frame in cable.frames)
        except StaleInputError as error:
            cable.apart = str(error)
            return
        cable.last, cable.apart = stamp, ""
        self._pairs += 1
        if len(self._cables) == 1:
            tree.prune(stamp)
        odd = cable.jumps.look(poses, stamp)
        if odd is not None:
            sink.health.remark(*odd, sink.now())
        for oldest, pairs in self._gathering.put(name, stamp, Pair(stamp, poses, 0)):
            sink.deliver(Ready(oldest, self._base, partial(self._ends, oldest, pairs)))

    def _refuse(self, topic: str, child: str, error: Exception) -> None:
        """Those that nobody asked for share a line: peers may make up any number of names."""
        text = str(error)
        told = text if text.startswith(TF_TOPIC) else f"{topic} to {shown(child)}: {text}"
        what = child if child in self._tree.needed else "other frames"
        self._sink.health.refuse(f"{topic} {what}", told, self._sink.now())

    def _ends(self, stamp: int, pairs: Mapping[str, Pair[Pose]]) -> Ends:
        links = None if self._links is None else partial(self._links.at, stamp, self._max_age)
        cables, grips = self._cables, self._grips
        return {name: cables[name].holding.at(grips[name], pair.values) for name, pair in pairs.items()}, links


def _name(frame: str) -> str:
    """Without the slash in front that tf once had."""
    return frame.removeprefix("/")
