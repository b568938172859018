"""Real cables, where their recordings are on this machine: inertial load and calibration bring the error down."""

import numpy as np
import pytest
from truth_data import DATA, carried, load, recording, shares
from truth_limits import RATIOS, least, mean_error

import cable_shape as cs
from cable_shape.replay.observations import load_observations

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


@recorded
def test_calm_frames_of_a_recording_are_judged_too() -> None:
    frames = load(5, 3)
    still, moving = recording(5, 0, frames.calm)
    assert 100 < len(still) == len(moving) < 500
    weight = frames.cable.linear_density * 9.81
    means = [least(seen[::10], frames.cable)[0] / frames.cable.length for seen in (still, moving)]
    assert means[1] < 0.7 * means[0]
    assert least(moving[::10], frames.cable.replace(bending_stiffness=weight))[0] == pytest.approx(
        means[1] * frames.cable.length, rel=1e-3
    )


def test_the_error_of_a_mean_counts_trajectories() -> None:
    values = np.random.default_rng(2).normal(size=300)
    alone = mean_error(values, np.arange(300))
    assert alone == pytest.approx(values.std(ddof=1) / np.sqrt(300.0))
    assert mean_error(np.repeat(values, 5), np.repeat(np.arange(300), 5)) == pytest.approx(alone)


def test_no_stiffness_is_better_than_the_best() -> None:
    true = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=float(RATIOS[40]) * 0.05 * 9.81)
    ends = [cs.Grip(cs.Pose((x, 0.0, 1.0), (0.5, 0.5, 0.5, 0.5))) for x in (0.0, 0.6, 0.8)]
    seen = [
        cs.Observation(ends[0], end, cs.predict(true, ends[0], end, model="cosserat").positions[10:-10:13])
        for end in ends[1:]
    ]
    distance, ratio = least(seen, true.replace(bending_stiffness=1.0, twisting_stiffness=None))
    assert ratio == RATIOS[40]
    assert distance < 1e-5


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
