"""What the planner's service costs over DDS, and what it costs the cycles of the node beside it."""

from __future__ import annotations

import array
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import planner_batch
import rclpy
import yaml
from builtin_interfaces.msg import Time
from cable_shape_msgs.srv import PredictShapes
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

import cable_shape as cs

RATE, PHASE_S = 250.0, 5.0  # Hz, s: the diagnostics' window of 1000 cycles is 4 s
OVER, MORE_S, P99_ALLOWED = 1.5, 0.02, 1.5
STARTUP_S = 120.0
SPREAD = planner_batch.SPREADS[0]


@contextmanager
def running_node() -> Iterator[Any]:
    """The node with its planner in processes of their own, and a client node."""
    with tempfile.TemporaryDirectory(prefix="bench_planner_") as folder:
        file = Path(folder) / "cable.yaml"
        file.write_text(yaml.safe_dump({k: v for k, v in planner_batch.CABLE.as_dict().items() if v is not None}))
        log = (Path(folder) / "node.log").open("w")
        command = [sys.executable, "-m", "cable_shape.ros.node", "--ros-args", "-r", "__ns:=/bench"]
        for name, value in (
            ("cable_file", file), ("model", "cosserat"), ("tolerance", planner_batch.TOLERANCE),
            ("planner", "true"), ("planner_rows", 10_000), ("diagnostics_period", 0.2),
        ):  # fmt: skip
            command += ["-p", f"{name}:={value}"]
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        rclpy.init()
        client = rclpy.create_node("client", namespace="bench")
        try:
            yield client
        finally:
            client.destroy_node()
            rclpy.try_shutdown()
            process.terminate()
            process.wait(30)
            log.close()


class Planner:
    """A client of the service."""

    def __init__(self, node: Any) -> None:
        self.node = node
        self.client = node.create_client(PredictShapes, "cable/predict_shapes")
        if not self.client.wait_for_service(STARTUP_S):
            raise TimeoutError("the planner did not come")

    def ask(self, starts: np.ndarray, ends: np.ndarray, arrays: int) -> tuple[float, Any]:
        """[s], from flat arrays to the answer, and that."""
        request = PredictShapes.Request(
            starts=array.array("d", starts.tobytes()), ends=array.array("d", ends.tobytes()), arrays=arrays
        )
        began = time.perf_counter()
        future = self.client.call_async(request)
        rclpy.spin_until_future_complete(self.node, future)
        spent = time.perf_counter() - began
        answer = future.result()
        if not answer.success or answer.partial:
            raise RuntimeError(answer.error or "the answer is partial")
        return spent, answer


def print_service(rows: int = 1000, repeats: int = 15) -> bool:
    """Prints how long a call takes over DDS beside the same call in process; returns whether that is within bounds."""
    starts, ends = planner_batch.grasps(rows, *SPREAD[1:])
    threads = max(1, len(os.sched_getaffinity(0)) - 1)
    print(
        f"\n## PredictShapes: {rows} grasps over DDS and in process, {threads} thread(s), median of {repeats} in turns"
    )
    holds = True
    with running_node() as node:
        planner = Planner(node)
        for name, arrays in (("status and margins", 0), ("and positions", 1), ("and all arrays", 31)):
            over, within = [], []
            for _ in range(repeats + 2):
                over.append(planner.ask(starts, ends, arrays)[0])
                began = time.perf_counter()
                cs.predict_batch(
                    planner_batch.CABLE, starts, ends, model="cosserat", tolerance=planner_batch.TOLERANCE,
                    threads=threads,
                )  # fmt: skip
                within.append(time.perf_counter() - began)
            dds, own = (1e3 * float(np.median(times[2:])) for times in (over, within))
            bound = OVER * own + 1e3 * MORE_S
            holds &= dds <= bound
            print(f"{name:20s} DDS {dds:7.1f} ms, in process {own:7.1f} ms, allowed {bound:7.1f} ms")
    print(f"at most {OVER:g} times and {1e3 * MORE_S:g} ms more asked; holds: {'yes' if holds else 'no'}")
    return holds


def feed(node: Any, seconds: float) -> float:
    """Publishes gripper poses at `RATE`; the p99 [ms] of the cycle times that the diagnostics tell at the end."""
    sensor = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    sides = [node.create_publisher(PoseStamped, f"{side}_gripper/pose", sensor) for side in ("left", "right")]
    p99: list[float] = []

    def listen(message: DiagnosticArray) -> None:
        for status in message.status:
            p99.extend(float(v.value) for v in status.values if v.key == "cycle time p99 [ms]")

    diagnostics = node.create_subscription(DiagnosticArray, "/diagnostics", listen, 10)
    began = due = time.monotonic()
    k = 0
    while due < began + seconds:
        due += 1.0 / RATE
        k += 1
        stamp = time.time_ns()
        for publisher, x in zip(sides, (0.0, 0.7), strict=True):
            message = PoseStamped()
            message.header.frame_id = "world"
            message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
            p, q = message.pose.position, message.pose.orientation
            p.x, p.y, p.z = x, 0.03 * np.sin(0.02 * k), 0.5 + 0.03 * np.cos(0.017 * k)
            q.x = q.y = q.z = q.w = 0.5
            publisher.publish(message)
        while due > time.monotonic():
            rclpy.spin_once(node, timeout_sec=max(0.0, due - time.monotonic()))
    for publisher in sides:
        node.destroy_publisher(publisher)
    node.destroy_subscription(diagnostics)
    return p99[-1]


def load(rows: int) -> None:
    """Asks for `rows` grasps again and again, until it is ended; prints the answers' seconds."""
    rclpy.init()
    planner = Planner(rclpy.create_node("load", namespace="bench"))
    starts, ends = planner_batch.grasps(rows, *SPREAD[1:])
    while True:
        print(f"{planner.ask(starts, ends, 1)[0]:.3f}", flush=True)


@contextmanager
def loaded(rows: int, spent: list[float]) -> Iterator[None]:
    """The node's planner answers without a pause; `spent` [s] gets what each call took."""
    child = subprocess.Popen([sys.executable, __file__, "load", str(rows)], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout is not None
        child.stdout.readline()
        yield
    finally:
        child.kill()
        spent += [float(line) for line in child.communicate()[0].splitlines()]


def print_cycles(rows: int = 10_000, phases: int = 3) -> bool:
    """Prints the cycles' p99 with and without calls of the service beside; returns whether it is within bounds."""
    print(f"\n## Cycles at {RATE:g} Hz while {rows} grasps are served without a pause, {phases} phases each in turns")
    alone: list[float] = []
    serving: list[float] = []
    spent: list[float] = []
    with running_node() as node:
        Planner(node)
        feed(node, PHASE_S)
        for _ in range(phases):
            alone.append(feed(node, PHASE_S))
            with loaded(rows, spent):
                serving.append(feed(node, PHASE_S))
    for name, values in (("alone", alone), ("serving", serving)):
        each = ", ".join(f"{value:.3f}" for value in values)
        print(f"{name:8s} p99 of the cycle time {float(np.median(values)):.3f} ms, median of {each}")
    ratio = float(np.median(serving) / np.median(alone))
    holds = ratio <= P99_ALLOWED
    print(f"{len(spent)} calls answered in {sum(spent):.1f} s, with the positions of all points")
    print(f"{ratio:.2f} times, at most {P99_ALLOWED:g} asked; holds: {'yes' if holds else 'no'}")
    return holds


if __name__ == "__main__":
    if sys.argv[1:2] == ["load"]:
        load(int(sys.argv[2]))
    else:
        print_service()
        print_cycles()
