"""check_trajectory through edits: what is done to the cable between two paths, as a cycle does it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.robots.robot import Robot

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(
    length=1.0, linear_density=0.05, bending_stiffness=0.005, diameter=0.006, min_bend_radius=0.01, tails={"end": 0.2}
)
POST = cs.Obstacle("post", cs.Cylinder(0.03, 0.6), cs.Pose((0.0, 0.0, 0.9)))
SCENE = cs.Scene(obstacles=[POST], contact="solve")
GUIDE = cs.Clip(0.25, cs.Pose((-0.19, -0.06, 0.88)), "ball", name="guide")


def across(*places: float) -> cs.GripPath:
    """Both grips move along y, past the post or back."""
    return cs.GripPath([(-0.38, y, 1.0, *ALONG_X) for y in places], [(0.38, y, 1.0, *ALONG_X) for y in places])


HOOK, STAY = across(*np.linspace(0.08, -0.15, 9)), across(-0.15)


def test_a_task_is_followed_as_a_cycle_follows_it() -> None:
    """Hooked round a post, clipped, moved, gripped again, let go: at every waypoint what a cycle tells."""
    edits = {
        0: (cs.Insert(GUIDE), cs.Move("guide", cs.Pose((-0.19, -0.06, 0.9)))),
        1: (cs.Regrip("end", 1.1),),
        2: (cs.Release("guide"),),
        3: (cs.Open("end"),),
    }
    paths = [HOOK, STAY, across(-0.15, -0.16, -0.17), STAY, STAY]
    parts = [part for i, path in enumerate(paths) for part in (path, *edits.get(i, ()))]
    found = cs.check_trajectory(CABLE, SCENE, None, parts)
    assert found.valid, found
    assert found.segments.all()
    cycle = cs.Cycle(CABLE, scene=SCENE, model="cosserat", tolerance=1e-4, snap_horizon=0.0)
    stamp, at, reports = 0, None, []
    for i, path in enumerate(paths):
        for pair in zip(path.starts, path.ends, strict=True):
            for x in np.linspace(0.0, 1.0, 9) if at is not None else (1.0,):
                a, b = ((1.0 - x) * (p if at is None else q) + x * p for p, q in zip(pair, at or pair, strict=True))
                grips = cs.Pose(a[:3], a[3:]), cs.Pose(b[:3], b[3:])
                report = cycle.step({"cable": grips}, stamp)
                stamp += 1
            at = pair
            reports.append(report)
        if i in edits:
            assert cycle.edit(*edits[i])
            at = None
    assert len(reports) == len(found.margins)
    for k, (report, margins) in enumerate(zip(reports, found.margins, strict=True)):
        told = {m.kind: m.used for m in report.margins["cable"] if m.kind is not cs.WarningKind.CLEARANCE}
        for margin in margins:
            if margin.kind in told:
                assert margin.used == pytest.approx(told[margin.kind], rel=2e-3), (k, margin)
        nearest = min((body.distance for body in report.clearance["cable"].bodies), default=np.inf)
        if k < len(reports) - 1:  # of the last one it is its tail that is near
            assert found.clearance[k] == pytest.approx(nearest, abs=1e-4), k


def test_the_branch_goes_on_through_edits() -> None:
    """Drawn back behind the post the cable stays hooked, as it would not be from nothing."""
    back = across(-0.15, -0.1, -0.06)
    found = cs.check_trajectory(CABLE, SCENE, None, [HOOK, cs.Regrip("end", 1.05), back])
    assert found.valid, found
    assert abs(found.clearance[-1]) < 2e-4
    assert cs.check_trajectory(CABLE, SCENE, None, back).clearance[-1] > 0.01


def test_the_edit_that_cannot_be_made_is_the_first_violation() -> None:
    found = cs.check_trajectory(CABLE, SCENE, None, [HOOK, cs.Insert(GUIDE), STAY, cs.Regrip("end", 1.5), STAY])
    assert found.first is not None
    assert (found.first.reason, found.first.place) == (cs.Reason.EDIT, 9.0)
    assert "goes from 0 m to 1.2 m" in found.first.text
    assert found.done.tolist() == [True] * 10 + [False]
    assert not found.valid
    assert not found.partial
    last = cs.check_trajectory(CABLE, SCENE, None, [HOOK, cs.Release("none")])
    assert last.first is not None
    assert "no such clip" in last.first.text


def test_what_an_edit_leads_to_is_judged_in_the_scene_that_it_makes() -> None:
    box = cs.Obstacle("box", cs.Box((0.1, 0.1, 0.1)), cs.Pose((0.3, -0.15, 1.05)))
    added = cs.check_trajectory(CABLE, SCENE.replace(allow=[cs.Allow("post")]), None, [HOOK, cs.Add(box), STAY])
    assert added.first is not None
    assert (added.first.reason, added.first.other, added.first.place) == (cs.Reason.CLEARANCE, "box", 9.0)
    lifted = cs.Clip(0.25, cs.Pose((-0.19, -0.06, 0.95)), "ball", name="lifted")
    bent = CABLE.replace(min_bend_radius=0.095)
    assert cs.check_trajectory(bent, SCENE, None, HOOK).valid
    wrong = cs.check_trajectory(bent, SCENE, None, [HOOK, cs.Insert(lifted), STAY]).first
    assert wrong is not None
    assert (wrong.reason, wrong.place) == (cs.Reason.BEND_RADIUS, 9.0)
    gone = cs.check_trajectory(CABLE, SCENE, None, [HOOK, cs.Remove("post"), STAY])
    assert gone.valid
    assert gone.clearance[-1] == np.inf


def test_paths_of_joints_are_one_after_the_other_in_time() -> None:
    robot = Robot.from_yaml(Path(__file__).resolve().parents[2] / "config" / "robots" / "dual_arm.yaml")
    cable = CABLE.replace(length=0.9, tails={})
    rows = robot.home + 0.02 * np.arange(3)[:, None] * np.array(["finger" not in name for name in robot.joint_names])
    names = list(robot.joint_names)
    paths = [cs.JointPath(names, rows, (5.0, 6.0, 8.0)), cs.JointPath(names[::-1], rows[::-1, ::-1], (0.0, 1.0, 2.0))]
    clip = cs.Clip(0.45, cs.Pose((0.0, 0.0, 2.0)), "ball")
    found = cs.check_trajectory(cable, None, robot, [paths[0], paths[1], cs.Insert(clip)])
    assert found.done.all()
    assert found.first is not None
    assert (found.first.reason, found.first.place, found.first.time) == (cs.Reason.EDIT, 5.0, 10.0)
    assert found.clearance[:3] == pytest.approx(found.clearance[:2:-1], abs=1e-5)


def test_what_is_no_routing_is_named() -> None:
    path = SimpleNamespace(joint_names=["a"], points=[])
    for wrong, said in (
        ([cs.Release("a"), STAY], r"trajectory\[0\].*no shape yet"),
        ([], "holds no path"),
        ([STAY, cs.JointPath(["a"], [[0.0]])], r"trajectory\[1\].*GripPath"),
        ([STAY, "Release"], "must be a JointPath"),
        ([path], "waypoints"),
    ):
        with pytest.raises(cs.ArgumentError, match=said):
            cs.check_trajectory(CABLE, SCENE, None, wrong)


def test_edits_of_several_cables_harnesses_and_swinging_ones_are_refused() -> None:
    start, end = np.array([(0.0, 0.0, 0.5, *ALONG_X)]), np.array([(1.5, 0.0, 0.5, *ALONG_X)])
    harness = cs.Harness(dict.fromkeys("ab", CABLE.replace(tails={})), [cs.Junction("middle", ("a.end", "b.start"))])
    ends, both = cs.EndsPath({"a.start": start, "b.end": end}), dict.fromkeys(("left", "right"), (start, end))
    cables = {"left": CABLE, "right": CABLE}
    for what, path, options in ((harness, ends, {}), (cables, both, {}), (CABLE, STAY, {"motion": True})):
        with pytest.raises(
            cs.ArgumentError, match="a list of 2' is not allowed: edits between paths are followed of one"
        ):
            cs.check_trajectory(what, cs.Scene(), None, [path, cs.Release("guide")], **options)
