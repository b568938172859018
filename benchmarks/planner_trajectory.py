"""What `check_trajectory` costs, and whether it agrees with a check a hundred times finer, in contact, too."""

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
    diameter=0.008,
)
JUMP = 0.02  # of the length, in a step a hundred times finer than the waypoints
SECONDS, ON_TABLE, FINER = 1.0, 2.0, 100


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


def touching(robot: Robot, seed: int) -> cs.Scene:
    """A table and a post under the cable, which may press on them; in every other cell it may touch the arms, too."""
    random = np.random.default_rng(seed)
    top = random.uniform(-0.02, 0.12)
    table = cs.Obstacle("table", cs.Box((1.2, 1.8, 0.04)), cs.Pose((0.35, 0.0, top - 0.02)))
    place = random.uniform(0.3, 0.6), random.uniform(-0.1, 0.1), top
    post = cs.Obstacle("post", cs.Capsule(0.02, 0.2), cs.Pose(place))
    links = [body.name for body in robot.link_geometry] if seed % 2 else []
    allow = [cs.Allow("table", max_force=random.choice([0.3, 0.5, 5.0])), cs.Allow("post", 0.1, 0.8)]
    allow += [cs.Allow(name) for name in links]
    return cs.Scene([table, post], contact="solve", allow=allow, error_distance=0.002, warn_distance=0.01)


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
    before = None
    for i, q in enumerate(rows):
        if (q > robot.upper + 1e-9).any() or (q < robot.lower - 1e-9).any():
            return False
        start, end = robot.grips(q)
        report = cycle.step({"cable": (start, end)}, 1 + i, robot.link_poses())
        shape = report.shapes["cable"]
        if shape.status is not cs.Status.OK:
            return False
        if before is not None and np.linalg.norm(shape.positions - before, axis=1).max() > JUMP * CABLE.length:
            return False  # to another branch, of which a cycle in contact may not tell
        before = shape.positions
        errors = [w for w in report.warnings if w.severity is cs.Severity.ERROR]
        if any(w.kind is not cs.WarningKind.QUASISTATIC for w in errors):
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
    table = cs.Obstacle("table", cs.Box((1.2, 1.8, 0.04)), cs.Pose((0.35, 0.0, 0.14)))
    on_it = cs.Scene([table], contact="solve", allow=[cs.Allow("table")])
    given = path(robot, waypoints, 0.01, 1)
    runs = [clocked(lambda: cs.check_trajectory(CABLE, on_it, robot, given)) for _ in range(3)]
    least = min(seconds for seconds, _ in runs)
    print(f"the same on a table, links in the equilibrium: {least:.3f} s, {runs[-1][1]!r}")
    figures.at_most(f"check_trajectory, {waypoints} waypoints on a table", least, ON_TABLE, "{:.2f}", " s")


def print_agreement(figures: Figures, paths: int) -> None:
    """How often the verdict is that of the brute check, among bodies and in contact with them."""
    robot = Robot.from_yaml(ROBOT)
    for where, scene_of in (("", cell), (" in contact", lambda seed: touching(robot, seed))):
        heading(f"check_trajectory{where} against a check {FINER} times finer: {paths} random paths of 12 waypoints")
        valid = solved = differ = 0
        for seed in range(paths):
            scene, given = scene_of(seed), path(robot, 12, 0.02 + 0.12 * (seed % 5) / 4.0, seed)
            found, brute = cs.check_trajectory(CABLE, scene, robot, given), brute_valid(scene, robot, given)
            valid, solved = valid + brute, solved + found.solved
            if brute != found.valid:
                differ += 1
                print(f"  path {seed}: brute {'valid' if brute else 'not valid'}, {found!r}")
        print(f"{valid} of {paths} are valid; {solved / paths:.0f} shapes a path, {FINER * 11 + 1} of the other")
        what = f"check_trajectory{where}: verdicts of {paths} unlike those of the finer check"
        figures.at_most(what, differ, 0, "{:.0f}")
