"""The Cosserat predictor over time: warm start, winding, snaps, overstretch, statuses, sensitivities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, END, GENERAL, LENGTH, START, moved, sensitivities, solved
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import cable_shape as cs
from cable_shape.cable.cable import Cable
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem


def test_a_warm_step_gives_the_cold_answer_in_fewer_iterations():
    state = Network(Problem(CABLE).move(START, END))
    cosserat.solve(state.problem, state)
    for k in range(1, 11):
        end = moved(END, (-0.005 * k, 0.002 * k, 0.0), (0.0, 0.01 * k, 0.0))
        warm = cosserat.solve(state.problem.move(START, end), state)
        assert warm.status is Status.OK
    cold = solved(CABLE, START, end)
    assert warm.iterations <= 4 < cold.iterations
    assert warm.positions == pytest.approx(cold.positions, abs=2e-5)
    assert warm.solve_time > 0.0


def test_a_problem_of_other_stiffness_starts_from_the_last_shape():
    state = Network(Problem(CABLE).move(START, END))
    cosserat.solve(state.problem, state)
    softer = CABLE.replace(bending_stiffness=0.009)
    warm = cosserat.solve(Problem(softer).move(START, END), state)
    assert warm.positions == pytest.approx(solved(softer, START, END).positions, abs=3e-5)


def test_turning_the_end_is_counted_and_twists_the_cable():
    cable = CABLE.replace(bending_stiffness=0.2, twisting_stiffness=0.05)
    end = Pose((1.1, 0, 0), ALONG_X)
    state = Network(Problem(cable).move(START, end))
    first = cosserat.solve(state.problem, state)
    for angle in np.linspace(0.0, 2 * math.pi, 13)[1:]:
        shape = cosserat.solve(state.problem.move(START, moved(end, turn=(angle, 0, 0))), state)
        assert shape.status is Status.OK
    assert shape.turns == 1
    assert abs(shape.twist - first.twist - 2 * math.pi) < 0.3
    for angle in np.linspace(2 * math.pi, 0.0, 13)[1:]:
        shape = cosserat.solve(state.problem.move(START, moved(end, turn=(angle, 0, 0))), state)
    assert shape.turns == 0
    assert shape.positions == pytest.approx(first.positions, abs=2e-5)


def test_a_cable_pushed_past_its_fold_snaps():
    """A weightless strip arched upwards, its ends tilted down until the arch must fall through."""
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=(1.0, 50.0), twisting_stiffness=50.0)
    state = None
    statuses = []
    for tilt in np.linspace(-0.8, 0.8, 33):
        start = moved(START, turn=(0, tilt, 0))
        end = moved(Pose((0.9, 0, 0), ALONG_X), turn=(0, -tilt, 0))
        problem = Problem(cable, gravity=(0, 0, 0)).move(start, end)
        state = state or Network(problem)
        shape = cosserat.solve(problem, state)
        statuses.append(shape.status)
        assert np.isfinite(shape.buffer).all()
    assert statuses.count(Status.SNAPPED) == 1
    assert statuses[0] is statuses[-1] is Status.OK
    assert shape.positions[75, 2] < -0.1


def test_a_small_snap_is_told_and_no_motion_on_the_way_to_it():
    """A strip bowed upwards falls through by 60 mm while its ends are drawn apart by 0.25 mm; then it is moved on."""
    weight, stiff = 0.981, 0.0392
    strip = Cable(1.0, weight / 9.81, (stiff, 50.0 * stiff), 50.0 * stiff)
    start = Pose((0, 0, 0), ALONG_X)
    problem = state = None
    for pull in (20.0, 5.0, 1.0, 0.0, -9.81):  # hung upwards, then let go
        problem = Problem(strip, gravity=(0.0, 0.0, pull)).move(start, Pose((0.982, 0, 0), ALONG_X))
        state = state or Network(problem)
        cosserat.solve(problem, state)
    middle, statuses = [], []
    for chord in np.arange(0.982, 0.996, 2.5e-4):
        shape = cosserat.solve(problem.move(start, Pose((chord, 0, 0), ALONG_X)), state)
        statuses.append(shape.status)
        middle.append(shape.positions[shape.points // 2, 2])
    jump = int(np.argmin(np.diff(middle))) + 1
    assert middle[jump] < -0.02 < 0.02 < middle[jump - 1]
    assert [k for k, status in enumerate(statuses) if status is not Status.OK] == [jump]
    assert statuses[jump] is Status.SNAPPED


@pytest.mark.parametrize("chord", [0.446, 0.514, 0.533, 0.553, 0.592, 0.611])
def test_a_weightless_cable_between_ends_in_line_bends_to_one_side(chord):
    """It may swing about the line freely: a neutral mode, which is not an unstable one. Nearer ends twist the plane."""
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=0.01, diameter=0.008)
    shape = cosserat.solve(Problem(cable).move(Pose((0, 0, 0), ALONG_X), Pose((chord, 0, 0), ALONG_X)))
    assert shape.status is Status.OK
    middle = shape.positions[shape.points // 2]
    # the elastica: its chord and its rise depend on its modulus alone
    m = brentq(lambda m: 2.0 * ellipe(m) / ellipk(m) - 1.0 - chord, 1e-6, 0.9)
    assert math.hypot(middle[1], middle[2]) == pytest.approx(math.sqrt(m) / ellipk(m), abs=2e-4)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-3])
@pytest.mark.parametrize("chord", [0.15, 0.5, 0.85])
@pytest.mark.parametrize("ratio", [1e-3, 2e-3, 5e-3])
def test_a_cable_next_to_limp_hangs_like_a_catenary(ratio, chord, tolerance):
    """From nothing, its ends bent sharply by the grips: a few boundary layers off the perfectly flexible cable."""
    EI = CABLE.linear_density * 9.81 * (ratio * LENGTH) ** 3
    cable = CABLE.replace(bending_stiffness=EI, twisting_stiffness=0.8 * EI)
    end = Pose(chord * LENGTH * END.position / np.linalg.norm(END.position), END.quaternion)
    shape = cosserat.solve(Problem(cable, tolerance=tolerance * LENGTH).move(START, end))
    assert shape.status is Status.OK
    limp = cs.predict(CABLE.replace(bending_stiffness=0.0), START, end, model="catenary")
    assert np.linalg.norm(shape.positions - limp.positions, axis=1).max() < 10.0 * ratio * LENGTH


@pytest.mark.parametrize("axial", [None, 1e3])
def test_a_sweep_through_overstretch_and_back(axial):
    cable = CABLE.replace(axial_stiffness=axial)
    state = Network(Problem(cable).move(START, Pose((0.05 * LENGTH, 0, 0), ALONG_X)))
    chords = np.concatenate((np.linspace(0.05, 1.05, 41), np.linspace(1.05, 0.05, 41)))
    seen = {}
    for i, chord in enumerate(chords):
        shape = cosserat.solve(state.problem.move(START, Pose((chord * LENGTH, 0, 0), ALONG_X)), state)
        assert np.isfinite(shape.buffer).all()
        if axial is None and chord >= 1.0:
            assert shape.status is Status.OVERSTRETCHED
            assert "further apart" in shape.detail
            assert shape.positions[-1] == pytest.approx((chord * LENGTH, 0, 0))
        else:
            assert shape.status is Status.OK, (chord, shape)
            if i < 41:
                seen[round(chord, 6)] = shape.positions
            elif round(chord, 6) in seen:
                # out of its plane the slack cable may bulge to either side
                before = seen[round(chord, 6)]
                side = np.sign(before[30, 1] * shape.positions[30, 1]) or 1.0
                assert shape.positions * (1.0, side, 1.0) == pytest.approx(before, abs=5e-5)
    if axial is not None:
        assert shape.error_estimate < 1e-5 * LENGTH


# -- status


def test_a_column_above_its_buckling_load_is_not_called_stable_upright():
    """Euler: pi^2/4 EI/L^2. Below it the column stays straight, above it it buckles."""
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=1.0)
    up = Pose((0, 0, 0))
    critical = math.pi**2 / 4
    below = solved(cable, up, FreeEnd(force=(0, 0, -0.99 * critical)))
    above = solved(cable, up, FreeEnd(force=(0, 0, -1.05 * critical)))
    assert below.status is Status.OK
    assert np.abs(below.positions[:, :2]).max() < 1e-9
    assert above.status is Status.OK
    assert np.linalg.norm(above.positions[-1, :2]) > 0.1


def test_a_deadline_that_has_passed_is_graded():
    fine = Problem(CABLE, tolerance=1e-9).move(START, END)  # needs a second mesh
    late = cosserat.solve(fine, deadline=0.0)
    assert late.status is Status.BUDGET_EXCEEDED
    assert not late.status
    assert 1e-9 < late.error_estimate < 1e-3
    assert cosserat.solve(fine, deadline=math.inf).status is Status.OK
    enough = cosserat.solve(Problem(CABLE, tolerance=0.01).move(START, END), deadline=0.0)
    assert enough.status in (Status.OK, Status.BUDGET)


def test_a_tolerance_that_no_mesh_meets_is_said():
    shape = solved(CABLE, START, END, tolerance=1e-17)
    assert shape.status is Status.NOT_CONVERGED
    assert "tolerance" in shape.detail


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: solved(CABLE.replace(bending_stiffness=0.0, twisting_stiffness=0.0), START, END), "catenary"),
        (lambda: cosserat.sensitivity(Network(Problem(CABLE))), "predict first"),
    ],
)
def test_bad_arguments_name_the_remedy(make, words):
    with pytest.raises(ArgumentError, match=words):
        make()


# -- sensitivity


@pytest.mark.parametrize(
    "kinds", [("clamped", "clamped"), ("swivel", "swivel"), ("clamped", "pinned"), ("swivel", "free")]
)
def test_sensitivity_against_finite_differences(kinds):
    state = Network(Problem(GENERAL, points=21, tolerance=1e-8))
    found, differences = sensitivities(cosserat, state, kinds)
    assert found == pytest.approx(differences, abs=2e-4)


def test_sensitivity_at_the_gripper_includes_its_offset():
    offset = Pose((0.0, 0.05, 0.1), (0.0, 0.6, 0.0, 0.8))
    tool = Pose((0.6, 0.2, -0.1), (0.1, 0.7, 0.1, 0.7))
    grip = Grip(Pose(tool.position, tool.quaternion / np.linalg.norm(tool.quaternion)), offset=offset)
    state = Network(Problem(CABLE, points=11, tolerance=1e-8))

    def positions(turn) -> np.ndarray:
        return cosserat.solve(state.problem.move(START, grip.at(moved(grip.pose, turn=turn))), state).positions

    positions(np.zeros(3))
    J = cosserat.sensitivity(state, at="gripper")
    for axis, turn in enumerate(2e-5 * np.eye(3)):
        difference = (positions(turn) - positions(-turn)) / 4e-5
        assert J[:, :, 9 + axis] == pytest.approx(difference, abs=2e-4)


@pytest.mark.parametrize("tension", [0.0, 100.0])
def test_the_flag_of_a_twisted_rod_flips_at_greenhills_moment(tension):
    """Clamped rod of EI = L = 1: M = 8.98682 without tension, 20.98350 at T = 100 (roots of its exact condition)."""
    critical, stretch = {0.0: 8.986819, 100.0: 20.983501}[tension], 1e5
    cable = Cable(1.0, 0.0, 1.0, 0.8, axial_stiffness=stretch)
    for factor, status in ((0.99, Status.OK), (1.01, Status.UNSTABLE)):
        twist = factor * critical / 0.8

        def frames(s, twist=twist):
            return np.stack((0 * s, 0 * s, np.sin(0.5 * twist * s), np.cos(0.5 * twist * s)), axis=1)

        end = Pose((0, 0, 1 + tension / stretch), frames(np.ones(1))[0])
        problem = Problem(cable, tolerance=1e-3).move(Pose(), end)
        shape = cosserat.solve_beside(problem, Network(problem), frames, (0, 0, tension))
        assert shape.status is status
        assert shape.moment[:, 2] == pytest.approx(np.full(shape.points, 0.8 * twist), rel=1e-6)
        if status is Status.UNSTABLE:
            assert "eigenvalue" in shape.detail


def test_a_cable_that_buckles_out_of_its_plane_goes_on_along_its_branch():
    """Between level ends that come together it swings out to one side: fast, but without a jump."""
    cable = Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
    state, aside = None, []
    problem = Problem(cable)
    for chord in np.linspace(0.995, 0.05, 189):
        problem.move(Pose((0, 0, 0), ALONG_X), Pose((1.2 * chord, 0, 0), ALONG_X))
        state = state or Network(problem)
        shape = cosserat.solve(problem, state)
        assert shape.status is Status.OK
        aside.append(np.abs(shape.positions[:, 1]).max())
    assert max(aside[:100]) < 1e-6
    assert max(aside) > 0.02
