"""Which ends of a harness are held, and how: :class:`HarnessFile`, a harness's file with its key `ends`.

Beside the keys of :mod:`cable_shape.cable.harness_file`, for the node and for replays::

    ends:
      trunk.start: {}                                           # a gripper's pose is the cable frame, clamped
      left.end: {kind: swivel, offset: {position: [0, 0, 0.1]}} # or pinned; the cable frame in the gripper's
      right.end: {mass: 0.03}                                   # free, with the mass of a connector [kg]

Open ends that it does not name are free. Where there is no such key, every open end is held. For replays, where tracked
markers are along segments [m], in the order in which a recording has them::

    markers: {trunk+left: [0.0, 0.2, 0.4, 0.6, 0.9], right: [0.1, 0.3]}
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.harness import Harness, run_of
from cable_shape.cable.harness_file import ENDS, MARKERS, pose_of
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.files.files import path_of
from cable_shape.files.yaml_files import load_yaml
from cable_shape.pose import IDENTITY, FreeEnd, Grip, Pose, pose_entry
from cable_shape.scene.scene import Scene
from cable_shape.solve.harness_problem import HarnessProblem

GRIP_KEYS, FREE_KEYS = ("kind", "offset"), ("mass", "force", "moment")
#: Where an end is held without a gripper, as `cable-shape predict` takes it; grippers say it themselves.
PLACE_KEYS = ("position", "quaternion")
_CLAMPED = Grip(IDENTITY)


def grip_name(harness: str, end: str) -> str:
    """What the grip of an end is called in topics and frames: "harness/segment_start"."""
    return f"{harness}/{end.replace('.', '_')}"


@final
@dataclass(frozen=True, slots=True)
class HarnessFile:
    """A harness, and what its file says of its ends: grips at the origin, or loads of free ends; called as the file.

    markers : arc lengths [m] along a segment, or along several joined by "+".
    """

    harness: Harness
    ends: Mapping[str, Grip | FreeEnd] = field(default_factory=dict, hash=False)
    name: str = "harness"
    markers: Mapping[str, tuple[float, ...]] = field(default_factory=dict, hash=False)

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
        seen = values.get(MARKERS) or {}
        checks.instance(f"{where}: {MARKERS}", seen, (Mapping,), "Write {trunk+left: [0.0, 0.2]}.")
        return cls(
            harness,
            {end: _end(f"{where}: {ENDS}.{end}", given) for end, given in ends.items()},
            markers={key: _places(f"{where}: {MARKERS}.{key}", key, at, harness) for key, at in seen.items()},
        )

    @classmethod
    def from_yaml(cls, path: str | Path) -> HarnessFile:
        """From a harness's file, whose name is the harness's."""
        file = path_of(path)
        return replace(cls.from_mapping(load_yaml(path), str(path), file.parent), name=file.stem)

    @property
    def grips(self) -> dict[str, Grip]:
        """The ends that it says are held."""
        return {end: held for end, held in self.ends.items() if isinstance(held, Grip)}

    @property
    def free(self) -> dict[str, FreeEnd]:
        """The loads of free ends."""
        return {end: held for end, held in self.ends.items() if isinstance(held, FreeEnd)}

    def as_dict(self) -> dict[str, Any]:
        """The mapping that `from_mapping` takes, as plain numbers, lists and words."""
        ends = {
            end: {"kind": held.kind, "offset": pose_entry(held.offset)}
            if isinstance(held, Grip)
            else {"mass": held.mass, "force": held.force.tolist(), "moment": held.moment.tolist()}
            for end, held in self.ends.items()
        }
        return {**self.harness.as_dict(), ENDS: ends, MARKERS: {run: list(at) for run, at in self.markers.items()}}

    @property
    def grip_names(self) -> tuple[str, ...]:
        """What grips are called in topics and frames."""
        return tuple(grip_name(self.name, end) for end in self.grips)

    def held_by(self, grips: Sequence[Grip]) -> dict[str, Grip | FreeEnd]:
        """The ends where these grips hold it."""
        return {**dict(zip(self.grips, grips, strict=True)), **self.free}

    def at(self, poses: Sequence[Pose]) -> dict[str, Grip | FreeEnd]:
        """The same where its own grips are at these poses."""
        return self.held_by([grip.at(pose) for grip, pose in zip(self.grips.values(), poses, strict=True)])

    def holding(self, named: Iterable[str] = (), scene: Scene | None = None) -> HarnessFile:
        """The same with the ends that are `held`."""
        return replace(self, ends=self.held(named, scene))

    def held(self, named: Iterable[str] = (), scene: Scene | None = None) -> dict[str, Grip | FreeEnd]:
        """The ends for :meth:`cable_shape.Cycle.step`, grips at the origin: those `named`, else those of the file.

        Raises
        ------
        ArgumentError
            For an end that cannot be held, and where a part of the harness, or all of it, is held by no gripper.
        """
        grips = tuple(named) or tuple(self.grips)
        if not (grips or self.ends):
            grips = self.harness.open_ends
        if not grips:
            open_ends = ", ".join(self.harness.open_ends) or "none is open"
            raise ArgumentError.of("ends", [], "no gripper would hold the harness", f"Name some of: {open_ends}.")
        out: dict[str, Grip | FreeEnd] = {
            end: held if isinstance(held := self.ends.get(end), Grip) else _CLAMPED for end in grips
        }
        out |= {end: held for end, held in self.free.items() if end not in out}
        HarnessProblem(self.harness, scene=scene).move(out)
        return out


def _places(where: str, key: str, at: Any, harness: Harness) -> tuple[float, ...]:
    """Arc lengths of markers on a run of segments."""
    run = run_of(key, harness)
    for segment in run:
        if segment not in harness.segments:
            raise UnknownKeyError.among(where, segment, harness.segments)
    places = np.atleast_1d(checks.numbers(where, at, "Write a list of arc lengths in m."))
    length = sum(harness.segments[segment].length for segment in run)
    if places.ndim != 1 or not len(places) or not ((places >= 0.0) & (places <= length)).all():
        bound = f"it must be arc lengths from 0 to {length:g} m"
        raise ArgumentError.of(where, places.tolist(), bound, "Count along the segments named, one after the other.")
    return tuple(places.tolist())


def _end(where: str, values: Any) -> Grip | FreeEnd:
    """A grip, or a free end from its keywords."""
    if values is None:
        return FreeEnd()
    checks.known_keys(where, values, (*GRIP_KEYS, *FREE_KEYS, *PLACE_KEYS))
    try:
        if any(key in values for key in FREE_KEYS):
            checks.known_keys(where, values, FREE_KEYS)
            return FreeEnd(**values)
        return Grip(IDENTITY, values.get("kind", "clamped"), pose_of("offset", values.get("offset") or {}))
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None
