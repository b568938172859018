"""Where cables of a harness meet: :class:`Junction`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, final

from cable_shape import checks
from cable_shape.cable.rest_form import third_axis
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import IDENTITY, Pose

JUNCTION_KINDS = ("rigid", "ball")


@final
@dataclass(frozen=True, slots=True)
class Junction:
    """Where ends of segments meet; nothing holds it but they.

    Parameters
    ----------
    name : str
    ends : sequence of str
        Two or more ends of segments, "a.start" or "b.end"; the first one carries the junction's frame.
    kind : str
        "rigid": the ends' frames keep to each other; "ball": every end is free of moment.
    frames : mapping of an end to Pose
        Of a rigid junction: that end's cable frame in the junction's frame. d3 points along increasing arc length, so
        out of the junction at a start and into it at an end. Default: the identity, of a branch that leaves, or comes,
        along the trunk.
    mass : float
        [kg], at the junction's origin, at least 0.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    name: str
    ends: Sequence[str]
    kind: str = "rigid"
    frames: Mapping[str, Pose] = dataclasses.field(default_factory=dict, hash=False)
    mass: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        checks.word("Junction.name", self.name)
        where = f"junction {self.name!r}"
        put(self, "ends", checks.entries(f"{where}: ends", self.ends, str, "Write ends=('a.end', 'b.start')."))
        if len(self.ends) < 2:
            raise ArgumentError.of(
                f"{where}: ends", list(self.ends), "at least two ends meet in a junction", "Name another, or leave it."
            )
        checks.one_of(f"{where}: kind", self.kind, JUNCTION_KINDS)
        put(self, "mass", checks.number(f"{where}: mass", self.mass, at_least=0.0, unit="kg"))
        frames = checks.mapping(f"{where}: frames", self.frames, self.ends, "Write {end: Pose(...)}.")
        for end, frame in frames.items():
            checks.instance(f"{where}: frames[{end!r}]", frame, (Pose,), "Write Pose(position, quaternion).")
            if frame.turns:
                bound = "a frame in a junction has no windings"
                raise ArgumentError.of(f"{where}: frames[{end!r}].turns", frame.turns, bound, "Leave them out.")
            if self.kind == "ball" and frame.position.any():
                raise ArgumentError.of(
                    f"{where}: frames[{end!r}].position", frame.position.tolist(),
                    "a ball joins its ends in one point", "Make the junction rigid, or leave the position out.",
                )  # fmt: skip
        put(self, "frames", MappingProxyType(frames))

    def frame(self, end: str) -> Pose:
        """The cable frame of an end in the junction's frame; of a ball the identity."""
        return IDENTITY if self.kind == "ball" else self.frames.get(end, IDENTITY)

    def leaving(self, end: str) -> Array:
        """(3,), unit, in the junction's frame: where the segment goes that has this end."""
        axis: Array = third_axis(self.frame(end).quaternion[None])[0]
        return axis if end.endswith(".start") else -axis

    def __reduce__(self) -> tuple[Any, ...]:
        return Junction, (self.name, self.ends, self.kind, dict(self.frames), self.mass)
