"""Where cables overlap or come past each other: :class:`Places`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from typing import Any, final

import numpy as np

from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.distance import apart, cable_near, passing
from cable_shape.shape import CableShape
from cable_shape.solve.problem import CLIP_SPACING
from cable_shape.solve.touching.spot import (
    ASIDE,
    DEEPEST,
    NEAR,
    OFF,
    SHORTEST,
    Line,
    Pair,
    Spot,
    moved_to,
    next_to,
    same_place,
)
from cable_shape.solve.touching.strands import Strands

_TIP = 1.0  #: diameters: nearer to a free end another cable slips off
MOUTH = 0.3  #: of the distance to be kept, from a grip to where a cable may be touched at least
#: Second derivatives of the distance by both arc lengths, times the distance, of which the determinant is smaller are
#: those of cables that lie along each other (crossing at 4 degrees, straight), larger of others (7).
_ALONG, _ACROSS = 0.005, 0.015
_PARALLEL = math.cos(math.radians(4.0))
_STEEP = math.cos(math.radians(40.0))  #: so many degrees apart they cross, however they bend
_LEVEL = 0.1  #: cosine: the same of both cables for any place, where they hang together
_SLOPE = 0.2  #: cosine: a place in such a row is where the second cable is square to the way to the first
_SIDES = ("start", "end")
_CLOSE = 2.0  #: of the distance to be kept: cables that are seen nearer touch, or may
_MOST_LOOKS = 40  #: at shapes between two


@final
class Places:
    """Looks for places where strands touch; `known` are contacts to leave out.

    down (3,): unit, where weight pulls. culled: how many pairs, those of a cable with itself included, bounds ruled out
    when missed places were last looked for; cull: whether they may.
    """

    def __init__(self, strands: Strands) -> None:
        self._strands = strands
        self._diameters = [widest(cable) for cable in strands.cables]
        down = strands.gravity if strands.gravity.any() else np.array((0.0, 0.0, -1.0))
        self.down: Array = down / np.linalg.norm(down)
        count = len(strands.cables)
        self.pairs: list[Pair] = [(a, b) for a in range(count) for b in range(a, count)]
        self._numbers: Any = np.array(self.pairs).T
        self._reaches = np.array([self.reach(pair) for pair in self.pairs])
        self._joined = {pair: strands.joined(pair) for pair in self.pairs}
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
        near = self.pairs
        if self.cull and len(shapes) > 1:
            boxes = np.empty((len(shapes), 6))
            for shape, then, box in zip(shapes, before, boxes, strict=True):
                apart.box(shape.positions, then.positions, box)
            a, b = self._numbers
            gaps = np.maximum(boxes[a, :3] - boxes[b, 3:], boxes[b, :3] - boxes[a, 3:]).max(axis=1)
            near = [self.pairs[i] for i in np.flatnonzero(gaps <= self._reaches).tolist()]
        pairs = [pair for pair in near if not self._far(pair, shapes, before)]
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
                moved_to(spot, [(a.arc_length, a.positions), (b.arc_length, b.positions)]) for spot in now if spot.stays
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
        now = [shapes[i].positions for i in pair]
        rows = came_through(lines, now, reach, self._joined[pair], own=pair[0] == pair[1])
        if not len(rows):
            return None
        arcs = rows[rows[:, 0].argmin(), 2:]
        return moved_to(Spot(pair, arcs.copy(), np.empty((2, 3)), reach, arcs.copy()), lines)

    def crowded(self, spots: Sequence[Spot]) -> str:
        """Which cable is touched too near to what holds it, or twice in one place, in words; empty if none is."""
        for cable, name in enumerate(self._strands.names):
            own = [float(arc) for spot in spots for arc, i in zip(spot.arcs, spot.cables, strict=True) if i == cable]
            if not own:
                continue
            length, tip = self._strands.cables[cable].length, _TIP * self._diameters[cable]
            held = sorted([0.0, *self._strands.held_at(cable), length, *own])
            start, end = self._strands.free(cable)
            slips = (start and min(own) < tip) or (end and length - max(own) < tip)
            if slips or min(b - a for a, b in pairwise(held)) < CLIP_SPACING * length:
                where = "at a grip, at a clip or by two others in one place"
                return f"cable {name!r} is touched {where}, which is not solved for. "
        return ""

    def held_inside(self, frames: Array) -> str:
        """Which cables grips hold inside each other, where frames (n, 7) are, in words; empty if none do."""
        ends = [(i, k) for i in range(len(self._strands.names)) for k in range(2) if self._strands.gripped(i)[k]]
        for (a, side), (b, other) in combinations(ends, 2):
            apart = float(np.linalg.norm(frames[2 * a + side, :3] - frames[2 * b + other, :3]))
            least = self.reach((a, b))
            if apart < least - DEEPEST and not self._joined[a, b][side, other]:
                one, two = (f"{self._strands.names[i]!r} at its {_SIDES[k]}" for i, k in ((a, side), (b, other)))
                return f"grips hold cable {one} inside {two}: {apart:.4f} m apart, where {least:.4f} m are needed. "
        return ""

    def _far(self, pair: Pair, shapes: list[CableShape], before: list[CableShape]) -> bool:
        """Whether bounds tell that two cables, or one and itself, have not touched from one shape to the next."""
        a, b = pair
        joined, reach = self._joined[pair], self.reach(pair)
        if not self.cull or (a != b and not joined.any()):
            return False
        (p, s, p_then), (r, u, r_then) = (
            (shapes[i].positions, shapes[i].arc_length, before[i].positions) for i in pair
        )
        if a == b and not joined.any():
            shortest = SHORTEST * self._diameters[a]
            return bool(apart.apart_from_itself(p, s, p_then, shortest, reach, 0.25 * reach))
        if a == b:
            return False
        return bool(apart.apart_but_joined(p, s, p_then, r, u, r_then, joined, reach, 0.25 * reach))

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

    def tell_lines(self, spots: Sequence[Spot], lines: Mapping[int, Line], known: Sequence[Spot] = ()) -> bool:
        """Tells which of these places belong to cables that lie along each other there; whether any is told otherwise.

        lines: the centrelines of the cables, by their numbers.
        Of a place that was one the other way round a little more is asked. So do those next to them, or to `known`
        ones, and none where the cables are far from each other, or one turns back onto itself; nor one that has no
        other beside it, unless they are all but parallel there.
        """
        before = [spot.stays for spot in spots]
        found = [_alongside(spot, lines) for spot in spots]
        may = [
            abs(cosine) > _STEEP and spot.distance < NEAR * spot.reach and not spot.turns_back
            for spot, (cosine, _, _, _) in zip(spots, found, strict=True)
        ]
        for spot, flat, (_, _, _, det) in zip(spots, may, found, strict=True):
            spot.stays = flat and det < (_ACROSS if spot.stays else _ALONG)
        rows = [spot for spot in (*spots, *known) if spot.stays]
        for spot, flat, (cosine, _, _, _) in zip(spots, may, found, strict=True):
            beside = any(next_to(spot, other) for other in rows if other is not spot)
            spot.stays = (flat and beside) or (spot.stays and abs(cosine) > _PARALLEL)
        return before != [spot.stays for spot in spots]

    def _spots(
        self, pair: Pair, a: CableShape, b: CableShape, p: Array, r: Array, reach: float, known: Sequence[Spot]
    ) -> list[Spot]:
        """Where two centrelines p, r (n, 3) of the shapes a and b are within `reach` of each other."""
        own, aside = pair[0] == pair[1], ASIDE * self.reach(pair)
        shortest = SHORTEST * self._diameters[pair[0]]
        arcs, joined = (a.arc_length, b.arc_length), self._joined[pair]
        count = cable_near.spots(p, arcs[0], r, arcs[1], own, shortest, joined, reach, aside, self._out)
        if count == 0:
            return []
        rows = self._out[:count].copy()
        for row in rows:
            self._keep_off_mouths(row, pair, ((a, p), (b, r)))
        found = [Spot(pair, row[1:3], row[3:9].reshape(2, 3), self.reach(pair), row[1:3].copy()) for row in rows]
        lines = {pair[0]: (a.arc_length, p), pair[1]: (b.arc_length, r)}
        self.tell_lines(found, lines, known)
        places = [
            spot
            for spot, row in zip(found, rows, strict=True)
            if (spot.stays and abs(_alongside(spot, lines)[2]) < _SLOPE)
            or not any(_slopes_to(row, other, a, b, p, r) for other in rows)
        ]
        if joined.any():  # where cables hang together the distance falls towards there
            places = [spot for spot in places if max(map(abs, _alongside(spot, lines)[1:3])) < _LEVEL]
        return [spot for spot in places if not any(same_place(spot, other) for other in known)]

    def _keep_off_mouths(self, row: Array, pair: Pair, lines: tuple[tuple[CableShape, Array], ...]) -> None:
        """Puts a place next to a grip at its mouth: there the knot of a pair stops."""
        off = MOUTH * self.reach(pair)
        for side, (shape, line) in enumerate(lines):
            arc = min(max(row[1 + side], off), shape.length - off)
            if arc != row[1 + side]:
                row[1 + side] = arc
                row[3 + 3 * side : 6 + 3 * side] = [np.interp(arc, shape.arc_length, c) for c in line.T]


def _alongside(spot: Spot, lines: Mapping[int, Line]) -> tuple[float, float, float, float]:
    """As `cable_near.alongside` has it; lines: centrelines by the cables' numbers."""
    (s, p), (u, r) = (lines[cable] for cable in spot.cables)
    row = np.concatenate(([spot.distance], spot.arcs, spot.places.ravel()))
    found: tuple[float, float, float, float] = cable_near.alongside(p, s, r, u, row, spot.reach)
    return found


def _slopes_to(row: Array, other: Array, a: CableShape, b: CableShape, p: Array, r: Array) -> bool:
    """Whether a place is but the flank of a nearer one: halfway between them the cables are nearer, too."""
    if not other[0] < row[0]:
        return False
    s, t = 0.5 * (row[1:3] + other[1:3])
    halfway = [np.interp(s, a.arc_length, p[:, i]) - np.interp(t, b.arc_length, r[:, i]) for i in range(3)]
    return float(np.linalg.norm(halfway)) < float(row[0])


def came_through(lines: Sequence[Line], now: Sequence[Array], reach: float, joined: Array, *, own: bool) -> Array:
    """(k, 4): where one of two centrelines must have gone through the other, or itself, from `lines` to places `now`.

    Rows are those of `kernels.distance.passing`, with arc lengths [m] in place of pieces, of the sign of their sum. Off
    an end a cable may slip, and none are left where they go through each other and back: then another way leads there.
    How often one goes through itself tells nothing: there all count. reach [m]: least distance of the centrelines;
    joined (2, 2): see `Strands.joined`.
    """
    (s, p), (u, r) = lines
    out = np.empty((passing.MOST_CROSSINGS, passing.CROSSING))
    apart = math.ceil(SHORTEST * reach / float(s[1] - s[0])) if own else 0
    rows = out[: passing.crossings(p, now[0], r, now[1], apart, out)]
    for side, arcs in ((2, s), (3, u)):
        rows[:, side] = np.interp(rows[:, side], np.arange(arcs.size), arcs)
    off = OFF * reach
    inner = rows[((rows[:, 2:] > off) & (rows[:, 2:] < (s[-1] - off, u[-1] - off))).all(axis=1)]
    if joined.any():
        inner = inner[[not cable_near.is_joined(x, float(s[-1]), y, float(u[-1]), joined) for _, _, x, y in inner]]
    through = inner if own else inner[inner[:, 1] * inner[:, 1].sum() > 0.0]
    whole = len(rows) < len(out)  # else there may be more, and what they add up to is not known
    return through if whole or len(through) else inner
