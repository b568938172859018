"""What may change while a cable is watched: edits such as :class:`Insert` and :class:`Regrip`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias, final

from cable_shape import checks
from cable_shape.cable.cable import TAIL_SIDES, Cable
from cable_shape.pose import Pose
from cable_shape.scene.scene import Clip, Obstacle, PointMass

_WRITE_CLIP = "Write Clip(arc_length, pose)."


def _check_end(name: str, end: object) -> None:
    """ "start" or "end", of a harness with its segment before it."""
    checks.word(name, end)
    checks.one_of(name, str(end).rpartition(".")[2], TAIL_SIDES)


@final
@dataclass(frozen=True, slots=True)
class Add:
    """A body, a connector on the cable, or a clip that takes the cable as :class:`Insert` has it."""

    part: Obstacle | PointMass | Clip

    def __post_init__(self) -> None:
        checks.instance("Add.part", self.part, (Obstacle, PointMass, Clip), "Write Obstacle(name, solid, pose).")


@final
@dataclass(frozen=True, slots=True)
class Remove:
    """The body or the clip of this name goes."""

    name: str

    def __post_init__(self) -> None:
        checks.word("Remove.name", self.name)


@final
@dataclass(frozen=True, slots=True)
class Move:
    """The body or the clip of this name goes to `pose`, on the straight way, and takes the cable along."""

    name: str
    pose: Pose

    def __post_init__(self) -> None:
        checks.word("Move.name", self.name)
        checks.instance("Move.pose", self.pose, (Pose,), "Write Pose(position, quaternion).")


@final
@dataclass(frozen=True, slots=True)
class Insert:
    """The cable is laid into a clip or an eyelet, on the straight way from where it is.

    The clip's `arc_length` counts from the start grip as it is now. One without a name gets the first free "clipN".
    """

    clip: Clip

    def __post_init__(self) -> None:
        checks.instance("Insert.clip", self.clip, (Clip,), _WRITE_CLIP)


@final
@dataclass(frozen=True, slots=True)
class Release:
    """The clip of this name opens: the cable slides to where it comes to rest."""

    name: str

    def __post_init__(self) -> None:
        checks.word("Release.name", self.name)


@final
@dataclass(frozen=True, slots=True)
class Regrip:
    """A gripper takes the cable elsewhere, or takes an end that was open.

    Where a "fixed" clip holds it, which may be a third gripper, it takes it over: that clip is gone.

    end : str
        "start" or "end"; of a harness "a.start" or "a.end", an open end.
    arc_length : float
        [m] of the cable as it was made: 0 at its start, negative or beyond its length on its tails.
    """

    end: str
    arc_length: float

    def __post_init__(self) -> None:
        _check_end("Regrip.end", self.end)
        object.__setattr__(self, "arc_length", checks.number("Regrip.arc_length", self.arc_length, unit="m"))


@final
@dataclass(frozen=True, slots=True)
class Open:
    """The gripper at this end opens: what it held hangs free, its tail with it, until `Regrip`; not both ends do."""

    end: str

    def __post_init__(self) -> None:
        _check_end("Open.end", self.end)


@final
@dataclass(frozen=True, slots=True)
class SetCable:
    """The cable is this one: other numbers, another length. `tails` of it are beyond the grips as it is made."""

    cable: Cable

    def __post_init__(self) -> None:
        checks.instance("SetCable.cable", self.cable, (Cable,), "Write Cable(length=..., ...).")


Edit: TypeAlias = Add | Remove | Move | Insert | Release | Regrip | Open | SetCable
EDITS = (Add, Remove, Move, Insert, Release, Regrip, Open, SetCable)


@final
@dataclass(frozen=True, slots=True)
class EditResult:
    """What came of edits, true where they are done; `reason`: why not, with what to do, else empty."""

    done: bool
    reason: str = ""

    def __bool__(self) -> bool:
        return self.done
