"""The Cosserat predictor: accuracy, reference and closed-form shapes, and what holds the ends."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from references import label, named, references
from rods import ALONG_X, CABLE, END, LENGTH, START, integrated_residual, solved
from scipy.spatial.transform import Rotation

from cable_shape.cable.cable import Cable
from cable_shape.command.reference_case import reference_case
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.scene import PointMass, Scene
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem


def test_its_points_satisfy_the_rod_equations_integrated_independently():
    cable = CABLE.replace(
        bending_stiffness=(0.01, 0.02), axial_stiffness=30.0, shear_stiffness=20.0, rest_curvature=(0.5, -0.3, 0.8)
    )
    shape = solved(cable, START, END, points=41, tolerance=1e-8 * LENGTH)
    assert shape.status is Status.OK
    assert integrated_residual(cable, shape, np.array((0, 0, -0.981))) < 3e-6
    coarse = solved(cable, START, END, points=41)
    assert integrated_residual(cable, coarse, np.array((0, 0, -0.981))) < 2e-3


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_the_true_error_is_below_the_estimate_and_not_far_below(tolerance):
    exact = solved(CABLE, START, END, tolerance=1e-10 * LENGTH)
    shape = solved(CABLE, START, END, tolerance=tolerance * LENGTH)
    error = np.linalg.norm(shape.positions - exact.positions, axis=1).max()
    assert error <= shape.error_estimate <= min(10.0 * error, tolerance * LENGTH)


# -- references

#: These have several stable shapes; from nothing another one is found, and the reference's along a path only.
OTHER_BRANCH = ("no_gravity_06", "rest_curvature_04")
ELSEWHERE = ("arch_load_", "catenary_")  # tests of their own
SHAPES = [path for path in references("*") if not path.stem.startswith((*OTHER_BRANCH, *ELSEWHERE))]


@pytest.mark.parametrize("path", SHAPES, ids=label)
def test_reference_grasp(path):
    values = json.loads(path.read_text())
    case, answer = reference_case(values), values["solution"]
    shape = solved(
        case.cable, case.start, case.end, points=len(answer["s"]), scene=case.scene, gravity=values["gravity"]
    )
    length = case.cable.length
    assert shape.status is Status.OK
    assert np.linalg.norm(shape.positions - answer["r"], axis=1).mean() < 1e-5 * length
    assert np.abs(shape.force - answer["n"]).max() < 1e-3 * np.abs(answer["n"]).max()
    assert np.abs(shape.moment - answer["m"]).max() < 1e-3 * np.abs(answer["m"]).max()
    assert abs(shape.energy - answer["energy"]) < 1e-4 * abs(answer["energy"]) + 1e-5
    assert abs(shape.twist - values["twist"]["integral_u3"]) < 2e-3


STABLE = named(
    "references/grasp_1", "references/strap_1", "references/rubber_shear", "references/free_plug",
    "public/grasp_02", "public/anisotropic_03", "public/extensible_05", "public/free_end_04",
)  # fmt: skip


@pytest.mark.parametrize("path", STABLE, ids=label)
def test_smallest_eigenvalue_of_the_second_variation(path):
    values = json.loads(path.read_text())
    case = reference_case(values)
    problem = Problem(case.cable, gravity=values["gravity"], tolerance=1e-7 * case.cable.length)
    state = Network(problem.move(case.start, case.end))
    assert cosserat.solve(problem, state).status is Status.OK
    unit = max(*case.cable.bending_stiffness, case.cable.twisting_stiffness) / case.cable.length**2
    assert cosserat.smallest_eigenvalue(state) / unit == pytest.approx(values["solution"]["min_eig"], rel=3e-3)


def test_end_loaded_cantilever_meets_the_elliptic_integral():
    """P L^2 / EI = 10: tip at (0.4451, 0.8111) L by elliptic integrals (Mattiasson 1981, five digits)."""
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=1.0)
    tip = solved(cable, START, FreeEnd(force=(0, 0, -10.0))).positions[-1]
    assert tip == pytest.approx((1.0 - 0.55500, 0.0, -0.81061), abs=2e-5)


def test_an_end_moment_bends_into_a_circle():
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=2.0)
    shape = solved(cable, START, FreeEnd(moment=(0, -math.pi, 0)), points=9)  # quarter turn, upwards
    s = shape.arc_length
    radius = 2.0 / math.pi
    expected = np.stack((radius * np.sin(s / radius), 0 * s, radius * (1 - np.cos(s / radius))), axis=1)
    assert shape.positions == pytest.approx(expected, abs=1e-6)
    assert np.abs(shape.moment - (0, -math.pi, 0)).max() < 1e-6


def test_an_unloaded_free_cable_shows_its_rest_curvature():
    """Constant (1, 0, 2): a helix of radius k / (k^2 + t^2) and pitch 2 pi t / (k^2 + t^2)."""
    cable = Cable(length=3.0, linear_density=0.0, bending_stiffness=1.0, rest_curvature=(1.0, 0.0, 2.0))
    shape = solved(cable, START, None)
    assert np.abs(shape.curvature - (1.0, 0.0, 2.0)).max() < 1e-8
    tangents = shape.tangents
    axis = np.array(Rotation.from_quat(ALONG_X).apply((1.0, 0.0, 2.0))) / math.sqrt(5.0)
    assert tangents @ axis == pytest.approx(np.full(len(tangents), 2.0 / math.sqrt(5.0)), abs=1e-6)
    assert shape.energy == pytest.approx(0.0, abs=1e-10)


def test_a_rest_curvature_that_varies_along_the_cable():
    """A clothoid: curvature 3 s about d1; the unloaded cable is its Fresnel integral."""
    table = np.outer(np.linspace(0.0, 1.0, 5), (3.0, 0.0, 0.0))
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=1.0, rest_curvature=table)
    shape = solved(cable, Pose((0, 0, 0)), None, tolerance=1e-7)
    s = np.linspace(0.0, 1.0, 20001)
    angle = 1.5 * s**2  # about d1 = x: d3 turns from z towards -y
    fine = np.stack((-np.sin(angle), np.cos(angle)), axis=1)
    reached = np.array([np.trapezoid(fine[:, 0], s), np.trapezoid(fine[:, 1], s)])
    assert shape.positions[-1, 1:] == pytest.approx(reached, abs=2e-7)


def test_stretch_of_a_hanging_cable():
    """Hanging straight down: r(L) = L + w L^2 / 2 EA."""
    cable = CABLE.replace(axial_stiffness=20.0)
    down = Pose((0, 0, 0), (1.0, 0.0, 0.0, 0.0))
    shape = solved(cable, down, FreeEnd(mass=0.2))
    w, plug = 0.981, 0.2 * 9.81
    assert shape.positions[-1, 2] == pytest.approx(-(LENGTH + (0.5 * w * LENGTH**2 + plug * LENGTH) / 20.0), abs=1e-9)
    assert shape.force[-1] == pytest.approx((0, 0, -plug))
    assert shape.force[0] == pytest.approx((0, 0, -plug - w * LENGTH))


def test_a_point_mass_is_a_jump_of_the_force():
    scene = Scene(masses=(PointMass(0.45, 0.2),))
    shape = solved(CABLE, START, END, points=241, scene=scene)
    jump = shape.force[90] - shape.force[89]  # the point at 0.45 m has the value just after it
    assert shape.arc_length[90] == pytest.approx(0.45)
    ds = LENGTH / 240
    assert jump == pytest.approx((0, 0, 0.2 * 9.81 + 0.981 * ds), abs=1e-9)


def test_distributed_load_adds_to_the_weight():
    wind = np.array(((0.0, 0.3, 0.0), (0.0, 0.9, 0.0)))
    shape = solved(CABLE, START, END, distributed_load=wind)
    total = shape.force[0] - shape.force[-1]
    assert total == pytest.approx((0.0, 0.6 * LENGTH, -0.981 * LENGTH), abs=1e-9)
    assert integrated_residual(CABLE, solved(CABLE, START, END), np.array((0, 0, -0.981))) < 1e-3


# -- ends


@pytest.mark.parametrize("kind", ["swivel", "pinned"])
def test_what_an_end_leaves_free_carries_no_moment(kind):
    shape = solved(CABLE.replace(bending_stiffness=(0.01, 0.02)), START, Grip(END, kind=kind))
    assert shape.status is Status.OK
    frame = Rotation.from_quat(shape.quaternions[-1])
    local = frame.inv().apply(shape.moment[-1])
    scale = np.abs(shape.moment).max()
    assert abs(local[2]) < 1e-5 * scale
    if kind == "pinned":
        assert np.abs(local).max() < 1e-5 * scale
    else:
        assert frame.apply((0, 0, 1)) == pytest.approx(Rotation.from_quat(END.quaternion).apply((0, 0, 1)), abs=1e-6)


def test_a_cable_pinned_at_both_ends_is_solved_in_spite_of_its_free_roll():
    shape = solved(CABLE, Grip(START, kind="pinned"), Grip(Pose((0.9, 0, 0)), kind="pinned"))
    assert shape.status is Status.OK
    assert np.abs(shape.moment[[0, -1]]).max() < 1e-6 * np.abs(shape.moment).max()
    assert shape.positions[:, 1] == pytest.approx(np.zeros(shape.points), abs=1e-9)


@pytest.mark.parametrize("turns", [1, -1, 2])
def test_turns_wind_the_cable(turns):
    """A slack cable stiff enough not to snarl holds the whole twist: integral of u3 near 2 pi turns."""
    cable = CABLE.replace(bending_stiffness=0.4, twisting_stiffness=0.05)
    straight_on = Pose((1.1, 0, 0), ALONG_X, turns=turns)
    shape = solved(cable, START, straight_on, gravity=(0, 0, 0))
    assert shape.status
    assert shape.turns == turns
    none = solved(cable, START, Pose((1.1, 0, 0), ALONG_X), gravity=(0, 0, 0))
    assert none.turns == 0
    assert abs(shape.twist - none.twist - 2 * math.pi * turns) < 0.5 * math.pi


def test_the_sign_of_a_quaternion_is_ignored():
    a = solved(CABLE, START, END)
    b = solved(CABLE, Pose(START.position, -START.quaternion), END)
    assert np.array_equal(a.positions, b.positions)
