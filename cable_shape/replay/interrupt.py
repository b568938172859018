"""Signals during a replay come between two messages, so that no half message is written: :class:`Interruptible`."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterable, Iterator
from types import FrameType, TracebackType
from typing import Any, Self, final

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


@final
class Interruptible:
    """While it is entered, SIGINT and SIGTERM raise KeyboardInterrupt; within `messages` only before the next one.

    A second signal raises at once.
    """

    def __init__(self) -> None:
        self._walking = False
        self._told = False
        self._before: dict[signal.Signals, Any] = {}

    def messages(self, messages: Iterable[Any]) -> Iterator[Any]:
        """The same messages."""
        self._walking = True
        try:
            for message in messages:
                if self._told:
                    raise KeyboardInterrupt
                yield message
        finally:
            self._walking = False

    def _tell(self, number: int, frame: FrameType | None) -> None:
        if self._told or not self._walking:
            raise KeyboardInterrupt
        self._told = True

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():  # others get no signals
            self._before = {number: signal.signal(number, self._tell) for number in _NUMBERS}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
