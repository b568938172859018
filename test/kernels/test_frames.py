"""Parallel transport against the closed form on a helix, and the roll against plain rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_shape.kernels import frames

#: A helix of radius 0.3 m and this rise per radian, 1.5 turns, by arc length.
RADIUS, RISE = 0.3, 0.2
SPEED = np.hypot(RADIUS, RISE)
CURVATURE, TORSION = RADIUS / SPEED**2, RISE / SPEED**2
LENGTH = 3.0 * np.pi * SPEED


def helix(points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tangents (3, n), curvature vectors (3, n) and t . (t' x t'') (n,) of the helix."""
    angle = np.linspace(0.0, LENGTH, points) / SPEED
    tangents = np.stack((-RADIUS * np.sin(angle), RADIUS * np.cos(angle), np.full(points, RISE))) / SPEED
    bend = -CURVATURE * np.stack((np.cos(angle), np.sin(angle), np.zeros(points)))
    return tangents, bend, np.full(points, CURVATURE**2 * TORSION)


def start_frame(tangent: np.ndarray) -> np.ndarray:
    """A frame whose d3 is `tangent`."""
    q = np.array((0.1, -0.5, 0.3, 0.8))
    q /= np.linalg.norm(q)
    frames.align(q, *tangent)
    return q


def carried(points: int, corrected: bool = True) -> np.ndarray:
    """(n, 4) the frames along the helix."""
    tangents, _, turning = helix(points)
    out = np.empty(4 * points)
    out[:4] = start_frame(tangents[:, 0])
    frames.transport(tangents, turning if corrected else 0.0 * turning, LENGTH / (points - 1), out)
    return out.reshape(points, 4)


def exact_last_frame(points: int) -> Rotation:
    """A twist-free frame turns by minus the integral of the torsion with respect to the Frenet frame."""
    tangents, bend, _ = helix(points)
    frenet = [
        Rotation.from_matrix(
            np.stack((bend[:, k] / CURVATURE, np.cross(tangents[:, k], bend[:, k]) / CURVATURE, tangents[:, k]), axis=1)
        )
        for k in (0, -1)
    ]
    first = Rotation.from_quat(start_frame(tangents[:, 0]))
    return frenet[1] * Rotation.from_rotvec((0.0, 0.0, -TORSION * LENGTH)) * frenet[0].inv() * first


def test_a_frame_carried_along_a_helix_does_not_twist() -> None:
    error = (exact_last_frame(200).inv() * Rotation.from_quat(carried(200)[-1])).magnitude()
    assert error < 1e-6
    # without the correction the error is of 2nd order, with it of 4th
    plain = [(exact_last_frame(n).inv() * Rotation.from_quat(carried(n, False)[-1])).magnitude() for n in (101, 201)]
    fine = [(exact_last_frame(n).inv() * Rotation.from_quat(carried(n)[-1])).magnitude() for n in (101, 201)]
    assert 3.5 < plain[0] / plain[1] < 4.5
    assert 13.0 < fine[0] / fine[1] < 19.0


def test_frames_follow_the_tangents_and_stay_unit() -> None:
    tangents, _, _ = helix(150)
    q = carried(150)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-13)
    np.testing.assert_allclose(Rotation.from_quat(q).apply((0.0, 0.0, 1.0)), tangents.T, atol=1e-12)


def test_the_darboux_vector_is_that_of_the_curve() -> None:
    tangents, bend, _ = helix(150)
    q = carried(150)
    curvature = np.empty(450)
    frames.darboux(bend, q.ravel(), curvature)
    world = Rotation.from_quat(q).apply(curvature.reshape(-1, 3))
    np.testing.assert_allclose(world, np.cross(tangents.T, bend.T), atol=1e-12)
    np.testing.assert_array_equal(curvature[2::3], 0.0)


def test_a_reversed_tangent_turns_the_frame_by_half_a_turn() -> None:
    tangents = np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, -1.0, -1.0)))
    out = np.zeros(12)
    out[3] = 1.0
    frames.transport(tangents, np.zeros(3), 0.1, out)
    turned = Rotation.from_quat(out.reshape(3, 4))
    np.testing.assert_allclose(turned.apply((0.0, 0.0, 1.0)), tangents.T, atol=1e-14)
    np.testing.assert_allclose(turned.apply((1.0, 0.0, 0.0)), np.tile((1.0, 0.0, 0.0), (3, 1)), atol=1e-14)


@pytest.mark.parametrize("angle", [-3.0, -1.0, 0.0, 1e-9, 2.5, np.pi])
def test_roll_is_the_angle_about_the_tangent(angle: float) -> None:
    p = Rotation.from_quat((0.3, -0.2, 0.7, 0.4))
    q = p * Rotation.from_rotvec((0.0, 0.0, angle))
    assert frames.roll(p.as_quat(), q.as_quat()) == pytest.approx(angle, abs=1e-14)
    assert frames.roll(p.as_quat(), -q.as_quat()) == pytest.approx(angle, abs=1e-14)


def test_the_straight_line_is_finite_and_meets_both_ends() -> None:
    start = np.array((0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0))
    end = np.array((0.1, 0.2, -1.3, 0.0, 0.0, 0.6, 0.8))
    buffer = np.full(17 * 5, np.nan)
    frames.straight(start, end, 1.0, 5, buffer)
    assert np.isfinite(buffer).all()
    np.testing.assert_allclose(buffer[5:20].reshape(5, 3), np.linspace(start[:3], end[:3], 5), atol=1e-15)
    tangents = Rotation.from_quat(buffer[20:40].reshape(5, 4)).apply((0.0, 0.0, 1.0))
    np.testing.assert_allclose(tangents, np.tile((0.0, 0.0, -1.0), (5, 1)), atol=1e-14)
