"""What `check_trajectory` costs, and whether it agrees with a check a hundred times finer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from clocks import clocked
from figures import Figures, heading
from planner_batch import bodies
from scipy.interpolate import CubicSpline

import cable_shape as cs
from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).resolve().parents[1] / "config" / "robots" / "dual_arm.yaml"
CABLE = cs.Cable(
    length=0.9,
    linear_density=0.06,
    bending_stiffness=0.006,
    twisting_stiffness=0.005,
    min_bend_radius=0.03,
    max_tension=10.0,
)
SECONDS, FINER = 1.0, 100


def cell(seed: int = 1) -> cs.Scene:
    """Twenty bodies around the cable that hangs between the arms at home."""
    random = np.random.default_rng(seed)
    moved = []
    for body in bodies(20, seed):
        place = random.uniform((0.15, -0.45, -0.1), (0.75, 0.45, 0.8))
        if abs(place[0] - 0.4) < 0.12 and place[2] < 0.45:
            place[0] += 0.16
        moved.append(cs.Obstacle(body.name, body.solid, cs.Pose(place, body.pose.quaternion)))
    return cs.Scene(obstacles=moved)


def path(robot: Robot, waypoints: int, wide: float, seed: int) -> cs.JointPath:
    """A smooth path through random postures around home, `wide` [rad]; arms apart."""
    random = np.random.default_rng(seed)
    arms = np.array(["finger" not in name for name in robot.joint_names])
    knots = robot.home + random.normal(0.0, wide, (6, len(arms))) * arms
    knots[0] = robot.home
    rows = CubicSpline(np.arange(6), knots)(np.linspace(0.0, 5.0, waypoints))
    return cs.JointPath(robot.joint_names, rows)


def brute_valid(scene: cs.Scene, robot: Robot, given: cs.JointPath) -> bool:
    """Every cycle of the path in steps a hundred times finer than its waypoints."""
    cycle = cs.Cycle(
        CABLE,
        scene=scene,
        robot_links=robot.link_geometry,
        gripping_links=robot.gripping_links,
        model="cosserat",
        tolerance=1e-4 * CABLE.length,
        snap_horizon=0.0,
    )
    count = len(given.positions)
    fine = np.linspace(0.0, count - 1.0, FINER * (count - 1) + 1)
    rows = np.stack([np.interp(fine, np.arange(count), column) for column in given.positions.T], axis=1)
    for i, q in enumerate(rows):
        if (q > robot.upper + 1e-9).any() or (q < robot.lower - 1e-9).any():
            return False
        start, end = robot.grips(q)
        report = cycle.step({"cable": (start, end)}, 1 + i, robot.link_poses())
        if report.shapes["cable"].status is not cs.Status.OK:
            return False
        if any(w.severity is cs.Severity.ERROR for w in report.warnings):
            return False
    return True


def print_time(figures: Figures, waypoints: int = 2000) -> None:
    """What long paths take."""
    robot = Robot.from_yaml(ROBOT)
    scene = cell()
    cs.check_trajectory(CABLE, scene, robot, path(robot, 5, 0.02, 1))
    heading(f"check_trajectory: {waypoints} waypoints, {len(robot.link_geometry)} bodies on links, 20 around")
    spent = []
    for wide in (0.01, 0.03, 0.06):
        given = path(robot, waypoints, wide, 1)
        runs = [clocked(lambda g=given: cs.check_trajectory(CABLE, scene, robot, g)) for _ in range(3)]
        spent.append(min(seconds for seconds, _ in runs))
        print(f"knots {wide:.2f} rad around home: {spent[-1]:.3f} s, {runs[-1][1]!r}")
    figures.at_most(f"check_trajectory, {waypoints} waypoints", max(spent), SECONDS, "{:.2f}", " s")


def print_agreement(figures: Figures, paths: int) -> None:
    """How often the verdict is that of the brute check."""
    robot = Robot.from_yaml(ROBOT)
    heading(f"check_trajectory against a check {FINER} times finer: {paths} random paths of 12 waypoints")
    valid = solved = differ = 0
    for seed in range(paths):
        scene, given = cell(seed), path(robot, 12, 0.02 + 0.12 * (seed % 5) / 4.0, seed)
        found, brute = cs.check_trajectory(CABLE, scene, robot, given), brute_valid(scene, robot, given)
        valid, solved = valid + brute, solved + found.solved
        if brute != found.valid:
            differ += 1
            print(f"  path {seed}: brute {'valid' if brute else 'not valid'}, {found!r}")
    print(f"{valid} of {paths} are valid; {solved / paths:.0f} shapes a path, {FINER * 11 + 1} of the other")
    figures.at_most(f"check_trajectory: verdicts of {paths} unlike those of the finer check", differ, 0, "{:.0f}")
