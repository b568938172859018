"""Replays one recording many times, each in a process of its own: the same bytes, the same columns of the .rrd."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from cell_scene import CONFIG
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from cable_shape.pose import multiply

FRAMES, PERIOD, BEGIN = 200, 10_000_000, 1_700_000_000_000_000_000  # ns
ALONG_X = (0.5, 0.5, 0.5, 0.5)
POSE = "geometry_msgs/msg/PoseStamped"
BYTES = ("replay/replay.mcap", "replay/metadata.yaml")


def write_recording(folder: Path, storage: str = "mcap", frames: int = FRAMES) -> None:
    """Two grippers that move, one of them turning, over the demo's scene."""
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = store.types
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        sides = [writer.add_connection(f"/{side}_gripper/pose", POSE, typestore=store) for side in ("left", "right")]
        for k in range(frames):
            stamp = BEGIN + k * PERIOD
            x = 0.6 + 0.1 * np.sin(0.05 * k)
            angle = 0.3 * np.sin(0.08 * k)  # about the tangent
            roll = np.array((0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)))
            for side, place, turn in zip(
                sides, ((0.0, 0.0, 0.5), (x, 0.05 * np.sin(0.03 * k), 0.5)), ((0.0, 0.0, 0.0, 1.0), roll), strict=True
            ):
                header = types["std_msgs/msg/Header"](
                    types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "world"
                )
                pose = types["geometry_msgs/msg/Pose"](
                    types["geometry_msgs/msg/Point"](*map(float, place)),
                    types["geometry_msgs/msg/Quaternion"](*map(float, multiply(np.array(ALONG_X), np.array(turn)))),
                )
                writer.write(side, stamp, store.serialize_cdr(types[POSE](header, pose), POSE))


def digest(out: Path) -> dict[str, str]:
    """What a replay wrote: the bytes of the bag, the decoded rows of the .rrd."""
    import rerun as rr

    digests = {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in BYTES}
    rows: list[str] = []
    for chunk in rr.chunk.RrdReader(str(out / "replay.rrd")).stream().to_chunks():
        batch = chunk.to_record_batch()
        names = sorted(name for name in batch.schema.names if not name.startswith("rerun.controls"))
        columns = [batch.column(name).to_pylist() for name in names]
        rows += [f"{chunk.entity_path} {names} {row}" for row in zip(*columns, strict=True)]
    digests["replay.rrd"] = hashlib.sha256("\n".join(sorted(rows)).encode()).hexdigest()
    return digests


def repeat(count: int) -> list[str]:
    """Replays it `count` times; what differed from the first time."""
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="soak_") as place:
        folder = Path(place)
        write_recording(folder / "bag")
        first: dict[str, str] = {}
        for k in range(count):
            out = folder / "out"
            command = [
                sys.executable,
                "-m",
                "cable_shape.command.cli",
                "replay",
                folder / "bag",
                "-o",
                out,
                "--no-picture",
            ]
            command += ["--cable", CONFIG / "cables" / "demo.yaml", "--scene", CONFIG / "scenes" / "demo.yaml"]
            seeded = {**os.environ, "PYTHONHASHSEED": str(k)}
            done = subprocess.run(command, env=seeded, capture_output=True, text=True, check=False)
            if done.returncode:
                return [f"replay {k} ended with exit code {done.returncode}: {done.stderr}"]
            found = digest(out)
            first = first or found
            wrong += [
                f"replay {k}: {name} differs from that of replay 0" for name in found if found[name] != first[name]
            ]
        for name, value in first.items():
            print(f"{count} replays of {FRAMES} frames, {name}: sha256 {value[:16]}...")
    return wrong
