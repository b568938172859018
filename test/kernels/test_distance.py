"""Distances against references that share no code with the kernels."""

import itertools
import math

import fcl
import numpy as np
import pytest
from clearances import RADIUS, ball_mesh, box_mesh, few, measured, random_pose, seeds, shape_through, straight, wavy
from hypothesis import given, settings
from scipy.optimize import minimize_scalar, nnls

from cable_shape.kernels.distance.cable_near import node_at
from cable_shape.pose import Pose
from cable_shape.scene.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere


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


@given(seeds)
@few
def test_nodes_are_found_as_numpy_finds_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s = np.sort(rng.integers(0, 12, rng.integers(0, 20)) / 3.0)
    for x in (*s, *rng.uniform(-1.0, 5.0, 5)):
        assert node_at(s, x) == np.searchsorted(s, x)
