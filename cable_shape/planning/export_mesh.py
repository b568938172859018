"""Cables as triangles, and triangles as STL and OBJ: :func:`tube`, :func:`stl`, :func:`obj`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.shape import CableShape

#: Sides of a tube.
SIDES = 16


def tube(shape: CableShape, radius: Array | float, sides: int = SIDES) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n * sides + 2, 3) [m] and faces of a closed tube about a shape, counter-clockwise from outside.

    Ring i has its vertices at i * sides on, the first along d1; the last two are the middles of the caps.
    """
    n = shape.points
    rings = shape.positions[:, None] + np.asarray(radius).reshape(-1, 1, 1) * ring(shape.quaternions, sides)
    vertices = np.concatenate((rings.reshape(-1, 3), shape.positions[[0, -1]]))
    return vertices, tube_faces(n, sides)


def ring(quaternions: Array, sides: int) -> Array:
    """(n, sides, 3): unit vectors across the cable, from d1 towards d2."""
    x, y, z, w = quaternions.T
    d1 = np.stack((1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)), axis=1)
    d2 = np.stack((2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)), axis=1)
    angles = 2.0 * math.pi * np.arange(sides) / sides
    return np.asarray(np.cos(angles)[None, :, None] * d1[:, None] + np.sin(angles)[None, :, None] * d2[:, None])


def tube_faces(n: int, sides: int) -> NDArray[np.int64]:
    """(f, 3), of a tube of n rings and two caps."""
    i, j = np.meshgrid(np.arange(n - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = a + sides, b + sides
    around = np.stack((np.stack((a, b, d), axis=-1), np.stack((a, d, c), axis=-1)), axis=2).reshape(-1, 3)
    k = np.arange(sides)
    first = np.stack((np.full(sides, n * sides), (k + 1) % sides, k), axis=1)
    end = (n - 1) * sides
    last = np.stack((np.full(sides, n * sides + 1), end + k, end + (k + 1) % sides), axis=1)
    return np.concatenate((around, first, last))


def stl(vertices: Array, faces: NDArray[Any]) -> bytes:
    """Binary STL, in metres."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    record = np.zeros(len(faces), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    record["n"], record["v"] = normals / np.where(size > 0.0, size, 1.0), corners
    return b"cable_shape, metres".ljust(80) + np.uint32(len(faces)).tobytes() + record.tobytes()


def obj(parts: dict[str, tuple[Array, NDArray[Any]]]) -> bytes:
    """Wavefront OBJ of named meshes, in metres."""
    lines, first = ["# cable_shape, metres"], 1
    for name, (vertices, faces) in parts.items():
        lines.append(f"o {name or 'cable'}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + first).tolist()]
        first += len(vertices)
    return ("\n".join(lines) + "\n").encode()
