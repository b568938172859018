"""Replay end to end, on small real recordings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import (
    ALONG_X,
    BEGIN,
    JOINTS,
    LEFT,
    MCAP,
    PERIOD,
    RIGHT,
    SQLITE3,
    ends_at,
    joints_entry,
    markers_entry,
    motion,
    pose_entry,
    storage_file,
    write_bag,
)
from replays import CABLE, MODEL, messages, report_of, run
from rosbags.rosbag2 import StoragePlugin

import cable_shape as cs
from cable_shape.replay.markers import distance_to_polyline

ROOT = Path(__file__).resolve().parents[2]


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
        start=cs.Held(offset=offset),
        end=cs.Held("swivel", cs.Pose((0.0, 0.0, 0.1), (0.5, -0.5, 0.5, -0.5))),
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
    from cable_shape.robots.robot import Robot

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
