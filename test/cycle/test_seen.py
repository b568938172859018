"""Cycles that judge the shape that is seen in place of the predicted one."""

from __future__ import annotations

import numpy as np

import cable_shape as cs
from cable_shape.cycle.seen import AsSeen

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.004, diameter=0.01)
STIFF = CABLE.replace(bending_stiffness=0.02)
START, END = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.7, 0.1, 1.0), ALONG_X)
FLOOR = 0.66  # m
SCENE = cs.Scene(obstacles=[cs.Obstacle("floor", cs.HalfSpace(), cs.Pose((0.0, 0.0, FLOOR)))])
KNOWN = cs.Uncertainty({"bending_stiffness": 0.3}, (0.002, 0.02), (0.002, 0.02), misses=0.005)


def lowest(shape: cs.CableShape) -> float:
    return float(shape.positions[:, 2].min())


def stability(report: cs.CycleReport) -> float:
    """The margin's value."""
    return next(one.value for one in report.margins["cable"] if one.kind is cs.WarningKind.STABILITY)


def test_clearance_margins_and_stability_are_those_of_what_is_seen():
    cycle, plain = (cs.Cycle(CABLE, scene=SCENE, model="cosserat", points=101) for _ in range(2))
    other = cs.Predictor(STIFF, points=101)
    shown, early = other.predict(START, END), []
    grips = {"cable": (START, END)}
    before = cycle.step(grips, 0)
    report = cycle.step(
        grips, 1, early=early.append, seen=lambda shapes: {"cable": AsSeen(shown, None, other.rod_state)}
    )
    assert report.shapes["cable"] is shown
    assert early == [{"cable": shown}]
    assert report.clearance["cable"].bodies[0].distance > before.clearance["cable"].bodies[0].distance + 0.005
    assert abs(report.clearance["cable"].bodies[0].distance - (lowest(shown) - FLOOR - 0.005)) < 1e-4
    own = cs.Cycle(STIFF, model="cosserat", points=101).step(grips, 1)
    assert abs(stability(report) - stability(own)) < 0.01 * stability(own)
    assert stability(report) > 1.03 * stability(before)
    # and nothing of it is left where it is not seen any more
    plain.step(grips, 0)
    after, never = cycle.step(grips, 2), plain.step(grips, 2)
    np.testing.assert_allclose(after.shapes["cable"].positions, never.shapes["cable"].positions, atol=1e-6)
    apart = after.clearance["cable"].bodies[0].distance - never.clearance["cable"].bodies[0].distance
    assert abs(apart) < 1e-6
    assert abs(stability(after) - stability(never)) < 0.01 * stability(never)


def test_where_tubes_are_asked_for_clearance_is_that_of_the_tube_that_is_seen():
    cycle = cs.Cycle(CABLE, scene=SCENE, model="cosserat", points=101, uncertainty=KNOWN)
    shown = cs.predict(STIFF, START, END, points=101)
    tube = cs.Tube(shown, np.zeros((101, 3, 3)), np.full(101, 0.02), 0.95, 0.0)
    report = cycle.step({"cable": (START, END)}, 0, seen=lambda shapes: {"cable": AsSeen(shown, tube)})
    assert report.tubes["cable"] is tube
    assert abs(report.clearance["cable"].bodies[0].distance - (lowest(shown) - FLOOR - 0.005 - 0.02)) < 1e-4
    again = cycle.step({"cable": (START, END)}, 1)
    assert again.tubes["cable"] is not tube
    assert again.tubes["cable"].shape is again.shapes["cable"]


def test_a_harness_is_judged_as_it_is_seen():
    fork = cs.Junction("fork", ("a.end", "b.start"))
    harness = cs.Harness({"a": CABLE.replace(length=0.5), "b": CABLE.replace(length=0.5)}, [fork])
    ends = {"a.start": START, "b.end": END}
    stiff = {name: cable.replace(bending_stiffness=0.02) for name, cable in harness.segments.items()}
    other = cs.Predictor(harness.replace(segments=stiff), points=51)
    shown = other.predict(ends)
    cycle = cs.Cycle({"h": harness}, scene=SCENE, points=51)
    before = cycle.step({"h": ends}, 0)
    report = cycle.step({"h": ends}, 1, seen=lambda shapes: {"h": AsSeen(shown, None, other.rod_state)})
    assert report.shapes["h"] is shown
    for name in ("a", "b"):
        there = report.clearance[f"h/{name}"].bodies[0].distance
        assert abs(there - (lowest(shown.segments[name]) - FLOOR - 0.005)) < 1e-4
    assert report.clearance["h/a"].bodies[0].distance > before.clearance["h/a"].bodies[0].distance + 0.005
    after = cycle.step({"h": ends}, 2)
    assert abs(after.clearance["h/a"].bodies[0].distance - before.clearance["h/a"].bodies[0].distance) < 1e-5
