"""Reading an MCAP file whose index or end is missing: everything that is whole, message by message.

The layout is that of the MCAP specification: a file is a row of records, each an opcode (1 byte), a length (8 bytes,
little endian) and its content; a chunk is a record whose content is again a row of records, possibly compressed.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import final
from zlib import crc32

from rosbags.rosbag2 import ReaderError

from cable_shape.replay.bounds import unpacked

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")

RawMessage = tuple[str, int, bytes]  # topic, log time [ns], CDR


@final
@dataclass(slots=True)
class Salvaged:
    """What could be read of a damaged file.

    `lost` says in words what could not; it is empty when only the index is missing.
    """

    types: dict[str, str] = field(default_factory=dict)  # topic -> message type
    messages: list[RawMessage] = field(default_factory=list)  # of the wanted topics, in the order of log time
    lost: list[str] = field(default_factory=list)


def salvage_mcap(path: Path, wanted: Collection[str] | None = None) -> Salvaged:
    """Everything whole in the MCAP file at `path`; messages of the topics `wanted` only (None: of none).

    A file that does not begin like an MCAP file gives no topics.
    """
    found = Salvaged()
    if path.stat().st_size <= len(MAGIC):
        found.lost.append(f"{path.name} is empty")
        return found
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if content[: len(MAGIC)] != MAGIC:
            found.lost.append(f"{path.name} does not begin like an MCAP file")
            return found
        with memoryview(content) as view:
            _Scan(found, path.name, frozenset(wanted or ())).run(view)
    found.messages.sort(key=lambda message: message[1])
    return found


@final
class _Scan:
    """One walk through the records of a file."""

    def __init__(self, found: Salvaged, name: str, wanted: frozenset[str]) -> None:
        self.found = found
        self.name = name
        self.wanted = wanted
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, str] = {}

    def run(self, view: memoryview) -> None:
        """Walks the whole file."""
        offset = len(MAGIC)
        for opcode, content, end in _records(view, offset):
            if opcode in (_DATA_END, _FOOTER):
                return
            if opcode == _CHUNK:
                self._chunk(content, whole=end <= len(view), offset=offset)
            elif end <= len(view):
                self._record(opcode, content)
            offset = min(end, len(view))
        self.found.lost.append(f"{self.name} ends at byte {len(view)} within its messages, the rest is missing")

    def _chunk(self, content: memoryview, *, whole: bool, offset: int) -> None:
        """The records of a chunk; those before the cut if the file ends inside it."""
        if len(content) < _CHUNK_HEAD.size:
            return
        *_, size, checksum, name_length = _CHUNK_HEAD.unpack_from(content)
        begin = _CHUNK_HEAD.size + name_length
        compression = bytes(content[_CHUNK_HEAD.size : begin]).decode("ascii", "replace")
        data = _decompressed(content[begin + 8 :], compression)
        if whole and (len(data) != size or (checksum and crc32(data) != checksum)):
            self.found.lost.append(f"the chunk at byte {offset} of {self.name} is damaged and was left out")
            return
        last = 0
        for opcode, record, end in _records(data, 0):
            last = end
            if end <= len(data):
                self._record(opcode, record)
        if whole and last != len(data):
            self.found.lost.append(f"the chunk at byte {offset} of {self.name} is damaged and was read in part")

    def _record(self, opcode: int, content: memoryview) -> None:
        """A whole schema, channel or message; every other record is passed over."""
        if opcode == _MESSAGE and len(content) >= _MESSAGE_HEAD.size:
            channel, _, log_time, _ = _MESSAGE_HEAD.unpack_from(content)
            topic = self.channels.get(channel)
            if topic in self.wanted and topic is not None:
                self.found.messages.append((topic, log_time, bytes(content[_MESSAGE_HEAD.size :])))
        elif opcode == _SCHEMA and len(content) >= 6:
            (key,) = struct.unpack_from("<H", content)
            self.schemas[key] = _string(content, 2)
        elif opcode == _CHANNEL and len(content) >= 8:
            key, schema = struct.unpack_from("<HH", content)
            self.channels[key] = topic = _string(content, 4)
            self.found.types[topic] = self.schemas.get(schema, "")


def _records(view: memoryview, offset: int) -> Iterator[tuple[int, memoryview, int]]:
    """(opcode, content, where it ends) of each record from `offset`; the last one may end beyond the view."""
    while offset + _RECORD.size <= len(view):
        opcode, length = _RECORD.unpack_from(view, offset)
        if opcode == 0:  # no record has it: what follows is none, however long
            return
        begin = offset + _RECORD.size
        offset = begin + length
        yield opcode, view[begin : min(offset, len(view))], offset


def _string(content: memoryview, offset: int) -> str:
    """A string with its length (4 bytes) before it."""
    (length,) = struct.unpack_from("<I", content, offset)
    return bytes(content[offset + 4 : offset + 4 + length]).decode("utf-8", "replace")


def _decompressed(data: memoryview, compression: str) -> memoryview:
    """As much of `data` as can be decompressed: it may be cut off."""
    if compression == "":
        return data
    try:
        if compression in ("zstd", "lz4"):
            return memoryview(unpacked(data, compression))
    except (ReaderError, ValueError, RuntimeError, EOFError, zstd_error()):
        pass
    return memoryview(b"")


def zstd_error() -> type[Exception]:
    """What the zstd library raises for damaged data."""
    from backports import zstd

    return zstd.ZstdError
