"""The demo: a simulated cell, the node and this monitor, each a process of its own, talking over DDS.

Exit status 0 if every cycle gave a usable shape and every process ended by itself, else 1.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import numpy as np
import rclpy
from cable_shape_msgs.msg import CableMargin, CableMargins, CableShape, CableWarning, CableWarnings
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tqdm import tqdm

from cable_shape.safety.report import WarningKind
from cable_shape.shape import Status

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "config"
CABLE = {"cable_file": CONFIG / "cables" / "demo.yaml", "scene_file": CONFIG / "scenes" / "demo.yaml"}
HARNESS = {"harness_file": CONFIG / "harnesses" / "demo.yaml", "scene_file": CONFIG / "scenes" / "harness.yaml"}
LIFT = 0.21  # m, by which the harness is carried higher than the cable: its connector hangs above the table
STARTUP_S = 120.0  # the node compiles its kernels if set-up could not cache them
SHUTDOWN_S = 20.0
KINDS = {kind.value: kind.name for kind in WarningKind}


class Process:
    """A child process with its log in a file; ended by signal, by its id, when the block is left."""

    def __init__(self, name: str, command: list[str], log: Path) -> None:
        self.name = name
        self.log = log
        self._file = log.open("w")
        self._child = subprocess.Popen(command, cwd=ROOT, stdout=self._file, stderr=subprocess.STDOUT)

    def __enter__(self) -> Process:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        self._file.close()

    @property
    def ended(self) -> int | None:
        """Its exit status, None while it runs."""
        return self._child.poll()

    def stop(self) -> int:
        """Asks it to end (SIGINT), and ends it if it does not within 20 s; its exit status."""
        if self._child.poll() is None:
            self._child.send_signal(signal.SIGINT)
            try:
                self._child.wait(SHUTDOWN_S)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
        return self._child.returncode


@dataclass
class Seen:
    """What the monitor received."""

    shapes: int = 0
    statuses: Counter[int] = field(default_factory=Counter)
    models: Counter[str] = field(default_factory=Counter)
    reused: int = 0
    solve_times: list[float] = field(default_factory=list)
    lowest: float = float("inf")
    tightest: float = float("inf")
    first_stamp: float | None = None
    last_stamp: float = 0.0
    warnings: Counter[tuple[str, str]] = field(default_factory=Counter)
    nearest: dict[str, tuple[float, float]] = field(default_factory=dict)  # body: distance, seconds from the start
    resting: Counter[str] = field(default_factory=Counter)  # body: cycles that it presses in
    pressed: dict[str, float] = field(default_factory=dict)  # body: N, at most
    robot_checked: bool = False
    diagnostics: dict[str, str] = field(default_factory=dict)
    told: int = 0  # messages of diagnostics

    def shape(self, message: CableShape) -> None:
        """Counts one shape."""
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.first_stamp = stamp if self.first_stamp is None else self.first_stamp
        self.last_stamp = stamp
        self.shapes += 1
        self.statuses[message.status] += 1
        self.models[message.model] += 1
        self.reused += message.reused
        if not message.reused:
            self.solve_times.append(message.solve_time)
        self.lowest = min(self.lowest, float(np.asarray(message.positions)[2::3].min()))
        bending = np.hypot(np.asarray(message.curvature)[0::3], np.asarray(message.curvature)[1::3]).max()
        self.tightest = min(self.tightest, 1.0 / max(float(bending), 1e-9))

    def warning(self, message: CableWarnings) -> None:
        """Counts the warnings of one cycle."""
        self.robot_checked |= message.robot_checked
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        for warning in message.warnings:
            self.warnings[KINDS[warning.kind], warning.other] += 1
            if warning.kind != CableWarning.CLEARANCE:
                continue
            if warning.value < self.nearest.get(warning.other, (np.inf, 0.0))[0]:
                self.nearest[warning.other] = (warning.value, stamp - (self.first_stamp or stamp))

    def margins(self, message: CableMargins) -> None:
        """Counts on what the cable rests that it is meant to rest on, and how hard it is pressed."""
        for margin in message.margins:
            if margin.kind == CableMargin.CONTACT_FORCE and margin.value > 0.0:
                self.resting[margin.other] += 1
                self.pressed[margin.other] = max(self.pressed.get(margin.other, 0.0), margin.value)

    def diagnostic(self, message: DiagnosticArray) -> None:
        """Keeps the newest value of every key."""
        self.told += 1
        for status in message.status:
            self.diagnostics.update({pair.key: pair.value for pair in status.values})


def subscribe(node: Node, seen: Seen) -> None:
    """The monitor's four topics."""
    latest = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
    kept = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(CableShape, "cable/shape", seen.shape, latest)
    node.create_subscription(CableWarnings, "cable/warnings", seen.warning, kept)
    node.create_subscription(CableMargins, "cable/margins", seen.margins, latest)
    node.create_subscription(DiagnosticArray, "/diagnostics", seen.diagnostic, latest)


def watch(seen: Seen, node_process: Process, cell_command: list[str], out: Path, duration: float) -> list[str]:
    """Runs the cell until it ends and returns what went wrong."""
    monitor = rclpy.create_node("demo_monitor")
    executor = SingleThreadedExecutor()
    executor.add_node(monitor)
    subscribe(monitor, seen)
    try:
        print("waiting for the node ...", file=sys.stderr)
        deadline = time.monotonic() + STARTUP_S
        with Process("cell", cell_command, out / "cell.log") as cell:  # it plans meanwhile, and waits for the node
            while seen.diagnostics.get("state") != "active":
                executor.spin_once(timeout_sec=0.1)
                if node_process.ended is not None:
                    return [f"the node ended early with exit status {node_process.ended}; see {node_process.log}"]
                if time.monotonic() > deadline:
                    return [f"the node was not active within {STARTUP_S:.0f} s; see {node_process.log}"]
            return _follow(seen, executor, node_process, cell, duration)
    finally:
        executor.shutdown()
        monitor.destroy_node()


def _follow(seen: Seen, executor: SingleThreadedExecutor, node: Process, cell: Process, duration: float) -> list[str]:
    """Spins while the cell moves, with a progress bar in seconds of its motion."""
    deadline = time.monotonic() + duration + STARTUP_S
    with tqdm(total=duration, unit="s", desc="cell", bar_format="{desc} {bar} {n:.0f}/{total:.0f} s {postfix}") as bar:
        while cell.ended is None:
            executor.spin_once(timeout_sec=0.1)
            if seen.first_stamp is not None:
                bar.n = min(seen.last_stamp - seen.first_stamp, duration)
                bar.set_postfix_str(f"{seen.shapes} shapes", refresh=False)
                bar.update(0)
            if node.ended is not None:
                return [f"the node ended early with exit status {node.ended}; see {node.log}"]
            if time.monotonic() > deadline:
                return [f"the cell did not end within {duration + STARTUP_S:.0f} s; see {cell.log}"]
    settle, told = time.monotonic() + 5.0, seen.told + 2  # the second one from now on has all cycles
    while seen.told < told and time.monotonic() < settle:
        executor.spin_once(timeout_sec=0.1)
    return [f"the cell failed with exit status {cell.ended}; see {cell.log}"] if cell.ended else []


def failures(seen: Seen, node_exit: int, rrd: Path | None, node_log: Path) -> list[str]:
    """Every reason to call the demo failed."""
    found = []
    if seen.shapes == 0:
        found.append(f"no shape was received; see {node_log}")
    bad = {Status(code).name: count for code, count in seen.statuses.items() if not Status(code)}
    if bad:
        found.append(f"cycles without a usable shape: {bad}")
    refused = {key: value for key, value in seen.diagnostics.items() if key.startswith("refused")}
    if refused:
        found.append(f"the node refused input: {refused}")
    if node_exit != 0:
        found.append(f"the node ended with exit status {node_exit}; see {node_log}")
    if rrd is not None and (not rrd.exists() or rrd.stat().st_size < 10_000):
        found.append(f"the viewer wrote no recording to {rrd}")
    return found


def summary(seen: Seen, rrd: Path | None) -> str:
    """A table for people."""
    seconds = seen.last_stamp - (seen.first_stamp or 0.0)
    times = 1e6 * np.array(seen.solve_times or [np.nan])
    rows = [
        ("cycles of the node", seen.diagnostics.get("cycles", "?")),
        ("shapes received", f"{seen.shapes} in {seconds:.1f} s"),
        ("model", ", ".join(f"{name} {count}" for name, count in seen.models.most_common())),
        ("status", ", ".join(f"{Status(code).name} {count}" for code, count in seen.statuses.most_common())),
        ("reused (grips at rest)", str(seen.reused)),
        ("solve time p50 / p99", f"{np.percentile(times, 50):.0f} / {np.percentile(times, 99):.0f} µs"),
        (
            "cycle time p50 / p99",
            " / ".join(seen.diagnostics.get(f"cycle time {p} [ms]", "?") for p in ("p50", "p99")) + " ms",
        ),
        ("lowest point of the cable", f"{seen.lowest:.3f} m"),
        ("tightest bend", f"{seen.tightest * 1e3:.0f} mm radius"),
        ("clearance to the robot checked", "yes" if seen.robot_checked else "no"),
    ]
    for body, count in seen.resting.items():
        rows.append(("rests on", f"{body} in {count} cycles, pressed with {seen.pressed[body]:.2f} N at most"))
    apart = [(*near, body) for body, near in seen.nearest.items()]
    if apart:
        distance, when, body = min(apart)
        rows.append(("closest approach", f"{distance * 1e3:.1f} mm to {body} at {when:.1f} s"))
    for (kind, other), count in seen.warnings.most_common():
        rows.append((f"warning {kind.lower()}", f"{count} cycles{f', {other}' if other else ''}"))
    if rrd is not None:
        rows.append(("recording", f"{rrd} (open it: .venv/bin/cable-shape view {rrd})"))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--view", action="store_true", help="open the viewer instead of writing an .rrd file")
    parser.add_argument("--harness", action="store_true", help="carry a harness: a trunk in a clip, two branches")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "demo", help="folder for logs and the recording")
    parser.add_argument("--duration", type=float, default=18.0, help="[s] of motion")
    args = parser.parse_args()
    out = args.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    rrd = None if args.view else out / "demo.rrd"
    if rrd is not None:
        rrd.unlink(missing_ok=True)
    parameters = {
        "input": "joints",
        **(HARNESS if args.harness else CABLE),
        "robot_file": CONFIG / "robots" / "dual_arm.yaml",
        "view": "window" if rrd is None else rrd,
        "output_folder": out,
        "diagnostics_period": 0.25,
    }
    node_command = [sys.executable, "-m", "cable_shape.ros.node", "--ros-args"]
    for name, value in parameters.items():
        node_command += ["-p", f"{name}:={value}"]
    cell_command = [sys.executable, str(ROOT / "demo" / "demo_cell.py"), "--duration", str(args.duration)]
    cell_command += ["--wait", str(STARTUP_S)]
    cell_command += ["--lift", str(LIFT)] if args.harness else []

    seen = Seen()
    rclpy.init()
    try:
        with Process("node", node_command, out / "node.log") as node:
            wrong = watch(seen, node, cell_command, out, args.duration)
            node_exit = node.stop()
    except KeyboardInterrupt:
        return 130
    finally:
        rclpy.try_shutdown()
    wrong += failures(seen, node_exit, rrd, out / "node.log")
    print(summary(seen, rrd))
    for reason in wrong:
        print(f"demo failed: {reason}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
