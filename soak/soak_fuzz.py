"""Random messages, as fast as they can be sent, at a node over DDS: it must live, and predict when good ones follow.

The messages are of every kind that a broken publisher makes: fields that are not finite, huge or subnormal, quaternions
of any length, stamps of the past, of the future and zero, other frames, long and unknown names, jumps.
"""

from __future__ import annotations

import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableShape
from cell_node import SENSOR, STARTUP_S
from cell_scene import CONFIG
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from cable_shape.robots.robot import Robot

AWAKE_EVERY = 2000  # messages, between looks whether good ones are answered
ANSWER_S = 120.0
PAUSE = 3e-4  # s, after each message, so that most are read and not overtaken
BATCH = 20  # messages between looks at what the node says
FRAMES = ("world", "world", "world", "world", "", "map", "ü" * 40, "/world", "world\n")
ALONG_X = (0.5, 0.5, 0.5, 0.5)


class Abuse:
    """Makes the messages; the same seed makes the same ones, but for the time in their stamps."""

    def __init__(self, seed: int, joints: tuple[str, ...]) -> None:
        self.chance = random.Random(seed)
        self.joints = joints

    def number(self) -> float:
        """Any float: usual, extreme, or 64 random bits."""
        kind = self.chance.randrange(8)
        if kind < 5:
            return self.chance.uniform(-1.0, 1.0)
        if kind < 7:
            return self.chance.choice((0.0, -0.0, 1e-320, 1e300, -1e300, float("nan"), float("inf"), float("-inf")))
        return float(struct.unpack("d", self.chance.randbytes(8))[0])

    def stamp(self) -> Time:
        """Mostly now."""
        now = time.time_ns()
        kind = self.chance.randrange(12)
        if kind == 0:
            return Time()
        if kind == 1:
            return Time(sec=self.chance.randrange(-(2**31), 2**31), nanosec=self.chance.randrange(2**32))
        now += self.chance.choice((-2 * 10**9, -(10**8), 10**9)) if kind == 2 else 0
        return Time(sec=now // 10**9, nanosec=now % 10**9)

    def pose(self) -> PoseStamped:
        """A pose of one gripper; every other one is fit for use but for its stamp."""
        message = PoseStamped()
        message.header.stamp = self.stamp()
        message.header.frame_id = self.chance.choice(FRAMES)
        p, o = message.pose.position, message.pose.orientation
        if self.chance.random() < 0.5:
            p.x, p.y, p.z = (self.chance.uniform(-0.5, 0.9) for _ in range(3))
            o.x, o.y, o.z, o.w = ALONG_X
            message.header.frame_id = "world"
        else:
            p.x, p.y, p.z, o.x, o.y, o.z, o.w = (self.number() for _ in range(7))
        return message

    def state(self) -> JointState:
        """Joint states with names missing, unknown, repeated, and lists of unequal length."""
        names = list(self.joints)
        if self.chance.random() < 0.5:
            names = [self.chance.choice((*self.joints, "", "x" * 300)) for _ in range(self.chance.randrange(40))]
        positions = [self.number() for _ in range(max(0, len(names) + self.chance.choice((0, 0, 0, -1, 1))))]
        message = JointState(name=names, position=positions)
        message.header.stamp = self.stamp()
        return message


def fuzz(count: int, seed: int) -> list[str]:
    """Sends `count` messages; what went wrong."""
    robot = Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml")
    abuse = Abuse(seed, tuple(robot.joint_names))
    node = rclpy.create_node("fuzz", namespace="fuzzed")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    keep_all = QoSProfile(depth=100)
    poses = [node.create_publisher(PoseStamped, f"{side}_gripper/pose", keep_all) for side in ("left", "right")]
    joints = node.create_publisher(JointState, "joint_states", SENSOR)
    shapes: list[CableShape] = []
    values: dict[str, str] = {}
    node.create_subscription(CableShape, "cable/shape", shapes.append, 10)
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: values.update({pair.key: pair.value for status in message.status for pair in status.values}),
        10,
    )
    parameters = {
        "cable_file": CONFIG / "cables" / "demo.yaml",
        "robot_file": CONFIG / "robots" / "dual_arm.yaml",
        "frame_id": "world",  # else that of the first message
    }
    command = [sys.executable, "-m", "cable_shape.ros.node", "--ros-args", "-r", "__ns:=/fuzzed"]
    for name, value in parameters.items():
        command += ["-p", f"{name}:={value}"]
    with tempfile.TemporaryDirectory(prefix="soak_") as folder:
        log = Path(folder, "node.log")
        with log.open("w") as file:
            child = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        try:
            end = time.monotonic() + STARTUP_S
            while values.get("state") != "active" or not all(p.get_subscription_count() for p in (*poses, joints)):
                executor.spin_once(timeout_sec=0.1)
                if child.poll() is not None or time.monotonic() > end:
                    return [f"the node did not become active:\n{log.read_text()}"]
            for k in range(count):
                if k % 5 == 4:
                    joints.publish(abuse.state())
                else:
                    poses[k % 2].publish(abuse.pose())
                time.sleep(PAUSE)
                if k % BATCH == 0:
                    executor.spin_once(timeout_sec=0.0)
                if k % AWAKE_EVERY == AWAKE_EVERY - 1 or k == count - 1:
                    if not answered(executor, poses, shapes):
                        return [f"no shape for good poses after {k + 1} messages:\n{log.read_text()[-4000:]}"]
                    shapes.clear()
            counts = {key: int(number) for key, number in values.items() if number.isdigit()}
            refused = sum(number for key, number in counts.items() if key.startswith("refused"))
            overtaken = sum(number for key, number in counts.items() if key.startswith("overtaken"))
            print(
                f"{count} random messages sent, {count - overtaken} read, {refused} refused; {counts['cycles']} cycles"
            )
            defects = log.read_text().count("Traceback")
            wrong = [f"{defects} defects:\n{log.read_text()[-4000:]}"] if defects else []
            return wrong + ([f"the node refused nothing: {values}"] if not refused else [])
        finally:
            child.send_signal(signal.SIGINT)
            if child.wait(STARTUP_S):
                print(f"the node ended with exit code {child.returncode}", file=sys.stderr)


def answered(executor: Any, poses: list[Any], shapes: list[CableShape]) -> bool:
    """Whether good poses come back as a usable shape; stamps of the future may have to be overcome first."""
    end = time.monotonic() + ANSWER_S
    begun = time.time_ns()
    while time.monotonic() < end:
        now = time.time_ns()
        for publisher, x in zip(poses, (0.0, 0.4), strict=True):
            message = PoseStamped()
            message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
            message.header.frame_id = "world"
            p, o = message.pose.position, message.pose.orientation
            p.x, p.z = x, 0.5
            o.x, o.y, o.z, o.w = ALONG_X
            publisher.publish(message)
        executor.spin_once(timeout_sec=0.05)
        stamps = [(s.header.stamp.sec * 10**9 + s.header.stamp.nanosec, s.usable) for s in shapes]
        if any(begun <= stamp <= now and usable for stamp, usable in stamps):
            return True
    return False
