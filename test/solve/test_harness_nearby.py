"""Shapes of harnesses almost alike, from factors alone, against differences of harnesses that were solved for."""

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.solve import harness_search
from cable_shape.solve.harness_nearby import nearby

ALONG = (0.0, 0.7071067811865476, 0.0, 0.7071067811865476)
ASIDE = cs.Pose((0, 0, 0), (0.3826834323650898, 0.0, 0.0, 0.9238795325112867))
TRUNK = {"length": 0.6, "linear_density": 0.12, "bending_stiffness": (0.01, 0.014)}
BRANCH = {"length": 0.4, "linear_density": 0.05, "bending_stiffness": 0.003}
AWAY = cs.Pose((0.0, 0.01, 0.005), (0.0, 0.0, 0.0, 1.0))
CLIP = {"name": "mid", "segment": "trunk", "arc_length": 0.3, "position": [0.27, 0.03, 0.02], "quaternion": ALONG}
#: Of differences of solved shapes, and of shapes nearby.
STEP, NEAR = 1e-4, 1e-6


def problem_of(trunk=None, left=None, fork=None, clips=(), masses=(), ends=None, loop=False, **more):
    """A problem of the solver: a trunk that forks, one branch held, one hanging or both."""
    made = {"axial_stiffness": 400.0}
    segments = {
        "trunk": cs.Cable(**{**TRUNK, **made, **(trunk or {})}),
        "left": cs.Cable(**{**BRANCH, **made, **(left or {})}),
        "right": cs.Cable(**{**BRANCH, **made, "length": 0.45}),
    }
    junction = {"ends": ("trunk.end", "left.start", "right.start"), "frames": {"left.start": ASIDE}, **(fork or {})}
    harness = cs.Harness(segments, [cs.Junction("fork", **junction)])
    scene = cs.Scene.from_mapping({"clips": [{**CLIP, **clip} for clip in clips], "masses": list(masses)})
    predictor = cs.Predictor(harness, scene=scene, points=50, **{"tolerance": 1e-8, **more})
    held = {"trunk.start": cs.Pose((0, 0, 0), ALONG), "left.end": cs.Pose((0.8, 0.1, -0.1), ALONG), **(ends or {})}
    if loop:
        held["right.end"] = cs.Pose((0.85, -0.1, -0.05), ALONG)
    return predictor.problem.move(held)


def turned(x):
    """The grip at the start, turned by x rad."""
    spin = cs.Pose((0, 0, 0), (*(np.sin(0.5 * x) * np.array((0.6, 0.0, 0.8))), np.cos(0.5 * x)))
    return (spin * cs.Pose((0, 0, 0), ALONG)).quaternion


RING, BESIDE = {"kind": "slide"}, {"frames": {"left.start": AWAY}}
PART = {"start": 0.1, "end": 0.25, "linear_density": 0.2, "bending_stiffness": 0.02, "axial_stiffness": 400.0}
CASES = {
    "length": lambda x: problem_of({"length": 0.6 + x}),
    "length in a loop": lambda x: problem_of({"length": 0.6 + x}, loop=True),
    "of a branch": lambda x: problem_of(
        {"bending_stiffness": (0.01, 0.014 + 0.01 * x)}, {"length": 0.4 + x}, loop=True
    ),
    "weight": lambda x: problem_of(left={"linear_density": 0.05 + 0.1 * x}),
    "grip": lambda x: problem_of(ends={"left.end": cs.Pose((0.8 + x, 0.1, -0.1 + x), ALONG)}),
    "grip turned": lambda x: problem_of(ends={"trunk.start": cs.Pose((0, 0, 0), turned(x))}),
    "swivel turned": lambda x: problem_of(ends={"trunk.start": cs.Grip(cs.Pose((0, 0, 0), turned(x)), "swivel")}),
    "load": lambda x: problem_of(ends={"right.end": cs.FreeEnd(mass=0.02 + 0.1 * x, force=(0.0, 0.1 * x, 0.0))}),
    "mass of the fork": lambda x: problem_of(fork={"mass": 0.02 + 0.1 * x}),
    "ball of the fork": lambda x: problem_of({"length": 0.6 + x}, fork={"kind": "ball", "frames": {}}, loop=True),
    "lever": lambda x: problem_of({"length": 0.6 + x}, fork=BESIDE, loop=True, tolerance=2e-7),
    "clip": lambda x: problem_of(clips=[{"position": [0.27, 0.03 + x, 0.02]}]),
    "arc length of a clip": lambda x: problem_of(clips=[{"kind": "fixed", "arc_length": 0.3 + x}]),
    "hinge": lambda x: problem_of({"length": 0.6 + x}, clips=[{"kind": "hinge", "quaternion": turned(x)}]),
    "eyelet": lambda x: problem_of(
        {"length": 0.6 + x}, clips=[{**RING, "position": [0.27, 0.03 + x, 0.02]}], loop=True
    ),
    "mass": lambda x: problem_of(masses=[{"segment": "left", "arc_length": 0.2 + x, "mass": 0.01}], loop=True),
    "sections": lambda x: problem_of({"sections": [{**PART, "end": 0.25 + x, "linear_density": 0.2 + x}]}),
    "gravity": lambda x: problem_of(gravity=(x, 0.0, -9.81), loop=True),
}


def told(shape):
    """What is compared, each in its own unit."""
    out = [np.array([shape.energy, *(one.energy for one in shape.segments.values())]), shape.supports[:, 1:].copy()]
    for one in shape.segments.values():
        out += [x.copy() for x in (one.positions, one.quaternions, one.curvature, one.force, one.moment)]
    return out


@pytest.mark.parametrize("case", CASES)
def test_differences_are_derivatives_of_all_that_a_shape_tells(case):
    make = CASES[case]
    share = 1e-3 if case == "lever" else 1e-4  # of shapes with levers no mesh is as fine
    base, state = harness_search.solve(make(0.0))
    assert base.status is cs.Status.OK
    state.refresh()
    for a, b in zip(told(nearby(state, make(0.0))), told(base), strict=True):
        assert np.allclose(a, b, atol=1e-6 * max(1.0, np.abs(b).max(initial=0.0)))
    above, below = (told(nearby(state, make(x))) for x in (NEAR, -NEAR))
    slopes = []
    for n in (1.0, 2.0):
        both = (told(harness_search.solve(make(side * n * STEP), state.copied())[0]) for side in (1.0, -1.0))
        slopes.append([(high - low) / (2.0 * n * STEP) for high, low in zip(*both, strict=True)])
    for i, (high, low, one, two) in enumerate(zip(above, below, *slopes, strict=True)):
        expected = (4.0 * one - two) / 3.0
        off = np.abs((high - low) / (2.0 * NEAR) - expected).max(initial=0.0)
        assert off <= share * np.abs(expected).max(initial=0.0) + 1e-5, i


def test_what_is_another_network_has_none():
    _, state = harness_search.solve(problem_of())
    state.refresh()
    assert nearby(state, problem_of(clips=[{}])) is None
    assert nearby(state, problem_of(fork={"frames": {}})) is None
    assert nearby(state, problem_of(fork={"kind": "ball", "frames": {}})) is None
