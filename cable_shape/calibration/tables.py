"""Tables of numbers (CSV) and arrays (NPZ) that observations come from, read within bounds."""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import FileError, UnknownKeyError
from cable_shape.files.files import read_bounded, read_text

#: Larger archives of arrays are refused, and those whose arrays are larger when they are unpacked.
NPZ_BYTES, ARRAYS_BYTES = 64 * 1024 * 1024, 256 * 1024 * 1024


def head_of(path: str | Path) -> list[str]:
    """The names in the first line of a table."""
    return [word.strip() for word in read_text(path, what="table").partition("\n")[0].split(",")]


def rows_of(
    path: str | Path, needed: Collection[str], known: Collection[str] | None = None
) -> Iterator[tuple[int, dict[str, str]]]:
    """Line number and values by column of each row of a CSV whose first line names the columns.

    needed: columns that must be there; known: those that may, None for any.

    Raises
    ------
    FileError, UnknownKeyError
        Naming the file.
    """
    lines = read_text(path, what="table").splitlines()
    names = [word.strip() for word in lines[0].split(",")] if lines else []
    if not set(needed) <= set(names):
        raise FileError(f"{path}: its first line must name the columns {', '.join(needed)}.")
    for name in names if known is not None else ():
        if name not in (known or ()):
            raise UnknownKeyError.among(str(path), name, known or ())
    if len(set(names)) < len(names):
        raise FileError(f"{path}, line 1: a column is named twice. Remove one of them.")
    table = csv.reader(lines[1:])
    try:
        for row in table:
            if row:
                yield table.line_num + 1, dict(zip(names, row, strict=False))
    except csv.Error:
        text = "it is no row of a table. Write numbers with commas between them."
        raise FileError(f"{path}, line {table.line_num + 1}: {text}") from None


def number_in(row: dict[str, str], name: str, where: str) -> float:
    """The number in a column, NaN allowed."""
    try:
        return float(row[name])
    except (KeyError, ValueError):
        given = row.get(name, "")[:40]
        raise FileError(f"{where}: {name} = {given!r} is not allowed: it must be a number. Correct it.") from None


def load_arrays(path: str | Path) -> dict[str, Array]:
    """The arrays of an NPZ file by name; objects are never unpacked.

    Raises
    ------
    FileError
    """
    remedy = "Write it with numpy.savez."
    content = io.BytesIO(read_bounded(path, NPZ_BYTES, "file of arrays"))
    try:
        with zipfile.ZipFile(content) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > ARRAYS_BYTES:
            raise FileError(f"{path}: {size} bytes when unpacked, at most {ARRAYS_BYTES} are read. Write fewer frames.")
        with np.load(content, allow_pickle=False) as arrays:
            return {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays}
    except FileError:
        raise
    except (
        OSError, ValueError, TypeError, KeyError, EOFError, MemoryError, OverflowError, NotImplementedError,
        RuntimeError, SyntaxError, zlib.error, zipfile.BadZipFile,
    ):  # fmt: skip
        raise FileError(f"{path}: not a sound file of arrays of numbers. {remedy}") from None
