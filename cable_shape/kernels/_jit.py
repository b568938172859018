"""How kernels are compiled: :func:`kernel`, the one decorator of this folder.

Machine code is cached in one folder per version of a kernel file and of the kernel files that it imports, so that a
kernel that calls another across files is never stale, and a read-only installation still has a cache. NUMBA_CACHE_DIR
overrides the place.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import re
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config as _config

HERE = Path(__file__).parent
_IMPORT = re.compile(rb"^(?:from|import) cable_shape\.kernels(?: import |\.)([\w, ]+)", re.MULTILINE)


@cache
def sources(file: Path) -> frozenset[Path]:
    """A kernel file and all kernel files that it imports, directly or not."""
    found = {file, Path(__file__)}
    for names in _IMPORT.findall(file.read_bytes()):
        for name in names.decode().replace(",", " ").split():
            other = HERE / f"{name}.py"
            if other.exists() and other not in found:
                found |= sources(other)
    return frozenset(found)


@cache
def cache_folder(file: Path) -> str:
    """Where the machine code of a kernel file as it is now is cached; writable, made if missing."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return os.environ["NUMBA_CACHE_DIR"]
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(sources(file)):
        digest.update(source.name.encode() + source.read_bytes())
    name = f"{file.stem}-{digest.hexdigest()[:16]}"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for base in (home / "cable_shape", Path(tempfile.gettempdir()) / f"cable_shape_{os.getuid()}"):
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return str(folder)
    return tempfile.mkdtemp(prefix="cable_shape_kernels_")


config: Any = _config


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compiles lazily in nopython mode with numpy's division rules (NaN and inf, no exceptions) and a cache on disk."""

    def decorate(f: Callable[..., Any]) -> Any:
        before = config.CACHE_DIR
        config.CACHE_DIR = cache_folder(Path(inspect.getfile(f)))  # read when the function below is decorated
        try:
            return numba.njit(cache=True, error_model="numpy", **options)(f)
        finally:
            config.CACHE_DIR = before

    return decorate if function is None else decorate(function)
