"""Reading a recording: :class:`Bag`, any rosbag2 through `rosbags`, without middleware or a ROS installation."""

from __future__ import annotations

import contextlib
import re
import sqlite3
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Protocol, final

import apsw
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from cable_shape.errors import BagError
from cable_shape.files.files import path_of, regular
from cable_shape.files.yaml_files import load_yaml
from cable_shape.replay.bounds import bound_rosbags
from cable_shape.replay.mcap_salvage import Salvaged, salvage_mcap, zstd_error

#: What rosbags and the libraries below it raise for a damaged file.
_DAMAGED: tuple[type[Exception], ...] = (
    ReaderError,
    SerdeError,
    apsw.Error,
    struct.error,
    zstd_error(),
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,  # a length that is damaged
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)

_METADATA = "rosbag2_bagfile_information"
STORAGE_SUFFIXES = (".mcap", ".db3")


class _Part(Protocol):
    """One readable piece of a recording."""

    types: dict[str, str]  # topic -> message type
    counts: dict[str, int]  # topic -> messages it should hold, where that is known

    def messages(self, wanted: Collection[str], problems: list[str]) -> Iterator[tuple[str, int, bytes]]: ...

    def close(self) -> None: ...


@final
class Bag:
    """A rosbag2 recording, open for reading: a folder, or a single .mcap or .db3 file.

    A damaged recording is read as far as it goes. After `messages` has run to its end, `problems` says what could not
    be read and `unread` how many messages of each topic that were.

    store: of the types of messages; default: those of ROS 2 Jazzy.

    Raises
    ------
    BagError
        If nothing can be read; it says why and what to do.
    """

    def __init__(self, path: str | Path, store: Typestore | None = None) -> None:
        self.path = path_of(path, "recording")
        self.problems: list[str] = []  # what could not be read
        self.notes: list[str] = []  # what is odd, though nothing is missing
        self.read: Counter[str] = Counter()  # topic -> messages given so far
        self._store = store or get_typestore(Stores.ROS2_JAZZY)
        self._parts = self._open()
        self.types = {topic: kind for part in self._parts for topic, kind in part.types.items()}
        self.counts = self._expected()

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of these topics, in the order of log time within each file."""
        undecodable: Counter[str] = Counter()
        wanted = [topic for topic in topics if topic in self.types]
        for part in self._parts:
            for topic, log_time, raw in part.messages(wanted, self.problems):
                try:
                    message = self._store.deserialize_cdr(raw, self.types[topic])
                except _DAMAGED:
                    undecodable[topic] += 1
                    continue
                self.read[topic] += 1
                yield topic, log_time, message
        for topic, count in sorted(undecodable.items()):
            self.problems.append(f"{count} messages of {topic} are damaged and were left out")
        for topic, count in self.unread(wanted).items():
            self.problems.append(f"{topic}: {self.read[topic]} of {self.counts[topic]} messages read, {count} missing")

    def unread(self, topics: Collection[str]) -> dict[str, int]:
        """Topic -> number of messages that the recording says it holds but did not give."""
        missing = {topic: self.counts[topic] - self.read[topic] for topic in topics if topic in self.counts}
        return {topic: count for topic, count in missing.items() if count > 0}

    def close(self) -> None:
        """Closes the files."""
        for part in self._parts:
            part.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self) -> list[_Part]:
        """The recording as a whole if it is sound, else file by file."""
        if self.path.name == "metadata.yaml":
            self.path = self.path.parent
        files = _storage_files(self.path)
        bound_rosbags()
        reason = "metadata.yaml is missing"
        if self.path.is_file() or (self.path / "metadata.yaml").is_file():
            try:
                if self.path.is_dir():
                    _check_files(self.path)
                else:
                    regular(self.path, what="recording")
                return [_Sound(self.path)]
            except _DAMAGED as error:
                reason = _in_one_line(error)
        parts = [part for file in files for part in self._open_file(file)]
        if not parts:
            details = "; ".join([reason, *self.problems])
            raise BagError(
                f"{self.path}: nothing in this recording can be read ({details}). "
                "Give a rosbag2 folder with metadata.yaml, or one .mcap or .db3 file."
            )
        if self.path.is_dir():
            self.notes.append(f"{self.path.name} was read file by file: {reason}")
        return parts

    def _open_file(self, file: Path) -> list[_Part]:
        """One storage file, by its index if that is sound, else by salvage."""
        if not file.stat().st_size:
            self.problems.append(f"{file.name} is empty")
            return []
        if self.path.is_dir():
            with contextlib.suppress(*_DAMAGED):
                return [_Sound(file)]
        part = _Damaged(file)
        if not part.types:
            self.problems.extend(part.found.lost)
            return []
        self.notes.append(f"the index of {file.name} is missing or damaged; its messages were read one after the other")
        return [part]

    def _expected(self) -> dict[str, int]:
        """Topic -> messages, by metadata.yaml or else by the index of each file."""
        counts: Counter[str] = Counter()
        for part in self._parts:
            counts.update(part.counts)
        return {**counts, **_counts_in_metadata(self.path / "metadata.yaml")}


@final
class _Sound:
    """A recording or a file with a sound index."""

    def __init__(self, path: Path) -> None:
        self.reader = Reader(path)
        self.reader.open()
        self.types = {c.topic: c.msgtype for c in self.reader.connections}
        self.counts: dict[str, int] = {}
        for connection in self.reader.connections:
            self.counts[connection.topic] = self.counts.get(connection.topic, 0) + connection.msgcount

    def messages(self, wanted: Collection[str], problems: list[str]) -> Iterator[tuple[str, int, bytes]]:
        """Until the end, or until the first damage."""
        connections = [c for c in self.reader.connections if c.topic in wanted]
        if not connections:
            return
        messages = self.reader.messages(connections)
        count = 0
        while True:
            try:
                connection, log_time, raw = next(messages)
            except StopIteration:
                return
            except _DAMAGED as error:
                problems.append(f"reading stopped after {count} messages: {_in_one_line(error)}")
                return
            count += 1
            yield connection.topic, log_time, raw

    def close(self) -> None:
        self.reader.close()


@final
class _Damaged:
    """A file without a sound index."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.salvage = salvage_sqlite if path.suffix == ".db3" else salvage_mcap
        self.found = self.salvage(path, ())
        self.types = self.found.types
        self.counts: dict[str, int] = {}

    def messages(self, wanted: Collection[str], problems: list[str]) -> Iterator[tuple[str, int, bytes]]:
        found = self.salvage(self.path, wanted)
        yield from found.messages
        problems.extend(found.lost)

    def close(self) -> None:
        """Nothing is open between calls."""


def salvage_sqlite(path: Path, wanted: Collection[str] | None = None) -> Salvaged:
    """Every row before the first damage of a .db3 file; messages of the topics `wanted` only (None: of none)."""
    found = Salvaged()
    chosen: dict[int, str] = {}
    try:
        with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?immutable=1", uri=True)) as connection:
            # SQLite refuses a file shorter than its header says, except while the schema may be repaired.
            connection.execute("PRAGMA writable_schema = ON")
            for key, topic, kind in connection.execute("SELECT id, name, type FROM topics"):
                found.types[topic] = kind
                if topic in (wanted or ()):
                    chosen[key] = topic
            if chosen:
                rows = connection.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id")
                for key, log_time, data in rows:
                    if key in chosen:
                        found.messages.append((chosen[key], log_time, data))
    except sqlite3.Error as error:
        found.lost.append(f"{path.name}: {error} after {len(found.messages)} messages")
    found.messages.sort(key=lambda message: message[1])
    return found


def _storage_files(path: Path) -> list[Path]:
    """The .mcap or .db3 files of a recording, in the order in which they were recorded."""
    if path.is_file():
        if path.suffix == ".bag":
            raise BagError(f"{path}: a ROS 1 bag. Convert it: rosbags-convert --src {path} --dst {path.stem}")
        if path.suffix not in STORAGE_SUFFIXES:
            raise BagError(f"{path}: not a recording. Give a rosbag2 folder, or one .mcap or .db3 file.")
        return [path]
    if not path.is_dir():
        raise BagError(f"{path}: no such file or folder. Check the path; it is taken from {Path.cwd()}.")
    files = [file for file in path.iterdir() if file.suffix in STORAGE_SUFFIXES and file.is_file()]
    if not files and not (path / "metadata.yaml").is_file():
        raise BagError(
            f"{path}: not a recording: neither metadata.yaml nor a .mcap or .db3 file is in it. "
            "Give the folder that `ros2 bag record` made."
        )
    return sorted(files, key=lambda file: [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", file.name)])


def _check_files(folder: Path) -> None:
    """Refuses metadata.yaml that names what is no regular file.

    Raises
    ------
    FileError, LookupError, TypeError
    """
    for name in load_yaml(folder / "metadata.yaml", (_METADATA,))[_METADATA]["relative_file_paths"]:
        regular(folder / Path(name).name, what="recording")


def _counts_in_metadata(path: Path) -> dict[str, int]:
    """Topic -> messages as metadata.yaml says; nothing if it cannot be read."""
    counts: Counter[str] = Counter()
    try:
        information = load_yaml(path, (_METADATA,))[_METADATA]
        for entry in information["topics_with_message_count"]:
            counts[str(entry["topic_metadata"]["name"])] += int(entry["message_count"])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return {}
    return counts


def _in_one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
