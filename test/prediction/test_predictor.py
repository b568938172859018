"""The predictor: its contract, what "auto" is, and when the last shape is given again."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)  # d1 = y, d2 = z, d3 = x
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
START = cs.Pose((0.0, 0.0, 0.0), ALONG_X)
END = cs.Pose((0.8, 0.1, -0.05), ALONG_X)
CLOSED_FORMS = ("catenary", "gradient4", "gradient6")
MODELS = (*CLOSED_FORMS, "cosserat")


@pytest.mark.parametrize("model", MODELS)
def test_a_shape_holds_what_the_contract_says(model: str) -> None:
    shape = cs.predict(CABLE, START, END, model=model, points=401)
    assert shape.status is cs.Status.OK
    assert bool(shape.status)
    assert shape.model == model
    assert shape.detail == ""
    np.testing.assert_allclose(shape.arc_length, np.linspace(0.0, 1.2, 401), atol=1e-12)
    for name, columns in (("positions", 3), ("quaternions", 4), ("curvature", 3), ("force", 3), ("moment", 3)):
        array = getattr(shape, name)
        assert array.shape == (401, columns), name
        assert np.isfinite(array).all(), name
    np.testing.assert_allclose(shape.positions[[0, -1]], [START.position, END.position], atol=1e-9 * 1.2)
    np.testing.assert_allclose(np.linalg.norm(shape.quaternions, axis=1), 1.0, atol=1e-12)
    # positions at uniform arc length: no chord is longer than the arc, and short ones are nearly as long
    chords = np.linalg.norm(np.diff(shape.positions, axis=0), axis=1)
    assert (chords <= 1.2 / 400 + 1e-9 + 2e-5 * 1.2).all()
    # d3 is the tangent: central differences of the centreline
    differences = np.gradient(shape.positions, shape.arc_length, axis=0, edge_order=2)
    assert np.abs(differences - shape.tangents)[2:-2].max() < 1e-3
    if model in CLOSED_FORMS:
        assert 1e-2 * 1.2 < shape.error_estimate < 0.2 * 1.2, "a slack cable: far from the rod"
    else:
        assert 0.0 <= shape.error_estimate <= 1e-5 * 1.2
    assert shape.iterations >= 1
    assert shape.solve_time > 0.0
    assert math.isfinite(shape.energy)
    assert math.isfinite(shape.residual)


@pytest.mark.parametrize("model", MODELS)
def test_the_cable_carries_its_weight(model: str) -> None:
    """Independent of the model: the force differs between the ends by the weight, and points along the load."""
    shape = cs.predict(CABLE, START, END, model=model)
    weight = np.array((0.0, 0.0, -9.81 * 0.1 * 1.2))
    np.testing.assert_allclose(shape.force[-1] - shape.force[0], -weight, atol=1e-3 * 1.2)


@pytest.mark.parametrize("model", MODELS)
def test_warm_and_cold_agree_along_a_motion(model: str) -> None:
    predictor = cs.Predictor(CABLE, model=model)
    for k in range(30):
        end = cs.Pose((0.8 - 0.01 * k, 0.1, -0.05 + 0.02 * k), ALONG_X)
        warm = predictor.predict(START, end)
        cold = cs.predict(CABLE, START, end, model=model)
        assert warm.status is cs.Status.OK
        assert not warm.reused
        np.testing.assert_allclose(warm.positions, cold.positions, atol=2e-5 * 1.2)


def test_reuse_fires_for_the_same_ends_whichever_sign_the_quaternion_has() -> None:
    predictor = cs.Predictor(CABLE, model="gradient4")
    first = predictor.predict(START, END)
    flipped = cs.Pose(END.position, -END.quaternion)
    for end in (END, cs.Pose(END.position, END.quaternion), flipped):
        again = predictor.predict(START, end)
        assert again.reused
        assert again.solve_time == 0.0
        assert again.buffer is first.buffer, "reuse gives the same shape to the bit"


def test_the_smallest_motion_is_solved_for() -> None:
    """One end or the other, place, rotation or winding by the least that numbers can tell, and back again."""
    predictor = cs.Predictor(CABLE, model="gradient4")
    ends = [
        (START, cs.Pose(np.nextafter(END.position, 1.0), END.quaternion)),
        (START, END),
        (START, cs.Pose(END.position, (0.5 + 1e-12, 0.5, 0.5, 0.5 - 1e-12))),
        (cs.Pose((0.0, 5e-324, 0.0), ALONG_X), END),
        (START, cs.Pose(END.position, END.quaternion, turns=1)),
        (START, END),
    ]
    assert not any(predictor.predict(*pair).reused for pair in ends)
    assert predictor.predict(START, END).reused


def test_a_taut_cable_is_solved_again_for_the_smallest_move() -> None:
    """There the sag changes by far more than the ends move: by more than the tolerance in this step."""
    predictor = cs.Predictor(CABLE)
    slack = predictor.predict(START, cs.Pose((1.2 * (1.0 - 1.0e-5), 0.0, 0.0), ALONG_X))
    tauter = predictor.predict(START, cs.Pose((1.2 * (1.0 - 0.1e-5), 0.0, 0.0), ALONG_X))
    assert slack.status is cs.Status.OK
    assert tauter.status is cs.Status.OK
    assert not tauter.reused
    beyond = predictor.predict(START, cs.Pose((1.2 * (1.0 + 0.1e-5), 0.0, 0.0), ALONG_X))
    assert beyond.status is cs.Status.OVERSTRETCHED


def test_a_change_of_grip_scene_or_reset_forbids_reuse() -> None:
    predictor = cs.Predictor(CABLE, model="gradient4")
    clamped = predictor.predict(START, END)
    pinned = predictor.predict(START, cs.Grip(END, kind="pinned"))
    assert not pinned.reused
    assert np.abs(pinned.positions - clamped.positions).max() > 1e-3
    predictor.scene = cs.Scene(masses=[cs.PointMass(0.6, 0.2)])
    loaded = predictor.predict(START, cs.Grip(END, kind="pinned"))
    assert not loaded.reused
    assert loaded.positions[:, 2].min() < pinned.positions[:, 2].min() - 0.01
    predictor.reset()
    assert not predictor.predict(START, cs.Grip(END, kind="pinned")).reused


def test_a_chord_longer_than_the_cable_is_a_status_and_a_straight_line() -> None:
    for model in MODELS:
        shape = cs.predict(CABLE, START, cs.Pose((1.3, 0.0, 0.0), ALONG_X), model=model)
        assert shape.status is cs.Status.OVERSTRETCHED, model
        assert not shape.status
        assert "0.1 m" in shape.detail, shape.detail
        assert np.isfinite(shape.buffer).all()
        np.testing.assert_allclose(shape.positions[:, 0], np.linspace(0.0, 1.3, 150), atol=1e-9)
        np.testing.assert_allclose(shape.positions[:, 1:], 0.0, atol=1e-9)


def test_auto_is_the_rod_and_the_catenary_for_a_chain() -> None:
    chain = cs.Cable(1.2, 0.1, 0.0)
    assert cs.predict(chain, START, END).model == "catenary"
    for model in ("gradient4", "gradient6", "cosserat"):
        with pytest.raises(
            cs.ArgumentError, match=rf"bending_stiffness = 0.0 .*model '{model}'.*choose model='catenary'"
        ):
            cs.Predictor(chain, model=model)
    for stiffness, end in ((0.01, END), (1e-5, cs.Pose((1.17, 0.0, 0.0), ALONG_X))):  # slack, and taut and thin
        cable = CABLE.replace(bending_stiffness=stiffness)
        auto, named = (cs.predict(cable, START, end, model=model) for model in ("auto", "cosserat"))
        assert auto.model == "cosserat"
        assert auto.error_estimate <= 1e-5 * 1.2
        np.testing.assert_array_equal(auto.buffer, named.buffer)


def test_sensitivity_agrees_with_finite_differences() -> None:
    predictor = cs.Predictor(CABLE, model="cosserat", points=31, tolerance=1e-9)
    predictor.predict(START, END)
    jacobian = predictor.sensitivity()
    assert jacobian.shape == (31, 3, 12)
    step = 1e-5
    for column in range(12):
        twist = np.zeros(12)
        twist[column] = step
        shapes = []
        for sign in (1.0, -1.0):
            ends = [
                cs.Pose(
                    pose.position + sign * move[:3],
                    (Rotation.from_rotvec(sign * move[3:]) * Rotation.from_quat(pose.quaternion)).as_quat(),
                )
                for pose, move in ((START, twist[:6]), (END, twist[6:]))
            ]
            shapes.append(predictor.predict(*ends))
            assert not shapes[-1].reused
        difference = (shapes[0].positions - shapes[1].positions) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:, :, column], difference, atol=2e-4, err_msg=f"column {column}")


def test_sensitivity_needs_the_rod_and_a_solution() -> None:
    with pytest.raises(cs.ArgumentError, match=r"model = 'gradient4' .*needs the Cosserat rod"):
        cs.Predictor(CABLE, model="gradient4").sensitivity()
    with pytest.raises(cs.ArgumentError, match="Call predict first"):
        cs.Predictor(CABLE, model="cosserat").sensitivity()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"model": "spline"}, r"model = 'spline' .*catenary, gradient4"),
        ({"points": 1}, r"points = 1 .*at least 2"),
        ({"points": 1.5}, r"points = 1.5 .*whole number"),
        ({"tolerance": 0.0}, r"tolerance = 0.0 .*above 0 m"),
        ({"gravity": (0, 0)}, r"gravity = .*shape \(3,\)"),
        ({"gravity": (0, 0, math.nan)}, r"gravity = .*finite"),
        ({"distributed_load": (0, 0, 1)}, r"distributed_load = .*two rows of three"),
        ({"scene": cs.Scene(masses=[cs.PointMass(1.3, 0.1)])}, r"PointMass.arc_length = 1.3 .*at most the length"),
        (
            {"scene": cs.Scene(clips=[cs.Clip(0.5, cs.Pose())]), "model": "gradient4"},
            r"scene.clips = 1 .*clips.*Remove the clips",
        ),
    ],
)
def test_bad_arguments_are_refused_by_name(keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(cs.ArgumentError, match=message):
        cs.predict(CABLE, START, END, **keywords)


def test_ends_of_the_wrong_type_are_refused() -> None:
    with pytest.raises(cs.ArgumentError, match=r"start = .*must be a Pose or a Grip"):
        cs.predict(CABLE, (0, 0, 0), END)  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError, match=r"cable = .*must be a Cable"):
        cs.predict("cable", START, END)  # type: ignore[arg-type]


def test_a_time_budget_grades_what_there_was_time_for():
    """Within tolerance or not, and never as OK; without one the same shape is OK."""
    hurried = cs.Predictor(CABLE, model="cosserat", tolerance=1e-11, time_budget=1e-9)
    shape = hurried.predict(START, END)
    assert shape.status is cs.Status.BUDGET_EXCEEDED
    assert not shape.status
    assert np.isfinite(shape.buffer).all()
    assert "time" in shape.detail
    far = cs.Pose((0.2, -0.3, 0.4), (0.0, 0.0, 0.0, 1.0))
    moved = hurried.predict(START, far)
    assert moved.status is cs.Status.BUDGET_EXCEEDED
    assert np.isfinite(moved.buffer).all()
    assert cs.Predictor(CABLE, model="cosserat").predict(START, END).status is cs.Status.OK
    with pytest.raises(cs.ArgumentError, match="time_budget"):
        cs.Predictor(CABLE, model="cosserat", time_budget=0.0)
