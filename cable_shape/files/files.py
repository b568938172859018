"""The one way to files that a user or a peer names.

Only regular files are opened, with nothing that could wait, and judged by what was opened; at most so many bytes are
read, whatever a file says of its size; and errors name the file, the line, the key and the remedy, but quote nothing
else of what is in it. :mod:`cable_shape.files.yaml_files` reads YAML and JSON in this way.
"""

from __future__ import annotations

import math
import os
import stat
import sys
from collections.abc import Iterable
from pathlib import Path

from cable_shape.errors import ArgumentError, FileError, shown

#: Larger YAML and JSON files are refused: a cable, scene or case is a few kilobytes.
YAML_BYTES = 1_000_000
#: Larger tables and robot descriptions are refused.
TEXT_BYTES = 16 * 1024 * 1024
#: How files begin that may be written over, by their ending.
BEGINNINGS = {".rrd": (b"RRF",), ".yaml": (b"# Calibrated;", b"# How well a cable")}

_OPEN = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
_PIECE = 1 << 20


def path_of(path: str | Path, what: str = "file") -> Path:
    """`path` with the home folder for a leading ~.

    Raises
    ------
    ArgumentError
        If it is no path at all, such as a number or a text with NUL in it.
    """
    remedy = "Give a path as text or as a Path."
    if not isinstance(path, (str, os.PathLike)) or isinstance(os.fspath(path), bytes):
        raise ArgumentError.of(what, path, "it must be a path", remedy)
    if "\0" in os.fspath(path):
        raise FileError(f"{what}: {shown(os.fspath(path))} has NUL in it, which no path has. {remedy}")
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise FileError(
            f"{what}: {shown(os.fspath(path))}: there is no such user's home. Write the path out."
        ) from None


def find_file(path: str | Path) -> Path:
    """`path` as it is if it exists or is absolute, else below the config folder of the sources or the installation.

    Raises
    ------
    ArgumentError
        If it cannot be a path.
    """
    file = path_of(path)
    if file.is_absolute() or os.path.exists(file):
        return file
    for folder in config_folders():
        if os.path.exists(folder / file):
            return folder / file
    return file


def config_folders() -> list[Path]:
    """Where this package's configuration lies: beside the sources, or in share/ of a ROS prefix."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p] + [sys.prefix]
    source = Path(__file__).resolve().parents[2] / "config"
    return [source, *(Path(prefix, "share", "cable_shape", "config") for prefix in prefixes)]


def read_bounded(path: str | Path, most_bytes: int, what: str = "file") -> bytes:
    """All of a regular file, refused if it holds more than `most_bytes`; `what` it is, for errors.

    A device, a FIFO, a socket or a folder is refused at once, without reading from it.

    Raises
    ------
    FileError
        Naming the file and the remedy, and nothing that is in it.
    """
    file = path_of(path, what)
    descriptor, size = _opened(file, what)
    try:
        if size <= most_bytes:
            pieces, left = [], most_bytes + 1
            while left and (piece := os.read(descriptor, min(left, _PIECE))):
                pieces.append(piece)
                left -= len(piece)
            if left:
                return b"".join(pieces)
    except OSError as error:
        raise FileError(f"{file}: cannot be read: {error.strerror}. Look at the disk.") from None
    finally:
        os.close(descriptor)
    much = f"{size} bytes" if size > most_bytes else "it goes on"
    raise FileError(f"{file}: {much}, at most {most_bytes} bytes are read. Is it the right {what}?")


def read_text(path: str | Path, most_bytes: int = TEXT_BYTES, what: str = "file") -> str:
    """The UTF-8 text of a file, see :func:`read_bounded`."""
    content = read_bounded(path, most_bytes, what)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise FileError(f"{path}, line {line}: it is not text in UTF-8. Is it the right {what}?") from None


def regular(path: str | Path, most_bytes: int | None = None, what: str = "file") -> Path:
    """The path of a regular file of at most so many bytes, and not empty, for a library that opens it by itself.

    Raises
    ------
    FileError
    """
    file = path_of(path, what)
    descriptor, size = _opened(file, what)
    os.close(descriptor)
    if size == 0:  # of the kernel, perhaps, and nothing that a library may wait for
        raise FileError(f"{file}: it is empty. Is it the right {what}?")
    if most_bytes is not None and size > most_bytes:
        raise FileError(f"{file}: {size} bytes, at most {most_bytes} bytes are read. Is it the right {what}?")
    return file


def safe_output(folder: str | Path, path: str | Path, endings: Iterable[str] = tuple(BEGINNINGS)) -> Path:
    """Where a file that somebody else names may be written: below `folder`, and over nothing but its own kind.

    Links are followed before they are judged, and never written through.

    Parameters
    ----------
    folder : path of a folder that exists
    path : relative to the folder, or absolute and below it; the folder it lies in must exist
    endings : of :data:`BEGINNINGS`

    Raises
    ------
    ArgumentError
        If it lies elsewhere, has another ending, or names something that is no file of this kind.
    """
    asked = path_of(path, "output")
    allowed = tuple(endings)
    if asked.suffix not in allowed or asked.name == asked.suffix:
        raise ArgumentError.of("output", str(asked), f"it must end in {' or '.join(allowed)}", "Name another file.")
    if not str(folder):
        raise ArgumentError.of("output", str(asked), "no output folder is set", "Set the folder that files go to.")
    try:
        root = path_of(folder, "output folder").resolve(strict=True)
        place = (root / asked).parent.resolve(strict=True)
    except (OSError, RuntimeError):
        remedy = "Make the folder first."
        raise ArgumentError.of("output", str(asked), f"its folder must exist, from {folder} on", remedy) from None
    if not root.is_dir() or not place.is_relative_to(root):
        remedy = "Name a file in there, or set another output folder where this is started."
        raise ArgumentError.of("output", str(asked), f"files are written only below {root}", remedy)
    file = place / asked.name
    if not _may_be_written(file):
        bound = f"something is there that is no {asked.suffix[1:]} file of cable_shape"
        raise ArgumentError.of("output", str(asked), bound, "Remove it by hand, or name another file.")
    return file


def finite(value: float) -> float | None:
    """`value`, None for NaN and infinity, which JSON cannot say."""
    return value if math.isfinite(value) else None


def _opened(file: Path, what: str) -> tuple[int, int]:
    """A descriptor of a regular file and the size it says to have; to be closed by the caller."""
    descriptor = -1
    try:
        status = os.stat(file)
        if stat.S_ISREG(status.st_mode):  # else it is not even opened: opening some devices does something
            descriptor = os.open(file, _OPEN)
            status = os.fstat(descriptor)
    except FileNotFoundError:
        raise FileError(f"{file}: no such file. Check the path; it is taken from {_here()}.") from None
    except OSError as error:
        raise FileError(f"{file}: cannot be opened: {error.strerror}. Check the path and its permissions.") from None
    except ValueError:
        raise FileError(f"{what}: {shown(os.fspath(file))} cannot be the name of a file. Check the path.") from None
    if descriptor < 0 or not stat.S_ISREG(status.st_mode):
        if descriptor >= 0:
            os.close(descriptor)
        raise _irregular(file, status.st_mode, what)
    return descriptor, status.st_size


def _irregular(file: Path, mode: int, what: str) -> FileError:
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a FIFO"), (stat.S_ISSOCK, "a socket"))
    kind = next((word for test, word in kinds if test(mode)), "a device")
    return FileError(f"{file}: it is {kind}, not a regular file. Name the {what} itself.")


def _here() -> str:
    try:
        return os.getcwd()
    except OSError:
        return "a working directory that is gone"


def _may_be_written(file: Path) -> bool:
    """Whether nothing is there, or a file of its own kind with no other name; an empty one is of any kind."""
    try:
        descriptor = os.open(file, _OPEN | os.O_NOFOLLOW)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
            return False
        return status.st_size == 0 or os.read(descriptor, 64).startswith(BEGINNINGS[file.suffix])
    except OSError:
        return False
    finally:
        os.close(descriptor)
