"""Convex parts of meshes kept on disk, beside the machine code of kernels: :func:`read` and :func:`write`.

A file is only what can be done again: one that is cut off, or of something else, is as if it were not there, and where
nothing can be written nothing is kept.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cable_shape.errors import ArgumentError
from cable_shape.kernels._jit import trusted
from cable_shape.scene.solids import Mesh

_FORMAT = 1
_MOST_BYTES = 64 * 1024 * 1024


def key_of(mesh: Mesh, made_by: object) -> str:
    """What names the parts of a mesh, divided in this way."""
    digest = hashlib.sha256(f"{_FORMAT} {made_by!r}".encode())
    for array in (mesh.vertices, mesh.faces):
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def read(key: str) -> tuple[tuple[Mesh, ...], float] | None:
    """The parts and their deviation [m]; None: there are none, or the file is damaged."""
    folder = _folder()
    file = None if folder is None else folder / f"{key}.npz"
    if file is None or not file.is_file() or file.stat().st_size > _MOST_BYTES:
        return None
    try:
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as held:
            vertices, faces, counts, off = (held[name] for name in ("vertices", "faces", "counts", "deviation"))
        rows = np.cumsum(counts, axis=0)
        meshes = tuple(
            Mesh(a, b) for a, b in zip(np.split(vertices, rows[:-1, 0]), np.split(faces, rows[:-1, 1]), strict=True)
        )
        deviation = float(off)
    except (OSError, EOFError, KeyError, ValueError, TypeError, IndexError, zipfile.BadZipFile, ArgumentError):
        return None
    return (meshes, deviation) if deviation >= 0.0 else None


def write(key: str, meshes: Sequence[Mesh], deviation: float) -> None:
    """Keeps them, whole or not at all."""
    folder = _folder()
    if folder is None:
        return
    with contextlib.suppress(OSError):
        number, name = tempfile.mkstemp(dir=folder, suffix=".part")
        try:
            with os.fdopen(number, "wb") as file:
                np.savez_compressed(
                    file,
                    vertices=np.concatenate([mesh.vertices for mesh in meshes]),
                    faces=np.concatenate([mesh.faces for mesh in meshes]),
                    counts=np.array([(len(mesh.vertices), len(mesh.faces)) for mesh in meshes]),
                    deviation=np.array(deviation),
                )
            Path(name).replace(folder / f"{key}.npz")
        except OSError:
            Path(name).unlink(missing_ok=True)


def _folder() -> Path | None:
    """Where they are, made if missing; None where there is no such place that is the user's own."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = home / "cable_shape" / "parts"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return trusted(folder)
    except (OSError, RuntimeError):
        return None
