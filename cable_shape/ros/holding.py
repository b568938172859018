"""Which grips hold a cable or a harness: what brings them, and the ends that they make, as :class:`Holding`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

from cable_shape.cable.cable_file import AS_GIVEN, Held
from cable_shape.cable.harness import split_end
from cable_shape.cycle.harness_ends import grip_name
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose
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
    grips : mapping of end to Grip, optional
        Of a harness, at the origin; None: it is a cable.
    free : mapping of end to FreeEnd
        Of a harness: what hangs at ends that nothing holds.
    """

    cable_id: str
    prefix: str = ""
    known: tuple[Held, Held] = (AS_GIVEN, AS_GIVEN)
    grips: Mapping[str, Grip] | None = None
    free: Mapping[str, FreeEnd] = field(default_factory=dict)

    @classmethod
    def of_harness(cls, name: str, ends: Mapping[str, Grip | FreeEnd]) -> Holding:
        """As :meth:`cable_shape.cycle.harness_ends.HarnessFile.held` says.

        Raises
        ------
        ArgumentError
            For a name that cannot be a part of a topic.
        """
        grips = {end: held for end, held in ends.items() if isinstance(held, Grip)}
        for word in (name, *(split_end(end)[0] for end in grips)):
            if not NAME.fullmatch(word):
                bound = "a name must be letters, digits and _, beginning with a letter"
                remedy = "It is a part of the topics: rename the harness's file, or the segment."
                raise ArgumentError.of("harness_file", word, bound, remedy)
        return cls(name, grips=grips, free={end: held for end, held in ends.items() if isinstance(held, FreeEnd)})

    @property
    def topics(self) -> tuple[str, ...]:
        """Of the poses, one for each grip."""
        if self.grips is None:
            return tuple(self.prefix + topic for topic in POSE_TOPICS)
        return tuple(f"{name}/pose" for name in self._names)

    def frames(self, settings: Settings) -> tuple[str, ...]:
        """Of the grips on /tf, one for each."""
        if self.grips is None:
            both = settings.left_gripper_frame, settings.right_gripper_frame
            return tuple(self.prefix + frame.lstrip("/") for frame in both)
        return self._names

    @property
    def _names(self) -> tuple[str, ...]:
        """Of a harness's grips: "harness/segment_end"."""
        return tuple(grip_name(self.cable_id, end) for end in self.grips or ())

    def told(self, settings: Settings) -> tuple[Grip, ...]:
        """The grips at the origin, with kind and offset."""
        return settings.grips(self.known) if self.grips is None else tuple(self.grips.values())

    def ends(self, grips: Sequence[Grip]) -> Any:
        """What a cycle takes: (start, end) of a cable, of a harness the mapping of ends."""
        return tuple(grips) if self.grips is None else {**dict(zip(self.grips, grips, strict=True)), **self.free}

    def at(self, grips: Sequence[Grip], poses: Sequence[Pose]) -> Any:
        """The same where the grips are at these poses."""
        return self.ends([grip.at(pose) for grip, pose in zip(grips, poses, strict=True)])
