"""That a knot on which several bodies press fits the solver's graph: one more vertex, the pushes, after the knot's own.

Newton's method is written out here, with compiled assembly, condensation, elimination and substitution: the rows of the
links, n . y + g = 0, and their pushes are all that is added.
"""

from __future__ import annotations

import numpy as np
from networks import TURNS, Net, Piece, Point, Rod, frame_along

from cable_shape.kernels.network import graph, newton, system
from cable_shape.solve import plan

SECTION = Piece(1.2, (0.01, 0.015, 0.008), rest=(0.3, 0.2, 0.1), weight=0.981)
NODES = [np.linspace(0.0, 0.5, 17), np.linspace(0.5, 1.2, 23)]
KNOT = 1  # that is pressed on
#: Normals of a floor and of a wall, and the gap of the origin.
NORMALS = np.array(((0.05, -0.1, 1.0), (0.2, 1.0, 0.1)))
NORMALS /= np.linalg.norm(NORMALS, axis=1)[:, None]
GAPS = np.array((0.25, -0.3))


def cable() -> Net:
    """A cable that sags through floor and wall; its knot in between is free in place and rotation."""
    ends = Point((0.0, 0.0, 0.0), frame_along((1.0, 0.0, 0.2))), Point((0.75, 0.1, 0.05), frame_along((1.0, 0.3, 0.4)))
    knot = Point((0.35, 0.05, -0.3), frame_along((1.0, 0.0, 0.0)), TURNS, True)
    points, rods = [ends[0], knot, ends[1]], [Rod((0, 1, 2), [SECTION], NODES)]
    without = Net(points, rods).settle()
    net = Net(points, rods, pressed=[[KNOT]])
    for ours, theirs in zip(net.trial, without.now, strict=True):
        ours[...] = theirs
    return net


def factor(net: Net) -> int:
    """`graph.factor`, with the links' rows; negative eigenvalues."""
    inner = graph.factor(net.ints, net.floats, net.work, 0.0)
    space, ours = net.space, net.plan
    inner -= sum((np.linalg.eigvalsh(P.reshape(3, 3)) < 0.0).sum() for P in space.diagonal[:-1])  # those of spans
    space.size[:], space.block[:] = 0.0, 0.0
    for j in range(ours.ends.shape[0]):
        graph.scatter(ours, net.model, space, j)
    ((pushes, _, _),) = plan.pushes(net.ints)
    assert pushes == space.size.shape[0] - 1
    beside = plan.block_between(net.ints, ours.vertices[KNOT, 1], pushes)
    space.block[beside].reshape(3, 3)[:, :2] = NORMALS.T
    space.size[pushes, 8] = 1.0  # a third link that is not there
    return inner + int(graph.eliminate(ours, space.size, space.block, space.diagonal))


def test_a_knot_in_a_corner_is_one_vertex_more():
    """Newton's method converges quadratically, the knot lies on both, and pushes are what holds it where it is."""
    net = cable()
    free = net.trial.pose[KNOT, :3].copy()
    assert (NORMALS @ free + GAPS < -0.01).all()
    pushes, trial, space = np.zeros(2), net.trial, net.space
    steps = []
    for _ in range(30):
        system.assemble(net.ints, net.floats, net.sols, net.work)
        negative = factor(net)
        space.pull[KNOT] += NORMALS.T @ pushes
        space.gap[-1] = *(NORMALS @ trial.pose[KNOT, :3] + GAPS), 0.0
        largest = graph.solve(net.ints, net.floats, net.work)
        fraction = min(1.0, 0.3 / largest)
        newton.advance(net.ints, net.sols, net.work, fraction)
        pushes += fraction * space.gap[-1, :2]
        steps.append(largest)
        if largest < 1e-12:
            break
    assert steps[-1] < 1e-12
    assert steps[-2] < 1e-5
    assert negative == 3 * 2 + 2  # a strict minimum on the walls: three of each force, one of each push
    np.testing.assert_allclose(NORMALS @ trial.pose[KNOT, :3] + GAPS, 0.0, atol=1e-14)
    assert (-pushes > 0.0).all()
    held = Point(trial.pose[KNOT, :3].copy(), trial.pose[KNOT, 3:].copy(), TURNS)
    other = Net([net.points[0], held, net.points[2]], [Rod((0, 1, 2), [SECTION], NODES)])
    other.trial.q[...], other.trial.lam[...], other.trial.pose[...] = trial.q, trial.lam, trial.pose
    assert other.solve(guard=True) == newton.CONVERGED
    forces = other.now.lam
    reaction = forces[0] - forces[1] - other.model.weight[1]
    np.testing.assert_allclose(-NORMALS.T @ pushes, reaction, atol=1e-9)
