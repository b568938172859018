"""From the control loop to the viewer process: :class:`Mailbox`, which holds only the newest letter.

A piece of memory that both processes map, a ring of slots. The writer never waits: it fills the next slot and moves on.
A pipe beside it wakes the reader, which takes the newest letter and passes over the older ones.
"""

from __future__ import annotations

import contextlib
import mmap
import os
from typing import final

SLOTS = 8
#: [bytes] of one slot. Pages that are never written take no memory, so this is an upper bound and not a cost.
SLOT_BYTES = 16 * 1024 * 1024
_HEAD_BYTES = 4096
_NEWEST, _TAKEN, _LENGTHS = 0, 1, 2  # words of the head: newest letter, letters taken, length of each slot's letter


@final
class Mailbox:
    """A ring of slots in shared memory; letters count from 1. One process writes, one reads.

    Parameters
    ----------
    file : int
        Descriptor of the memory, from :meth:`memory`; the mailbox takes it over.
    """

    def __init__(self, file: int) -> None:
        self.file = file
        self._map = mmap.mmap(file, _HEAD_BYTES + SLOTS * SLOT_BYTES)
        self._bytes = memoryview(self._map)
        self._words = self._bytes[:_HEAD_BYTES].cast("q")

    @staticmethod
    def memory() -> int:
        """A new descriptor of zeroed memory that vanishes with its last user."""
        file = os.memfd_create("cable_shape_viewer", os.MFD_CLOEXEC)
        os.ftruncate(file, _HEAD_BYTES + SLOTS * SLOT_BYTES)
        return file

    @property
    def newest(self) -> int:
        """Number of the newest letter, 0 before the first."""
        return self._words[_NEWEST]

    @property
    def taken(self) -> int:
        """How many letters the reader has taken."""
        return self._words[_TAKEN]

    def put(self, letter: bytes) -> bool:
        """Writes a letter without waiting; False if it is longer than a slot."""
        length = len(letter)
        if length > SLOT_BYTES:
            return False
        number = self._words[_NEWEST] + 1
        slot = number % SLOTS
        begin = _HEAD_BYTES + slot * SLOT_BYTES
        self._bytes[begin : begin + length] = letter
        self._words[_LENGTHS + slot] = length
        self._words[_NEWEST] = number
        return True

    def take(self, after: int) -> tuple[int, bytes] | None:
        """Number and text of the newest letter, None if there is none after number `after`."""
        while (number := self._words[_NEWEST]) > after:
            slot = number % SLOTS
            begin = _HEAD_BYTES + slot * SLOT_BYTES
            letter = bytes(self._bytes[begin : begin + self._words[_LENGTHS + slot]])
            # The slot is written again for letter number + SLOTS, which begins once number + SLOTS - 1 is the newest.
            if self._words[_NEWEST] < number + SLOTS - 1:
                self._words[_TAKEN] += 1
                return number, letter
        return None

    def close(self) -> None:
        """Lets go of the memory."""
        self._words.release()
        self._bytes.release()
        self._map.close()
        with contextlib.suppress(OSError):
            os.close(self.file)
