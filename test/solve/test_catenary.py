"""The catenary against closed forms, integration of the differential equation, and reference shapes."""

import json
import math
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from references import label, references
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels import catenary as kernel

CHAIN = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.0)
ORIGIN = cs.Pose()
SETTINGS = settings(derandomize=True, deadline=None, max_examples=60)
places = st.tuples(*[st.floats(-0.65, 0.65)] * 3)


def integrated(
    shape: cs.CableShape, cable: cs.Cable, load: np.ndarray, masses: list[tuple[float, float]]
) -> np.ndarray:
    """r(s) at the shape's arc lengths by integrating r' = (1 + |n|/EA) n/|n|, n' = -f from the force at the start."""
    give = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        f = load[0] + (load[1] - load[0]) * s / cable.length
        size = np.linalg.norm(y[3:])
        return np.concatenate((y[3:] / size + give * y[3:], -f))

    y = np.concatenate((shape.positions[0], shape.force[0]))
    stops = [0.0, *[s for s, _ in masses], cable.length]
    out = np.empty((shape.points, 3))
    for i in range(len(stops) - 1):
        inside = (shape.arc_length >= stops[i] - 1e-12) & (shape.arc_length <= stops[i + 1] + 1e-12)
        at = np.clip(shape.arc_length[inside], stops[i], stops[i + 1])
        found = solve_ivp(slope, stops[i : i + 2], y, method="DOP853", rtol=1e-11, atol=1e-13, dense_output=True)
        out[inside] = found.sol(at)[:3].T
        y = found.y[:, -1]
        if i < len(masses):
            y[3:] -= masses[i][1] * np.array((0.0, 0.0, -9.81))
    return out


def test_the_level_catenary_is_a_hyperbolic_cosine() -> None:
    shape = cs.predict(CHAIN, ORIGIN, cs.Pose((0.8, 0.0, 0.0)), model="catenary")
    a = brentq(lambda a: 2 * a * math.sinh(0.4 / a) - 1.2, 0.01, 10.0, xtol=1e-15)
    s = shape.arc_length - 0.6
    x = 0.4 + a * np.arcsinh(s / a)
    z = np.sqrt(a * a + s * s) - math.sqrt(a * a + 0.36)
    np.testing.assert_allclose(shape.positions, np.stack((x, 0 * x, z), axis=1), atol=1e-13)
    np.testing.assert_allclose(shape.force[:, 0], a * 0.981, rtol=1e-12)
    np.testing.assert_allclose(shape.curvature[:, :2] ** 2 @ (1, 1), (a / (a * a + s * s)) ** 2, rtol=1e-9)
    assert shape.iterations == 1, "the closed form needs no iteration"
    assert not shape.moment.any()
    # energy: weight times height, integrated independently
    fine = np.linspace(-0.6, 0.6, 200_001)
    height = np.sqrt(a * a + fine**2) - math.sqrt(a * a + 0.36)
    assert shape.energy == pytest.approx(0.981 * np.trapezoid(height, fine), abs=1e-10)


@SETTINGS
@given(places, st.sampled_from([None, 5.0, 500.0]), st.floats(0.05, 1.15), st.floats(0.0, 0.5))
def test_any_place_load_and_stretch_agrees_with_integration(
    place: tuple[float, float, float], stiffness: float | None, where: float, mass: float
) -> None:
    cable = cs.Cable(1.2, 0.1, 0.0, axial_stiffness=stiffness)
    scene = cs.Scene(masses=[cs.PointMass(where, mass)])
    shape = cs.predict(cable, ORIGIN, cs.Pose(place), model="catenary", scene=scene, points=60)
    assert shape.status is cs.Status.OK, shape
    np.testing.assert_allclose(shape.positions[-1], place, atol=1e-12)
    level = math.hypot(place[0], place[1])
    if level < 1e-3:
        return  # folded on itself: integration through the fold says nothing
    load = np.tile((0.0, 0.0, -0.981), (2, 1))
    reference = integrated(shape, cable, load, [(where, mass)])
    np.testing.assert_allclose(shape.positions, reference, atol=2e-7 / level)


def test_a_load_that_varies_agrees_with_integration_within_its_error_estimate() -> None:
    wind = ((0.0, 0.5, 0.0), (0.0, -0.2, 0.4))
    shape = cs.predict(CHAIN, ORIGIN, cs.Pose((0.8, 0.1, -0.2)), model="catenary", distributed_load=wind)
    assert shape.status is cs.Status.OK
    reference = integrated(shape, CHAIN, np.array(wind) + np.array((0.0, 0.0, -0.981)), [])
    error = np.abs(shape.positions - reference).max()
    assert 0.0 < error <= shape.error_estimate <= 1e-5 * 1.2


def test_a_concentrated_load_is_a_jump_of_force() -> None:
    scene = cs.Scene(masses=[cs.PointMass(0.45, 0.2)])
    shape = cs.predict(CHAIN, ORIGIN, cs.Pose((0.9, 0.0, 0.0)), model="catenary", scene=scene, points=121)
    k = 45  # at 0.45 m exactly: the value just after the mass
    jump = shape.force[k] - shape.force[k - 1]
    np.testing.assert_allclose(jump, (0.0, 0.0, 0.2 * 9.81 + 0.981 * 0.01), atol=1e-12)


@SETTINGS
@given(places, st.tuples(*[st.floats(-3.0, 3.0)] * 3), places)
def test_moving_and_turning_everything_moves_and_turns_the_shape(
    place: tuple[float, float, float], turn: tuple[float, float, float], shift: tuple[float, float, float]
) -> None:
    R = Rotation.from_rotvec(turn)
    one = cs.predict(CHAIN, ORIGIN, cs.Pose(place), model="catenary", points=40)
    two = cs.predict(
        CHAIN,
        cs.Pose(shift, R.as_quat()),
        cs.Pose(R.apply(place) + shift, R.as_quat()),
        model="catenary",
        gravity=R.apply((0.0, 0.0, -9.81)),
        points=40,
    )
    np.testing.assert_allclose(two.positions, R.apply(one.positions) + shift, atol=1e-9)
    np.testing.assert_allclose(two.force, R.apply(one.force), atol=1e-7)


@SETTINGS
@given(places)
def test_exchanging_the_ends_reverses_the_shape(place: tuple[float, float, float]) -> None:
    there = cs.predict(CHAIN, ORIGIN, cs.Pose(place), model="catenary")
    back = cs.predict(CHAIN, cs.Pose(place), ORIGIN, model="catenary")
    np.testing.assert_allclose(there.positions, back.positions[::-1], atol=1e-9)
    np.testing.assert_allclose(there.force, -back.force[::-1], atol=1e-7)


@SETTINGS
@given(
    st.tuples(*[st.floats(-0.7, 0.7)] * 3),
    st.floats(0.0, 2.0),
    st.floats(1e-3, 1e3),
    st.sampled_from([None, 1e-1, 1e2, 1e9]),
    st.floats(0.1, 10.0),
)
def test_nothing_is_ever_nan_and_the_status_is_honest(
    place: tuple[float, float, float], density: float, scale: float, stiffness: float | None, stretch: float
) -> None:
    cable = cs.Cable(scale, density, 0.0, axial_stiffness=stiffness)
    shape = cs.predict(cable, ORIGIN, cs.Pose(stretch * scale * np.array(place)), model="catenary", points=30)
    assert np.isfinite(shape.buffer).all()
    if shape.status is cs.Status.OK:
        assert np.linalg.norm(shape.positions[-1] - stretch * scale * np.array(place)) <= 1e-5 * scale
    else:
        assert shape.detail


@pytest.mark.parametrize("slack", [1e-2, 1e-4, 1e-6, 1e-9])
def test_taut_cables_close(slack: float) -> None:
    shape = cs.predict(CHAIN, ORIGIN, cs.Pose((1.2 * (1.0 - slack), 0.0, 0.0)), model="catenary")
    assert shape.status is cs.Status.OK
    sag = -shape.positions[:, 2].min()
    assert sag == pytest.approx(1.2 * math.sqrt(3.0 * slack / 8.0), rel=0.02)  # parabola


def test_folded_free_and_weightless() -> None:
    folded = cs.predict(CHAIN, ORIGIN, cs.Pose((0.0, 0.0, -0.2)), model="catenary", points=121)
    assert folded.status is cs.Status.OK
    assert folded.positions[:, 2].min() == pytest.approx(-0.7, abs=1e-6)
    hanging = cs.predict(CHAIN, ORIGIN, cs.FreeEnd(mass=0.3), model="catenary")
    assert hanging.status is cs.Status.OK
    np.testing.assert_allclose(hanging.positions[-1], (0, 0, -1.2), atol=1e-12)
    np.testing.assert_allclose(hanging.force[0], (0, 0, -9.81 * 0.42), atol=1e-12)
    weightless = cs.Cable(1.2, 0.0, 0.0)
    slack = cs.predict(weightless, ORIGIN, cs.Pose((0.5, 0.0, 0.0)), model="catenary")
    assert slack.status is cs.Status.NOT_CONVERGED
    assert "no definite shape" in slack.detail
    rubber = cs.Cable(1.2, 0.0, 0.0, axial_stiffness=10.0)
    pulled = cs.predict(rubber, ORIGIN, cs.Pose((1.5, 0.0, 0.0)), model="catenary")
    assert pulled.status is cs.Status.OK
    np.testing.assert_allclose(pulled.tension, 10.0 * 0.25, rtol=1e-9)


def test_the_derivative_of_the_closure_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(3)
    panels = np.zeros((3, 7))
    panels[:, 0] = (0.3, 0.5, 0.4)
    panels[:, 1:4] = rng.normal(size=(3, 3))
    panels[1, 1:4] = 0.0  # a panel without load
    panels[1:, 4:7] = rng.normal(size=(2, 3))
    for give in (0.0, 0.05):
        for _ in range(20):
            force = rng.normal(size=3)
            derivative = np.zeros((3, 3))
            kernel.closure(force, panels, give, derivative)
            none = np.zeros((3, 3))
            for k in range(3):
                step = np.zeros(3)
                step[k] = 1e-6
                ahead = kernel.closure(force + step, panels, give, none)
                behind = kernel.closure(force - step, panels, give, none)
                np.testing.assert_allclose(derivative[:, k], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("path", references("catenary_*", "published"), ids=label)
def test_reference_catenaries(path: Path) -> None:
    case = json.loads(path.read_text())
    given_cable, reference = case["cable"], case["solution"]
    cable = cs.Cable(given_cable["length"], given_cable["linear_density"], 0.0, axial_stiffness=given_cable["EA"])
    shape = cs.predict(
        cable,
        cs.Pose(case["start"]["position"]),
        cs.Pose(case["end"]["position"]),
        gravity=case["gravity"],
        points=len(reference["s"]),
    )
    assert shape.model == "catenary"
    assert shape.status is cs.Status.OK
    np.testing.assert_allclose(shape.positions, reference["r"], atol=1e-9 * cable.length)
    np.testing.assert_allclose(shape.force, reference["n"], atol=1e-7)
