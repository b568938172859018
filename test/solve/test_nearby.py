"""Shapes of cables almost alike, from factors alone, against differences of cables that were solved for."""

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.pose import FreeEnd
from cable_shape.solve import cosserat
from cable_shape.solve.nearby import nearby
from cable_shape.solve.network import Network

ALONG = np.array((0.5, 0.5, 0.5, 0.5))
POINTS = 80
PLAIN = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": (0.02, 0.03), "twisting_stiffness": 0.015,
         "axial_stiffness": 500.0}  # fmt: skip
CLIP = {"name": "mid", "arc_length": 0.55, "position": [0.35, 0.1, 0.8], "quaternion": [0.5, 0.5, 0.5, 0.5]}
#: Of differences of solved shapes, and of shapes nearby.
STEP, NEAR = 1e-4, 1e-6


def turn_of(x, axis=(0.3, 0.5, -0.8)):
    """A quaternion: ALONG turned about an axis of the world by x rad."""
    axis = np.array(axis) / np.linalg.norm(axis)
    spin = cs.Pose((0, 0, 0), (*(np.sin(0.5 * x) * axis), np.cos(0.5 * x)))
    return (spin * cs.Pose((0, 0, 0), ALONG)).quaternion


def problem_of(cable=None, clips=(), start=None, end=(0.8, 0.05, 1.0), masses=(), **more):
    """A problem of the solver."""
    scene = {"clips": [{**CLIP, **clip} for clip in clips], "masses": list(masses)}
    predictor = cs.Predictor(
        cs.Cable(**{**PLAIN, **(cable or {})}),
        scene=cs.Scene.from_mapping(scene),
        points=POINTS,
        tolerance=1e-8,
        **more,
    )
    last = end if isinstance(end, (cs.Grip, cs.Pose, FreeEnd)) else cs.Pose(end, ALONG)
    return predictor.problem.move(start or cs.Pose((0, 0, 1), ALONG), last)


BENT_ROWS = [[0.5, 0.2, 0.3], [1.5, -0.4, 0.1], [0.2, 0.1, 0.0]]
BENT = {"rest_curvature": BENT_ROWS}
PARTS = {
    "axial_stiffness": None,
    "sections": [{"start": 0.3, "end": 0.5, "linear_density": 0.2, "bending_stiffness": 0.05}],
}
LOADED = FreeEnd(mass=0.02, force=(0.05, 0.02, 0.01), moment=(0.0, 0.004, 0.0))
RUNS = {"kind": "slide", "arc_length": 0.55}
CASES = {
    "length": lambda x: problem_of({"length": 1.2 + x}),
    "length in a clip": lambda x: problem_of({"length": 1.2 + x}, [{}]),
    "weight": lambda x: problem_of({"linear_density": 0.1 + 0.1 * x}, [{"kind": "hinge"}]),
    "one of two stiffnesses": lambda x: problem_of({"bending_stiffness": (0.02, 0.03 + 0.03 * x)}, [{"kind": "fixed"}]),
    "twisting stiffness": lambda x: problem_of(
        {"twisting_stiffness": 0.015 + 0.03 * x}, start=cs.Pose((0, 0, 1), turn_of(0.3))
    ),
    "axial stiffness": lambda x: problem_of({"axial_stiffness": 5.0 + 10.0 * x}),
    "rest curvature": lambda x: problem_of({"rest_curvature": [BENT_ROWS[0], [1.5 + x, -0.4, 0.1], BENT_ROWS[2]]}),
    "length of a bent one": lambda x: problem_of({**BENT, "length": 1.2 + x}, [{}]),
    "length of one in sections": lambda x: problem_of({**PARTS, "length": 1.2 + x}),
    "where a section ends": lambda x: problem_of({**PARTS, "sections": [{**PARTS["sections"][0], "end": 0.5 + x}]}),
    "end": lambda x: problem_of(end=(0.8 + x, 0.05, 1.0), clips=[{}]),
    "start turned": lambda x: problem_of(start=cs.Pose((0, 0, 1), turn_of(x))),
    "swivel turned": lambda x: problem_of(start=cs.Grip(cs.Pose((0, 0, 1), turn_of(x)), "swivel")),
    "pinned turned": lambda x: problem_of(end=cs.Grip(cs.Pose((0.8, 0, 1), turn_of(x)), "pinned")),
    "free end": lambda x: problem_of(start=cs.Pose((x, 0, 1), turn_of(x)), end=LOADED),
    "its load": lambda x: problem_of(end=FreeEnd(mass=0.02 + 0.1 * x, force=(0.05, 0.02, 0.01 + 0.1 * x))),
    "mass": lambda x: problem_of(masses=[{"arc_length": 0.4 + x, "mass": 0.03}], clips=[{}]),
    "ball": lambda x: problem_of(clips=[{"position": [0.35, 0.1 + x, 0.8]}]),
    "arc length of a clip": lambda x: problem_of(clips=[{"arc_length": 0.55 + x}]),
    "arc length of two": lambda x: problem_of(
        clips=[{"arc_length": 0.4 + x}, {**CLIP, "name": "b", "arc_length": 0.7 - x, "position": [0.6, 0.1, 0.85]}]
    ),
    "fixed turned": lambda x: problem_of(clips=[{"kind": "fixed", "quaternion": turn_of(x)}]),
    "hinge turned": lambda x: problem_of(clips=[{"kind": "hinge", "quaternion": turn_of(x)}]),
    "gravity": lambda x: problem_of(gravity=(x, 0.0, -9.81 + x)),
    "load": lambda x: problem_of(distributed_load=((0, x, 0), (0, 0.3 + x, 0))),
    "length through an eyelet": lambda x: problem_of({"length": 1.2 + x}, [RUNS]),
    "place of an eyelet": lambda x: problem_of(clips=[{**RUNS, "position": [0.35 + x, 0.1, 0.8]}]),
    "eyelet and clip": lambda x: problem_of(
        {"linear_density": 0.1 + 0.1 * x}, [RUNS, {"name": "b", "arc_length": 0.8, "position": [0.6, 0.1, 0.85 + x]}]
    ),
}  # fmt: skip


def told(shape):
    """What is compared, each in its own unit."""
    parts = [shape.positions, shape.quaternions, shape.curvature, shape.force, shape.moment, shape.supports[:, 1:]]
    return [part.copy() for part in parts] + [np.array([shape.energy])]


def solved(state, problem):
    other = state.copied()
    return told(cosserat.solve(problem, other))


@pytest.mark.parametrize("case", CASES)
def test_differences_are_derivatives_of_all_that_a_shape_tells(case):
    make = CASES[case]
    problem = make(0.0)
    state = Network(problem)
    base = cosserat.solve(problem, state)
    assert base.status is cs.Status.OK
    state.refresh()
    again, _ = nearby(state, make(0.0))
    for a, b in zip(told(again), told(base), strict=True):
        assert np.allclose(a, b, atol=1e-7 * max(1.0, np.abs(b).max(initial=0.0)))
    above, below = (told(nearby(state, make(x))[0]) for x in (NEAR, -NEAR))
    steps = [[solved(state, make(side * x)) for side in (1.0, -1.0)] for x in (STEP, 2.0 * STEP)]
    for i, (high, low) in enumerate(zip(above, below, strict=True)):
        slope = (high - low) / (2.0 * NEAR)
        one, two = ((plus[i] - minus[i]) / (2.0 * n * STEP) for n, (plus, minus) in enumerate(steps, 1))
        expected = (4.0 * one - two) / 3.0
        assert np.abs(slope - expected).max(initial=0.0) <= 1e-4 * np.abs(expected).max(initial=0.0) + 1e-6, (case, i)


def test_what_is_another_network_has_none():
    problem = problem_of(clips=[{}])
    state = Network(problem)
    cosserat.solve(problem, state)
    state.refresh()
    assert nearby(state, problem_of(clips=[{"kind": "fixed"}])) is None
    assert nearby(state, problem_of(clips=[{}], masses=[{"arc_length": 0.3, "mass": 0.01}])) is None
    assert nearby(state, problem_of(PARTS, clips=[{}])) is None


def test_the_solution_stays_as_it_is():
    problem = problem_of(clips=[RUNS])
    state = Network(problem)
    cosserat.solve(problem, state)
    state.refresh()
    before = [a.copy() for a in (state.floats, state.sols, state.work)]
    nearby(state, problem_of({"length": 1.21}, clips=[RUNS]))
    assert all(np.array_equal(a, b) for a, b in zip(before, (state.floats, state.sols, state.work), strict=True))
