#!/usr/bin/env python
"""How long after the second gripper pose was published the centreline arrives, over DDS, beside an empty echo node.

    scripts/bench cell [--quick] [--rates 125 250 500] [--seconds 20] [--view FILE.rrd] [--save FILE] [--compare FILE]
    scripts/bench cell --viewer       # what a viewer costs that is attached, blocked or killed
    scripts/bench cell --cables 10    # that many cables on one node, beside one
    scripts/bench cell --priority     # what a real-time priority does on a busy machine; needs the right to it
    scripts/bench cell --calibration  # what a calibration costs that goes on beside; part of the whole, too

Four processes: a publisher (two gripper poses and joint states), the node (20 obstacles, the links of two arms, viewer
off), an echo node that answers the same messages with a ready-made shape, and a receiver. The publisher feeds
node and echo in turns of one second, so that whatever else the machine does meets both. Exit status 0 if p50 is at most
1.5 times and p99 at most 3 times the echo's at every rate, and p99 beside a calibration at most 1.5 times that without.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cell_calibration
import cell_viewer
import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableShape, CableWarnings
from cell_node import SENSOR, STARTUP_S
from cell_scene import CONFIG, motion, node_command
from figures import Figures, bench_options, bench_parser, finish
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from cable_shape.robots.robot import Robot

RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NAMES = ("echo", "node")
TURN_S = 1.0
POINTS = 150
P50_ALLOWED, P99_ALLOWED = 1.5, 3.0
TOPICS = (("left_gripper/pose", PoseStamped), ("right_gripper/pose", PoseStamped), ("joint_states", JointState))


def spun(node: Node) -> None:
    """Spins until a signal."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


def echo() -> None:
    """The least that a node in Python can do with these messages."""
    node = rclpy.create_node("echo", namespace="echo")
    shape = CableShape(cable_id="cable", model="cosserat", usable=True, length=1.0)
    for name, width in (
        ("arc_length", 1), ("positions", 3), ("quaternions", 4), ("curvature", 3), ("force", 3), ("moment", 3)
    ):  # fmt: skip
        setattr(shape, name, np.zeros(width * POINTS))
    warnings = CableWarnings()
    shapes = node.create_publisher(CableShape, "cable/shape", RELIABLE)
    warned = node.create_publisher(CableWarnings, "cable/warnings", LATCHED)

    def answer(message: PoseStamped) -> None:
        shape.header = warnings.header = message.header
        shapes.publish(shape)
        warned.publish(warnings)

    for topic, kind in TOPICS:
        node.create_subscription(kind, topic, answer if topic.startswith("right") else lambda _: None, SENSOR)
    spun(node)


def receive(out: Path) -> None:
    """Keeps when each shape came."""
    node = rclpy.create_node("receiver")
    came: list[tuple[int, int, int]] = []

    def listen(number: int) -> Callable[[CableShape], None]:
        def keep(message: CableShape) -> None:
            now = time.monotonic_ns()
            stamp = message.header.stamp
            came.append((number, stamp.sec * 10**9 + stamp.nanosec, now))

        return keep

    for number, name in enumerate(NAMES):
        node.create_subscription(CableShape, f"/{name}/cable/shape", listen(number), QoSProfile(depth=10))
    spun(node)
    np.save(out, np.array(came, dtype=np.int64).reshape(-1, 3))


def publish(out: Path, rates: list[float], seconds: float) -> None:
    """Feeds echo and node in turns; keeps the rate and when each second pose was published."""
    node = rclpy.create_node("publisher")
    sides = [[node.create_publisher(kind, f"/{name}/{topic}", SENSOR) for topic, kind in TOPICS] for name in NAMES]
    robot = Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml")
    end = time.monotonic() + STARTUP_S
    while not all(p.get_subscription_count() for publishers in sides for p in publishers):
        if time.monotonic() > end:
            raise TimeoutError("a subscriber did not come")
        time.sleep(0.1)
    time.sleep(1.0)
    sent: list[tuple[int, int, int, int]] = []
    for rate in rates:
        rows = motion(robot, round(4.0 * rate), rate)
        step, k = 1.0 / rate, 0
        for turn in range(2 * max(1, round(seconds / TURN_S))):
            number = turn % 2
            left, right, joints = sides[number]
            due = time.monotonic() + step
            for _ in range(round(TURN_S * rate)):
                q, poses = rows[k % len(rows)]
                k += 1
                stamp = time.time_ns()
                time_of = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
                state = JointState(name=list(robot.joint_names), position=q)
                state.header.stamp = time_of
                made = []
                for pose in poses:
                    message = PoseStamped()
                    message.header.frame_id = "world"
                    message.header.stamp = time_of
                    p, o = message.pose.position, message.pose.orientation
                    p.x, p.y, p.z, o.x, o.y, o.z, o.w = pose
                    made.append(message)
                time.sleep(max(0.0, due - time.monotonic()))
                due += step
                joints.publish(state)
                left.publish(made[0])
                began = time.monotonic_ns()
                right.publish(made[1])
                sent.append((round(rate), number, stamp, began))
            time.sleep(0.05)
    np.save(out, np.array(sent, dtype=np.int64))


def measured(folder: Path, rates: list[float], seconds: float, view: str) -> tuple[np.ndarray, np.ndarray]:
    """What was sent (rate, side, stamp, time) and what came (side, stamp, time)."""
    me = [sys.executable, __file__]
    options = ["--seconds", str(seconds), "--rates", *map(str, rates)]
    log = (folder / "node.log").open("w")
    children = [
        subprocess.Popen(node_command(folder, view), stdout=log, stderr=subprocess.STDOUT),
        subprocess.Popen([*me, "--role", "echo"]),
        subprocess.Popen([*me, "--role", "receive", "--out", str(folder / "came.npy")]),
    ]
    try:
        subprocess.run([*me, "--role", "publish", "--out", str(folder / "sent.npy"), *options], check=True)
        time.sleep(0.5)
    except subprocess.CalledProcessError:
        print((folder / "node.log").read_text(), file=sys.stderr)
        raise
    finally:
        for child in reversed(children):
            child.send_signal(signal.SIGINT)
            child.wait(30)
        log.close()
    return np.load(folder / "sent.npy"), np.load(folder / "came.npy")


def report(sent: np.ndarray, came: np.ndarray, collected: Figures) -> None:
    """A table of latencies; keeps whether the bounds hold."""
    arrivals = {(int(side), int(stamp)): int(at) for side, stamp, at in came}
    beside: list[tuple[int, float, float]] = []
    print("| rate | node | answered | p50 | p90 | p99 | max ms | p50 / echo | p99 / echo |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for rate in dict.fromkeys(sent[:, 0].tolist()):
        echoed: np.ndarray | None = None
        for side, name in enumerate(NAMES):
            rows = [row for row in sent.tolist() if row[0] == rate and row[1] == side]
            late = [arrivals[side, stamp] - began for _, _, stamp, began in rows if (side, stamp) in arrivals]
            if not late:
                print(f"| {rate} Hz | {name} | 0 % |")
                collected.check(f"{rate} Hz: the {name} answers", False)
                continue
            figures = np.percentile(1e-6 * np.array(late), (50, 90, 99, 100))
            ratios = "|  |  |"
            if echoed is not None:
                p50, p99 = figures[0] / echoed[0], figures[2] / echoed[2]
                beside.append((rate, p50, p99))
                ratios = f"| {p50:.2f} | {p99:.2f} |"
            echoed = figures if side == 0 else echoed
            numbers = " | ".join(f"{figure:.2f}" for figure in figures)
            print(f"| {rate} Hz | {name} | {len(late) / len(rows):.1%} | {numbers} {ratios}")
    for rate, p50, p99 in beside:
        collected.at_most(f"{rate} Hz: p50 of the node / of the echo", p50, P50_ALLOWED, "{:.2f}")
        collected.at_most(f"{rate} Hz: p99 of the node / of the echo", p99, P99_ALLOWED, "{:.2f}")


def main() -> int:
    """Runs all processes, or one of them."""
    parser = bench_parser(__doc__, "two seconds at 250 Hz, one round")
    parser.add_argument("--rates", type=float, nargs="+", help="[Hz] (125 250 500)")
    parser.add_argument("--seconds", type=float, help="[s] at each rate, of node and of echo (20)")
    parser.add_argument("--view", default="off", help="the node's parameter view")
    parser.add_argument("--viewer", action="store_true", help="compare cycle times with a viewer and without")
    parser.add_argument("--calibration", action="store_true", help="only cycles beside a calibration and without")
    parser.add_argument("--rounds", type=int, help="of --viewer and --calibration (3)")
    parser.add_argument("--cables", type=int, help="on one node; --rates then are 25 50 100 unless given")
    parser.add_argument("--priority", action="store_true", help="compare with a real-time priority and without")
    parser.add_argument("--role", choices=("echo", "receive", "publish"), help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    options = bench_options(parser)
    options.seconds = options.seconds or (2.0 if options.quick else 20.0)
    options.rounds = options.rounds or (1 if options.quick else 3)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if options.viewer:
        return 0 if cell_viewer.run(options.rounds) else 1
    if options.cables:
        import cell_cables

        return 0 if cell_cables.run(options.cables, options.rates or [25.0, 50.0, 100.0]) else 1
    if options.priority:
        import cell_priority

        return 0 if cell_priority.run(options.rates or [125.0]) else 1
    if options.calibration:
        return 0 if cell_calibration.run(options.rounds) else 1
    options.rates = options.rates or ([250.0] if options.quick else [125.0, 250.0, 500.0])
    if options.role is None:
        collected = Figures()
        with tempfile.TemporaryDirectory(prefix="bench_cell_") as folder:
            report(*measured(Path(folder), options.rates, options.seconds, options.view), collected)
        collected.check("cycles beside a calibration keep their p99", cell_calibration.run(options.rounds))
        return finish(collected, options)
    rclpy.init()
    roles = {
        "echo": echo,
        "receive": lambda: receive(options.out),
        "publish": lambda: publish(options.out, options.rates, options.seconds),
    }
    roles[options.role]()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
