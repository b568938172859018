"""A node under test that the benchmark feeds itself: :class:`FedNode`."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, final

import rclpy
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableShape
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
DAY = 86_400 * 10**9  # ns, so that the phase of a motion keeps its digits
STARTUP_S = 120.0  # the node may have to compile its kernels
LATE_S = 0.2  # s, after the last poses no shape is waited for longer
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
        self._waiting = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, listener.context.handle)

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

    def feed(
        self, poses: Callable[[int], Sequence[Sequence[float]]], rate: float, rounds: int, shapes: int = 1
    ) -> list[float]:
        """Sends rounds of `poses` of a stamp at a rate [Hz].

        Returns
        -------
        list of float
            [s], of each round from its last pose until the last of its shapes came, or those of a later round where the
            node has overtaken it; infinite if none came.
        """
        waits: list[float] = []
        open_rounds: deque[tuple[int, float]] = deque()
        missing: dict[int, int] = {}
        due = time.monotonic()
        for k in range(rounds + 1):
            if k < rounds:
                stamp = time.time_ns()
                self.send(stamp, poses(stamp))
                open_rounds.append((stamp, time.monotonic()))
                missing[stamp] = shapes
            due += 1.0 / rate if k < rounds else LATE_S
            while open_rounds and time.monotonic() < due:
                taken = self._taken(due - time.monotonic())
                if taken is None:
                    continue
                now, at = time.monotonic(), taken.header.stamp
                came = at.sec * 10**9 + at.nanosec
                if came not in missing:  # of an earlier turn
                    continue
                missing[came] -= 1
                while not missing[came] and open_rounds and open_rounds[0][0] <= came:
                    waits.append(now - open_rounds.popleft()[1])
            time.sleep(max(0.0, due - time.monotonic()) if k < rounds else 0.0)
        return waits + [math.inf] * len(open_rounds)

    def _taken(self, seconds: float) -> CableShape | None:
        """The next shape, waited for without keeping a core busy, on which the node may have to run."""
        self._waiting.clear_entities()
        self._waiting.add_subscription(self.shapes.handle)
        self._waiting.wait(max(0, round(1e9 * seconds)))
        taken = self.shapes.handle.take_message(self.shapes.msg_type, False)
        return None if taken is None else taken[0]

    def close(self) -> None:
        """Ends it."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(30)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
