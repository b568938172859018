"""Real nodes in processes of their own, and a client over DDS that plays the rest of the robot cell."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nursery import NODES, Forked, nursery

with warnings.catch_warnings():
    # its parser imports a deprecated module of the standard library
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

import rclpy
from builtin_interfaces.msg import Time
from cable_shape_msgs.msg import CableShape
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParametersAtomically
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2, PointField

TIMEOUT = 120.0  # s, bound of every wait; the kernels may have to be compiled within it
FIRST_PATIENCE, LONGEST_PATIENCE = 0.1, 10.0  # s, for what a message leads to, which may be lost; each time longer
ALONG_X = (0.5, 0.5, 0.5, 0.5)  # d3 = x
#: A tracker of its own process, see there.
MOVER = Path(__file__).with_name("mover.py")
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class NodeProcess:
    """cable_shape_node in its own process and namespace.

    fresh: started as by a user, from nothing; else forked from one that has loaded what nodes need, which takes a tenth
    of the time. code: Python's, run in place of the node's module, from nothing.
    """

    def __init__(
        self,
        namespace: str,
        folder: Path,
        arguments: Sequence[str],
        *,
        fresh: bool = False,
        code: str = "",
        **environment: str,
    ) -> None:
        self.namespace = namespace
        self.log = folder / f"{namespace}.log"
        given = ["--ros-args", "-r", f"__ns:=/{namespace}", *arguments]
        env = {**os.environ, **environment}
        self.process: subprocess.Popen[bytes] | Forked
        with self.log.open("w") as log:
            if fresh or code:
                program = ("-c", code) if code else ("-m", "cable_shape.ros.node")
                command = [sys.executable, *program, *given]
                self.process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=folder, env=env)
            else:
                self.process = nursery(NODES).start(given, self.log, self.log, folder, env)

    def stop(self, number: int = signal.SIGINT) -> int:
        """Its exit code after a signal."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def text(self) -> str:
        return self.log.read_text()


class Cell:
    """The other side: publishes grips or joints, keeps what the node sends."""

    def __init__(self, node: NodeProcess) -> None:
        self.process = node
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("cell", namespace=f"/{node.namespace}", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.grippers = tuple(
            self.node.create_publisher(PoseStamped, f"{side}_gripper/pose", sensor) for side in ("left", "right")
        )
        self.joints = self.node.create_publisher(JointState, "joint_states", sensor)
        self.pairs = 0  # published
        self.repeats = 0  # requests that were asked again
        self.clients: dict[str, Any] = {}  # of the node's services
        self.shapes: list[Any] = []
        self.diagnostics: list[Any] = []
        self.node.create_subscription(CableShape, "cable/shape", self.shapes.append, 100)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnose, 100)

    def _diagnose(self, message: Any) -> None:
        if all(status.name.startswith(f"{self.process.namespace}/") for status in message.status):
            self.diagnostics.append(message)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def listen(self, kind: type, topic: str, qos: Any = 10) -> list[Any]:
        """A list that fills with the messages of a topic."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def until(self, done: Callable[[], Any], what: str, timeout: float = TIMEOUT) -> Any:
        """Spins until `done` returns something true, and returns it."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            value = done()
            if value:
                return value
            if not self.process.alive:
                pytest.fail(f"the node ended while waiting for {what}:\n{self.process.text()}")
            self.executor.spin_once(timeout_sec=0.05)
        return pytest.fail(f"no {what} within {timeout} s; the node said:\n{self.process.text()}")

    def spin(self, seconds: float) -> None:
        """Spins for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def send_until(self, publish: Callable[[], Any], done: Callable[[], Any], what: str) -> Any:
        """Publishes until `done` returns something true, ever more rarely, and returns it.

        A message may be lost, be overtaken, or come before the topics have met.
        """
        due, patience = 0.0, FIRST_PATIENCE

        def came() -> Any:
            nonlocal due, patience
            if time.monotonic() >= due:
                publish()
                due, patience = time.monotonic() + patience, min(1.5 * patience, LONGEST_PATIENCE)
            return done()

        return self.until(came, what)

    def answer_to(self, ask: Callable[[], Any], what: str, again: float = 30.0) -> Any:
        """The answer to a request that may be made twice, as after `again` [s] without an answer it is.

        A service may be known before it has found the client, and its answer is lost then; the middleware says so.
        """
        futures: list[Any] = []
        due = 0.0

        def answered() -> Any:
            nonlocal due
            if time.monotonic() >= due:
                self.repeats += bool(futures)
                futures.append(ask())
                due = time.monotonic() + again
            return next((future for future in futures if future.done()), None)

        return self.until(answered, what).result()

    def ask(self, client: Any, request: Any, what: str, again: float = 30.0) -> Any:
        """The answer of a service, see `answer_to`."""
        return self.answer_to(lambda: client.call_async(request), what, again)

    def call(self, kind: type, name: str, request: Any, again: float = 10.0) -> Any:
        """The answer of one of the node's services, see `answer_to`."""
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, f"cable_shape_node/{name}")
        self.until(self.clients[name].service_is_ready, f"service {name}")
        return self.ask(self.clients[name], request, f"answer of {name}", again)

    def state(self) -> str:
        return str(self.call(GetState, "get_state", GetState.Request()).current_state.label)

    def transition(self, number: int) -> bool:
        """Whether it was made: as answered or, where an answer was lost, by the state, which each of them changes."""
        request = ChangeState.Request()
        request.transition.id = number
        before, repeats = self.state(), self.repeats
        made = bool(self.call(ChangeState, "change_state", request, again=30.0).success)
        return made or (self.repeats > repeats and self.state() != before)

    def active(self) -> None:
        """Waits until the node is active and all topics are matched."""
        self.until(lambda: self.state() == "active", "state active")
        self.until(lambda: self.grippers[0].get_subscription_count() or self.joints.get_subscription_count(), "match")
        self.until(lambda: self.node.count_publishers("cable/shape"), "cable/shape")

    def set(self, **values: Any) -> Any:
        """Sets parameters atomically; __ in a name stands for a dot."""
        request = SetParametersAtomically.Request()
        request.parameters = [
            ParameterMessage(name=name.replace("__", "."), value=Parameter(name, value=value).to_parameter_msg().value)
            for name, value in values.items()
        ]
        return self.call(SetParametersAtomically, "set_parameters_atomically", request).result

    def get(self, name: str) -> Any:
        values = self.call(GetParameters, "get_parameters", GetParameters.Request(names=[name])).values
        return Parameter.from_parameter_msg(ParameterMessage(name=name, value=values[0])).value

    def describe(self, names: list[str]) -> Any:
        request = DescribeParameters.Request(names=names)
        return self.call(DescribeParameters, "describe_parameters", request).descriptors

    def now(self) -> int:
        """[ns]"""
        return int(self.node.get_clock().now().nanoseconds)

    def pose(
        self,
        side: int,
        stamp: int,
        position: Sequence[float] | None = None,
        quaternion: Sequence[float] = ALONG_X,
        frame: str = "world",
    ) -> None:
        """Publishes the pose of one gripper."""
        message = PoseStamped()
        message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
        message.header.frame_id = frame
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = position if position is not None else ((0.0, 0.0, 0.5), (0.8, 0.0, 0.5))[side]
        q.x, q.y, q.z, q.w = quaternion
        self.grippers[side].publish(message)

    def pair(self, stamp: int | None = None, **keywords: Any) -> int:
        """Publishes both grippers under one stamp, which it returns."""
        self.pairs += 1
        stamp = self.now() if stamp is None else stamp
        for side in (0, 1):
            self.pose(side, stamp, **keywords)
        return stamp

    def shape_of(self, stamp: int) -> Any:
        """The shape that carries this stamp, if it came."""
        return next((m for m in self.shapes if nanoseconds(m.header.stamp) == stamp), None)

    def predicted(self) -> Any:
        """The shape of a pair, which is published again until it is answered; none of those before it is under way."""
        stamp = 0

        def publish() -> None:
            nonlocal stamp
            stamp = self.pair()

        return self.send_until(publish, lambda: self.shape_of(stamp), "shape")

    def shape_at(self, stamp: int, *places: Sequence[float] | None, late: int = 0) -> Any:
        """The shape of one pair, of which only the first that the node hears is used; left comes `late` [ns] after."""
        left, right = places or (None, None)

        def publish() -> None:
            self.pose(0, stamp + late, left)
            self.pose(1, stamp, right)

        return self.send_until(publish, lambda: self.shape_of(stamp), "shape")

    def diagnosis(
        self, name: str, text: str, level: bytes | None = None, provoke: Callable[[], Any] = lambda: None
    ) -> Any:
        """A fresh diagnostics line `name` whose message holds `text`; `provoke`, see `send_until`, leads to it."""
        self.diagnostics.clear()

        def found() -> Any:
            for message in self.diagnostics:
                for status in message.status:
                    if status.name.endswith(f": {name}") and text in status.message and level in (None, status.level):
                        return status
            return None

        return self.send_until(provoke, found, f"diagnostics {name!r} with {text!r}")


class Goals:
    """A client of an action of the node's workers."""

    def __init__(self, cell: Cell, kind: Any, name: str) -> None:
        self.cell, self.kind = cell, kind
        self.feedback: list[Any] = []
        self.client = ActionClient(cell.node, kind, name)
        cell.until(self.client.server_is_ready, name)
        self._meet()

    def _meet(self) -> None:
        """Has a goal that asks for nothing refused, each request being repeated until it is answered.

        A server that has not found the client yet loses its answers; from then on it has.
        """
        wait = 2.0  # s
        handle = self.cell.answer_to(lambda: self.client.send_goal_async(self.kind.Goal()), "answer to a goal", wait)
        self.cell.answer_to(handle.get_result_async, "result", wait)
        self.cell.answer_to(handle.cancel_goal_async, "answer to a cancellation", wait)

    def send(self, **fields: Any) -> Any:
        """The handle of an accepted goal."""
        goal = self.kind.Goal(**fields)
        sent = self.client.send_goal_async(goal, feedback_callback=lambda m: self.feedback.append(m.feedback))
        self.cell.until(sent.done, "answer to the goal")
        assert sent.result().accepted
        return sent.result()

    def answer(self, handle: Any) -> tuple[int, Any]:
        """Status and result of a goal, once it has ended."""
        found = handle.get_result_async()
        self.cell.until(found.done, "result")
        return found.result().status, found.result().result

    def __call__(self, **fields: Any) -> tuple[int, Any]:
        """Status and result of a new goal."""
        return self.answer(self.send(**fields))


def child_of(cell: Cell, module: str) -> int | None:
    """The process of this module among the node's children."""
    for entry in os.listdir("/proc"):
        if not entry.isdigit():
            continue
        try:
            with open(f"/proc/{entry}/stat") as stat, open(f"/proc/{entry}/cmdline") as command:
                parent, words = int(stat.read().rpartition(")")[2].split()[1]), command.read()
        except OSError:
            continue
        if parent == cell.process.process.pid and module in words:
            return int(entry)
    return None


def viewer_of(cell: Cell) -> int:
    """The process of the node's viewer."""
    return int(cell.until(lambda: child_of(cell, "cable_shape.viewer.child"), "viewer"))


def alive(pid: int) -> bool:
    """Whether a process still runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_until_gone(*pids: int) -> None:
    """Of processes that nobody may wait for."""
    end = time.monotonic() + TIMEOUT
    while any(map(alive, pids)):
        assert time.monotonic() < end, pids
        time.sleep(0.05)


def cloud_message(points: np.ndarray, stamp: int, frame: str = "world") -> PointCloud2:
    """Of points (n, 3) [m] seen at a stamp [ns]."""
    message = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points), is_dense=True)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate("xyz")
    ]
    message.data = np.ascontiguousarray(points, dtype=np.float32).tobytes()
    return message


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    return {entry.key: entry.value for entry in status.values}
