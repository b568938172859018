"""Which input messages may be used together: stamps that increase, one publisher, those of all grippers at one time.

All stamps are integers in nanoseconds.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar, final

from cable_shape.errors import InputError, StaleInputError

T = TypeVar("T")

SECOND = 1_000_000_000  # ns

#: A stamp that jumps back by more than this [ns] is a clock that was set back (a bag that loops), not a late message.
RESTART_JUMP = SECOND

#: Where several publishers are known, so many messages must have followed each other before one is used ...
ROW = 10

#: [s] ... and for so long none of another publisher must have come between.
MIXED = 1.0

#: Unpaired messages kept of each gripper, so that one whose messages travel longer still finds its partner.
HISTORY = 32

#: A closer partner is waited for, once, if the stamps differ by more than this fraction of the time between messages.
CLOSE_ENOUGH = 0.6


@final
class StampGuard:
    """The stamps of one topic must be set and increase.

    Parameters
    ----------
    topic : str
        Named in the messages.
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.last: int | None = None

    def check(self, stamp: int) -> bool:
        """Takes the stamp of the newest message; True if the clock was set back by more than a second.

        Raises
        ------
        StaleInputError
            For a stamp that is not set, repeated, or up to a second older than the last one.
        """
        last = self.last
        if stamp <= 0:
            raise StaleInputError(
                f"{self.topic}: header.stamp = {stamp} ns is not allowed: it must be above 0. "
                "Fill it with the time of the measurement."
            )
        restarted = False
        if last is not None and stamp <= last:
            back = last - stamp
            if back == 0:
                raise StaleInputError(
                    f"{self.topic}: header.stamp = {stamp} ns is repeated: every message needs a newer stamp. "
                    "Stamp each measurement once, and look for two publishers on this topic."
                )
            if back <= RESTART_JUMP:
                raise StaleInputError(
                    f"{self.topic}: header.stamp = {stamp} ns goes backwards, by {back / SECOND:.6f} s from {last} ns: "
                    "it must increase. Look for two publishers on this topic or a clock that was adjusted; a jump of "
                    f"more than {RESTART_JUMP / SECOND:g} s is taken as a restart."
                )
            restarted = True
        self.last = stamp
        return restarted

    def forget(self) -> None:
        """Any stamp may come next."""
        self.last = None


@final
class MissedCount:
    """Counts the messages of one topic that were never read: overtaken by a newer one, or lost on their way."""

    def __init__(self) -> None:
        self.missed = 0
        self._last: int | None = None

    def take(self, info: Mapping[str, int | None]) -> None:
        """What rclpy tells with a message: `publication_sequence_number` counts the messages of its publisher."""
        number = info.get("publication_sequence_number")  # None: this middleware does not count
        if number is None:
            return
        if self._last is not None and number > self._last:  # else it is another publisher, or one started again
            self.missed += number - self._last - 1
        self._last = number

    def forget(self) -> None:
        """The next message has none before it; the count stays."""
        self._last = None


@final
class SpeakerGuard:
    """Whether the messages of a topic come from one publisher; nothing in a message says which one sent it.

    As long as several publishers are known, only numbers that follow each other are taken for those of one: where two
    send, each message of the other breaks the row. One that was killed stays known for a while; once it has been silent
    for `MIXED` [s], who sends in its place is used.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._row = ROW
        self._until = -math.inf  # s, nothing is used before

    def check(self, publishers: int, info: Mapping[str, int | None], now: float) -> bool:
        """Whether a message may be used that came at `now` [s, steady] when so many `publishers` were known.

        `info` is what rclpy tells with it: `publication_sequence_number` counts the messages of its publisher.
        """
        number = info.get("publication_sequence_number")  # None: this middleware does not count
        last, self._last = self._last, number
        if publishers < 2:
            self._row = ROW
        elif number is None or last is None or number > last + 1:
            self._row = 0  # another one, or messages that were overtaken
        elif number == last + 1:
            self._row += 1
        else:
            self._row, self._until = 0, now + MIXED
        return self._row >= ROW and now >= self._until

    def forget(self) -> None:
        """The next message has none before it."""
        self._last = None


@final
@dataclass(frozen=True, slots=True)
class Pair(Generic[T]):
    """What all grippers said at nearly the same time; `stamp` is the oldest of theirs, `skew` their distance."""

    stamp: int
    values: tuple[T, ...]
    skew: int

    @property
    def start(self) -> T:
        """Of two grippers the first."""
        return self.values[0]

    @property
    def end(self) -> T:
        """Of two grippers the second."""
        return self.values[-1]


@final
class Pairing(Generic[T]):
    """Puts together the messages of all grippers: closest stamps first, latest wins, each message used once.

    Streams of equal rate keep their smallest possible skew, also after a lost message: a partner further away than
    about half a period is passed over once in favour of the next message. Never twice in a row, so pairs keep coming
    whatever the jitter.

    Parameters
    ----------
    max_skew : int
        [ns], stamps further apart are never paired.
    sides : int
        How many grippers there are, at least 1.
    """

    def __init__(self, max_skew: int, sides: int = 2) -> None:
        self.max_skew = max_skew
        self.pairs = 0
        self.unpaired = 0  # messages that were given up without a partner
        self._waiting: tuple[deque[tuple[int, T]], ...] = tuple(deque() for _ in range(sides))
        self._newest: list[int | None] = [None] * sides
        self._period: list[int | None] = [None] * sides
        self._passed_over = False

    def put(self, side: int, stamp: int, value: T) -> Pair[T] | None:
        """Takes a message of `side` (from 0 on), newer than all of that side, and returns the pair it makes."""
        newest = self._newest[side]
        if newest is not None:
            self._period[side] = stamp - newest
        self._newest[side] = stamp
        own = self._waiting[side]
        own.append((stamp, value))
        if len(own) > HISTORY:
            own.popleft()
            self.unpaired += 1
        if not all(self._waiting):
            return None
        chosen = [min(waiting, key=lambda entry: abs(entry[0] - stamp)) for waiting in self._waiting]
        chosen[side] = own[-1]
        stamps = [entry[0] for entry in chosen]
        oldest = min(stamps)
        skew = max(stamps) - oldest
        if skew > self.max_skew:
            return None
        if stamp - oldest == skew > 0 and not self._passed_over and self._closer_may_come(skew):
            self._passed_over = True
            return None
        self._passed_over = False
        self.pairs += 1
        for waiting, used in zip(self._waiting, stamps, strict=True):
            while waiting and waiting[0][0] <= used:
                waiting.popleft()
                self.unpaired += 1
        self.unpaired -= len(chosen)  # those of the pair itself
        return Pair(oldest, tuple(entry[1] for entry in chosen), skew)

    def _closer_may_come(self, skew: int) -> bool:
        """Whether the next message of another side is likely to be closer than `skew`."""
        periods = [period for period in self._period if period is not None]
        return len(periods) == len(self._period) and skew > CLOSE_ENOUGH * min(periods)

    def nearest_miss(self) -> int | None:
        """[ns], how far apart the newest stamps of the sides are; None until all were seen."""
        seen = [stamp for stamp in self._newest if stamp is not None]
        return max(seen) - min(seen) if len(seen) == len(self._newest) else None

    def seen(self, side: int) -> bool:
        """Whether a message of this side has come."""
        return self._newest[side] is not None

    def clear(self) -> None:
        """Forgets all messages; the counts stay."""
        for waiting in self._waiting:
            self.unpaired += len(waiting)
            waiting.clear()
        self._newest = [None] * len(self._waiting)
        self._period = [None] * len(self._waiting)
        self._passed_over = False


@final
class FrameGuard:
    """All input must be in one frame: nothing here transforms between frames.

    Parameters
    ----------
    expected : str
        Empty: the frame of the first message that is used.
    """

    def __init__(self, expected: str) -> None:
        self.expected = expected or None

    def check(self, topic: str, frame_id: str) -> None:
        """Takes the frame of a message.

        Raises
        ------
        InputError
        """
        if self.expected is not None and frame_id != self.expected:
            raise InputError(
                f"{topic}: header.frame_id = {frame_id!r} is not allowed: it must be {self.expected!r}, the frame of "
                "the parameter frame_id or else of the first message. Publish the pose in that frame (nothing is "
                "transformed here), or set frame_id."
            )

    def fix(self, frame_id: str) -> None:
        """The message was used: from now on this is the frame."""
        if self.expected is None:
            self.expected = frame_id
