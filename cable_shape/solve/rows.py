"""Rows of a network by names that outlive a rebuilt table: :class:`Rows`, :class:`Memory`, :func:`carry`.

Compiled code knows knots, spans and pushes by their numbers, and these change whenever one comes or goes. Whoever
builds tables gives each a name; what a solution or a link holds is carried from one table to the next by it.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import tables
from cable_shape.kernels.network.tables import BEFORE, NOW, TRIAL
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.plan import Cable, Knot, Span, Whole, make_plan, pushes

Name = Hashable
#: Pushes of one vertex.
OF_VERTEX = 3


@final
class Stretch(NamedTuple):
    """A span, by the names of its knots; see `plan.Span`."""

    start: Name
    end: Name
    tied: tuple[bool, bool] = (False, False)
    turned: tuple[bool, bool] = (False, False)


@final
class Run(NamedTuple):
    """A cable: its spans from start to end, by their names; see `plan.Cable`."""

    spans: Sequence[Name]
    pieces: int = 1
    points: int = 0
    roll: tuple[Name, Name] | None = None  # knots between which its turns are counted; None: its ends


@final
class Link(NamedTuple):
    """That a knot touches a body, or another knot."""

    knot: Name
    other: Name | None = None  # the other knot
    body: Name | None = None


@final
@dataclass
class Memory:
    """What a link knows from before."""

    side: int = 1  # of the body's surface, on which the cable is
    push: float = 0.0  # N
    anchor: Array = field(default_factory=lambda: np.zeros(3))  # m, in the body's frame: where it stuck last
    tangential: Array = field(default_factory=lambda: np.zeros(3))  # N
    sticks: bool = False


@final
class Rows:
    """Knots, spans, cables and links by name, in the order of their rows; `memory` is that of the links."""

    def __init__(
        self,
        knots: Mapping[Name, Knot],
        cables: Mapping[Name, Run],
        spans: Mapping[Name, Stretch],
        links: Mapping[Name, Link] | None = None,
        before: Rows | None = None,
    ) -> None:
        """before: the rows whose links' memory is taken over, where they are still there."""
        self.knots, self.cables, self.links = dict(knots), dict(cables), dict(links or {})
        self.spans = {name: spans[name] for run in cables.values() for name in run.spans}
        self.row_of_knot = {name: i for i, name in enumerate(self.knots)}
        self.row_of_span = {name: i for i, name in enumerate(self.spans)}
        known: dict[Name, Memory] = before.memory if before is not None else {}
        self.memory: dict[Name, Memory] = {name: known[name] if name in known else Memory() for name in self.links}
        self.places: dict[Name, tuple[int, int]] = {}  # of a link: which vertex of pushes, which of its three rows
        self._pressed: list[list[int]] = []
        open_at: dict[tuple[Name, Name | None], tuple[int, int]] = {}
        for name, link in self.links.items():
            group = (link.knot, link.other)
            vertex, row = open_at.get(group, (-1, OF_VERTEX))
            if row == OF_VERTEX:
                vertex, row = len(self._pressed), 0
                self._pressed.append([self.row_of_knot[knot] for knot in group if knot is not None])
            self.places[name] = vertex, row
            open_at[group] = vertex, row + 1

    def plan(self, elements: Mapping[Name, int]) -> Whole:
        """The plan of :mod:`cable_shape.solve.plan`; elements: how many of each span."""
        row = self.row_of_knot
        spans = [Span(row[s.start], row[s.end], s.tied, s.turned) for s in self.spans.values()]
        cables = []
        for run in self.cables.values():
            a, b = run.roll or (self.spans[run.spans[0]].start, self.spans[run.spans[-1]].end)
            cables.append(Cable(len(run.spans), run.pieces, run.points, (row[a], row[b])))
        counts = [elements[name] for name in self.spans]
        return make_plan(list(self.knots.values()), spans, cables, counts, pressed=self._pressed)

    def push_at(self, ints: Whole, link: Name) -> tuple[int, int]:
        """Vertex and row in it of a link's push."""
        vertex, row = self.places[link]
        return int(pushes(ints)[vertex, 0]), row


@final
class Table(NamedTuple):
    """Rows and the solver's arrays of them."""

    rows: Rows
    ints: Whole
    floats: Array
    sols: Array


def carry(old: Table, new: Table) -> set[Name]:
    """Fills the solutions of a new table from those of an old one; returns the knots that the old one has not.

    A knot keeps its pose. A span with the same nodes keeps its rotations and its force to the last digit; any other
    takes them from its cable, by arc length. Loads and nodes of the new table have to be there.
    """
    plans = [tables.plan_of.py_func(t.ints) for t in (old, new)]
    models = [tables.model_of.py_func(t.ints, t.floats) for t in (old, new)]
    for which in (NOW, BEFORE, TRIAL):
        a, b = (tables.solution_of.py_func(t.ints, t.sols, which) for t in (old, new))
        for name, row in new.rows.row_of_knot.items():
            if name in old.rows.row_of_knot:
                b.pose[row] = a.pose[old.rows.row_of_knot[name]]
        for i, (name, run) in enumerate(new.rows.cables.items()):
            if name not in old.rows.cables:
                continue
            was = list(old.rows.cables).index(name)
            b.turns[i] = a.turns[was]
            along = _along(plans[0], models[0], a, was)
            for span in run.spans:
                j = new.rows.row_of_span[span]
                ours = _nodes(plans[1], j)
                k = old.rows.row_of_span.get(span)
                theirs = _nodes(plans[0], k) if k is not None else slice(0, 0)
                if k is not None and np.array_equal(models[1].s[ours], models[0].s[theirs]):
                    b.q[ours], b.lam[j] = a.q[theirs], a.lam[k]
                else:
                    _take(plans[1], models[1], b, j, along)
    return set(new.rows.knots) - set(old.rows.knots)


def _nodes(plan: tables.Plan, j: int) -> slice:
    """The nodes of span j."""
    return slice(int(plan.first[j]) + j, int(plan.first[j + 1]) + j + 1)


def _along(
    plan: tables.Plan, model: tables.Model, sol: tables.Solution, cable: int
) -> tuple[Array, Array, Array, Array]:
    """Of a cable: arc lengths of its nodes and their rotations, of the middles of its elements and the forces there."""
    first, last = int(plan.cables[cable]), int(plan.cables[cable + 1])
    s, q, middles, forces = [], [], [], []
    for j in range(first, last):
        nodes, own = _nodes(plan, j), slice(int(plan.first[j]), int(plan.first[j + 1]))
        s.append(model.s[nodes])
        q.append(sol.q[nodes])
        middles.append(0.5 * (s[-1][1:] + s[-1][:-1]))
        forces.append(model.load[own, 3:6] + sol.lam[j])
    return np.concatenate(s), np.concatenate(q), np.concatenate(middles), np.concatenate(forces)


def _take(
    plan: tables.Plan, model: tables.Model, sol: tables.Solution, j: int, along: tuple[Array, Array, Array, Array]
) -> None:
    """Rotations and force of a span from its cable."""
    s, q, middles, forces = along
    nodes, own = _nodes(plan, j), slice(int(plan.first[j]), int(plan.first[j + 1]))
    sol.q[nodes] = interpolated(model.s[nodes], s, q)
    at = 0.5 * (model.s[nodes][1:] + model.s[nodes][:-1])
    found = np.stack([np.interp(at, middles, column) for column in forces.T], axis=1)
    sol.lam[j] = (found - model.load[own, 3:6]).mean(axis=0)
