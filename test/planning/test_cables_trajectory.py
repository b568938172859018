"""check_trajectory of several cables: kept out of each other, or not to come too near."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).parents[2] / "config" / "robots" / "dual_arm.yaml"
CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.01, diameter=0.008)
CABLES = {"under": CABLE, "over": CABLE.replace(linear_density=0.08, diameter=0.01)}
SOLVED = cs.Scene(contact="solve")
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
Tables = dict[str, tuple[Any, Any]]
SIDES = ("start", "end")


def pair(heading: float, height: float, chord: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Poses (7,) of two grips about a place near the z axis."""
    turn = Rotation.from_euler("z", heading, degrees=True)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    q, middle = (turn * ALONG_X).as_quat(), np.array((0.02, 0.01, height))
    return np.concatenate((middle - half, q)), np.concatenate((middle + half, q))


def lowered(high: float, low: float, count: int) -> Tables:
    """The one is let down across the other."""
    over = [pair(70.0, height) for height in np.linspace(high, low, count)]
    under = [pair(0.0, 0.0)] * count
    return {name: tuple(np.array(side) for side in zip(*rows, strict=True))
            for name, rows in (("under", under), ("over", over))}  # type: ignore[misc]  # fmt: skip


def stepped(path: Tables, scene: cs.Scene, **options: Any) -> list[cs.CycleReport]:
    """A cycle led along the waypoints."""
    cycle = cs.Cycle(CABLES, scene=scene, model="cosserat", tolerance=1e-4, **options)
    out = []
    for i in range(len(path["over"][0])):
        grips = {name: tuple(cs.Pose(t[i][:3], t[i][3:]) for t in both) for name, both in path.items()}
        out.append(cycle.step(grips, i * 10**9))
    return out


def test_one_that_is_let_down_onto_the_other_is_followed_and_told_as_a_cycle_tells_it() -> None:
    path = lowered(0.03, -0.03, 13)
    found = cs.check_trajectory(CABLES, SOLVED, None, path)
    assert found.valid, found.first
    assert found.done.all()
    assert found.segments.all()
    reports = stepped(path, SOLVED)
    assert reports[-1].shapes["under"].contacts
    assert not reports[0].shapes["under"].contacts
    for i, report in enumerate(reports):
        near = [body.distance for body in report.clearance["under"].bodies if body.body == "over"]
        assert found.clearance[i] == pytest.approx(min(near, default=math.inf), abs=2e-4)
        for name in CABLES:
            told = {(m.kind, m.other): m.used for m in found.margins_of[name][i]}
            stability = told[cs.WarningKind.STABILITY, ""]
            expected = {(m.kind, m.other): m.used for m in report.margins[name]}[cs.WarningKind.STABILITY, ""]
            assert stability == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("waypoints", [2, 31])
def test_a_way_straight_through_the_other_leads_to_where_it_lies_on_it(waypoints: int) -> None:
    """It does not come out below, however few waypoints there are."""
    path = lowered(0.05, -0.25, waypoints)
    found = cs.check_trajectory(CABLES, SOLVED, None, path)
    assert found.valid, found.first
    assert found.clearance[-1] == pytest.approx(0.0, abs=2e-4)
    deep = {name: tuple(cs.Pose(t[-1][:3], t[-1][3:]) for t in both) for name, both in path.items()}
    below = cs.Cycle(CABLES, scene=SOLVED, model="cosserat").step(deep, 0)
    assert not below.shapes["under"].contacts  # from nothing it hangs below


def test_without_contact_solved_for_they_may_not_come_too_near() -> None:
    """Also where they do so between two waypoints only."""
    near = cs.Scene(error_distance=0.005, warn_distance=0.01)
    through = cs.check_trajectory(CABLES, near, None, lowered(0.06, -0.06, 2))
    assert not through.valid
    assert through.first is not None
    assert through.first.reason is cs.Reason.CLEARANCE
    assert (through.first.segment, through.first.other) == ("over", "under")
    assert 0.0 < through.first.place < 1.0
    assert through.waypoints == (None, None)
    assert "cable 'over'" in through.first.text
    aside = cs.check_trajectory(CABLES, near, None, lowered(0.06, 0.03, 2))
    assert aside.valid
    assert not cs.check_trajectory(CABLES, near, None, lowered(0.06, 0.005, 2)).valid


def test_where_it_first_comes_too_near_is_where_a_scan_finds_it() -> None:
    near = cs.Scene(error_distance=0.005, warn_distance=0.01)
    found = cs.check_trajectory(CABLES, near, None, lowered(0.06, -0.06, 2))
    scan = stepped(lowered(0.06, -0.06, 401), near)
    apart = [next((b.distance for b in r.clearance["over"].bodies if b.body == "under"), math.inf) for r in scan]
    first = next(i for i, distance in enumerate(apart) if distance < 0.005) / 400.0
    assert found.first is not None
    assert found.first.place == pytest.approx(first, abs=4e-3)
    assert found.first.arc_length == pytest.approx(0.5, abs=0.1)


def test_a_body_in_the_way_of_one_is_told_of_that_one() -> None:
    post = cs.Obstacle("post", cs.Sphere(0.05), cs.Pose((0.09, 0.2, -0.1)))
    found = cs.check_trajectory(CABLES, cs.Scene(obstacles=[post]), None, lowered(0.3, 0.1, 3))
    assert found.first is not None
    assert (found.first.segment, found.first.other) == ("over", "post")


def test_free_ends_clips_loads_and_accelerations_are_those_of_each_cable() -> None:
    path = lowered(0.1, 0.05, 3)
    path["over"] = (path["over"][0], cs.FreeEnd(mass=0.01))
    clip = cs.Clip(0.5, cs.Pose((0.02, 0.01, -0.25), ALONG_X.as_quat()), kind="ball")
    options: dict[str, Any] = {"clips": {"under": [clip]}, "distributed_load": {"over": ((0, 0, -0.1), (0, 0, -0.1))}}
    found = cs.check_trajectory(CABLES, SOLVED, None, path, acceleration={"over": np.zeros((3, 3))}, **options)
    assert found.valid, found.first
    strong = CABLES["over"].replace(max_tension=1.0)
    limits = {**CABLES, "over": strong}
    assert cs.check_trajectory(limits, SOLVED, None, path).valid
    pulled = cs.check_trajectory(limits, SOLVED, None, path, acceleration={"over": np.full((3, 3), 8.0)})
    assert pulled.first is not None
    assert (pulled.first.reason, pulled.first.segment) == (cs.Reason.TENSION, "over")


def test_an_ends_path_has_times_and_names_every_end() -> None:
    path = lowered(0.06, -0.06, 3)
    ends = {f"{name}.{side}": table for name, both in path.items() for side, table in zip(SIDES, both, strict=True)}
    near = cs.Scene(error_distance=0.005, warn_distance=0.01)
    found = cs.check_trajectory(CABLES, near, None, cs.EndsPath(ends, times=[0.0, 2.0, 4.0]))
    plain = cs.check_trajectory(CABLES, near, None, path)
    assert found.first is not None
    assert plain.first is not None
    assert found.first.place == plain.first.place
    assert found.first.time == pytest.approx(2.0 * found.first.place)
    assert math.isnan(plain.first.time)


def test_the_robot_leads_one_cable_past_another_that_hangs_still() -> None:
    robot = Robot.from_yaml(ROBOT)
    poses = np.tile(np.zeros(len(robot.joint_names)), (2, 1))
    left, right = robot.grips(poses[0])
    frames = [as_pose(grip) for grip in (left, right)]
    span = float(np.linalg.norm(frames[1].position - frames[0].position))
    cables = {"held": CABLE.replace(length=1.2 * span), "still": CABLE}
    away = cs.Pose(frames[0].position + np.array((0.0, 0.0, 5.0)), frames[0].quaternion)
    ends = {"held.start": "left", "held.end": "right", "still.start": away, "still.end": cs.FreeEnd()}
    path = cs.JointPath(robot.joint_names, poses)
    found = cs.check_trajectory(cables, cs.Scene(), robot, path, ends=ends)
    alone = cs.check_trajectory(cables["held"], cs.Scene(), robot, path)
    assert found.robot_checked
    assert found.done.all()
    assert (found.first is None) == (alone.first is None)
    if found.first is not None and alone.first is not None:
        assert (found.first.reason, found.first.other) == (alone.first.reason, alone.first.other)


def as_pose(grip: Any) -> cs.Pose:
    return grip.cable_frame if isinstance(grip, cs.Grip) else grip


def test_it_ends_where_it_is_told_to() -> None:
    found = cs.check_trajectory(CABLES, SOLVED, None, lowered(0.03, -0.03, 9), proceed=lambda check: check.solved < 3)
    assert found.partial
    assert not found.valid
    assert found.solved == 3


PATH = lowered(0.1, 0.05, 3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trajectory": {"over": PATH["over"]}}, r"trajectory = \['over'\].*'under' is missing.*Write"),
        ({"trajectory": {**PATH, "ovr": PATH["over"]}}, "ovr"),
        ({"trajectory": {**PATH, "over": PATH["over"][0]}}, r"trajectory\['over'\].*\(starts, ends\)"),
        ({"trajectory": {**PATH, "over": (PATH["over"][0][:2], PATH["over"][1])}}, "2 waypoints|3 waypoints"),
        ({"trajectory": cs.GripPath(*PATH["over"])}, r"several cables.*Write"),
        ({"trajectory": cs.EndsPath({"over.start": PATH["over"][0]})}, r"nothing holds the start of cable 'under'"),
        ({"trajectory": cs.EndsPath({"over.middle": PATH["over"][0]})}, "over.middle"),
        ({"ends": {"over.start": "left"}}, r"ends.*Leave them out"),
        ({"acceleration": {"over": np.zeros((2, 3))}}, r"acceleration\['over'\].*\(3, 3\)"),
        ({"acceleration": {"top": np.zeros((3, 3))}}, "top"),
        ({"clips": {"top": []}}, "top"),
        ({"cable": {"under": CABLE, "over": "rope"}}, r"cables\['over'\].*Cable"),
        ({"cable": {}}, "at least one"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"cable": CABLES, "trajectory": PATH, **changes}
    with pytest.raises((ArgumentError, UnknownKeyError), match=words):
        cs.check_trajectory(given.pop("cable"), SOLVED, None, given.pop("trajectory"), **given)


def test_clips_by_name_are_of_several_cables() -> None:
    with pytest.raises(ArgumentError, match=r"clips.*several cables.*Write"):
        cs.check_trajectory(CABLE, SOLVED, None, cs.GripPath(*PATH["over"]), clips={"over": []})
