"""Harnesses whose segments run through eyelets: against one cable, without friction, and how they answer grips."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.safety.report import WarningKind

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
START, END = cs.Pose((0.0, 0.0, 0.0), ALONG), cs.Pose((0.9, 0.0, 0.0), ALONG)
PLACES = {0.3: cs.Pose((0.25, 0.03, -0.04), ALONG), 0.55: cs.Pose((0.48, 0.02, -0.05), ALONG)}
ASIDE = cs.Pose(quaternion=(0.479426, 0.0, 0.0, 0.877583))


def eyelets(segment: str | None = None) -> cs.Scene:
    return cs.Scene(clips=[cs.Clip(s, place, "slide", segment=segment) for s, place in PLACES.items()])


def halves() -> cs.Harness:
    parts = {"a": CABLE.replace(length=0.8), "b": CABLE.replace(length=0.4)}
    return cs.Harness(parts, [cs.Junction("j", ("a.end", "b.start"))])


def fork() -> cs.Harness:
    """A trunk with two eyelets, of which one branch is held and the other hangs."""
    parts = {"a": CABLE.replace(length=0.8), "b": CABLE.replace(length=0.4), "c": CABLE.replace(length=0.2)}
    return cs.Harness(parts, [cs.Junction("j", ("a.end", "b.start", "c.start"), frames={"c.start": ASIDE})])


def test_two_segments_run_through_eyelets_as_one_cable_does() -> None:
    single = cs.Predictor(CABLE, scene=eyelets())
    several = cs.Predictor(halves(), scene=eyelets("a"))
    for k in range(6):
        end = cs.Pose((0.9, 0.01 * k, 0.012 * k), ALONG)
        one, two = single.predict(START, end), several.predict({"a.start": START, "b.end": end})
        assert two.status is cs.Status.OK
        for mine, wanted in zip(two.clips, one.clips, strict=True):
            assert mine.arc_length == pytest.approx(wanted.arc_length, abs=2e-6)
            np.testing.assert_allclose(mine.force, wanted.force, atol=1e-4)
        np.testing.assert_allclose(two.segments["b"].positions[-1], end.position, atol=1e-9)
        assert two.energy == pytest.approx(one.energy, abs=1e-6)
    still = cs.predict(halves(), {"a.start": START, "b.end": end}, scene=eyelets("a"))
    np.testing.assert_allclose(still.segments["a"].positions, two.segments["a"].positions, atol=2e-5)


def test_no_eyelet_of_a_fork_pulls_along_its_segment_and_shapes_answer_grips() -> None:
    predictor = cs.Predictor(fork(), scene=eyelets("a"), tolerance=1e-7)
    ends = {"a.start": START, "b.end": END, "c.end": cs.FreeEnd(mass=0.02)}
    shape = predictor.predict(ends)
    assert shape.status is cs.Status.OK
    trunk = shape.segments["a"]
    for load in shape.clips:
        tangent = np.array([np.interp(load.arc_length, trunk.arc_length, x) for x in trunk.tangents.T])
        assert np.linalg.norm(load.force) > 0.1
        assert abs(load.force @ tangent) < 2e-3 * np.linalg.norm(load.force)
    columns = predictor.sensitivity()
    step, grips = 1e-4, list(predictor.grips)
    for axis in range(3):
        moved = []
        for sign in (-1.0, 1.0):
            way = np.zeros(3)
            way[axis] = sign * step
            there = cs.Pose(END.position + way, END.quaternion)
            moved.append(predictor.predict({**ends, "b.end": there}))
        for name, one in columns.items():
            wanted = (moved[1].segments[name].positions - moved[0].segments[name].positions) / (2.0 * step)
            np.testing.assert_allclose(one[:, :, 6 * grips.index("b.end") + axis], wanted, atol=2e-3)


def test_clips_beside_an_eyelet_may_hold_other_points_from_one_shape_to_the_next() -> None:
    def scene(arc: float) -> cs.Scene:
        ball = cs.Clip(arc, cs.Pose((0.48, 0.02, -0.05), ALONG), "ball", segment="a")
        return cs.Scene(clips=[cs.Clip(0.3, PLACES[0.3], "slide", segment="a"), ball])

    ends = {"a.start": START, "b.end": END}
    predictor = cs.Predictor(halves(), scene=scene(0.55))
    predictor.predict(ends)
    predictor.scene = scene(0.556)
    warm, cold = predictor.predict(ends), cs.predict(halves(), ends, scene=scene(0.556))
    assert warm.clips[1].arc_length == 0.556
    assert warm.clips[0].arc_length == pytest.approx(cold.clips[0].arc_length, abs=1e-6)
    for name, shape in warm.segments.items():
        np.testing.assert_allclose(shape.positions, cold.segments[name].positions, atol=1e-5)


def test_a_segment_that_nothing_stops_runs_out_of_its_eyelet() -> None:
    heavy = {"a.start": START, "c.end": cs.FreeEnd(mass=0.5)}
    clip = cs.Clip(0.1, cs.Pose((0.05, 0.0, 0.3), ALONG), "slide", segment="b", name="ring")
    shape = cs.predict(fork(), heavy, scene=cs.Scene(clips=[clip]))
    assert not shape.usable
    assert shape.detail


def test_cycles_with_eyelets_have_tubes_and_stability() -> None:
    known = cs.Uncertainty({"bending_stiffness": 0.2}, (0.001, 0.01), (0.001, 0.01))
    one = cs.Cycle(CABLE, scene=eyelets(), uncertainty=known).step({"cable": (START, END)}, 0)
    two = cs.Cycle({"h": halves()}, scene=eyelets("a"), uncertainty=known).step(
        {"h": {"a.start": START, "b.end": END}}, 0
    )
    tube, whole = two.tubes["h/b"], one.tubes["cable"]
    wanted = np.interp(tube.shape.arc_length + 0.8, whole.shape.arc_length, whole.radius)
    np.testing.assert_allclose(tube.radius, wanted, rtol=0.02, atol=2e-5)
    (told,) = (m for m in one.margins["cable"] if m.kind is WarningKind.STABILITY)
    (own,) = (m for name in ("h/a", "h/b") for m in two.margins[name] if m.kind is WarningKind.STABILITY)
    assert own.value / 0.8**2 == pytest.approx(told.value / 1.2**2, rel=0.02)
