"""What must not change the Cosserat rod's shape: rigid motions, reversal, mirrors, units."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rods import ALONG_X, CABLE, LENGTH, START, moved, solved
from scipy.spatial.transform import Rotation

from cable_shape.cable.cable import Cable
from cable_shape.pose import Pose

numbers = st.floats(-1.0, 1.0)
turns = st.tuples(numbers, numbers, numbers).map(lambda v: 2.5 * np.array(v))
#: off the plane of gravity and the start, where two mirrored shapes would be equally good
spans = st.tuples(st.floats(0.3, 0.8), st.floats(0.1, 0.4), numbers).map(lambda v: np.array((v[0], v[1], 0.3 * v[2])))
grasps = settings(max_examples=12, deadline=None, derandomize=True)


def grasp(span, turn) -> tuple[Pose, Pose]:
    return START, moved(Pose(span, ALONG_X), turn=0.4 * turn)


@grasps
@given(span=spans, turn=turns, motion=turns)
def test_a_rigid_motion_of_everything_moves_the_shape(span, turn, motion):
    start, end = grasp(span, turn)
    shape = solved(CABLE, start, end, points=31, tolerance=1e-8)
    R, shift = Rotation.from_rotvec(motion), np.array((0.3, -2.0, 1.0))

    def carried(pose: Pose) -> Pose:
        return Pose(R.apply(np.array(pose.position)) + shift, (R * Rotation.from_quat(pose.quaternion)).as_quat())

    gravity = R.apply((0, 0, -9.81))
    other = solved(CABLE, carried(start), carried(end), points=31, gravity=gravity, tolerance=1e-8)
    assert other.positions == pytest.approx(R.apply(shape.positions) + shift, abs=2e-7)
    assert other.force == pytest.approx(R.apply(shape.force), abs=2e-5)


@grasps
@given(span=spans, turn=turns)
def test_the_reversed_cable_has_the_same_shape(span, turn):
    """Seen from the other end, d3 and one more axis change sign."""
    start, end = grasp(span, turn)
    shape = solved(CABLE, start, end, points=31, tolerance=1e-8)
    flip = Rotation.from_rotvec((math.pi, 0, 0))

    def reversed_end(pose: Pose) -> Pose:
        return Pose(pose.position, (Rotation.from_quat(pose.quaternion) * flip).as_quat())

    other = solved(CABLE, reversed_end(end), reversed_end(start), points=31, tolerance=1e-8)
    assert other.positions[::-1] == pytest.approx(shape.positions, abs=2e-7)


@grasps
@given(span=spans, turn=turns)
def test_the_mirrored_grasp_has_the_mirrored_shape(span, turn):
    """Mirrored in y: rotations turn the other way, d1 is reflected into its opposite."""
    start, end = grasp(span, turn)
    shape = solved(CABLE, start, end, points=31, tolerance=1e-8)
    mirror = np.diag((1.0, -1.0, 1.0))

    def mirrored(pose: Pose) -> Pose:
        R = Rotation.from_quat(pose.quaternion).as_matrix()
        return Pose(mirror @ pose.position, Rotation.from_matrix(mirror @ R @ np.diag((-1.0, 1.0, 1.0))).as_quat())

    other = solved(CABLE, mirrored(start), mirrored(end), points=31, tolerance=1e-8)
    assert other.positions == pytest.approx(shape.positions @ mirror, abs=2e-7)


@grasps
@given(span=spans, turn=turns, metre=st.floats(0.01, 100.0), newton=st.floats(0.001, 1000.0))
def test_units_scale_out(span, turn, metre, newton):
    start, end = grasp(span, turn)
    shape = solved(CABLE, start, end, points=31, tolerance=1e-7)
    cable = Cable(
        length=LENGTH * metre,
        linear_density=0.1 * newton / metre,
        bending_stiffness=0.01 * newton * metre**2,
        twisting_stiffness=0.008 * newton * metre**2,
    )
    scaled = Pose(end.position * metre, end.quaternion)
    other = solved(cable, start, scaled, points=31, tolerance=1e-7 * metre)
    assert other.positions / metre == pytest.approx(shape.positions, abs=1e-7)
    assert other.moment / (newton * metre) == pytest.approx(shape.moment, abs=1e-5)
