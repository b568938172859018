"""A cable's file, and how grippers hold that cable where the file knows it: :class:`CableFile` and :class:`Held`.

A file that a calibration wrote has, beside the keywords of Cable, how the grips held the cable while it was seen, and
where its frames were found to lie beside what the grips said::

    length: 0.998
    linear_density: 0.1
    bending_stiffness: [0.0009, 0.0009]
    grips:
      start: {kind: clamped, correction: {position: [0.002, 0.0, -0.001], quaternion: [0.02, 0.01, 0.0, 0.99975]}}
      end: {kind: swivel}
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from cable_shape import checks
from cable_shape.cable.cable import GRIPS, Cable
from cable_shape.errors import ArgumentError
from cable_shape.pose import GRIP_KINDS, Grip, Pose, as_grip

SIDES = ("start", "end")


@final
@dataclass(frozen=True, slots=True)
class Held:
    """What is known of how one gripper holds its end, beside what a Grip says.

    Parameters
    ----------
    kind : str, optional
        "clamped", "swivel" or "pinned", in place of the grip's.
    offset : Pose, optional
        The cable frame in the tool frame, in place of the grip's.
    correction : Pose, optional
        Where the cable frame lies in the one that pose and offset say, as a calibration found it.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    kind: str | None = None
    offset: Pose | None = None
    correction: Pose | None = None

    def __post_init__(self) -> None:
        if self.kind is not None:
            checks.one_of("kind", self.kind, GRIP_KINDS)
        for name in ("offset", "correction"):
            if getattr(self, name) is not None:
                checks.instance(name, getattr(self, name), (Pose,), "Write Pose(position, quaternion).")

    def grip(self, end: Pose | Grip) -> Grip:
        """The same end, held in this way; a bare Pose is a clamped grip where no kind is known."""
        grip = as_grip("end", end)
        if self == AS_GIVEN:
            return grip
        offset = self.offset or grip.offset
        if self.correction is not None:
            offset = offset * self.correction
        return Grip(grip.pose, self.kind or grip.kind, offset, grip.curvature)

    def told(self, kind: str | None = None, offset: Pose | None = None) -> Held:
        """The same but for what is told here; the correction stays."""
        return Held(kind or self.kind, offset or self.offset, self.correction)

    def then(self, found: Held) -> Held:
        """What a calibration found between grips that were held in this way: its kind, and both corrections."""
        parts = [part for part in (self.correction, found.correction) if part is not None]
        both = None if not parts else parts[0] if len(parts) == 1 else parts[0] * parts[1]
        return Held(found.kind or self.kind, self.offset, both)

    def describe(self) -> str:
        """In words; empty where nothing is known."""
        words = [] if self.kind is None else [self.kind]
        if self.correction is not None:
            way, angle = Pose().distance(self.correction)
            words.append(f"corrected by {1e3 * way:.3g} mm and {math.degrees(angle):.3g} degrees")
        return ", ".join(words)

    def as_dict(self) -> dict[str, Any]:
        """Its part of a file, as plain numbers and lists."""
        out: dict[str, Any] = {} if self.kind is None else {"kind": self.kind}
        if self.correction is not None:
            place, turn = self.correction.position.tolist(), self.correction.quaternion.tolist()
            out["correction"] = {"position": place, "quaternion": turn}
        return out

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "held") -> Held:
        """What :meth:`as_dict` says."""
        checks.known_keys(where, values, ("kind", "correction"))
        given = values.get("correction")
        try:
            if given is not None:
                checks.known_keys("correction", given, ("position", "quaternion"))
            return cls(values.get("kind"), None, None if given is None else Pose(**given))
        except ArgumentError as error:
            raise type(error)(f"{where}: {error}") from None


AS_GIVEN = Held()


@final
@dataclass(frozen=True, slots=True)
class CableFile:
    """A cable, and how its grips hold it where that is known.

    `start` and `end` correct grips: ``file.start.grip(cs.Grip(pose, offset=...))``.
    """

    cable: Cable
    start: Held = AS_GIVEN
    end: Held = AS_GIVEN

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "cable") -> CableFile:
        """From a mapping with the keys that :meth:`Cable.from_mapping` takes, and `grips`.

        Raises
        ------
        ArgumentError
            Naming the key, the bound and the remedy.
        """
        cable = Cable.from_mapping(values, where)
        given = checks.mapping(f"{where}: {GRIPS}", values.get(GRIPS), SIDES, "Write {start: .., end: ..}.")
        told = [{} if given.get(side) is None else given[side] for side in SIDES]
        held = [Held.from_mapping(one, f"{where}: {GRIPS}.{side}") for side, one in zip(SIDES, told, strict=True)]
        return cls(cable, *held)

    @classmethod
    def from_yaml(cls, path: str | Path) -> CableFile:
        """From a cable's YAML file, one that a calibration wrote or any other."""
        from cable_shape.files.yaml_files import load_yaml

        return cls.from_mapping(load_yaml(path), where=str(path))

    def as_dict(self) -> dict[str, Any]:
        """The mapping that makes it, as plain numbers, lists and None; offsets are no part of it."""
        return {
            **self.cable.as_dict(),
            GRIPS: {side: held.as_dict() for side, held in zip(SIDES, self.held, strict=True)},
        }

    @property
    def held(self) -> tuple[Held, Held]:
        """Start and end."""
        return self.start, self.end

    def describe(self) -> str:
        """What is known of the grips, in words; empty where nothing is."""
        told = ((side, held.describe()) for side, held in zip(SIDES, self.held, strict=True))
        return "; ".join(f"{side} {words}" for side, words in told if words)
