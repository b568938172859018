"""Cables that were seen wound onto themselves: a fit follows the points, or is refused."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.calibration.cables_forward import CablesForward, forward_of, path_of
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.parameters import Parameters
from cable_shape.errors import ArgumentError
from cable_shape.solve.seen import laid_on, turns_of, writhe

TRUE = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)
SOLVED = cs.Scene(contact="solve")
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))


def ends(turns: float, chord: float = 0.3) -> tuple[cs.Pose, cs.Pose]:
    """Grips apart along x, the end turned about it."""
    turned = Rotation.from_rotvec((2.0 * math.pi * turns, 0.0, 0.0)) * ALONG_X
    return cs.Pose((0.0, 0.0, 0.0), ALONG_X.as_quat()), cs.Pose((chord, 0.0, 0.0), turned.as_quat())


@cache
def wound(sign: float = 1.0) -> cs.CableShape:
    """The cable wound by more than a turn, until a loop of it rests on it."""
    predictor = cs.Predictor(TRUE, model="cosserat", tolerance=1e-6, scene=SOLVED)
    for turns in np.linspace(0.3, 1.1, 81):
        shape = predictor.predict(*ends(sign * float(turns)))
    assert shape.status is cs.Status.OK
    assert [contact.body for contact in shape.contacts] == ["itself", "itself"]
    return shape


def seen(sign: float = 1.0, every: int = 5, noise: float = 1e-4, arcs: bool = True) -> cs.Observation:
    """Points of it, which scatter by `noise` [m]."""
    shape, rng = wound(sign), np.random.default_rng(every)
    points = shape.positions[every:-every:every]
    arc_length = shape.arc_length[every:-every:every] if arcs else None
    return cs.Observation(*ends(1.1 * sign), points + noise * rng.normal(size=points.shape), arc_length)


def stiffer(factor: float) -> cs.Cable:
    """A cable of the same ratio of bending to twisting stiffness."""
    return TRUE.replace(bending_stiffness=0.004 * factor, twisting_stiffness=0.003 * factor)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("factor", [0.4, 1.1, 3.0])
def test_its_stiffness_is_found(sign: float, factor: float) -> None:
    found = cs.calibrate([seen(sign)], stiffer(factor), scene=SOLVED, progress=False)
    assert found.converged
    assert len(found.remarks) == 1
    assert "1 observations show a cable on itself" in found.remarks[0]
    assert found.cable.mean_bending_stiffness == pytest.approx(TRUE.mean_bending_stiffness, rel=0.01)
    assert np.abs(found.distances).max() < 5e-4


def test_points_that_scatter_tell_it_within_the_errors_told() -> None:
    looks = [seen(sign, every, 2e-3) for sign in (1.0, -1.0) for every in (4, 7, 9)]
    found = cs.calibrate(looks, stiffer(1.5), scene=SOLVED, progress=False)
    told = found["bending_stiffness"]
    assert found.converged
    assert found.scale == pytest.approx(2e-3, rel=0.2)
    assert told.low < TRUE.mean_bending_stiffness < told.high < 1.5 * TRUE.mean_bending_stiffness


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_that_is_twisted_by_two_turns_more_is_found_where_its_turns_are_told(sign: float) -> None:
    """Not otherwise: nothing that is seen tells how often it has been turned, and a remark says what was assumed."""
    cable = TRUE.replace(twisting_stiffness=0.0008)
    predictor = cs.Predictor(cable, model="cosserat", tolerance=1e-6, scene=SOLVED)
    for turns in np.linspace(0.3, 3.0, 271):
        shape = predictor.predict(*ends(sign * float(turns)))
    assert shape.contacts
    assert abs(shape.twist) > 12.0
    assert shape.turns == turns_of(shape) == sign * 3
    start, end = ends(3.0 * sign)
    told = cs.Pose(end.position, end.quaternion, turns=round(3 * sign))
    points = shape.positions[5:-5:5] + 1e-4 * np.random.default_rng(3).normal(size=shape.positions[5:-5:5].shape)
    arc, begin = shape.arc_length[5:-5:5], cable.replace(bending_stiffness=0.006, twisting_stiffness=0.0012)
    found = cs.calibrate([cs.Observation(start, told, points, arc)], begin, scene=SOLVED, progress=False)
    assert found.converged
    assert not found.remarks
    assert found.cable.mean_bending_stiffness == pytest.approx(0.004, rel=0.01)
    guessed = cs.calibrate([cs.Observation(start, end, points, arc)], begin, scene=SOLVED, progress=False)
    assert abs(guessed.cable.mean_bending_stiffness / 0.004 - 1.0) > 0.1
    assert any("turns of its end's pose would tell" in remark for remark in guessed.remarks)


def test_turns_are_twist_and_writhe() -> None:
    """As the solver counts them on the way; a circle in a plane has no writhe, a helix 1 less the sine of its slope."""
    predictor = cs.Predictor(TRUE, model="cosserat", tolerance=1e-6, scene=SOLVED)
    for turns in np.linspace(0.1, 1.1, 41):
        shape = predictor.predict(*ends(float(turns)))
        assert turns_of(shape) == shape.turns
    angle = np.linspace(0.0, 2.0 * np.pi, 201)
    circle = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(201)))
    assert writhe(circle) == pytest.approx(0.0, abs=1e-9)
    around, pitch, radius = np.linspace(0.0, 80.0 * np.pi, 2001), 0.5, 0.05  # of 40 turns
    helix = np.column_stack((radius * np.cos(around), radius * np.sin(around), pitch * around / (2.0 * np.pi)))
    slope = pitch / math.hypot(pitch, 2.0 * np.pi * radius)
    assert writhe(helix) == pytest.approx(40.0 * (1.0 - slope), rel=0.03)
    assert writhe(helix * (1.0, 1.0, -1.0)) == pytest.approx(-writhe(helix), rel=1e-9)


def test_derivatives_are_differences() -> None:
    """Of the shape that rests on itself, by stiffness, length and grips."""
    parameters = Parameters(TRUE, ("bending_stiffness", "length", "end_offset", "roll"))
    forward = forward_of(parameters, [seen()], scene=SOLVED)
    assert isinstance(forward, CablesForward)
    at = parameters.start
    derivatives = forward.jacobian(at, forward.misses(at))
    assert forward.shapes(at)[0]["cable"].contacts
    for j, parameter in enumerate(parameters.each):
        step = np.zeros_like(at)
        step[j] = 0.1 * parameter.step
        wanted = (forward.misses(at + step) - forward.misses(at - step)) / (2.0 * step[j])
        np.testing.assert_allclose(derivatives[:, :, j], wanted, rtol=0.0, atol=0.03 * float(np.abs(wanted).max()))


def test_a_path_through_points_lies_as_the_cable_does() -> None:
    """The shape laid on it has the cable's places and frames, its twist included."""
    shape, look = wound(), seen(every=4)
    start, end = (cs.Grip(pose) for pose in ends(1.1))
    path = path_of(look, start, end, TRUE.length)
    assert path is not None
    laid = laid_on(path, start, end, TRUE.length, shape.points)
    np.testing.assert_allclose(laid.positions, shape.positions, atol=2e-3)
    assert laid.twist == pytest.approx(shape.twist, abs=0.02)
    apart = np.abs((laid.quaternions * shape.quaternions).sum(axis=1))
    assert 2.0 * np.arccos(np.minimum(apart, 1.0)).max() < 0.1
    for frame, grip in ((laid.quaternions[0], start), (laid.quaternions[-1], end)):
        assert abs(frame @ grip.cable_frame.quaternion) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("look", [{"arcs": False}, {"every": 25}])
def test_what_does_not_tell_how_it_is_wound_is_refused(look: dict[str, int]) -> None:
    """Also where the fit ends at a shape that is not wound, as one of a cable hundreds of times as stiff is."""
    what = r"observations\[1\]\.arc_length = .*8 points at least.*Give the arc"
    with pytest.raises(ArgumentError, match=what) as told:
        cs.calibrate([seen(), seen(**look)], stiffer(1.1), scene=SOLVED, progress=False)
    assert "contact='solve'" in str(told.value)


def test_a_cable_that_does_not_touch_itself_needs_no_arc_lengths() -> None:
    shape = cs.predict(TRUE, *ends(0.0, 0.7), model="cosserat", scene=SOLVED)
    look = cs.Observation(*ends(0.0, 0.7), shape.positions[5:-5:5])
    found = cs.calibrate([look], stiffer(1.2), scene=SOLVED, progress=False)
    assert found.cable.mean_bending_stiffness == pytest.approx(TRUE.mean_bending_stiffness, rel=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_cable_that_bows_on_a_table_is_found_on_the_side_on_which_it_lay(side: float) -> None:
    """From nothing it bows to one side, whichever it was led to."""
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.2)))
    scene, cable = cs.Scene(obstacles=[table], contact="solve"), cs.Cable(1.0, 0.05, 0.02, 0.016, diameter=0.008)
    predictor = cs.Predictor(cable, model="cosserat", tolerance=1e-6, scene=scene)
    for twist in (*np.linspace(0.5, 0.0, 11),):
        turned = (Rotation.from_rotvec((0.0, 0.0, sign * side * float(twist))) * ALONG_X for sign in (1.0, -1.0))
        held = [cs.Pose((x, 0.0, 0.0), q.as_quat()) for x, q in zip((-0.35, 0.35), turned, strict=True)]
        shape = predictor.predict(*held)
    assert side * shape.positions[75, 1] > 0.1
    points = shape.positions[6:-6:6] + 1e-4 * np.random.default_rng(2).normal(size=shape.positions[6:-6:6].shape)
    look = cs.Observation(held[0], held[1], points, shape.arc_length[6:-6:6])
    begin = cable.replace(bending_stiffness=0.03, twisting_stiffness=0.024)
    found = cs.calibrate([look], begin, scene=scene, progress=False)
    assert found.converged
    assert not found.remarks
    assert np.nanmax(found.distances) < 1e-3
    assert found.cable.mean_bending_stiffness == pytest.approx(0.02, rel=0.02)


def test_without_contact_solved_for_nothing_is_asked() -> None:
    parameters = Parameters(TRUE, ("bending_stiffness",))
    assert isinstance(forward_of(parameters, [seen()]), Forward)
    assert isinstance(forward_of(parameters, [seen()], scene=cs.Scene(contact="warn")), Forward)
