"""The rod in clips from one shape to the next: warm, in small steps, from nothing, snaps, deadlines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from clips import WEIGHT, arrays, on_the_free_shape
from rods import ALONG_X, CABLE, END, START, integrated_residual, moved, solved
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.pose import FreeEnd, Pose
from cable_shape.scene.scene import Clip, PointMass, Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.search import Search
from cable_shape.solve.starts import guessed

# -- over time


def test_moving_ends_and_clips_are_followed_warm():
    """Grips and clips move together, then the clips alone; the answer is that of a cold start."""
    predictor = cs.Predictor(CABLE, model="cosserat", scene=on_the_free_shape((60, "ball"), (160, "fixed")))
    predictor.predict(START, END)
    iterations = []
    for k in range(1, 11):
        shift = np.array((0.002, -0.003, 0.002)) * k
        predictor.scene = on_the_free_shape((60, "ball"), (160, "fixed"), shift=shift)
        shape = predictor.predict(START, moved(END, 0.5 * shift))
        assert shape.status is Status.OK
        iterations.append(shape.iterations)
    assert max(iterations) <= 5
    cold = solved(CABLE, START, moved(END, 0.5 * shift), scene=predictor.scene)
    assert cold.iterations > 5
    assert shape.positions == pytest.approx(cold.positions, abs=2e-5)
    assert predictor.predict(START, moved(END, 0.5 * shift)).reused


def test_other_clips_start_from_the_last_shape():
    """A wound cable stays wound when clips are added, moved along it or changed in kind."""
    cable = CABLE.replace(bending_stiffness=0.4, twisting_stiffness=0.05)
    far = Pose((1.1, 0, 0), ALONG_X, turns=1)
    predictor = cs.Predictor(cable, model="cosserat", gravity=(0, 0, 0))
    wound = predictor.predict(START, far)
    assert abs(wound.twist) > 5.0
    for kind, i in (("ball", 50), ("fixed", 50), ("fixed", 90), ("hinge", 91)):
        clip = Clip(wound.arc_length[i], Pose(wound.positions[i], wound.quaternions[i]), kind)
        predictor.scene = Scene(clips=[clip])
        shape = predictor.predict(START, far)
        assert shape.status is Status.OK
        assert shape.turns == 1
        assert shape.twist == pytest.approx(wound.twist, abs=0.02)
        assert shape.positions == pytest.approx(wound.positions, abs=3e-5)


def test_masses_may_come_and_go():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=on_the_free_shape((60, "ball"), (160, "fixed")))
    predictor.predict(START, END)
    for masses in ((PointMass(0.55, 0.05),), (PointMass(0.55, 0.05), PointMass(0.3, 0.02)), ()):
        predictor.scene = predictor.scene.replace(masses=masses)
        shape = predictor.predict(START, END)
        cold = solved(CABLE, START, END, scene=predictor.scene)
        assert shape.status is Status.OK
        assert shape.positions == pytest.approx(cold.positions, abs=2e-5)
        assert shape.energy == pytest.approx(cold.energy, abs=1e-5)


def test_what_no_guess_leads_to_is_approached_from_a_straight_cable():
    """A loop back through a clip that points the other way."""

    def pose(position, *q: float) -> Pose:
        return Pose(position, Rotation.from_quat(q).as_quat())

    cable = cs.Cable(1.2, 0.1, 0.0524, 0.04)
    scene = Scene(clips=[Clip(0.424, pose((0.334, -0.014, 0.2), 0.136, 0.558, 0.105, 0.812), "fixed")])
    problem = Problem(cable, scene=scene, points=101)
    start = pose((0, 0, 0), 0.446, 0.678, 0.525, 0.257)
    end = pose((-0.205, -0.51, 0.3), -0.074, 0.459, 0.524, 0.713)
    state = Network(problem.move(start, end))
    poses = state.aim(problem.start, problem.end)
    assert not guessed(Search(problem, state, math.inf, 0.0), poses, 1.0, 0.0)
    shape = cosserat.solve(problem)
    assert shape.status is Status.OK
    part = CableShape(np.concatenate([array[36:].ravel() for array in arrays(shape)]), 65, length=1.2, model="part",
                      status=Status.OK)  # fmt: skip
    assert integrated_residual(cable, part, np.array((0.0, 0.0, -WEIGHT))) < 2e-3


def test_turning_the_end_is_counted():
    cable = CABLE.replace(bending_stiffness=0.2, twisting_stiffness=0.05)
    end = Pose((1.1, 0, 0), ALONG_X)
    problem = Problem(cable, scene=Scene(clips=[Clip(0.5, Pose((0.46, 0.0, 0.05)))]))
    state = Network(problem.move(START, end))
    first = cosserat.solve(problem, state)
    for angle in np.linspace(0.0, 2 * math.pi, 13)[1:]:
        shape = cosserat.solve(problem.move(START, moved(end, turn=(angle, 0, 0))), state)
        assert shape.status is Status.OK
    assert shape.turns == 1
    assert abs(shape.twist - first.twist - 2 * math.pi) < 0.5
    asked = cosserat.solve(problem.move(START, Pose(end.position, ALONG_X, turns=1)))
    assert asked.turns == 1
    assert asked.twist == pytest.approx(shape.twist, abs=1e-3)


def test_a_jump_of_the_grip_is_followed_in_small_steps():
    scene = on_the_free_shape((60, "ball"))
    state = Network(Problem(CABLE, scene=scene).move(START, END))
    cosserat.solve(state.problem, state)
    far = moved(END, (-0.3, 0.2, 0.2), (0.0, 1.0, 1.0))
    jumped = cosserat.solve(state.problem.move(START, far), state)
    assert jumped.status is Status.OK
    small = Network(Problem(CABLE, scene=scene).move(START, END))
    for t in np.linspace(0.0, 1.0, 41):
        path = cosserat.solve(small.problem.move(START, moved(END, t * np.array((-0.3, 0.2, 0.2)), (0, t, t))), small)
    assert jumped.positions == pytest.approx(path.positions, abs=3e-5)


def test_an_arch_between_a_grip_and_a_clip_snaps():
    """A weightless strip arched upwards, grip and clip tilted down until it must fall through; its tail is free."""
    cable = cs.Cable(length=1.2, linear_density=0.0, bending_stiffness=(1.0, 50.0), twisting_stiffness=50.0)
    state, statuses = None, []
    for tilt in np.linspace(-0.8, 0.8, 33):
        frame = moved(Pose((0.9, 0, 0), ALONG_X), turn=(0, -tilt, 0))
        problem = Problem(cable, gravity=(0, 0, 0), scene=Scene(clips=[Clip(1.0, frame, "fixed")]))
        problem.move(moved(START, turn=(0, tilt, 0)), FreeEnd())
        state = state or Network(problem)
        shape = cosserat.solve(problem, state)
        statuses.append(shape.status)
        assert np.isfinite(shape.buffer).all()
    assert statuses.count(Status.SNAPPED) == 1
    assert statuses.count(Status.OK) == 32
    assert shape.positions[62, 2] < -0.1


def test_a_deadline_that_has_passed_is_graded():
    fine = Problem(CABLE, tolerance=1e-9, scene=on_the_free_shape((60, "ball"))).move(START, END)
    late = cosserat.solve(fine, deadline=0.0)
    assert not late.status
    assert late.status is Status.BUDGET_EXCEEDED
    assert cosserat.solve(fine).status is Status.OK
