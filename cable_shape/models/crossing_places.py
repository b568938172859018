"""Where cables overlap or come past each other: :class:`Places`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import cable_near
from cable_shape.models.crossing_step import Spot
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

DEEPEST = 1e-4  #: [m] cables that overlap by more than this between their points touch
SHORTEST = math.pi  #: diameters of cable between two points of it that may touch
_PARALLEL = math.cos(math.radians(15.0))  #: cables that cross at a smaller angle lie along each other
_ASIDE = 2.0  #: of the distance to be kept: a place nearer to a contact along both cables is that contact
_MOST_LOOKS = 40  #: at shapes between two

Pair = tuple[int, int]


@final
class Places:
    """Looks for places where some cables, with these names, touch; `known` are contacts to leave out."""

    def __init__(self, names: Sequence[str], problems: list[Problem]) -> None:
        self._names = tuple(names)
        self._diameters = [problem.cable.diameter for problem in problems]
        self._out = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))

    def reach(self, pair: Pair) -> float:
        """[m], least distance of two centrelines."""
        return 0.5 * (self._diameters[pair[0]] + self._diameters[pair[1]])

    def overlaps(self, shapes: list[CableShape], known: Sequence[Spot] = ()) -> list[Spot]:
        """Where the shapes overlap."""
        found: list[Spot] = []
        for pair in self._pairs():
            a, b = shapes[pair[0]], shapes[pair[1]]
            found += self._spots(pair, a, b, a.positions, b.positions, self.reach(pair) - DEEPEST, known)
        return found

    def involved(self, shapes: list[CableShape]) -> set[int]:
        """The cables that overlap another one or themselves."""
        return {cable for spot in self.overlaps(shapes) for cable in spot.cables}

    def missed(self, shapes: list[CableShape], before: list[CableShape], known: Sequence[Spot]) -> list[Spot]:
        """Where the shapes overlap, or have come past each other since those before: as it was before."""
        found: list[Spot] = []
        moved = [
            float(np.linalg.norm(now.positions - then.positions, axis=1).max())
            for now, then in zip(shapes, before, strict=True)
        ]
        for pair in self._pairs():
            way = moved[pair[0]] + moved[pair[1]]
            looks = min(_MOST_LOOKS, 1 + math.floor(2.0 * way / self.reach(pair)))
            (a, later_a), (b, later_b) = ((before[i], shapes[i]) for i in pair)
            now: list[Spot] = []
            for k in range(1, looks + 1):
                x = k / looks
                p = a.positions + x * (later_a.positions - a.positions)
                r = b.positions + x * (later_b.positions - b.positions)
                now = self._spots(pair, a, b, p, r, self.reach(pair) - DEEPEST, known)
                if now:
                    break
            if not now:
                continue
            then = self._spots(pair, a, b, a.positions, b.positions, self.reach(pair) + way, known)
            for spot in now:
                near = min(then, key=lambda s: float(np.abs(s.arcs - spot.arcs).sum()), default=None)
                if near is not None and not any(near is other for other in found):
                    found.append(near)
        return found

    def along_each_other(self, shapes: list[CableShape], spots: Sequence[Spot]) -> str:
        """Which cables do not cross at these places but lie along each other, in words; empty if none do."""
        for spot in spots:
            t, u = (
                shapes[cable].tangents[np.abs(shapes[cable].arc_length - arc).argmin()]
                for cable, arc in zip(spot.cables, spot.arcs, strict=True)
            )
            if abs(float(t @ u)) > _PARALLEL:
                first, second = (self._names[cable] for cable in spot.cables)
                who = f"cables {first!r} and {second!r} lie" if first != second else f"cable {first!r} lies"
                what = "each other" if first != second else "itself"
                return f"{who} along {what} at {spot.arcs[0]:.3f} m, which is not solved for. "
        return ""

    def _pairs(self) -> list[Pair]:
        count = len(self._diameters)
        return [(a, b) for a in range(count) for b in range(a, count)]

    def _spots(
        self, pair: Pair, a: CableShape, b: CableShape, p: Array, r: Array, reach: float, known: Sequence[Spot]
    ) -> list[Spot]:
        """Where two centrelines p, r (n, 3) of the shapes a and b are within `reach` of each other."""
        own, aside = pair[0] == pair[1], _ASIDE * self.reach(pair)
        shortest = SHORTEST * self._diameters[pair[0]]
        count = cable_near.spots(p, a.arc_length, r, b.arc_length, own, shortest, reach, aside, self._out)
        rows = self._out[:count].copy()
        found = [Spot(pair, row[1:3], row[3:9].reshape(2, 3), self.reach(pair), row[1:3].copy()) for row in rows]
        return [spot for spot in found if not any(_same(spot, other, aside) for other in known)]


def _same(spot: Spot, known: Spot, aside: float) -> bool:
    """Whether a place is a contact, or where one has been since the last equilibrium."""
    low, high = np.minimum(known.arcs, known.before) - aside, np.maximum(known.arcs, known.before) + aside
    return known.cables == spot.cables and bool((low < spot.arcs).all() and (spot.arcs < high).all())
