#!/usr/bin/env python3
"""The worked planners and their recordings: two arms carry a cable past a post, or route it through a whole task.

scripts/plan [--routing] [OUT.rrd] [--seed N] [--seconds S]; look at it with rerun OUT.rrd. Exit code 0: a path was
found and every report along it is free of errors; 1: none was found in time, or a report has an error; 2: wrong
arguments.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plan_cable
import route_cable

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.viewer.recording import RecordingWriter

RATE = 50.0  # Hz, of the recording
PAUSE = 0.5  # s, to look at what an edit has done


def record(
    robot: Robot, cable: cs.Cable, scene: cs.Scene, parts: Sequence[Any], path: Path, clips: Sequence[cs.Clip] = ()
) -> list[cs.CycleReport]:
    """Writes paths and edits as cycles at RATE to a .rrd, with all `clips` drawn at once; returns the reports."""
    links = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    cycle = cs.Cycle(cable, scene=scene, model="cosserat", **links)
    reports: list[cs.CycleReport] = []
    with RecordingWriter(path, cycle.cables, scene.replace(clips=clips), robot.link_geometry) as writer:
        began = 0.0
        for part in parts:
            if not isinstance(part, cs.JointPath):
                done = cycle.edit(part)
                if not done:
                    raise cs.RobotError(f"recording: {done.reason}")
                continue
            times = part.times
            assert times is not None
            first = times[0] - (PAUSE if reports else 0.0)  # the hands stand still after edits
            for t in np.linspace(first, times[-1], int((times[-1] - first) * RATE) + 2):
                q = np.array([np.interp(t, times, column) for column in part.positions.T])
                stamp = round(1e9 * (began + t))
                report = cycle.step({"cable": robot.grips(q)}, stamp, robot.link_poses())
                writer.log(report)
                reports.append(report)
            began += times[-1] + PAUSE + 1.0 / RATE
    return reports


def main(arguments: list[str] | None = None) -> int:
    """Plans, records, says what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, nargs="?", default=Path("out/plan.rrd"), metavar="OUT.rrd")
    parser.add_argument("--routing", action="store_true", help="the task from the table to the last clip")
    parser.add_argument("--seed", type=int, default=1, help="of the search (%(default)s)")
    parser.add_argument("--seconds", type=float, default=60.0, help="that the search may take (%(default)g)")
    options = parser.parse_args(arguments)
    if not options.seconds > 0.0:
        parser.error(f"--seconds {options.seconds}: it must be above 0")
    if options.seed < 1:
        parser.error(f"--seed {options.seed}: it must be at least 1")
    robot = Robot.from_yaml(plan_cable.ROOT / "config/robots/dual_arm.yaml")
    if options.routing:
        task = route_cable.plan(robot, seed=options.seed, seconds=options.seconds)
        parts: Sequence[Any] = () if task is None else task.parts
        found, cable, scene, clips = task, route_cable.CABLE, route_cable.SCENE, route_cable.CLIPS
    else:
        way = plan_cable.plan(robot, seed=options.seed, seconds=options.seconds)
        parts = () if way is None else (way.path,)
        found, cable, scene, clips = way, plan_cable.cable(), plan_cable.SCENE, ()
    if found is None:
        print(f"plan: no path found in {options.seconds:g} s; another --seed may have one", file=sys.stderr)
        return 1
    if isinstance(found, plan_cable.Plan):
        print(f"straight there: {found.direct!r}")
    print(f"found in {found.seconds:.1f} s over {found.edges} edges: {found.check!r}")
    options.recording.parent.mkdir(parents=True, exist_ok=True)
    reports = record(robot, cable, scene, parts, options.recording, clips)
    errors = [w.text for report in reports for w in report.warnings if w.severity is cs.Severity.ERROR]
    nearest = min((body.distance for report in reports for body in report.clearance["cable"].bodies), default=np.inf)
    print(f"{options.recording}: {len(reports)} cycles, least clearance {nearest * 1e3:.1f} mm, {len(errors)} errors")
    for text in list(dict.fromkeys(errors))[:3]:
        print(f"  {text}", file=sys.stderr)
    return 1 if errors or not found.check.valid else 0


if __name__ == "__main__":
    sys.exit(main())
