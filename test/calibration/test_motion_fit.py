"""Cables fitted as they swing: numbers found again, free ends, points of unknown arc length, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import cable_shape as cs
from cable_shape.calibration.motion_forward import MotionForward, recordings_of
from cable_shape.calibration.parameters import Parameters
from cable_shape.command.cli import main

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
TRUE = cs.Cable(
    length=1.0, linear_density=0.06, bending_stiffness=0.004, twisting_stiffness=0.003, retardation_time=0.05, drag=0.03
)
KEPT = np.array((12, 25, 38, 50, 62, 75, 88))  # of 101 points
DT = 0.02
PARTS = 2  # of the time between two looks, in which the cable itself moves, as in a fit


def smooth(t: float, whole: float) -> float:
    """From 0 to 1 in the time `whole`, three times differentiable."""
    x = min(max(t / whole, 0.0), 1.0)
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def ends(group: int, t: float, free: bool = False) -> tuple[cs.Pose, cs.Pose | None]:
    """Grips of one of three motions: sideways, up and down, and both turned."""
    x = smooth(t - 2 * DT, 0.3)
    way = 0.15 * x * np.array(((0.0, 1.0, 0.0), (0.3, 0.0, 1.0), (0.0, 0.5, 0.4))[group])
    turn = (0.0, 0.0, np.sin(0.25 * x * group), np.cos(0.25 * x * group))
    start = cs.Pose(way, ALONG) * cs.Pose((0, 0, 0), turn)
    return start, None if free else cs.Pose((0.7, 0.0, 0.1 * group) + 0.6 * way, ALONG)


def recordings(groups: Sequence[int], looks: int = 30, free: bool = False, **keywords: Any) -> list[cs.Observation]:
    """What a camera sees of `TRUE` from rest on, every 20 ms, while its grips go their own way in between."""
    out = []
    for group in groups:
        motion = cs.Motion(TRUE, points=101)
        shape = motion.begin(*ends(group, 0.0, free))
        for k in range(looks):
            for part in range(PARTS if k > 1 else 0):  # two looks at rest, from which it begins
                shape = motion.step(*ends(group, (k - 1 + (part + 1) / PARTS) * DT, free), DT / PARTS)
            seen = {name: value(shape) for name, value in keywords.items()}
            start, end = ends(group, k * DT, free)
            out.append(cs.Observation(start, end, shape.positions[KEPT], group=group, time=k * DT, **seen))
    return out


def arc(shape: cs.CableShape) -> np.ndarray:
    return np.asarray(shape.arc_length[KEPT])


def test_numbers_of_a_cable_that_swings_are_found_again():
    begin = TRUE.replace(
        bending_stiffness=0.006, twisting_stiffness=0.0045, retardation_time=0.03, drag=0.02, length=1.005
    )
    fit = ("bending_stiffness", "retardation_time", "drag", "length")
    found = cs.calibrate(recordings(range(3), arc_length=arc), begin, fit, motion=True)
    assert found.converged
    assert not found.trouble
    assert found.groups == 3
    assert found["bending_stiffness"].value == pytest.approx(0.004, rel=0.02)
    assert found["retardation_time"].value == pytest.approx(0.05, rel=0.03)
    assert found["drag"].value == pytest.approx(0.03, rel=0.05)
    assert found["length"].value == pytest.approx(1.0, abs=2e-4)
    assert found.scale < 2e-4
    assert len(found.points) == len(found.centrelines)
    off = [
        np.linalg.norm(line[KEPT] - seen, axis=1).max()
        for line, seen in zip(found.centrelines, found.points, strict=True)
    ]
    assert max(off) < 2e-3


def test_pitch_and_roll_of_grips_are_seen_in_a_swing():
    pitch, roll = 0.1, 0.3
    tilted = [
        cs.Observation(
            cs.Grip(one.start.pose, offset=cs.Pose((0, 0, 0), (-np.sin(0.5 * pitch), 0.0, 0.0, np.cos(0.5 * pitch)))),
            cs.Grip(one.end.pose, offset=cs.Pose((0, 0, 0), (0.0, 0.0, -np.sin(0.5 * roll), np.cos(0.5 * roll)))),
            one.points,
            one.arc_length,
            group=one.group,
            time=one.time,
        )
        for one in recordings(range(3), arc_length=arc)
        if isinstance(one.end, cs.Grip)
    ]
    found = cs.calibrate(tilted, TRUE, ("start_pitch", "roll"), motion=True)
    assert found["start_tilt_1"].value == pytest.approx(pitch, abs=0.01)
    assert found["roll"].value == pytest.approx(roll, abs=0.05)


@pytest.mark.parametrize("gap", [slice(4, 26, 2), slice(9, 14)], ids=["a slow camera", "frames are lost"])
def test_looks_may_be_far_apart(gap: slice):
    lost = set(range(30)[gap])
    seen = [one for i, one in enumerate(recordings(range(3), arc_length=arc)) if i % 30 not in lost]
    begin = TRUE.replace(bending_stiffness=0.006, twisting_stiffness=0.0045, retardation_time=0.03, drag=0.02)
    fit = ("bending_stiffness", "retardation_time", "drag", "length")
    found = cs.calibrate(seen, begin, fit, motion=True)
    assert found["bending_stiffness"].value == pytest.approx(0.004, rel=0.03)
    assert found["retardation_time"].value == pytest.approx(0.05, rel=0.05)
    assert found["drag"].value == pytest.approx(0.03, rel=0.1)
    assert found["length"].value == pytest.approx(1.0, abs=3e-4)


@pytest.mark.parametrize("free", [False, True], ids=["two grips", "a free end"])
def test_points_of_unknown_arc_length_do(free: bool):
    found = cs.calibrate(
        recordings((0, 1), free=free), TRUE.replace(bending_stiffness=0.005), ("bending_stiffness",), motion=True
    )
    assert found["bending_stiffness"].value == pytest.approx(0.004, rel=0.03)


def test_what_it_needs_and_what_it_refuses():
    seen = recordings((0,), looks=4, arc_length=arc)
    plain = [cs.Observation(one.start, one.end, one.points, group=0) for one in seen]
    alone = [cs.Observation(one.start, one.end, one.points, time=one.time) for one in seen]
    twice = [cs.Observation(one.start, one.end, one.points, group=0, time=0.0) for one in seen]
    for looks, match in ((plain, "time"), (alone, "group"), (twice, "ascend"), (seen[:2], "3 at least")):
        with pytest.raises(cs.ArgumentError, match=match):
            cs.calibrate(looks, TRUE, motion=True)
    with pytest.raises(cs.ArgumentError, match="cross validation"):
        cs.calibrate(seen, TRUE, ("rest_curvature_along",), supports="auto", motion=True)
    with pytest.raises(cs.ArgumentError, match="one cable"):
        cs.calibrate([{"a": one} for one in seen], {"a": TRUE}, motion=True)  # type: ignore[call-overload]
    with pytest.raises(cs.ArgumentError, match="usable"):
        cs.calibrate(seen, TRUE.replace(length=0.5), motion=True)
    with pytest.raises(cs.ArgumentError, match="part of"):
        cs.calibrate(seen, TRUE, ("start_tilt", "start_pitch"), motion=True)


def test_the_command_fits_a_file_of_a_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    seen = recordings((0, 1), arc_length=arc)
    np.savez(
        tmp_path / "seen.npz",
        start=[one.start.pose.array for one in seen],
        end=[one.end.pose.array for one in seen if isinstance(one.end, cs.Grip)],
        points=[one.points for one in seen],
        arc_length=seen[0].arc_length,
        group=[one.group for one in seen],
        time=[one.time for one in seen],
    )
    rough = TRUE.replace(bending_stiffness=0.005, twisting_stiffness=0.00375).as_dict()
    (tmp_path / "rough.yaml").write_text(yaml.safe_dump({k: v for k, v in rough.items() if v is not None}))
    asked = [str(tmp_path / "seen.npz"), "--motion", "--cable", str(tmp_path / "rough.yaml")]
    assert main(["calibrate", *asked, "-o", str(tmp_path / "cable.yaml")]) == 0
    assert "bending_stiffness" in capsys.readouterr().out
    found = cs.Cable.from_yaml(tmp_path / "cable.yaml")
    assert found.bending_stiffness[0] == pytest.approx(0.004, rel=0.03)


def test_a_roll_is_found_from_the_other_side():
    """From where a fit begins it may lead into another minimum: of three turns the best one is gone on from."""
    roll = 2.6
    rolled = [
        cs.Observation(
            one.start,
            cs.Grip(one.end.pose, offset=cs.Pose((0, 0, 0), (0.0, 0.0, -np.sin(0.5 * roll), np.cos(0.5 * roll)))),
            one.points,
            one.arc_length,
            group=one.group,
            time=one.time,
        )
        for one in recordings(range(3), arc_length=arc)
        if isinstance(one.end, cs.Grip)
    ]
    begin = TRUE.replace(bending_stiffness=0.006, twisting_stiffness=0.0045)
    found = cs.calibrate(rolled, begin, ("bending_stiffness", "twisting_stiffness", "roll"), motion=True)
    assert found.scale < 1e-3
    assert np.cos(found["roll"].value - roll) > np.cos(0.1)


def kinked(k: int) -> tuple[cs.Pose, cs.Pose]:
    """Grips that turn a limp cable back onto itself, after k looks."""
    t = 0.01 * k
    pitch, out = 1.25 * np.sin(6.0 * t), 0.05 * np.sin(7.0 * t)
    turns = [(0.0, sign * np.sin(pitch), 0.0, np.cos(pitch)) for sign in (1.0, -1.0)]
    start, end = (cs.Pose((0, 0, 0), turn) * cs.Pose((0, 0, 0), ALONG) for turn in turns)
    return start, cs.Pose((0.75, out, 0.1 * np.sin(6.0 * t)), end.quaternion)


def test_where_elements_are_too_long_for_what_bends_at_a_grip_there_are_more():
    """Elements that turn by almost pi hold up all steps that follow: the recording then tells of nothing else."""
    cable = cs.Cable(0.9, 0.05, 1.5e-4, twisting_stiffness=2e-5, retardation_time=0.05, drag=0.01)
    motion = cs.Motion(cable, points=101, elements=48)
    shapes = [motion.begin(*kinked(0))] + [motion.step(*kinked(k), 0.01) for k in range(1, 60)]
    assert all(shape.usable for shape in shapes)
    seen = [
        cs.Observation(*kinked(max(k - 1, 0)), shape.positions[KEPT], arc(shape), group=0, time=0.01 * k)
        for k, shape in enumerate([shapes[0], *shapes])
    ]
    parameters = Parameters(cable, ("bending_stiffness",))
    coarse = cs.Motion(cable, points=101, elements=16)
    coarse.begin(*kinked(0))
    assert not all(coarse.step(*kinked(k), 0.01).usable for k in range(1, 60)), "else this tests nothing"
    forward = MotionForward(parameters, recordings_of(seen), elements=16)
    missed = np.linalg.norm(forward.misses(parameters.start), axis=1)
    assert forward.lost == 0
    assert missed.max() < 0.02 * cable.length
    assert np.median(missed) < 0.002 * cable.length
