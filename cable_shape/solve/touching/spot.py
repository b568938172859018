"""A place where cables touch, or nearly do: :class:`Spot`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels.distance import cable_near

DEEPEST = 1e-4  #: [m] cables that overlap by more than this between their points touch
SHORTEST = math.pi  #: diameters of cable between two points of it that may touch
ASIDE = 2.0  #: of the distance to be kept: a place nearer to a contact along both cables is that contact
_ROW = 1.0  #: the same of cables that lie along each other, where such contacts are in a row
_LOOP = 2.0 * SHORTEST  #: the same: cable between two points that lie along each other, of one cable
_END = 5.0  #: the same: so near to such a row there is no other contact
NEAR, _NEAR_LINE = 2.0, 1.2  #: of it: contacts that are lost stay contacts up to there, in rows
OFF = 2.0  #: of the distance to be kept: so near to an end a cable may slip off the other one

Pair = tuple[int, int]
Line = tuple[Array, Array]  #: arc lengths (n,) and places (n, 3) of a centreline


@final
@dataclass(slots=True, eq=False)
class Spot:
    """Two points that touch, or nearly: on cables `a` and `b`, which may be one.

    arcs (2,) [m]; places (2, 3) [m]; press [N], 0 where they do not touch; reach [m]: least distance of the
    centrelines; before (2,) [m]: the arc lengths in the last equilibrium that was accepted; hand: how the cables cross,
    of the sign of n . (t_a x t_b) between tangents t, which changes as they come through each other. stays: they lie
    along each other, and the first point stays where it is along its cable: rows of such stand for contact on a line.
    pull (3,) [N]: friction on the first cable; slips: it is what can be held.
    """

    cables: Pair
    arcs: Array
    places: Array
    reach: float
    before: Array
    press: float = 0.0
    hand: float = 0.0
    stays: bool = False
    pull: Array = field(default_factory=lambda: np.zeros(3))
    slips: bool = False

    @property
    def distance(self) -> float:
        """[m], of the centrelines."""
        return float(np.linalg.norm(self.places[0] - self.places[1]))

    @property
    def near(self) -> float:
        """Of the distance to be kept: so near they are watched though they do not press on each other."""
        return _NEAR_LINE if self.stays else NEAR

    @property
    def turns_back(self) -> bool:
        """Whether there is so little between two points of one cable that it cannot come to lie along itself there."""
        return self.cables[0] == self.cables[1] and abs(float(self.arcs[1] - self.arcs[0])) < _LOOP * self.reach

    @property
    def normal(self) -> Array:
        """(3,), unit, out of the second cable."""
        return np.asarray((self.places[0] - self.places[1]) / self.distance)

    def copy(self) -> Spot:
        """Once more, arrays and all."""
        return replace(self, arcs=self.arcs.copy(), places=self.places.copy())


def at_an_end(spot: Spot, cables: Sequence[Cable]) -> bool:
    """Whether a place is at an end of one of its cables."""
    lengths = (cables[cable].length for cable in spot.cables)
    return any(min(arc, length - arc) < OFF * spot.reach for arc, length in zip(spot.arcs, lengths, strict=True))


def overlaps_at(spot: Spot, lines: Sequence[Line], least: float, joined: Array) -> Array:
    """(k, SPOT), see `cable_near`: where two centrelines are too near to each other beside a contact.

    least [m]: cable between two points of one cable that may touch; joined (2, 2): see `Strands.joined`.
    """
    (s, p), (u, r) = lines
    own, aside = spot.cables[0] == spot.cables[1], (_ROW if spot.stays else ASIDE) * spot.reach
    rows = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))
    count = cable_near.spots(p, s, r, u, own, least, joined, spot.reach - DEEPEST, aside, rows)
    return rows[[k for k in range(count) if _beside(rows[k, 1:3], spot)]]


def overlap_of(spot: Spot, lines: Sequence[Line]) -> float:
    """[m], by how much two centrelines of a pair overlap at most, wherever; a cable with itself at a distance."""
    (s, p), (u, r) = lines
    found, own = np.empty((1, cable_near.SPOT)), spot.cables[0] == spot.cables[1]
    counts = np.zeros(2, dtype=np.int64)
    near = cable_near.nearest(p, s, r, u, own, _LOOP * spot.reach, spot.reach, True, found[0], counts, counts)
    return float(spot.reach - found[0, 0]) if near else 0.0


def moved_to(spot: Spot, lines: Sequence[Line]) -> Spot:
    """The place where two centrelines have it."""
    places = [[np.interp(arc, s, c) for c in p.T] for arc, (s, p) in zip(spot.arcs, lines, strict=True)]
    return replace(spot, places=np.array(places))


def ordered(spots: Sequence[Spot]) -> list[Spot]:
    """The places pair by pair and along the first cable: next to each other are what lies along each other."""
    return sorted(spots, key=lambda spot: (spot.cables, float(spot.arcs[0])))


def apart_from_each_other(spots: Sequence[Spot]) -> list[Spot]:
    """These without what does not press where another one, that runs along its cables as it does, has come to be."""
    runs = [spot for spot in spots if not spot.stays]
    gone = set()
    for i, spot in enumerate(runs):
        others = (other for j, other in enumerate(runs) if id(other) not in gone and (other.press > 0.0 or j < i))
        if spot.press == 0.0 and any(
            other is not spot
            and other.cables == spot.cables
            and np.abs(other.arcs - spot.arcs).max() < ASIDE * spot.reach
            for other in others
        ):
            gone.add(id(spot))
    return [spot for spot in spots if id(spot) not in gone]


def next_to(spot: Spot, other: Spot) -> bool:
    """Whether two places may belong to one row."""
    return spot.cables == other.cables and bool(np.abs(other.arcs - spot.arcs).max() < _END * spot.reach)


def same_place(spot: Spot, known: Spot) -> bool:
    """Whether a place is a contact, or where one has been since the last equilibrium."""
    return known.cables == spot.cables and _beside(spot.arcs, known)


def _beside(arcs: Array, known: Spot) -> bool:
    """Whether arc lengths (2,) are where a contact is, or has been since the last equilibrium."""
    aside = (_ROW if known.stays else ASIDE) * known.reach
    low, high = np.minimum(known.arcs, known.before) - aside, np.maximum(known.arcs, known.before) + aside
    return bool((low < arcs).all() and (arcs < high).all())


def hand_of(spot: Spot, lines: Sequence[Line]) -> float:
    """How cables with these centrelines cross at a contact, see `Spot`."""
    pieces = []
    for (arcs, points), arc in zip(lines, spot.arcs, strict=True):
        k = min(max(int(np.searchsorted(arcs, arc)), 1), len(arcs) - 1)
        pieces.append(points[k] - points[k - 1])
    return float((spot.places[0] - spot.places[1]) @ np.cross(*pieces))
