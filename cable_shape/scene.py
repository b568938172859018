"""What surrounds the cable: obstacles, clips and masses, as :class:`Scene`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.plug import Plug
from cable_shape.pose import IDENTITY, Pose

CLIP_KINDS = ("ball", "fixed", "hinge", "slide")
CONTACT_KINDS = ("off", "warn", "solve")

#: Meshes with more triangles are refused.
MAX_FACES = 200_000


@final
@dataclass(frozen=True, slots=True, eq=False, init=False)
class Box:
    """`size` (3,) [m]: full edge lengths along the obstacle's axes, centred."""

    size: Array

    def __init__(self, size: ArrayLike) -> None:
        size = checks.vector("Box.size", size, 3, "m")
        if not (size > 0.0).all():
            raise ArgumentError.of(
                "Box.size", size.tolist(), "every edge must be above 0 m", "Give full edge lengths in m."
            )
        size.flags.writeable = False
        object.__setattr__(self, "size", size)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Box) and bool(np.array_equal(self.size, other.size))

    def __hash__(self) -> int:
        return hash(self.size.tobytes())


@final
@dataclass(frozen=True, slots=True)
class Sphere:
    """`radius` [m], centred."""

    radius: float

    def __post_init__(self) -> None:
        _positive(self, "Sphere", "radius")


@final
@dataclass(frozen=True, slots=True)
class Cylinder:
    """`radius` [m] and full `length` [m] along the obstacle's z axis, centred, flat ends."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        _positive(self, "Cylinder", "radius", "length")


@final
@dataclass(frozen=True, slots=True)
class Capsule:
    """`radius` [m] and `length` [m] of the straight part along the obstacle's z axis, centred, round ends."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        _positive(self, "Capsule", "radius", "length")


@final
@dataclass(frozen=True, slots=True)
class HalfSpace:
    """Everything with z <= 0 in the obstacle's frame is solid."""


@final
@dataclass(frozen=True, slots=True, eq=False, init=False)
class Mesh:
    """Triangles: `vertices` (v, 3) [m] in the obstacle's frame, `faces` (f, 3) indices, counter-clockwise from outside.

    A closed mesh is a solid, an open one a thin surface.
    """

    vertices: Array
    faces: Array  # (f, 3) int64

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        try:
            vertices = np.array(vertices, dtype=np.float64)
            faces = np.array(faces)
        except (TypeError, ValueError):
            raise ArgumentError("Mesh: vertices and faces must be tables of three numbers a row.") from None
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise ArgumentError.of(
                "Mesh.vertices", f"array of shape {vertices.shape}", "it must be finite of shape (v, 3)", "Give metres."
            )
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise ArgumentError.of(
                "Mesh.faces", f"array of shape {faces.shape}", "it must be whole numbers of shape (f, 3)", ""
            )
        if not 0 < len(faces) <= MAX_FACES:
            raise ArgumentError.of(
                "Mesh.faces", f"{len(faces)} triangles", f"it must be 1 to {MAX_FACES}", "Simplify the mesh."
            )
        faces = faces.astype(np.int64)
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ArgumentError.of(
                "Mesh.faces",
                f"indices {faces.min()} to {faces.max()}",
                f"they must be 0 to {len(vertices) - 1}",
                "Indices count vertices from 0.",
            )
        vertices.flags.writeable = faces.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @classmethod
    def from_file(cls, path: str | Path, scale: float = 1.0) -> Mesh:
        """From an STL (binary or ASCII) or OBJ file; its coordinates times `scale` are metres."""
        from cable_shape.meshes.files import read_mesh

        return read_mesh(path, scale)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Mesh)
            and bool(np.array_equal(self.vertices, other.vertices))
            and bool(np.array_equal(self.faces, other.faces))
        )

    def __hash__(self) -> int:
        return hash((self.vertices.tobytes(), self.faces.tobytes()))

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces)"


Solid = Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh
SOLIDS = (Box, Sphere, Cylinder, Capsule, HalfSpace, Mesh)


@final
@dataclass(frozen=True, slots=True)
class Obstacle:
    """A solid body, fixed in the world (`link` None) or attached to a robot link.

    pose: in the world, or in the frame of `link`.
    """

    name: str
    solid: Solid
    pose: Pose = IDENTITY
    link: str | None = None

    def __post_init__(self) -> None:
        _word("Obstacle.name", self.name)
        _instance("Obstacle.solid", self.solid, SOLIDS, "Write for example Box((0.1, 0.2, 0.3)) or Sphere(0.05).")
        _instance("Obstacle.pose", self.pose, (Pose,), "Write Pose(position, quaternion).")
        if self.link is not None:
            _word("Obstacle.link", self.link)


@final
@dataclass(frozen=True, slots=True)
class Clip:
    """Holds the cable at `arc_length` [m] from the start grip, with the cable frame of `pose`.

    "ball" holds the place of the material point, "fixed" its frame, "hinge" its place and d3: the cable may roll.
    "slide" is an eyelet without friction through which the cable runs: it holds a place, `arc_length` is about which
    point is in it, and what is found is in the shape's `clips`.
    """

    arc_length: float
    pose: Pose
    kind: str = "ball"

    def __post_init__(self) -> None:
        _number(self, "Clip", "arc_length", "m")
        _instance("Clip.pose", self.pose, (Pose,), "Write Pose(position, quaternion).")
        checks.one_of("Clip.kind", self.kind, CLIP_KINDS)
        if self.pose.turns:
            raise ArgumentError.of(
                "Clip.pose.turns",
                self.pose.turns,
                "windings are counted at the cable's end only",
                "Give the end's Pose the turns; a clip's own come from the path that led there.",
            )


@final
@dataclass(frozen=True, slots=True)
class PointMass:
    """A connector of `mass` [kg] at `arc_length` [m] from the start grip."""

    arc_length: float
    mass: float

    def __post_init__(self) -> None:
        _number(self, "PointMass", "arc_length", "m")
        _number(self, "PointMass", "mass", "kg")


@final
@dataclass(frozen=True, slots=True)
class Scene:
    """Obstacles, clips and masses around one cable, and the distances at which to warn.

    Parameters
    ----------
    obstacles, clips, masses : sequence of Obstacle, Clip, PointMass
        Kept as a tuple. Names of obstacles are unique; clips are in ascending arc length.
    warn_distance, error_distance : float
        [m], a clearance below these is a warning of severity WARN, ERROR.
    sockets : mapping of name to Pose
        World frame of a plug when it is in the socket; z points into the socket.
    plug : Plug, optional
        At the end of every cable that has no other one.
    contact : str
        What obstacles and robot links do: "warn" (default) of the clearance to them; "solve" keeps the cable out of
        them in the equilibrium, and out of each other and of themselves, without friction (Cosserat rod only), and
        warns, too; "off" neither. With eyelets, cables are not kept out of each other.

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

    def __post_init__(self) -> None:
        checks.one_of("contact", self.contact, CONTACT_KINDS)
        for name, kind in (("obstacles", Obstacle), ("clips", Clip), ("masses", PointMass)):
            object.__setattr__(self, name, _tuple_of(name, getattr(self, name), kind))
        _number(self, "", "warn_distance", "m")
        _number(self, "", "error_distance", "m")
        unique_names("obstacles", self.obstacles)
        if not isinstance(self.sockets, Mapping):
            raise ArgumentError.of("sockets", self.sockets, "it must be a mapping", "Write {name: Pose(...)}.")
        object.__setattr__(self, "sockets", dict(self.sockets))
        for name, pose in self.sockets.items():
            _word("sockets", name)
            _instance(f"sockets[{name!r}]", pose, (Pose,), "Write Pose(position, quaternion).")
        if self.plug is not None:
            _instance("plug", self.plug, (Plug,), "Write Plug(socket).")
            checks.one_of("plug.socket", self.plug.socket, self.sockets)
        for i, (clip, following) in enumerate(pairwise(self.clips)):
            if not clip.arc_length < following.arc_length:
                raise ArgumentError.of(
                    f"clips[{i + 1}].arc_length",
                    following.arc_length,
                    f"it must be above that of clips[{i}], {clip.arc_length:g} m",
                    "List the clips in the order in which the cable runs through them, no two at one arc length.",
                )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "scene", folder: str | Path = ".") -> Scene:
        """From a mapping whose keys are the keywords of Scene; see :mod:`cable_shape.scene_files` for the entries.

        `where` is named in errors; the paths of meshes are taken from `folder`.
        """
        from cable_shape.scene_files import scene_of

        return scene_of(values, where, Path(folder))

    @classmethod
    def from_yaml(cls, path: str | Path) -> Scene:
        """From a YAML file whose keys are the keywords of Scene; the paths of meshes are taken from its folder."""
        from cable_shape.files import load_yaml

        return cls.from_mapping(load_yaml(path), where=str(path), folder=Path(path).expanduser().parent)

    def as_dict(self) -> dict[str, Any]:
        """The mapping that `from_mapping` takes, as plain numbers, lists and words; meshes are written out."""
        from cable_shape.scene_files import mapping_of

        return mapping_of(self)

    def replace(self, **changes: Any) -> Scene:
        """A copy with some keywords changed."""
        checks.known_keys("Scene.replace", changes, SCENE_KEYS)
        return dataclasses.replace(self, **changes)


SCENE_KEYS = tuple(f.name for f in dataclasses.fields(Scene))


def unique_names(where: str, obstacles: Iterable[Obstacle]) -> None:
    """Refuses two obstacles of one name: reports could not tell them apart."""
    seen: set[str] = set()
    for obstacle in obstacles:
        if obstacle.name in seen:
            raise ArgumentError.of(where, obstacle.name, "names must be unique", "Rename one of them.")
        seen.add(obstacle.name)


def _number(owner: Any, prefix: str, name: str, unit: str) -> None:
    """Keeps field `name` of a frozen `owner` as a finite float of at least 0."""
    label = f"{prefix}.{name}" if prefix else name
    object.__setattr__(owner, name, checks.number(label, getattr(owner, name), at_least=0.0, unit=unit))


def _positive(owner: Any, prefix: str, *names: str) -> None:
    """Keeps the fields `names` of a frozen `owner` as finite floats above 0 m."""
    for name in names:
        value = checks.number(f"{prefix}.{name}", getattr(owner, name), above=0.0, unit="m")
        object.__setattr__(owner, name, value)


def _word(label: str, value: object) -> None:
    if not isinstance(value, str) or not value.strip():
        raise ArgumentError.of(label, value, "it must be a word", "Give a short name in quotes.")


def _instance(label: str, value: object, kinds: tuple[type, ...], remedy: str) -> None:
    if not isinstance(value, kinds):
        names = " or ".join(k.__name__ for k in kinds)
        raise ArgumentError.of(label, value, f"it must be a {names}", remedy)


def _tuple_of(label: str, values: Any, kind: type) -> tuple[Any, ...]:
    remedy = f"Give a list of {kind.__name__}."
    if isinstance(values, (str, Mapping)) or not isinstance(values, Iterable):
        raise ArgumentError.of(label, values, "it must be a list", remedy)
    entries = tuple(values)
    for i, entry in enumerate(entries):
        _instance(f"{label}[{i}]", entry, (kind,), remedy)
    return entries
