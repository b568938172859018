"""What clearance costs: a cable between two arms, 30 bodies around it, few or all of them near."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from clocks import Turns
from figures import Figures, heading
from scipy.spatial import ConvexHull

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.scene import Solid

CELL = Path(__file__).resolve().parents[1] / "config" / "robots" / "dual_arm.yaml"
CABLE = cs.Cable(length=0.9, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
BODIES, NEAR, NEAR_MESHES = 30, 6, 2
ASKED_US = 150.0
SHAPES, ROUNDS = 40, 25
WARN = 0.03  # m
CLOSE, FAR = (0.005, 0.025), (0.15, 0.6)  # m from the cable


def ball_mesh(radius: float, triangles: int = 480) -> cs.Mesh:
    """A closed ball of so many triangles around points on a spiral."""
    k = np.arange(triangles // 2 + 2) + 0.5
    z, turn = 1.0 - 2.0 * k / k.size, np.pi * (1.0 + math.sqrt(5.0)) * k
    around = np.sqrt(1.0 - z**2)
    points = np.stack((around * np.cos(turn), around * np.sin(turn), z), axis=1)
    faces = ConvexHull(points).simplices
    inwards = np.linalg.det(points[faces]) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return cs.Mesh(radius * points, faces)


def solids(rng: np.random.Generator) -> list[Solid]:
    """As many as BODIES, meshes first, then the others in turns."""
    meshes: list[Solid] = [ball_mesh(rng.uniform(0.03, 0.08)) for _ in range(4)]
    rest: list[Solid] = []
    while len(meshes) + len(rest) < BODIES:
        a, b, c = rng.uniform(0.03, 0.1, 3)
        rest += [cs.Box((a, b, c)), cs.Sphere(a), cs.Cylinder(0.5 * a, b), cs.Capsule(0.5 * a, b)]
    return [*meshes, *rest][:BODIES]


def placed(solid: Solid, name: str, gap: float, shape: cs.CableShape, rng: np.random.Generator) -> cs.Obstacle:
    """The body with its surface `gap` [m] from the cable's, somewhere along it in some direction."""
    q = rng.normal(size=4)
    turn = q / np.linalg.norm(q)
    point = shape.positions[rng.integers(20, shape.points - 20)]
    n = rng.normal(size=3)
    n[1] *= 0.2  # mostly across the cable, which spans the cell along y
    n /= np.linalg.norm(n)
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        body = cs.Obstacle(name, solid, cs.Pose(point + middle * n, turn))
        checker = ClearanceChecker(cs.Scene(obstacles=(body,)), radius=0.5 * CABLE.diameter, horizon=10.0)
        low, high = (middle, high) if checker.check(shape).bodies[0].distance < gap else (low, middle)
    return body


def print_clearance(figures: Figures) -> None:
    """The medians."""
    robot = Robot.from_yaml(CELL)
    links = robot.link_poses()
    start, end = robot.grips()
    predictor = cs.Predictor(CABLE)
    shapes = []
    for k in range(SHAPES):
        shift = 0.01 * np.array((np.sin(0.2 * k), 0.0, np.cos(0.15 * k) - 1.0))
        frame = end.pose
        shapes.append(predictor.predict(start, cs.Grip(cs.Pose(frame.position + shift, frame.quaternion), end.kind)))
    heading(f"Clearance to {BODIES} bodies and the links of two arms ({len(robot.link_geometry)} bodies), 150 points")
    for name, near in ((f"{NEAR} near", NEAR), (f"all {BODIES} near", BODIES)):
        rng = np.random.default_rng(30)
        bodies, count = [], 0
        for i, solid in enumerate(solids(rng)):
            close = near == BODIES or i < NEAR_MESHES or (i >= 4 and count < near)
            count += close
            bodies.append(placed(solid, f"body_{i}", rng.uniform(*(CLOSE if close else FAR)), shapes[0], rng))
        scene = cs.Scene(obstacles=bodies, warn_distance=WARN)
        geometry = {"robot_links": robot.link_geometry, "gripping_links": robot.gripping_links}
        checker, slow = (
            ClearanceChecker(scene, radius=0.5 * CABLE.diameter, cull=cull, **geometry) for cull in (True, False)
        )
        turns = Turns("culled", "every")
        for _ in range(ROUNDS):
            for shape in shapes:
                turns.of("culled", lambda c=checker, s=shape: c.check(s, links))
        for shape in shapes[:2]:
            turns.of("every", lambda c=slow, s=shape: c.check(s, links))
        culled, every = (1e6 * turns.medians[which] for which in ("culled", "every"))
        clearance = checker.check(shapes[0], links)
        inside = [b.body for b in clearance.bodies if b.distance < WARN and b.body.startswith("body_")]
        print(
            f"{name}: {culled:.0f} us, without culling {every:.0f} us; "
            f"{len(inside)} obstacles within {WARN:g} m, "
            f"of which {sum(b in [f'body_{i}' for i in range(4)] for b in inside)} meshes of 480 triangles; "
            f"{clearance.pairs_culled} pairs culled, {clearance.pairs_exact} computed"
        )
        if near == NEAR:
            figures.at_least("clearance: obstacles within the warning distance", len(inside), NEAR, "{:d}")
            figures.at_most(
                f"clearance, {NEAR} of {BODIES} obstacles and two arms near", culled, ASKED_US, "{:.0f}", " us"
            )
