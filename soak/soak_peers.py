"""Hostile peers beside the node: it lives, tells no secret, writes nowhere else, and predicts again.

They set parameters (of every type; files that are devices, FIFOs, secrets and bombs), ask for transitions in any order,
publish wrong types and second poses on the grippers' topics; the second time at a node that is locked.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from cable_shape_msgs.msg import CableShape
from cell_node import STARTUP_S, stamp_of, stamped, started
from cell_scene import CONFIG
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import String

from cable_shape.ros.parameters import SPECS

SECRET = "hunter2"  # noqa: S105, planted where the node must not tell it
SPACE = "hostile"
AWAKE_EVERY = 20  # requests, between looks whether the node predicts
ANSWER_S = 120.0  # for one answer: configure loads files
AGAIN_S = 20.0  # without an answer, until it is asked for again
ROADS = {"unconfigured": (1,), "inactive": (3,), "active": ()}
FILES = ("cable_file", "scene_file", "robot_file", "uncertainty_file", "planner_profiles", "view", "calibration_file")
ALONG_X = (0.5, 0.5, 0.5, 0.5)


class UnansweredError(Exception):
    """What went wrong."""


class Peer:
    """A participant of its own, with clients of the node's services."""

    def __init__(self, name: str) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, namespace=SPACE, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.clients = {
            kind: self.node.create_client(kind, f"cable_shape_node/{name}")
            for kind, name in (
                (ChangeState, "change_state"), (GetState, "get_state"), (SetParameters, "set_parameters"),
                (SetParametersAtomically, "set_parameters_atomically"), (GetParameters, "get_parameters"),
                (DescribeParameters, "describe_parameters"),
            )
        }  # fmt: skip
        self.said = ""
        self.shapes: list[CableShape] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, 10)
        self.node.create_subscription(CableShape, "cable/shape", self.shapes.append, 10)
        self.publishers: list[Any] = []

    def _hear(self, message: DiagnosticArray) -> None:
        self.said += " ".join(status.message for status in message.status)

    def until(self, done: Callable[[], Any], what: str, timeout: float = ANSWER_S) -> Any:
        """Spins until `done` gives something true."""
        end = time.monotonic() + timeout
        while not (value := done()):
            if time.monotonic() > end:
                raise UnansweredError(f"no {what} within {timeout:g} s")
            self.executor.spin_once(timeout_sec=0.02)
        return value

    def call(self, kind: Any, **fields: Any) -> Any:
        """The answer, which must come."""
        client = self.clients[kind]
        self.until(client.service_is_ready, kind.__name__)
        futures: list[Any] = []
        due = 0.0

        def answered() -> Any:
            nonlocal due
            if time.monotonic() >= due:  # the middleware may lose an answer
                futures.append(client.call_async(kind.Request(**fields)))
                due = time.monotonic() + AGAIN_S
            return next((future for future in futures if future.done()), None)

        return self.until(answered, f"answer of {kind.__name__}").result()

    def transition(self, number: int, label: str = "") -> bool:
        """Whether it was made."""
        request = ChangeState.Request()
        request.transition.id, request.transition.label = number, label
        client, before = self.clients[ChangeState], self.state()
        future = client.call_async(request)
        try:
            self.until(future.done, f"answer to transition {number} {label!r}")
        except UnansweredError:  # the middleware may lose an answer; what was asked for was done or not
            return self.state() != before
        return bool(future.result().success)

    def state(self) -> str:
        """Of the node's lifecycle."""
        return str(self.call(GetState).current_state.label)

    def set(self, **values: Any) -> bool:
        """Whether all was set."""
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return bool(self.call(SetParametersAtomically, parameters=parameters).result.successful)

    def pose(self, publisher: Any, x: float) -> None:
        """A good one, of now."""
        publisher.publish(stamped(time.time_ns(), (x, 0.0, 0.5, *ALONG_X)))

    def drop(self) -> None:
        """Takes its publishers away."""
        for publisher in self.publishers:
            self.node.destroy_publisher(publisher)
        self.publishers.clear()

    def close(self) -> None:
        """For good."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Malice:
    """What the peers ask for, drawn at random."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.chance = random.Random(seed)
        bad = folder / "bad"
        bad.mkdir()
        (bad / "shadow").write_text(f"root:{SECRET}:19000:0\nann:{SECRET}\n")
        (bad / "keys.yaml").write_text(f"{SECRET}: [{SECRET}\n- {SECRET}: *{SECRET}\n")
        (bad / "seen.rrd").write_text(SECRET)
        bomb = "a0: &a0 {x: 1}\n" + "".join(f"a{k + 1}: &a{k + 1} [{f'*a{k}, ' * 9}]\n" for k in range(30))
        (bad / "bomb.yaml").write_text(bomb)
        os.mkfifo(bad / "fifo")
        self.paths = [
            *map(str, sorted(bad.iterdir())), "/dev/zero", "/dev/stdin", "/proc/self/environ", "/etc/passwd", "/", "",
            "../../outside.rrd", str(folder / "outside.rrd"), str(folder / "outside.yaml"), "~nobody/x.yaml",
            "x" * 5000, "own.rrd", "window", "cables/three.yaml", "\u0000.yaml",
        ]  # fmt: skip

    def value(self) -> Any:
        """Of any type."""
        c = self.chance
        return c.choice((True, 0, -1, 2**40, 0.0, 1e300, float("nan"), "", "x" * 3000, "off", [1.0] * 7, ["a"], [True]))

    def act(self, peer: Peer) -> None:
        """One thing that a peer does."""
        c = self.chance
        kind = c.randrange(10)
        if kind < 3:
            if c.random() < 0.7:  # else it is refused while the node is configured
                for number in (4, 2):
                    peer.transition(number)
            peer.set(**{c.choice(FILES): c.choice(self.paths)}, planner=c.random() < 0.2)
            peer.transition(1)
        elif kind < 5:
            name = c.choice([*(spec.name for spec in SPECS), "no_such", "use_sim_time", ""])
            message = ParameterMessage(name=name, value=Parameter("x", value=self.value()).get_parameter_value())
            if name == "use_sim_time":
                return  # it would wait for a clock for good, and say so
            peer.call(SetParameters, parameters=[message] * c.randrange(1, 4))
        elif kind < 7:
            label = c.choice(("", "", "configure", "cleanup", "activate", "deactivate", "", "no_such"))
            number = c.choice((1, 1, 2, 3, 3, 4, 0, 8, 10, 30, 60, 97, 255))  # not shutdown: it obeys
            peer.transition(number, label)
        elif kind == 7:
            names = [c.choice(("model", "x" * 1000, "\u00fc", "")) for _ in range(c.randrange(50))]
            peer.call(c.choice((GetParameters, DescribeParameters)), names=names)
        else:
            self.publish(peer)

    def publish(self, peer: Peer) -> None:
        """Another type, or second poses."""
        topic = self.chance.choice(("left_gripper/pose", "right_gripper/pose"))
        if self.chance.random() < 0.5:
            peer.drop()
        try:
            peer.publishers.append(peer.node.create_publisher(self.chance.choice((String, PoseStamped)), topic, 10))
        except Exception:  # noqa: BLE001, one participant cannot have two types on a topic
            return
        if peer.publishers[-1].msg_type is PoseStamped:
            for _ in range(5):
                peer.pose(peer.publishers[-1], self.chance.uniform(-1.0, 1.0))


@contextmanager
def hostile_node(folder: Path, lock: bool) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """The node among them, and its log."""
    (folder / "out").mkdir()
    good = {"cable_file": CONFIG / "cables" / "demo.yaml", "output_folder": folder / "out", "frame_id": "world"}
    child, log = started(SPACE, folder, {**good, "lock": str(lock).lower(), "workers_make_way": "false"})
    try:
        yield child, log
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(STARTUP_S)


def recovers(peer: Peer, cell: Peer, lock: bool) -> None:
    """Good parameters and poses lead to a usable shape again."""
    peer.drop()
    if not lock:
        while (state := cell.state()) != "unconfigured":
            if not cell.transition({"active": 4, "inactive": 2}[state]):
                raise UnansweredError(f"it cannot leave {state!r}")
        good = {spec.name: spec.default for spec in SPECS if not spec.read_only}
        good.update(cable_file=str(CONFIG / "cables" / "demo.yaml"), frame_id="world", workers_make_way=False)
        if not cell.set(**good):
            raise UnansweredError("good parameters are refused")
    while (state := cell.state()) != "active":
        if not cell.transition(*ROADS[state]):
            raise UnansweredError(f"it cannot leave {state!r}: {cell.said[-2000:]}")
    begun = time.time_ns()
    cell.shapes.clear()

    def shaped() -> bool:
        for publisher, x in zip(cell.publishers, (0.0, 0.4), strict=True):
            cell.pose(publisher, x)
        cell.executor.spin_once(timeout_sec=0.05)
        return any(shape.usable and stamp_of(shape) > begun for shape in cell.shapes)

    cell.until(shaped, "usable shape")


def harass(count: int, seed: int, lock: bool) -> list[str]:
    """Asks for `count` things; what went wrong."""
    with tempfile.TemporaryDirectory(prefix="soak_") as place:
        folder = Path(place)
        malice = Malice(seed, folder)
        planted = {file: file.read_bytes() for file in (folder / "bad").iterdir() if file.is_file()}
        peer, cell = Peer("peer"), Peer("cell")
        try:
            with hostile_node(folder, lock) as (child, log):
                topics = ("left_gripper/pose", "right_gripper/pose")
                cell.publishers += [cell.node.create_publisher(PoseStamped, topic, 10) for topic in topics]
                try:
                    cell.until(lambda: cell.state() == "active", "active node", STARTUP_S)
                    for k in range(count):
                        malice.act(peer)
                        if child.poll() is not None:
                            raise UnansweredError(f"the node ended with {child.returncode}")
                        if k % AWAKE_EVERY == AWAKE_EVERY - 1 or k == count - 1:
                            recovers(peer, cell, lock)
                except UnansweredError as error:
                    return [f"{error}:\n{log.read_text()[-4000:]}"]
            said = log.read_text() + peer.said + cell.said
            parts = said.split("Traceback")
            wrong = [f"{len(parts) - 1} defects, the first:\n{parts[1][:4000]}"] if len(parts) > 1 else []
            wrong += ["it told what is in a file"] if SECRET in said else []
            known = {"bad", "out", log.name}
            wrong += [f"it wrote {name}" for name in sorted({p.name for p in folder.iterdir()} - known)]
            wrong += [f"it wrote over {file}" for file, content in planted.items() if file.read_bytes() != content]
            wrong += [f"it left {p.name}" for p in (folder / "out").iterdir() if p.suffix not in (".rrd", ".yaml")]
            print(f"{count} requests and publishers of hostile peers{', the node locked' if lock else ''}: it predicts")
            return wrong
        finally:
            peer.close()
            cell.close()
