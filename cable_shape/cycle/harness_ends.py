"""Which ends of a harness are held, and how: :class:`HarnessFile`, a harness's file with its key `ends`.

Beside the keys of :mod:`cable_shape.cable.harness_file`, for the node and for replays::

    ends:
      trunk.start: {}                                           # a gripper's pose is the cable frame, clamped
      left.end: {kind: swivel, offset: {position: [0, 0, 0.1]}} # or pinned; the cable frame in the gripper's
      right.end: {mass: 0.03}                                   # free, with the mass of a connector [kg]

Open ends that it does not name are free. Where there is no such key, every open end is held.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.cable.harness_file import ENDS, pose_of
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of
from cable_shape.files.yaml_files import load_yaml
from cable_shape.pose import IDENTITY, FreeEnd, Grip
from cable_shape.scene.scene import Scene
from cable_shape.solve.harness_problem import HarnessProblem

GRIP_KEYS, FREE_KEYS = ("kind", "offset"), ("mass", "force", "moment")
_CLAMPED = Grip(IDENTITY)


def grip_name(harness: str, end: str) -> str:
    """What the grip of an end is called in topics and frames: "harness/segment_start"."""
    return f"{harness}/{end.replace('.', '_')}"


@final
@dataclass(frozen=True, slots=True)
class HarnessFile:
    """A harness, and what its file says of its ends: grips at the origin, or loads of free ends; called as the file."""

    harness: Harness
    ends: Mapping[str, Grip | FreeEnd] = field(default_factory=dict, hash=False)
    name: str = "harness"

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "harness", folder: str | Path = ".") -> HarnessFile:
        """From a mapping with the keys of a harness, with or without `ends`; paths of cables are taken from `folder`.

        Raises
        ------
        ArgumentError
            Naming the key, the bound and the remedy.
        """
        harness = Harness.from_mapping(values, where, folder)
        ends = checks.mapping(f"{where}: {ENDS}", values.get(ENDS), harness.open_ends, "Write {trunk.start: {}}.")
        return cls(harness, {end: _end(f"{where}: {ENDS}.{end}", given) for end, given in ends.items()})

    @classmethod
    def from_yaml(cls, path: str | Path) -> HarnessFile:
        """From a harness's file, whose name is the harness's."""
        file = path_of(path)
        return replace(cls.from_mapping(load_yaml(path), str(path), file.parent), name=file.stem)

    def held(self, named: Iterable[str] = (), scene: Scene | None = None) -> dict[str, Grip | FreeEnd]:
        """The ends for :meth:`cable_shape.Cycle.step`, grips at the origin: those `named`, else those of the file.

        Raises
        ------
        ArgumentError
            For an end that cannot be held, and where a part of the harness, or all of it, is held by no gripper.
        """
        grips = tuple(named) or tuple(end for end, held in self.ends.items() if isinstance(held, Grip))
        if not (grips or self.ends):
            grips = self.harness.open_ends
        if not grips:
            open_ends = ", ".join(self.harness.open_ends) or "none is open"
            raise ArgumentError.of("ends", [], "no gripper would hold the harness", f"Name some of: {open_ends}.")
        out: dict[str, Grip | FreeEnd] = {
            end: held if isinstance(held := self.ends.get(end), Grip) else _CLAMPED for end in grips
        }
        out |= {end: held for end, held in self.ends.items() if isinstance(held, FreeEnd) and end not in out}
        HarnessProblem(self.harness, scene=scene).move(out)
        return out


def _end(where: str, values: Any) -> Grip | FreeEnd:
    """A grip, or a free end from its keywords."""
    if values is None:
        return FreeEnd()
    checks.known_keys(where, values, (*GRIP_KEYS, *FREE_KEYS))
    try:
        if any(key in values for key in FREE_KEYS):
            checks.known_keys(where, values, FREE_KEYS)
            return FreeEnd(**values)
        return Grip(IDENTITY, values.get("kind", "clamped"), pose_of("offset", values.get("offset") or {}))
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None
