"""Feeds the node two gripper poses for a long time: memory, threads, open files and cycle time must not grow.

Exit status 0 if nothing grew and no process ended, else 1.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
import soak_edits
import soak_files
import soak_fuzz
import soak_peers
import soak_replay
from cable_shape_msgs.msg import CableShape
from cell_node import FedNode
from cell_scene import CONFIG, given_at, node_parameters
from soak_held import Held

from cable_shape.robots.robot import Robot

GROWTH_KB = 5_000  # allocators keep some; a leak of 100 bytes a cycle at 250 Hz is 15 MB in ten minutes
PEERS = 100  # messages of --fuzz for one request of a hostile peer
SLOWER = 1.5  # times, of the processor time that a cycle takes, which a busy machine changes less than the clock's


def soak(seconds: float, rate: float, settle: float, timed: bool) -> list[str]:
    """Runs it and returns what went wrong."""
    robot = Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml")
    came = [0]

    def count(_: CableShape) -> None:
        came[0] += 1

    with tempfile.TemporaryDirectory(prefix="soak_") as place:
        folder = Path(place)
        with FedNode("node", folder, node_parameters(folder, "off")) as fed:
            fed.node.create_subscription(CableShape, "cable/shape", count, 10)
            fed.wait()
            began = due = time.monotonic()
            first: tuple[Held, float] | None = None
            before: tuple[Held, int] | None = None
            tell, sent = began + 10.0, 0
            while (now := time.monotonic()) < began + seconds:
                due += 1.0 / rate
                stamp = time.time_ns()
                q = robot.home + 0.03 * np.sin(0.7 * (stamp % 10**13) * 1e-9) * (robot.home < -0.1)
                fed.send(stamp, *given_at(robot, q))
                sent += 1
                fed.spin(max(due - time.monotonic(), 1e-4))
                fed.check()
                if now < tell:
                    continue
                tell = now + max(10.0, seconds / 20.0)
                held, cycles = Held.by(fed.process.pid), int(fed.values.get("cycles", "0"))
                p50 = float(fed.values.get("cycle time p50 [ms]", "nan"))
                text = f"{now - began:6.0f} s: {sent} sent, {came[0]} shapes, cycle p50 {p50:.2f} ms, {held}"
                if before is not None and cycles > before[1]:
                    cost = 1e3 * (held.cpu - before[0].cpu) / (cycles - before[1])
                    last = (held, cost)
                    text += f", {cost:.2f} ms of processor a cycle"
                    if first is None and now - began > settle:
                        first = last
                print(text)
                before = (held, cycles)
    if first is None:
        return [f"shorter than {settle:g} s: nothing can be said"]
    return judged(first, last, sent, came[0], timed)


def judged(first: tuple[Held, float], last: tuple[Held, float], sent: int, came: int, timed: bool) -> list[str]:
    """What grew."""
    wrong = []
    (before, fast), (after, slow) = first, last
    if after.memory_kb > before.memory_kb + GROWTH_KB:
        wrong.append(f"memory grew from {before.memory_kb} to {after.memory_kb} kB")
    if after.threads > before.threads or after.files > before.files:
        wrong.append(f"threads or files grew from {before} to {after}")
    if timed and slow > SLOWER * fast:
        wrong.append(f"the processor time of a cycle grew from {fast:.2f} to {slow:.2f} ms")
    if came < (0.5 if timed else 0.01) * sent:
        wrong.append(f"only {came} of {sent} pairs were answered")
    print(
        f"memory {before.memory_kb} -> {after.memory_kb} kB, {fast:.2f} -> {slow:.2f} ms of processor a cycle, "
        f"{came} of {sent} answered"
    )
    return wrong


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--fuzz", type=int, metavar="N", help="send N random messages, then N / 100 requests of hostile peers, instead"
    )
    parser.add_argument("--replay", type=int, metavar="N", help="replay one recording N times: the same bytes")
    parser.add_argument(
        "--files", type=float, metavar="S", help="mutate YAML files, URDFs and recordings for S seconds"
    )
    parser.add_argument(
        "--edits", type=int, nargs="?", const=1000, metavar="N", help="ask a node for N (1000) random edits instead"
    )
    parser.add_argument("--seed", type=int, default=1, help="of --fuzz, --files and --edits")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=250.0, help="[Hz]")
    parser.add_argument("--settle", type=float, default=15.0, help="[s] before the first look")
    parser.add_argument("--untimed", action="store_true", help="judge no times: the machine is busy")
    options = parser.parse_args()
    if options.replay:
        wrong = soak_replay.repeat(options.replay)
    elif options.files:
        wrong = soak_files.mutate(options.files, options.seed)
    else:
        rclpy.init()
        if options.edits:
            wrong = soak_edits.edits(options.edits, options.seed)
        elif options.fuzz:
            wrong = soak_fuzz.fuzz(options.fuzz, options.seed)
            for lock in (False, True):
                wrong += soak_peers.harass(max(1, options.fuzz // PEERS), options.seed, lock)
        else:
            wrong = soak(60.0 * options.minutes, options.rate, options.settle, not options.untimed)
        rclpy.try_shutdown()
    for reason in wrong:
        print(f"soak failed: {reason}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
