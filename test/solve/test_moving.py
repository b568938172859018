"""A cable in motion as one at rest under loads: drag, and a moment that lags behind the curvature."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError
from cable_shape.solve.moving import lag_of
from cable_shape.solve.problem import Problem

ALONG_X = (0.5, 0.5, 0.5, 0.5)
START, END = cs.Pose((0, 0, 1), ALONG_X), cs.Grip(cs.Pose((0.6, 0.1, 1.0), ALONG_X), "swivel")
CABLE = cs.Cable(length=0.9, linear_density=0.05, bending_stiffness=0.004, retardation_time=0.08, drag=0.02)
SHARES = np.linspace(0.0, 1.0, 41)


def swung(size: float = 0.5) -> np.ndarray:
    """(41, 6): accelerations and velocities of a cable that swings between its ends."""
    bump = np.sin(math.pi * SHARES)[:, None] ** 2
    return np.concatenate((bump * (1.0, -2.0, 0.5), size * bump * (0.2, 1.0, -0.3)), axis=1)


def test_a_straight_beam_bends_by_retardation_time_times_velocity() -> None:
    """EI y'''' = -tau EI v'''' between clamped ends, where v and v' are 0: y = -tau v, whatever v is in between."""
    cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.5, axial_stiffness=1.0, retardation_time=0.1)
    s = np.linspace(0.0, 1.0, 101)
    speed = 1e-4 * (s * (1.0 - s)) ** 2 * np.sin(4.0 * s + 1.0) / 0.03
    moving = np.zeros((101, 6))
    moving[:, 4], moving[:, 5] = speed, -0.5 * speed
    ends = cs.Pose((0, 0, 0), ALONG_X), cs.Pose((1.0, 0, 0), ALONG_X)
    shape = cs.predict(
        cable, *ends, model="cosserat", gravity=(0, 0, 0), points=101, acceleration=moving, tolerance=1e-9
    )
    assert shape.status is cs.Status.OK
    np.testing.assert_allclose(shape.positions[:, 1:], -0.1 * moving[:, 4:], atol=0.01 * 0.1 * np.abs(speed).max())


def test_drag_is_a_load_against_the_velocity() -> None:
    cable = CABLE.replace(retardation_time=0.0)
    moving = swung()
    moving[:, 3:] = (0.4, -0.3, 0.2)
    shape = cs.predict(cable, START, END, acceleration=moving)
    force = -0.02 * np.array((0.4, -0.3, 0.2))
    same = cs.predict(cable, START, END, acceleration=moving[:, :3], distributed_load=(force, force))
    np.testing.assert_allclose(shape.positions, same.positions, atol=1e-9)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_damping_takes_the_power_that_its_moment_does(seed: int) -> None:
    """Of velocities v that keep lengths: integral f v = -integral tau EI |dw/ds across|^2, whatever the shape is.

    v and its slope are 0 at both ends; the sections' spin is not told by v, and has no part in the load of an isotropic
    cable that turns as a whole, but for where the moment acts on what the cable bends already.
    """
    rng = np.random.default_rng(seed)
    cable = CABLE.replace(rest_curvature=4.0 * rng.normal(size=(5, 3)) * (1, 1, 0), drag=0.0)
    shape = cs.predict(cable, START, END, points=801)
    s, length = shape.arc_length, shape.length
    # dw/ds from a field of turns across the tangent, w; v' = w x t; made to come home with v = 0 by three waves
    t = shape.tangents
    waves = np.stack([np.sin(k * math.pi * s / length) ** 2 for k in range(1, 7)])
    fields = [wave[:, None] * axis for wave in waves for axis in np.eye(3)]
    slopes = np.stack([np.cross(field, t) for field in fields])
    ends = np.trapezoid(slopes, s, axis=1)  # (18, 3)
    mix = np.linalg.svd(ends.T)[2][3:].T @ rng.normal(size=15)
    slope = np.tensordot(mix, slopes, axes=1)
    v = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * np.diff(s)[:, None] * (slope[1:] + slope[:-1]), axis=0)))
    rows = np.linspace(0.0, length, 161)
    speed = CubicSpline(s, v)(rows)
    problem = Problem(cable, acceleration=np.concatenate((np.zeros_like(speed), speed), axis=1), points=801)
    load = CubicSpline(rows, lag_of(shape, problem))(s)
    power = np.trapezoid(np.einsum("ij,ij->i", load, v), s)
    w = np.cross(t, slope)
    spin = -np.einsum("ij,ij->i", np.gradient(w, s, axis=0), t)
    spin = np.concatenate(((0.0,), np.cumsum(0.5 * np.diff(s) * (spin[1:] + spin[:-1]))))
    change = np.gradient(w + spin[:, None] * t, s, axis=0)
    across = change - np.einsum("ij,ij->i", change, t)[:, None] * t
    own = np.gradient(w, s, axis=0)
    work = -np.trapezoid(np.einsum("ij,ij->i", across, own), s)
    assert power == pytest.approx(work, rel=0.03)


def test_a_cable_that_turns_as_a_whole_is_not_damped() -> None:
    cable = CABLE.replace(drag=0.0)
    shape = cs.predict(cable, START, END, points=201)
    turning = np.array((0.0, 0.7, -0.4))  # across the start, which then does not spin
    assert abs(turning @ shape.tangents[0]) < 1e-12
    at = np.linspace(0.0, shape.length, 41)
    speed = np.cross(turning, CubicSpline(shape.arc_length, shape.positions)(at)) + np.array((0.1, 0.2, 0.3))
    off = []
    for velocity in (speed, swung()[:, 3:]):
        moving = np.concatenate((np.zeros_like(velocity), velocity), axis=1)
        off.append(np.abs(cs.predict(cable, START, END, points=201, acceleration=moving).positions - shape.positions))
    assert off[1].max() > 0.01
    assert off[0].max() < 0.01 * off[1].max()


def test_the_roll_of_the_grips_has_no_part_in_it() -> None:
    rolled = [Rotation.from_rotvec((0, 0, angle)).as_quat() for angle in (1.1, -0.6)]
    swivels = cs.Grip(START, "swivel"), END
    others = [cs.Grip(g.pose * cs.Pose((0, 0, 0), q), "swivel") for g, q in zip(swivels, rolled, strict=True)]
    shapes = [cs.predict(CABLE, *ends, acceleration=swung()) for ends in (swivels, others)]
    np.testing.assert_allclose(shapes[1].positions, shapes[0].positions, atol=1e-5)
    still = cs.predict(CABLE, *swivels, acceleration=swung()[:, :3])
    assert np.abs(shapes[0].positions - still.positions).max() > 5e-3


def test_it_is_the_same_from_nothing_and_followed_and_for_sections() -> None:
    predictor = cs.Predictor(CABLE)
    for size in (0.3, 0.45, 0.5):
        shape = predictor.predict(START, END, acceleration=swung(size))
    alone = cs.predict(CABLE, START, END, acceleration=swung(0.5))
    np.testing.assert_allclose(shape.positions, alone.positions, atol=2e-5)
    again = predictor.predict(START, END, acceleration=swung(0.5))
    assert again.reused
    two = CABLE.replace(sections=[cs.Section(0.3, 0.6, bending_stiffness=0.004, drag=0.02, retardation_time=0.08)])
    apart = cs.predict(two, START, END, acceleration=swung(0.5))
    np.testing.assert_allclose(apart.positions, alone.positions, atol=2e-5)


def test_batches_and_harnesses_take_accelerations_only() -> None:
    start = np.concatenate((START.position, ALONG_X))[None]
    with pytest.raises(ArgumentError, match="a batch takes accelerations only"):
        cs.predict_batch(CABLE, start, start + np.eye(7)[:1], acceleration=np.zeros((5, 6)))
    harness = cs.Harness({"a": CABLE})
    with pytest.raises(ArgumentError, match="a harness takes accelerations only"):
        cs.predict(harness, {"a.start": START, "a.end": END}, acceleration={"a": np.zeros((5, 6))})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"acceleration": np.zeros((3, 6))}, r"shape \(3, 6\)"),
        ({"acceleration": np.zeros((5, 4))}, r"\(3,\), \(m, 3\) or \(m, 6\)"),
        ({"points": 20}, "points = 20"),
        ({"end": None}, "end.kind = 'free'"),
        ({"start": cs.Grip(START, "pinned")}, "start.kind = 'pinned'"),
        ({"model": "gradient4"}, "knows no retardation time"),
        ({"cable": CABLE.replace(linear_density=0.0)}, "linear_density"),
    ],
)
def test_what_is_not_known_of_moving_cables_is_refused(change: dict[str, Any], words: str) -> None:
    usual = {"cable": CABLE, "start": START, "end": END, "acceleration": np.zeros((5, 6))} | change
    with pytest.raises(ArgumentError, match=words):
        cs.predict(usual.pop("cable"), usual.pop("start"), usual.pop("end"), **usual)
