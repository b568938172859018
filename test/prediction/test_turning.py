"""How the cable frame turns with the grips, beside differences of predictions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import cable_shape as cs

CABLE = cs.Cable(
    length=1.0,
    linear_density=0.1,
    bending_stiffness=(0.02, 0.008),
    twisting_stiffness=0.006,
    rest_curvature=(0.5, -0.3, 0.8),
    diameter=0.008,
)
START = cs.Pose((0.0, 0.0, 1.0), (0.5, 0.5, 0.5, 0.5))
END = cs.Pose((0.7, 0.1, 1.05), (0.55, 0.42, 0.5, 0.52))
BELOW = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.8)))
CLIPPED = cs.Scene(clips=[cs.Clip(0.45, cs.Pose((0.35, 0.05, 0.85), (0.5, 0.5, 0.5, 0.5)), "hinge")])
STEP = 1e-4


def moved(pose: cs.Pose, axis: int, step: float) -> cs.Pose:
    """By a velocity, or an angular velocity about its origin, along an axis of the world."""
    by = step * np.eye(3)[axis % 3]
    if axis < 3:
        return cs.Pose(pose.position + by, pose.quaternion)
    return cs.Pose(pose.position, (Rotation.from_rotvec(by) * Rotation.from_quat(pose.quaternion)).as_quat())


@pytest.mark.parametrize("scene", [None, CLIPPED, cs.Scene(obstacles=[BELOW], contact="solve")])
@pytest.mark.parametrize("arc_length", [0.0, 0.3371, 0.45, 0.82, 1.0])
def test_turning_is_that_of_differences(scene: cs.Scene | None, arc_length: float) -> None:
    keywords = {"model": "cosserat", "scene": scene, "tolerance": 1e-8, "points": 401}
    predictor = cs.Predictor(CABLE, **keywords)
    end = cs.Grip(END, offset=cs.Pose((0.02, 0.0, 0.05), (0.0, 0.1, 0.0, 0.994987)))
    predictor.predict(START, end)

    def frame(start: cs.Pose, pose: cs.Pose) -> Rotation:
        shape = predictor.ahead()(cs.Grip(start), cs.Grip(pose, offset=end.offset))
        return Slerp(shape.arc_length, Rotation.from_quat(shape.quaternions))(arc_length)

    here, columns = frame(START, END), []
    for which in range(2):
        for axis in range(6):
            sides = []
            for sign in (-STEP, STEP):
                poses = [START, END]
                poses[which] = moved(poses[which], axis, sign)
                sides.append((here.inv() * frame(*poses)).as_rotvec())
            columns.append((sides[1] - sides[0]) / (2.0 * STEP))
    found = predictor.turning(arc_length, at="gripper")
    assert np.abs(found).max() > 0.5
    np.testing.assert_allclose(found, np.stack(columns, axis=1), atol=2e-3)


def test_what_has_no_turning_is_refused() -> None:
    predictor = cs.Predictor(CABLE)
    with pytest.raises(cs.ArgumentError, match=r"turning\(\) needs a solution.*Call predict first"):
        predictor.turning(0.5)
    predictor.predict(START, None)
    assert (predictor.turning(1.0)[:, 6:] == 0.0).all()
    assert np.abs(predictor.turning(1.0)[:, :3]).max() < 1e-9  # carried along as it is
    assert np.abs(predictor.turning(1.0)[:, 3:6]).max() > 0.5
    for arc_length, said in ((1.5, r"at most 1 m"), (np.nan, "finite"), (-0.1, "at least 0")):
        with pytest.raises(cs.ArgumentError, match=said):
            predictor.turning(arc_length)
    ring = cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.35, 0.05, 0.8)), "slide")])
    predictor = cs.Predictor(CABLE, scene=ring)
    predictor.predict(START, END)
    with pytest.raises(cs.ArgumentError, match="not known with clips of kind 'slide'"):
        predictor.turning(0.5)
    closed = cs.Predictor(CABLE.replace(rest_curvature=(0, 0, 0)), model="catenary")
    closed.predict(START, END)
    with pytest.raises(cs.ArgumentError, match="turning needs the Cosserat rod"):
        closed.turning(0.5)
