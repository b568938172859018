"""The Cosserat predictor is of sixth order: on meshes laid out here, not on those that a tolerance asks for."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from references import label, named
from rods import ALONG_X, CABLE, END, LENGTH, START, on_mesh, rod_equations
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from cable_shape.cable.cable import Cable
from cable_shape.command.reference_case import reference_case
from cable_shape.pose import FreeEnd, Pose
from cable_shape.scene.scene import PointMass, Scene
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

MESHES = (16, 32, 64)
#: [m], below this rounding and the references' own digits count.
FLOOR = 1e-11


def orders(problem: Problem, exact: np.ndarray) -> np.ndarray:
    """log2 of how the mean error at equal arc length falls from one mesh to the next, above the floor."""
    state = Network(problem)
    assert cosserat.solve(problem, state).status
    errors = np.array(
        [np.linalg.norm(on_mesh(state, [n + 2 * state.stops.size]).positions - exact, axis=1).mean() for n in MESHES]
    )
    found = np.log2(errors[:-1] / errors[1:])[errors[1:] > FLOOR]
    assert found.size, "nothing to see above the floor"
    return found


def shot(problem: Problem) -> np.ndarray:
    """The same shape by shooting: the rod's equations from s = 0 (DOP853, 1e-12), the wrench there by root finding."""
    cable, start, end = problem.cable, problem.start.cable_frame, problem.end
    R0 = Rotation.from_quat(start.quaternion).as_matrix()
    slopes = rod_equations(cable, cable.linear_density * problem.gravity)

    def sweep(wrench, points=2):
        first = np.concatenate((start.position, R0.ravel(), wrench))
        s = np.linspace(0.0, cable.length, points)
        return solve_ivp(slopes, s[[0, -1]], first, method="DOP853", t_eval=s, rtol=1e-12, atol=1e-13).y

    def miss(wrench):
        y = sweep(wrench)[:, -1]
        if isinstance(end, FreeEnd):
            return np.concatenate((y[12:15] - end.force - end.mass * problem.gravity, y[15:] - end.moment))
        turn = Rotation.from_quat(end.cable_frame.quaternion).inv() * Rotation.from_matrix(y[3:12].reshape(3, 3))
        return np.concatenate((y[:3] - end.cable_frame.position, turn.as_rotvec()))

    guess = cosserat.solve(Problem(cable, gravity=problem.gravity, tolerance=1e-7).move(problem.start, end))
    found = root(miss, np.concatenate((guess.force[0], guess.moment[0])), tol=1e-12)
    assert np.abs(found.fun).max() < 1e-9, found.message
    return sweep(found.x, problem.points)[:3].T


#: Everything at once: anisotropic, stretching, shearing, curved at rest.
GENERAL = CABLE.replace(
    bending_stiffness=(0.03, 0.06), twisting_stiffness=0.04, axial_stiffness=30.0, shear_stiffness=20.0,
    rest_curvature=(0.5, -0.3, 0.8),
)  # fmt: skip


@pytest.mark.parametrize(
    ("cable", "end"),
    [
        (GENERAL, END),
        (GENERAL, FreeEnd(mass=0.02, force=(0.05, 0.1, 0.0))),
        (CABLE.replace(bending_stiffness=0.2, twisting_stiffness=0.1), Pose((0.9, 0.1, 0.2), ALONG_X, turns=1)),
    ],
    ids=["grasp", "free end", "one turn"],
)
def test_sixth_order_against_shooting(cable, end):
    problem = Problem(cable, points=25).move(START, end)
    found = orders(problem, shot(problem))
    assert (found > 5.4).all(), found
    assert (found < 7.6).all(), found


def test_sixth_order_against_a_circle():
    """A dead end moment M bends the weightless cable into an arc of curvature M / EI, here a full turn."""
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=2.0)
    s = np.linspace(0.0, 1.0, 25)
    exact = np.stack((np.sin(2 * np.pi * s), 0 * s, 1.0 - np.cos(2 * np.pi * s)), axis=1) / (2 * np.pi)
    problem = Problem(cable, points=25).move(START, FreeEnd(moment=(0, -4 * math.pi, 0)))
    assert orders(problem, exact) == pytest.approx(6.0, abs=0.3)


def test_sixth_order_against_finer_meshes_of_a_cable_with_a_mass():
    """The mass makes a node, so that meshes are not each other's halves and the order shows less evenly."""
    problem = Problem(CABLE, points=25, scene=Scene(masses=(PointMass(0.45, 0.05),))).move(START, END)
    state = Network(problem)
    cosserat.solve(problem, state)
    found = orders(problem, on_mesh(state, [562]).positions)
    assert (found > 5.0).all(), found
    assert (found < 7.6).all(), found


REFERENCES = named(
    "references/grasp_1", "references/grasp_taut", "references/grasp_twisted", "references/coil_1",
    "references/rubber_shear", "references/free_pulled",
    "public/grasp_02", "public/grasp_rotated_03", "public/grasp_taut_01", "public/grasp_twisted_05",
    "public/no_gravity_05", "public/rest_curvature_06", "public/free_end_08",
    "published/bend45_shear_GA5e6_P600", "published/cantilever_end_load_PL2_EI_10", "published/helix_clamped_c",
    "published/localised_buckling_mu_0.7",
)  # fmt: skip


@pytest.mark.parametrize("path", REFERENCES, ids=label)
def test_sixth_order_against_reference_shapes(path):
    """References of 1e-12 or better."""
    values = json.loads(path.read_text())
    case = reference_case(values)
    exact = np.array(values["solution"]["r"])
    problem = Problem(case.cable, points=len(exact), gravity=values["gravity"], scene=case.scene)
    found = orders(problem.move(case.start, case.end), exact)
    assert (found > 5.4).all(), found
    assert (found < 7.6).all(), found


def test_the_error_on_a_given_mesh_is_the_one_estimated():
    """By solving on a mesh and on one eight times finer, at meshes from coarse to fine."""
    problem = Problem(CABLE).move(START, END)
    state = Network(problem)
    cosserat.solve(problem, state)
    exact = on_mesh(state, [512]).positions
    for elements in (16, 32, 64):
        error = np.linalg.norm(on_mesh(state, [elements]).positions - exact, axis=1).max()
        assert error <= state.info[7] <= 10.0 * error, elements
    assert error < 1e-6 * LENGTH
