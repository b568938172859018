"""How many times as fast as it was recorded a recording of two grippers is replayed, start and report taken in."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from cell_scene import CONFIG
from clocks import clocked
from figures import Figures, heading
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from cable_shape.pose import multiply

FRAMES, PERIOD, BEGIN = 200, 10_000_000, 1_700_000_000_000_000_000  # ns
ALONG_X = (0.5, 0.5, 0.5, 0.5)
POSE = "geometry_msgs/msg/PoseStamped"
ASKED = 20.0  # times


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


def print_replay(figures: Figures, seconds: float) -> None:
    """Of a cable by itself, in a process of its own, as it is typed."""
    heading("Replay of two grippers at 100 Hz")
    with tempfile.TemporaryDirectory(prefix="bench_replay_") as place:
        bag = Path(place) / "bag"
        write_recording(bag, frames=round(1e9 * seconds / PERIOD))
        given = [bag, "-o", Path(place) / "out", "--cable", CONFIG / "cables" / "ethernet.yaml"]
        command = [sys.executable, "-m", "cable_shape.command.cli", "replay", *given]
        before = os.times()
        spent, _ = clocked(lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL))
        used = sum(os.times()[2:4]) - sum(before[2:4])
    print(f"{spent:.1f} s, of the processor {used:.1f} s")
    figures.at_least(f"replay of {seconds:g} s, from its start: times real time", seconds / spent, ASKED)
