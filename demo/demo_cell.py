#!/usr/bin/env python3
"""The simulated cell of the demo: two arms carry a cable, and /joint_states says where they are.

Plans one motion (lower the cable onto the table beside the clip that holds its middle, lift, twist the end by a quarter
turn, lower past a post, draw back), by inverse kinematics step by step, then publishes it in real time with stamps of
the system clock, and ends by itself. With --lift it does all that higher. Exit code 0: all published; 1: the motion
cannot be done, nobody listened or it was interrupted; 2: wrong arguments.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from cable_shape.errors import CableShapeError, RobotError
from cable_shape.pose import Pose, multiply
from cable_shape.robots.ik import DualArmIK
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[1]
NOMINAL_DURATION = 20.0  # s, of the key frames below
WAYPOINTS_PER_SECOND = 25.0  # of the nominal motion
#: joints stay below this part of their velocity limits
SPEED_MARGIN = 0.8


class Key(NamedTuple):
    """Where both grips are at one time; between two keys they move with minimum jerk, from rest to rest."""

    time: float  # s
    x: float  # m, of both grips
    chord: float  # m, between the grips, which lie at y = +chord/2 (start) and -chord/2 (end)
    height: float  # m, of both grips
    dip: float  # deg, by which the cable leaves either grip downwards
    twist: float  # deg, of the end grip about the cable's tangent


KEYS = (
    Key(0.0, 0.40, 0.80, 0.32, 15.0, 0.0),
    Key(0.5, 0.40, 0.80, 0.32, 15.0, 0.0),
    Key(4.0, 0.40, 0.84, 0.17, 20.0, 0.0),  # lower onto the table
    Key(7.5, 0.40, 0.84, 0.28, 10.0, 0.0),  # lift
    Key(11.5, 0.40, 0.84, 0.28, 10.0, -90.0),  # twist
    Key(15.5, 0.47, 0.83, 0.17, 20.0, -90.0),  # lower past the post
    Key(19.0, 0.40, 0.84, 0.28, 10.0, -90.0),  # draw back
    Key(20.0, 0.40, 0.84, 0.28, 10.0, -90.0),
)


class Plan(NamedTuple):
    """A joint path that passes through every waypoint at its time."""

    names: tuple[str, ...]
    times: np.ndarray  # (k,) s, of the waypoints
    path: CubicSpline  # time [s] -> (n,) joint positions [rad] or [m]

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1])


def minimum_jerk(t: float) -> Key:
    """The grips at the nominal time `t` [s]: x(u) = a + (b - a)(10 u^3 - 15 u^4 + 6 u^5) between two keys."""
    after = next((i for i, key in enumerate(KEYS) if key.time >= t), len(KEYS) - 1)
    a, b = KEYS[max(after - 1, 0)], KEYS[after]
    u = 0.0 if b.time == a.time else min(1.0, max(0.0, (t - a.time) / (b.time - a.time)))
    part = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    values = [p + (q - p) * part for p, q in zip(a, b, strict=True)]
    return Key(t, *values[1:])


def about(axis: int, degrees: float) -> np.ndarray:
    """The quaternion x y z w of a turn about a coordinate axis."""
    half = np.radians(degrees) / 2.0
    out = np.array((0.0, 0.0, 0.0, np.cos(half)))
    out[axis] = np.sin(half)
    return out


def cable_ends(key: Key) -> tuple[Pose, Pose]:
    """The cable frames at start and end: d3 runs from left to right (-y), d1 forward (+x) before the twist."""
    level = about(0, 90.0)
    start = Pose((key.x, 0.5 * key.chord, key.height), multiply(about(0, key.dip), level))
    turned = multiply(level, about(2, key.twist))
    end = Pose((key.x, -0.5 * key.chord, key.height), multiply(about(0, -key.dip), turned))
    return start, end


def plan(robot: Robot, duration: float = NOMINAL_DURATION, lift: float = 0.0) -> Plan:
    """The joint path of the demo, stretched to `duration` [s] and raised by `lift` [m].

    Raises
    ------
    RobotError
        If a waypoint is out of reach or a joint would be too fast.
    """
    ik = DualArmIK(robot, position_tolerance=1e-6, rotation_tolerance=1e-6)
    count = int(NOMINAL_DURATION * WAYPOINTS_PER_SECOND) + 1
    nominal = np.linspace(0.0, NOMINAL_DURATION, count)
    joints = np.empty((count, len(robot.joint_names)))
    q = robot.home
    for i, t in enumerate(nominal):
        key = minimum_jerk(float(t))
        result = ik.solve(*cable_ends(key._replace(height=key.height + lift)), q)
        if not result.converged:
            raise RobotError(
                f"the grips at {t:.2f} s are out of reach: {result.position_error * 1e3:.3g} mm and "
                f"{result.rotation_error:.3g} rad off after {result.iterations} iterations. Change KEYS."
            )
        joints[i] = q = result.q
    times = nominal * (duration / NOMINAL_DURATION)
    path = CubicSpline(times, joints, bc_type="clamped")
    fine = np.linspace(0.0, duration, 10 * count)
    share = np.abs(path(fine, 1)).max(axis=0) / robot.velocity_limits
    if share.max() > SPEED_MARGIN:
        worst = int(share.argmax())
        raise RobotError(
            f"{robot.joint_names[worst]} would move at {share[worst]:.2f} of its velocity limit, at most "
            f"{SPEED_MARGIN} is allowed. Raise --duration above {duration * share[worst] / SPEED_MARGIN:.1f} s."
        )
    return Plan(robot.joint_names, times, path)


def publish(motion: Plan, rate: float, namespace: str, wait: float) -> bool:
    """Publishes the motion as JointState at `rate` [Hz]; False if nobody listens within `wait` [s] or on a signal."""
    import rclpy
    from rclpy.duration import Duration
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import JointState

    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("demo_cell", namespace=namespace)
    try:
        publisher = node.create_publisher(JointState, "joint_states", 10)
        until = time.monotonic() + wait
        while wait > 0.0 and publisher.get_subscription_count() == 0 and not stop.wait(0.02):
            if time.monotonic() > until:
                print(f"demo_cell: nobody subscribed to {publisher.topic_name} within {wait:g} s", file=sys.stderr)
                return False
        message = JointState(name=list(motion.names))
        print(f"demo_cell: moving for {motion.duration:.1f} s", flush=True)
        began = time.monotonic()
        sent, worst_gap, last = 0, 0.0, began
        count = round(motion.duration * rate) + 1
        while sent < count:
            due = began + sent / rate
            if stop.wait(max(0.0, due - time.monotonic())):
                break
            now = time.monotonic()
            t = min(now - began, motion.duration)  # where the arms are now, even if this process woke up late
            message.header.stamp = node.get_clock().now().to_msg()
            message.position = motion.path(t).tolist()
            message.velocity = motion.path(t, 1).tolist()
            publisher.publish(message)
            worst_gap, last = max(worst_gap, now - last), now
            # ticks that were slept through are left out, not sent in a burst
            sent = max(sent + 1, int((now - began) * rate))
        if stop.is_set():
            print("demo_cell: interrupted", file=sys.stderr)
            return False
        publisher.wait_for_all_acked(Duration(seconds=10.0))
        print(f"demo_cell: {motion.duration:.1f} s published at {rate:g} Hz, longest gap {worst_gap * 1e3:.1f} ms")
        return True
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def positive(text: str) -> float:
    """A finite number above 0, for argparse."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} must be a finite number above 0")
    return value


def main(arguments: list[str] | None = None) -> int:
    """Plans, then publishes or, with --dry-run, writes the path."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=positive, default=NOMINAL_DURATION, help="of the motion [s]")
    parser.add_argument("--lift", type=float, default=0.0, help="of all heights [m]")
    parser.add_argument("--rate", type=positive, default=200.0, help="of the joint states [Hz]")
    parser.add_argument("--namespace", default="", help="of the node, and so of joint_states")
    parser.add_argument("--wait", type=float, default=60.0, help="for a first subscriber [s]; 0: do not wait")
    parser.add_argument("--robot", type=Path, default=ROOT / "config/robots/dual_arm.yaml", help="robot YAML")
    parser.add_argument(
        "--dry-run", type=Path, metavar="FILE.npz", help="write names, times, positions; publish nothing"
    )
    options = parser.parse_args(arguments)
    try:
        motion = plan(Robot.from_yaml(options.robot), options.duration, options.lift)
    except CableShapeError as error:
        print(f"demo_cell: {error}", file=sys.stderr)
        return 1
    if options.dry_run is None:
        return 0 if publish(motion, options.rate, options.namespace, options.wait) else 1
    times = np.linspace(0.0, motion.duration, round(motion.duration * options.rate) + 1)
    np.savez(options.dry_run, names=np.array(motion.names), times=times, positions=motion.path(times))
    print(f"demo_cell: {len(times)} joint positions written to {options.dry_run}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
