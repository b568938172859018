"""The task and the limits that steer the cable through mink: their Jacobians, and that they do what they say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mink
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import CableChordLimit, CableClearanceLimit, CablePointTask, HeldCable

ROOT = Path(__file__).resolve().parents[2]
DUAL_ARM = ROOT / "config/robots/dual_arm.yaml"
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
STEP = 1e-4  # rad, of the differences


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(DUAL_ARM)


def held_by(robot: Robot, **options) -> HeldCable:
    return HeldCable(cs.Predictor(CABLE, model="cosserat", tolerance=1e-7, **options), robot)


def around_home(robot: Robot, seed: int, wide: float = 0.15) -> np.ndarray:
    """Joint positions, fingers at home."""
    arms = np.array(["finger" not in name for name in robot.joint_names])
    while True:
        q = robot.home + np.random.default_rng(seed).normal(0.0, wide, len(arms)) * arms
        start, end = (grip.cable_frame.position for grip in robot.grips(q))
        if np.linalg.norm(end - start) < 0.95 * CABLE.length:
            return q
        seed += 1000


def predicted(robot: Robot, q: np.ndarray) -> cs.CableShape:
    """From nothing, at the grips that Pinocchio gives."""
    return cs.predict(CABLE, *robot.grips(q), model="cosserat", points=601, tolerance=1e-7)


def place_on(shape: cs.CableShape, arc_length: float) -> np.ndarray:
    return CubicSpline(shape.arc_length, shape.positions)(arc_length)


def differences(held: HeldCable, q: np.ndarray, of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Central differences of `of`, a function of the joints, along every velocity of mink's configuration."""
    columns = []
    for velocity in np.eye(held.model.nv):
        sides = []
        for sign in (-1.0, 1.0):
            configuration = held.configuration(q)
            configuration.integrate_inplace(sign * STEP * velocity, 1.0)
            sides.append(np.atleast_1d(of(held.q(configuration))))
        columns.append((sides[1] - sides[0]) / (2.0 * STEP))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize(("seed", "arc_length"), [(0, 0.0), (1, 0.3137), (2, 0.5), (3, 0.8), (4, 1.0)])
def test_the_jacobian_of_a_point_is_that_of_differences(robot: Robot, seed: int, arc_length: float) -> None:
    held, q = held_by(robot), around_home(robot, seed)
    task = CablePointTask(held, arc_length)
    task.set_target((0.1, 0.2, 0.3))
    configuration = held.configuration(q)
    expected = place_on(predicted(robot, q), arc_length) - (0.1, 0.2, 0.3)
    np.testing.assert_allclose(task.compute_error(configuration), expected, atol=1e-6)
    jacobian = task.compute_jacobian(configuration)
    wanted = differences(held, q, lambda p: place_on(predicted(robot, p), arc_length))
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_allclose(jacobian, wanted, atol=2e-5)


def test_the_jacobian_follows_joints_that_mimic(robot: Robot) -> None:
    """The left wrist's second joint at twice the first: the column of the first has both, that of the second none."""
    text = robot.urdf.replace(
        '<joint name="left_wrist_2_joint" type="revolute">',
        '<joint name="left_wrist_2_joint" type="revolute">'
        '<mimic joint="left_wrist_1_joint" multiplier="0.5" offset="-0.55"/>',
    )
    home = {name: float(v) for name, v in zip(robot.joint_names, robot.home, strict=True) if "wrist_2" not in name}
    home["right_wrist_2_joint"] = float(robot.home[robot.joint_names.index("right_wrist_2_joint")])
    coupled = Robot(text, robot.grippers, home)
    assert "left_wrist_2_joint" not in coupled.joint_names
    held = held_by(coupled)
    task = CablePointTask(held, 0.3)
    task.set_target((0.0, 0.0, 0.0))
    jacobian = task.compute_jacobian(held.configuration(coupled.home))
    wanted = differences(held, coupled.home, lambda p: place_on(predicted(coupled, p), 0.3))
    np.testing.assert_allclose(jacobian, wanted, atol=2e-5)
    follower = held.model.joint("left_wrist_2_joint").dofadr[0]
    assert (jacobian[:, follower] == 0.0).all()


def bodies_near(robot: Robot) -> cs.Scene:
    """A ball below the cable, a floor, and a bar that the right palm carries before the cable's middle."""
    robot.update(robot.home)
    held_out = robot.link_poses()["right_palm"].inverse() * cs.Pose((0.5, 0.05, 0.1))
    return cs.Scene(
        obstacles=[
            cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose((0.42, 0.02, 0.0))),
            cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.05))),
            cs.Obstacle("bar", cs.Capsule(0.01, 0.2), held_out, link="right_palm"),
        ]
    )


def test_the_jacobian_of_distances_is_that_of_differences(robot: Robot) -> None:
    held = held_by(robot, points=301)
    scene = bodies_near(robot)
    limit = CableClearanceLimit(held, scene, minimum=0.02, horizon=0.6)
    configuration = held.configuration(robot.home)
    bodies, jacobian = limit.distances(configuration)
    constraint = limit.compute_qp_inequalities(configuration, 0.01)
    np.testing.assert_array_equal(constraint.G, -jacobian)
    np.testing.assert_allclose(constraint.h, 0.85 * (np.array([body.distance for body in bodies]) - 0.02))
    names = [body.body for body in bodies]
    assert {"ball", "floor", "bar"} <= set(names)
    assert any("left" in name for name in names)  # links of the robot, too

    def distances(q: np.ndarray) -> np.ndarray:
        other = held.configuration(q)
        return np.array([body.distance for body in limit.distances(other)[0] if body.body in chosen])

    # where the nearest point jumps from one place to another there is no derivative: those bodies are left out
    chosen = ("ball", "floor", "bar")
    wanted = differences(held, robot.home, distances)
    rows = [i for i, name in enumerate(names) if name in chosen]
    assert np.abs(wanted).max(axis=1).min() > 0.05
    np.testing.assert_allclose(jacobian[rows], wanted, atol=2e-3)


def test_the_chord_limit_is_that_of_differences(robot: Robot) -> None:
    held, q = held_by(robot), around_home(robot, 7)
    limit = CableChordLimit(held, most=0.9, gain=0.5)
    constraint = limit.compute_qp_inequalities(held.configuration(q), 0.01)

    def chord(p: np.ndarray) -> float:
        start, end = (grip.cable_frame.position for grip in robot.grips(p))
        return float(np.linalg.norm(end - start))

    np.testing.assert_allclose(constraint.G, differences(held, q, chord), atol=1e-7)
    assert constraint.h == pytest.approx([0.5 * (0.9 * CABLE.length - chord(q))])


def steered(robot: Robot, place: np.ndarray, limited: CableClearanceLimit | None, held: HeldCable) -> tuple:
    """The middle is taken towards a place from home; how near it comes and the least distance to a ball."""
    task = CablePointTask(held, 0.5, lm_damping=1e-2)
    task.set_target(place)
    configuration = held.configuration()
    posture = mink.PostureTask(held.model, cost=1e-4)
    posture.set_target_from_configuration(configuration)
    limits = [
        mink.ConfigurationLimit(held.model),
        mink.VelocityLimit(held.model, dict.fromkeys(robot.single_joints, 0.05)),
        CableChordLimit(held),
    ]
    limits += [] if limited is None else [limited]
    watch = limited or CableClearanceLimit(held, bodies_near(robot), minimum=0.02)
    least = np.inf
    for _ in range(60):
        least = min([least, *(b.distance for b in watch.distances(configuration)[0] if b.body == "ball")])
        velocity = mink.solve_ik(configuration, [task, posture], 1.0, solver="daqp", limits=limits)
        configuration.integrate_inplace(velocity, 1.0)
    reached = place_on(predicted(robot, held.q(configuration)), 0.5)
    return float(np.linalg.norm(reached - place)), least


def test_a_point_is_brought_to_its_place_and_bodies_keep_it_off(robot: Robot) -> None:
    held = held_by(robot)
    middle = held.point(held.at(held.configuration()), 0.5)[0]
    apart, _ = steered(robot, middle + np.array((0.05, 0.03, 0.06)), None, held)
    assert apart < 1e-4
    inside = np.array((0.42, 0.02, 0.0))  # of the ball
    apart, least = steered(robot, inside, None, held)
    assert apart < 1e-3
    assert least < 0.0
    limit = CableClearanceLimit(held, bodies_near(robot), minimum=0.02)
    apart, least = steered(robot, inside, limit, held)
    assert 0.02 - 5e-4 < least < 0.025
    assert apart > 0.03 + 0.02


def test_one_prediction_serves_every_task_and_limit(robot: Robot) -> None:
    held = held_by(robot)
    configuration = held.configuration()
    first = held.at(configuration)
    task = CablePointTask(held, 0.25)
    task.set_target_from_configuration(configuration)
    assert np.linalg.norm(task.compute_error(configuration)) == 0.0
    CableChordLimit(held).compute_qp_inequalities(configuration, 0.1)
    assert held.at(configuration) is first
    held.predictor.scene = cs.Scene(masses=[cs.PointMass(0.5, 0.05)])
    heavy = held.at(configuration).shape
    assert heavy.positions[:, 2].min() < first.shape.positions[:, 2].min() - 1e-3


def test_arguments_that_are_refused(robot: Robot) -> None:
    held = held_by(robot)
    with pytest.raises(cs.ArgumentError, match=r"arc_length = 1.2.*at most the cable's length, 1 m"):
        CablePointTask(held, 1.2)
    with pytest.raises(cs.ArgumentError, match=r"cost = \[1.0, -1.0, 1.0\].*at least 0"):
        CablePointTask(held, 0.5, cost=(1.0, -1.0, 1.0))
    with pytest.raises(cs.ArgumentError, match=r"gain = 1.5.*at most 1"):
        CablePointTask(held, 0.5, gain=1.5)
    with pytest.raises(cs.ArgumentError, match="Call set_target first"):
        CablePointTask(held, 0.5).compute_error(held.configuration())
    with pytest.raises(cs.ArgumentError, match=r"place = .*shape \(3,\)"):
        CablePointTask(held, 0.5).set_target((0.0, 1.0))
    with pytest.raises(cs.ArgumentError, match=r"most = 0.*above 0"):
        CableChordLimit(held, most=0.0)
    with pytest.raises(cs.ArgumentError, match=r"q = .*shape \(14,\)"):
        held.configuration(np.zeros(3))
    with pytest.raises(cs.RobotError, match="disagree on 'left_tool'"):
        HeldCable(held.predictor, robot, xml=robot.urdf.replace('xyz="0 0.0996 0"', 'xyz="0 0.0997 0"'))


def test_a_cable_without_a_shape_is_not_steered(robot: Robot) -> None:
    held = HeldCable(cs.Predictor(CABLE.replace(length=0.5), model="cosserat"), robot)
    with pytest.raises(cs.SteeringError, match=r"OVERSTRETCHED.*CableChordLimit"):
        held.at(held.configuration())


def test_the_jacobian_counts_clips_on_links(robot: Robot) -> None:
    """One on the left tool, which turns with its wrist, and how a frame turns beyond it."""
    clips = [cs.Clip(0.35, cs.Pose((0.05, 0.2, 0.05)), link="left_tool")]
    held, q = held_by(robot, scene=cs.Scene(clips=clips)), around_home(robot, 1, 0.05)
    configuration = held.configuration(q)
    task = CablePointTask(held, 0.6)
    task.set_target((0.0, 0.0, 0.0))
    alone = cs.Predictor(CABLE, model="cosserat", tolerance=1e-7, scene=held.predictor.scene, points=601)

    def shape(p: np.ndarray) -> cs.CableShape:
        return alone.predict(*robot.grips(p), robot.link_poses())

    jacobian, turning = task.compute_jacobian(configuration), held.turning(configuration, 0.6)
    wanted = differences(held, q, lambda p: place_on(shape(p), 0.6))
    np.testing.assert_allclose(jacobian, wanted, atol=5e-5)
    without = np.array(held.predictor.sensitivity(at="gripper")[90] @ held.predicted(configuration).twists[:12])
    assert np.abs(without - wanted).max() > 0.05, "the clip counts"
    here = Rotation.from_quat(shape(q).quaternions[360])
    turned = differences(held, q, lambda p: (here.inv() * Rotation.from_quat(shape(p).quaternions[360])).as_rotvec())
    np.testing.assert_allclose(turning, turned, atol=1e-3)
