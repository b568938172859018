"""Whether ends of cables have gone round each other while nothing was known of their shapes: :class:`Rounds`."""

from __future__ import annotations

import math
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.solve.touching.spot import Pair

_TURN, _BACK = math.cos(math.radians(45.0)), math.cos(math.radians(30.0))
_NOWHERE = 1e-9  # m


@final
class Rounds:
    """The way of the ends since the last equilibrium, as directions from the ends of one cable to those of another.

    Each is put down that is more than 45 degrees off the one before; who comes back the same way takes it off again.
    With more than one beside the first, ends may be on their way round: how often cables then go through each other on
    the straight way from shape to shape does not tell whether they must (`kernels.distance.passing`).
    """

    def __init__(self, pairs: list[Pair]) -> None:
        self._pairs = [pair for pair in pairs if pair[0] != pair[1]]
        self._way: list[Array] = []

    def begin(self) -> None:
        """An equilibrium is known."""
        self._way = []

    def go(self, then: Array, now: Array) -> set[int]:
        """The cables whose ends are on the way round; frames (n, 7) of the last equilibrium, two a cable, and now."""
        if not self._pairs:
            return set()
        way = self._way or [self._directions(then)]
        here = self._directions(now)
        while len(way) > 1 and (_cosines(here, way[-2]) > _BACK).all():
            way.pop()
        if (_cosines(here, way[-1]) < _TURN).any():
            way.append(here)
        self._way = way
        if len(way) < 3:
            return set()
        off = np.min([_cosines(way[0], one) for one in way], axis=0).min(axis=1) < _TURN
        return {cable for pair, is_off in zip(self._pairs, off, strict=True) if is_off for cable in pair}

    def _directions(self, frames: Array) -> Array:
        """(pairs, 2, 3): from start to start and from end to end, unit or, where they are in one place, zero."""
        places = frames[:, :3]
        a, b = np.array(self._pairs).T
        ways = np.stack([places[2 * b + side] - places[2 * a + side] for side in range(2)], axis=1)
        sizes = np.linalg.norm(ways, axis=2, keepdims=True)
        return np.asarray(np.where(sizes > _NOWHERE, ways / np.maximum(sizes, _NOWHERE), 0.0))


def _cosines(one: Array, other: Array) -> Array:
    """(pairs, 2), of the angles between directions; 1 where one has none."""
    known = one.any(axis=2) & other.any(axis=2)
    return np.where(known, (one * other).sum(axis=2), 1.0)
