"""How far a closed form is said to be from the Cosserat rod."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.models.judge import SAFETY, Judge
from cable_shape.models.rod_state import RodState
from cable_shape.problem import Problem

LENGTH = 1.2
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))  # d1 = y, d2 = z, d3 = x
START = cs.Pose((0.0, 0.0, 0.0), ALONG_X.as_quat())
TOLERANCE = 1e-3 * LENGTH


def cable(stiffness: float, **keywords) -> cs.Cable:
    return cs.Cable(LENGTH, 0.1, stiffness, twisting_stiffness=0.8 * np.mean(stiffness), **keywords)


def level(chord: float, roll: float = 1e-3, turns: int = 0) -> cs.Pose:
    """An end at this fraction of the length, level and along the chord; in one plane with START if not rolled."""
    turned = ALONG_X * Rotation.from_rotvec((0.0, 0.0, roll))
    return cs.Pose((chord * LENGTH, 0.0, 0.0), turned.as_quat(), turns)


def apart(a: cs.CableShape, b: cs.CableShape) -> float:
    return float(np.linalg.norm(a.positions - b.positions, axis=1).max())


def exact(cable: cs.Cable, start, end, **keywords) -> cs.CableShape:
    shape = cs.predict(cable, start, end, model="cosserat", tolerance=1e-7 * LENGTH, **keywords)
    assert shape.status is cs.Status.OK
    return shape


def judged(problem: Problem, shape: cs.CableShape) -> float:
    return Judge().estimate(problem, shape, RodState(problem), None) / SAFETY


def test_the_judge_gives_the_distance_to_the_rod_of_shapes_that_are_far_from_it_too() -> None:
    """Independent: the rod itself, solved for to 1e-7 of the length."""
    for stiffness, chord, model in ((1e-4, 0.97, "catenary"), (1e-3, 0.97, "gradient4"), (1e-5, 0.93, "gradient4")):
        rope, end = cable(stiffness), level(chord)
        shape = cs.predict(rope, START, end, model=model)
        error = apart(shape, exact(rope, START, end))
        assert error > 2e-4 * LENGTH
        found = judged(Problem(rope, tolerance=TOLERANCE).move(START, end), shape)
        assert error <= SAFETY * found <= 1.6 * error, (stiffness, chord, model)


def test_the_judge_finds_no_fault_with_the_rods_own_shape() -> None:
    rope, end = cable(1e-3), level(0.9)
    shape = exact(rope, START, end)
    assert judged(Problem(rope, tolerance=TOLERANCE).move(START, end), shape) < 1e-4 * LENGTH


def test_the_judge_sees_all_that_closed_forms_leave_out() -> None:
    """Loads that a straight, round, untwisted cable does not have move the rod away from the closed form."""
    rope, end = cable(1e-4), level(0.98)
    shape = cs.predict(rope, START, end, model="gradient4")
    plain = judged(Problem(rope, tolerance=TOLERANCE).move(START, end), shape)
    for other, there in (
        (rope.replace(rest_curvature=(0.0, 3.0, 0.0)), end),
        (rope.replace(bending_stiffness=(1e-4, 1e-3)), end),
        (rope.replace(axial_stiffness=50.0), end),
        (rope, level(0.98, roll=3.0)),
    ):
        problem = Problem(other, tolerance=TOLERANCE).move(START, there)
        found = judged(problem, shape)
        error = apart(shape, exact(other, START, there))
        assert found > 1.05 * plain
        assert error <= SAFETY * found <= 1.6 * error


def test_no_stable_rod_beside_a_shape_is_an_infinite_distance() -> None:
    """A rod pressed straight beyond Euler's load, 4 pi^2 EI / L^2 between clamps: an equilibrium, not a stable one."""
    rope = cable(1e-3, axial_stiffness=100.0).replace(linear_density=0.0)
    euler = 4.0 * np.pi**2 * 1e-3 / LENGTH**2
    for load, stable in ((0.8 * euler, True), (1.3 * euler, False)):
        problem = Problem(rope, tolerance=TOLERANCE, points=101).move(START, level(1.0 - load / 100.0))
        shape = cs.predict(rope, START, level(1.0), model="gradient4", points=101)
        shape.positions[:, 0] *= 1.0 - load / 100.0
        shape.positions[:, 1] += 1e-4 * LENGTH * np.sin(np.pi * shape.arc_length / LENGTH) ** 2
        shape.force[:] = (-load, 0.0, 0.0)
        assert judged(problem, shape) == pytest.approx(1e-4 * LENGTH if stable else np.inf, rel=0.05)
