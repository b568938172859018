"""Where cables overlap or come past each other: :class:`Places`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
#: Second derivatives of the distance by both arc lengths, times the distance, of which the determinant is smaller are
#: those of cables that lie along each other (crossing at 4 degrees, straight), larger of others (7).
_ALONG, _ACROSS = 0.005, 0.015
_PARALLEL = math.cos(math.radians(4.0))
_STEEP = math.cos(math.radians(40.0))  #: so many degrees apart they cross, however they bend
_ASIDE = 2.0  #: of the distance to be kept: a place nearer to a contact along both cables is that contact
_ROW = 1.0  #: the same of cables that lie along each other, where such contacts are in a row
_LOOP = 2.0 * SHORTEST  #: the same: cable between two points that lie along each other, of one cable
_SLOPE = 0.2  #: cosine: a place in such a row is where the second cable is square to the way to the first
_END = 5.0  #: the same: so near to such a row there is no other contact
_NEAR, _NEAR_LINE = 2.0, 1.2  #: of it: contacts that are lost stay contacts up to there, in rows
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
    of the sign of n . (t_a x t_b) between tangents t, which changes as they come through each other. stays: they lie
    along each other, and the first point stays where it is along its cable: rows of such stand for contact on a line.
    """

    cables: Pair
    arcs: Array
    places: Array
    reach: float
    before: Array
    press: float = 0.0
    hand: float = 0.0
    stays: bool = False

    @property
    def distance(self) -> float:
        """[m], of the centrelines."""
        return float(np.linalg.norm(self.places[0] - self.places[1]))

    @property
    def near(self) -> float:
        """Of the distance to be kept: so near they are watched though they do not press on each other."""
        return _NEAR_LINE if self.stays else _NEAR

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
        self.pairs: list[Pair] = [(a, b) for a in range(count) for b in range(a, count)]
        self.culled, self.cull = 0, True
        self._out = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))

    def reach(self, pair: Pair) -> float:
        """[m], least distance of two centrelines."""
        return 0.5 * (self._diameters[pair[0]] + self._diameters[pair[1]])

    def overlaps(self, shapes: list[CableShape], known: Sequence[Spot] = ()) -> list[Spot]:
        """Where the shapes overlap."""
        found: list[Spot] = []
        for pair in self.pairs:
            a, b = shapes[pair[0]], shapes[pair[1]]
            found += self._spots(pair, a, b, a.positions, b.positions, self.reach(pair) - DEEPEST, known)
        return found

    def close(self, shapes: Sequence[CableShape]) -> list[Spot]:
        """Where the shapes overlap, or touch but for an inexact look at them."""
        found: list[Spot] = []
        for pair in self.pairs:
            a, b = shapes[pair[0]], shapes[pair[1]]
            found += self._spots(pair, a, b, a.positions, b.positions, _CLOSE * self.reach(pair), ())
        return found

    def involved(self, shapes: list[CableShape]) -> set[int]:
        """The cables that overlap another one or themselves."""
        return {cable for spot in self.overlaps(shapes) for cable in spot.cables}

    def near(self, shapes: list[CableShape], before: list[CableShape]) -> list[Pair]:
        """The pairs that bounds do not rule out to have touched since the shapes before."""
        pairs = [pair for pair in self.pairs if not self._far(pair, shapes, before)]
        self.culled = len(self.pairs) - len(pairs)
        return pairs

    def missed(self, shapes: list[CableShape], before: list[CableShape], known: Sequence[Spot]) -> list[Spot] | None:
        """Where the shapes overlap, or have come past each other since those before: as it was before.

        Looked for in shapes between the two; what is seen in none of them, in how cables come through each other. None:
        it cannot be told, as a known contact was lost there, or the cables were nowhere near each other, or only
        further along than they have gone.
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
            found += [
                _moved_to(spot, [(a.arc_length, a.positions), (b.arc_length, b.positions)])
                for spot in now
                if spot.stays
            ]
            now = [spot for spot in now if not spot.stays]
            then = self._spots(pair, a, b, a.positions, b.positions, self.reach(pair) + way, known) if now else []
            for spot in now:
                near = min(then, key=lambda s: float(np.abs(s.arcs - spot.arcs).sum()), default=None)
                if near is None:
                    return None
                if pair[0] != pair[1] and float(np.abs(near.arcs - spot.arcs).sum()) > way + self.reach(pair):
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
        return _moved_to(Spot(pair, arcs.copy(), np.empty((2, 3)), reach, arcs.copy()), lines)

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
        least = cable_near.APART * self.reach(spot.cables)
        if spot.distance >= least:
            return
        t, u = (
            shapes[cable].tangents[np.abs(shapes[cable].arc_length - arc).argmin()]
            for cable, arc in zip(spot.cables, spot.arcs, strict=True)
        )
        across = np.cross(t, u)
        size = float(np.linalg.norm(across))
        normal = across / size if size > 0.0 else np.array((0.0, 0.0, 1.0))
        if float(normal @ self.down) < 0.0:
            normal = -normal
        middle = spot.places.mean(axis=0)
        spot.places = np.array((middle + 0.5 * least * normal, middle - 0.5 * least * normal))

    def tell_lines(self, spots: Sequence[Spot], shapes: Mapping[int, CableShape], known: Sequence[Spot] = ()) -> bool:
        """Tells which of these places belong to cables that lie along each other there; whether any is told otherwise.

        Of a place that was one the other way round a little more is asked. So do those next to them, or to `known`
        ones, and none where the cables are far from each other, or one turns back onto itself; nor one that has no
        other beside it, unless they are all but parallel there.
        """
        before = [spot.stays for spot in spots]
        found = [self._alongside(spot, shapes) for spot in spots]
        may = [
            abs(cosine) > _STEEP and spot.distance < _NEAR * spot.reach and not spot.turns_back
            for spot, (cosine, _, _) in zip(spots, found, strict=True)
        ]
        for spot, flat, (_, _, det) in zip(spots, may, found, strict=True):
            spot.stays = flat and det < (_ACROSS if spot.stays else _ALONG)
        rows = [spot for spot in (*spots, *known) if spot.stays]
        for spot, flat, (cosine, _, _) in zip(spots, may, found, strict=True):
            beside = any(_next_to(spot, other) for other in rows if other is not spot)
            spot.stays = (flat and beside) or (spot.stays and abs(cosine) > _PARALLEL)
        return before != [spot.stays for spot in spots]

    @staticmethod
    def _alongside(spot: Spot, shapes: Mapping[int, CableShape]) -> tuple[float, float, float]:
        """As `cable_near.alongside` has it."""
        a, b = (shapes[cable] for cable in spot.cables)
        row = np.concatenate(([spot.distance], spot.arcs, spot.places.ravel()))
        found: tuple[float, float, float] = cable_near.alongside(
            a.positions, a.arc_length, b.positions, b.arc_length, row, spot.reach
        )
        return found

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
        found = [Spot(pair, row[1:3], row[3:9].reshape(2, 3), self.reach(pair), row[1:3].copy()) for row in rows]
        self.tell_lines(found, {pair[0]: a, pair[1]: b}, known)
        places = [
            spot
            for spot, row in zip(found, rows, strict=True)
            if (spot.stays and abs(self._alongside(spot, {pair[0]: a, pair[1]: b})[1]) < _SLOPE)
            or not any(_slopes_to(row, other, a, b, p, r) for other in rows)
        ]
        return [spot for spot in places if not any(_same(spot, other) for other in known)]

    def _keep_off_mouths(self, row: Array, pair: Pair, lines: tuple[tuple[CableShape, Array], ...]) -> None:
        """Puts a place next to a grip at its mouth: there the knot of a pair stops."""
        off = MOUTH * self.reach(pair)
        for side, (shape, line) in enumerate(lines):
            arc = min(max(row[1 + side], off), shape.length - off)
            if arc != row[1 + side]:
                row[1 + side] = arc
                row[3 + 3 * side : 6 + 3 * side] = [np.interp(arc, shape.arc_length, c) for c in line.T]


def _moved_to(spot: Spot, lines: Sequence[Line]) -> Spot:
    """The place where two centrelines have it."""
    places = [[np.interp(arc, s, c) for c in p.T] for arc, (s, p) in zip(spot.arcs, lines, strict=True)]
    return replace(spot, places=np.array(places))


def ordered(spots: Sequence[Spot]) -> list[Spot]:
    """The places pair by pair and along the first cable: next to each other are what lies along each other."""
    return sorted(spots, key=lambda spot: (spot.cables, float(spot.arcs[0])))


def _slopes_to(row: Array, other: Array, a: CableShape, b: CableShape, p: Array, r: Array) -> bool:
    """Whether a place is but the flank of a nearer one: halfway between them the cables are nearer, too."""
    if not other[0] < row[0]:
        return False
    s, t = 0.5 * (row[1:3] + other[1:3])
    halfway = [np.interp(s, a.arc_length, p[:, i]) - np.interp(t, b.arc_length, r[:, i]) for i in range(3)]
    return float(np.linalg.norm(halfway)) < float(row[0])


def _next_to(spot: Spot, other: Spot) -> bool:
    """Whether two places may belong to one row."""
    return spot.cables == other.cables and bool(np.abs(other.arcs - spot.arcs).max() < _END * spot.reach)


def _same(spot: Spot, known: Spot) -> bool:
    """Whether a place is a contact, or where one has been since the last equilibrium."""
    return known.cables == spot.cables and _beside(spot.arcs, known)


def _beside(arcs: Array, known: Spot) -> bool:
    """Whether arc lengths (2,) are where a contact is, or has been since the last equilibrium."""
    aside = (_ROW if known.stays else _ASIDE) * known.reach
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
    own, aside = spot.cables[0] == spot.cables[1], (_ROW if spot.stays else _ASIDE) * spot.reach
    rows = np.empty((cable_near.MOST_SPOTS, cable_near.SPOT))
    count = cable_near.spots(p, s, r, u, own, least, spot.reach - DEEPEST, aside, rows)
    return rows[[k for k in range(count) if _beside(rows[k, 1:3], spot)]]


def overlap_of(spot: Spot, lines: Sequence[Line]) -> float:
    """[m], by how much two centrelines of a pair overlap at most, wherever; a cable with itself at a distance."""
    (s, p), (u, r) = lines
    found, own = np.empty((1, cable_near.SPOT)), spot.cables[0] == spot.cables[1]
    counts = np.zeros(2, dtype=np.int64)
    near = cable_near.nearest(p, s, r, u, own, _LOOP * spot.reach, spot.reach, True, found[0], counts, counts)
    return float(spot.reach - found[0, 0]) if near else 0.0


def hand_of(spot: Spot, lines: Sequence[Line]) -> float:
    """How cables with these centrelines cross at a contact, see `Spot`."""
    pieces = []
    for (arcs, points), arc in zip(lines, spot.arcs, strict=True):
        k = min(max(int(np.searchsorted(arcs, arc)), 1), len(arcs) - 1)
        pieces.append(points[k] - points[k - 1])
    return float((spot.places[0] - spot.places[1]) @ np.cross(*pieces))
