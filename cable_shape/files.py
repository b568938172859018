"""YAML and JSON files: safe-loaded, bounded in size, with errors that name the file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from cable_shape.errors import ArgumentError

#: Larger files are refused: a cable, scene or case is a few kilobytes.
MAX_BYTES = 16 * 1024 * 1024

#: Aliases let a small file stand for a huge one.
MAX_VALUES = 5_000_000


def read_text(path: str | Path) -> str:
    """The text of a file, refused above 16 MiB."""
    file = Path(path).expanduser()
    try:
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise ArgumentError(f"{file}: {size} bytes, at most {MAX_BYTES} are read. Is it the right file?")
        return file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ArgumentError(f"{file}: no such file. Check the path; it is taken from {Path.cwd()}.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ArgumentError(f"{file}: cannot be read as text ({error}).") from None


def load_yaml(path: str | Path) -> dict[str, Any]:
    """A YAML (or JSON) file whose top level is a mapping."""
    import yaml

    text = read_text(path)
    try:
        data = json.loads(text) if str(path).endswith(".json") else yaml.safe_load(text)
    except (yaml.YAMLError, json.JSONDecodeError, RecursionError) as error:
        raise ArgumentError(f"{path}: not well formed: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict):
        raise ArgumentError(f"{path}: the top level must be a mapping of keys to values, not {type(data).__name__}.")
    if _values(data, {}) > MAX_VALUES:
        raise ArgumentError(f"{path}: its aliases (*name) make more than {MAX_VALUES} values. Write out what is meant.")
    return data


def finite(value: float) -> float | None:
    """`value`, None for NaN and infinity, which JSON cannot say."""
    return value if math.isfinite(value) else None


def _values(data: Any, known: dict[int, float]) -> float:
    """How many values `data` is when each alias is written out; infinitely many if it contains itself."""
    if not isinstance(data, (dict, list)):
        return 1
    if id(data) not in known:
        known[id(data)] = math.inf
        inner = data.values() if isinstance(data, dict) else data
        known[id(data)] = 1 + sum(_values(value, known) for value in inner)
    return known[id(data)]
