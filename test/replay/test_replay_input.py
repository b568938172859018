"""Recordings that are cut off, lack topics or hold what cannot be used: a replay says so."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from recordings import (
    ALONG_X,
    BEGIN,
    JOINT_STATE,
    LEFT,
    MCAP,
    PERIOD,
    POSE,
    RIGHT,
    SQLITE3,
    Entry,
    cut,
    ends_at,
    motion,
    pose_entry,
    storage_file,
    write_bag,
)
from replays import messages, report_of, run
from rosbags.rosbag2 import StoragePlugin

import cable_shape as cs


@pytest.mark.parametrize("storage", [MCAP, SQLITE3])
def test_a_truncated_recording_is_replayed_up_to_the_cut(tmp_path: Path, storage: StoragePlugin) -> None:
    bag = write_bag(tmp_path / "bag", motion(200), storage)
    whole = run(bag, tmp_path / "whole", points=20)
    cut(bag, storage_file(bag).stat().st_size // 2)
    part = run(bag, tmp_path / "part", points=20)
    assert 20 < part.tally.cycles < whole.tally.cycles == 200
    read = part.topics[LEFT][0]
    assert f"{LEFT}: {read} of 200 messages read, {200 - read} missing" in part.problems
    report = report_of(tmp_path / "part")
    assert report["recording"]["complete"] is False
    assert report["recording"]["topics"][LEFT] == {"messages_read": read, "messages_recorded": 200}
    assert "**Only a part of the recording could be read.**" in (tmp_path / "part/report.md").read_text()
    complete = [m.positions for _, m in messages(tmp_path / "whole", "/cable/shape")]
    for (_, message), positions in zip(messages(tmp_path / "part", "/cable/shape"), complete, strict=False):
        np.testing.assert_array_equal(message.positions, positions)


def test_a_recording_without_the_topics_names_those_found(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [pose_entry("/arm/tool", BEGIN, (0, 0, 0))])
    with pytest.raises(cs.BagError) as caught:
        run(bag, tmp_path / "out")
    text = str(caught.value)
    assert f"has no topic {LEFT}" in text
    assert "Topics found: /arm/tool (geometry_msgs/msg/PoseStamped)" in text
    assert "--left-topic, --right-topic, --joints-topic or --tf-topic" in text


def test_topics_can_be_named(tmp_path: Path) -> None:
    entries = [Entry(f"/cell{e.topic}", e.kind, e.log_time, e.message) for e in motion(3)]
    bag = write_bag(tmp_path / "bag", entries)
    outcome = run(bag, tmp_path / "out", left_topic=f"/cell{LEFT}", right_topic=f"/cell{RIGHT}")
    assert outcome.tally.cycles == 3


def test_only_one_gripper_recorded(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [e for e in motion(3) if e.topic == LEFT])
    with pytest.raises(cs.BagError, match=f"has no topic {RIGHT}. Only one gripper was recorded: {LEFT}"):
        run(bag, tmp_path / "out")


def test_only_one_gripper_ever_spoke(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [e for e in motion(3) if e.topic == LEFT], empty={RIGHT: POSE})
    with pytest.raises(cs.BagError, match=rf"no cycle could be run\. Messages read: 3 on {LEFT}, 0 on {RIGHT}"):
        run(bag, tmp_path / "out")


def test_a_topic_of_another_type_is_refused(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(2)[:1], empty={RIGHT: JOINT_STATE})
    with pytest.raises(cs.BagError, match=f"{RIGHT} is of type {JOINT_STATE}, it must be {POSE}"):
        run(bag, tmp_path / "out")


def test_poses_that_are_never_close_in_time_say_so(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(1, skew=50_000_000))
    with pytest.raises(cs.BagError, match=r"2 poses had no partner within max_skew = 0\.02 s"):
        run(bag, tmp_path / "out")
    assert run(bag, tmp_path / "out", max_skew=0.06).tally.cycles == 1


NAN = math.nan


@pytest.mark.parametrize(
    ("position", "quaternion", "frame", "reason", "example"),
    [
        ((0.0, NAN, 0.5), ALONG_X, "world", "pose not finite", "every entry must be finite"),
        ((0.0, math.inf, 0.5), ALONG_X, "world", "pose not finite", "every entry must be finite"),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0, NAN), "world", "pose not finite", "quaternion"),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 0.0), "world", "quaternion not of unit length", "its length is 0"),
        ((0.0, 0.0, 0.5), (1.0, 1.0, 1.0, 1.0), "world", "quaternion not of unit length", "its length is 2"),
        ((0.0, 0.0, 0.5), ALONG_X, "camera", "other frame", "header.frame_id = 'camera' is not allowed"),
    ],
)
def test_a_bad_pose_inside_costs_its_cycle_and_is_counted(
    tmp_path: Path, position: Sequence[float], quaternion: Sequence[float], frame: str, reason: str, example: str
) -> None:
    entries = motion(10)
    entries[8] = pose_entry(LEFT, BEGIN + 4 * PERIOD, position, quaternion, frame)
    outcome = run(write_bag(tmp_path / "bag", entries), tmp_path / "out")
    stamps = [time for time, _ in messages(tmp_path / "out", "/cable/shape")]
    assert stamps == [BEGIN + k * PERIOD for k in range(10) if k != 4]
    (refused,) = outcome.refusals
    assert (refused.topic, refused.reason, refused.count) == (LEFT, reason, 1)
    assert example in refused.example
    assert outcome.unpaired == 1  # the partner of the bad one
    (listed,) = report_of(tmp_path / "out")["input"]["refused"]
    assert (listed["reason"], listed["messages"]) == (reason, 1)
    assert reason in (tmp_path / "out/report.md").read_text()


def test_stamps_that_go_backwards_are_refused(tmp_path: Path) -> None:
    entries = motion(10)
    late = pose_entry(LEFT, BEGIN + 4 * PERIOD - PERIOD // 2 - PERIOD, ends_at(0)[0], log_time=BEGIN + 4 * PERIOD)
    entries.insert(9, late)
    outcome = run(write_bag(tmp_path / "bag", entries), tmp_path / "out")
    stamps = [time for time, _ in messages(tmp_path / "out", "/cable/shape")]
    assert stamps == [BEGIN + k * PERIOD for k in range(10)]
    (refused,) = outcome.refusals
    assert refused.reason == "stamp not newer than the last"
    assert "goes backwards" in refused.example


def test_a_clock_that_is_set_back_starts_afresh(tmp_path: Path) -> None:
    entries = []
    for k in range(6):
        stamp = BEGIN + (k % 3) * PERIOD + (0 if k >= 3 else 10 * 10**9)
        for topic, position in zip((LEFT, RIGHT), ends_at(k), strict=True):
            entries.append(pose_entry(topic, stamp, position, log_time=BEGIN + k * PERIOD))
    outcome = run(write_bag(tmp_path / "bag", entries), tmp_path / "out")
    assert outcome.tally.cycles == 6
    assert outcome.tally.restarts == 1
    assert report_of(tmp_path / "out")["replay"]["clock_restarts"] == 1


def test_nothing_but_bad_poses_says_why_no_cycle_was_run(tmp_path: Path) -> None:
    entries = [pose_entry(e.topic, e.log_time, (NAN, 0.0, 0.0)) for e in motion(3)]
    with pytest.raises(cs.BagError, match=r"no cycle could be run.*3 refused on /left_gripper/pose \(pose not finite"):
        run(write_bag(tmp_path / "bag", entries), tmp_path / "out")
    assert not (tmp_path / "out" / "replay").exists()
