"""What is carried in a recording: a cable by two grips, or a harness by as many as it has. :func:`carried`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, final

from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import Held
from cable_shape.cable.harness import Harness
from cable_shape.cycle.harness_ends import grip_name
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose

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
    file = settings.harness
    ends = file.held(settings.held_ends, settings.scene)
    return _Harness(file.name, file.harness, ends, dict(settings.end_topics))


@final
@dataclass(frozen=True, slots=True)
class _Cable:
    what: Cable
    topics: tuple[str, ...]
    known: tuple[Held, Held]
    name: str = CABLE

    def held(self, grips: Sequence[Grip]) -> Any:
        return tuple(known.grip(grip) for known, grip in zip(self.known, grips, strict=True))

    def at(self, poses: Sequence[Pose]) -> Any:
        return self.held([Grip(pose) for pose in poses])


@final
class _Harness:
    def __init__(self, name: str, what: Harness, ends: dict[str, Grip | FreeEnd], topics: dict[str, str]) -> None:
        self.name, self.what = name, what
        self._grips = {end: held for end, held in ends.items() if isinstance(held, Grip)}
        self._free = {end: held for end, held in ends.items() if isinstance(held, FreeEnd)}
        for end in topics:
            if end not in self._grips:
                held = ", ".join(self._grips)
                raise ArgumentError.of("end_topics", end, "this end is not held", f"Held are: {held}.")
        self.topics = tuple(topics.get(end, f"/{grip_name(name, end)}/pose") for end in self._grips)

    def held(self, grips: Sequence[Grip]) -> Any:
        if len(grips) != len(self._grips):
            bound = f"the robot's {len(grips)} grippers move as many ends, the first one the first"
            raise ArgumentError.of("held_ends", list(self._grips), bound, f"Name {len(grips)} ends.")
        return {**dict(zip(self._grips, grips, strict=True)), **self._free}

    def at(self, poses: Sequence[Pose]) -> Any:
        return self.held([grip.at(pose) for grip, pose in zip(self._grips.values(), poses, strict=True)])
