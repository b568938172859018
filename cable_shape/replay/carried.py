"""What is carried in a recording: a cable by two grips, or a harness by as many as it has. :func:`carried`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, final

from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import Held
from cable_shape.cable.harness import Harness
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip, Pose
from cable_shape.replay.marked import Marked

if TYPE_CHECKING:
    from cable_shape.replay.settings import Settings

CABLE = "cable"


class Carried(Protocol):
    """What it is, the topics of its grips' poses, and the ends that they make."""

    @property
    def name(self) -> str: ...

    @property
    def what(self) -> Cable | Harness: ...

    @property
    def topics(self) -> tuple[str, ...]: ...

    @property
    def marked(self) -> Marked | None: ...  # where markers are on it; None: it is not known

    def held(self, grips: Sequence[Grip]) -> Any: ...  # for a cycle, from grips of a robot

    def at(self, poses: Sequence[Pose]) -> Any: ...  # the same from the poses of `topics`


def carried(settings: Settings) -> Carried:
    """What the settings say.

    Raises
    ------
    ArgumentError
        For ends of a harness that cannot be held.
    """
    if settings.harness is None:
        assert settings.cable is not None
        return _Cable(settings.cable, (settings.left_topic, settings.right_topic), (settings.start, settings.end))
    return _Harness(settings.harness.holding(settings.held_ends, settings.scene), settings.end_topics)


@final
@dataclass(frozen=True, slots=True)
class _Cable:
    what: Cable
    topics: tuple[str, ...]
    known: tuple[Held, Held]
    name: str = CABLE

    @property
    def marked(self) -> Marked:
        return Marked(self.name, self.what)

    def held(self, grips: Sequence[Grip]) -> Any:
        return tuple(known.grip(grip) for known, grip in zip(self.known, grips, strict=True))

    def at(self, poses: Sequence[Pose]) -> Any:
        return self.held([Grip(pose) for pose in poses])


@final
class _Harness:
    def __init__(self, file: HarnessFile, topics: Mapping[str, str]) -> None:
        self.file, self.name, self.what = file, file.name, file.harness
        for end in topics:
            if end not in file.grips:
                held = ", ".join(file.grips)
                raise ArgumentError.of("end_topics", end, "this end is not held", f"Held are: {held}.")
        names = zip(file.grips, file.grip_names, strict=True)
        self.topics = tuple(topics.get(end, f"/{name}/pose") for end, name in names)
        self.marked = Marked(file.name, file) if file.markers else None
        self.at = file.at

    def held(self, grips: Sequence[Grip]) -> Any:
        if len(grips) != len(self.file.grips):
            bound = f"the robot's {len(grips)} grippers move as many ends, the first one the first"
            raise ArgumentError.of("held_ends", list(self.file.grips), bound, f"Name {len(grips)} ends.")
        return self.file.held_by(grips)
