"""Bodies of many points, each a sphere of one radius: :class:`Points`, a cloud, and :class:`HeightField`, a lattice."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, FileError
from cable_shape.files.files import path_of, read_bounded, read_text

MAX_POINTS = 100_000  #: more are refused
MAX_BYTES = 64 * 1024 * 1024  #: larger files are refused
TABLES = (".csv", ".txt", ".xyz", ".npy")  #: files that hold a table of numbers


@final
@dataclass(frozen=True, slots=True, eq=False, init=False)
class Points:
    """A point cloud: spheres of `radius` [m] around `points` (n, 3) [m] in the obstacle's frame.

    For contact the radius is no smaller than the points are apart: a cable lies on a smooth surface over them.
    """

    points: Array
    radius: float

    def __init__(self, points: ArrayLike, radius: float) -> None:
        points = _finite("Points.points", points)
        if points.ndim != 2 or points.shape[1] != 3:
            bound = "it must be of shape (n, 3)"
            raise ArgumentError.of("Points.points", f"array of shape {points.shape}", bound, "Give x, y, z a row.")
        _bounded("Points.points", len(points), "points")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "radius", checks.number("Points.radius", radius, above=0.0, unit="m"))

    @classmethod
    def from_file(cls, path: str | Path, radius: float, scale: float = 1.0) -> Points:
        """From a table of numbers, a point a row: .csv, .txt, .xyz or .npy; what stands behind x, y, z is left out.

        Coordinates times `scale` are metres.

        Raises
        ------
        ArgumentError
            Naming the file: missing, too large, of another kind, cut off, or without points.
        """
        factor = checks.number("scale", scale, above=0.0)
        table = read_table(path, "file of points")
        if table.shape[1] < 3:
            raise FileError(f"{path_of(path)}: it has {table.shape[1]} numbers a row, and a point has three.")
        try:
            return cls(table[:, :3] * factor, radius)
        except ArgumentError as error:
            raise ArgumentError(f"{path_of(path)}: {error}") from None

    @property
    def centres(self) -> Array:
        """(n, 3) [m], of the spheres."""
        return self.points

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Points)
            and self.radius == other.radius
            and bool(np.array_equal(self.points, other.points))
        )

    def __hash__(self) -> int:
        return hash((self.points.tobytes(), self.radius))

    def __repr__(self) -> str:
        return f"Points({len(self.points)} points, radius {self.radius:g} m)"


@final
@dataclass(frozen=True, slots=True, eq=False, init=False)
class HeightField:
    """A height field: `heights` (r, c) [m] along the obstacle's z, `spacing` [m] apart, centred on its origin.

    Columns go along x, rows along y. The surface goes through the heights: each is a point of a sphere of `radius`
    [m], the spacing if none is given, whose centre is behind it along the slope's normal.
    """

    heights: Array
    spacing: float
    radius: float

    def __init__(self, heights: ArrayLike, spacing: float, radius: float | None = None) -> None:
        heights = _finite("HeightField.heights", heights)
        if heights.ndim != 2 or min(heights.shape) < 2:
            bound = "it must be of shape (r, c), both at least 2"
            raise ArgumentError.of("HeightField.heights", f"array of shape {heights.shape}", bound, "Give a table.")
        _bounded("HeightField.heights", heights.size, "heights")
        spacing = checks.number("HeightField.spacing", spacing, above=0.0, unit="m")
        radius = spacing if radius is None else checks.number("HeightField.radius", radius, above=0.0, unit="m")
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "spacing", spacing)
        object.__setattr__(self, "radius", radius)

    @classmethod
    def from_file(
        cls, path: str | Path, spacing: float, radius: float | None = None, scale: float = 1.0
    ) -> HeightField:
        """From a table of heights, .csv, .txt or .npy; heights times `scale` are metres. Errors as of `Points`."""
        factor = checks.number("scale", scale, above=0.0)
        table = read_table(path, "file of heights")
        try:
            return cls(table * factor, spacing, radius)
        except ArgumentError as error:
            raise ArgumentError(f"{path_of(path)}: {error}") from None

    @property
    def centres(self) -> Array:
        """(n, 3) [m], of the spheres."""
        up, along = np.gradient(self.heights, self.spacing)
        normals = np.stack((-along, -up, np.ones_like(up)), axis=-1).reshape(-1, 3)
        out: Array = self._places - self.radius * normals / np.linalg.norm(normals, axis=1, keepdims=True)
        return out

    @property
    def _places(self) -> Array:
        """(n, 3) [m], where the heights are."""
        rows, columns = self.heights.shape
        x = self.spacing * (np.arange(columns) - 0.5 * (columns - 1))
        y = self.spacing * (np.arange(rows) - 0.5 * (rows - 1))
        return np.stack((*np.meshgrid(x, y), self.heights), axis=-1).reshape(-1, 3)

    def surface(self) -> tuple[Array, Array]:
        """Vertices (n, 3) [m] and faces (f, 3) through the heights, for pictures."""
        rows, columns = self.heights.shape
        a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        faces = np.concatenate(
            (np.stack((a, a + 1, a + columns), 1), np.stack((a + 1, a + columns + 1, a + columns), 1))
        )
        return self._places, faces

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, HeightField)
            and (self.spacing, self.radius) == (other.spacing, other.radius)
            and bool(np.array_equal(self.heights, other.heights))
        )

    def __hash__(self) -> int:
        return hash((self.heights.tobytes(), self.spacing, self.radius))

    def __repr__(self) -> str:
        return f"HeightField({' x '.join(map(str, self.heights.shape))} heights, {self.spacing:g} m apart)"


def read_table(path: str | Path, what: str) -> Array:
    """(r, c), the numbers of a .csv, .txt, .xyz or .npy file; text has as many in each row, lines with # are notes.

    Raises
    ------
    FileError
        Naming the file, and the line.
    """
    file = path_of(path, what)
    suffix = file.suffix.lower()
    if suffix not in TABLES:
        raise FileError(f"{file}: a {what} is one of {', '.join(TABLES)}, not {suffix or 'without suffix'}.")
    if suffix == ".npy":
        held = io.BytesIO(read_bounded(file, MAX_BYTES, what))
        try:
            table = np.load(held, allow_pickle=False)
        except (ValueError, EOFError, OSError, MemoryError, SyntaxError):
            raise FileError(f"{file}: not a whole .npy file of numbers; is it cut off?") from None
        if not isinstance(table, np.ndarray) or table.ndim != 2 or table.dtype.kind not in "fiu":
            raise FileError(f"{file}: it must hold a table of numbers, rows and columns.")
        return table.astype(np.float64)
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(file, MAX_BYTES, what).splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            raise FileError(f"{file}, line {number}: a number is missing or is none.") from None
        if len(rows[-1]) != len(rows[0]):
            told = f"{len(rows[-1])} numbers, and {len(rows[0])} in the first row; is it cut off?"
            raise FileError(f"{file}, line {number}: it has {told}")
    if not rows:
        raise FileError(f"{file}: it holds no numbers.")
    return np.array(rows)


def _finite(name: str, values: ArrayLike) -> Array:
    """An own array of finite numbers, read-only."""
    made = checks.numbers(name, values, "Give a table of numbers, in metres.")
    if not (np.abs(made) <= checks.MOST).all():
        wrong = "NaN" if np.isnan(made).any() else f"{np.abs(made).max():g}"
        raise ArgumentError.of(name, wrong, f"every number must be finite, at most {checks.MOST:g} m", "Leave it out.")
    made.flags.writeable = False
    return made


def _bounded(name: str, count: int, what: str) -> None:
    if not 0 < count <= MAX_POINTS:
        raise ArgumentError.of(
            name, f"{count} {what}", f"it must be 1 to {MAX_POINTS}", "Take every second, or a part."
        )
