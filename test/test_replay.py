"""Replay end to end, on small real recordings and, where present, on real cables."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import (
    ALONG_X,
    BEGIN,
    JOINT_STATE,
    JOINTS,
    LEFT,
    MARKERS,
    MCAP,
    PERIOD,
    POSE,
    RIGHT,
    SQLITE3,
    Entry,
    cut,
    ends_at,
    joints_entry,
    markers_entry,
    motion,
    pose_entry,
    storage_file,
    write_bag,
)
from rosbags.rosbag2 import Reader, StoragePlugin

import cable_shape as cs
from cable_shape.replay.bag_writer import cable_shape_store
from cable_shape.replay.inputs import Held
from cable_shape.replay.markers import MarkerComparison, distance_to_polyline
from cable_shape.replay.outcome import Outcome, Settings
from cable_shape.replay.run import replay

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data"
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
MODEL = "gradient4"


def run(bag: Path, out: Path, **options: Any) -> Outcome:
    given = {"cable": CABLE, "model": MODEL, "points": 60, "rrd": False, "picture": False, **options}
    return replay(bag, out, Settings(**given))


def messages(out: Path, topic: str) -> list[tuple[int, Any]]:
    """(log time, message) of one topic of OUT/replay."""
    store = cable_shape_store()
    with Reader(out / "replay") as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [(time, store.deserialize_cdr(raw, c.msgtype)) for c, time, raw in reader.messages(connections)]


def report_of(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "report.json").read_text())
    return found


@pytest.mark.parametrize("storage", [MCAP, SQLITE3])
def test_every_pair_becomes_a_shape_at_the_older_stamp(tmp_path: Path, storage: StoragePlugin) -> None:
    bag = write_bag(tmp_path / "bag", motion(12), storage)
    outcome = run(bag, tmp_path / "out", picture=True)
    shapes = messages(tmp_path / "out", "/cable/shape")
    assert [time for time, _ in shapes] == [BEGIN + k * PERIOD for k in range(12)]
    for k, (time, message) in enumerate(shapes):
        start, end = ends_at(k)
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time
        assert message.header.frame_id == "world"
        positions = message.positions.reshape(-1, 3)
        np.testing.assert_allclose(positions[[0, -1]], [start, end], atol=1e-9)
        alone = cs.predict(CABLE, cs.Pose(start, ALONG_X), cs.Pose(end, ALONG_X), model=MODEL, points=60)
        np.testing.assert_allclose(positions, alone.positions, atol=2e-5 * CABLE.length)
        assert message.solve_time == 0.0
        assert message.usable
    warnings = messages(tmp_path / "out", "/cable/warnings")
    assert [time for time, _ in warnings] == [time for time, _ in shapes]
    assert outcome.problems == ()
    report = report_of(tmp_path / "out")
    assert report["replay"]["cycles"] == 12
    assert report["replay"]["status"] == {"OK": 12}
    assert report["recording"]["complete"] is True
    assert report["input"] == {
        "source": "poses",
        "frame_id": "world",
        "max_skew": 0.02,
        "unpaired": 0,
        "refused": [],
    }
    times = report["replay"]["cycle_time"]
    assert 0.0 < times["p50"] <= times["p99"] <= times["max"]
    assert (tmp_path / "out" / "report.png").read_bytes().startswith(b"\x89PNG")


def columns(path: Path) -> dict[tuple[str, str], list[Any]]:
    """Everything in a .rrd as (entity, column) -> [(stamp, value), ...], whatever its chunks."""
    import rerun as rr

    rows: dict[tuple[str, str], list[Any]] = {}
    for chunk in rr.chunk.RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if name not in ("rerun.controls.RowId", "stamp")]
        ids = batch.column("rerun.controls.RowId").to_pylist()
        stamps = batch.column("stamp").to_pylist() if "stamp" in batch.schema.names else [None] * len(ids)
        for name in names:
            values = batch.column(name).to_pylist()
            rows.setdefault((chunk.entity_path, name), []).extend(zip(ids, stamps, values, strict=True))
    return {
        key: [(stamp, value) for _, stamp, value in sorted(found, key=lambda row: row[0])]
        for key, found in sorted(rows.items())
    }


def test_two_runs_give_the_same_bytes_and_the_same_columns(tmp_path: Path) -> None:
    entries = motion(8)
    entries[6:6] = [markers_entry(BEGIN + 2 * PERIOD, [(0.1 * k, 0.0, 0.3) for k in range(8)])]
    bag = write_bag(tmp_path / "bag", entries)
    scene = cs.Scene(obstacles=[cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.4, 0.0, 0.2)))])
    for name in ("a", "b"):
        run(bag, tmp_path / name, scene=scene, rrd=True)
    for name in ("replay.mcap", "metadata.yaml"):
        assert (tmp_path / "a/replay" / name).read_bytes() == (tmp_path / "b/replay" / name).read_bytes()
    first, second = columns(tmp_path / "a/replay.rrd"), columns(tmp_path / "b/replay.rrd")
    assert first == second
    lines = first["/world/cables/cable/line", "LineStrips3D:strips"]
    assert len(lines) == 8
    assert len(first["/world/markers", "Points3D:positions"]) == 1
    assert not any("time" in entity for entity, _ in first if entity.startswith("/plots"))


def test_a_second_replay_replaces_the_first(tmp_path: Path) -> None:
    run(write_bag(tmp_path / "long", motion(9)), tmp_path / "out", rrd=True)
    run(write_bag(tmp_path / "short", motion(4)), tmp_path / "out")
    assert len(messages(tmp_path / "out", "/cable/shape")) == 4
    assert report_of(tmp_path / "out")["replay"]["cycles"] == 4
    assert not (tmp_path / "out" / "replay.rrd").exists()


def test_the_recording_itself_is_never_overwritten(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "replay", motion(2))
    for path in (bag, storage_file(bag)):
        with pytest.raises(cs.ArgumentError, match="its replay/ is the recording itself"):
            run(path, tmp_path)
    assert storage_file(bag).is_file()


def test_an_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(2))
    (tmp_path / "out").write_text("")
    with pytest.raises(cs.ArgumentError, match=r"is a file\. Give a folder"):
        run(bag, tmp_path / "out")


def test_grips_are_held_as_asked(tmp_path: Path) -> None:
    """Tool axes across the cable, turned onto it by the offsets; the end swivels, so that its roll does not matter."""
    identity = (0.0, 0.0, 0.0, 1.0)
    entries = []
    for k in range(3):
        start, end = ends_at(k)
        entries += [
            pose_entry(LEFT, BEGIN + k * PERIOD, start, identity),
            pose_entry(RIGHT, BEGIN + k * PERIOD, end, (1.0, 0.0, 0.0, 0.0)),
        ]
    bag = write_bag(tmp_path / "bag", entries)
    offset = cs.Pose((0.0, 0.0, 0.1), ALONG_X)
    run(
        bag,
        tmp_path / "out",
        start=Held(offset=offset),
        end=Held("swivel", cs.Pose((0.0, 0.0, 0.1), (0.5, -0.5, 0.5, -0.5))),
        points=400,
    )
    _, message = messages(tmp_path / "out", "/cable/shape")[0]
    positions = message.positions.reshape(-1, 3)
    np.testing.assert_allclose(positions[0], (0.0, 0.0, 0.6), atol=1e-9)
    np.testing.assert_allclose(positions[-1], np.add(ends_at(0)[1], (0.0, 0.0, -0.1)), atol=1e-9)
    tangent = (positions[1] - positions[0]) / np.linalg.norm(positions[1] - positions[0])
    np.testing.assert_allclose(tangent, (1.0, 0.0, 0.0), atol=0.05)


def robot_file() -> Path:
    path = ROOT / "config" / "robots" / "dual_arm.yaml"
    assert path.is_file()
    return path


def test_joint_states_go_through_the_robot(tmp_path: Path) -> None:
    from cable_shape.robot import Robot

    robot = Robot.from_yaml(robot_file())
    names = list(robot.joint_names)
    expected, entries = [], []
    for k in range(4):
        q = robot.home.copy()
        q[0] += 0.01 * k
        start, end = robot.grips(q)
        expected.append((start.cable_frame.position.copy(), end.cable_frame.position.copy()))
        order = np.roll(np.arange(len(names)), k)
        entries.append(joints_entry(BEGIN + k * PERIOD, [names[i] for i in order], [q[i] for i in order]))
    entries.insert(2, joints_entry(BEGIN + PERIOD + 1, [names[0]], [0.0]))
    entries.insert(3, joints_entry(BEGIN + PERIOD + 2, names, np.full(len(names), math.nan)))
    bag = write_bag(tmp_path / "bag", entries)
    far = max(math.dist(*ends) for ends in expected)
    outcome = run(bag, tmp_path / "out", robot=robot, cable=CABLE.replace(length=1.3 * far))
    shapes = messages(tmp_path / "out", "/cable/shape")
    assert [time for time, _ in shapes] == [BEGIN + k * PERIOD for k in range(4)]
    for (_, message), (start_at, end_at) in zip(shapes, expected, strict=True):
        positions = message.positions.reshape(-1, 3)
        np.testing.assert_allclose(positions[0], start_at, atol=1e-9)
        np.testing.assert_allclose(positions[-1], end_at, atol=1e-9)
    assert all(message.robot_checked for _, message in messages(tmp_path / "out", "/cable/warnings"))
    (refused,) = outcome.refusals
    assert (refused.topic, refused.reason, refused.count) == (JOINTS, "joint state not usable", 2)
    assert "missing; the grippers hang on them" in refused.example


def test_joint_states_without_a_robot_say_what_to_give(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [joints_entry(BEGIN, ["a"], [0.0])])
    with pytest.raises(cs.BagError, match=r"joint states on /joint_states, which need a robot\. Give --robot"):
        run(bag, tmp_path / "out")


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
    assert "--left-topic, --right-topic or --joints-topic" in text


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


def test_the_closest_approach_is_that_to_a_sphere(tmp_path: Path) -> None:
    """Against the distance of the messages' own polylines to the sphere, in closed form."""
    centre, radius = np.array((0.38, 0.05, 0.12)), 0.04
    scene = cs.Scene(
        obstacles=[cs.Obstacle("ball", cs.Sphere(radius), cs.Pose(centre))], warn_distance=0.3, error_distance=0.2
    )
    run(write_bag(tmp_path / "bag", motion(15)), tmp_path / "out", scene=scene)
    distances = [
        distance_to_polyline(centre[None], message.positions.reshape(-1, 3))[0] - radius - 0.5 * CABLE.diameter
        for _, message in messages(tmp_path / "out", "/cable/shape")
    ]
    report = report_of(tmp_path / "out")
    closest = report["replay"]["closest_approach"]
    assert closest["distance"] == pytest.approx(min(distances), abs=1e-9)
    assert closest["body"] == "ball"
    assert closest["stamp"] == BEGIN + int(np.argmin(distances)) * PERIOD
    assert closest["time"] == pytest.approx(int(np.argmin(distances)) * PERIOD * 1e-9)
    counts = {(w["kind"], w["severity"]): w["cycles"] for w in report["replay"]["warnings"]}
    errors = sum(d < 0.2 for d in distances)
    warned = sum(0.2 <= d < 0.3 for d in distances)
    assert counts.get(("CLEARANCE", "ERROR"), 0) == errors
    assert counts.get(("CLEARANCE", "WARN"), 0) == warned
    assert errors + warned > 0
    assert f"{1e3 * min(distances):.1f} mm to ball" in (tmp_path / "out/report.md").read_text()


def test_a_chord_longer_than_the_cable_is_a_status_and_a_warning(tmp_path: Path) -> None:
    run(write_bag(tmp_path / "bag", motion(3)), tmp_path / "out", cable=CABLE.replace(length=0.5))
    report = report_of(tmp_path / "out")
    assert report["replay"]["status"] == {"OVERSTRETCHED": 3}
    assert [w["kind"] for w in report["replay"]["warnings"]] == ["OVERSTRETCHED"]
    assert report["replay"]["longest_chord"] > 0.5


def test_markers_beside_the_centreline_are_measured(tmp_path: Path) -> None:
    """Inner markers a known distance sideways of the vertical plane in which the cable hangs, the outer ones far."""
    start, end = (0.0, 0.0, 0.5), (0.8, 0.0, 0.5)
    shape = cs.predict(CABLE, cs.Pose(start, ALONG_X), cs.Pose(end, ALONG_X), model=MODEL, points=60)
    on_line = shape.positions[[0, 10, 20, 30, 40, 59]].copy()
    sideways = np.array((9.0, 0.010, 0.020, 0.030, 0.050, 9.0))
    on_line[:, 1] += sideways
    entries = []
    for k in range(4):
        entries += [
            pose_entry(LEFT, BEGIN + k * PERIOD, start),
            pose_entry(RIGHT, BEGIN + k * PERIOD, end),
            markers_entry(BEGIN + k * PERIOD, on_line),
        ]
    hidden = on_line.copy()
    hidden[2] = NAN
    entries[-1] = markers_entry(BEGIN + 3 * PERIOD, hidden)
    entries.append(markers_entry(BEGIN + 9 * PERIOD, on_line))
    entries.append(
        Entry(MARKERS, entries[-1].kind, BEGIN + 9 * PERIOD + 1, markers_entry(BEGIN, on_line, "table").message)
    )
    outcome = run(write_bag(tmp_path / "bag", entries), tmp_path / "out")
    expected = np.concatenate([np.tile(sideways[1:-1], 3), sideways[[1, 3, 4]]]) / CABLE.length
    markers = report_of(tmp_path / "out")["markers"]
    assert markers["frames_compared"] == 4
    assert markers["frames_without_a_shape"] == 1
    assert markers["markers_not_finite"] == 1
    assert markers["distances"] == len(expected)
    assert markers["mean"] == pytest.approx(expected.mean(), abs=1e-6)
    assert markers["median"] == pytest.approx(np.median(expected), abs=1e-6)
    assert markers["p90"] == pytest.approx(np.percentile(expected, 90.0), abs=1e-6)
    (refused,) = outcome.refusals
    assert (refused.topic, refused.reason) == (MARKERS, "other frame")


def test_markers_go_with_the_shape_nearest_in_time_in_whatever_order_they_come() -> None:
    line = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    above = [np.array(((0.0, 0.0, 0.0), (0.5, 0.0, height), (1.0, 0.0, 0.0))) for height in (0.1, 0.2, 0.3)]
    comparison = MarkerComparison(length=2.0, max_skew=4)
    comparison.add_markers(0, above[0])  # before any shape
    comparison.add_shape(1, line)
    comparison.add_shape(10, line + np.array((0.0, 0.0, 0.1)))
    comparison.add_markers(8, above[1])  # nearer to 10
    comparison.add_markers(12, above[2])  # waits for the end
    comparison.add_shape(30, None)
    comparison.add_markers(29, above[2])  # the shape is not usable
    comparison.add_markers(50, above[2])  # no shape near
    comparison.finish()
    assert [mean for _, mean in comparison.series] == pytest.approx([0.1, 0.1, 0.2])
    assert (comparison.frames, comparison.unusable, comparison.unpaired) == (3, 1, 1)
    figures = comparison.figures()
    assert figures is not None
    assert figures.mean == pytest.approx(0.4 / 3 / 2.0)


numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
points = st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=6).map(np.array)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(points, points)
def test_distance_to_a_polyline_is_the_smallest_over_a_dense_sampling(markers: Any, line: Any) -> None:
    found = distance_to_polyline(markers, line)
    t = np.linspace(0.0, 1.0, 2001)[:, None]
    samples = np.concatenate([a + t * (b - a) for a, b in itertools.pairwise(line)])
    sampled = np.linalg.norm(markers[:, None] - samples[None], axis=2).min(axis=1)
    assert (found <= sampled + 1e-12).all()
    assert (sampled - found <= 2.0 * math.sqrt(3.0) / 4000.0 + 1e-12).all()


#: EI / w [m^3], free length [m], and the figure in % of a rod with static equilibrium on frames of this speed
REAL = {1: (8.8e-4, 0.998, 3.5)}


@pytest.mark.parametrize("cable_number", sorted(REAL))
def test_a_real_cable_is_followed_as_closely_as_a_static_rod_can(tmp_path: Path, cable_number: int) -> None:
    bag = DATA / f"cable{cable_number}_recording0"
    if not bag.is_dir():
        pytest.skip(f"the recordings of real cables are not at {DATA}")
    ratio, length, figure = REAL[cable_number]
    density = 0.1
    cable = cs.Cable(length=length, linear_density=density, bending_stiffness=ratio * density * 9.81)
    outcome = run(bag, tmp_path / "out", cable=cable, end=Held("swivel"), points=150)
    assert outcome.tally.cycles == 500
    figures = outcome.markers.figures()
    assert figures is not None
    assert figures.frames == 500
    assert 100.0 * figures.mean <= 1.2 * figure
