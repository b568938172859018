"""From recorded transforms to grips: the frames of two grippers on /tf and /tf_static, as the node's `input: tf`."""

from __future__ import annotations

from functools import partial
from typing import Any, final

from cable_shape.errors import ArgumentError, InputError, StaleInputError
from cable_shape.messages.pairing import SECOND
from cable_shape.messages.transforms import TransformTree
from cable_shape.pose import Pose
from cable_shape.replay.carried import Carried
from cable_shape.replay.inputs import Refusals, Sample, stamp_of

TRANSFORM_TYPE = "tf2_msgs/msg/TFMessage"
WORLD = "world"


@final
class TransformSource:
    """Two frames in a third, both at the newest time at which all transforms between them are known.

    No transform further than `max_skew` [s] from that time is used. `frames`: of the left and the right gripper.
    """

    def __init__(
        self,
        topic: str,
        frames: tuple[str, str],
        frame_id: str,
        carried: Carried,
        max_skew: float,
        refusals: Refusals,
    ) -> None:
        self.topics: tuple[str, ...] = (topic, f"{topic}_static")
        self.frame_id: str | None = frame_id.removeprefix("/") or WORLD
        self.restarted = False
        self._frames = tuple(frame.removeprefix("/") for frame in frames)
        self._carried = carried
        self._gap = round(max_skew * SECOND)
        self._refusals = refusals
        self._tree = TransformTree(self.frame_id, self._frames)
        self._last = 0  # ns, of the last sample

    @property
    def unpaired(self) -> int:
        """Transforms have no partners; those too far apart are refused."""
        return 0

    def feed(self, topic: str, message: Any) -> Sample | None:
        """Takes a TFMessage; a sample if all transforms to both frames are newer than those of the last."""
        self.restarted = False
        static = topic == self.topics[1]
        for transform in message.transforms:
            try:
                self._put(transform, static)
            except StaleInputError as error:
                self._refusals.add(topic, "stamp not newer than the last", error)
            except ArgumentError as error:
                self._refusals.add(topic, "transform not usable", f"{topic} to {transform.child_frame_id!r}: {error}")
            except InputError as error:
                self._refusals.add(topic, "frame not usable", error)
        stamp = self._tree.newest(self._frames)
        if not stamp or stamp <= self._last:
            return None
        self._last = stamp
        try:
            poses = tuple(self._tree.at(frame, stamp, self._gap) for frame in self._frames)
        except StaleInputError as error:
            self._refusals.add(topic, "transforms too far apart", error)
            return None
        self._tree.prune(stamp)
        return Sample(stamp, self._carried.at(poses), links=None)

    def finish(self) -> None:
        """Says why there was no sample, if there was none."""
        if self._last:
            return
        for frame in self._frames:
            missing = self._tree.missing(frame)
            if missing:
                self._refusals.add(self.topics[0], "frame not reached", missing)
        if self._tree.newest(self._frames) == 0:
            names = " and ".join(self._frames)
            text = f"{names} hang on {self.frame_id} by static transforms alone: they have no time"
            self._refusals.add(self.topics[1], "nothing moves", text)

    def _put(self, transform: Any, static: bool) -> None:
        """One transform.

        Raises
        ------
        InputError, ArgumentError
        """
        parent, child = transform.header.frame_id.removeprefix("/"), transform.child_frame_id.removeprefix("/")
        pose = partial(_pose, transform)
        if static:
            self._tree.put_static(parent, child, pose)
        elif not self._tree.changes_nothing(parent, child) and self._tree.put(parent, child, stamp_of(transform), pose):
            self.restarted = True
            self._last = 0


def _pose(transform: Any) -> Pose:
    """Where the child is in its parent."""
    p, q = transform.transform.translation, transform.transform.rotation
    return Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
