"""Tubes that move, as GLB (binary glTF 2.0): :func:`glb`. Any viewer of a browser plays it.

Every ring of a tube is a joint of a skin, with a translation and a rotation at every instant. The file's y points up,
so that a root node turns the world's z there.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.planning.export_mesh import SIDES, tube, tube_faces
from cable_shape.shape import CableShape

FLOAT, UINT16, UINT32 = 5126, 5123, 5125
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_Z_UP = [-0.7071067811865476, 0.0, 0.0, 0.7071067811865476]
_BLUE = [0.146, 0.389, 0.658, 1.0]


@final
class _File:
    """The buffer of a file and what lies in it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: NDArray[Any], kind: int, bounds: bool = False) -> int:
        """The number of an accessor to these values (k,) or (k, c)."""
        code = {FLOAT: "<f4", UINT16: "<u2", UINT32: "<u4"}[kind]
        table = np.ascontiguousarray(values, dtype=code)
        width = 1 if table.ndim == 1 else table.shape[1]
        self.data += b"\0" * (-len(self.data) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": table.nbytes})
        self.data += table.tobytes()
        told: dict[str, Any] = {
            "bufferView": len(self.views) - 1, "componentType": kind, "count": len(table), "type": _TYPES[width]
        }  # fmt: skip
        if bounds:
            flat = table.reshape(len(table), width)
            told |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self.accessors.append(told)
        return len(self.accessors) - 1


def glb(motions: Mapping[str, Sequence[CableShape]], radius: Mapping[str, Array | float], period: float) -> bytes:
    """The tubes of named cables, each at the same instants, `period` [s] apart."""
    file = _File()
    nodes: list[dict[str, Any]] = [{"name": "world", "rotation": _Z_UP, "children": []}]
    meshes: list[dict[str, Any]] = []
    skins: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, Any]] = []
    count = len(next(iter(motions.values())))
    times = file.add(period * np.arange(count), FLOAT, bounds=True) if count > 1 else -1
    for name, shapes in motions.items():
        first = len(nodes)
        places = np.array([shape.positions for shape in shapes])
        turns = _continuous(np.array([shape.quaternions for shape in shapes]))
        n = places.shape[1]
        for i in range(n):
            nodes.append({"translation": places[0, i].tolist(), "rotation": turns[0, i].tolist()})
            nodes[0]["children"].append(first + i)
            for path, values in (("translation", places[:, i]), ("rotation", turns[:, i])) if count > 1 else ():
                samplers.append({"input": times, "output": file.add(values, FLOAT), "interpolation": "LINEAR"})
                channels.append({"sampler": len(samplers) - 1, "target": {"node": first + i, "path": path}})
        vertices, _ = tube(shapes[0], radius[name])
        joint = np.concatenate((np.repeat(np.arange(n), SIDES), (0, n - 1)))
        joints, weights = np.zeros((len(joint), 4), np.uint16), np.zeros((len(joint), 4))
        joints[:, 0], weights[:, 0] = joint, 1.0
        own = {
            "POSITION": file.add(vertices, FLOAT, bounds=True), "JOINTS_0": file.add(joints, UINT16),
            "WEIGHTS_0": file.add(weights, FLOAT),
        }  # fmt: skip
        faces = file.add(tube_faces(n, SIDES).ravel(), UINT32)
        meshes.append({"name": name or "cable", "primitives": [{"attributes": own, "indices": faces, "material": 0}]})
        inverse = file.add(_inverses(places[0], turns[0]), FLOAT)
        skins.append({"joints": list(range(first, first + n)), "inverseBindMatrices": inverse})
        nodes.append({"name": name or "cable", "mesh": len(meshes) - 1, "skin": len(skins) - 1})
    shown = [0, *(i for i, node in enumerate(nodes) if "mesh" in node)]
    told: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "cable_shape"}, "scene": 0, "scenes": [{"nodes": shown}],
        "nodes": nodes, "meshes": meshes, "skins": skins, "accessors": file.accessors, "bufferViews": file.views,
        "buffers": [{"byteLength": len(file.data)}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": _BLUE, "metallicFactor": 0.0}}],
    }  # fmt: skip
    if channels:
        told["animations"] = [{"name": "motion", "channels": channels, "samplers": samplers}]
    return _packed(told, bytes(file.data))


def _continuous(turns: Array) -> Array:
    """Quaternions (m, n, 4) whose signs do not change from one instant to the next."""
    out = turns.copy()
    for i in range(1, len(out)):
        out[i][(out[i] * out[i - 1]).sum(axis=1) < 0.0] *= -1.0
    return out


def _inverses(places: Array, turns: Array) -> Array:
    """(n, 16), column by column: from the world to each frame."""
    out = np.zeros((len(places), 4, 4))
    x, y, z, w = turns.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    for i, row in enumerate(rows):  # the transposed rotation
        for j, entry in enumerate(row):
            out[:, i, j] = entry
    out[:, :3, 3] = -np.einsum("kij,kj->ki", out[:, :3, :3], places)
    out[:, 3, 3] = 1.0
    return np.asarray(out.transpose(0, 2, 1).reshape(-1, 16))


def _packed(told: Mapping[str, Any], data: bytes) -> bytes:
    """Both chunks behind their headers."""
    text = json.dumps(told, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    whole = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, whole) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(data), b"BIN\0") + data
