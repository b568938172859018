"""model="auto": which model it takes, how honest its estimates are, that it does not flicker and keeps the branch."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import cable_shape as cs
from cable_shape.models import cosserat
from cable_shape.models.auto import ENTER, LATEST, Auto
from cable_shape.models.judge import SAFETY, Judge
from cable_shape.models.rod_state import RodState
from cable_shape.pose import multiply
from cable_shape.problem import Problem
from cable_shape.solvers import Rod

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


def taut_grasp(rng: np.random.Generator) -> tuple[cs.Cable, cs.Pose, cs.Pose]:
    """Slack 3e-5 to 0.2 of the length, ends near the chord, (EI/w)^(1/3) from 0.01 to 0.3 L: closed forms' ground."""
    bend = 0.981 * (LENGTH * np.exp(rng.uniform(np.log(0.01), np.log(0.3)))) ** 3
    chord = rng.normal(size=3)
    chord /= np.linalg.norm(chord)
    ends = []
    for place in (np.zeros(3), (1.0 - 10.0 ** rng.uniform(-4.5, -0.7)) * LENGTH * chord):
        tangent = chord + rng.choice((0.02, 0.1, 0.3)) * rng.normal(size=3)
        frame, _ = Rotation.align_vectors([tangent / np.linalg.norm(tangent)], [(0.0, 0.0, 1.0)])
        ends.append(cs.Pose(place, (frame * Rotation.from_rotvec((0.0, 0.0, rng.uniform(-3.0, 3.0)))).as_quat()))
    return cable(bend), ends[0], ends[1]


# -- choice


@pytest.mark.parametrize(
    ("stiffness", "chord", "model"),
    [(1e-7, 0.9, "catenary"), (1e-4, 0.98, "gradient4"), (1e-4, 0.9, "cosserat"), (1e-2, 0.7, "cosserat")],
)
def test_the_cheapest_sufficient_model_answers_and_says_how_far_off_it_is(stiffness, chord, model) -> None:
    shape = cs.predict(cable(stiffness), START, level(chord))
    assert shape.model == model
    assert shape.status is cs.Status.OK
    assert shape.error_estimate <= TOLERANCE
    error = apart(shape, exact(cable(stiffness), START, level(chord)))
    assert error <= shape.error_estimate
    if model != "cosserat":
        assert shape.error_estimate <= 2.0 * error


def test_a_tolerance_that_a_closed_form_misses_is_met_by_the_rod() -> None:
    rope, end = cable(1e-4), level(0.98)
    loose = cs.predict(rope, START, end)
    tight = cs.predict(rope, START, end, tolerance=0.5 * loose.error_estimate)
    assert (loose.model, tight.model) == ("gradient4", "cosserat")
    assert tight.error_estimate <= 0.5 * loose.error_estimate


@pytest.mark.parametrize(
    ("limits", "models"),
    [
        ({}, {"catenary", "gradient4"}),
        ({"min_bend_radius": 0.05}, {"gradient4", "cosserat"}),
        ({"max_twist_rate": 1.0}, {"cosserat"}),
        ({"max_tension": 0.9}, {"cosserat"}),
        ({"max_tension": 9.0}, {"catenary", "gradient4"}),
    ],
)
def test_a_limit_that_a_closed_form_does_not_know_keeps_it_out(limits, models) -> None:
    """A catenary has no bent ends and neither has twist; tension is 0.7 to 1.2 N here."""
    found = {cs.predict(cable(EI, **limits), START, level(c)).model for EI, c in ((1e-7, 0.93), (1e-4, 0.97))}
    assert found == models


def test_clips_and_windings_are_the_rods() -> None:
    rope = cable(1e-5)
    assert cs.predict(rope, START, level(0.97)).model != "cosserat"
    wound = cs.predict(rope, START, level(0.97, turns=1))
    assert (wound.model, wound.turns) == ("cosserat", 1)


def test_few_points_are_points_of_the_same_shape() -> None:
    rope, end = cable(1e-4), level(0.98)
    few, many = cs.predict(rope, START, end, points=11), cs.predict(rope, START, end, points=101)
    assert few.model == many.model == "gradient4"
    assert few.points == 11
    for name in ("arc_length", "positions", "quaternions", "curvature", "force", "moment"):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[::10], err_msg=name)
    assert few.error_estimate == many.error_estimate


# -- the judge


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


def test_estimates_are_honest_and_not_wasteful() -> None:
    """Asked: the true error is at most the estimate in 99 %, the estimate at most 10 times as much in 80 %."""
    rng = np.random.default_rng(5)
    ratios, chosen = [], Counter()
    while len(ratios) < 100:
        rope, start, end = taut_grasp(rng)
        shape = cs.predict(rope, start, end)
        chosen[shape.model] += 1
        if shape.model != "cosserat":
            assert shape.status is cs.Status.OK
            error = apart(shape, exact(rope, start, end))
            assert error <= TOLERANCE
            ratios.append(shape.error_estimate / error)
    ratio = np.array(ratios)
    assert (ratio >= 1.0).sum() >= 99
    assert (ratio <= 10.0).sum() >= 80
    assert min(chosen["catenary"], chosen["gradient4"]) > 15, chosen


def test_estimates_are_honest_for_all_kinds_of_ends_and_loads() -> None:
    rng = np.random.default_rng(6)
    ratios, seen = [], Counter()
    for what in itertools.islice(
        itertools.cycle(("pinned", "swivel", "mass", "load", "rest", "flat", "EA", "free")), 240
    ):
        rope, start, end = taut_grasp(rng)
        keywords = {}
        if what in ("pinned", "swivel"):
            end = cs.Grip(end, kind=what)
        elif what == "mass":
            keywords["scene"] = cs.Scene(masses=[cs.PointMass(rng.uniform(0.1, 0.9) * LENGTH, 0.02)])
        elif what == "load":
            keywords["distributed_load"] = 0.3 * rng.normal(size=(2, 3))
        elif what == "rest":
            rope = rope.replace(rest_curvature=0.2 * rng.normal(size=3))
        elif what == "flat":
            rope = rope.replace(bending_stiffness=(rope.mean_bending_stiffness, 3.0 * rope.mean_bending_stiffness))
        elif what == "EA":
            rope = rope.replace(axial_stiffness=200.0)
        else:
            end = cs.FreeEnd(mass=rng.uniform(0.1, 3.0))
        shape = cs.predict(rope, start, end, **keywords)
        if shape.model != "cosserat":
            seen[what] += 1
            truth = cs.predict(rope, start, end, model="cosserat", tolerance=1e-7 * LENGTH, **keywords)
            if truth.status is cs.Status.OK:
                ratios.append(shape.error_estimate / apart(shape, truth))
    assert len(seen) == 8, seen
    assert len(ratios) > 100
    assert np.mean(np.array(ratios) >= 1.0) >= 0.99
    assert np.mean(np.array(ratios) <= 10.0) >= 0.8


# -- along a motion


def models(predictor: cs.Predictor, chords: np.ndarray) -> list[str]:
    return [predictor.predict(START, level(c)).model for c in chords]


def switches(sequence: list[str]) -> int:
    return sum(a != b for a, b in itertools.pairwise(sequence))


def test_a_closed_form_is_kept_to_the_tolerance_and_taken_again_well_below_it() -> None:
    """The catenary's error passes the tolerance at 0.955 L, and the gradient cable's half of it at 0.966 L."""
    rope = cable(5e-6)
    last, first = (cs.predict(rope, START, level(c)) for c in (0.956, 0.9665))
    assert last.model == first.model == "catenary"
    assert 0.9 * TOLERANCE < last.error_estimate <= TOLERANCE
    assert first.error_estimate > ENTER * TOLERANCE
    predictor = cs.Predictor(rope)
    out = np.linspace(0.985, 0.935, 201)
    there, back = models(predictor, out), models(predictor, out[::-1])
    assert switches(there) == 1
    assert out[there.index("cosserat")] == pytest.approx(0.955, abs=0.001)
    assert switches(back) == 1
    assert 0.965 < out[::-1][back.index("gradient4")] <= 0.966 + 0.00025 * (LATEST + 1)


@pytest.mark.parametrize("middle", [0.946, 0.955, 0.96, 0.966, 0.983])
@pytest.mark.parametrize("first", [0.99, 0.93])
def test_a_motion_that_hovers_does_not_flicker(middle: float, first: float) -> None:
    """Around both thresholds and between them, whichever model came first: at most one change."""
    predictor = cs.Predictor(cable(5e-6))
    models(predictor, np.linspace(first, middle, 40))
    hovering = middle + 0.004 * np.sin(0.7 * np.arange(200))
    assert switches(models(predictor, hovering)) <= 1


def test_a_warm_rod_that_is_as_cheap_is_preferred() -> None:
    """Boundary layers above 2.5e-3 of the length: few elements. Cold the closed form is cheaper."""
    predictor = cs.Predictor(cable(1e-4))
    sequence = models(predictor, 0.98 - 1e-4 * np.arange(60))
    assert sequence[0] == "gradient4"
    assert set(sequence[1:]) == {"cosserat"}


def test_slack_taut_slack_ends_on_the_branch_of_the_rod() -> None:
    """Ends turned at random while slack, where several stable shapes exist; closed forms answer in between."""
    rng = np.random.default_rng(8)
    answered = Counter()
    for stiffness in (2e-6, 5e-6, 1e-5, 2e-5):
        rope = cable(stiffness)
        way = [
            ((0.5, 0.3, 0.2), Rotation.from_rotvec(rng.normal(size=3)) * ALONG_X),
            ((1.18, 0.05, 0.05), Rotation.from_rotvec(0.05 * rng.normal(size=3)) * ALONG_X),
            ((1.175, 0.05, 0.05), Rotation.from_rotvec(0.05 * rng.normal(size=3)) * ALONG_X),
            ((0.6, -0.2, -0.3), Rotation.from_rotvec(rng.normal(size=3)) * ALONG_X),
        ]
        auto, rod = cs.Predictor(rope), cs.Predictor(rope, model="cosserat")
        for (p, q), (p1, q1) in itertools.pairwise(way):
            between = Slerp((0.0, 1.0), Rotation.concatenate((q, q1)))
            for t in np.linspace(0.0, 1.0, 50):
                end = cs.Pose((1.0 - t) * np.array(p) + t * np.array(p1), between(t).as_quat())
                shape, truth = auto.predict(START, end), rod.predict(START, end)
                answered[shape.model] += 1
                assert shape.status is truth.status is cs.Status.OK
                if shape.model != "cosserat":
                    assert apart(shape, truth) <= shape.error_estimate + truth.error_estimate
                assert apart(shape, truth) < 2.0 * TOLERANCE, "another branch"
        assert shape.model == "cosserat"
        assert shape.turns == truth.turns
        assert shape.twist == pytest.approx(truth.twist, abs=0.2)
    assert answered["catenary"] + answered["gradient4"] > 100, answered


def test_a_cable_that_is_being_wound_goes_over_to_the_rod_and_comes_back() -> None:
    rope = cable(3e-6)
    auto, rod = cs.Predictor(rope), cs.Predictor(rope, model="cosserat")
    found = []
    for roll in np.pi * np.concatenate((np.linspace(0.0, 1.6, 60), np.linspace(1.6, 1e-3, 120))):
        end = level(0.97, roll)
        shape, truth = auto.predict(START, end), rod.predict(START, end)
        found.append((shape.model, truth.turns))
        assert apart(shape, truth) < 2.0 * TOLERANCE
        if shape.model == "cosserat":
            assert shape.turns == truth.turns
            assert shape.twist == pytest.approx(truth.twist, abs=0.2)
    assert {model for model, turns in found if turns != 0} == {"cosserat"}
    assert "cosserat" not in (found[0][0], found[-1][0])


def test_a_rod_wound_in_a_way_that_its_ends_do_not_tell_is_not_left_for_a_closed_form() -> None:
    """Two whole turns of twist bring the end frame back, quaternion and all; the centreline hardly knows of them."""
    rope, rod = cable(3e-6), Rod()
    auto, problem = Auto(rod), Problem(rope, tolerance=TOLERANCE)
    assert auto.solve(problem.move(START, level(0.7))).model == "cosserat"
    assert rod.state is not None

    def frames(s: np.ndarray) -> np.ndarray:
        q = np.array([(0.0, 0.0, np.sin(x), np.cos(x)) for x in 2.0 * np.pi * s / LENGTH])
        return np.array([multiply(START.quaternion, p) for p in q])

    wound = cosserat.solve_beside(problem.move(START, level(0.97)), rod.state, frames, (2.0, 0.0, 0.6))
    assert wound.status is cs.Status.OK
    assert wound.turns == 0
    assert wound.twist == pytest.approx(4.0 * np.pi, abs=0.5)
    for chord in np.linspace(0.97, 0.98, 60):
        shape = auto.solve(problem.move(START, level(chord)))
        assert shape.model == "cosserat"
        assert shape.twist == pytest.approx(4.0 * np.pi, abs=0.5)


def test_ends_that_jump_are_followed_by_the_rod() -> None:
    """The same cable a fifth of a turn further on could have taken any way there; in small steps it is the same one."""
    rope, turn = cable(3e-6), Rotation.from_rotvec((0.0, 0.0, 0.4 * np.pi))
    there = [
        cs.Pose(turn.apply(pose.position.copy()), (turn * Rotation.from_quat(pose.quaternion)).as_quat())
        for pose in (START, level(0.97))
    ]
    assert cs.predict(rope, *there).model == "catenary"
    jumping = cs.Predictor(rope)
    assert jumping.predict(START, level(0.97)).model == "catenary"
    shape = jumping.predict(*there)
    assert shape.model == "cosserat"
    assert shape.status is cs.Status.OK
    assert apart(shape, exact(rope, *there)) < 2.0 * TOLERANCE


def test_reset_forgets_which_model_was_in_use() -> None:
    """Between the thresholds the rod is kept when warm, and the closed form is taken when cold."""
    predictor = cs.Predictor(cable(5e-6))
    predictor.predict(START, level(0.93))
    assert predictor.predict(START, level(0.96)).model == "cosserat"
    predictor.reset()
    with pytest.raises(cs.ArgumentError, match="Call predict first"):
        predictor.sensitivity()
    assert predictor.predict(START, level(0.96)).model == "catenary"


def test_a_new_scene_is_judged_anew() -> None:
    predictor = cs.Predictor(cable(5e-6))
    end = level(0.98)
    assert predictor.predict(START, end).model == "catenary"
    predictor.scene = cs.Scene(masses=[cs.PointMass(0.3, 0.5)])
    shape = predictor.predict(START, end)
    truth = exact(cable(5e-6), START, end, scene=predictor.scene)
    assert apart(shape, truth) <= TOLERANCE


def test_the_same_ends_give_the_same_shape_again() -> None:
    predictor = cs.Predictor(cable(1e-4))
    first = predictor.predict(START, level(0.98))
    again = predictor.predict(START, level(0.98))
    assert again.reused
    assert again.model == "gradient4"
    assert again.buffer is first.buffer


def test_an_overstretched_cable_is_a_status_and_the_way_back_is_open() -> None:
    predictor = cs.Predictor(cable(1e-4))
    chords = (0.99, 0.999, 1.001, 1.01, 0.999, 0.99, 0.985, 0.98)
    shapes = [predictor.predict(START, level(c)) for c in chords]
    beyond = [shape.status is cs.Status.OVERSTRETCHED for shape in shapes]
    assert beyond == [c > 1.0 for c in chords]
    assert all(shape.status is cs.Status.OK for shape, c in zip(shapes, chords, strict=True) if c < 1.0)


# -- sensitivities


@pytest.mark.parametrize(("stiffness", "chord", "model"), [(1e-6, 0.95, "catenary"), (1e-5, 0.966, "gradient4")])
def test_sensitivity_is_that_of_the_rod_beside_a_closed_form(stiffness, chord, model) -> None:
    """Against central differences of the rod, whichever model answered; before and after the next shape."""
    rope, end = cable(stiffness), cs.Pose((chord * LENGTH, 0.1, 0.0), ALONG_X.as_quat())
    auto = cs.Predictor(rope, points=31)
    for there in (end, cs.Pose(end.position + np.array((0.0, 0.004, 0.0)), end.quaternion)):
        assert auto.predict(START, there).model == model
        jacobian = auto.sensitivity()
        rod = cs.Predictor(rope, model="cosserat", points=31, tolerance=1e-8 * LENGTH)
        rod.predict(START, there)
        for column in (0, 2, 4, 7, 8, 10):
            shapes = []
            for sign in (1e-5, -1e-5):
                twist = np.zeros(12)
                twist[column] = sign
                ends = [
                    cs.Pose(
                        pose.position + move[:3],
                        (Rotation.from_rotvec(move[3:]) * Rotation.from_quat(pose.quaternion)).as_quat(),
                    )
                    for pose, move in ((START, twist[:6]), (there, twist[6:]))
                ]
                shapes.append(rod.predict(*ends).positions)
            difference = (shapes[0] - shapes[1]) / 2e-5
            np.testing.assert_allclose(jacobian[:, :, column], difference, atol=0.02, err_msg=f"column {column}")


def test_asking_for_sensitivities_changes_no_shape() -> None:
    asked, silent = (cs.Predictor(cable(5e-6)) for _ in range(2))
    for chord in np.linspace(0.985, 0.935, 40):
        a, b = asked.predict(START, level(chord)), silent.predict(START, level(chord))
        assert asked.sensitivity().shape == (150, 3, 12)
        assert a.model == b.model
        np.testing.assert_allclose(a.positions, b.positions, atol=0.0 if a.model != "cosserat" else 2.0 * TOLERANCE)
