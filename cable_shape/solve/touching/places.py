"""Where cables overlap or come past each other: :class:`Places`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np

from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.distance import apart, cable_near, passing
from cable_shape.pose import FreeEnd
from cable_shape.shape import CableShape
from cable_shape.solve.problem import CLIP_SPACING, Problem

_TIP = 1.0  #: diameters: nearer to a free end another cable slips off
MOUTH = 0.3  #: of the distance to be kept, from a grip to where a cable may be touched at least
DEEPEST = 1e-4  #: [m] cables that overlap by more than this between their points touch
SHORTEST = math.pi  #: diameters of cable between two points of it that may touch
_PARALLEL = math.cos(math.radians(4.0))  #: cables that cross at a smaller angle lie along each other
_ASIDE = 2.0  #: of the distance to be kept: a place nearer to a contact along both cables is that contact
_APART = 0.05  #: of the distance to be kept: nearer points tell no direction in which to part
_CLOSE = 2.0  #: of the distance to be kept: cables that are seen nearer touch, or may
_MOST_LOOKS = 40  #: at shapes between two
_OFF = 2.0  #: of the distance to be kept: so near to an end a cable may slip off the other one

Pair = tuple[int, int]
Line = tuple[Array, Array]  #: arc lengths (n,) and places (n, 3) of a centreline


@final
@dataclass(slots=True, eq=False)
class Spot:
    """Two points that touch, or nearly: on cables `a` and `b`, which may be one.

    arcs (2,) [m]; places (2, 3) [m]; press [N], 0 where they do not touch; reach [m]: least distance of the
    centrelines; before (2,) [m]: the arc lengths in the last equilibrium that was accepted; hand: how the cables cross,
    of the sign of n . (t_a x t_b) between tangents t, which changes as they come through each other.
    """

    cables: Pair
    arcs: Array
    places: Array
    reach: float
    before: Array
    press: float = 0.0
    hand: float = 0.0

    @property
    def distance(self) -> float:
        """[m], of the centrelines."""
        return float(np.linalg.norm(self.places[0] - self.places[1]))

    @property
    def normal(self) -> Array:
        """(3,), unit, out of the second cable."""
        return np.asarray((self.places[0] - self.places[1]) / self.distance)

    def copy(self) -> Spot:
        """Once more, arrays and all."""
        return Spot(self.cables, self.arcs.copy(), self.places.copy(), self.reach, self.before, self.press, self.hand)


@final
class Places:
    """Looks for places where some cables, with these names, touch; `known` are contacts to leave out.

    down (3,): unit, where weight pulls. culled: how many pairs, those of a cable with itself included, bounds ruled out
    when missed places were last looked for; cull: whether they may.
    """

    def __init__(self, names: Sequence[str], problems: list[Problem]) -> None:
        self._names = tuple(names)
        self._problems = problems
        self._diameters = [widest(problem.cable) for problem in problems]
        down = problems[0].gravity if problems[0].gravity.any() else np.array((0.0, 0.0, -1.0))
        self.down: Array = down / np.linalg.norm(down)
        count = len(problems)
        self._pairs: list[Pair] = [(a, b) for a in range(count) for b in range(a, count)]
        self.culled, self.cull = 0, True
        self._out = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))

    def reach(self, pair: Pair) -> float:
        """[m], least distance of two centrelines."""
        return 0.5 * (self._diameters[pair[0]] + self._diameters[pair[1]])

    def overlaps(self, shapes: list[CableShape], known: Sequence[Spot] = ()) -> list[Spot]:
        """Where the shapes overlap."""
        found: list[Spot] = []
        for pair in self._pairs:
            a, b = shapes[pair[0]], shapes[pair[1]]
            found += self._spots(pair, a, b, a.positions, b.positions, self.reach(pair) - DEEPEST, known)
        return found

    def close(self, shapes: Sequence[CableShape]) -> list[Spot]:
        """Where the shapes overlap, or touch but for an inexact look at them."""
        found: list[Spot] = []
        for pair in self._pairs:
            a, b = shapes[pair[0]], shapes[pair[1]]
            found += self._spots(pair, a, b, a.positions, b.positions, _CLOSE * self.reach(pair), ())
        return found

    def involved(self, shapes: list[CableShape]) -> set[int]:
        """The cables that overlap another one or themselves."""
        return {cable for spot in self.overlaps(shapes) for cable in spot.cables}

    def near(self, shapes: list[CableShape], before: list[CableShape]) -> list[Pair]:
        """The pairs that bounds do not rule out to have touched since the shapes before."""
        pairs = [pair for pair in self._pairs if not self._far(pair, shapes, before)]
        self.culled = len(self._pairs) - len(pairs)
        return pairs

    def missed(self, shapes: list[CableShape], before: list[CableShape], known: Sequence[Spot]) -> list[Spot] | None:
        """Where the shapes overlap, or have come past each other since those before: as it was before.

        Looked for in shapes between the two; what is seen in none of them, in how cables come through each other. None:
        it cannot be told, as a known contact was lost there, or the cables were nowhere near each other.
        """
        found: list[Spot] = []
        pairs = self.near(shapes, before)
        for pair in pairs:
            way = sum(float(np.linalg.norm(shapes[i].positions - before[i].positions, axis=1).max()) for i in pair)
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
                if near is None:
                    return None
                if not any(near is other for other in found):
                    found.append(near)
        through = (self._through(pair, shapes, before) for pair in pairs)
        return found or [place for place in through if place is not None]

    def gone_through(self, shapes: list[CableShape], before: list[CableShape]) -> set[int]:
        """The cables that must have gone through another one, or themselves, since the shapes before."""
        pairs = self.near(shapes, before)
        return {cable for pair in pairs if self._through(pair, shapes, before) is not None for cable in pair}

    def _through(self, pair: Pair, shapes: list[CableShape], before: list[CableShape]) -> Spot | None:
        """Where the cables of a pair first came through each other, as it was before; None if they need not have."""
        reach, lines = self.reach(pair), [(before[i].arc_length, before[i].positions) for i in pair]
        rows = came_through(lines, [shapes[i].positions for i in pair], reach, own=pair[0] == pair[1])
        if not len(rows):
            return None
        arcs = rows[rows[:, 0].argmin(), 2:]
        places = [[np.interp(arc, s, c) for c in p.T] for arc, (s, p) in zip(arcs, lines, strict=True)]
        return Spot(pair, arcs.copy(), np.array(places), reach, arcs.copy())

    def crowded(self, spots: Sequence[Spot]) -> str:
        """Which cable is touched too near to what holds it, or twice in one place, in words; empty if none is."""
        for cable, problem in enumerate(self._problems):
            own = [float(arc) for spot in spots for arc, i in zip(spot.arcs, spot.cables, strict=True) if i == cable]
            length = problem.cable.length
            held = sorted([0.0, *(clip.arc_length for clip in problem.clips), length, *own])
            slips = isinstance(problem.end, FreeEnd) and own and length - max(own) < _TIP * self._diameters[cable]
            if own and (slips or min(b - a for a, b in pairwise(held)) < CLIP_SPACING * length):
                where = "at a grip, at a clip or by two others in one place"
                return f"cable {self._names[cable]!r} is touched {where}, which is not solved for. "
        return ""

    def _far(self, pair: Pair, shapes: list[CableShape], before: list[CableShape]) -> bool:
        """Whether bounds tell that two cables, or one and itself, have not touched from one shape to the next."""
        (a, b), cull = pair, self.cull
        p, p_then, reach = shapes[a].positions, before[a].positions, self.reach(pair)
        if a == b:
            arcs, shortest = shapes[a].arc_length, SHORTEST * self._diameters[a]
            return cull and bool(apart.apart_from_itself(p, arcs, p_then, shortest, reach, 0.25 * reach))
        return cull and bool(apart.boxes_apart(p, p_then, shapes[b].positions, before[b].positions, reach))

    def part(self, spot: Spot, shapes: Sequence[CableShape]) -> None:
        """Puts two points that are all but one a little apart, across both cables, the second one above."""
        least = _APART * self.reach(spot.cables)
        if spot.distance >= least:
            return
        t, u = (self._tangent(shapes[cable], arc) for cable, arc in zip(spot.cables, spot.arcs, strict=True))
        across = np.cross(t, u)
        size = float(np.linalg.norm(across))
        normal = across / size if size > 0.0 else np.array((0.0, 0.0, 1.0))
        if float(normal @ self.down) < 0.0:
            normal = -normal
        middle = spot.places.mean(axis=0)
        spot.places = np.array((middle + 0.5 * least * normal, middle - 0.5 * least * normal))

    @staticmethod
    def _tangent(shape: CableShape, arc: float) -> Array:
        """(3,), of a shape at an arc length."""
        return np.asarray(shape.tangents[np.abs(shape.arc_length - arc).argmin()])

    def along_each_other(self, shapes: Sequence[CableShape], spots: Sequence[Spot]) -> str:
        """Which cables do not cross at these places but lie along each other, in words; empty if none do."""
        for spot in spots:
            t, u = (self._tangent(shapes[cable], arc) for cable, arc in zip(spot.cables, spot.arcs, strict=True))
            if abs(float(t @ u)) > _PARALLEL:
                first, second = (self._names[cable] for cable in spot.cables)
                who = f"cables {first!r} and {second!r} lie" if first != second else f"cable {first!r} lies"
                what = "each other" if first != second else "itself"
                return f"{who} along {what} at {spot.arcs[0]:.3f} m, which is not solved for. "
        return ""

    def _spots(
        self, pair: Pair, a: CableShape, b: CableShape, p: Array, r: Array, reach: float, known: Sequence[Spot]
    ) -> list[Spot]:
        """Where two centrelines p, r (n, 3) of the shapes a and b are within `reach` of each other."""
        own, aside = pair[0] == pair[1], _ASIDE * self.reach(pair)
        shortest = SHORTEST * self._diameters[pair[0]]
        count = cable_near.spots(p, a.arc_length, r, b.arc_length, own, shortest, reach, aside, self._out)
        rows = self._out[:count].copy()
        for row in rows:
            self._keep_off_mouths(row, pair, ((a, p), (b, r)))
        found = [
            Spot(pair, row[1:3], row[3:9].reshape(2, 3), self.reach(pair), row[1:3].copy())
            for row in rows
            if not any(_slopes_to(row, other, a, b, p, r) for other in rows)
        ]
        return [spot for spot in found if not any(_same(spot, other, aside) for other in known)]

    def _keep_off_mouths(self, row: Array, pair: Pair, lines: tuple[tuple[CableShape, Array], ...]) -> None:
        """Puts a place next to a grip at its mouth: there the knot of a pair stops."""
        off = MOUTH * self.reach(pair)
        for side, (shape, line) in enumerate(lines):
            arc = min(max(row[1 + side], off), shape.length - off)
            if arc != row[1 + side]:
                row[1 + side] = arc
                row[3 + 3 * side : 6 + 3 * side] = [np.interp(arc, shape.arc_length, c) for c in line.T]


def _slopes_to(row: Array, other: Array, a: CableShape, b: CableShape, p: Array, r: Array) -> bool:
    """Whether a place is but the flank of a nearer one: halfway between them the cables are nearer, too."""
    if not other[0] < row[0]:
        return False
    s, t = 0.5 * (row[1:3] + other[1:3])
    halfway = [np.interp(s, a.arc_length, p[:, i]) - np.interp(t, b.arc_length, r[:, i]) for i in range(3)]
    return float(np.linalg.norm(halfway)) < float(row[0])


def _same(spot: Spot, known: Spot, aside: float) -> bool:
    """Whether a place is a contact, or where one has been since the last equilibrium."""
    return known.cables == spot.cables and _beside(spot.arcs, known, aside)


def _beside(arcs: Array, known: Spot, aside: float) -> bool:
    """Whether arc lengths (2,) are where a contact is, or has been since the last equilibrium."""
    low, high = np.minimum(known.arcs, known.before) - aside, np.maximum(known.arcs, known.before) + aside
    return bool((low < arcs).all() and (arcs < high).all())


def came_through(lines: Sequence[Line], now: Sequence[Array], reach: float, *, own: bool) -> Array:
    """(k, 4): where one of two centrelines must have gone through the other, or itself, from `lines` to places `now`.

    Rows are those of `kernels.distance.passing`, with arc lengths [m] in place of pieces, of the sign of their sum. Off
    an end a cable may slip, and none are left where they go through each other and back: then another way leads there.
    How often one goes through itself tells nothing: there all count. reach [m]: least distance of the centrelines.
    """
    (s, p), (u, r) = lines
    out = np.empty((passing.MOST_CROSSINGS, passing.CROSSING))
    apart = math.ceil(SHORTEST * reach / float(s[1] - s[0])) if own else 0
    rows = out[: passing.crossings(p, now[0], r, now[1], apart, out)]
    for side, arcs in ((2, s), (3, u)):
        rows[:, side] = np.interp(rows[:, side], np.arange(arcs.size), arcs)
    off = _OFF * reach
    inner = rows[((rows[:, 2:] > off) & (rows[:, 2:] < (s[-1] - off, u[-1] - off))).all(axis=1)]
    through = inner if own else inner[inner[:, 1] * inner[:, 1].sum() > 0.0]
    whole = len(rows) < len(out)  # else there may be more, and what they add up to is not known
    return through if whole or len(through) else inner


def at_an_end(spot: Spot, problems: Sequence[Problem]) -> bool:
    """Whether a place is at an end of one of its cables."""
    lengths = (problems[cable].cable.length for cable in spot.cables)
    return any(min(arc, length - arc) < _OFF * spot.reach for arc, length in zip(spot.arcs, lengths, strict=True))


def overlaps_at(spot: Spot, lines: Sequence[Line], least: float) -> Array:
    """(k, SPOT), see `cable_near`: where two centrelines are too near to each other beside a contact.

    least [m]: cable between two points of one cable that may touch.
    """
    (s, p), (u, r) = lines
    own, aside = spot.cables[0] == spot.cables[1], _ASIDE * spot.reach
    rows = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))
    count = cable_near.spots(p, s, r, u, own, least, spot.reach - DEEPEST, aside, rows)
    return rows[[k for k in range(count) if _beside(rows[k, 1:3], spot, aside)]]


def hand_of(spot: Spot, lines: Sequence[Line]) -> float:
    """How cables with these centrelines cross at a contact, see `Spot`."""
    pieces = []
    for (arcs, points), arc in zip(lines, spot.arcs, strict=True):
        k = min(max(int(np.searchsorted(arcs, arc)), 1), len(arcs) - 1)
        pieces.append(points[k] - points[k - 1])
    return float((spot.places[0] - spot.places[1]) @ np.cross(*pieces))
