"""What a harness is to the solver of networks: which knots and spans there are, as :class:`Layout`.

Every segment is a cable of the network. Its spans run from support to support: an open end, a clip, a junction; a point
mass, and an arc length at which what the segment is made of has a jump or a kink that is felt, is a knot, too, which
nothing holds (a station). An end that lies beside its junction's origin hangs on a lever, a rod LEVER times as stiff as
the stiffest segment, which is a cable of the network, too.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable as Whole
from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.solve.bare import IDENTITY
from cable_shape.solve.cables import AT, FREE_ROTATIONS, Structure, material_of, shared_loads
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.plan import Cable, Knot, Span
from cable_shape.solve.problem import Problem

#: What holds an end beside its junction is so many times as stiff as the stiffest segment.
LEVER = 1e6
#: A longer table of rest curvature is the drawing of a preformed cable: its kinks are no knots.
MOST_ROWS = 8
#: Stations of a segment that comes back to the point that it leaves, in its lengths: no span may begin and end at one
#: knot, and of three that come around none turns by half a turn or more.
_OF_LOOP, _APART = (1.0 / 3.0, 2.0 / 3.0), 0.15
#: A knot: ("junction", its name), ("end", "a.start"), ("clip", number in the scene), ("station", segment, arc length),
#: ("lever", "a.start").
Name = tuple[str | int | float, ...]
Mask = tuple[float, ...]
_ALL, _NONE = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
#: Knots of whose rotation a guess is to be made: ends that are tied to one begin with the same frame, and keep to it.
_GUESSED = ("junction", "lever", "station")


@final
class Layout(NamedTuple):
    """Knots and spans of a harness, and where they are along its segments."""

    structure: Structure
    frames: Array  # (m, 2, 4) of the ends of spans in their knots
    knots: dict[Name, int]
    spans: dict[str, range]  # of each segment
    arcs: Array  # (m, 2) [m], at which a span begins and ends, on its segment
    own: Array  # (k, 3) [N], loads of segments at knots: point masses
    at_masses: tuple[tuple[int, float, Array], ...]  # knot, mass [kg], what weighs on it [m/s^2]
    levers: tuple[tuple[int, float], ...]  # span and length [m] of each, in the order of their cables, the last ones
    rings: tuple[tuple[int, int], ...]  # segment by segment, the eyelets: number of the clip, span before it
    placed: Array  # (k,) whole numbers, 1: a rotation of which a guess is to be made
    beside: dict[int, list[tuple[int, float]]]  # of each knot those at the other ends of its spans, and how far [m]
    ways: tuple[tuple[int, int, float], ...]  # two knots that are held, and how far they may be apart [m]


@final
class _Builder:
    """Rows as they are found."""

    def __init__(self) -> None:
        self.rows: dict[Name, int] = {}
        self.knots: list[Knot] = []
        self.loose: list[Mask] = []
        self.spans: list[Span] = []
        self.free: list[tuple[Mask, Mask]] = []
        self.frames: list[list[Mask]] = []
        self.arcs: list[tuple[float, float]] = []
        self.rings: list[tuple[int, int]] = []  # clip, and span before it
        self.levers: list[tuple[int, int, Array]] = []  # knots of junction and end, and the way between them

    def knot(self, name: Name, turns: Mask = _NONE, moves: bool = False) -> int:
        """The row of a knot, made if it is new."""
        if name not in self.rows:
            self.rows[name] = len(self.knots)
            self.knots.append(Knot(any(turns), moves))
            self.loose.append(turns)
        return self.rows[name]


def layout_of(problem: HarnessProblem, kinds: Mapping[str, str]) -> Layout:
    """The network of a harness whose open ends are held like this: kinds of grips, or "free"."""
    build = _Builder()
    harness = problem.harness
    for junction in harness.junctions:
        build.knot(("junction", junction.name), _ALL if junction.kind == "rigid" else _NONE, moves=True)
    spans: dict[str, range] = {}
    loads: dict[int, Array] = {}
    masses = []
    cables = []
    for name, one in problem.segments.items():
        first = len(build.spans)
        places, own = _places(problem, name, one)
        knots, ends = [], []
        for (what, _), load in zip(places, own, strict=True):
            row, mask, frame = _support(build, problem, what, kinds)
            knots.append(row)
            ends.append((mask, frame))
            loads[row] = loads.get(row, np.zeros(3)) + load
        _hold_roll(one, places, ends, build)
        names = dict(zip(knots, [what for what, _ in places], strict=True))
        rows = list(zip(knots, [arc for _, arc in places], ends, strict=True))
        for (k, a, end), (n, b, other) in pairwise(rows):
            masks, frames = (end[0], other[0]), (end[1], other[1])
            tied = (masks[0] is None, masks[1] is None)
            turned = (frames[0] is not None, frames[1] is not None)
            build.spans.append(Span(k, n, tied, turned))
            build.free.append((masks[0] or _NONE, masks[1] or _NONE))
            build.frames.append([frame or IDENTITY for frame in frames])
            build.arcs.append((a, b))
            clip = _eyelet(problem, names[n])
            if clip is not None:
                build.rings.append((clip, len(build.spans) - 1))
        spans[name] = range(first, len(build.spans))
        cables.append(Cable(len(spans[name]), len(material_of(one).pieces), 0, (knots[0], knots[0])))
        masses += [(_at(places, knots, mass.arc_length), mass.mass, one.fall(mass.arc_length)) for mass in one.masses]
    levers = []
    for row, far, way in build.levers:
        size = float(np.linalg.norm(way))
        levers.append((len(build.spans), size))
        build.spans.append(Span(row, far, (True, True), (True, True)))
        build.free.append((_NONE, _NONE))
        build.frames.append([frame_along(way / size)] * 2)
        build.arcs.append((0.0, size))
        cables.append(Cable(1, 1, 0, (row, row)))
    for junction in harness.junctions:
        masses.append((build.rows["junction", junction.name], junction.mass, problem.fall(junction.ends[0])))
    own_loads = np.zeros((len(build.knots), 3))
    for row, load in loads.items():
        own_loads[row] = load
    structure = Structure(
        tuple(build.knots), tuple(build.spans), tuple(cables),
        tuple((build.spans[j].end, j) for _, j in build.rings), tuple(build.free), tuple(build.loose),
    )  # fmt: skip
    through = {row for row, _ in structure.rings}
    held = [k for k, knot in enumerate(build.knots) if not knot.moves and k not in through]
    beside = _beside(problem, build, spans, levers)
    ways = [(k, other, far) for k in held for other, far in ways_from(beside, k, held).items() if k < other]
    placed = [name[0] in _GUESSED and build.knots[row].turns for name, row in build.rows.items()]
    return Layout(
        structure, np.array(build.frames), build.rows, spans, np.array(build.arcs), own_loads,
        tuple(row for row in masses if row[1] > 0.0), tuple(levers), tuple(build.rings),
        np.array(placed, dtype=np.int64), beside, tuple(ways),
    )  # fmt: skip


def _beside(
    problem: HarnessProblem, build: _Builder, spans: Mapping[str, range], levers: list[tuple[int, float]]
) -> dict[int, list[tuple[int, float]]]:
    """Of each knot those at the other ends of its spans, and how far they reach [m]: those that stretch, anywhere."""
    reach = dict(levers)
    for name, rows in spans.items():
        stiff = holds(problem.harness.segments[name])
        reach |= {j: build.arcs[j][1] - build.arcs[j][0] if stiff else math.inf for j in rows}
    out: dict[int, list[tuple[int, float]]] = {}
    for j, far in reach.items():
        a, b = build.spans[j][:2]
        out.setdefault(a, []).append((b, far))
        out.setdefault(b, []).append((a, far))
    return out


def holds(cable: Whole) -> bool:
    """Whether no part of a cable stretches."""
    return all(one.axial_stiffness is None for _, _, one in pieces_of(cable))


def ways_from(beside: Mapping[int, list[tuple[int, float]]], start: int, held: Sequence[int]) -> dict[int, float]:
    """[m], the shortest ways along spans from one knot to others that are held, without passing any."""
    best = {start: 0.0}
    queue = [(0.0, start)]
    stop = set(held) - {start}
    while queue:
        way, k = heapq.heappop(queue)
        if way > best[k] or k in stop:
            continue
        for other, length in beside.get(k, ()):
            if way + length < best.get(other, math.inf):
                best[other] = way + length
                heapq.heappush(queue, (way + length, other))
    return {k: way for k, way in best.items() if k in stop}


def _places(problem: HarnessProblem, name: str, one: Problem) -> tuple[list[tuple[Name, float]], Array]:
    """Knots along a segment with their arc lengths [m], and the dead loads (p, 3) [N] on them."""
    length = one.cable.length
    ends = f"{name}.start", f"{name}.end"
    fixed: list[tuple[Name, float]] = [(("end", ends[0]), 0.0)]
    fixed += [(("clip", i), clip.arc_length) for i, clip in zip(problem.clips[name], one.clips, strict=True)]
    fixed.append((("end", ends[1]), length))
    arcs = np.array([arc for _, arc in fixed])
    own, at, force = shared_loads(one, arcs)
    stops = _stops_of(one)
    stations: dict[float, Array] = {}
    for arc, load in zip(at.tolist(), force, strict=True):
        stations[arc] = stations.get(arc, np.zeros(3)) + load
    for arc in stops.tolist():
        near = np.concatenate((arcs, list(stations)))
        if np.abs(near - arc).min() > AT * length:
            stations[arc] = np.zeros(3)
    if len(fixed) == 2 and _closes(problem, ends):
        for arc in (share * length for share in _OF_LOOP):
            if min((abs(arc - other) for other in stations), default=length) > _APART * length:
                stations[arc] = np.zeros(3)
    rows = [*zip(fixed, own, strict=True), *(((("station", name, arc), arc), f) for arc, f in stations.items())]
    rows.sort(key=lambda row: row[0][1])
    return [place for place, _ in rows], np.array([load for _, load in rows])


def _closes(problem: HarnessProblem, ends: tuple[str, str]) -> bool:
    """Whether a segment comes back to the point that it leaves."""
    first, last = (problem.harness.junction_of(end) for end in ends)
    if first is None or first is not last:
        return False
    return not any(first.frame(end).position.any() for end in ends)


def _stops_of(one: Problem) -> Array:
    """Arc lengths [m] that are to be knots: of a long table of rest curvature no kinks, whose spans would be too short.

    What is inside an element then counts as error, and the mesh is made finer there.
    """
    stops = material_of(one).stops
    if len(one.cable.rest_curvature) <= MOST_ROWS or one.swing is not None:
        return stops
    bounds = np.array([x for a, b, _ in pieces_of(one.cable) for x in (a, b)])
    return np.asarray(stops[[bool(np.abs(bounds - x).min() <= 1e-9 * one.cable.length) for x in stops]])


def _support(
    build: _Builder, problem: HarnessProblem, what: Name, kinds: Mapping[str, str]
) -> tuple[int, Mask | None, Mask | None]:
    """Row of a knot, the rotations that it leaves free of an end that is not tied to it, the frame of one that is."""
    if what[0] == "end":
        end = str(what[1])
        junction = problem.harness.junction_of(end)
        if junction is None:
            return build.knot(what, moves=kinds[end] == "free"), FREE_ROTATIONS[kinds[end]], None
        row = build.rows["junction", junction.name]
        if junction.kind == "ball":
            return row, _ALL, None
        frame = junction.frame(end)
        if frame.position.any():
            far = build.knot(("lever", end), _ALL, moves=True)
            build.levers.append((row, far, frame.position))
            row = far
        return row, None, tuple(frame.quaternion.tolist())
    if what[0] == "station":
        return build.knot(what, _ALL, moves=True), None, None
    assert problem.scene is not None
    assert isinstance(what[1], int)
    mask = FREE_ROTATIONS[problem.scene.clips[what[1]].kind]
    return (build.knot(what, mask), None, None) if any(mask) else (build.knot(what), mask, None)


def _eyelet(problem: HarnessProblem, what: Name) -> int | None:
    """The number of the clip at a knot, if it is an eyelet."""
    if what[0] != "clip" or problem.scene is None:
        return None
    clip = int(what[1])
    return clip if problem.scene.clips[clip].kind == "slide" else None


def _hold_roll(
    one: Problem, places: list[tuple[Name, float]], ends: list[tuple[Mask | None, Mask | None]], build: _Builder
) -> None:
    """Holds the roll of a round straight segment at one of its ends where nothing else does: it would be neutral."""
    stiff = [part.bending_stiffness for _, _, part in pieces_of(one.cable)]
    alike = all(a == b for a, b in stiff) and material_of(one).straight
    if not alike or any(frame is not None for _, frame in ends):
        return
    if any(mask is not None and mask[2] == 0.0 for mask, _ in ends):
        return
    side = 0 if ends[0][0] is not None else -1
    mask = ends[side][0]
    if mask is not None:
        ends[side] = ((mask[0], mask[1], 0.0), None)


def frame_along(way: Array) -> Mask:
    """(4,) x, y, z, w: a rotation whose d3 points along a unit vector."""
    x, y, z = way.tolist()
    if z < -0.999999:
        return (1.0, 0.0, 0.0, 0.0)
    size = math.sqrt(2.0 + 2.0 * z)
    return (-y / size, x / size, 0.0, 0.5 * size)


def _at(places: list[tuple[Name, float]], knots: list[int], arc: float) -> int:
    """The knot nearest to an arc length."""
    return knots[min(range(len(places)), key=lambda i: abs(places[i][1] - arc))]
