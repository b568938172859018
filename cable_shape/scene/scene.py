"""What surrounds the cable, as :class:`Scene`: its parts are in `scene_parts`, their bodies in `solids`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, final

from cable_shape import checks
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of
from cable_shape.pose import Pose, pose_entry
from cable_shape.scene.plug import Plug
from cable_shape.scene.points import HeightField, Points
from cable_shape.scene.scene_files import allow_entry, clip_entry, keywords_of, mass_entry, obstacle_entry, plug_entry
from cable_shape.scene.scene_parts import CLIP_KINDS, Allow, Clip, Obstacle, PointMass, clip_names
from cable_shape.scene.solids import Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere

__all__ = [
    "CLIP_KINDS", "CONTACT_KINDS", "SCENE_KEYS", "Allow", "Box", "Capsule", "Clip", "Cylinder", "HalfSpace",
    "HeightField", "Mesh", "Obstacle", "PointMass", "Points", "Scene", "Solid", "Sphere",
]  # fmt: skip

CONTACT_KINDS = ("off", "warn", "solve")


@final
@dataclass(frozen=True, slots=True)
class Scene:
    """Obstacles, clips and masses around one cable, and the distances at which to warn.

    Parameters
    ----------
    obstacles, clips, masses : sequence of Obstacle, Clip, PointMass
        Kept as a tuple. Names of obstacles are unique, and those of clips; clips are in ascending arc length.
    warn_distance, error_distance : float
        [m], a clearance below these is a warning of severity WARN, ERROR.
    sockets : mapping of name to Pose
        World frame of a plug when it is in the socket; z points into the socket.
    plug : Plug, optional
        At the end of every cable that has no other one.
    contact : str
        What obstacles and robot links do: "warn" (default) of the clearance to them; "solve" keeps the cable out of
        them in the equilibrium, and out of each other and of themselves, held along bodies by their friction
        (Cosserat rod only), and warns, too; "off" neither. With eyelets, cables are not kept out of each other.
    allow : sequence of Allow
        Contact that is meant, of which no clearance warns. What holds for a body holds where any of them allows it; a
        `max_force` needs contact="solve".

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    obstacles: Sequence[Obstacle] = ()
    clips: Sequence[Clip] = ()
    masses: Sequence[PointMass] = ()
    warn_distance: float = 0.03
    error_distance: float = 0.01
    sockets: Mapping[str, Pose] = dataclasses.field(default_factory=dict, hash=False)
    plug: Plug | None = None
    contact: str = "warn"
    allow: Sequence[Allow] = ()

    def __post_init__(self) -> None:
        checks.one_of("contact", self.contact, CONTACT_KINDS)
        for name, kind in (("obstacles", Obstacle), ("clips", Clip), ("masses", PointMass), ("allow", Allow)):
            object.__setattr__(self, name, checks.entries(name, getattr(self, name), kind))
        for name in ("warn_distance", "error_distance"):
            object.__setattr__(self, name, checks.number(name, getattr(self, name), at_least=0.0, unit="m"))
        _unique_names("obstacles", [obstacle.name for obstacle in self.obstacles])
        if not isinstance(self.sockets, Mapping):
            raise ArgumentError.of("sockets", self.sockets, "it must be a mapping", "Write {name: Pose(...)}.")
        object.__setattr__(self, "sockets", dict(self.sockets))
        for name, pose in self.sockets.items():
            checks.word("sockets", name)
            checks.instance(f"sockets[{name!r}]", pose, (Pose,), "Write Pose(position, quaternion).")
        if self.plug is not None:
            checks.instance("plug", self.plug, (Plug,), "Write Plug(socket).")
            checks.one_of("plug.socket", self.plug.socket, self.sockets)
        for segment in dict.fromkeys(clip.segment for clip in self.clips):
            of_one = [(i, clip) for i, clip in enumerate(self.clips) if clip.segment == segment]
            for (i, clip), (k, following) in pairwise(of_one):
                if not clip.arc_length < following.arc_length:
                    raise ArgumentError.of(
                        f"clips[{k}].arc_length",
                        following.arc_length,
                        f"it must be above that of clips[{i}], {clip.arc_length:g} m",
                        "List the clips in the order in which the cable runs through them, no two at one arc length.",
                    )
        _unique_names("clips", clip_names(self.clips))
        for i, allow in enumerate(self.allow):
            if allow.max_force is not None and self.contact != "solve":
                bound = f"contact={self.contact!r} knows no forces"
                raise ArgumentError.of(
                    f"allow[{i}].max_force", allow.max_force, bound, "Write contact='solve', or leave it out."
                )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "scene", folder: str | Path = ".") -> Scene:
        """From a mapping whose keys are the keywords of Scene, see :mod:`cable_shape.scene.scene_files`.

        `where` is named in errors; the paths of meshes are taken from `folder`.
        """
        checks.known_keys(where, values, SCENE_KEYS)
        keywords = keywords_of(values, where, path_of(folder, "folder"))
        try:
            return cls(**keywords)
        except ArgumentError as error:
            raise type(error)(f"{where}: {error}") from None

    @classmethod
    def from_yaml(cls, path: str | Path) -> Scene:
        """From a YAML file whose keys are the keywords of Scene; the paths of meshes are taken from its folder."""
        from cable_shape.files.yaml_files import load_yaml

        return cls.from_mapping(load_yaml(path), where=str(path), folder=path_of(path).parent)

    def as_dict(self) -> dict[str, Any]:
        """The mapping that `from_mapping` takes, as plain numbers, lists and words; meshes are written out."""
        return {
            "obstacles": [obstacle_entry(obstacle) for obstacle in self.obstacles],
            "clips": [clip_entry(clip) for clip in self.clips],
            "masses": [mass_entry(mass) for mass in self.masses],
            "warn_distance": self.warn_distance,
            "error_distance": self.error_distance,
            "sockets": {name: pose_entry(pose) for name, pose in self.sockets.items()},
            "plug": self.plug and plug_entry(self.plug),
            "contact": self.contact,
            "allow": [allow_entry(allow) for allow in self.allow],
        }

    def replace(self, **changes: Any) -> Scene:
        """A copy with some keywords changed."""
        checks.known_keys("Scene.replace", changes, SCENE_KEYS)
        return dataclasses.replace(self, **changes)


SCENE_KEYS = tuple(f.name for f in dataclasses.fields(Scene))


def _unique_names(where: str, names: Iterable[str]) -> None:
    """Refuses two parts of one name: reports could not tell them apart."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ArgumentError.of(where, name, "names must be unique", "Rename one of them.")
        seen.add(name)
