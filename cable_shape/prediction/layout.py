"""What edits change: :class:`Layout`, cables as they are held now among bodies as they are now."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

from cable_shape.cable.cable import Cable
from cable_shape.cable.cut import stretch_of
from cable_shape.cable.harness import Harness
from cable_shape.scene.scene import Allow, Clip, Obstacle, PointMass, Scene
from cable_shape.scene.scene_files import clip_entry, clip_of, mass_entry, part_of
from cable_shape.scene.scene_parts import clip_names


@final
@dataclass(frozen=True, slots=True)
class Laid:
    """One cable as it is held: between which arc lengths [m] of it as it was made, in which clips, with which masses.

    Arc lengths of clips and masses count from the start grip. opened: the end, "start" or "end", that nothing holds,
    whatever gripper is there; "": none.
    """

    made: Cable
    first: float
    last: float
    clips: tuple[Clip, ...] = ()
    masses: tuple[PointMass, ...] = ()
    opened: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Keys and values for :meth:`from_mapping`: numbers, texts, lists and mappings."""
        return {
            "made": self.made.as_dict(), "first": float(self.first), "last": float(self.last), "opened": self.opened,
            "clips": [clip_entry(clip) for clip in self.clips], "masses": [mass_entry(mass) for mass in self.masses],
        }  # fmt: skip

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Laid:
        """What `as_dict` made."""
        parts: dict[str, Any] = {
            "made": Cable.from_mapping(values["made"]),
            "clips": tuple(clip_of(one, "clips") for one in values["clips"]),
            "masses": tuple(part_of(one, "masses") for one in values["masses"]),
        }
        return cls(**{**values, **parts})

    @property
    def cable(self) -> Cable:
        """What is between the grips, with the rest as its tails."""
        return stretch_of(self.made, self.first, self.last)

    def held_from(self, first: float, last: float, **changes: Any) -> Laid:
        """The same between other arc lengths, its clips and masses where they are on the cable."""
        shift = self.first - first
        return dataclasses.replace(
            self,
            first=first,
            last=last,
            clips=tuple(dataclasses.replace(clip, arc_length=clip.arc_length + shift) for clip in self.clips),
            masses=tuple(dataclasses.replace(mass, arc_length=mass.arc_length + shift) for mass in self.masses),
            **changes,
        )


@final
@dataclass(frozen=True, slots=True)
class Layout:
    """All cables by name, and the scene that they share: its bodies count, what holds the cables is theirs.

    Segments of a harness "h" are the cables "h/a" and so on. Where the scene allows contact is told by arc lengths of
    the cables as they were made.
    """

    scene: Scene
    cables: Mapping[str, Laid]
    harnesses: Mapping[str, Harness] = field(default_factory=dict)  # of which names and junctions count
    _scenes: dict[str, Scene] = field(default_factory=dict, init=False, repr=False, compare=False)  # those told

    @classmethod
    def of(
        cls,
        scene: Scene,
        cables: Mapping[str, Cable],
        own_clips: Mapping[str, Sequence[Clip]],
        harnesses: Mapping[str, Harness] | None = None,
    ) -> Layout:
        """As it is before any edit; clips without a name get the one that they are called by."""
        laid = {}
        for name, cable in cables.items():
            laid[name] = Laid(cable, 0.0, cable.length, _named(own_clips.get(name, scene.clips)), tuple(scene.masses))
        for name, harness in (harnesses or {}).items():
            clips = _named(own_clips.get(name, scene.clips))
            for segment, cable in harness.segments.items():
                held = tuple(dataclasses.replace(c, segment=None) for c in clips if c.segment == segment)
                heavy = tuple(dataclasses.replace(m, segment=None) for m in scene.masses if m.segment == segment)
                laid[cable_id(name, segment)] = Laid(cable, 0.0, cable.length, held, heavy)
        return cls(scene, laid, dict(harnesses or {}))

    def as_text(self) -> str:
        """All but the harnesses, for :meth:`read`: JSON, whose numbers give back the same bits."""
        cables = {name: laid.as_dict() for name, laid in self.cables.items()}
        return json.dumps({"scene": self.scene.as_dict(), "cables": cables}, allow_nan=False)

    @classmethod
    def read(cls, text: str, harnesses: Mapping[str, Harness]) -> Layout:
        """What `as_text` wrote, of cables and these harnesses."""
        values = json.loads(text)
        cables = {name: Laid.from_mapping(laid) for name, laid in values["cables"].items()}
        return cls(Scene.from_mapping(values["scene"]), cables, harnesses)

    @property
    def single(self) -> dict[str, Laid]:
        """The cables that are no segments."""
        return {name: laid for name, laid in self.cables.items() if self.harness_with(name) is None}

    def harness_with(self, name: str) -> str | None:
        """The harness that this is a segment of; None: it is a cable."""
        harness = name.rpartition("/")[0]
        return harness if harness in self.harnesses else None

    def segments(self, name: str) -> dict[str, Laid]:
        """The segments of a harness, by their own names."""
        return {one: self.cables[cable_id(name, one)] for one in self.harnesses[name].segments}

    def harness_of(self, name: str) -> Harness:
        """A harness as it is between its grips, with the rest as tails."""
        return self.harnesses[name].replace({one: laid.cable for one, laid in self.segments(name).items()})

    def scene_of_harness(self, name: str) -> Scene:
        """What holds and surrounds a harness."""
        segments = self.segments(name).items()
        clips = [dataclasses.replace(clip, segment=one) for one, laid in segments for clip in laid.clips]
        masses = [dataclasses.replace(mass, segment=one) for one, laid in segments for mass in laid.masses]
        return self.scene.replace(clips=clips, masses=masses)

    def scene_of(self, name: str) -> Scene:
        """What holds and surrounds one cable."""
        if name not in self._scenes:
            laid = self.cables[name]
            allow = self.scene.allow
            if laid.first:
                allow = [_shifted(one, laid.first) for one in allow]
            self._scenes[name] = self.scene.replace(clips=laid.clips, masses=laid.masses, allow=allow)
        return self._scenes[name]

    @property
    def common(self) -> Scene:
        """The bodies, and what holds every cable; of a harness alone all that holds it."""
        cables = self.single
        if not cables and len(self.harnesses) == 1:
            return self.scene_of_harness(next(iter(self.harnesses)))
        if not cables:
            return self.scene.replace(clips=(), masses=())
        if len(cables) == 1:
            return self.scene_of(next(iter(cables)))
        first, *others = cables.values()
        clips = [clip for clip in first.clips if all(clip in one.clips for one in others)]
        masses = [mass for mass in first.masses if all(mass in one.masses for one in others)]
        return self.scene.replace(clips=clips, masses=masses)

    def with_cable(self, name: str, **changes: Any) -> Layout:
        """The same with one cable held otherwise."""
        return self.with_laid(name, dataclasses.replace(self.cables[name], **changes))

    def with_laid(self, name: str, laid: Laid) -> Layout:
        """The same with one cable held like this."""
        return dataclasses.replace(self, cables={**self.cables, name: laid})

    def with_bodies(self, bodies: Sequence[Obstacle]) -> Layout:
        """The same with other bodies."""
        return dataclasses.replace(self, scene=self.scene.replace(obstacles=bodies))


def cable_id(harness: str, segment: str) -> str:
    """What a segment of a harness is called among cables: "harness/segment"."""
    return f"{harness}/{segment}"


def _named(clips: Sequence[Clip]) -> tuple[Clip, ...]:
    """The same, each with its name."""
    return tuple(dataclasses.replace(c, name=n) for c, n in zip(clips, clip_names(clips), strict=True))


def _shifted(allow: Allow, by: float) -> Allow:
    """The same stretch of cable, told from a start grip that is by so much [m] further on."""
    start, end = (None if at is None else at - by for at in (allow.start, allow.end))
    return dataclasses.replace(allow, start=start, end=end)
