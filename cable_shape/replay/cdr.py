"""Messages as CDR, each by one call of struct: field by field, as rosbags does it, takes several times as long."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

_HEADER = b"\x00\x01\x00\x00"  # little-endian CDR; places count from after it
_SIZES = {"?": 1, "B": 1, "i": 4, "I": 4, "d": 8}


def packed(codes: str, values: Sequence[object]) -> bytes:
    """The message of these values, one for each code.

    codes: those of struct, of numbers; "s", of a str; "D", of an array of float64; "y", of an array of bytes.
    """
    plain: list[object] = [_HEADER]
    lengths: list[int] = []
    done = 0
    for place, code in _long(codes):
        value = values[place]
        content = f"{value}\0".encode() if code == "s" else np.asarray(value).tobytes()
        lengths.append(len(content))
        plain += values[done:place]
        plain += (len(content) // 8 if code == "D" else len(content), content)
        done = place + 1
    plain += values[done:]
    return _layout(codes, tuple(lengths)).pack(*plain)


@lru_cache(maxsize=1024)
def _long(codes: str) -> tuple[tuple[int, str], ...]:
    """Places and codes of texts and arrays."""
    return tuple((place, code) for place, code in enumerate(codes) if code in "sDy")


@lru_cache(maxsize=1024)
def _layout(codes: str, lengths: tuple[int, ...]) -> struct.Struct:
    """Numbers where CDR has them, each at a multiple of its size; lengths [bytes] of arrays and texts."""
    form, place, left = "<4s", 0, iter(lengths)

    def put(code: str, size: int, align: int) -> None:
        nonlocal form, place
        gap = -place % align
        form += f"{gap}x{code}" if gap else code
        place += gap + size

    for code in codes:
        if code in "sDy":
            length = next(left)
            put("I", 4, 4)
            put(f"{length}s", length, 8 if code == "D" and length else 1)
        else:
            put(code, _SIZES[code], _SIZES[code])
    return struct.Struct(form)
