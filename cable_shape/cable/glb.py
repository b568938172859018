"""Triangles of a GLB (binary glTF 2.0): :func:`read_glb`. Its unit is the metre."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import FileError
from cable_shape.files.files import path_of, read_bounded
from cable_shape.pose import Pose
from cable_shape.scene.mesh_files import MAX_BYTES, MAX_FACES

_TYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_DEEP = 32


def read_glb(path: str | Path) -> tuple[Array, Any]:
    """Vertices (v, 3) [m] and faces (f, 3) of all meshes of the scene, where their nodes put them.

    Raises
    ------
    FileError
        Naming the file: not a GLB, cut off, compressed, or with indices to nothing.
    """
    file = path_of(path, "mesh file")
    data = read_bounded(file, MAX_BYTES, "mesh file")
    try:
        return _Reader(data).triangles()
    except _UnusableError as error:
        raise FileError(f"{file}: {error}.") from None
    except (struct.error, ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise FileError(f"{file}: not a well-formed GLB file. Is it cut off?") from None


class _UnusableError(Exception):
    """What is wrong, in words."""


class _Reader:
    def __init__(self, data: bytes) -> None:
        magic, version, _ = struct.unpack_from("<4sII", data, 0)
        if magic != b"glTF" or version != 2:
            raise _UnusableError("not a GLB of version 2. Export it as binary glTF 2.0")
        size, kind = struct.unpack_from("<I4s", data, 12)
        if kind != b"JSON":
            raise _UnusableError("its first chunk is not JSON. Is it cut off?")
        self.head: dict[str, Any] = json.loads(data[20 : 20 + size])
        at = 20 + size
        self.binary = b""
        if len(data) > at + 8:
            size, _ = struct.unpack_from("<I4s", data, at)
            self.binary = data[at + 8 : at + 8 + size]
        self.vertices: list[Array] = []
        self.faces: list[Any] = []
        self.count = 0

    def triangles(self) -> tuple[Array, Any]:
        """All of them."""
        head = self.head
        nodes = head.get("nodes", [])
        scene = head.get("scenes", [{}])[head.get("scene", 0)]
        for root in scene.get("nodes", range(len(nodes))):
            self.node(nodes, root, np.eye(4), 0)
        if not self.faces:
            raise _UnusableError("it holds no triangle. Export the tube as a mesh")
        return np.concatenate(self.vertices), np.concatenate(self.faces)

    def node(self, nodes: list[Any], i: int, above: Array, depth: int) -> None:
        """A node and what lies below it."""
        if depth > _DEEP:
            raise _UnusableError(f"its nodes are nested more than {_DEEP} deep")
        one = nodes[i]
        here = above @ _matrix(one)
        if "mesh" in one:
            for primitive in self.head["meshes"][one["mesh"]]["primitives"]:
                self.primitive(primitive, here)
        for child in one.get("children", ()):
            self.node(nodes, child, here, depth + 1)

    def primitive(self, one: dict[str, Any], here: Array) -> None:
        """Triangles of one material."""
        if one.get("mode", 4) != 4:
            return
        if "KHR_draco_mesh_compression" in one.get("extensions", {}):
            raise _UnusableError("it is compressed (Draco). Export it without compression")
        r = self.accessor(one["attributes"]["POSITION"]).astype(np.float64)
        f = self.accessor(one["indices"]) if "indices" in one else np.arange(len(r))
        f = f.astype(np.int64).reshape(-1, 3)
        self.count += len(f)
        if self.count > MAX_FACES:
            raise _UnusableError(f"more than {MAX_FACES} triangles. Simplify the mesh")
        if len(f) and f.max() >= len(r):
            raise _UnusableError("an index names no vertex. Export it again")
        self.faces.append(f + sum(map(len, self.vertices)))
        self.vertices.append(r @ here[:3, :3].T + here[:3, 3])

    def accessor(self, i: int) -> Any:
        """Its numbers."""
        one = self.head["accessors"][i]
        view = self.head["bufferViews"][one["bufferView"]]
        kind = np.dtype(_TYPES[one["componentType"]])
        wide = {"SCALAR": 1, "VEC3": 3}[one["type"]]
        stride = view.get("byteStride", kind.itemsize * wide)
        first, count = view.get("byteOffset", 0) + one.get("byteOffset", 0), int(one["count"])
        if min(first, count) < 0 or stride < kind.itemsize * wide or first + stride * (count - 1) > len(self.binary):
            raise _UnusableError("an accessor lies beyond its data. Is it cut off?")
        rows = np.ndarray((count, wide), kind, self.binary, first, (stride, kind.itemsize))
        return rows if wide > 1 else rows[:, 0]


def _matrix(node: dict[str, Any]) -> Array:
    """(4, 4), of a node in the one above."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    out = np.eye(4)
    q = np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), dtype=np.float64)
    pose = Pose(quaternion=q / np.linalg.norm(q))
    scale = np.array(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    from cable_shape.pose import rotate

    out[:3, :3] = np.stack([rotate(pose.quaternion, axis) for axis in np.eye(3)], axis=1) * scale
    out[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return out
