"""That names outlive a rebuilt table: what comes, goes or moves leaves the state of all else as it was."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from networks import TURNS, Net, Piece, Point, Rod
from test_network import END, LENGTH, REST, START, K

from cable_shape.kernels.network import newton, tables
from cable_shape.solve.plan import Knot, block_between, pushes
from cable_shape.solve.rows import Link, Memory, Rows, Run, Stretch, Table, carry

NODES = np.linspace(0.0, LENGTH, 33)


def table(arcs: dict[str, float], points: dict[str, Point], before: Rows | None = None, **links: Link):
    """A cable through named points at arc lengths, its spans named by those: the net and its rows."""
    names = sorted(arcs, key=arcs.__getitem__)
    spans = {f"{a}-{b}": (a, b) for a, b in pairwise(names)}
    order = list(points)  # rows of knots are not in the order in which the cable meets them
    turns = {name: any(points[name].loose) for name in names}
    stretches = {span: Stretch(a, b, (turns[a], turns[b])) for span, (a, b) in spans.items()}
    knots = {name: Knot(turns[name], points[name].moves) for name in order}
    rows = Rows(knots, {"cable": Run(list(spans))}, stretches, links, before)
    bounds = [arcs[name] for name in names]
    nodes = [NODES[(a - 1e-9 <= NODES) & (b + 1e-9 >= NODES)] for a, b in pairwise(bounds)]
    pressed = [[row for row in group[1:] if row >= 0] for group in pushes(rows.plan(dict.fromkeys(spans, 4)))]
    rod = Rod([order.index(name) for name in names], [Piece(LENGTH, K, rest=REST)], nodes)
    net = Net([points[name] for name in order], [rod], pressed=pressed)
    counts = {span: x.size - 1 for span, x in zip(spans, nodes, strict=True)}
    np.testing.assert_array_equal(rows.plan(counts), net.ints)
    return net, rows, Table(rows, net.ints, net.floats, net.sols)


def on(net: Net, arc: float) -> Point:
    """A ball clip on the shape of a net of one rod."""
    i = int(np.abs(np.linspace(0.0, LENGTH, net.samples) - arc).argmin())
    return Point(net.positions(0)[i].copy(), net.quaternions(0)[i].copy(), TURNS)


def test_knots_that_come_and_go_leave_all_others_as_they_were():
    """A third clip where the cable is already, then without the first: rows move, numbers do not."""
    start, end = 0.0, LENGTH
    free = Net([START, END], [Rod((0, 1), [Piece(LENGTH, K, rest=REST)], [NODES])]).settle()
    near, far = on(free, 0.3), on(free, 0.9)
    near = Point(np.add(near.place, (0.0, 0.0, 0.03)), near.rotation, TURNS)
    arcs = {"start": start, "near": 0.3, "far": 0.9, "end": end}
    points = {"far": far, "start": START, "end": END, "near": near}
    net, rows, old = table(arcs, points)
    net.settle()
    new = on(net, 0.6)
    other, after, grown = table(arcs | {"new": 0.6}, {"new": new} | points, rows)
    assert carry(old, grown) == {"new"}
    for name in points:
        pose = other.now.pose[after.row_of_knot[name]]
        np.testing.assert_array_equal(pose, net.now.pose[rows.row_of_knot[name]])
    for span in ("start-near", "far-end"):
        i, j = rows.row_of_span[span], after.row_of_span[span]
        np.testing.assert_array_equal(other.now.lam[j], net.now.lam[i])
        np.testing.assert_array_equal(other.raw(j), net.raw(i))
    np.testing.assert_allclose(other.now.lam[after.row_of_span["near-new"]] - other.model.weight[2],
                               net.now.lam[1], atol=1e-9)  # fmt: skip
    other.now.pose[after.row_of_knot["new"]] = (*new.place, *new.rotation)
    other.trial.pose[...] = other.now.pose
    assert other.solve(1) == newton.CONVERGED
    assert other.info[newton.I_ITERATIONS] <= 4
    np.testing.assert_allclose(other.positions(0), net.positions(0), rtol=0.0, atol=1e-6)
    fewer, last, shrunk = table({k: v for k, v in (arcs | {"new": 0.6}).items() if k != "near"},
                                {k: v for k, v in points.items() if k != "near"} | {"new": new}, after)  # fmt: skip
    assert carry(grown, shrunk) == set()
    for name in ("start", "new", "far", "end"):
        pose = fewer.now.pose[last.row_of_knot[name]]
        np.testing.assert_array_equal(pose, other.now.pose[after.row_of_knot[name]])
    for span in ("new-far", "far-end"):
        i, j = after.row_of_span[span], last.row_of_span[span]
        np.testing.assert_array_equal(fewer.raw(j), other.raw(i))
        np.testing.assert_array_equal(fewer.now.lam[j], other.now.lam[i])


def test_a_knot_that_moves_along_the_cable_leaves_the_spans_beyond_its_neighbours():
    points = {"start": START, "a": Point((0.2, 0.1, 0.0), loose=TURNS), "b": Point((0.5, 0.2, 0.0), loose=TURNS),
              "end": END}  # fmt: skip
    net, rows, old = table({"start": 0.0, "a": 0.3, "b": 0.9, "end": LENGTH}, points)
    rng = np.random.default_rng(3)
    net.sols[:] = rng.standard_normal(net.sols.size)
    other, after, new = table({"start": 0.0, "a": 0.45, "b": 0.9, "end": LENGTH}, points, rows)
    assert carry(old, new) == set()
    for which in range(3):
        a = tables.solution_of.py_func(net.ints, net.sols, which)
        b = tables.solution_of.py_func(other.ints, other.sols, which)
        np.testing.assert_array_equal(b.pose, a.pose)
        np.testing.assert_array_equal(b.lam[2], a.lam[2])
        last = NODES[NODES >= 0.9 - 1e-9].size
        np.testing.assert_array_equal(b.q[-last:], a.q[-last:])
    assert after.memory == {}


def test_links_keep_their_memory_while_others_come_and_go():
    """Five on one knot, of which three are a vertex; between two knots; on a knot that goes."""
    points = {"start": START, "a": Point((0.3, 0.1, 0.0), loose=TURNS, moves=True),
              "b": Point((0.5, 0.2, 0.0), loose=TURNS, moves=True), "end": END}  # fmt: skip
    arcs = {"start": 0.0, "a": 0.3, "b": 0.9, "end": LENGTH}
    several = {f"wall {i}": Link("a", body=f"wall {i}") for i in range(5)}
    crossing = {"crossing": Link("a", "b"), "floor": Link("b", body="floor")}
    _, first, _ = table(arcs, points, None, **several, **crossing)
    first.memory["wall 3"] = Memory(-1, 2.0, np.ones(3), np.full(3, 0.5), True)
    kept = dict(first.memory)
    assert [first.places[f"wall {i}"] for i in range(5)] == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]
    remaining = {name: several[name] for name in ("wall 3", "wall 1")}
    net, second, _ = table(arcs, points, first, corner=Link("b", body="corner"), **crossing, **remaining)
    for name in ("wall 3", "wall 1", "crossing", "floor"):
        assert second.memory[name] is kept[name]
    assert second.memory["corner"].push == 0.0
    assert "wall 0" not in second.memory
    assert second.memory["wall 3"].sticks
    vertex, row = second.push_at(net.ints, "wall 3")
    assert row == 0
    assert second.push_at(net.ints, "wall 1") == (vertex, 1)
    places = net.plan.vertices[:, 1]
    a, b = second.row_of_knot["a"], second.row_of_knot["b"]
    crossed, _ = second.push_at(net.ints, "crossing")
    assert vertex > places[a]  # pushes go after the places on which they act
    assert crossed > max(places[a], places[b])
    assert net.plan.pointer[-1] >= block_between(net.ints, places[a], vertex) >= net.plan.pointer[places[a]]
    third = Rows({k: v for k, v in second.knots.items() if k != "b"}, {"cable": Run(["x", "y"])},
                 {"x": Stretch("start", "a"), "y": Stretch("a", "end")}, remaining, second)  # fmt: skip
    assert third.memory["wall 3"] is kept["wall 3"]
    assert set(third.memory) == set(remaining)
