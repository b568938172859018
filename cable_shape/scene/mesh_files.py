"""Reading triangle meshes: binary and ASCII STL, OBJ. :func:`read_triangles`"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import FileError
from cable_shape.files.files import path_of, read_bounded

#: Meshes with more triangles are refused.
MAX_FACES = 200_000
#: Larger files are refused.
MAX_BYTES = 64 * 1024 * 1024

_STL_HEADER = 84  # bytes: 80 of text, then the number of triangles as uint32
_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class _MalformedError(Exception):
    """What is wrong with a file, in words."""


def read_triangles(path: str | Path) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (v, 3) and faces (f, 3) of an STL or OBJ file, in its own unit; equal vertices are merged.

    Raises
    ------
    FileError
        Naming the file: missing, too large, of another kind, cut off, or without triangles.
    """
    file = path_of(path, "mesh file")
    suffix = file.suffix.lower()
    if suffix not in (".stl", ".obj"):
        raise FileError(f"{file}: meshes are read from .stl and .obj files, not {suffix or 'without suffix'}.")
    data = read_bounded(file, MAX_BYTES, "mesh file")
    try:
        return _obj(data) if suffix == ".obj" else _stl(data)
    except (_MalformedError, ValueError, IndexError, OverflowError) as error:
        reason = str(error) if isinstance(error, _MalformedError) else "a number or an index is missing or is none"
        raise FileError(f"{file}: not a well-formed {suffix[1:].upper()} file: {reason}.") from None


def _stl(data: bytes) -> tuple[Array, NDArray[np.int64]]:
    """Binary if its length fits the number of triangles it states (a binary header may also start with "solid")."""
    if len(data) >= _STL_HEADER:
        count = int(np.frombuffer(data, "<u4", 1, 80)[0])
        if len(data) == _STL_HEADER + count * _STL_RECORD.itemsize:
            corners = np.frombuffer(data, _STL_RECORD, count, _STL_HEADER)["corners"].astype(np.float64)
            return _merged(corners.reshape(-1, 3))
    if not data.lstrip().startswith(b"solid"):
        raise _MalformedError("neither ASCII nor a binary file of the stated length; is it cut off?")
    words = data.decode("ascii", errors="replace").split()
    at = [i for i, word in enumerate(words) if word == "vertex"]
    if len(at) % 3 or "endsolid" not in words:
        raise _MalformedError("a facet is incomplete; is it cut off?")
    return _merged(np.array([words[i + 1 : i + 4] for i in at], dtype=np.float64).reshape(-1, 3))


def _obj(data: bytes) -> tuple[Array, NDArray[np.int64]]:
    """Lines `v x y z` and `f a b c ...` (`a/t/n`, negative counts from the last vertex); polygons become fans."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for row, line in enumerate(data.decode("utf-8", errors="replace").splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            if 0 in numbers or len(numbers) < 3:
                raise _MalformedError(f"line {row}: a face needs three or more indices that count from 1")
            corners = [n - 1 if n > 0 else len(vertices) + n for n in numbers]
            faces.extend((corners[0], b, c) for b, c in itertools.pairwise(corners[1:]))
            if len(faces) > MAX_FACES:
                break
    if not faces:
        raise _MalformedError("it holds no face")
    return np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)


def _merged(corners: Array) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of triangles that are given corner by corner (3 f, 3)."""
    if not len(corners):
        raise _MalformedError("it holds no triangle")
    vertices, inverse = np.unique(corners, axis=0, return_inverse=True)
    return vertices, inverse.reshape(-1, 3).astype(np.int64)
