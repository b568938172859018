"""A node under test that benches and soaks feed themselves: :class:`FedNode`."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
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


def started(
    name: str, folder: Path, parameters: Mapping[str, Any], program: Sequence[str] = ("-m", "cable_shape.ros.node")
) -> tuple[subprocess.Popen[bytes], Path]:
    """A node in a process of its own in the namespace `name`, and its log in a folder."""
    command = [sys.executable, *program, "--ros-args", "-r", f"__ns:=/{name}"]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={value}"]
    log = folder / f"{name}.log"
    with log.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, cwd=folder)
    return process, log


def stamped(stamp: int, row: Sequence[float]) -> PoseStamped:
    """A pose (7,) in the world, of a stamp [ns]."""
    message = PoseStamped()
    message.header.stamp, message.header.frame_id = Time(sec=stamp // 10**9, nanosec=stamp % 10**9), "world"
    p, o = message.pose.position, message.pose.orientation
    p.x, p.y, p.z, o.x, o.y, o.z, o.w = map(float, row)
    return message


def stamp_of(message: Any) -> int:
    """[ns]."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


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
    program : sequence of str, optional
        Arguments of Python, in place of the node: of something that answers like it, without diagnostics.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        parameters: Mapping[str, Any],
        cables: Sequence[str] = (),
        program: Sequence[str] | None = None,
    ) -> None:
        if program is None:
            self.process, self.log = started(name, folder, {"diagnostics_period": 0.1, **parameters})
        else:
            self.process, self.log = started(name, folder, parameters, program)
        self.node = rclpy.create_node(f"feeder_{name}", namespace=name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        prefixes = [f"{cable}/" for cable in cables] or [""]
        topics = [f"{prefix}{side}_gripper/pose" for prefix in prefixes for side in ("left", "right")]
        self.poses = [self.node.create_publisher(PoseStamped, topic, SENSOR) for topic in topics]
        self.joints = self.node.create_publisher(JointState, "joint_states", SENSOR)
        self.several = len(prefixes)  # shapes of a round
        self.overtaken = 0  # rounds that were last fed and have no shapes of their own
        self.values: dict[str, str] = {}
        self._speaks, self._heard, self._name = program is None, 0.0, name
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, 10)
        listener = rclpy.create_node(f"listener_{name}", namespace=name)  # not spun: shapes are taken by hand
        depth = QoSProfile(depth=self.several)
        self._shapes = listener.create_subscription(CableShape, "cable/shape", lambda _: None, depth)
        self._waiting = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, listener.context.handle)

    def _hear(self, message: DiagnosticArray) -> None:
        if message.status and message.status[0].name.startswith(f"{self._name}/"):  # others may be on this domain
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
        while (self._speaks and self.values.get("state") != "active") or not all(
            p.get_subscription_count() for p in self.poses
        ):
            self.spin(0.1)
            self.check()
            if time.monotonic() > end:
                raise RuntimeError(f"the node did not become active:\n{self.log.read_text()}")
        self.spin(1.0)

    def check(self) -> None:
        """Raises RuntimeError, with what it wrote, if it has ended."""
        if self.process.poll() is not None:
            raise RuntimeError(f"the node ended:\n{self.log.read_text()}")

    def fresh(self) -> dict[str, str]:
        """The diagnostics after all that was sent."""
        self.spin(FRESH_S)
        sent = time.monotonic()
        while self._speaks and self._heard < sent:
            self.spin(0.02)
        return self.values

    def send(self, stamp: int, poses: Sequence[Sequence[float]], joints: JointState | None = None) -> None:
        """Publishes joint states, if there are any, then a pose for each topic, all under one stamp [ns]."""
        messages = [stamped(stamp, pose) for pose in poses]
        if joints is not None:
            joints.header.stamp = messages[0].header.stamp
            self.joints.publish(joints)
        for publisher, message in zip(self.poses, messages, strict=True):
            publisher.publish(message)

    def feed(self, given: Callable[[int], tuple[Any, ...]], rate: float, rounds: int) -> list[float]:
        """Sends rounds of what is given at a stamp, the arguments of :meth:`send` after it, at a rate [Hz].

        Returns
        -------
        list of float
            [s], of each round from its last pose until the last of its shapes came, or those of a later round where the
            node has overtaken it; infinite if none came.
        """
        waits: list[float] = []
        self.overtaken = 0
        open_rounds: deque[tuple[int, float]] = deque()
        missing: dict[int, int] = {}
        due = time.monotonic()
        for k in range(rounds + 1):
            if k < rounds:
                stamp = time.time_ns()
                self.send(stamp, *given(stamp))
                open_rounds.append((stamp, time.monotonic()))
                missing[stamp] = self.several
            due += 1.0 / rate if k < rounds else LATE_S
            while open_rounds and time.monotonic() < due:
                taken = self._taken(due - time.monotonic())
                if taken is None:
                    continue
                now, came = time.monotonic(), stamp_of(taken)
                if came not in missing:  # of an earlier turn
                    continue
                missing[came] -= 1
                while not missing[came] and open_rounds and open_rounds[0][0] <= came:
                    own, sent = open_rounds.popleft()
                    waits.append(now - sent)
                    self.overtaken += own < came
            time.sleep(max(0.0, due - time.monotonic()) if k < rounds else 0.0)
        self.overtaken += len(open_rounds)
        return waits + [math.inf] * len(open_rounds)

    def _taken(self, seconds: float) -> CableShape | None:
        """The next shape, waited for without keeping a core busy, on which the node may have to run."""
        self._waiting.clear_entities()
        self._waiting.add_subscription(self._shapes.handle)
        self._waiting.wait(max(0, round(1e9 * seconds)))
        taken = self._shapes.handle.take_message(self._shapes.msg_type, False)
        return None if taken is None else taken[0]

    def close(self) -> int:
        """Ends it; its exit status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(STARTUP_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
