"""The newest pairs of several cables for one cycle: :class:`Gathering`. Knows no ROS."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, TypeVar, final

T = TypeVar("T")


@final
class Gathering(Generic[T]):
    """Waits for the cables that came together last time, but for none whose neighbour comes a second time.

    Cables of one tracker so share a cycle; one that falls silent is waited for once, one that comes back joins again.
    What comes back just after a cycle, nearer to it than to what comes next, has a cycle of its own and joins from then
    on: else it would share cycles with what came after it for good.

    Parameters
    ----------
    names : iterable of str
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names = frozenset(names)
        self.late = 0  # left out: older than the cycle before
        self.clear()

    def clear(self) -> None:
        """Forgets all; the count stays."""
        self._expected = self._names
        self._held: dict[str, tuple[int, T]] = {}
        self._together: frozenset[str] = frozenset()  # in the last cycle
        self._last = self._newest = 0  # oldest and newest stamp of the last cycle

    def put(self, name: str, stamp: int, value: T) -> list[tuple[int, dict[str, T]]]:
        """Takes what one cable brings at `stamp` [ns]; the cycles that it completes: oldest stamp, name -> value."""
        ready = []
        if name in self._held:
            ready.append(self._release())
        elif self._held and name in self._together and self._stragglers(stamp):
            together = self._together
            ready.append(self._release())
            self._expected |= together
        if stamp < self._last:
            self.late += 1
            return ready
        self._held[name] = (stamp, value)
        if self._held.keys() >= self._expected:
            ready.append(self._release())
        return ready

    def _stragglers(self, stamp: int) -> bool:
        """Whether all that is held came back too late for the last cycle, and is nearer to it than to `stamp`."""
        newest = max(held for held, _ in self._held.values())
        return self._together.isdisjoint(self._held) and stamp - newest > newest - self._newest

    def _release(self) -> tuple[int, dict[str, T]]:
        held, self._held = self._held, {}
        self._expected = self._together = frozenset(held)
        stamps = [stamp for stamp, _ in held.values()]
        self._last, self._newest = min(stamps), max(stamps)
        return self._last, {name: value for name, (_, value) in held.items()}
