"""Which grips hold a cable or a harness: what brings them, and the ends that they make, as :class:`Holding`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

from cable_shape.cable.cable_file import AS_GIVEN, Held
from cable_shape.cable.harness import split_end
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip, Pose
from cable_shape.ros.parameters import Settings
from cable_shape.ros.qos import POSE_TOPICS

#: names are parts of topics
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@final
@dataclass(frozen=True, slots=True)
class Holding:
    """The grips of one cable or harness.

    Parameters
    ----------
    cable_id : str
        Name of the cable or harness.
    prefix : str
        Before the names of topics and frames of a cable; empty if it is alone.
    known : (Held, Held)
        What the file of a cable knows of its grips.
    harness : HarnessFile, optional
        With the ends as they are held; None: it is a cable.
    """

    cable_id: str
    prefix: str = ""
    known: tuple[Held, Held] = (AS_GIVEN, AS_GIVEN)
    harness: HarnessFile | None = None

    @classmethod
    def of_harness(cls, file: HarnessFile) -> Holding:
        """As :meth:`cable_shape.cycle.harness_ends.HarnessFile.holding` says.

        Raises
        ------
        ArgumentError
            For a name that cannot be a part of a topic.
        """
        for word in (file.name, *(split_end(end)[0] for end in file.grips)):
            if not NAME.fullmatch(word):
                bound = "a name must be letters, digits and _, beginning with a letter"
                remedy = "It is a part of the topics: rename the harness's file, or the segment."
                raise ArgumentError.of("harness_file", word, bound, remedy)
        return cls(file.name, harness=file)

    @property
    def topics(self) -> tuple[str, ...]:
        """Of the poses, one for each grip."""
        if self.harness is None:
            return tuple(self.prefix + topic for topic in POSE_TOPICS)
        return tuple(f"{name}/pose" for name in self.harness.grip_names)

    def frames(self, settings: Settings) -> tuple[str, ...]:
        """Of the grips on /tf, one for each."""
        if self.harness is None:
            both = settings.left_gripper_frame, settings.right_gripper_frame
            return tuple(self.prefix + frame.lstrip("/") for frame in both)
        return self.harness.grip_names

    def told(self, settings: Settings) -> tuple[Grip, ...]:
        """The grips at the origin, with kind and offset."""
        return settings.grips(self.known) if self.harness is None else tuple(self.harness.grips.values())

    def ends(self, grips: Sequence[Grip]) -> Any:
        """What a cycle takes: (start, end) of a cable, of a harness the mapping of ends."""
        return tuple(grips) if self.harness is None else self.harness.held_by(grips)

    def at(self, grips: Sequence[Grip], poses: Sequence[Pose]) -> Any:
        """The same where the grips are at these poses."""
        return self.ends([grip.at(pose) for grip, pose in zip(grips, poses, strict=True)])
