"""Replays of recordings in which the grippers are frames on /tf: the shapes are those of the same poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import (
    ALONG_X,
    BEGIN,
    MCAP,
    PERIOD,
    SQLITE3,
    TYPES,
    Entry,
    ends_at,
    header,
    motion,
    pose_entry,
    write_bag,
)
from replays import messages, report_of, run
from rosbags.rosbag2 import StoragePlugin

import cable_shape as cs
from cable_shape.command.cli import main

TF, STATIC = "/tf", "/tf_static"
TFMESSAGE = "tf2_msgs/msg/TFMessage"
HALF = math.sqrt(0.5)
#: Of both arms in the world: turned against each other.
BASES = {"left_base": cs.Pose((-0.3, 0.1, 0.2), (0.0, 0.0, HALF, HALF)), "right_base": cs.Pose((1.2, 0.0, 0.3))}
FRAMES = {"left_frame": "left_tool", "right_frame": "right_tool"}
OPTIONS = ["--left-frame", "left_tool", "--right-frame", "right_tool"]


def transform(parent: str, child: str, stamp: int, pose: cs.Pose) -> Any:
    moved = TYPES["geometry_msgs/msg/Transform"](
        TYPES["geometry_msgs/msg/Vector3"](*map(float, pose.position)),
        TYPES["geometry_msgs/msg/Quaternion"](*map(float, pose.quaternion)),
    )
    return TYPES["geometry_msgs/msg/TransformStamped"](header(stamp, parent), child, moved)


def entry(transforms: Sequence[Any], stamp: int, topic: str = TF) -> Entry:
    return Entry(topic, TFMESSAGE, stamp, TYPES[TFMESSAGE](list(transforms)))


def statics() -> Entry:
    return entry([transform("world", base, 0, pose) for base, pose in BASES.items()], BEGIN - 1, STATIC)


def tool(side: str, stamp: int, place: Sequence[float], parent: str = "") -> Entry:
    """The tool of an arm at a place of the world, as that arm sends it."""
    base = f"{side}_base"
    inside = BASES[base].inverse() * cs.Pose(place, ALONG_X)
    return entry([transform(parent or base, f"{side}_tool", stamp, inside)], stamp)


def recorded(frames: int, skew: int = 0) -> list[Entry]:
    """The motion of `recordings` as two drivers send it; the right one stamps `skew` later."""
    entries = [statics()]
    for k in range(frames):
        start, end = ends_at(k)
        entries += [tool("left", BEGIN + k * PERIOD, start), tool("right", BEGIN + k * PERIOD + skew, end)]
    return entries


@pytest.mark.parametrize("storage", [MCAP, SQLITE3])
def test_frames_give_the_shapes_of_the_same_poses(tmp_path: Path, storage: StoragePlugin) -> None:
    poses = write_bag(tmp_path / "poses", motion(20, skew=0))
    frames = write_bag(tmp_path / "frames", recorded(20), storage)
    run(poses, tmp_path / "of_poses", points=20)
    outcome = run(frames, tmp_path / "of_frames", points=20, **FRAMES)
    assert (outcome.source, outcome.frame_id, outcome.tally.cycles) == ("tf", "world", 20)
    assert outcome.topics[TF] == (40, 40)
    assert outcome.topics[STATIC] == (1, 1)
    assert outcome.refusals.total == outcome.unpaired == 0
    pairs = zip(
        messages(tmp_path / "of_poses", "/cable/shape"), messages(tmp_path / "of_frames", "/cable/shape"), strict=True
    )
    for (_, wanted), (_, found) in pairs:
        assert found.header == wanted.header
        np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-12)
    assert report_of(tmp_path / "of_frames")["input"]["source"] == "tf"


def test_both_grippers_are_taken_at_one_time(tmp_path: Path) -> None:
    """Drivers that stamp 3 ms apart: a cycle at each stamp at which both are known, the other one in between."""
    bag = write_bag(tmp_path / "bag", recorded(20, skew=3_000_000))
    outcome = run(bag, tmp_path / "out", points=20, **FRAMES)
    shapes = list(messages(tmp_path / "out", "/cable/shape"))
    assert outcome.tally.cycles == len(shapes) == 39
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec - BEGIN for _, m in shapes]
    assert stamps == [0, *(k * PERIOD + late for k in range(19) for late in (3_000_000, PERIOD))]
    at = stamps.index(PERIOD + 3_000_000)
    before, after = (np.array(ends_at(k)[0]) for k in (1, 2))
    np.testing.assert_allclose(shapes[at][1].positions[:3], before + 0.3 * (after - before), atol=1e-9)


def test_another_frame_may_be_that_of_the_shapes(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", recorded(3))
    outcome = run(bag, tmp_path / "out", points=20, frame_id="/right_base", gravity=(0.0, 0.0, -9.81), **FRAMES)
    assert outcome.frame_id == "right_base"
    (_, first), *_ = messages(tmp_path / "out", "/cable/shape")
    assert first.header.frame_id == "right_base"
    np.testing.assert_allclose(
        first.positions[-3:], np.subtract(ends_at(0)[1], BASES["right_base"].position), atol=1e-9
    )


def test_what_cannot_be_used_costs_its_cycle_and_is_counted(tmp_path: Path) -> None:
    entries = recorded(10)
    entries[5].message.transforms[0].transform.translation.x = math.nan
    late = tool("left", BEGIN + 5 * PERIOD - 1, ends_at(0)[0])  # goes backwards
    odd = [
        Entry(late.topic, late.kind, BEGIN + 5 * PERIOD + 1, late.message),
        tool("left", BEGIN + 5 * PERIOD + 1, ends_at(0)[0], parent="right_base"),
        entry([transform("same", "same", BEGIN + 1, cs.Pose((0, 0, 0)))], BEGIN + 5 * PERIOD + 2),
    ]
    bag = write_bag(tmp_path / "bag", entries[:12] + odd + entries[12:])
    outcome = run(bag, tmp_path / "out", points=20, max_skew=0.004, **FRAMES)
    assert {entry.reason: entry.count for entry in outcome.refusals} == {
        "transform not usable": 1,
        "stamp not newer than the last": 1,
        "frame not usable": 2,
        "transforms too far apart": 1,
    }
    assert outcome.tally.cycles == 9


def test_a_clock_that_is_set_back_begins_anew(tmp_path: Path) -> None:
    entries = recorded(10)
    again = [Entry(e.topic, e.kind, e.log_time + 10**9, e.message) for e in entries]
    far = recorded(5)
    for e in far[1:]:
        e.message.transforms[0].header.stamp.sec -= 100
    bag = write_bag(
        tmp_path / "bag",
        entries + [Entry(e.topic, e.kind, BEGIN + 2 * 10**9 + i, e.message) for i, e in enumerate(far)],
    )
    outcome = run(bag, tmp_path / "out", points=20, **FRAMES)
    assert outcome.tally.restarts == 1
    assert outcome.tally.cycles == 15
    repeated = write_bag(tmp_path / "repeated", entries + again[1:3])  # repeated stamps: no new cycle
    assert run(repeated, tmp_path / "out2", points=20, **FRAMES).tally.cycles == 10


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"right_frame": "rigth_tool"}, "/tf: nobody sends frame 'rigth_tool'; there are 'left_base', 'left_tool'"),
        ({"frame_id": "map"}, "/tf: nobody sends frame 'map', in which 'left_tool' is wanted"),
        ({"left_frame": "left_base", "right_frame": "right_base"}, "by static transforms alone: they have no time"),
        ({"tf_topic": "/cell/tf"}, "has no topic /cell/tf"),
    ],
)
def test_frames_that_are_not_there_are_told(tmp_path: Path, more: dict[str, str], text: str) -> None:
    bag = write_bag(tmp_path / "bag", recorded(3))
    with pytest.raises(cs.BagError) as caught:
        run(bag, tmp_path / "out", **{**FRAMES, **more})
    assert text in str(caught.value)


def test_a_recording_of_transforms_alone_says_what_to_give(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", recorded(3))
    with pytest.raises(cs.BagError, match=r"or /tf \(tf2_msgs/msg/TFMessage\) with --left-frame and --right-frame"):
        run(bag, tmp_path / "out")
    with pytest.raises(cs.ArgumentError, match="Give --left-frame and --right-frame"):
        run(bag, tmp_path / "out", input="tf")
    with pytest.raises(cs.ArgumentError, match="Give --left-frame and --right-frame"):
        run(bag, tmp_path / "out", left_frame="left_tool")


def test_topics_of_another_type_are_told(tmp_path: Path) -> None:
    for topic in (TF, STATIC):
        other = [pose_entry(topic, BEGIN, (0, 0, 0)), *(e for e in recorded(3) if e.topic != topic)]
        bag = write_bag(tmp_path / topic.strip("/"), other)
        with pytest.raises(cs.BagError, match=f"{topic} is of type geometry_msgs/msg/PoseStamped"):
            run(bag, tmp_path / "out", **FRAMES)


def test_the_command_takes_the_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries = [Entry(f"/cell{e.topic}", e.kind, e.log_time, e.message) for e in recorded(5)]
    bag = write_bag(tmp_path / "bag", entries)
    cable = Path(__file__).resolve().parents[2] / "config" / "cables" / "demo.yaml"
    options = ["--cable", str(cable), "--tf-topic", "/cell/tf", "--no-rrd", "--no-picture", *OPTIONS]
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), *options]) == 0
    assert report_of(tmp_path / "out")["input"]["source"] == "tf"
    assert "cycles                     5\n" in capsys.readouterr().out
