"""Distances against references that share no code with the kernels, and shortcuts that must not change them."""

import itertools
import math

import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar, nnls

from cable_shape.clearance import ClearanceChecker
from cable_shape.errors import ArgumentError
from cable_shape.pose import IDENTITY, Pose
from cable_shape.report import BodyDistance
from cable_shape.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Obstacle, Scene, Sphere
from cable_shape.shape import CableShape, Status

RADIUS = 0.004
seeds = st.integers(min_value=0, max_value=2**32 - 1)
few = settings(derandomize=True, deadline=None, max_examples=40)


def shape_through(points: np.ndarray, status: Status = Status.OK) -> CableShape:
    """A shape with this centreline; only what clearance looks at is filled."""
    points = np.asarray(points, dtype=float)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    shape = CableShape(
        np.zeros(17 * len(points)), len(points), length=float(steps.sum()), model="gradient4", status=status
    )
    shape.arc_length[:] = np.concatenate(([0.0], np.cumsum(steps)))
    shape.positions[:] = points
    return shape


def straight(start, end, points: int = 21) -> CableShape:
    return shape_through(np.linspace(start, end, points))


def wavy(rng: np.random.Generator, points: int = 60) -> CableShape:
    """A smooth curve through the unit cube."""
    s = np.linspace(0.0, 1.0, points)[:, None]
    curve = sum(rng.normal(size=3) * 0.25 / k * np.sin(k * np.pi * s + rng.uniform(0, 6)) for k in (1, 2, 3))
    return shape_through(curve + rng.uniform(-0.3, 0.3, 3) + s * rng.normal(size=3) * 0.4)


def random_pose(rng: np.random.Generator, reach: float = 0.6) -> Pose:
    q = rng.normal(size=4)
    return Pose(rng.uniform(-reach, reach, 3), q / np.linalg.norm(q))


def box_mesh(size) -> Mesh:
    """The 12 triangles of a box, outward."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.5 * np.asarray(size)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])


def ball_mesh(radius: float, rings: int = 12) -> Mesh:
    """A closed ball of `2 rings (rings - 1)` triangles with its vertices on the sphere."""
    polar = np.linspace(0.0, np.pi, rings + 1)[1:-1]
    around = np.arange(rings) * 2.0 * np.pi / rings
    middle = [(np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)) for p in polar for a in around]
    vertices = radius * np.array([(0.0, 0.0, 1.0), *middle, (0.0, 0.0, -1.0)])
    last = len(vertices) - 1

    def at(row: int, column: int) -> int:
        return 1 + row * rings + column % rings

    faces = [(0, at(0, j), at(0, j + 1)) for j in range(rings)]
    faces += [(last, at(rings - 2, j + 1), at(rings - 2, j)) for j in range(rings)]
    for i in range(rings - 2):
        for j in range(rings):
            faces += [(at(i, j), at(i + 1, j), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i, j + 1))]
    return Mesh(vertices, faces)


def measured(solid, shape: CableShape, pose: Pose = IDENTITY, **keywords) -> BodyDistance:
    checker = ClearanceChecker(
        Scene(obstacles=[Obstacle("body", solid, pose)]), radius=RADIUS, horizon=10.0, **keywords
    )
    found = checker.check(shape)
    assert len(found.bodies) == 1
    return found.bodies[0]


def in_frame(pose: Pose, points: np.ndarray) -> np.ndarray:
    m = pose.matrix()
    return (np.atleast_2d(points) - m[:3, 3]) @ m[:3, :3]


def hull_distance(segment: np.ndarray, hull: np.ndarray) -> float:
    """Least distance between two convex hulls by non-negative least squares, weights of each summing to 1."""
    heavy = 1e3
    table = np.zeros((5, len(segment) + len(hull)))
    table[:3] = np.concatenate((segment, -hull)).T
    table[3, : len(segment)] = table[4, len(segment) :] = heavy
    weights, _ = nnls(table, np.array([0.0, 0.0, 0.0, heavy, heavy]), maxiter=1000)
    a, b = weights[: len(segment)], weights[len(segment) :]
    return float(np.linalg.norm(segment.T @ (a / a.sum()) - hull.T @ (b / b.sum())))


def polyline_hull_distance(points: np.ndarray, hulls: list[np.ndarray]) -> float:
    return min(hull_distance(points[i : i + 2], hull) for i in range(len(points) - 1) for hull in hulls)


def polyline_minimum(points: np.ndarray, distance) -> float:
    """Least of `distance` (of points (k, 3)) along a polyline by sampling and refining."""
    best = math.inf
    for a, b in itertools.pairwise(points):
        t = np.linspace(0.0, 1.0, 41)
        values = distance(a + t[:, None] * (b - a))
        i = int(values.argmin())
        bounds = (t[max(i - 1, 0)], t[min(i + 1, 40)])
        fine = minimize_scalar(
            lambda u, a=a, b=b: distance((a + u * (b - a))[None])[0],
            bounds=bounds, method="bounded", options={"xatol": 1e-12},
        )  # fmt: skip
        best = min(best, values[i], fine.fun)
    return float(best)


def from_cylinder(radius: float, length: float):
    """Signed distance of points to a cylinder: outside to the clamped point, inside to the nearest of wall and lids."""

    def distance(p: np.ndarray) -> np.ndarray:
        rho = np.hypot(p[:, 0], p[:, 1])
        inside = np.minimum(radius - rho, 0.5 * length - np.abs(p[:, 2]))
        outside = np.hypot(rho - np.minimum(rho, radius), p[:, 2] - np.clip(p[:, 2], -0.5 * length, 0.5 * length))
        return np.where(inside > 0.0, -inside, outside)

    return distance


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("solid", "centreline", "on_body", "arc_length"),
    [
        (Sphere(0.05), 0.15, (0.0, 0.0, 0.05), 0.5),
        (Box((0.2, 0.1, 0.3)), 0.05, (None, 0.0, 0.15), None),
        (Cylinder(0.05, 0.3), 0.05, (None, 0.0, 0.15), None),
        (Capsule(0.05, 0.2), 0.05, (0.0, 0.0, 0.15), 0.5),
        (HalfSpace(), 0.2, (None, 0.0, 0.0), None),
        (box_mesh((0.2, 0.1, 0.3)), 0.05, (None, 0.0, 0.15), None),
    ],
)
def test_level_cable_above_a_body(solid, centreline, on_body, arc_length):
    found = measured(solid, straight((-0.5, 0.0, 0.2), (0.5, 0.0, 0.2)))
    assert found.distance == pytest.approx(centreline - RADIUS, abs=1e-12)
    assert found.point_on_cable[2] == pytest.approx(0.2 - RADIUS, abs=1e-12)
    for value, expected in zip(found.point_on_body, on_body, strict=True):
        assert expected is None or value == pytest.approx(expected, abs=1e-12)
    assert arc_length is None or found.arc_length == pytest.approx(arc_length, abs=1e-12)


def test_skew_edge_of_a_box():
    # The cable crosses above the edge y = 0.05, z = 0.15 at a right angle to the edge's diagonal.
    found = measured(Box((1.0, 0.1, 0.3)), straight((0.01, 0.05, 0.25), (0.01, 0.15, 0.15)))
    assert found.distance == pytest.approx(0.1 / math.sqrt(2.0) - RADIUS, abs=1e-12)
    np.testing.assert_allclose(found.point_on_body, (0.01, 0.05, 0.15), atol=1e-12)


def test_rim_of_a_cylinder():
    # Along y above the rim point (0.05, 0, 0.1): 0.03 further out and 0.04 higher.
    found = measured(Cylinder(0.05, 0.2), straight((0.08, -0.3, 0.14), (0.08, 0.3, 0.14), 20))
    assert found.distance == pytest.approx(0.05 - RADIUS, abs=1e-12)
    np.testing.assert_allclose(found.point_on_body, (0.05, 0.0, 0.1), atol=1e-7)


@pytest.mark.parametrize(
    ("solid", "height", "depth"),
    [
        (Sphere(0.05), 0.02, 0.03),
        (Box((0.4, 0.4, 0.1)), 0.02, 0.03),
        (Cylinder(0.2, 0.1), 0.02, 0.03),
        (Capsule(0.05, 0.0001), 0.02, 0.03005),
        (HalfSpace(), -0.03, 0.03),
        (box_mesh((0.4, 0.4, 0.1)), 0.02, 0.03),
    ],
)
def test_depth_of_overlap(solid, height, depth):
    found = measured(solid, straight((-0.5, 0.0, height), (0.5, 0.0, height)))
    assert found.distance == pytest.approx(-depth - RADIUS, abs=1e-12)
    gap = np.linalg.norm(found.point_on_cable - found.point_on_body)
    assert gap == pytest.approx(depth + RADIUS, abs=1e-12)
    assert found.point_on_body[2] > found.point_on_cable[2]


def test_surfaces_touch_when_only_the_cable_s_flesh_overlaps():
    found = measured(HalfSpace(), straight((0.0, 0.0, 0.003), (1.0, 0.0, 0.003)))
    assert found.distance == pytest.approx(-0.001, abs=1e-15)
    assert found.point_on_cable[2] == pytest.approx(-0.001, abs=1e-15)
    assert found.point_on_body[2] == pytest.approx(0.0, abs=1e-15)


def test_cable_through_a_thin_wall_between_two_points():
    for solid in (box_mesh((0.001, 1.0, 1.0)), Mesh([(0, -1, -1), (0, 1, -1), (0, 0, 1)], [(0, 1, 2)])):
        found = measured(solid, straight((-0.51, 0.0, 0.0), (0.49, 0.0, 0.0), 6))
        assert found.distance == pytest.approx(-RADIUS, abs=1e-9)


def test_cable_inside_a_closed_mesh():
    found = measured(box_mesh((2.0, 1.0, 1.0)), straight((-0.5, 0.0, 0.2), (0.5, 0.0, 0.2)))
    assert found.distance == pytest.approx(-0.3 - RADIUS, abs=1e-12)
    np.testing.assert_allclose(found.point_on_body[2], 0.5, atol=1e-12)
    shell = box_mesh((2.0, 1.0, 1.0))
    opened = Mesh(shell.vertices, shell.faces[1:])
    found = measured(opened, straight((-0.5, 0.0, 0.2), (0.5, 0.0, 0.2)))
    assert found.distance == pytest.approx(0.3 - RADIUS, abs=1e-12), "an open mesh is a surface"


# --- against independent solvers --------------------------------------------------------------------------------------


@few
@given(seeds)
def test_polyhedra_against_least_squares(seed):
    rng = np.random.default_rng(seed)
    shape, pose = wavy(rng, 8), random_pose(rng)
    points = in_frame(pose, shape.positions)
    size, length, radius = rng.uniform(0.02, 0.3, 3), rng.uniform(0.02, 0.4), rng.uniform(0.01, 0.1)
    triangle = rng.uniform(-0.3, 0.3, (3, 3))
    axis = np.array([(0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)])
    for solid, hull, thick in (
        (Box(size), box_mesh(size).vertices, 0.0),
        (Capsule(radius, length), axis, radius),
        (Sphere(radius), np.zeros((1, 3)), radius),
        (Mesh(triangle, [(0, 1, 2)]), triangle, 0.0),
    ):
        reference = polyline_hull_distance(points, [hull]) - thick
        found = measured(solid, shape, pose).distance + RADIUS
        if reference > -thick + 1e-6:  # centreline outside
            assert found == pytest.approx(reference, abs=1e-7), solid
        else:
            assert found <= -thick + 1e-6, solid


@few
@given(seeds)
def test_cylinders_against_sampling(seed):
    rng = np.random.default_rng(seed)
    shape, pose = wavy(rng, 8), random_pose(rng)
    radius, length = rng.uniform(0.02, 0.3), rng.uniform(0.02, 0.4)
    reference = polyline_minimum(in_frame(pose, shape.positions), from_cylinder(radius, length))
    assert measured(Cylinder(radius, length), shape, pose).distance + RADIUS == pytest.approx(reference, abs=1e-7)


@few
@given(seeds)
def test_depth_in_a_box_against_sampling(seed):
    rng = np.random.default_rng(seed)
    shape, pose = wavy(rng, 8), random_pose(rng, 0.2)
    half = rng.uniform(0.2, 0.6, 3)

    def distance(p):
        inside = (half - np.abs(p)).min(axis=1)
        return np.where(inside > 0.0, -inside, np.linalg.norm(p - np.clip(p, -half, half), axis=1))

    reference = polyline_minimum(in_frame(pose, shape.positions), distance)
    # at a crease the reference is no better than its step, a few 1e-8
    assert measured(Box(2.0 * half), shape, pose).distance + RADIUS == pytest.approx(reference, abs=1e-7)


@settings(few, max_examples=15)
@given(seeds)
def test_meshes_against_least_squares_over_all_triangles(seed):
    rng = np.random.default_rng(seed)
    mesh = ball_mesh(0.2, 5)
    shape, pose = wavy(rng, 6), random_pose(rng)
    points = in_frame(pose, shape.positions)
    reference = polyline_hull_distance(points, [mesh.vertices[f] for f in mesh.faces])
    found = measured(mesh, shape, pose).distance + RADIUS
    if (np.linalg.norm(points, axis=1) > 0.2).all() and reference > 1e-6:
        assert found == pytest.approx(reference, abs=1e-7)
    elif reference <= 1e-6:
        assert found <= 1e-6


@few
@given(seeds)
def test_side_of_a_point_on_a_closed_mesh(seed):
    """Corners and edges are where the side is easily mistaken: aim the points at them."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.1, 0.5, 3)
    mesh = box_mesh(size)
    corners = mesh.vertices[mesh.faces[rng.integers(12)]]
    aim = rng.dirichlet(np.ones(3) * rng.choice([0.01, 1.0])) @ corners
    point = aim + rng.normal(size=3) * 10.0 ** rng.uniform(-6, -1)
    shape = shape_through([point, point + 1e-9])
    exact = measured(Box(size), shape).distance
    assert measured(mesh, shape).distance == pytest.approx(exact, abs=3e-9)


@few
@given(seeds)
def test_side_of_a_point_where_one_face_is_cut_into_slivers(seed):
    """Normals at a sharp tip that are not weighted by angle lean towards the face with most triangles."""
    rng = np.random.default_rng(seed)
    turns = np.arange(3) * 2.0 * np.pi / 3.0
    tip = np.zeros(3)
    b, c, d = np.stack((0.2 * np.cos(turns), 0.2 * np.sin(turns), np.full(3, -1.0)), axis=1)
    many = 40
    edge = [c + (d - c) * i / many for i in range(many + 1)]  # the face tip, c, d, as a fan around the tip
    faces = [(0, 2 + i, 3 + i) for i in range(many)] + [(1, 3 + i, 2 + i) for i in range(many)]
    mesh = Mesh([tip, b, *edge], [*faces, (0, 1, 2), (0, 2 + many, 1)])
    point = rng.normal(size=3) * 0.03
    below = [point @ np.cross(q, p) / np.linalg.norm(np.cross(q, p)) for p, q in ((b, c), (c, d), (d, b))]
    found = measured(mesh, shape_through([point, point + 1e-9])).distance + RADIUS
    if min(below) > 0.0:
        assert found == pytest.approx(-min(below), abs=3e-9)
    else:
        assert found == pytest.approx(hull_distance(point[None], np.array([tip, b, c, d])), abs=1e-7)


@few
@given(seeds)
def test_fcl_agrees_within_its_own_error(seed):
    """FCL's distances of capsules are off by up to 70 µm."""
    rng = np.random.default_rng(seed)
    shape, pose = wavy(rng, 2), random_pose(rng)
    a, b = shape.positions
    length, radius = rng.uniform(0.05, 0.4), rng.uniform(0.02, 0.2)
    mesh = ball_mesh(0.2, 8)
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    axis = (b - a) / np.linalg.norm(b - a)
    side = np.linalg.svd(axis[None])[2][1:]
    turned = np.stack((side[0], np.cross(axis, side[0]), axis), axis=1)
    cable = fcl.CollisionObject(fcl.Capsule(RADIUS, float(np.linalg.norm(b - a))), fcl.Transform(turned, 0.5 * (a + b)))
    m = pose.matrix()
    for solid, other in (
        (Box((length, radius, 0.1)), fcl.Box(length, radius, 0.1)),
        (Sphere(radius), fcl.Sphere(radius)),
        (Cylinder(radius, length), fcl.Cylinder(radius, length)),
        (Capsule(radius, length), fcl.Capsule(radius, length)),
        (mesh, model),
    ):
        request, result = fcl.DistanceRequest(enable_nearest_points=True), fcl.DistanceResult()
        body = fcl.CollisionObject(other, fcl.Transform(m[:3, :3].copy(), m[:3, 3].copy()))
        theirs = fcl.distance(cable, body, request, result)
        ours = measured(solid, shape, pose).distance
        if theirs > 1e-3:
            assert ours == pytest.approx(theirs, abs=1e-4), solid
        else:
            assert ours < 2e-3, solid


@few
@given(seeds)
def test_witness_points_lie_on_both_surfaces(seed):
    rng = np.random.default_rng(seed)
    shape, pose = wavy(rng, 20), random_pose(rng)
    for solid in (
        Box((0.3, 0.2, 0.1)),
        Sphere(0.1),
        Cylinder(0.1, 0.3),
        Capsule(0.1, 0.3),
        HalfSpace(),
        ball_mesh(0.2),
    ):
        found = measured(solid, shape, pose)
        between = found.point_on_cable - found.point_on_body
        assert np.linalg.norm(between) == pytest.approx(abs(found.distance), abs=1e-9)
        there = [np.interp(found.arc_length, shape.arc_length, shape.positions[:, k]) for k in range(3)]
        assert np.linalg.norm(found.point_on_cable - there) == pytest.approx(RADIUS, abs=1e-12)
        dot = shape_through([found.point_on_body, found.point_on_body + 1e-12])
        assert measured(solid, dot, pose).distance + RADIUS == pytest.approx(0.0, abs=1e-9), solid


@few
@given(seeds)
def test_moving_everything_together_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    shape, pose, move = wavy(rng), random_pose(rng), random_pose(rng, 3.0)
    m = move.matrix()
    moved = shape_through(shape.positions @ m[:3, :3].T + m[:3, 3])
    for solid in (Box((0.3, 0.2, 0.1)), Cylinder(0.1, 0.3), Capsule(0.1, 0.3), ball_mesh(0.2)):
        there, here = measured(solid, moved, move * pose), measured(solid, shape, pose)
        assert there.distance == pytest.approx(here.distance, abs=1e-12)


# --- shortcuts --------------------------------------------------------------------------------------------------------


def crowd(rng: np.random.Generator) -> tuple[Scene, list[Obstacle], dict[str, Pose]]:
    solids = [Box((0.1, 0.2, 0.05)), Sphere(0.06), Cylinder(0.05, 0.2), Capsule(0.05, 0.2), ball_mesh(0.1)]
    obstacles = [Obstacle(f"obstacle{i}", solids[i % 5], random_pose(rng, 0.9)) for i in range(20)]
    obstacles += [Obstacle("floor", HalfSpace(), Pose((0, 0, -0.5))), Obstacle("ring", box_mesh((2, 2, 2)))]
    robot = [Obstacle(f"link{i}", solids[i % 5], random_pose(rng, 0.1), f"link{i}") for i in range(14)]
    return Scene(obstacles), robot, {f"link{i}": random_pose(rng, 0.9) for i in range(14)}


def tangled(rng: np.random.Generator, points: int) -> CableShape:
    """A random walk: no neighbour tells where the next point is."""
    return shape_through(np.cumsum(rng.normal(size=(points, 3)) * 0.08, axis=0))


@few
@given(seeds, st.sampled_from([wavy, tangled]))
def test_culling_changes_no_bit_and_fires(seed, curve):
    rng = np.random.default_rng(seed)
    scene, robot, links = crowd(rng)
    keywords = {"radius": RADIUS, "robot_links": robot, "gripping_links": ("link3", "link9"), "horizon": 0.2}
    shape = curve(rng, 41)
    quick = ClearanceChecker(scene, **keywords).check(shape, links)
    slow = ClearanceChecker(scene, **keywords, cull=False).check(shape, links)
    assert slow.pairs_culled == 0
    assert quick.pairs_culled > 0
    assert quick.pairs_culled + quick.pairs_exact == slow.pairs_exact
    assert quick.beyond == slow.beyond
    assert len(quick.bodies) == len(slow.bodies)
    for a, b in zip(quick.bodies, slow.bodies, strict=True):
        assert (a.body, a.distance, a.arc_length) == (b.body, b.distance, b.arc_length)
        assert a.point_on_cable.tobytes() == b.point_on_cable.tobytes()
        assert a.point_on_body.tobytes() == b.point_on_body.tobytes()


def test_a_far_scene_costs_no_exact_pair():
    scene = Scene([Obstacle("far", Sphere(0.1), Pose((0, 0, 5.0)))])
    found = ClearanceChecker(scene, radius=RADIUS).check(straight((0, 0, 0), (1, 0, 0)))
    assert found.bodies == ()
    assert found.pairs_exact == 0
    assert found.pairs_culled == 20
    assert found.beyond == 0.1
    assert found.closest is None


def test_horizon_lists_what_is_nearer_and_bounds_the_rest():
    scene = Scene(
        [Obstacle("near", Sphere(0.1), Pose((0.5, 0, 0.2))), Obstacle("far", Sphere(0.1), Pose((0.5, 0, -0.4)))]
    )
    cable = straight((0, 0, 0), (1, 0, 0))
    assert [b.body for b in ClearanceChecker(scene, radius=RADIUS, horizon=0.295).check(cable).bodies] == ["near"]
    both = ClearanceChecker(scene, radius=RADIUS, horizon=0.297).check(cable)
    assert [b.body for b in both.bodies] == ["near", "far"], "in the order of the scene"
    assert both.beyond == math.inf
    assert both.closest is both.bodies[0]


def test_nothing_to_check():
    checker = ClearanceChecker(Scene(), radius=RADIUS)
    cable = straight((0, 0, 0), (1, 0, 0))
    assert checker.check(cable).beyond == math.inf
    assert not checker.check(cable).robot_checked
    assert checker.check(cable, {}).robot_checked


# --- robot ------------------------------------------------------------------------------------------------------------


def test_bodies_move_with_their_links():
    tool = Obstacle("camera", Sphere(0.02), Pose((0.0, 0.0, 0.1)), link="tool")
    checker = ClearanceChecker(Scene([tool]), radius=RADIUS, horizon=1.0)
    cable = straight((-1, 0, 0), (1, 0, 0))
    half_turn = Pose((0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0))
    assert checker.check(cable, {"tool": half_turn}).bodies[0].distance == pytest.approx(0.4 - 0.02 - RADIUS)
    assert checker.check(cable, {"tool": Pose((0, 0, 0.5))}).bodies[0].distance == pytest.approx(0.6 - 0.02 - RADIUS)


def test_without_links_the_robot_is_not_checked():
    scene = Scene([Obstacle("post", Sphere(0.05), Pose((0.5, 0, 0.1)))])
    arm = Obstacle("arm", Sphere(0.05), Pose((0.5, 0, 0.1)), link="arm")
    checker = ClearanceChecker(scene, radius=RADIUS, robot_links=[arm])
    cable = straight((0, 0, 0), (1, 0, 0))
    without, with_it = checker.check(cable), checker.check(cable, {"arm": IDENTITY, "other": IDENTITY})
    assert [b.body for b in without.bodies] == ["post"]
    assert not without.robot_checked
    assert without.beyond == math.inf, "bodies that were left out are not said to be far"
    assert [b.body for b in with_it.bodies] == ["post", "arm"]
    assert with_it.robot_checked


def test_a_missing_link_is_named():
    arm = Obstacle("upper arm", Sphere(0.05), link="left_upper_arm")
    checker = ClearanceChecker(Scene(), radius=RADIUS, robot_links=[arm])
    with pytest.raises(ArgumentError, match=r"left_upper_arm.*upper arm"):
        checker.check(straight((0, 0, 0), (1, 0, 0)), {"right_upper_arm": IDENTITY})


@pytest.mark.parametrize("points", [11, 150])
def test_gripping_links_are_left_out_near_the_grips_only(points):
    finger = Obstacle("finger", Sphere(0.01), link="hand")
    elbow = Obstacle("elbow", Sphere(0.01), link="forearm")
    cable = straight((0, 0, 0), (1, 0, 0), points)
    keywords = {"radius": RADIUS, "robot_links": [finger, elbow], "gripping_links": ["hand"], "horizon": 1.0}
    checker = ClearanceChecker(Scene(), **keywords, grip_exclusion=0.07)
    at_grip = {"hand": Pose((0, 0, 0.01)), "forearm": Pose((0, 0, 0.01))}
    hand, forearm = checker.check(cable, at_grip).bodies
    assert forearm.distance == pytest.approx(-RADIUS), "other links count everywhere"
    assert hand.arc_length == pytest.approx(0.07)
    assert hand.distance == pytest.approx(math.hypot(0.07, 0.01) - 0.01 - RADIUS)
    at_end = {"hand": Pose((1.0, 0, 0.01)), "forearm": IDENTITY}
    assert checker.check(cable, at_end).bodies[0].arc_length == pytest.approx(0.93)
    in_the_middle = {"hand": Pose((0.5, 0, 0.02)), "forearm": IDENTITY}
    assert checker.check(cable, in_the_middle).bodies[0].distance == pytest.approx(0.01 - RADIUS)
    everything = ClearanceChecker(Scene(), **keywords, grip_exclusion=0.0)
    assert everything.check(cable, at_grip).bodies[0].distance == pytest.approx(-RADIUS)


# --- what is refused or not judged ------------------------------------------------------------------------------------


@pytest.mark.parametrize("status", [Status.NOT_CONVERGED, Status.BUDGET_EXCEEDED])
def test_a_shape_that_is_none_is_not_judged(status):
    scene = Scene([Obstacle("post", Sphere(0.05))])
    cable = shape_through([(0, 0, 1.0), (math.nan, 0, 0)], status)
    found = ClearanceChecker(scene, radius=RADIUS).check(cable, {})
    assert found.bodies == ()
    assert found.beyond == 0.0
    assert not found.robot_checked


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("where", [0, 7, 19])
def test_positions_that_are_not_finite_are_refused(value, where):
    cable = straight((0, 0, 0), (1, 0, 0), 20)
    cable.positions[where, 1] = value
    with pytest.raises(ArgumentError, match=r"shape\.positions.*finite"):
        ClearanceChecker(Scene([Obstacle("floor", HalfSpace())]), radius=RADIUS).check(cable)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"radius": -0.001}, r"radius = -0\.001 .*at least 0 m"),
        ({"radius": RADIUS, "horizon": 0.02}, r"horizon = 0\.02 .*at least 0\.03 m"),
        ({"radius": RADIUS, "grip_exclusion": math.nan}, r"grip_exclusion = nan .*finite"),
        ({"radius": RADIUS, "robot_links": [Obstacle("arm", Sphere(0.1))]}, r"arm\.link = None"),
    ],
)
def test_bad_arguments(keywords, message):
    with pytest.raises(ArgumentError, match=message):
        ClearanceChecker(Scene(), **keywords)


def test_a_mesh_without_area_is_refused():
    flat = Obstacle("sliver", Mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)]))
    with pytest.raises(ArgumentError, match=r"sliver.*no triangle with an area"):
        ClearanceChecker(Scene([flat]), radius=RADIUS)
