"""The newest pairs of several cables for one cycle: :class:`Gathering`. Knows no ROS."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, TypeVar, final

T = TypeVar("T")


@final
class Gathering(Generic[T]):
    """Waits for the cables that came together last time, but for none whose neighbour comes a second time.

    Cables of one tracker so share a cycle; one that falls silent is waited for once, one that comes back joins again.

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
        self._last = 0

    def put(self, name: str, stamp: int, value: T) -> list[tuple[int, dict[str, T]]]:
        """Takes what one cable brings at `stamp` [ns]; the cycles that it completes: oldest stamp, name -> value."""
        ready = [self._release()] if name in self._held else []
        if stamp < self._last:
            self.late += 1
            return ready
        self._held[name] = (stamp, value)
        if self._held.keys() >= self._expected:
            ready.append(self._release())
        return ready

    def _release(self) -> tuple[int, dict[str, T]]:
        held, self._held = self._held, {}
        self._expected = frozenset(held)
        self._last = min(stamp for stamp, _ in held.values())
        return self._last, {name: value for name, (_, value) in held.items()}
