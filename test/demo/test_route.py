"""The worked routing task: it is done, by checks that are not its own, and its recording shows it."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import plan_run
import pytest
import route_cable as task

import cable_shape as cs
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")


@pytest.fixture(scope="module")
def found(robot: Robot) -> task.Task:
    planned = task.plan(robot, seed=1, seconds=600.0)
    assert planned is not None
    return planned


@pytest.fixture(scope="module")
def reports(robot: Robot, found: task.Task, tmp_path_factory: pytest.TempPathFactory) -> list[cs.CycleReport]:
    """Of cycles at 50 Hz along the recording."""
    out = tmp_path_factory.mktemp("route") / "route.rrd"
    made = plan_run.record(robot, task.CABLE, task.SCENE, found.parts, out, task.CLIPS)
    assert out.stat().st_size > 50_000
    return made


def touched(report: cs.CycleReport) -> set[str]:
    return {contact.body for contact in report.shapes["cable"].contacts}


def test_the_whole_task_is_valid_in_one_piece(found: task.Task) -> None:
    assert found.check.valid, found.check
    assert found.check.robot_checked
    kinds = [type(part) for part in found.parts]
    assert kinds.count(cs.Insert) == 2
    assert kinds.count(cs.Regrip) == 1


def test_every_cycle_along_it_is_free_of_errors(reports: list[cs.CycleReport]) -> None:
    for report in reports:
        assert report.shapes["cable"].status is cs.Status.OK, report.stamp
        assert not [w.text for w in report.warnings if w.severity is cs.Severity.ERROR]


def test_the_cable_comes_from_the_table_round_the_post_into_the_channel(reports: list[cs.CycleReport]) -> None:
    """At the end its middle is behind the post, and between the clips it lies in the channel below the walls' tops."""
    assert touched(reports[0]) == {"table"}
    assert any(not touched(report) for report in reports)
    assert {"table", "post"} <= touched(reports[-1])
    shape = reports[-1].shapes["cable"]
    x = shape.positions[np.abs(shape.positions[:, 1] - task.POST.pose.position[1]).argmin(), 0]
    assert x == pytest.approx(task.POST.pose.position[0] + 0.024, abs=2e-3)
    across = np.array((np.cos(task.TURN), np.sin(task.TURN)))
    along = np.array((np.sin(task.TURN), -np.cos(task.TURN)))
    beside = shape.positions[:, :2] - task.MIDDLE
    inside = np.abs(beside @ along) < 0.25 * task.LONG
    assert inside.sum() > 3
    assert np.abs(beside[inside] @ across).max() <= 0.5 * task.WIDE - 0.004 + 2e-4
    assert shape.positions[inside, 2].max() < task.DEEP


def test_the_clips_hold_the_cable_and_the_right_hand_has_another_grip(reports: list[cs.CycleReport]) -> None:
    assert len(reports[0].shapes["cable"].clips) == 0
    shape = reports[-1].shapes["cable"]
    assert shape.length == pytest.approx(task.THROUGH)
    for clip in task.CLIPS:
        place = [np.interp(clip.arc_length, shape.arc_length, x) for x in shape.positions.T]
        assert place == pytest.approx(clip.pose.position, abs=5e-4)


def test_the_hands_and_the_arms_stay_off_what_is_there(robot: Robot, found: task.Task) -> None:
    arms = task.Arms(robot, task.SCENE)
    paths = [part.positions for part in found.parts if isinstance(part, cs.JointPath)]
    for before, after in itertools.pairwise(paths):
        assert np.array_equal(before[-1], after[0])  # an edit moves no hand
    for rows in paths:
        assert all(arms.apart(q) for q in rows)
