"""Small real rosbag2 recordings for the tests of bags, replay and command line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from cable_shape.replay.bag_writer import cable_shape_store

STORE = cable_shape_store()
TYPES = STORE.types
LEFT, RIGHT, JOINTS, MARKERS = "/left_gripper/pose", "/right_gripper/pose", "/joint_states", "/cable/markers"
POSE, JOINT_STATE, POSE_ARRAY = (
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/PoseArray",
)
ALONG_X = (0.5, 0.5, 0.5, 0.5)
BEGIN = 1_700_000_000_000_000_000  # ns
PERIOD = 10_000_000  # ns

MCAP, SQLITE3 = StoragePlugin.MCAP, StoragePlugin.SQLITE3


@dataclass(frozen=True)
class Entry:
    """One recorded message; `raw` in place of `message` is written as it is."""

    topic: str
    kind: str
    log_time: int
    message: Any = None
    raw: bytes = b""


def header(stamp: int, frame: str = "world") -> Any:
    time = TYPES["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
    return TYPES["std_msgs/msg/Header"](time, frame)


def pose(position: Sequence[float], quaternion: Sequence[float] = ALONG_X) -> Any:
    return TYPES["geometry_msgs/msg/Pose"](
        TYPES["geometry_msgs/msg/Point"](*map(float, position)),
        TYPES["geometry_msgs/msg/Quaternion"](*map(float, quaternion)),
    )


def pose_entry(
    topic: str,
    stamp: int,
    position: Sequence[float],
    quaternion: Sequence[float] = ALONG_X,
    frame: str = "world",
    log_time: int | None = None,
) -> Entry:
    message = TYPES[POSE](header(stamp, frame), pose(position, quaternion))
    return Entry(topic, POSE, stamp if log_time is None else log_time, message)


def markers_entry(stamp: int, points: Iterable[Sequence[float]], frame: str = "world") -> Entry:
    poses = [pose(point, (0.0, 0.0, 0.0, 1.0)) for point in points]
    return Entry(MARKERS, POSE_ARRAY, stamp, TYPES[POSE_ARRAY](header(stamp, frame), poses))


def joints_entry(stamp: int, names: Sequence[str], positions: Sequence[float]) -> Entry:
    nothing = np.empty(0)
    message = TYPES[JOINT_STATE](header(stamp, ""), list(names), np.array(positions, float), nothing, nothing)
    return Entry(JOINTS, JOINT_STATE, stamp, message)


def ends_at(k: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Positions of the grips at frame k of the motion below: level, 0.7 m to 0.85 m apart."""
    return (0.0, 0.0, 0.5), (0.775 + 0.075 * math.sin(0.3 * k), 0.05 * math.sin(0.2 * k), 0.5)


def motion(frames: int, skew: int = 3_000_000) -> list[Entry]:
    """Two grippers; the right one is stamped `skew` later."""
    entries = []
    for k in range(frames):
        start, end = ends_at(k)
        entries.append(pose_entry(LEFT, BEGIN + k * PERIOD, start))
        entries.append(pose_entry(RIGHT, BEGIN + k * PERIOD + skew, end))
    return entries


def write_bag(
    folder: Path,
    entries: Iterable[Entry],
    storage: StoragePlugin = MCAP,
    compression: CompressionMode = CompressionMode.NONE,
    empty: Mapping[str, str] | None = None,
) -> Path:
    """Writes a rosbag2 folder; `empty` names topics (with their types) on which nothing was recorded."""
    writer = Writer(folder, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for topic, kind in (empty or {}).items():
            connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
        for entry in entries:
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(entry.topic, entry.kind, typestore=STORE)
            raw = entry.raw or bytes(STORE.serialize_cdr(entry.message, entry.kind))
            writer.write(connections[entry.topic], entry.log_time, raw)
    return folder


def storage_file(folder: Path) -> Path:
    """The .mcap or .db3 file of a recording."""
    (file,) = (f for f in folder.iterdir() if f.suffix in (".mcap", ".db3"))
    return file


def cut(folder: Path, size: int) -> Path:
    """Cuts the storage file of a recording off after `size` bytes."""
    file = storage_file(folder)
    file.write_bytes(file.read_bytes()[:size])
    return folder
