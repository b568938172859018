"""What a viewer costs the node: cycle times with one attached, blocked (SIGSTOP) and killed, beside a node without.

Two nodes of the same scene and robot are fed the same motion in turns, so that whatever else the machine does meets
both; the node's own diagnostics say what the cycles of a turn took.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from cell_node import FedNode
from cell_scene import CONFIG, motion, node_parameters
from sensor_msgs.msg import JointState

from cable_shape.robots.robot import Robot
from cable_shape.ros.diagnostics import TIMES_WINDOW

STATES = {"attached": signal.SIGCONT, "blocked": signal.SIGSTOP, "killed": signal.SIGKILL}
ALLOWED = 1.1  # times the median cycle without a viewer
RATE = 125.0  # Hz


def child_of(pid: int) -> int:
    """The viewer's process."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rsplit(")", 1)[1].split()[1])
        except OSError:  # it has ended
            continue
        if parent == pid:
            return int(stat.parent.name)
    raise RuntimeError("the node has no viewer")


def turn(node: FedNode, rows: list[tuple[list[float], list[list[float]]]], names: list[str]) -> tuple[float, float]:
    """Feeds it for as long as the diagnostics look back; p50 and p99 of its cycles [ms]."""
    due = time.monotonic()
    for k in range(round((TIMES_WINDOW + 1.0) * RATE)):
        q, poses = rows[k % len(rows)]
        node.send(time.time_ns(), poses, JointState(name=names, position=q))
        due += 1.0 / RATE
        time.sleep(max(0.0, due - time.monotonic()))
    values = node.fresh()
    return float(values["cycle time p50 [ms]"]), float(values["cycle time p99 [ms]"])


def compare(rounds: int) -> bool:
    """Prints the table; whether the bound holds in every state."""
    robot = Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml")
    rows, names = motion(robot, round(4.0 * RATE), RATE), list(robot.joint_names)
    holds = True
    with tempfile.TemporaryDirectory(prefix="bench_cell_") as place:
        folder = Path(place)
        with (
            FedNode("without", folder, node_parameters(folder, "off")) as without,
            FedNode("viewed", folder, node_parameters(folder, str(folder / "seen.rrd"))) as viewed,
        ):
            for node in (without, viewed):
                node.wait()
                turn(node, rows, names)
            viewer = child_of(viewed.process.pid)
            print(f"| viewer | p50 ms | without | ratio | p99 ms | without | ({rounds} rounds at {RATE:g} Hz, medians)")
            print("| --- | --- | --- | --- | --- | --- |")
            for state, number in STATES.items():
                os.kill(viewer, number)
                times = np.array([[turn(node, rows, names) for node in (without, viewed)] for _ in range(rounds)])
                (p50, p99), (p50_viewed, p99_viewed) = np.median(times, axis=0)
                ratio = p50_viewed / p50
                holds &= bool(ratio <= ALLOWED)
                print(f"| {state} | {p50_viewed:.2f} | {p50:.2f} | {ratio:.3f} | {p99_viewed:.2f} | {p99:.2f} |")
    print(f"p50 at most {ALLOWED:g} times that without a viewer: {'yes' if holds else 'NO'}")
    return holds


def run(rounds: int) -> bool:
    """See the module."""
    rclpy.init()
    try:
        return compare(rounds)
    finally:
        rclpy.try_shutdown()
