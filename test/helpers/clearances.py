"""What the tests of distances share: shapes through given points, meshes, and one measurement."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from cable_shape.pose import IDENTITY, Pose
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.report import BodyDistance
from cable_shape.scene.scene import Mesh, Obstacle, Scene
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
