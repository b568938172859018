"""Places of a cable that are unknown themselves, which contact stands on: loaded, sprung, on a plane or a line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import CABLE, END, LENGTH, START, solved

from cable_shape.kernels import span_stability
from cable_shape.models.span_search import Search
from cable_shape.models.span_state import SpanState
from cable_shape.pose import Pose
from cable_shape.predictor import predict
from cable_shape.problem import Problem
from cable_shape.scene import Clip, PointMass, Scene
from cable_shape.shape import CableShape, Status

FREE = predict(CABLE, START, END, model="cosserat", points=241)


def at_a_place(free: int, A=None, f=(0.0, 0.0, 0.0), axes=None, targets=(0.0, 0.0, 0.0), **options):
    """The solution, state and place of a cable whose point at 0.5 m is held by what `span_factor` calls a place."""
    clip = Clip(0.5, Pose(FREE.positions[100]))
    problem = Problem(CABLE, scene=Scene(clips=[clip]), points=241, **options).move(START, END)
    state = SpanState(problem)
    place = state.place[1]
    place[0] = free
    place[1:10] = np.zeros(9) if A is None else np.ravel(A)
    place[10:13] = f
    place[13:22] = np.eye(3).ravel() if axes is None else np.ravel(axes)
    place[22:25] = targets
    return found(state), state, state.frames[1, :3].copy()


def found(state: SpanState) -> CableShape:
    """From nothing."""
    search = Search(state.problem, state, math.inf)
    assert search.guessed(state.aim(state.problem.start, state.problem.end), fineness=5.0)
    return CableShape(search.buffer, 241, length=LENGTH, model="", status=Status.OK, supports=search.loads)


def test_a_free_place_without_load_is_a_point_of_the_cable():
    shape, _, place = at_a_place(3, tolerance=1e-8)
    free = solved(CABLE, START, END, points=241, tolerance=1e-8)
    assert shape.positions == pytest.approx(free.positions, abs=2e-8)
    assert place == pytest.approx(shape.positions[100], abs=1e-9)
    assert shape.clips[0].force == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_free_place_under_a_dead_weight_is_a_point_mass_to_rounding():
    """The same mesh, the same equations: the free place adds nothing but an unknown that can be eliminated."""
    mass = 0.2
    shape, state, _ = at_a_place(3, f=(0.0, 0.0, 9.81 * mass))
    assert shape.clips[0].force == pytest.approx((0.0, 0.0, 9.81 * mass), abs=1e-9)
    scene = state.problem.scene.replace(masses=[PointMass(0.5, mass)])
    elements = state.elements
    state.take(Problem(CABLE, scene=scene, points=241).move(START, END))
    state.place[1, 0], state.place[1, 13:22] = 3, np.eye(3).ravel()
    carried = found(state)
    assert state.elements == elements
    assert shape.positions == pytest.approx(carried.positions, abs=3e-8)
    assert shape.force == pytest.approx(carried.force, abs=1e-6)
    assert carried.clips[0].force == pytest.approx(np.zeros(3), abs=1e-9)
    known = solved(CABLE, START, END, points=241, scene=Scene(masses=[PointMass(0.5, mass)]))
    assert shape.positions == pytest.approx(known.positions, abs=2e-5)


def test_a_spring_to_the_ground_pulls_with_its_stretch():
    stiffness = np.diag((0.0, 0.0, 40.0))
    anchor = FREE.positions[100] - (0.0, 0.0, 0.1)
    shape, _, place = at_a_place(3, A=stiffness, f=-stiffness @ anchor, tolerance=1e-8)
    force = -stiffness @ (place - anchor)
    assert force[2] < -0.1
    assert shape.clips[0].force == pytest.approx(-force, abs=1e-8)
    weight = Scene(masses=[PointMass(0.5, -force[2] / 9.81)])
    known = solved(CABLE, START, END, points=241, tolerance=1e-8, scene=weight)
    assert shape.positions == pytest.approx(known.positions, abs=3e-8)


@pytest.mark.parametrize("free", [1, 2])
def test_a_point_on_a_smooth_plane_or_line_is_pushed_across_it_only(free):
    axes = np.linalg.qr(np.array(((1.0, 0.2, 0.1), (0.1, 1.0, -0.3), (0.2, 0.4, 1.0))))[0].T
    targets = axes @ (FREE.positions[100] + (0.01, 0.02, 0.04))
    shape, state, place = at_a_place(free, axes=axes, targets=targets, tolerance=1e-8)
    assert (axes @ place)[free:] == pytest.approx(targets[free:], abs=1e-12)
    force = shape.clips[0].force
    assert axes[:free] @ force == pytest.approx(np.zeros(free), abs=1e-8)
    assert np.abs(axes[free:] @ force).min() > 1e-2
    ball = solved(CABLE, START, END, points=241, tolerance=1e-8, scene=Scene(clips=[Clip(0.5, Pose(place))]))
    assert shape.positions == pytest.approx(ball.positions, abs=3e-8)
    assert ball.clips[0].force == pytest.approx(force, abs=1e-4 * np.abs(force).max())
    assert (
        span_stability.smallest_eigenvalue(
            state.par,
            state.mesh,
            state.sol,
            state.work,
            state.where,
            state.mask,
            state.place,
            state.elements,
            state.forces,
        )
        > 0.0
    )
