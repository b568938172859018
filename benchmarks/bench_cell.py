#!/usr/bin/env python
"""How long after the second gripper pose was published the centreline arrives, over DDS, beside an empty echo node.

    scripts/bench cell [--quick] [--rates 125 250 500] [--seconds 20] [--view FILE.rrd] [--save FILE] [--compare FILE]
    scripts/bench cell --viewer       # what a viewer costs that is attached, blocked or killed
    scripts/bench cell --cables 10    # that many cables on one node, beside one
    scripts/bench cell --priority     # what a real-time priority does on a busy machine; needs the right to it
    scripts/bench cell --calibration  # what a calibration costs that goes on beside; part of the whole, too
    scripts/bench cell --edits        # what 20 edits a second cost in contact; part of the whole, too
    scripts/bench cell --replay       # ten minutes replayed beside how long they took; part of the whole, too

Three processes: this one, which publishes two gripper poses and joint states and receives the shapes, the node (20
obstacles, the links of two arms, viewer off), and an echo node that answers the same messages with a ready-made shape.
Node and echo are fed in turns of two seconds, so that whatever else the machine does meets both. Exit status 0 if p50
is at most 1.5 times and p99 at most 3 times the echo's at every rate, medians over the turns, and p99 beside a
calibration at most 1.5 times that without.
"""

from __future__ import annotations

from pathlib import Path

import cell_calibration
import cell_edits
import cell_replay
import cell_sides
from cell_beside import TURN_S, Side, compare, measuring
from cell_node import FedNode
from cell_scene import CONFIG, motion, node_parameters
from figures import Figures, bench_options, bench_parser, finish, heading

from cable_shape.robots.robot import Robot

ECHO = Path(__file__).with_name("cell_echo.py")
P50_ALLOWED, P99_ALLOWED = 1.5, 3.0


def beside_echo(collected: Figures, rates: list[float], seconds: float, view: str) -> None:
    """The node and the echo in turns; keeps whether the bounds hold."""
    robot = Robot.from_yaml(CONFIG / "robots" / "dual_arm.yaml")
    with measuring() as (stack, folder):
        echo = stack.enter_context(FedNode("echo", folder, {}, program=(str(ECHO),)))
        node = stack.enter_context(FedNode("node", folder, node_parameters(folder, view)))
        for one in (echo, node):
            one.wait()
        for rate in rates:
            given = motion(robot, round(4.0 * rate))
            sides = [Side("echo", echo, given), Side("node", node, given)]
            found = compare(sides, max(1, round(seconds / TURN_S)), rate)
            for name, turn in found.items():
                collected.check(f"{rate:g} Hz: the {name} answers", turn.in_time > 0.0)
            p50, p99 = (getattr(found["node"], name) / getattr(found["echo"], name) for name in ("p50", "p99"))
            collected.at_most(f"{rate:g} Hz: p50 of the node / of the echo", p50, P50_ALLOWED, "{:.2f}")
            collected.at_most(f"{rate:g} Hz: p99 of the node / of the echo", p99, P99_ALLOWED, "{:.2f}")


def main() -> int:
    """All of it, or one of the comparisons."""
    parser = bench_parser(__doc__, "two seconds at 250 Hz, one round")
    parser.add_argument("--rates", type=float, nargs="+", help="[Hz] (125 250 500)")
    parser.add_argument("--seconds", type=float, help="[s] at each rate, of node and of echo (20)")
    parser.add_argument("--view", default="off", help="the node's parameter view")
    parser.add_argument("--viewer", action="store_true", help="compare cycle times with a viewer and without")
    parser.add_argument("--calibration", action="store_true", help="only cycles beside a calibration and without")
    parser.add_argument("--edits", action="store_true", help="only cycles in contact beside edits and without")
    parser.add_argument("--replay", action="store_true", help="only a recording replayed")
    parser.add_argument("--rounds", type=int, help="of the comparisons (3)")
    parser.add_argument("--cables", type=int, help="on one node; --rates then are 25 50 100 unless given")
    parser.add_argument("--priority", action="store_true", help="compare with a real-time priority and without")
    options = bench_options(parser)
    rounds = options.rounds or (1 if options.quick else 3)
    if options.viewer:
        return 0 if cell_sides.viewer(rounds) else 1
    if options.cables:
        return 0 if cell_sides.cables(options.cables, options.rates or [25.0, 50.0, 100.0], rounds) else 1
    if options.priority:
        return 0 if cell_sides.priority(options.rates or [125.0], rounds) else 1
    collected = Figures()
    if options.replay:
        cell_replay.print_replay(collected, 20.0 if options.quick else 600.0)
        return finish(collected, options)
    rates = options.rates or ([250.0] if options.quick else [125.0, 250.0, 500.0])
    seconds = options.seconds or (2.0 if options.quick else 20.0)
    if options.edits:
        cell_edits.print_edits(collected, rates, seconds)
        return finish(collected, options)
    if not options.calibration:
        heading("From the second pose to the shape, over DDS")
        beside_echo(collected, rates, seconds, options.view)
        cell_edits.print_edits(collected, rates, seconds)
        cell_replay.print_replay(collected, 20.0 if options.quick else 600.0)
    cell_calibration.print_calibration(collected, rounds)
    return finish(collected, options)


if __name__ == "__main__":
    raise SystemExit(main())
