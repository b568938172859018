"""Planes of bodies at the nodes of a network in motion: where they put a node, and that nothing is behind them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scene_certificate import distances
from scipy.optimize import minimize

import cable_shape as cs
from cable_shape.kernels.contact.guard import guard
from cable_shape.kernels.network import motion, tables, walls
from cable_shape.kernels.network.walls import AT, BODY, KEPT, OUT, PUSHED, STIFF, WALL, WALLS
from cable_shape.solve.touching.bodies import TouchBodies
from cable_shape.solve.touching.held_along import pulls

RADIUS, REACH = 0.004, 0.3


def walled(settling, node, planes, hold):
    """Gives a node planes (normal, at, stiff, kept)."""
    settling.motion.walls[node] = 0.0
    settling.motion.walls[node, 0] = len(planes)
    for k, (normal, at, stiff, kept) in enumerate(planes):
        row = settling.motion.walls[node, 1 + WALL * k : 1 + WALL * (k + 1)]
        row[OUT : OUT + 3], row[AT], row[STIFF], row[KEPT] = normal, at, stiff, kept
    settling.motion.hold[node] = hold


def value(x, settling, node, pull, planes, hold):
    """What a node minimises [J]."""
    out = 0.5 * hold * float((x - settling.motion.origin[node]) @ (x - settling.motion.origin[node])) - float(pull @ x)
    for normal, at, stiff, kept in planes:
        out += 0.5 * max(0.0, kept + stiff * (at - normal @ x)) ** 2 / stiff
    return out


@given(some.integers(0, 10**6))
def test_a_node_goes_where_planes_and_drag_hold_it_and_gives_as_differences_say(settling, seed):
    rng = np.random.default_rng(seed)
    node, hold = 5, 10.0 ** rng.uniform(-2, 2)
    a, pull = settling.motion.origin[node].copy(), rng.normal(size=3)
    planes = []
    for _ in range(rng.integers(1, WALLS + 1)):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        planes.append((normal, normal @ a + 0.02 * rng.normal(), 10.0 ** rng.uniform(1, 3), rng.choice((0.0, 0.5))))

    def place(pull):
        walled(settling, node, planes, hold)
        moving = settling.motion
        walls.touched(moving.walls, node, tuple(a), hold, tuple(pull), moving.place, moving.give)
        return settling.motion.place[node].copy()

    x = place(pull)
    give = settling.motion.give[node].reshape(3, 3).copy()
    pushes = settling.motion.walls[node, 1:].reshape(WALLS, WALL)[: len(planes), PUSHED].copy()
    assert pushes == pytest.approx([max(0.0, k + s * (at - n @ x)) for n, at, s, k in planes], abs=1e-9)
    forces = pull - hold * (x - a) + sum(p * plane[0] for p, plane in zip(pushes, planes, strict=True))
    assert np.abs(forces).max() < 1e-9 * (1.0 + hold)
    best = minimize(value, x, (settling, node, pull, planes, hold), tol=1e-14)
    assert value(x, settling, node, pull, planes, hold) <= best.fun + 1e-12
    step = 1e-7
    turned = np.array([(place(pull + step * e) - place(pull - step * e)) / (2.0 * step) for e in np.eye(3)]).T
    same = settling.motion.walls[node, 1:].reshape(WALLS, WALL)[: len(planes), PUSHED] > 0.0
    if ((pushes > 0.0) == same).all() and np.abs(pushes[pushes > 0.0]).min(initial=1.0) > 1e-3:
        assert give == pytest.approx(turned, rel=1e-5, abs=1e-8 / hold)


@pytest.mark.parametrize("seed", range(20))
def test_a_plane_that_is_much_firmer_than_drag_lets_no_node_in(settling, seed):
    """Where rounding of what gives, 1e-16 / hold, is a large part of 1 / stiff: in long steps."""
    rng = np.random.default_rng(seed)
    node, hold, stiff = 5, 10.0 ** rng.uniform(-6.5, -5.0), 10.0 ** rng.uniform(6.5, 7.5)
    a, normal = settling.motion.origin[node].copy(), rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    pull = -(10.0 ** rng.uniform(-3, 0)) * normal
    walled(settling, node, [(normal, normal @ a + 10.0 ** rng.uniform(-7, -5), stiff, 0.0)], hold)
    moving = settling.motion
    walls.touched(moving.walls, node, tuple(a), hold, tuple(pull), moving.place, moving.give)
    row = moving.walls[node, 1 : 1 + WALL]
    assert row[PUSHED] == pytest.approx(-pull @ normal, rel=1e-3, abs=1e-4)
    assert row[AT] - normal @ moving.place[node] == pytest.approx(row[PUSHED] / stiff, abs=1e-10)


@given(some.integers(0, 10**6))
def test_planes_hold_a_node_at_its_seat_as_differences_say(settling, seed):
    rng = np.random.default_rng(seed)
    node, hold = 5, 10.0 ** rng.uniform(-1, 5)
    a, pull = settling.motion.origin[node].copy(), rng.normal(size=3)
    normals = rng.normal(size=(rng.integers(1, 4), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = [(n, n @ a + 1e-4 * rng.normal(), 10.0 ** rng.uniform(3, 5), rng.choice((0.0, 0.5))) for n in normals]
    edge = len(planes) > 1 and rng.random() < 0.5
    axis = np.cross(normals[0], normals[1]) if edge else normals[0]
    axis = axis / np.linalg.norm(axis)
    firm, limit = 10.0 ** rng.uniform(2, 5), 10.0 ** rng.uniform(-3, 0)
    centre, x = a + 1e-3 * rng.normal(size=3), a + 1e-3 * rng.normal(size=3)
    row = settling.motion.rough[node]
    walled(settling, node, planes, hold)
    row[motion.FIRM], row[motion.LIMIT], row[motion.EDGE] = firm, limit, edge
    row[motion.CENTRE : motion.CENTRE + 3], row[motion.AXIS : motion.AXIS + 3] = centre, axis

    def rubs(x):
        along = ((centre - x) @ axis) * axis
        way = firm * (along if edge else centre - x - along)
        return way * min(1.0, limit / np.linalg.norm(way))

    def forces(x):
        pushes = np.array([max(0.0, k + s * (at - n @ x)) for n, at, s, k in planes])
        return pull - hold * (x - a) + pushes @ normals + rubs(x)

    def place(pull):
        settling.motion.seat[node] = x
        motion.seat(settling.motion, node, tuple(pull))
        return settling.motion.place[node].copy()

    to = place(pull)
    give = settling.motion.give[node].reshape(3, 3).copy()
    assert np.linalg.solve(give, to - x) == pytest.approx(forces(x), rel=1e-6, abs=1e-6 * (1.0 + hold * 1e-3))
    assert pulls(settling.motion.rough, x[None].repeat(len(settling.motion.rough), axis=0))[node] == pytest.approx(
        rubs(x), abs=1e-12
    )
    pushes = settling.motion.walls[node, 1:].reshape(WALLS, WALL)[: len(planes), PUSHED]
    assert pushes == pytest.approx([max(0.0, k + s * (at - n @ x)) for n, at, s, k in planes], abs=1e-9)
    assert place(pull + normals[0]) - to == pytest.approx(give @ normals[0], rel=1e-6, abs=1e-12)
    step = 1e-7
    beside = [x + sign * step * e for e in np.eye(3) for sign in (1.0, -1.0)]
    kinks = [(np.linalg.norm(rubs(y)) < limit * (1.0 - 1e-9), *[n @ y < at + k / s for n, at, s, k in planes])
             for y in (x, *beside)]  # fmt: skip
    if len(set(kinks)) == 1:
        slopes = np.array([forces(y) for y in beside])
        stiff = -(slopes[::2] - slopes[1::2]).T / (2.0 * step)
        assert np.linalg.inv(give) == pytest.approx(stiff, rel=1e-4, abs=1e-4 * np.abs(stiff).max())
    row[:] = 0.0


def test_a_plane_that_sticks_to_a_node_at_its_seat_pulls_until_it_is_let_go(settling):
    """Else two sets of planes might follow each other for ever."""
    node, normal, hold = 5, np.array((0.0, 0.0, 1.0)), 1.0
    a, row = settling.motion.origin[node].copy(), settling.motion.walls[node]
    settling.motion.rough[node] = 0.0

    def lift(height):
        settling.motion.seat[node] = a + height * normal
        motion.seat(settling.motion, node, (0.0, 0.0, 0.0))
        return settling.motion.give[node, 8]

    settling.motion.walls[...] = 0.0
    walled(settling, node, [(normal, normal @ a, 100.0, 0.0)], hold)
    free, held = pytest.approx(1.0 / hold), pytest.approx(1.0 / (hold + 100.0))
    assert lift(1e-3) == free
    motion.stick(settling.motion)  # nothing pushes
    assert lift(1e-3) == free
    assert lift(-1e-3) == held
    motion.stick(settling.motion)
    assert lift(1e-3) == held
    assert row[1 + PUSHED] == 0.0
    assert row[1 + walls.PULLED] == pytest.approx(-0.1)
    assert motion.let_go(settling.motion)
    assert lift(1e-3) == free
    assert not motion.let_go(settling.motion)
    settling.motion.walls[...] = 0.0


SOLIDS = (cs.Sphere(0.05), cs.Box((0.2, 0.1, 0.05)), cs.Cylinder(0.04, 0.3), cs.Capsule(0.03, 0.2), cs.HalfSpace())


@given(some.integers(0, 10**6))
def test_all_of_a_body_is_behind_the_planes_that_nodes_have(settling, seed):
    rng = np.random.default_rng(seed)
    solid = SOLIDS[rng.integers(len(SOLIDS))]
    turn = rng.normal(size=4)
    pose = cs.Pose((0.35, 0.0, -0.15) + 0.1 * rng.normal(size=3), turn / np.linalg.norm(turn))
    bodies = TouchBodies()
    bodies.take((cs.Obstacle("it", solid, pose),), frozenset(), None, RADIUS, {})
    n = settling.motion.walls.shape[0]
    settling.motion.walls[...] = 0.0
    one = np.ones(n)
    clear, _ = guard(
        settling.ints, settling.floats, settling.moving, bodies.kernel, RADIUS * one, one, REACH, 100.0 * one
    )
    inside = []
    for node in range(1, n - 1):
        gap = float(distances(solid, pose, settling.places[node][None])[0]) - RADIUS
        if not settling.motion.walls[node, 0]:
            assert gap > REACH - 1e-9
            assert clear <= gap + 1e-9
            continue
        row = settling.motion.walls[node, 1 : 1 + WALL]
        assert row[BODY] == 0.0
        assert row[OUT : OUT + 3] @ settling.places[node] - row[AT] == pytest.approx(gap, abs=1e-9)
        if gap > -RADIUS:  # with the node outside of the body itself
            inside.append(row[[OUT, OUT + 1, OUT + 2, AT]])
    cloud = rng.uniform(-0.2, 0.2, (2000, 3)) + pose.position
    within = cloud[distances(solid, pose, cloud) < 0.0]
    for *normal, at in inside:
        assert (within @ np.array(normal) < at - RADIUS + 1e-9).all()


def test_pushes_go_with_their_bodies(settling):
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0, 0, -0.3)))
    ball = cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.35, 0.0, -0.2)))
    n = settling.motion.walls.shape[0]
    settling.motion.walls[...] = 0.0
    one = np.ones(n)

    def look(*found):
        bodies = TouchBodies()
        bodies.take(found, frozenset(), None, RADIUS, {})
        guard(settling.ints, settling.floats, settling.moving, bodies.kernel, RADIUS * one, one, 1.0, 100.0 * one)
        return settling.motion.walls[1:-1, 1:].reshape(n - 2, WALLS, WALL)

    rows = look(ball, table)
    assert (settling.motion.walls[1:-1, 0] == 2).all()
    rows[:, 0, PUSHED], rows[:, 1, PUSHED] = 0.25, 0.5
    again = look(ball, table)
    assert (again[:, 0, KEPT] == 0.25).all()
    assert (again[:, 1, KEPT] == 0.5).all()
    assert (again[:, 0, STIFF] == 100.0).all()
    settling.motion.walls[...] = 0.0
    assert tables.plan_of.py_func(settling.ints).ends.shape == (1, 2)


def test_bodies_that_have_just_become_known_were_where_they_are():
    """Compiled code reads a row of `then` for each body, also where nothing has been solved among them."""
    still = cs.Obstacle("post", cs.Cylinder(0.02, 1.0), cs.Pose((0.3, 0.2, 0.1)))
    carried = cs.Obstacle("tool", cs.Sphere(0.05), link="arm")
    bodies = TouchBodies()
    assert bodies.take((still, carried), frozenset(), None, RADIUS, {"arm": "tool"})
    np.testing.assert_array_equal(bodies.kernel.then, bodies.kernel.frames)
    assert len(bodies.kernel.then) == 1
    assert bodies.move(np.array([[0.5, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(bodies.kernel.then, bodies.kernel.frames)
    assert len(bodies.kernel.then) == 2
