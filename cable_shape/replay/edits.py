"""Edits in a recording, and when they were made between its cycles: :class:`RecordedEdits`."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from cable_shape.cycle.cycle import Cycle
from cable_shape.errors import CableShapeError
from cable_shape.messages.edits import edits_of
from cable_shape.replay.bag_writer import EDITS_TYPE, cable_shape_store
from cable_shape.replay.bags import Bag
from cable_shape.replay.inputs import Source, stamp_of


@final
@dataclass(frozen=True, slots=True)
class _Recorded:
    message: Any  # CableEdits
    restarts: int  # how often the clock was set back before
    stamp: int  # ns, of the cycle that it came after


@final
class RecordedEdits:
    """The edits of a recording, in their order.

    Parameters
    ----------
    path : of the recording
    topic : str
    source : Source
        A fresh one, by which restarts of the clock are told.
    """

    def __init__(self, path: Path, topic: str, source: Source) -> None:
        self.topic = topic
        self.problems: list[str] = []
        self.read = self.done = 0  # messages, and those repeated
        self._waiting: deque[_Recorded] = deque()
        restarts, number = 0, 0
        with Bag(path, cable_shape_store()) as bag:
            for name, _, message in bag.messages((topic, *source.topics)):
                if name != topic:
                    source.feed(name, message)
                    restarts += source.restarted
                    continue
                if message.number != number + 1:
                    self.problems.append(_missing(topic, number, int(message.number)))
                number = int(message.number)
                self.read += 1
                self._waiting.append(_Recorded(message, restarts, stamp_of(message)))

    @staticmethod
    def in_bag(bag: Bag, topic: str) -> bool:
        """Whether some were recorded."""
        return bag.types.get(topic) == EDITS_TYPE and bag.counts.get(topic) != 0

    def make(self, cycle: Cycle, restarts: int, stamp: int | None = None) -> list[Any]:
        """Makes those that came before the cycle of `stamp` [ns], after so many restarts, and gives their messages.

        stamp: default: all before the next restart.
        """
        made = []
        while self._waiting:
            first = self._waiting[0]
            later = first.restarts > restarts or (stamp is not None and first.stamp >= stamp)
            if later and not first.restarts < restarts:
                break
            self._waiting.popleft()
            if self._make(cycle, first.message):
                made.append(first.message)
        return made

    def _make(self, cycle: Cycle, message: Any) -> bool:
        try:
            result = cycle.edit(*edits_of(message.edits), cable=message.cable_id or None)
            reason = result.reason
        except CableShapeError as error:
            reason = str(error)
        if reason:
            text = (
                f"{self.topic}: edits number {message.number} could not be repeated, from then on shapes are others: "
            )
            self.problems.append(text + reason)
            return False
        self.done += 1
        return True


def _missing(topic: str, last: int, number: int) -> str:
    """What to say where numbers do not follow each other."""
    if number <= last:
        return (
            f"{topic}: edits number {number} come after number {last}: the node was configured anew. Cut the recording "
            "there, and replay both parts."
        )
    which = f"{last + 1}" if number == last + 2 else f"{last + 1} to {number - 1}"
    return (
        f"{topic}: edits number {which} were not recorded, shapes are those without them. Record from configure on, or "
        "give scene and cable as they were then."
    )
