"""Bounds on what `rosbags` reads: :func:`bound_rosbags`. It trusts a recording's own YAML and compressed chunks."""

from __future__ import annotations

import types
from functools import cache, partial
from typing import Any, final

from rosbags.rosbag2 import ReaderError

from cable_shape.files.yaml_files import read_strictly

#: Larger pieces of a recording are not unpacked.
UNPACKED_BYTES = 256 * 1024 * 1024


@final
class _StrictYaml:
    """What rosbags takes for its library of YAML."""

    def __init__(self, **_: object) -> None:
        """As ruamel's."""

    def load(self, text: str) -> Any:
        return read_strictly(text, "metadata")


def unpacked(data: Any, compression: str) -> bytes:
    """The content of one compressed piece, as far as it is there.

    Raises
    ------
    ReaderError
        If it is larger than `UNPACKED_BYTES`.
    """
    decompressor: Any
    if compression == "zstd":
        from backports import zstd

        decompressor = zstd.ZstdDecompressor()
    else:
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

        decompressor = LZ4FrameDecompressor()
    content: bytes = decompressor.decompress(bytes(data), UNPACKED_BYTES + 1)
    if len(content) > UNPACKED_BYTES:
        raise ReaderError(f"a piece is larger than {UNPACKED_BYTES} bytes when it is unpacked")
    return content


def _of_size(compression: str, data: bytes, _: int) -> bytes:
    """As rosbags calls it, with the size that it is said to have, which rosbags compares."""
    return unpacked(data, compression)


@cache
def bound_rosbags() -> None:
    """Puts bounded readers in place of those that rosbags takes; what is sound is read as before."""
    from rosbags.rosbag2 import metadata, reader, storage_mcap

    places: Any = (metadata, reader)
    for place in places:
        place.YAML = _StrictYaml
    for compression in ("zstd", "lz4"):
        storage_mcap.DECOMPRESSORS[compression] = partial(_of_size, compression)
    streams: Any = reader
    streams.zstd = types.SimpleNamespace(open=streams.zstd.open, decompress=lambda data: unpacked(data, "zstd"))
