"""A node under test that the benchmark feeds itself: :class:`FedNode`."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, final

import rclpy
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableShape
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
STARTUP_S = 120.0  # the node may have to compile its kernels
FRESH_S = 0.3  # s, diagnostics this long after the last input hold all of it


@final
class FedNode:
    """cable_shape_node in a process of its own, its publishers, and what it says in the diagnostics.

    Parameters
    ----------
    name : str
        Its namespace.
    folder : path
        For its log.
    parameters : mapping
    cables : sequence of str
        Names of several cables; one cable has none.
    """

    def __init__(
        self, name: str, folder: Path, parameters: Mapping[str, Any], cables: Sequence[str] = (), shapes: int = 1
    ) -> None:
        command = [sys.executable, "-m", "cable_shape.ros.node", "--ros-args", "-r", f"__ns:=/{name}"]
        for key, value in {"diagnostics_period": 0.1, **parameters}.items():
            command += ["-p", f"{key}:={value}"]
        self._log = folder / f"{name}.log"
        with self._log.open("w") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        self.node = rclpy.create_node(f"feeder_{name}", namespace=name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        prefixes = [f"{cable}/" for cable in cables] or [""]
        topics = [f"{prefix}{side}_gripper/pose" for prefix in prefixes for side in ("left", "right")]
        self.poses = [self.node.create_publisher(PoseStamped, topic, SENSOR) for topic in topics]
        self.joints = self.node.create_publisher(JointState, "joint_states", SENSOR)
        self.values: dict[str, str] = {}
        self._heard = 0.0
        self._name = name
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, 10)
        listener = rclpy.create_node(f"listener_{name}", namespace=name)  # not spun: `shapes` are taken by hand
        self.shapes = listener.create_subscription(CableShape, "cable/shape", lambda _: None, QoSProfile(depth=shapes))

    def _hear(self, message: DiagnosticArray) -> None:
        if message.status and message.status[0].name.startswith(f"{self._name}/"):
            self.values = {pair.key: pair.value for status in message.status for pair in status.values}
            self._heard = time.monotonic()

    def spin(self, seconds: float) -> None:
        """Listens to the diagnostics."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def wait(self) -> None:
        """Until it is active and hears us."""
        end = time.monotonic() + STARTUP_S
        while self.values.get("state") != "active" or not all(p.get_subscription_count() for p in self.poses):
            self.spin(0.1)
            if self.process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"the node did not become active:\n{self._log.read_text()}")
        self.spin(1.0)

    def fresh(self) -> dict[str, str]:
        """The diagnostics after all that was sent."""
        self.spin(FRESH_S)
        sent = time.monotonic()
        while self._heard < sent:
            self.spin(0.02)
        return self.values

    def send(self, stamp: int, poses: Sequence[Sequence[float]], joints: JointState | None = None) -> None:
        """Publishes joint states, if there are any, then a pose for each topic, all under one stamp [ns]."""
        at = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        if joints is not None:
            joints.header.stamp = at
            self.joints.publish(joints)
        for publisher, pose in zip(self.poses, poses, strict=True):
            message = PoseStamped()
            message.header.stamp, message.header.frame_id = at, "world"
            p, o = message.pose.position, message.pose.orientation
            p.x, p.y, p.z, o.x, o.y, o.z, o.w = pose
            publisher.publish(message)

    def close(self) -> None:
        """Ends it."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(30)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
