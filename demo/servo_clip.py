#!/usr/bin/env python3
"""Two arms lay a cable into the mouth of a clip by what a camera sees of it, and its recording.

.venv/bin/python demo/servo_clip.py [OUT.rrd] [--open]; look at it with rerun OUT.rrd. The cable of the cell is three
times as stiff as the robot knows, 1 % longer and gripped 3 mm elsewhere, the camera 3 mm noisy and 50 ms late. White
balls are points that are seen. Exit code 0: the cable lies in the clip and has touched nothing on the way; 1: not so;
2: wrong arguments. --open: without the camera.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import HeldCable
from cable_shape.viewer.recording import RecordingWriter

ROOT = Path(__file__).resolve().parents[1]
KNOWN = cs.Cable.from_yaml(ROOT / "config" / "cables" / "demo.yaml")
REAL = KNOWN.replace(length=1.01, bending_stiffness=0.03, twisting_stiffness=0.024)
SLIPS = (cs.Pose((0.002, 0.002, -0.001)), cs.Pose((-0.001, 0.002, 0.002)))  # 3 mm
NOISE, DELAY = 0.003, 0.05  # m, s
DT, LONGEST, AFTER = 0.025, 15.0, 0.5  # s: of a cycle, of all of it, and of standing still in the end
POINTS = 101
ALONG = (0.70710678, 0.0, 0.0, 0.70710678)  # the tangent along -y
CLIP = cs.Clip(0.5, cs.Pose((0.45, 0.02, 0.032), ALONG), "hinge", name="clip")
GAP, DEEP, LONG = 0.018, 0.024, 0.02  # m: between the jaws, of them, and along the cable


class Laid(NamedTuple):
    """How it went."""

    reached: bool
    off: float  # m, of the real cable from its place in the clip
    clearance: float  # m, least of the real cable to jaws and post, all the way
    seconds: float


def scene() -> cs.Scene:
    """The table, a post, and a clip on a stand: two jaws that open upwards."""
    x, y, z = CLIP.pose.position
    bottom = z - 0.5 * GAP
    high = DEEP + bottom
    bodies = [cs.Obstacle("table", cs.Box((1.2, 1.8, 0.04)), cs.Pose((0.35, 0.0, -0.02)))]
    bodies += [cs.Obstacle("post", cs.Cylinder(0.03, 0.24), cs.Pose((0.517, 0.22, 0.12)))]
    bodies += [cs.Obstacle("stand", cs.Box((0.03, LONG, bottom)), cs.Pose((x, y, 0.5 * bottom)))]
    for name, side in (("left jaw", -1.0), ("right jaw", 1.0)):
        place = (x + side * (0.5 * GAP + 0.002), y, 0.5 * (bottom + high))
        bodies.append(cs.Obstacle(name, cs.Box((0.004, LONG, DEEP)), cs.Pose(place)))
    return cs.Scene(obstacles=bodies, warn_distance=0.005, error_distance=0.0)


def lay(robot: Robot, path: Path | None, *, closed: bool = True, seed: int = 0) -> Laid:
    """Until it lies in the clip, or comes no nearer; with a recording if a path is given."""
    random = np.random.default_rng(seed)
    around = scene()
    held = HeldCable(cs.Predictor(KNOWN, model="cosserat", points=POINTS), robot)
    post = cs.Scene(obstacles=[body for body in around.obstacles if body.name in ("post", "table")])
    target = cs.MouthTarget.of(CLIP, outward=(0.0, 0.0, 1.0), approach=0.06)
    servo = cs.Servo(held, [target, cs.KeepClear(post, minimum=0.02)], delay=DELAY)
    links = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
    cycle = cs.Cycle(REAL, scene=around, model="cosserat", points=POINTS, **links)
    shown = None if path is None else RecordingWriter(path, cycle.cables, around, robot.link_geometry)
    bodies = {body.name for body in around.obstacles}
    late: list[np.ndarray] = []
    least, ends_at, k = np.inf, LONGEST, 0
    while k * DT < ends_at:
        start, end = (grip.cable_frame * slip for grip, slip in zip(robot.grips(servo.q), SLIPS, strict=True))
        stamp = round(1e9 * k * DT)
        report = cycle.step({"cable": (start, end)}, stamp, robot.link_poses())
        real = report.shapes["cable"].positions
        near = [body.distance for body in report.clearance["cable"].bodies if body.body in bodies]
        least = min([least, *near])
        late.append(real[::2] + random.normal(0.0, NOISE, real[::2].shape))
        points = late[max(0, len(late) - 1 - round(DELAY / DT))]
        if shown is not None:
            shown.log(report)
            if closed:
                shown.log_markers(points, stamp)
        servo.step(cs.CableShape.of_points(points, KNOWN.length) if closed else None, DT)
        k += 1
        if (servo.reached or servo.stalled) and ends_at == LONGEST:
            ends_at = k * DT + AFTER
    if shown is not None:
        shown.close()
    off = float(np.linalg.norm(real[POINTS // 2] - CLIP.pose.position))
    return Laid(servo.reached, off, float(least), k * DT)


def main(arguments: list[str] | None = None) -> int:
    """Lays it in, records it, and says how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, nargs="?", default=Path("out/servo.rrd"), metavar="OUT.rrd")
    parser.add_argument("--open", action="store_true", help="open loop: the camera is not looked at")
    options = parser.parse_args(arguments)
    options.recording.parent.mkdir(parents=True, exist_ok=True)
    robot = Robot.from_yaml(ROOT / "config" / "robots" / "dual_arm.yaml")
    laid = lay(robot, options.recording, closed=not options.open)
    print(
        f"servo: after {laid.seconds:.1f} s the cable is {1e3 * laid.off:.1f} mm from its place in the clip; before, "
        f"it was no nearer than {1e3 * laid.clearance:.1f} mm to jaws, post and table; {options.recording}"
    )
    return 0 if laid.reached and laid.off < 0.5 * GAP and laid.clearance > 0.0 else 1


if __name__ == "__main__":
    sys.exit(main())
