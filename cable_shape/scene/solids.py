"""Solid bodies, each in a frame of its own: boxes, spheres, cylinders, capsules, half-spaces and meshes.

Those of many points are in `points`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.scene.mesh_files import MAX_FACES, read_triangles
from cable_shape.scene.points import HeightField, Points


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
        _positive(self, "radius")


@final
@dataclass(frozen=True, slots=True)
class Cylinder:
    """`radius` [m] and full `length` [m] along the obstacle's z axis, centred, flat ends."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        _positive(self, "radius", "length")


@final
@dataclass(frozen=True, slots=True)
class Capsule:
    """`radius` [m] and `length` [m] of the straight part along the obstacle's z axis, centred, round ends."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        _positive(self, "radius", "length")


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
        remedy = "Give a table of three numbers a row."
        vertices = checks.numbers("Mesh.vertices", vertices, remedy)
        try:
            faces = np.array(faces)
        except (TypeError, ValueError, OverflowError):
            raise ArgumentError.of("Mesh.faces", faces, "it must be whole numbers of shape (f, 3)", remedy) from None
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not (np.abs(vertices) <= checks.MOST).all():
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
        """From an STL (binary or ASCII) or OBJ file, equal vertices merged; its coordinates times `scale` are metres.

        Raises
        ------
        ArgumentError
            Naming the file: missing, too large, of another kind, cut off, or without triangles.
        """
        factor = checks.number(
            "scale", scale, above=0.0, remedy="1 for a file in metres, 0.001 for one in millimetres."
        )
        vertices, faces = read_triangles(path)
        try:
            return cls(vertices * factor, faces)
        except ArgumentError as error:
            raise ArgumentError(f"{Path(path).expanduser()}: {error}") from None

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


Solid = Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh | Points | HeightField
SOLIDS = (Box, Sphere, Cylinder, Capsule, HalfSpace, Mesh, Points, HeightField)


def _positive(solid: Any, *names: str) -> None:
    """Keeps the fields `names` of a frozen solid as finite floats above 0 m."""
    for name in names:
        value = checks.number(f"{type(solid).__name__}.{name}", getattr(solid, name), above=0.0, unit="m")
        object.__setattr__(solid, name, value)
