"""Random messages, as fast as they can be sent, at a node over DDS: it must live, and predict when good ones follow.

The messages are of every kind that a broken publisher makes: fields that are not finite, huge or subnormal, quaternions
of any length, stamps of the past, of the future and zero, other frames, long and unknown names, jumps.
"""

from __future__ import annotations

import random
import struct
import tempfile
import time
from pathlib import Path

from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableShape
from cell_node import FedNode, stamp_of
from cell_scene import CONFIG
from geometry_msgs.msg import PoseStamped
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
    abuse = Abuse(seed, tuple(Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml").joint_names))
    parameters = {
        "cable_file": CONFIG / "cables" / "demo.yaml",
        "robot_file": CONFIG / "robots" / "dual_arm.yaml",
        "frame_id": "world",  # else that of the first message
    }
    with tempfile.TemporaryDirectory(prefix="soak_") as folder, FedNode("fuzzed", Path(folder), parameters) as fed:
        keep_all, shapes = QoSProfile(depth=100), list[CableShape]()
        poses = [fed.node.create_publisher(PoseStamped, publisher.topic_name, keep_all) for publisher in fed.poses]
        fed.node.create_subscription(CableShape, "cable/shape", shapes.append, 10)
        fed.wait()
        for k in range(count):
            if k % 5 == 4:
                fed.joints.publish(abuse.state())
            else:
                poses[k % 2].publish(abuse.pose())
            time.sleep(PAUSE)
            if k % BATCH == 0:
                fed.spin(1e-4)
            if k % AWAKE_EVERY == AWAKE_EVERY - 1 or k == count - 1:
                if not answered(fed, shapes):
                    return [f"no shape for good poses after {k + 1} messages:\n{fed.log.read_text()[-4000:]}"]
                shapes.clear()
        counts = {key: int(number) for key, number in fed.fresh().items() if number.isdigit()}
        refused, overtaken = (
            sum(number for key, number in counts.items() if key.startswith(what)) for what in ("refused", "overtaken")
        )
        print(f"{count} random messages sent, {count - overtaken} read, {refused} refused; {counts['cycles']} cycles")
        said = fed.log.read_text()
        wrong = [f"{said.count('Traceback')} defects:\n{said[-4000:]}"] if "Traceback" in said else []
        return wrong + ([f"the node refused nothing: {fed.values}"] if not refused else [])


def answered(fed: FedNode, shapes: list[CableShape]) -> bool:
    """Whether good poses come back as a usable shape; stamps of the future may have to be overcome first."""
    begun, end = time.time_ns(), time.monotonic() + ANSWER_S
    while time.monotonic() < end:
        now = time.time_ns()
        fed.send(now, [(x, 0.0, 0.5, *ALONG_X) for x in (0.0, 0.4)])
        fed.spin(0.05)
        if any(shape.usable and begun <= stamp_of(shape) <= now for shape in shapes):
            return True
    return False
