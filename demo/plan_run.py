#!/usr/bin/env python3
"""The worked planner and its recording: two arms carry a cable past a post.

scripts/plan [OUT.rrd] [--seed N] [--seconds S]; look at it with rerun OUT.rrd. Exit code 0: a path was found and every
report along it is free of errors; 1: none was found in time, or a report has an error; 2: wrong arguments.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import plan_cable
from plan_cable import Plan

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.viewer.recording import RecordingWriter

RATE = 50.0  # Hz, of the recording


def record(robot: Robot, found: Plan, path: Path) -> list[cs.CycleReport]:
    """Writes the motion as cycles at RATE to a .rrd; returns their reports."""
    held, scene, rows = plan_cable.cable(), plan_cable.SCENE, found.path
    assert rows.times is not None
    cycle = cs.Cycle(
        held, scene=scene, robot_links=robot.link_geometry, gripping_links=robot.gripping_links, model="cosserat"
    )
    reports = []
    with RecordingWriter(path, cycle.cables, scene, robot.link_geometry) as writer:
        for t in np.linspace(0.0, rows.times[-1], int(rows.times[-1] * RATE) + 2):
            q = np.array([np.interp(t, rows.times, column) for column in rows.positions.T])
            report = cycle.step({"cable": robot.grips(q)}, round(1e9 * t), robot.link_poses())
            writer.log(report)
            reports.append(report)
    return reports


def main(arguments: list[str] | None = None) -> int:
    """Plans, records, says what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, nargs="?", default=Path("out/plan.rrd"), metavar="OUT.rrd")
    parser.add_argument("--seed", type=int, default=1, help="of the search (%(default)s)")
    parser.add_argument("--seconds", type=float, default=60.0, help="that the search may take (%(default)g)")
    options = parser.parse_args(arguments)
    if not options.seconds > 0.0:
        parser.error(f"--seconds {options.seconds}: it must be above 0")
    if options.seed < 1:
        parser.error(f"--seed {options.seed}: it must be at least 1")
    robot = Robot.from_yaml(plan_cable.ROOT / "config/robots/dual_arm.yaml")
    found = plan_cable.plan(robot, seed=options.seed, seconds=options.seconds)
    if found is None:
        print(f"plan: no path found in {options.seconds:g} s; another --seed may have one", file=sys.stderr)
        return 1
    print(f"straight there: {found.direct!r}")
    print(f"found in {found.seconds:.1f} s over {found.edges} edges: {found.check!r}")
    options.recording.parent.mkdir(parents=True, exist_ok=True)
    reports = record(robot, found, options.recording)
    errors = [w.text for report in reports for w in report.warnings if w.severity is cs.Severity.ERROR]
    nearest = min(body.distance for report in reports for body in report.clearance["cable"].bodies)
    print(f"{options.recording}: {len(reports)} cycles, least clearance {nearest * 1e3:.1f} mm, {len(errors)} errors")
    return 1 if errors else 0


if __name__ == "__main__":
    sys.exit(main())
