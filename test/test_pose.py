"""Poses, grips and free ends: algebra against scipy, refusals by name."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.pose import multiply, rotate

SETTINGS = settings(derandomize=True, deadline=None, max_examples=60)
numbers = st.floats(-10.0, 10.0)
vectors = st.tuples(numbers, numbers, numbers)


@st.composite
def unit_quaternions(draw: st.DrawFn) -> np.ndarray:
    q = np.array(draw(st.tuples(numbers, numbers, numbers, numbers)))
    n = np.linalg.norm(q)
    return q / n if n > 1e-3 else np.array((0.0, 0.0, 0.0, 1.0))


@SETTINGS
@given(unit_quaternions(), unit_quaternions(), vectors)
def test_quaternion_algebra_agrees_with_scipy(p: np.ndarray, q: np.ndarray, v: tuple[float, float, float]) -> None:
    P, Q = Rotation.from_quat(p), Rotation.from_quat(q)
    np.testing.assert_allclose(rotate(p, np.array(v)), P.apply(v), atol=1e-12)
    product = multiply(p, q)
    np.testing.assert_allclose(Rotation.from_quat(product).as_matrix(), (P * Q).as_matrix(), atol=1e-12)


@SETTINGS
@given(unit_quaternions(), vectors, unit_quaternions(), vectors)
def test_composition_and_inverse_agree_with_matrices(
    p: np.ndarray, a: tuple[float, float, float], q: np.ndarray, b: tuple[float, float, float]
) -> None:
    A, B = cs.Pose(a, p), cs.Pose(b, q)
    np.testing.assert_allclose((A * B).matrix(), A.matrix() @ B.matrix(), atol=1e-11)
    np.testing.assert_allclose((A * A.inverse()).matrix(), np.eye(4), atol=1e-11)


def test_nearly_unit_quaternion_is_normalised_and_others_are_refused() -> None:
    rounded = cs.Pose((0, 0, 0), (0, 0.7071, 0, 0.7071))
    assert math.isclose(float(np.linalg.norm(rounded.quaternion)), 1.0, abs_tol=1e-15)
    for bad in [(0, 0, 0, 0), (0, 0, 0, 1.0011), (0, 0, 0, 0.9989)]:
        with pytest.raises(cs.ArgumentError, match=r"quaternion = .*within 0.001 of 1.*Normalise it"):
            cs.Pose((0, 0, 0), bad)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_non_finite_entries_are_refused_by_name(bad: float) -> None:
    with pytest.raises(cs.ArgumentError, match=r"position = .*finite"):
        cs.Pose((0, bad, 0))
    with pytest.raises(cs.ArgumentError, match=r"quaternion = .*finite"):
        cs.Pose((0, 0, 0), (0, bad, 0, 1))
    with pytest.raises(cs.ArgumentError, match=r"curvature = .*finite"):
        cs.Grip(cs.Pose(), curvature=(bad, 0, 0))
    with pytest.raises(cs.ArgumentError, match=r"force = .*finite"):
        cs.FreeEnd(force=(bad, 0, 0))


def test_wrong_shapes_kinds_and_types_are_refused_by_name() -> None:
    with pytest.raises(cs.ArgumentError, match=r"position = .*shape \(3,\)"):
        cs.Pose((0, 0))
    with pytest.raises(cs.ArgumentError, match=r"position = 'here'.*3 numbers"):
        cs.Pose("here")
    with pytest.raises(cs.ArgumentError, match=r"kind = 'glued'.*clamped, swivel, pinned"):
        cs.Grip(cs.Pose(), kind="glued")
    with pytest.raises(cs.ArgumentError, match=r"mass = -0.1.*at least 0 kg"):
        cs.FreeEnd(mass=-0.1)
    with pytest.raises(cs.ArgumentError, match=r"turns = 0.5.*whole number"):
        cs.Pose(turns=0.5)


def test_offset_turns_a_crosswise_gripper_onto_the_tangent() -> None:
    # The tool's x axis points along the cable; the offset makes it the cable frame's third axis.
    offset = cs.Pose((0.0, 0.0, 0.1), Rotation.from_euler("y", 90, degrees=True).as_quat())
    grip = cs.Grip(cs.Pose((1.0, 2.0, 3.0), Rotation.from_euler("z", 90, degrees=True).as_quat()), offset=offset)
    np.testing.assert_allclose(grip.cable_frame.matrix()[:3, 2], (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(grip.cable_frame.position, (1.0, 2.0, 3.1), atol=1e-12)
    assert grip.at(cs.Pose()).cable_frame == offset


def test_pose_is_fixed_and_does_not_share_the_callers_array() -> None:
    given_position = np.array((1.0, 2.0, 3.0))
    pose = cs.Pose(given_position)
    given_position[0] = 9.0
    assert pose.position[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        pose.position[0] = 5.0
