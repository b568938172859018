"""The servo: Jacobians of its targets, that limits and bounds are kept, what it does with targets out of reach, and
with a cable that is not as the model says."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import mink
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation, Slerp
from seen_cell import CABLE, DT, POINTS, Cell, Wrong

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.servo_seen import Seen
from cable_shape.robots.servo_tasks import MouthTask, task_of
from cable_shape.robots.steering import CableClearanceLimit, CableLoadLimit, HeldCable

ROOT = Path(__file__).resolve().parents[2]
STEP = 1e-4  # rad, of the differences
ALONG_Y = (-0.70710678, 0.0, 0.0, 0.70710678)  # d3 = y


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(ROOT / "config/robots/dual_arm.yaml")


def held_by(robot: Robot, cable: cs.Cable = CABLE, **options) -> HeldCable:
    return HeldCable(cs.Predictor(cable, model="cosserat", **{"points": POINTS, **options}), robot)


def around_home(robot: Robot, seed: int, wide: float = 0.15) -> np.ndarray:
    """Joint positions with a cable that is not taut, fingers at home."""
    random = np.random.default_rng(seed)
    while True:
        q = robot.home + random.normal(0.0, wide, len(robot.home)) * robot.carrying
        start, end = (grip.cable_frame.position for grip in robot.grips(q))
        if np.linalg.norm(end - start) < 0.95 * CABLE.length:
            return np.clip(q, robot.lower, robot.upper)


def predicted(robot: Robot, q: np.ndarray, cable: cs.Cable = CABLE) -> cs.CableShape:
    """From nothing, at the grips that Pinocchio gives."""
    return cs.predict(cable, *robot.grips(q), model="cosserat", points=601, tolerance=1e-7)


def run(servo: cs.Servo, steps: int = 500, shapes: Callable[[], cs.CableShape | None] = lambda: None) -> None:
    for _ in range(steps):
        servo.step(shapes(), DT)
        if servo.reached or servo.stalled:
            return


def test_the_jacobian_of_every_target_is_that_of_differences(robot: Robot) -> None:
    held, q = held_by(robot, tolerance=1e-7, points=301), around_home(robot, 3)
    mouth = cs.MouthTarget(0.4, cs.Pose((0.4, 0.1, 0.1), ALONG_Y), (0.1, 0.0, 1.0))

    def place(shape: cs.CableShape, s: float) -> np.ndarray:
        return CubicSpline(shape.arc_length, shape.positions)(s)

    def tangent(shape: cs.CableShape, s: float) -> np.ndarray:
        return CubicSpline(shape.arc_length, shape.tangents)(s)

    def roll(shape: cs.CableShape, s: float, direction: tuple[float, float, float]) -> np.ndarray:
        frame = Slerp(shape.arc_length, Rotation.from_quat(shape.quaternions))(s)
        x, y, _ = frame.inv().apply(direction)
        return np.array([-np.arctan2(y, x)])

    line = np.linspace((0.4, 0.4, 0.2), (0.4, -0.4, 0.1), 7)
    out = mouth.pose.position + mouth.approach * mouth.outward
    wanted: list[tuple[cs.PointsTarget, Callable[[cs.CableShape], np.ndarray]]] = [
        (cs.PointsTarget(0.3137, (0.1, 0.2, 0.3)), lambda shape: place(shape, 0.3137) - (0.1, 0.2, 0.3)),
        (
            cs.PointsTarget((0.0, 0.9), np.zeros((2, 3))),
            lambda shape: np.concatenate((place(shape, 0.0), place(shape, 0.9))),
        ),
        (cs.CentrelineTarget(line), lambda shape: (place(shape, np.linspace(0.0, 1.0, 7)) - line).ravel()),
        (cs.TangentTarget(0.62, (0.0, -2.0, 0.0)), lambda shape: tangent(shape, 0.62) - (0.0, -1.0, 0.0)),
        (cs.TangentTarget(0.0, (1.0, 0.0, 0.0)), lambda shape: tangent(shape, 0.0) - (1.0, 0.0, 0.0)),
        (cs.TwistTarget(0.37, (0.3, 0.1, 1.0)), lambda shape: roll(shape, 0.37, (0.3, 0.1, 1.0))),
        (cs.TwistTarget(1.0, (0.0, 0.0, -1.0)), lambda shape: roll(shape, 1.0, (0.0, 0.0, -1.0))),
        (mouth, lambda shape: np.concatenate((place(shape, 0.4) - out, tangent(shape, 0.4) - mouth.tangent))),
    ]
    for target, of in wanted:
        task, configuration = task_of(held, target), held.configuration(q)
        np.testing.assert_allclose(task.compute_error(configuration), of(predicted(robot, q)), atol=2e-6)
        columns = []
        for velocity in np.eye(held.model.nv):
            sides = []
            for sign in (-1.0, 1.0):
                other = held.configuration(q)
                other.integrate_inplace(sign * STEP * velocity, 1.0)
                sides.append(of(predicted(robot, held.q(other))))
            columns.append((sides[1] - sides[0]) / (2.0 * STEP))
        found = task.compute_jacobian(configuration)
        assert np.abs(found).max() > 0.1
        np.testing.assert_allclose(found, np.stack(columns, axis=-1), atol=2e-4)


def test_what_was_seen_moves_the_cable_and_not_its_jacobian(robot: Robot) -> None:
    held, configuration = held_by(robot), None
    configuration = held.configuration()
    task = task_of(held, cs.PointsTarget(0.5, (0.0, 0.0, 0.0)))
    error, jacobian = task.compute_error(configuration), task.compute_jacobian(configuration)
    held.correction = np.tile((0.01, 0.0, -0.02), (POINTS, 1))
    np.testing.assert_allclose(task.compute_error(configuration), error + np.array((0.01, 0.0, -0.02)), atol=1e-12)
    np.testing.assert_array_equal(task.compute_jacobian(configuration), jacobian)
    held.correction = None
    np.testing.assert_array_equal(task.compute_error(configuration), error)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_centreline_within_reach_is_reached(robot: Robot, seed: int) -> None:
    goal = predicted(robot, around_home(robot, seed, 0.2)).positions[::6]
    servo = cs.Servo(held_by(robot), cs.CentrelineTarget(goal))
    run(servo)
    assert servo.reached
    assert not servo.stalled
    assert servo.binds == ()
    found = predicted(robot, servo.q).positions[::6]
    assert np.linalg.norm(found - goal, axis=1).mean() == pytest.approx(servo.errors[0], abs=3e-4)
    assert servo.errors[0] < 1e-3


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.tuples(*[st.floats(-2.0, 2.0)] * 3), arc_length=st.floats(0.0, 1.0), dt=st.sampled_from((0.004, 0.05)))
def test_limits_are_kept_on_the_way_to_any_target(robot: Robot, place, arc_length, dt) -> None:
    held = held_by(robot)
    servo = cs.Servo(held, cs.PointsTarget(arc_length, place), speed=0.3)
    before = servo.predicted()
    for _ in range(40):
        q = servo.q
        velocity = servo.step(None, dt)
        assert np.isfinite(velocity).all()
        assert (np.abs(velocity) <= robot.velocity_limits * (1.0 + 1e-9) + 1e-6).all()
        assert (velocity[~robot.carrying] == 0.0).all()
        np.testing.assert_allclose(servo.q, q + velocity * dt, atol=1e-12)
        assert (servo.q <= robot.upper).all()
        assert (servo.q >= robot.lower).all()
        after = servo.predicted()
        assert after is not None
        # what moves to first order by so much moves by not much more
        assert np.linalg.norm(after.positions - before.positions, axis=1).max() <= 0.3 * dt * 1.5 + 1e-4
        assert after.status is cs.Status.OK
        before = after


def narrowed(robot: Robot, free: tuple[str, ...], room: float) -> Robot:
    """The same robot, all joints but these kept, and these within so much of home."""
    text = robot.urdf
    for name, home in zip(robot.joint_names, robot.home, strict=True):
        at = text.index(f'<joint name="{name}"')
        limit = re.compile(r'lower="[^"]*" upper="[^"]*"|upper="[^"]*" lower="[^"]*"').search(text, at)
        assert limit is not None
        wide = room if name in free else 1e-7
        text = f'{text[: limit.start()]}lower="{home - wide}" upper="{home + wide}"{text[limit.end() :]}'
    return Robot(text, robot.grippers, dict(zip(robot.joint_names, map(float, robot.home), strict=True)))


def test_a_target_out_of_reach_gives_the_nearest_and_says_what_binds(robot: Robot) -> None:
    """Three joints with little room: the constrained optimum, found by scipy with shapes from nothing."""
    free = ("left_shoulder_lift_joint", "right_elbow_joint", "right_wrist_3_joint")
    small = narrowed(robot, free, 0.15)
    rows = [small.joint_names.index(name) for name in free]
    start = predicted(small, small.home)
    goal = CubicSpline(start.arc_length, start.positions)(0.5) + np.array((0.3, 0.05, 0.1))

    def apart(x: np.ndarray) -> float:
        q = small.home.copy()
        q[rows] = x
        shape = predicted(small, q)
        return float(np.square(CubicSpline(shape.arc_length, shape.positions)(0.5) - goal).sum())

    bounds = list(zip(small.lower[rows], small.upper[rows], strict=True))
    best = minimize(apart, small.home[rows], bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-13})
    servo = cs.Servo(held_by(small), cs.PointsTarget(0.5, goal))
    run(servo)
    assert servo.stalled
    assert not servo.reached
    assert servo.errors[0] == pytest.approx(np.sqrt(best.fun), abs=2e-4)
    assert servo.errors[0] > 0.05
    at_limit = [
        name for name, x, (low, high) in zip(free, best.x, bounds, strict=True) if min(x - low, high - x) < 1e-3
    ]
    assert at_limit
    said = " ".join(servo.binds)
    assert all(name in said for name in at_limit)
    assert "limit" in said


def test_ends_that_cannot_be_so_far_apart_are_told(robot: Robot) -> None:
    held = held_by(robot)
    ends = held.at(held.configuration()).part()[0].positions[[0, -1]]
    out = (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1])
    servo = cs.Servo(held, cs.PointsTarget((0.0, 1.0), ends + 0.5 * np.array((out, -out))))
    run(servo)
    assert servo.stalled
    assert any("taut" in words for words in servo.binds)
    found = predicted(robot, servo.q).positions
    assert np.linalg.norm(found[-1] - found[0]) < 0.981


def test_clearance_is_kept(robot: Robot) -> None:
    ball = cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose((0.42, 0.02, 0.0)))
    scene = cs.Scene(obstacles=[ball])
    held = held_by(robot)
    servo = cs.Servo(held, [cs.PointsTarget(0.5, (0.42, 0.02, 0.0)), cs.KeepClear(scene, minimum=0.02)])
    watch = CableClearanceLimit(held, scene, minimum=0.02)
    least = np.inf
    for _ in range(300):
        servo.step(None, DT)
        bodies, _ = watch.distances(held.configuration(servo.q))
        least = min([least, *(body.distance for body in bodies if body.body == "ball")])
    assert 0.02 - 5e-4 < least < 0.025
    assert servo.stalled
    assert any("ball" in words for words in servo.binds)


def test_a_cable_is_bent_up_to_its_limit_and_no_further(robot: Robot) -> None:
    """Where it stops is the constrained optimum, found by scipy with shapes from nothing."""
    cable = CABLE.replace(min_bend_radius=0.13)
    free = ("left_shoulder_pan_joint", "left_elbow_joint", "right_shoulder_lift_joint", "right_wrist_1_joint")
    small = narrowed(robot, free, 0.6)
    rows = [small.joint_names.index(name) for name in free]
    held = held_by(small, cable)
    middle = held.at(held.configuration()).part()[0].positions[[0, -1]].mean(axis=0)

    def shape_at(x: np.ndarray) -> cs.CableShape:
        q = small.home.copy()
        q[rows] = x
        return predicted(small, q, cable)

    def apart(x: np.ndarray) -> float:
        return float(np.square(shape_at(x).positions[[0, -1]] - middle).sum())

    bounds = list(zip(small.lower[rows], small.upper[rows], strict=True))
    options = {"ftol": 1e-7, "eps": 1e-5}
    # at points of their own, for the least radius of all has a kink where one point takes over from another
    limit = {"type": "ineq", "fun": lambda x: 1.0 - 0.13 / shape_at(x).bend_radius[::6]}
    best = minimize(apart, small.home[rows], bounds=bounds, constraints=[limit], method="SLSQP", options=options)
    assert best.success
    assert shape_at(best.x).bend_radius.min() == pytest.approx(0.13, rel=1e-3)
    servo = cs.Servo(held, cs.PointsTarget((0.0, 1.0), np.tile(middle, (2, 1))))
    run(servo)
    assert servo.stalled
    assert any("BEND_RADIUS" in words for words in servo.binds)
    assert predicted(small, servo.q, cable).bend_radius.min() > 0.13 * 0.998
    assert apart(servo.q[rows]) == pytest.approx(best.fun, rel=5e-3)


def test_loads_count_where_they_are_near_their_limits(robot: Robot) -> None:
    """Rows are differences of the worst places of the cable's pieces; far from every limit there are none."""
    free = held_by(robot)
    shape = free.at(free.configuration()).part()[0]
    pulled, twisted = shape.tension.max(), np.abs(shape.curvature[:, 2]).max()
    assert twisted < 1e-3
    cable = CABLE.replace(max_tension=1.02 * pulled, min_bend_radius=0.98 * shape.bend_radius.min(), max_twist_rate=1.0)
    held = held_by(robot, cable)
    limit, configuration = CableLoadLimit(held, gain=0.5), held.configuration()
    names = [words.split()[0] for _, _, words in limit.near_limit(configuration)]
    assert set(names) == {"TENSION", "BEND_RADIUS"}
    constraint = limit.compute_qp_inequalities(configuration, DT)
    worst = min(h for h, name in zip(constraint.h, names, strict=True) if name == "TENSION")
    assert worst == pytest.approx(0.5 * (1.0 - 1.0 / 1.02), rel=1e-3)
    row = constraint.G[int(np.argmin(constraint.h))]
    which, place, _ = limit.near_limit(configuration)[int(np.argmin(constraint.h))]
    step, used = 5e-4 * row / np.linalg.norm(row), []
    for sign in (1.0, -1.0):
        there = held.configuration()
        there.integrate_inplace(sign * step, 1.0)
        shape = cs.predict(cable, *robot.grips(held.q(there)), model="cosserat", points=POINTS, tolerance=1e-7)
        used.append(limit.loads(shape)[which].used[place])
    assert used[0] - used[1] == pytest.approx(2.0 * row @ step, rel=1e-2)
    assert CableLoadLimit(free).compute_qp_inequalities(configuration, DT).inactive
    with pytest.raises(cs.ArgumentError, match=r"near = 1.5.*at most 1"):
        CableLoadLimit(held, near=1.5)


def test_the_cable_is_not_brought_over_a_snap(robot: Robot) -> None:
    """A wrist winds it up to just before it would jump; what lies beyond is not asked for by a step."""
    name = "right_wrist_2_joint"
    wound = narrowed(robot, (name,), 9.0)
    row = wound.joint_names.index(name)
    alone, q, before = cs.Predictor(CABLE, model="cosserat", points=POINTS), wound.home.copy(), 0.0
    shape = alone.predict(*wound.grips(q))
    while shape.status is cs.Status.OK:
        before = q[row]
        q[row] += 0.01
        shape = alone.predict(*wound.grips(q))
    assert shape.status is cs.Status.SNAPPED
    beyond = shape.positions.copy()

    held = held_by(wound)
    q = wound.home.copy()
    for angle in np.linspace(wound.home[row], before - 0.1, 200):
        q[row] = angle
        assert held.at(held.configuration(q)).part()[0].status is cs.Status.OK
    servo = cs.Servo(held, cs.CentrelineTarget(beyond), q=q)
    for _ in range(300):
        servo.step(None, DT)
        found = servo.predicted()
        assert found is not None
        assert found.status is cs.Status.OK
    assert before - 0.005 < servo.q[row] < before + 0.01
    assert servo.stalled
    assert "snap" in servo.binds[0]


@pytest.mark.parametrize("below", [-0.04, 0.03])
def test_the_cable_goes_into_a_mouth_from_outside(robot: Robot, below: float) -> None:
    """Above the clip it comes down in line; from beside and below it goes up first, and then across."""
    held = held_by(robot)
    here = held.at(held.configuration()).part()[0].positions[50]
    clip = cs.Clip(0.5, cs.Pose(here + np.array((0.04, 0.02, below)), (0.70710678, 0.0, 0.0, 0.70710678)))
    target = cs.MouthTarget.of(clip, outward=(0.0, 0.0, 1.0))
    np.testing.assert_allclose(target.tangent, (0.0, -1.0, 0.0), atol=1e-7)
    servo = cs.Servo(held, target)
    asides, depths = [], []
    for _ in range(500):
        servo.step(None, DT)
        shape = servo.predicted()
        assert shape is not None
        apart = shape.positions[50] - clip.pose.position
        asides.append(np.linalg.norm(apart[:2]))
        depths.append(apart[2])
        if servo.reached:
            break
    assert servo.reached
    aside, depth = np.array(asides), np.array(depths)
    near = aside < 0.03
    assert (depth[near] > np.minimum(0.9 * target.approach, aside[near]) - 3e-3).all()  # as far in as it is in line
    found = predicted(robot, servo.q)
    assert np.linalg.norm(CubicSpline(found.arc_length, found.positions)(0.5) - clip.pose.position) < 2.1e-3
    assert np.arccos(CubicSpline(found.arc_length, found.tangents)(0.5) @ target.tangent) < 0.1


@pytest.mark.parametrize("seed", [0, 1])
def test_seen_the_wrong_cable_comes_to_its_target_and_unseen_it_does_not(robot: Robot, seed: int) -> None:
    cell, held = Cell(robot, Wrong(), seed), held_by(robot)
    goal = cell.goal()
    off = {}
    for closed in (True, False):
        cell.begin(robot.home)
        servo = cs.Servo(held, cs.CentrelineTarget(goal), delay=cell.wrong.delay)
        for _ in range(400):
            servo.step(cell.seen() if closed else None, DT)
            cell.move(servo.q)
        off[closed] = np.linalg.norm(cell.positions - goal, axis=1).mean()
    assert off[True] < 1e-3
    assert off[False] > 5e-3


def test_a_cable_that_swings_comes_to_rest_at_its_target(robot: Robot) -> None:
    """MuJoCo's, soft and slack: with less settling its swing is kept up by the arms."""
    cell, held = Cell(robot, Wrong(), 5, mujoco=True), held_by(robot)
    servo = cs.Servo(held, cs.CentrelineTarget(cell.goal()), delay=cell.wrong.delay)
    for _ in range(360):
        servo.step(cell.seen(), DT)
        cell.move(servo.q)
    assert np.linalg.norm(cell.positions - servo.targets[0].positions, axis=1).mean() < 2e-3


@pytest.mark.parametrize("told", [0.075, 0.03, 0.0])
def test_what_is_seen_is_compared_with_what_was_predicted_then(told: float) -> None:
    """A cable that moves at 0.2 m/s, seen 5 cm aside and 75 ms late: exact where that is told."""
    rows = np.linspace(0.0, 1.0, 51)
    line = np.stack((rows, 0.1 * np.sin(3.0 * rows), np.zeros(51)), axis=1)
    speed, aside = np.array((0.0, 0.0, 0.2)), np.array((0.05, 0.0, 0.0))
    seen = Seen(51, told, 0.1)
    for k in range(100):
        time = k * DT
        seen.predict(time, line + time * speed)
        late = cs.CableShape.of_points((line + (time - 0.075) * speed + aside)[::2], 1.0)
        seen.take(time, late, DT)
    off = seen.correction - aside
    np.testing.assert_allclose(off, np.tile((told - 0.075) * speed, (51, 1)), atol=2e-4)
    assert seen.lag == pytest.approx(told + 0.2)
    seen.reset()
    assert seen.correction is None
    assert seen.lag == 0.0


def test_a_delay_that_is_not_told_is_survived(robot: Robot) -> None:
    cell, held = Cell(robot, Wrong(delay=0.1), 0), held_by(robot)
    goal = cell.goal()
    servo = cs.Servo(held, cs.CentrelineTarget(goal))
    for _ in range(500):
        servo.step(cell.seen(), DT)
        cell.move(servo.q)
    assert np.linalg.norm(cell.positions - goal, axis=1).mean() < 1e-3


def test_seen_a_target_out_of_reach_stalls_at_the_nearest(robot: Robot) -> None:
    """Noise does not keep it going: the real cable comes as near as that of a right model does unseen."""
    cell = Cell(robot, Wrong(stiffness=1.0, length=1.0, grips=0.0), 0)
    places = ((0.4, 0.8, 0.2), (0.4, -0.8, 0.2))
    unseen, seen = (cs.Servo(held_by(robot), cs.PointsTarget((0.0, 1.0), places), delay=delay) for delay in (0.0, 0.05))
    run(unseen)
    for _ in range(500):
        seen.step(cell.seen(), DT)
        cell.move(seen.q)
    assert unseen.stalled
    assert seen.stalled
    off = np.linalg.norm(cell.positions[[0, -1]] - places, axis=1).mean()
    assert off == pytest.approx(unseen.errors[0], abs=3e-3)
    assert any("taut" in words for words in seen.binds)


def test_a_robot_that_lags_is_told_where_it_is(robot: Robot) -> None:
    """Its velocities follow with 0.1 s; set to what is measured, the servo goes on from there."""
    cell, held = Cell(robot, Wrong(), 3), held_by(robot)
    servo = cs.Servo(held, cs.CentrelineTarget(cell.goal()), delay=cell.wrong.delay)
    q, velocity = robot.home.copy(), np.zeros(len(robot.home))
    for _ in range(600):
        servo.q = q
        velocity += (1.0 - np.exp(-DT / 0.1)) * (servo.step(cell.seen(), DT) - velocity)
        q = q + DT * velocity
        cell.move(q)
    goal = servo.targets[0].positions
    assert np.linalg.norm(cell.positions - goal, axis=1).mean() < 1e-3


def test_what_is_not_usable_counts_for_nothing(robot: Robot) -> None:
    held = held_by(robot)
    servo = cs.Servo(held, cs.PointsTarget(0.5, (0.4, 0.0, 0.2)))
    lost = cs.CableShape.of_points(np.zeros((20, 3)), 1.0)
    lost.positions[:] = np.nan
    lost.status = cs.Status.NOT_CONVERGED
    here = held.at(held.configuration()).part()[0]
    np.testing.assert_array_equal(servo.step(lost, DT), cs.Servo(held, servo.targets).step(None, DT))
    assert held.correction is None
    servo.q = robot.home
    servo.step(cs.CableShape.of_points(here.positions + np.array((0.0, 0.0, 0.01)), 1.0), DT)
    servo.step(lost, DT)
    np.testing.assert_allclose(held.correction, np.tile((0.0, 0.0, 0.01), (POINTS, 1)), atol=1e-9)
    servo.reset()
    assert held.correction is None


def test_a_cable_without_a_shape_stands_still_and_says_so(robot: Robot) -> None:
    held = held_by(robot, CABLE.replace(length=0.5))
    servo = cs.Servo(held, cs.PointsTarget(0.25, (0.4, 0.0, 0.2)))
    assert (servo.step(None, DT) == 0.0).all()
    assert "OVERSTRETCHED" in servo.binds[0]
    assert servo.predicted() is None
    assert not servo.reached


def test_targets_may_be_set_on_the_way(robot: Robot) -> None:
    servo = cs.Servo(held_by(robot), cs.PointsTarget(0.5, (0.42, -0.03, 0.2)))
    run(servo)
    assert servo.reached
    servo.targets = [cs.PointsTarget(0.5, (0.42, 0.0, 0.18)), cs.TangentTarget(0.5, (0.1, -1.0, 0.0))]
    assert not servo.reached
    run(servo)
    assert servo.reached
    assert len(servo.errors) == 2


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda held: cs.PointsTarget(-0.1, (0, 0, 0)), r"arc_length = -0.1 .*at least 0 m.*start grip"),
        (lambda held: cs.PointsTarget(np.nan, (0, 0, 0)), r"arc_length = \[nan\].*finite"),
        (lambda held: cs.PointsTarget((0.1, 0.2), (0, 0, 0)), r"positions = .*shape \(3,\).*\(2, 3\).*x, y, z"),
        (lambda held: cs.PointsTarget(0.1, (0, np.inf, 0)), r"positions\[0\] = \[0.0, inf, 0.0\].*finite"),
        (lambda held: cs.PointsTarget(0.1, (0, 0, 0), weight=0.0), r"weight = 0.*above 0"),
        (lambda held: cs.PointsTarget(0.1, (0, 0, 0), tolerance=np.nan), r"tolerance = nan.*finite"),
        (lambda held: cs.CentrelineTarget(((0, 0, 0),)), r"shape \(1, 3\).*n at least 2"),
        (lambda held: cs.TangentTarget(0.1, (0, 0, 0)), r"direction = .*above 0.*direction in the world"),
        (lambda held: cs.MouthTarget(0.1, cs.Pose(), (0, 0, 1)), r"outward = .*along the cable's tangent"),
        (lambda held: cs.MouthTarget(0.1, cs.Pose(), (1, 0, 0), approach=-1), r"approach = -1.*at least 0 m"),
        (lambda held: cs.MouthTarget.of(cs.Pose()), r"clip = .*it must be a Clip"),
        (lambda held: cs.KeepClear(cs.Pose()), r"scene = .*it must be a Scene"),
        (lambda held: cs.Servo(held, []), r"targets = \[\].*nothing is to be reached"),
        (lambda held: cs.Servo(held, [cs.KeepClear(cs.Scene())]), "nothing is to be reached"),
        (lambda held: cs.Servo(held, ["up"]), r"targets\[0\] = 'up'.*PointsTarget"),
        (lambda held: cs.Servo(held, cs.PointsTarget(1.2, (0, 0, 0))), r"arc_length = 1.2.*at most .* 1 m"),
        (lambda held: cs.Servo(None, cs.PointsTarget(1.2, (0, 0, 0))), r"held = None.*HeldCable"),
        (lambda held: cs.Servo(held, cs.PointsTarget(0.5, (0, 0, 0)), [1]), r"limits\[0\] = 1.*Limit"),
        (lambda held: cs.Servo(held, cs.PointsTarget(0.5, (0, 0, 0)), rate=0.0), r"rate = 0.*above 0 1/s"),
        (lambda held: cs.Servo(held, cs.PointsTarget(0.5, (0, 0, 0)), delay=-0.1), r"delay = -0.1.*at least 0 s"),
        (lambda held: cs.Servo(held, cs.PointsTarget(0.5, (0, 0, 0)), q=(0.0,)), r"q = .*shape \(14,\)"),
    ],
)
def test_arguments_that_are_refused(robot: Robot, make, said: str) -> None:
    with pytest.raises(cs.ArgumentError, match=said):
        make(held_by(robot))


def test_steps_that_are_refused(robot: Robot) -> None:
    servo = cs.Servo(held_by(robot), cs.PointsTarget(0.5, (0.4, 0.0, 0.2)))
    for dt in (0.0, -0.01, np.nan, 2.0):
        with pytest.raises(cs.ArgumentError, match=r"dt = .* s"):
            servo.step(None, dt)
    with pytest.raises(cs.ArgumentError, match=r"shape = .*CableShape.*None"):
        servo.step(np.zeros((5, 3)), DT)  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError, match=r"positions = .*\(n, 3\).*interpolate"):
        cs.CableShape.of_points(np.zeros(6), 1.0)
    bad = cs.CableShape.of_points(np.zeros((5, 3)), 1.0)
    bad.positions[2] = np.nan
    with pytest.raises(cs.ArgumentError, match=r"shape.positions = .*finite"):
        servo.step(bad, DT)
    with pytest.raises(cs.ArgumentError, match=r"correction = .*\(101, 3\)"):
        servo.held.correction = np.zeros((4, 3))
    assert isinstance(task_of(servo.held, cs.MouthTarget(0.5, cs.Pose(), (1, 0, 0))), MouthTask)
    slow = mink.VelocityLimit(servo.held.model, dict.fromkeys(robot.joint_names, 0.01))
    limited = cs.Servo(held_by(robot), cs.PointsTarget(0.5, (0.4, 0.0, 0.2)), [slow])
    assert np.abs(limited.step(None, DT)).max() == pytest.approx(0.01, rel=1e-3)
