"""Steering a harness through mink: Jacobians of points, distances and the chord, and that a branch goes where asked."""

from __future__ import annotations

from pathlib import Path

import mink
import numpy as np
import pytest

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import CableChordLimit, CableClearanceLimit, CablePointTask, HeldCable

ROOT = Path(__file__).resolve().parents[2]
DUAL_ARM = ROOT / "config/robots/dual_arm.yaml"
CABLE = cs.Cable(length=0.5, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
ASIDE = cs.Pose(quaternion=(0.479426, 0.0, 0.0, 0.877583))
GRIPS = ("a.start", "b.end")
STEP = 1e-4  # rad, of the differences


def harness() -> cs.Harness:
    fork = cs.Junction("fork", ("a.end", "b.start", "c.start"), frames={"c.start": ASIDE})
    return cs.Harness({"a": CABLE, "b": CABLE, "c": CABLE.replace(length=0.2)}, [fork])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(DUAL_ARM)


def held_by(robot: Robot, grips: tuple[str, ...] = GRIPS, **ends: object) -> HeldCable:
    return HeldCable(cs.Predictor(harness(), tolerance=1e-7, points=301), robot, grips=grips, **ends)  # type: ignore[arg-type]


def differences(held: HeldCable, of: object) -> np.ndarray:
    """(m, nv), central differences of a function of mink's configuration at home."""
    columns = []
    for velocity in np.eye(held.model.nv):
        sides = []
        for sign in (-1.0, 1.0):
            configuration = held.configuration()
            configuration.integrate_inplace(sign * STEP * velocity, 1.0)
            sides.append(np.atleast_1d(of(configuration)))  # type: ignore[operator]
        columns.append((sides[1] - sides[0]) / (2.0 * STEP))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize(("segment", "arc_length"), [("a", 0.2), ("b", 0.41), ("c", 0.2)])
@pytest.mark.parametrize("grips", [GRIPS, GRIPS[::-1]])
def test_the_jacobian_of_a_point_is_that_of_differences(robot: Robot, segment, arc_length, grips) -> None:
    held = held_by(robot, grips)
    task = CablePointTask(held, arc_length, segment=segment)
    task.set_target((0.1, 0.2, 0.3))
    jacobian = task.compute_jacobian(held.configuration())
    wanted = differences(held, task.compute_error)
    assert np.abs(wanted).max() > 0.05
    np.testing.assert_allclose(jacobian, wanted, atol=5e-5)


def test_distances_and_the_chord_are_those_of_differences(robot: Robot) -> None:
    held = held_by(robot)
    ball = cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose((0.42, 0.02, -0.2)))
    limit = CableClearanceLimit(held, cs.Scene(obstacles=[ball]), minimum=0.02, horizon=1.0)
    bodies, jacobian = limit.distances(held.configuration())
    rows = [i for i, body in enumerate(bodies) if body.body == "ball"]
    assert len(rows) == 3  # of each segment

    def distances(configuration: mink.Configuration) -> np.ndarray:
        return np.array([body.distance for body in limit.distances(configuration)[0] if body.body == "ball"])

    np.testing.assert_allclose(jacobian[rows], differences(held, distances), atol=3e-3)
    chord = CableChordLimit(held, most=0.9, gain=0.5)
    constraint = chord.compute_qp_inequalities(held.configuration(), 0.01)
    start, end = (grip.cable_frame.position for grip in robot.grips(robot.home))
    assert constraint.h == pytest.approx([0.5 * (0.9 - np.linalg.norm(end - start))])
    assert constraint.G.shape == (1, held.model.nv)


def test_the_end_of_a_branch_is_brought_to_its_place(robot: Robot) -> None:
    held = held_by(robot)
    task = CablePointTask(held, 0.2, segment="c", lm_damping=1e-2)
    configuration = held.configuration()
    task.set_target_from_configuration(configuration)
    task.set_target(task.target + np.array((0.04, 0.02, 0.05)))
    posture = mink.PostureTask(held.model, cost=1e-4)
    posture.set_target_from_configuration(configuration)
    limits = [
        mink.ConfigurationLimit(held.model),
        mink.VelocityLimit(held.model, dict.fromkeys(robot.single_joints, 0.05)),
        CableChordLimit(held),
    ]
    for _ in range(60):
        velocity = mink.solve_ik(configuration, [task, posture], 1.0, solver="daqp", limits=limits)
        configuration.integrate_inplace(velocity, 1.0)
    assert np.linalg.norm(task.compute_error(configuration)) < 1e-3
    assert held.at(configuration).part("c")[0].status is cs.Status.OK


def test_other_ends_are_held_as_told_and_wrong_ones_are_refused(robot: Robot) -> None:
    free = held_by(robot)
    tip = free.at(free.configuration()).part("c")[0].positions[-1]
    place = cs.Grip(cs.Pose(tip + np.array((0.02, 0.0, 0.03))), "pinned")
    held = held_by(robot, ends={"c.end": place})
    found = held.at(held.configuration())
    np.testing.assert_allclose(found.part("c")[0].positions[-1], place.pose.position, atol=1e-9)
    assert np.abs(found.part("c")[1][-1]).max() < 1e-9
    for arguments, said in (
        ({"grips": ("a.start",)}, r"grips = \['a.start'\] .* 2 grippers"),
        ({"grips": ("a.start", "a.end")}, "junction 'fork'"),
        ({"grips": GRIPS, "ends": {"d.end": place}}, "there is no such end"),
    ):
        with pytest.raises(cs.ArgumentError, match=said):
            held_by(robot, **arguments)  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError, match="Leave grips and ends out"):
        HeldCable(cs.Predictor(CABLE), robot, grips=GRIPS)
    with pytest.raises(cs.ArgumentError, match=r"segment = 'd' .* segments a, b, c"):
        CablePointTask(free, 0.1, segment="d")


def test_the_shortest_way_between_ends_goes_along_segments() -> None:
    loop = harness()
    assert loop.way("a.start", "b.end") == pytest.approx(1.0)
    assert loop.way("c.end", "a.end") == pytest.approx(0.2)
    apart = cs.Harness({"a": CABLE, "b": CABLE})
    assert apart.way("a.start", "b.end") == np.inf
