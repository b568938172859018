"""The kernels with the types that they are compiled for, in the order in which they can be: the file kernels.txt.

Each stage of :data:`cable_shape.warm_up.runs.STAGES` has those that the stages before it do not need. A kernel stands
below all that it calls; what others call has a star, and is compiled without what takes arguments from Python. What is
missing in the list, or no longer right, costs time alone: it is compiled when it is first called.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import cable_shape.kernels
from cable_shape.warm_up.signatures import KERNELS, text_of

FILE = Path(__file__).with_name("kernels.txt")
_NAMED = re.compile(r"[a-z][\w.]*\([^()]*\)")


class Entry(NamedTuple):
    """A kernel and the types of its arguments, as text; `module` is below :mod:`cable_shape.kernels`.

    called: by another kernel, and not from Python.
    """

    stage: str
    module: str
    name: str
    types: str
    called: bool

    @property
    def kernel(self) -> Any:
        """numba's dispatcher. AttributeError or ImportError: it is no longer there."""
        kernel = getattr(importlib.import_module(KERNELS + self.module), self.name)
        return kernel.within.compiled if self.called else kernel


def read(file: Path = FILE) -> list[Entry]:
    """All entries, in order."""
    entries, stage, short = [], "", dict[str, str]()
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            stage = line.strip("[]")
        elif line.startswith("@"):
            name, _, long = line.partition(" = ")
            short[name] = long
        elif line and not line.startswith("#"):
            kernel, _, types = line.partition(" ")
            for name, long in short.items():
                types = types.replace(f"{name};", long)
            module, _, name = kernel.rstrip("*").rpartition(".")
            entries.append(Entry(stage, module, name, types, kernel.endswith("*")))
    return entries


def write(entries: Iterable[Entry], file: Path = FILE) -> None:
    """Writes a list; named tuples, which are long, once each."""
    lines = ["# written by: python -m cable_shape.warm_up --record"]
    short: dict[str, str] = {}
    stage = ""
    for entry in entries:
        if entry.stage != stage:
            stage = entry.stage
            lines.append(f"[{stage}]")
        text = entry.types
        for long in _NAMED.findall(text):
            if long not in short:
                short[long] = f"@{len(short)}"
                lines.append(f"{short[long]} = {long}")
            text = text.replace(long, f"{short[long]};")
        lines.append(f"{entry.module}.{entry.name}{'*' if entry.called else ''} {text}")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def all_kernels() -> dict[tuple[str, str], Any]:
    """Every kernel of the package by module and name."""
    found = {}
    for info in pkgutil.walk_packages(cable_shape.kernels.__path__, KERNELS):
        for name, value in vars(importlib.import_module(info.name)).items():
            if hasattr(value, "py_func") and value.py_func.__module__ == info.name:
                found[info.name.removeprefix(KERNELS), name] = value
    return found


def cached() -> list[tuple[float, str, str, str, bool]]:
    """What is in the cache, oldest first: when it came [s], and but for its stage what an entry says."""
    found = []
    for (module, name), kernel in all_kernels().items():
        for called, one in ((False, kernel), (True, kernel.within.compiled)):
            files = one._cache._impl and one._cache._cache_file
            for key, data in files._load_index().items():
                path = Path(files._data_path(data))
                if path.exists():
                    found.append((path.stat().st_mtime_ns * 1e-9, module, name, text_of(key[0]), called))
    return sorted(found)
