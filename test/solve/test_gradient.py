"""The gradient cables through the public API, against scipy's solve_bvp, beams in closed form, and invariances."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from gradient_bvp import GradientBvp
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.solve.problem import Problem

ALONG_X = (0.5, 0.5, 0.5, 0.5)
UP, DOWN = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
ORIGIN = cs.Pose((0.0, 0.0, 0.0), ALONG_X)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
MODELS = ("gradient4", "gradient6")
SETTINGS = settings(derandomize=True, deadline=None, max_examples=40)


def end_at(x: float, y: float = 0.0, z: float = 0.0) -> cs.Pose:
    return cs.Pose((x, y, z), ALONG_X)


@pytest.mark.parametrize("order", [4, 6])
@pytest.mark.parametrize(
    ("cable", "start", "end"),
    [
        (CABLE, ORIGIN, end_at(0.8)),
        (CABLE, ORIGIN, end_at(0.7, 0.3, -0.1)),
        (CABLE.replace(bending_stiffness=[0.2, 0.2]), cs.Pose((0, 0, 0), ALONG_X), end_at(0.9, 0.2)),
        # complex roots of the 6th order: C > B^2 / 4T
        (CABLE.replace(gradient_length=0.4), ORIGIN, end_at(0.9)),
        (CABLE, ORIGIN, cs.Grip(end_at(0.8, 0.1), kind="pinned")),
        (CABLE.replace(gradient_length=0.1), ORIGIN, cs.Grip(end_at(0.8), curvature=(0.0, 0.0, 2.0))),
    ],
    ids=["level", "inclined", "stiff", "complex", "pinned", "curvature"],
)
def test_it_agrees_with_a_boundary_value_solver(order: int, cable: cs.Cable, start: cs.Pose, end: cs.Pose) -> None:
    reference = GradientBvp(Problem(cable).move(start, end), order)
    answer = reference.solve(1e-5, last=reference.solve(1e-3))
    assert answer.success, answer.message
    shape = cs.predict(cable, start, end, model=f"gradient{order}", points=101)
    assert shape.status is cs.Status.OK
    np.testing.assert_allclose(shape.positions, reference.positions(answer, 101), atol=2e-6 * cable.length)


def test_a_stiff_arch_is_under_compression() -> None:
    """T < 0: the cable is pushed. An arch between upright grips closer than its length."""
    cable = CABLE.replace(bending_stiffness=[0.2, 0.2])
    for model in MODELS:
        shape = cs.predict(cable, cs.Pose((0, 0, 0), UP), cs.Pose((0.5, 0, 0), DOWN), model=model)
        assert shape.status is cs.Status.OK
        assert np.isfinite(shape.buffer).all()
        np.testing.assert_allclose(shape.positions[-1], (0.5, 0.0, 0.0), atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("ratio", [40.0, 400.0, 4000.0])
def test_slender_cables_are_stable_and_keep_their_length(model: str, ratio: float) -> None:
    """L/g, g = sqrt(EI/T), up to 4000: the boundary layer is far shorter than the distance of points."""
    stiffness = 0.5 * 9.81 * 0.1 * 1.2 * (1.2 / ratio) ** 2
    cable = cs.Cable(1.2, 0.1, stiffness, gradient_length=0.2 / ratio)
    turned = cs.Pose((0.8, 0.1, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    shape = cs.predict(cable, ORIGIN, turned, model=model, points=16001)
    assert shape.status is cs.Status.OK
    assert np.isfinite(shape.buffer).all()
    arc = np.linalg.norm(np.diff(shape.positions, axis=0), axis=1).sum()
    assert arc == pytest.approx(1.2, rel=2e-5)
    chain = cs.predict(CABLE.replace(bending_stiffness=[0.0, 0.0]), ORIGIN, turned, model="catenary", points=16001)
    # the linearised weight is not the catenary's: they agree to the slackness, not to rounding
    assert np.abs(shape.positions - chain.positions).max() < 0.1


@pytest.mark.parametrize("model", MODELS)
def test_a_taut_heavy_cable_sags_like_a_parabola(model: str) -> None:
    slack = 1e-4
    cable = cs.Cable(1.0, 0.1, 1e-9, gradient_length=1e-5)
    shape = cs.predict(cable, ORIGIN, end_at(1.0 - slack), model=model)
    assert -shape.positions[:, 2].min() == pytest.approx(math.sqrt(3.0 * slack / 8.0), rel=5e-3)


def test_a_concentrated_load_is_a_jump_of_force_at_its_arc_length() -> None:
    scene = cs.Scene(masses=[cs.PointMass(0.6, 0.05)])
    for model in MODELS:
        shape = cs.predict(CABLE, ORIGIN, end_at(0.9), model=model, scene=scene, points=601)
        assert shape.status is cs.Status.OK
        drop = np.diff(shape.force[:, 2])
        assert abs(int(np.argmax(np.abs(drop))) - 300) <= 1
        assert np.abs(drop).max() == pytest.approx(0.05 * 9.81, abs=0.01)
        assert abs(shape.arc_length[shape.positions[:, 2].argmin()] - 0.6) < 0.05


def test_the_sixth_order_becomes_the_fourth_as_its_length_vanishes() -> None:
    end = end_at(0.85, 0.1, -0.1)
    fourth = cs.predict(CABLE, ORIGIN, end, model="gradient4")
    gaps = []
    for length in (1e-2, 1e-3, 1e-4):
        sixth = cs.predict(CABLE.replace(gradient_length=length), ORIGIN, end, model="gradient6")
        gaps.append(np.abs(sixth.positions - fourth.positions).max())
    assert gaps[0] > gaps[1] > gaps[2]
    assert gaps[2] < 1e-4


@pytest.mark.parametrize("model", MODELS)
def test_a_free_end_carries_what_hangs_on_it(model: str) -> None:
    shape = cs.predict(CABLE, ORIGIN, cs.FreeEnd(mass=0.02), model=model)
    assert shape.status is cs.Status.OK
    # of the 6th order the moment with its gradient part vanishes, not the bending moment alone
    np.testing.assert_allclose(shape.moment[-1], 0.0, atol=1e-6 if model == "gradient4" else 1e-5)
    np.testing.assert_allclose(shape.force[0], (0.0, 0.0, -9.81 * (0.12 + 0.02)), atol=1e-6)
    stiff = cs.predict(CABLE.replace(bending_stiffness=[1.0, 1.0]), ORIGIN, None, model=model)
    limp = cs.predict(CABLE.replace(bending_stiffness=[1e-3, 1e-3]), ORIGIN, None, model=model)
    assert stiff.positions[-1, 2] > limp.positions[-1, 2]


@SETTINGS
@given(
    st.tuples(*[st.floats(-0.55, 0.55)] * 3),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    st.sampled_from(MODELS),
)
def test_moving_and_turning_everything_moves_and_turns_the_shape(
    place: tuple[float, float, float], turn: tuple[float, float, float], shift: tuple[float, float, float], model: str
) -> None:
    R = Rotation.from_rotvec(turn)
    quaternion = Rotation.from_quat(ALONG_X)
    one = cs.predict(CABLE, ORIGIN, end_at(*place), model=model, points=40)
    two = cs.predict(
        CABLE,
        cs.Pose(shift, (R * quaternion).as_quat()),
        cs.Pose(R.apply(place) + shift, (R * quaternion).as_quat()),
        model=model,
        gravity=R.apply((0.0, 0.0, -9.81)),
        points=40,
    )
    assert one.status is two.status
    if one.status is cs.Status.OK:
        np.testing.assert_allclose(two.positions, R.apply(one.positions) + shift, atol=2e-6)


@SETTINGS
@given(
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.floats(-6.0, 2.0),
    st.sampled_from([0.0, 1e-3, 0.1, 2.0]),
    st.sampled_from([None, 1e2, 1e7]),
    st.sampled_from(MODELS),
)
def test_nothing_is_ever_nan_and_the_status_is_honest(
    place: tuple[float, float, float],
    turn: tuple[float, float, float],
    log_stiffness: float,
    density: float,
    stiffness: float | None,
    model: str,
) -> None:
    cable = cs.Cable(1.2, density, 10.0**log_stiffness, axial_stiffness=stiffness)
    end = cs.Pose(place, Rotation.from_rotvec(turn).as_quat())
    shape = cs.predict(cable, ORIGIN, end, model=model, points=30)
    assert np.isfinite(shape.buffer).all()
    assert shape.status in (cs.Status.OK, cs.Status.OVERSTRETCHED, cs.Status.NOT_CONVERGED)
    if shape.status is cs.Status.OK:
        np.testing.assert_allclose(shape.positions[-1], place, atol=1e-9)
    else:
        assert shape.detail
    if stiffness is None and np.linalg.norm(place) > 1.2:
        assert shape.status is cs.Status.OVERSTRETCHED


@pytest.mark.parametrize("model", MODELS)
def test_a_warm_start_leaves_nothing_behind(model: str) -> None:
    """A walk with noise, jumps, chords too long, loads and ways of holding that come and go: every shape is the cold
    one. Tensions are guessed ahead and panels kept for at most 32 solves, so it is longer."""
    rng = np.random.default_rng(4)
    predictor = cs.Predictor(CABLE, model=model)
    place, turn = np.array((0.7, 0.3, -0.1)), Rotation.from_quat(ALONG_X)
    for k in range(240):
        place = place + rng.normal(size=3) * (0.3 if k % 40 == 39 else 0.01 if k % 3 else 1e-4)
        place *= min(1.0, (1.3 if k % 50 == 0 else 1.18) / float(np.linalg.norm(place)))
        turn = Rotation.from_rotvec(0.05 * rng.normal(size=3)) * turn
        if k % 60 == 20:
            predictor.scene = cs.Scene(masses=[cs.PointMass(0.5, 0.03)])
        if k % 60 == 30:
            predictor.scene = None
        pose = cs.Pose(place, turn.as_quat())
        end = cs.Grip(pose, kind="pinned") if k % 60 > 50 else cs.FreeEnd(mass=0.01 * (k % 4)) if k % 60 > 45 else pose
        shape = predictor.predict(ORIGIN, end)
        cold = cs.predict(CABLE, ORIGIN, end, model=model, scene=predictor.scene)
        assert shape.status is cold.status, k
        np.testing.assert_allclose(shape.positions, cold.positions, rtol=0.0, atol=2e-7 * CABLE.length, err_msg=str(k))
        np.testing.assert_allclose(shape.force, cold.force, rtol=0.0, atol=2e-6 * (0.1 + np.abs(cold.force).max()))
