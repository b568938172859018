"""Real cables, where their recordings are on this machine: inertial load and calibration bring the error down."""

import sys
from pathlib import Path

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.calibration.sources import load_observations

sys.path.append(str(Path(__file__).resolve().parents[1] / "scripts"))
from truth_data import DATA, carried, load, shares

recorded = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recordings of real cables at {DATA.parent.name}/{DATA.name}"
)


@recorded
@pytest.mark.parametrize(("number", "still", "moving"), [(2, 1.8, 1.8), (4, 3.0, 1.6)])
def test_errors_on_trajectories_not_fitted(number: int, still: float, moving: float) -> None:
    """Mean distance of inner markers, % of the length: bounds a little above what the bench of all frames prints."""
    frames = load(number, 3)
    learn, judge = frames.where(("quasi",), 0, False)[::2], frames.where(("quasi",), 0, True)
    for observations, bound in ((frames.static, still), (frames.moving, moving)):
        found = cs.calibrate([observations[i] for i in learn], frames.cable)
        assert found.converged
        left = cs.calibrate([observations[i] for i in judge], found.cable, priors={"bending_stiffness": 1e-6})
        assert 100.0 * float(np.nanmean(left.distances)) / frames.cable.length < bound


@recorded
def test_inertial_load_explains_moderate_motion() -> None:
    frames = load(4, 3)
    which = np.flatnonzero(frames.kind == "moderate")[::3]
    still = cs.calibrate([frames.static[i] for i in which], frames.cable)
    moving = cs.calibrate([frames.moving[i] for i in which], frames.cable)
    assert np.nanmean(moving.distances) < 0.5 * np.nanmean(still.distances)


@recorded
def test_a_recording_calibrates_with_its_own_accelerations() -> None:
    cable = load(4, 3).cable
    seen = load_observations(DATA / "cable4_recording0", ("clamped", "swivel"), inertia=True, frames=20)
    still = load_observations(DATA / "cable4_recording0", ("clamped", "swivel"), frames=20)
    found, worse = cs.calibrate(seen, cable), cs.calibrate(still, cable)
    assert 100.0 * np.nanmean(found.distances) / cable.length < 2.5
    assert np.nanmean(found.distances) < np.nanmean(worse.distances)


def test_parts_keep_trajectories_whole() -> None:
    traj = np.random.default_rng(0).integers(0, 30, 200)
    part = shares(traj, 4)
    assert all(len(set(part[traj == t])) == 1 for t in traj)
    assert np.bincount(part).min() > 35


def test_carried_frames_point_along_their_tangents() -> None:
    tangents = np.array((1.0, 0.2, -0.1)) + 0.4 * np.random.default_rng(1).normal(size=(50, 3))
    from scipy.spatial.transform import Rotation

    axes = Rotation.from_quat(carried(tangents)).as_matrix()[:, :, 2]
    np.testing.assert_allclose(axes, tangents / np.linalg.norm(tangents, axis=1)[:, None], atol=1e-12)
