"""Whether the steering task brings a point of the cable where it can be brought, within joint limits and clearance."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import mink
import numpy as np
from clocks import clocked
from figures import Figures, heading
from scipy.interpolate import CubicSpline

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import CableChordLimit, CableClearanceLimit, CablePointTask, HeldCable

ROBOT = Path(__file__).resolve().parents[1] / "config" / "robots" / "dual_arm.yaml"
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
SCENE = cs.Scene(obstacles=[cs.Obstacle("table", cs.Box((1.2, 1.8, 0.04)), cs.Pose((0.35, 0.0, -0.02)))])
BOUND = 0.01  # m, of clearance
NEAR = 1e-3  # m, so near the point must come ...
SHARE = 0.95  # ... in this part of the tries
STEPS, STEP = 200, 0.05  # at most so many, of at most so much a joint [rad]
WIDE = 0.35  # rad, spread of the postures whose cables give the targets, around home


class Try(NamedTuple):
    """How one target was approached."""

    apart: float  # m, from the target in the end
    clearance: float  # m, least on the way
    within: bool  # joint limits, all the way
    steps: int


def shape_at(robot: Robot, q: np.ndarray, model: str = "cosserat", points: int = 1201) -> cs.CableShape:
    """From nothing, by Pinocchio: apart from what steered."""
    return cs.predict(CABLE, *robot.grips(q), model=model, points=points)


def place_on(shape: cs.CableShape, arc_length: float) -> np.ndarray:
    """The centreline there (3,) [m]."""
    return CubicSpline(shape.arc_length, shape.positions)(arc_length)


def target(robot: Robot, random: np.random.Generator) -> tuple[float, np.ndarray]:
    """A point of the cable and where it is at a random posture with an untaut cable that touches nothing."""
    arms = np.array(["finger" not in name for name in robot.joint_names])
    cycle = cs.Cycle(CABLE, scene=SCENE, robot_links=robot.link_geometry, gripping_links=robot.gripping_links)
    while True:
        q = robot.home + random.normal(0.0, WIDE, len(arms)) * arms
        start, end = (grip.cable_frame for grip in robot.grips(q))
        if np.linalg.norm(end.position - start.position) > 0.95 * CABLE.length:
            continue
        if (q > robot.upper).any() or (q < robot.lower).any():
            continue
        cycle.reset()
        report = cycle.step({"cable": (start, end)}, 0, robot.link_poses())
        closest = report.clearance["cable"].closest
        if report.shapes["cable"].status is cs.Status.OK and (closest is None or closest.distance > 2.0 * BOUND):
            arc_length = float(random.uniform(0.1, 0.9)) * CABLE.length
            return arc_length, place_on(shape_at(robot, q), arc_length)


class Steering:
    """The task with mink's own posture task and limits, and the cable's."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.held = HeldCable(cs.Predictor(CABLE, model="cosserat"), robot)
        model = self.held.model
        self.posture = mink.PostureTask(model, cost=1e-4)
        self.clearance = CableClearanceLimit(self.held, SCENE, minimum=BOUND)
        self.limits = [
            mink.ConfigurationLimit(model),
            mink.VelocityLimit(model, dict.fromkeys(robot.single_joints, STEP)),
            CableChordLimit(self.held, most=0.97),
            self.clearance,
        ]

    def approach(self, arc_length: float, place: np.ndarray) -> Try:
        """From home until the point is at its place, or no nearer."""
        task = CablePointTask(self.held, arc_length, lm_damping=1e-2)
        task.set_target(place)
        configuration = self.held.configuration()
        self.held.predictor.reset()
        self.posture.set_target_from_configuration(configuration)
        least, within, step = np.inf, True, 0
        for step in range(STEPS + 1):  # noqa: B007
            bodies, _ = self.clearance.distances(configuration)
            least = min([least, *(body.distance for body in bodies)])
            q = self.held.q(configuration)
            within &= bool((q <= self.robot.upper + 1e-6).all() and (q >= self.robot.lower - 1e-6).all())
            if np.linalg.norm(task.compute_error(configuration)) < 0.1 * NEAR:
                break
            try:
                velocity = mink.solve_ik(configuration, [task, self.posture], 1.0, solver="daqp", limits=self.limits)
            except mink.NoSolutionFound:
                break
            configuration.integrate_inplace(velocity, 1.0)
        shape = shape_at(self.robot, self.held.q(configuration))
        apart = float(np.linalg.norm(place_on(shape, arc_length) - place))
        return Try(apart, float(least), within, step)


def print_steering(figures: Figures, tries: int) -> None:
    """How many targets are reached."""
    robot = Robot.from_yaml(ROBOT)
    steering = Steering(robot)
    heading(f"The cable task: {tries} reachable targets of a point of the centreline, from home")
    found, spent = [], 0.0
    for seed in range(tries):
        arc_length, place = target(robot, np.random.default_rng(seed))
        seconds, one = clocked(lambda s=arc_length, p=place: steering.approach(s, p))
        found.append(one)
        spent += seconds
    steps = np.array([one.steps for one in found])
    reached = np.array([one.apart for one in found]) <= NEAR
    for seed in np.flatnonzero(~reached):
        print(f"  target {seed}: {found[seed]}")
    print(
        f"{reached.sum()} of {tries} within {NEAR * 1e3:g} mm, judged by cold predictions at Pinocchio's grips; "
        f"{np.median(steps):.0f} steps in the median, {steps.max()} at most; {spent / steps.sum() * 1e3:.2f} ms a step"
    )
    figures.at_least("steering: targets reached", 100.0 * reached.mean(), 100.0 * SHARE, "{:.1f}", " %")
    figures.check("steering: joint limits kept", all(one.within for one in found))
    print(f"least clearance {1e3 * min(one.clearance for one in found):.2f} mm, bound {1e3 * BOUND:g} mm")
