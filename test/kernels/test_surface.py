"""The surface that a cable touches, against finite differences and brute force."""

from __future__ import annotations

import numpy as np
import pytest

from cable_shape.kernels.distance import surface
from cable_shape.kernels.distance.triangles import STACK_SIZE
from cable_shape.pose import Pose
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Obstacle, Scene, Sphere

POSE = Pose((0.1, -0.2, 0.3), np.array((0.2, -0.4, 0.5, 0.7)) / np.linalg.norm((0.2, -0.4, 0.5, 0.7)))
TETRAHEDRON = Mesh(
    [(0.1, 0.1, 0.1), (-0.1, -0.1, 0.1), (-0.1, 0.1, -0.1), (0.1, -0.1, -0.1)],
    [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)],
)
SHEET = Mesh([(0, 0, 0), (0.3, 0, 0), (0, 0.3, 0)], [(0, 1, 2)])
SOLIDS = {
    "half-space": HalfSpace(),
    "box": Box((0.2, 0.3, 0.1)),
    "sphere": Sphere(0.1),
    "capsule": Capsule(0.05, 0.2),
    "cylinder": Cylinder(0.08, 0.2),
    "closed mesh": TETRAHEDRON,
    "open mesh": SHEET,
}


class Touch:
    """The kernel on one body."""

    def __init__(self, solid, pose=POSE) -> None:
        checker = ClearanceChecker(Scene(obstacles=[Obstacle("body", solid, pose)]), radius=0.0)
        self.bodies, self.triangles, self.nodes = checker.tables
        self.frames = np.empty((1, 4, 3))
        surface.place_bodies(self.bodies, np.empty((0, 7)), self.frames)
        self.stack = np.empty(STACK_SIZE, np.int64)

    def __call__(self, at, side=(0.0, 0.0, 0.0)):
        d, n, H = surface.touch(
            self.bodies[0], self.frames[0], self.triangles, self.nodes, tuple(map(float, at)), side, True, self.stack
        )
        return d, np.array(n), np.array(H).reshape(3, 3)


@pytest.mark.parametrize("name", SOLIDS)
def test_normal_and_hessian_are_the_derivatives_of_the_distance(name):
    touch, rng = Touch(SOLIDS[name]), np.random.default_rng(3)
    step, compared = 1e-5, 0
    for at in POSE.position + rng.uniform(-0.35, 0.35, (150, 3)):
        d, n, H = touch(at)
        if d < 0.01:
            continue
        slope, second = np.empty(3), np.empty((3, 3))
        for i, e in enumerate(step * np.eye(3)):
            (up, n_up, _), (down, n_down, _) = touch(at + e), touch(at - e)
            slope[i] = (up - down) / (2 * step)
            second[i] = (n_up - n_down) / (2 * step)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
        assert np.abs(H @ n).max() < 1e-9
        if np.abs(second - second.T).max() > 1e-3:  # the step reaches into another feature's region
            continue
        compared += 1
        assert slope == pytest.approx(n, abs=1e-5)
        assert second == pytest.approx(H, abs=3e-4 * max(1.0, 1 / d))
    assert compared > 50


@pytest.mark.parametrize("name", SOLIDS)
def test_the_box_around_a_body_bounds_its_distance_from_below(name):
    touch, rng = Touch(SOLIDS[name]), np.random.default_rng(4)
    of_body, missed = (touch.bodies[0], touch.frames[0]), []
    for at in POSE.position + rng.uniform(-0.3, 0.3, (300, 3)):
        d, n, _ = touch(at)
        least = surface.at_least(*of_body, tuple(at.tolist()))
        assert least <= d + 1e-12
        missed.append(d - least)
        if "mesh" not in name:
            plain, outward = surface.outward(*of_body, tuple(at.tolist()))
            assert plain == d
            assert np.array_equal(outward, n)
    assert min(missed) < 0.02  # it is no bound that nothing comes near
    assert name != "half-space" or max(missed) == 0.0


def test_inside_round_bodies_the_curvature_is_that_of_the_level_surface():
    for solid, at in ((Sphere(0.1), np.array((0.03, 0.02, 0.04))), (Capsule(0.1, 0.2), np.array((0.03, 0.02, 0.05)))):
        touch = Touch(solid, Pose())
        _, n, H = touch(at)
        step = np.array((1e-5, 0, 0))
        up, down = touch(at + step), touch(at - step)
        assert (up[1] - down[1]) / 2e-5 == pytest.approx(H[0], abs=1e-6)
        assert np.abs(H @ n).max() < 1e-12


def test_a_mesh_measures_as_the_nearest_of_many_points_on_it():
    touch, rng = Touch(TETRAHEDRON, Pose()), np.random.default_rng(5)
    corners = TETRAHEDRON.vertices[TETRAHEDRON.faces]
    weights = rng.dirichlet((1, 1, 1), 40_000)
    cloud = np.concatenate([weights @ c for c in corners])
    for at in rng.uniform(-0.3, 0.3, (20, 3)):
        d, n, _ = touch(at)
        nearest = np.linalg.norm(cloud - at, axis=1).min()
        assert abs(d) == pytest.approx(nearest, abs=3e-3)
        assert abs(touch(at - d * n)[0]) < 1e-12


def test_the_side_of_a_sheet_and_of_a_plate_is_remembered():
    sheet = Touch(SHEET, Pose())
    d, n, _ = sheet((0.05, 0.05, -0.002), (0.0, 0.0, 1.0))
    assert d == pytest.approx(-0.002)
    assert n == pytest.approx((0, 0, 1))
    plate = Touch(Box((1.0, 1.0, 0.004)), Pose())
    assert plate((0.0, 0.0, -0.001))[1] == pytest.approx((0, 0, -1))
    d, n, _ = plate((0.0, 0.0, -0.001), (0.0, 0.0, 1.0))
    assert d == pytest.approx(-0.003)
    assert n == pytest.approx((0, 0, 1))
