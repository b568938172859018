"""How shapes answer the numbers of their cable: against central differences of shapes solved for anew."""

from __future__ import annotations

import numpy as np
import pytest
from rods import CABLE, END, START, moved, solved

import cable_shape as cs
from cable_shape.calibration.answers import Answers
from cable_shape.calibration.parameters import Parameters
from cable_shape.kernels.network import respond
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ELASTIC = CABLE.replace(axial_stiffness=40.0, shear_stiffness=25.0, rest_curvature=(1.0, -0.5, 0.3))
WAVY = CABLE.replace(rest_curvature=[(1.0, 0.0, 0.5), (-2.0, 1.0, 0.0), (0.5, 0.5, -1.0)])
MASSES = cs.Scene(masses=[cs.PointMass(0.31, 0.03), cs.PointMass(0.91, 0.02)])
SWING = np.array(((0.0, 0.0, 0.0), (3.0, 0.0, 1.0), (0.0, -2.0, 0.0), (1.0, 1.0, 1.0)))
ENDS = {
    "clamped": (START, END),
    "swivel": (cs.Grip(START, kind="swivel"), END),
    "pinned": (START, cs.Grip(END, kind="pinned")),
    "free": (START, cs.FreeEnd(mass=0.02, force=(0.1, 0.0, 0.05), moment=(0.0, 0.01, 0.0))),
}
FIT = ("bending_stiffness", "twisting_stiffness", "length")


def assert_differences(cable: cs.Cable, fit: tuple[str, ...], ends, share: float = 1e-4, **options) -> None:
    """Each derivative is that of shapes with a step up and a step down, to a share of the largest."""
    options = {"points": 61, "tolerance": 1e-9 * cable.length, **options}
    parameters = Parameters(cable, fit)
    middle = parameters.start
    state = Network(Problem(parameters.make_cable(middle), **options))
    shape = cosserat.solve(state.problem.move(*ends), state)
    assert shape.status is cs.Status.OK
    found = Answers(parameters, middle).moves(state, state.problem.start, state.problem.end)
    for j, parameter in enumerate(parameters.each):
        step = np.zeros_like(middle)
        step[j] = 0.1 * parameter.step
        above, below = (
            solved(parameters.make_cable(middle + sign * step), *ends, **options).positions for sign in (1.0, -1.0)
        )
        wanted = (above - below) / (2.0 * step[j])
        size = max(np.abs(wanted).max(), 1e-3)
        np.testing.assert_allclose(found[:, :, j], wanted, rtol=0.0, atol=share * size, err_msg=parameter.name)


@pytest.mark.parametrize("kind", ENDS)
def test_answers_are_central_differences(kind: str) -> None:
    assert_differences(CABLE, FIT, ENDS[kind])


@pytest.mark.parametrize("kind", ENDS)
def test_of_a_cable_that_stretches_and_is_bent_at_rest(kind: str) -> None:
    assert_differences(ELASTIC, (*FIT, "axial_stiffness", "rest_curvature"), ENDS[kind])


def test_of_a_rest_curvature_along_the_cable() -> None:
    assert_differences(WAVY, ("length", "rest_curvature_along"), ENDS["clamped"])


@pytest.mark.parametrize("kind", ["clamped", "free"])
def test_masses_keep_their_place_on_a_longer_cable(kind: str) -> None:
    load = ((0.1, 0.0, 0.0), (0.0, 0.2, 0.0))
    assert_differences(ELASTIC, FIT, ENDS[kind], scene=MASSES, distributed_load=load)


@pytest.mark.parametrize("kind", ["ball", "fixed", "hinge", "slide"])
def test_in_clips(kind: str) -> None:
    shape = cs.predict(WAVY, START, END, points=61)
    there = moved(cs.Pose(shape.positions[25], shape.quaternions[25]), (0.01, 0.02, 0.02), (0.1, 0.1, 0.0))
    scene = cs.Scene(clips=[cs.Clip(0.5, there, kind)], masses=[cs.PointMass(0.9, 0.02)])
    assert_differences(WAVY, (*FIT, "rest_curvature_along"), ENDS["clamped"], scene=scene)


def test_of_a_cable_that_swings() -> None:
    assert_differences(CABLE, FIT, ENDS["clamped"], acceleration=SWING)


def test_a_dead_moment_counts_in_the_answer_to_the_start() -> None:
    options = {"points": 61, "tolerance": 1e-9 * CABLE.length}
    end = ENDS["free"][1]
    state = Network(Problem(ELASTIC, **options))
    cosserat.solve(state.problem.move(START, end), state)
    found = cosserat.sensitivity(state)[:, :, 3:6]
    for axis in range(3):
        turn = np.zeros(3)
        turn[axis] = 1e-4
        above, below = (
            solved(ELASTIC, moved(START, turn=sign * turn), end, **options).positions for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(found[:, :, axis], (above - below) / 2e-4, rtol=0.0, atol=1e-5)
    twists, places = np.zeros((2, 6)), np.linspace(0.0, CABLE.length, 61)
    twists[0, 3:] = 0.3, -0.5, 0.7
    state.refresh()
    network, out = (state.ints, state.floats, state.sols, state.work), np.empty((61, 3))
    respond.still(state.ints, state.work)
    respond.move_knots(*network, twists)
    respond.answer(*network, twists)
    respond.velocities(*network, places, out)
    np.testing.assert_allclose(out, found @ twists[0, 3:], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("turn", [1e-5, 2e-4, 1e-2])
def test_a_dead_moment_is_solved_for_as_exactly_from_the_last_shape_as_from_nothing(turn: float) -> None:
    tolerance = 1e-9 * CABLE.length
    predictor = cs.Predictor(CABLE, points=61, tolerance=tolerance)
    end = ENDS["free"][1]
    cold = predictor.predict(START, end).positions
    predictor.predict(moved(START, turn=(0.0, 0.0, turn)), end)
    again = predictor.predict(START, end)
    assert again.status is cs.Status.OK
    np.testing.assert_allclose(again.positions, cold, rtol=0.0, atol=2.0 * tolerance)


def test_a_mass_at_a_kink_of_the_rest_curvature_is_one_node_with_it() -> None:
    table = [(1.0, 0.0, 0.5), (-0.5, 0.5, 0.25), (-2.0, 1.0, 0.0), (-0.7, 0.8, -0.5), (0.5, 0.5, -1.0)]
    wavy = CABLE.replace(rest_curvature=table)  # its last kink is at 0.9 m but for rounding
    assert not (np.linspace(0.0, CABLE.length, 5) == 0.9).any()
    state = Network(Problem(wavy, tolerance=1e-9 * CABLE.length, scene=cs.Scene(masses=[cs.PointMass(0.9, 0.02)])))
    shape = cosserat.solve(state.problem.move(START, END), state)
    assert shape.status is cs.Status.OK
    assert np.diff(state.nodes).min() > 1e-4
