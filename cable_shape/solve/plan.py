"""Who is joined to whom, as the compiled solver needs it: :func:`make_plan`.

Vertices of the graph of unknown rotations and places are eliminated least degree first; which blocks fill in by that is
found once, here, and again only when a knot or a span comes or goes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.kernels.network import tables

Whole = NDArray[np.int64]

#: Where the head of a plan tells how many vertices of pushes there are.
PRESSED = 14
_NOTHING: Mapping[int, Sequence[int]] = MappingProxyType({})


@final
class Knot(NamedTuple):
    """What is unknown of a knot."""

    turns: bool = False  # its rotation, or part of it
    moves: bool = False  # its place


@final
class Span(NamedTuple):
    """Between which knots a span runs, and how its ends are in them."""

    start: int
    end: int
    tied: tuple[bool, bool] = (False, False)  # turns with the knot
    turned: tuple[bool, bool] = (False, False)  # has a frame of its own there


@final
class Cable(NamedTuple):
    """A run of spans."""

    spans: int
    pieces: int = 1
    points: int = 0
    roll: tuple[int, int] = (0, 0)  # knots between which turns are counted


def make_plan(
    knots: Sequence[Knot], spans: Sequence[Span], cables: Sequence[Cable], elements: Sequence[int],
    rings: Sequence[tuple[int, int]] = (), stripping: bool = True, pressed: Sequence[Sequence[int]] = (),
) -> Whole:  # fmt: skip
    """The whole numbers of :class:`cable_shape.kernels.network.tables.Plan`.

    elements: how many of each span. rings: (knot, span before it) of each eyelet. stripping: forces beyond which
    nothing holds a place are known, and such places no unknowns; not so in motion, where drag holds all. pressed: the
    knots between which, or on which, a vertex of up to three pushes acts; see `pushes`.
    """
    stripped = strip(knots, spans) if stripping else []
    leaves = {spans[j][end] for j, end in stripped}
    known = {j for j, _ in stripped}
    sides = [(2 * k, 2 * k + 1) for k in range(len(knots))]
    unknown = {sides[k][0] for k, knot in enumerate(knots) if knot.turns}
    unknown |= {sides[k][1] for k, knot in enumerate(knots) if knot.moves and k not in leaves}
    corners = []
    for j, span in enumerate(spans):
        row = []
        for knot, tied in ((span.start, span.tied[0]), (span.end, span.tied[1])):
            row.append(sides[knot][0] if tied and sides[knot][0] in unknown else -1)
            row.append(sides[knot][1] if sides[knot][1] in unknown and j not in known else -1)
        corners.append(row)
    links = [[sides[k][1] for k in group if sides[k][1] in unknown] for group in pressed]
    vertex_of = [2 * len(knots) + i for i in range(len(pressed))]
    unknown |= set(vertex_of)
    after = dict(zip(vertex_of, links, strict=True))
    order, graph = eliminate(unknown, [*corners, *([*row, v] for v, row in after.items())], after)
    number = {vertex: i for i, vertex in enumerate(order)}
    pointer: list[int] = [0]
    neighbour: list[int] = []
    place: dict[tuple[int, int], int] = {}
    for vertex in order:
        for other in sorted(graph[vertex], key=number.__getitem__):
            place[number[vertex], number[other]] = len(neighbour)
            neighbour.append(number[other])
        pointer.append(len(neighbour))
    goal, target = [0], []
    for i in range(len(order)):
        row = neighbour[pointer[i] : pointer[i + 1]]
        for a, x in enumerate(row):
            target += [-1 - x if x == y else place[x, y] for y in row[a:]]
        goal.append(len(target))
    blocks = []
    for row in corners:
        found = [number.get(x, -1) for x in row]
        blocks.append([_block(place, found[a], found[b]) for a, b in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))])
    first = _starts(elements)
    head = np.zeros(tables.HEAD, dtype=np.int64)
    head[: tables.N_RINGS + 1] = (
        first[-1], len(spans), len(knots), len(order), len(neighbour), len(target), len(cables), len(stripped),
        sum(c.pieces for c in cables), sum(c.points for c in cables), len(rings),
    )  # fmt: skip
    head[PRESSED] = len(pressed)
    head[tables.UNKNOWN] = 3 * (len(spans) - len(known))
    vertices = [[number.get(a, -1), number.get(b, -1)] for a, b in sides]
    left = [np.arange(a, b) + j for j, (a, b) in enumerate(pairwise(first.tolist()))]
    parts = (
        head, first, np.concatenate(left), [span[:2] for span in spans], [span.tied for span in spans],
        [span.turned for span in spans], [j in known for j in range(len(spans))],
        [[number.get(x, -1) for x in row] for row in corners], blocks, vertices, pointer, neighbour, goal, target,
        stripped, _starts([c.spans for c in cables]), [c.roll for c in cables], _starts([c.pieces for c in cables]),
        _starts([c.points for c in cables]), list(rings),
        [(number[v], *group, -1)[:3] for v, group in zip(vertex_of, pressed, strict=True)],
    )  # fmt: skip
    return np.concatenate([np.asarray(part, dtype=np.int64).ravel() for part in parts])


def moving(ints: Whole, loose: bool = False) -> Whole:
    """The plan of the same network in motion: no force is known, and every place that is not given is unknown.

    loose: but for those of cables' free ends, which go like those inside, see `kernels.network.motion`.
    """
    plan: tables.Plan = tables.plan_of.py_func(ints)
    inside = set(loose_spans(plan)) if loose else set()
    leaves = {int(plan.ends[j, end]) for j, end in plan.stripped if int(j) not in inside}
    knots = [Knot(bool(a >= 0), bool(b >= 0) or k in leaves) for k, (a, b) in enumerate(plan.vertices)]
    spans = [
        Span(int(a), int(b), (bool(t[0]), bool(t[1])), (bool(f[0]), bool(f[1])))
        for (a, b), t, f in zip(plan.ends, plan.tied, plan.turned, strict=True)
    ]
    counts = zip(np.diff(plan.cables), np.diff(plan.pieces), np.diff(plan.points), plan.roll, strict=True)
    cables = [Cable(int(m), int(p), int(q), (int(a), int(b))) for m, p, q, (a, b) in counts]
    rings = [(int(knot), int(span)) for knot, span in plan.rings]
    pressed = [[int(k) for k in row[1:] if k >= 0] for row in pushes(ints)]
    return make_plan(knots, spans, cables, np.diff(plan.first).tolist(), rings, stripping=False, pressed=pressed)


def loose_spans(plan: tables.Plan) -> list[int]:
    """Spans at whose end, which is no junction, nothing holds the cable."""
    return [int(j) for j, end in plan.stripped if end == 1 and int((plan.ends == plan.ends[j, 1]).sum()) == 1]


def strip(knots: Sequence[Knot], spans: Sequence[Span]) -> list[tuple[int, int]]:
    """Spans whose force follows from loads alone, leaves first, each with the end (0 or 1) that is the leaf."""
    left = set(range(len(spans)))
    out: list[tuple[int, int]] = []
    while True:
        at: dict[int, list[tuple[int, int]]] = {}
        for j in left:
            at.setdefault(spans[j].start, []).append((j, 0))
            at.setdefault(spans[j].end, []).append((j, 1))
        leaves = [rows[0] for knot, rows in sorted(at.items()) if len(rows) == 1 and knots[knot].moves]
        if not leaves:
            return out
        for j, end in leaves:
            if j in left:
                left.discard(j)
                out.append((j, end))


def pushes(ints: Whole) -> Whole:
    """(p, 3): the vertices of pushes, each with its knot, and the other one or -1; behind what compiled code knows.

    Their blocks on the diagonal are zero but for pushes that are not there, whose number is 1: so they come after the
    places on which they act, and every push adds a negative eigenvalue.
    """
    return ints[ints.size - 3 * int(ints[PRESSED]) :].reshape(-1, 3)


def block_between(ints: Whole, first: int, second: int) -> int:
    """Where the block of two vertices is, of which the first is eliminated first."""
    plan: tables.Plan = tables.plan_of.py_func(ints)
    a, b = int(plan.pointer[first]), int(plan.pointer[first + 1])
    return a + [int(x) for x in plan.neighbour[a:b]].index(second)


def eliminate(
    unknown: set[int], corners: Sequence[Sequence[int]], after: Mapping[int, Sequence[int]] = _NOTHING
) -> tuple[list[int], dict[int, set[int]]]:
    """An order of the vertices, least degree first, and of each the neighbours that are still there at its turn.

    after: of some vertices, those that have to go before.
    """
    beside: dict[int, set[int]] = {vertex: set() for vertex in unknown}
    for row in corners:
        there = [x for x in row if x in beside]
        for x in there:
            beside[x].update(y for y in there if y != x)
    order, graph = [], {}
    while beside:
        ready = (x for x in beside if not any(y in beside for y in after.get(x, ())))
        vertex = min(ready, key=lambda x: (len(beside[x]), x))
        others = beside.pop(vertex)
        for x in others:
            beside[x].discard(vertex)
            beside[x].update(y for y in others if y != x)
        order.append(vertex)
        graph[vertex] = others
    return order, graph


def _starts(counts: Sequence[int]) -> Whole:
    """0, then the sums of all counts so far."""
    return np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(np.asarray(counts, dtype=np.int64))))


def _block(place: dict[tuple[int, int], int], a: int, b: int) -> int:
    """Where the block of rows a and columns b is; -1 - that, if only its transpose is; 0 if there is none."""
    if (a, b) in place:
        return place[a, b]
    return -1 - place[b, a] if (b, a) in place else 0
