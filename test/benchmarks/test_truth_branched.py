"""Branched cables by motion capture: how frames become observations, and what is reached where they are here."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from branched_data import BRANCHED, load, objects
from branched_recordings import recorded as whole_recordings
from scipy.spatial.transform import Rotation
from truth_branched import (
    CALM,
    STRAIGHT,
    calibrated,
    calibrated_rolled,
    fit_of,
    off,
    rolled,
    straight,
    table,
    turned,
)

import cable_shape as cs

recorded = pytest.mark.skipif(
    not BRANCHED.is_dir(), reason=f"no recordings of branched cables at {'/'.join(BRANCHED.parts[-3:])}"
)
#: Vertices: seven of the parent, two of child a at the third, two of child b at the first of a.
ARM = [0] * 7 + [1] * 2 + [2] * 2
ARC = np.array([0.0, 0.03, 0.2, 0.35, 0.5, 0.67, 0.7, 0.08, 0.16, 0.07, 0.14])
ANGLES = (1.4, -1.1)


def aside(angle: float) -> cs.Pose:
    return cs.Pose(quaternion=(math.sin(0.5 * angle), 0.0, 0.0, math.cos(0.5 * angle)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One object of which a known harness is the truth, second child on the first one."""
    cable = cs.Cable(length=0.32, linear_density=0.05, bending_stiffness=2e-3 * 0.05 * 9.81)
    lengths = {"p0": 0.32, "p1": 0.32, "a0": 0.08, "a1": 0.08, "b0": 0.14}
    joints = [
        cs.Junction("j", ("p0.end", "p1.start", "a0.start"), frames={"a0.start": aside(ANGLES[0])}),
        cs.Junction("k", ("a0.end", "a1.start", "b0.start"), frames={"b0.start": aside(ANGLES[1])}),
    ]
    true = cs.Harness({name: cable.replace(length=length) for name, length in lengths.items()}, joints)
    rng, noise, frames = np.random.default_rng(0), np.random.default_rng(1), []

    def seen(*markers: np.ndarray) -> np.ndarray:
        """As a camera sees them: what has no noise at all is fitted until rounding decides when it ends."""
        return np.array(markers) + 1e-4 * noise.normal(size=(len(markers), 3))

    for _ in range(6):
        turns = [
            Rotation.from_rotvec(0.3 * rng.normal(size=3)) * Rotation.from_quat((0.5, 0.5, 0.5, 0.5)) for _ in "ab"
        ]
        far = np.array((0.45, 0.0, 0.0)) + 0.05 * rng.normal(size=3)
        ends = [cs.Pose(x, q.as_quat()) for x, q in zip((np.zeros(3), far), turns, strict=True)]
        grips = {end: cs.Grip(pose, "swivel") for end, pose in zip(("p0.start", "p1.end"), ends, strict=True)}
        shape = cs.predict(true, grips, points=321)

        def at(name: str, s: float, shape: cs.HarnessShape = shape) -> np.ndarray:
            one = shape.segments[name]
            return np.array([np.interp(s, one.arc_length, x) for x in one.positions.T])

        before, beyond = -0.03 * turns[0].as_matrix()[:, 2], far + 0.03 * turns[1].as_matrix()[:, 2]
        frames.append([
            before, np.zeros(3), *seen(at("p0", 0.17), at("p0", 0.32), at("p1", 0.15)), far, beyond,
            *seen(at("a0", 0.08), at("a1", 0.08), at("b0", 0.07), at("b0", 0.14)),
        ])  # fmt: skip
    table = np.zeros((11, 3))
    table[:7, 0] = ARC[:7]
    table[7:9] = [(0.35, -0.08, 0.0), (0.35, -0.16, 0.0)]
    table[9:] = [(0.35 + 0.07, -0.08, 0.0), (0.35 + 0.14, -0.08, 0.0)]
    out = tmp_path_factory.mktemp("branched")
    np.savez(
        out / "made_frames.npz", frames=np.array(frames), acc=np.zeros((6, 11, 3)), arc=np.array([ARC]),
        take=np.zeros(6, dtype=int), arm=np.array(ARM), arm_start=np.array([-1, 3, 7]), grips=np.array([0, 1, 5, 6]),
        prev=np.array([-1, 0, 1, 2, 3, 4, 5, 3, 7, 7, 9]), traj=np.arange(6), kind=np.array(["calm"] * 6),
        split=np.array(["train"] * 6), parent_length=0.7, rest_markers=table,
    )  # fmt: skip
    return out


def test_a_frame_becomes_an_observation_of_its_harness(folder: Path) -> None:
    assert objects(folder) == ["made"]
    frames = load("made", 3, folder)
    assert frames.runs == ("p0+p1", "a0+a1", "b0")
    assert frames.branches == ("a0.start", "b0.start")
    assert [one.ends for one in frames.harness.junctions] == [
        ("p0.end", "p1.start", "a0.start"), ("a0.end", "a1.start", "b0.start"),
    ]  # fmt: skip
    assert frames.static[0].lengths == pytest.approx({"p0": 0.32, "p1": 0.32, "a0": 0.08, "a1": 0.08, "b0": 0.14})
    assert [len(x) for x in frames.static[0].points.values()] == [3, 2, 2]
    assert frames.angles.mean(axis=0) == pytest.approx(ANGLES, abs=0.25)  # first edges sag
    assert set(frames.part) == {0, 1, 2}


def test_the_harness_that_was_put_in_is_found_and_straight_lines_are_far_off(folder: Path) -> None:
    frames = load("made", 3, folder)
    learn, judged = frames.where(CALM, 0, False), frames.where(CALM, 0, True)
    fit = ("bending_stiffness", *(f"tilt:{end}" for end in frames.branches))
    seen = [frames.static[i] for i in learn]
    found = cs.calibrate(seen, frames.measured(learn))
    for _ in range(4):  # a long valley: how many iterations it takes hangs on rounding
        found = cs.calibrate(seen, found.harness, fit)
        if found.converged:
            break
    assert found.converged
    assert found["bending_stiffness"].value == pytest.approx(2e-3 * 0.05 * 9.81, rel=0.02)
    assert off(found, [frames.moving[i] for i in judged]).max() < 1e-3
    assert straight(frames, judged).min() > 0.02


def test_all_that_is_calibrated_may_be_fitted(folder: Path) -> None:
    frames = load("made", 3, folder)
    fit, priors = fit_of(frames)
    assert "tilt:p0.start" in fit
    found = cs.calibrate(frames.static[:2], frames.measured(np.arange(6)), fit, priors=priors)
    assert np.nanmean(found.distances) < 2e-3


def test_the_table_has_a_cell_for_every_object_and_row(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = load("made", 3, folder)
    one = cs.calibrate(frames.static[:2], frames.measured(np.arange(6)))
    more = {"groups": np.arange(4), "fits": [(one, one)], "times": [1.25], "frames": frames}
    lost = np.where(np.arange(4)[:, None] == 1, np.nan, np.full((4, 3), 2.0))
    both = {STRAIGHT: np.full((4, 3), 20.0), "more": lost}
    table({"made": {"rows": both, **more}, "other": {"rows": {STRAIGHT: np.ones((2, 3))}, **more}})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "|  | made | other |"
    assert said[2] == "| straight lines | 20.00 (20.00, 20.00) | 1.00 (1.00, 1.00) |"
    assert "| frames without a usable shape: more | 1 | 0 |" in said
    assert {line.count("|") for line in said} == {4}


@recorded
def test_one_stiffness_and_a_calibration_on_trajectories_not_fitted() -> None:
    """Mean distance of free vertices, % of the parent's length: bounds a little above what the bench prints."""
    frames = load("bdlo5", 3)
    learn, judged = frames.where(CALM, 0, False)[::4], frames.where(CALM, 0, True)[::2]
    one, found = calibrated(frames, learn)
    seen = [frames.static[i] for i in judged]
    means = [
        100.0 * x[:, 0].mean() / frames.length for x in (straight(frames, judged), off(one, seen), off(found, seen))
    ]
    assert means[0] > 15.0
    assert means[1] < 5.5
    assert means[2] < 2.0


@recorded
def test_the_object_held_in_its_middle_hangs_from_a_clip() -> None:
    frames = load("bdlo3_mid", 3)
    assert list(frames.static[0].ends) == ["p2.end"]
    (clip,) = frames.static[0].scene.clips
    assert clip.segment == "p0"
    assert 0.15 < clip.arc_length < frames.static[0].lengths["p0"]


@recorded
def test_calm_frames_of_recordings_are_those_of_the_same_object() -> None:
    """Mean distances, % of the parent's length: what one EI/w reaches on frames that nobody chose."""
    found = whole_recordings("bdlo3", BRANCHED)
    assert found is not None
    seen, inside = found
    frames = load("bdlo3", 3)
    assert set(inside) <= set(frames.traj)
    assert set(seen.traj) == {0, 1}
    assert seen.static[0].ends.keys() == frames.static[0].ends.keys()
    learn = np.flatnonzero(np.isin(frames.kind, CALM) & ~np.isin(frames.traj, inside))[::4]
    one = cs.calibrate([frames.static[i] for i in learn], frames.measured(learn))
    scale = 100.0 / frames.length
    assert scale * straight(seen, np.arange(len(seen.static)))[:, 0].mean() > 15.0
    assert scale * off(one, seen.static[::4])[:, 0].mean() < 2.8
    assert whole_recordings("bdlo4", BRANCHED) is None


def test_rolls_of_the_grips_are_fitted_about_those_of_tools_that_turn_little(folder: Path) -> None:
    frames = load("made", 3, folder)
    one = cs.calibrate(frames.static, frames.measured(np.arange(6)))
    found, roll = rolled(one, frames.static[:3])
    assert {name for name in found.parameters.names if name.startswith("roll:")} == {"roll:p0.start", "roll:p1.end"}
    assert np.isfinite(off(found, [turned(frames.static[5], roll)])).all()
    both, as_there = calibrated_rolled(frames, np.arange(3), found, roll)
    assert {"tilt:p0.start", "roll:p0.start"} <= set(both.parameters.names)
    assert off(both, [as_there(frames.moving[4])]).max() < 0.05


def test_branched_cables_are_found_below_the_folder_of_all_recordings(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import bench_truth

    (tmp_path / "branched").symlink_to(folder, target_is_directory=True)
    judged = []

    def judge(figures: object, quick: bool, where: Path) -> dict[str, object]:
        judged.append(where)
        return {}

    monkeypatch.setattr(bench_truth, "branched", judge)
    monkeypatch.setattr(bench_truth.cs, "warm_up", lambda: None)
    for given in (tmp_path, tmp_path / "branched"):
        monkeypatch.setattr("sys.argv", ["bench_truth", "--branched", "--data", str(given)])
        bench_truth.main()
    assert judged == [tmp_path / "branched"] * 2
