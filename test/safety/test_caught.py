"""A body that holds the cable back is told: which one, where, and how hard."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cable_shape as cs

HALF = math.sqrt(0.5)
OUT, BACK = (0.0, HALF, 0.0, HALF), (0.0, -HALF, 0.0, HALF)
CABLE = cs.Cable(0.8, 0.05, 0.0005, diameter=0.004)
WEIGHT = 0.8 * 0.05 * 9.81 + 10.0 * 0.0005 / 0.8**2
POST = cs.Obstacle("post", cs.Cylinder(0.04, 4.0))


def kinds(report: cs.CycleReport) -> dict[cs.WarningKind, cs.CableWarning]:
    """Its warnings, by kind."""
    return {warning.kind: warning for warning in report.warnings}


def hairpin(cycle: cs.Cycle, back: float, stamp: int) -> cs.CycleReport:
    """A step in which both grips are so far behind the post around which the cable goes [m]."""
    ends = cs.Pose((-back, -0.12, 0.0), OUT), cs.Pose((-back, 0.12, 0.0), BACK)
    return cycle.step({"cable": ends}, stamp=stamp)


@pytest.mark.parametrize("meant", [False, True])
def test_a_hairpin_that_is_drawn_against_a_post_is_caught_before_it_is_too_short(meant: bool) -> None:
    """By what holds both of its legs: twice the tension there but for what the legs lean outwards."""
    allow = [cs.Allow("post")] if meant else []
    scene = cs.Scene(obstacles=[POST], contact="solve", allow=allow)
    cycle = cs.Cycle({"cable": CABLE}, scene=scene, model="cosserat")
    first = None
    for k, back in enumerate(np.arange(0.0, 0.36, 0.005)):
        report = hairpin(cycle, float(back), 10_000_000 * k)
        shape = report.shapes["cable"]
        found = kinds(report)
        if cs.WarningKind.CAUGHT in found and first is None:
            first = found[cs.WarningKind.CAUGHT]
            force = sum(c.force * c.normal + c.tangential_force for c in shape.contacts)
            assert first.value == pytest.approx(float(np.linalg.norm(force)), rel=1e-12)
            assert first.value == pytest.approx(2.0 * float(shape.tension.max()), rel=0.2)
            assert first.limit == pytest.approx(WEIGHT, rel=1e-12)
            assert first.severity is cs.Severity.WARN
            assert first.other == "post"
            assert first.arc_length == pytest.approx(0.4, abs=0.05)
            assert "caught on 'post'" in first.text
            assert shape.status is cs.Status.OK
        if shape.status is cs.Status.OVERSTRETCHED:
            assert cs.WarningKind.CAUGHT not in found  # that pull is of a cable that is drawn longer than it is
            assert "'post'" in found[cs.WarningKind.OVERSTRETCHED].text
            break
    else:
        pytest.fail("the hairpin was never too short")
    assert (first is None) == meant


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_what_lies_on_a_table_is_not(friction: float) -> None:
    """Whatever the grips drag it to: the table carries no more than its weight."""
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.05)), friction=friction)
    cycle = cs.Cycle({"cable": CABLE}, scene=cs.Scene(obstacles=[table], contact="solve"), model="cosserat")
    along = (0.5, 0.5, 0.5, 0.5)
    for k, aside in enumerate(0.05 * np.sin(np.linspace(0.0, 2.0 * math.pi, 40))):
        ends = cs.Pose((0.0, 0.0, 0.0), along), cs.Pose((0.6, aside, 0.0), along)
        report = cycle.step({"cable": ends}, stamp=10_000_000 * k)
        (margin,) = (m for m in report.margins["cable"] if m.kind is cs.WarningKind.CAUGHT)
        assert report.shapes["cable"].contacts
        assert margin.value < WEIGHT
        assert cs.WarningKind.CAUGHT not in kinds(report)


def test_a_load_on_a_free_end_that_hangs_over_a_bar_has_not_caught_it() -> None:
    """The bar carries the load and the cable."""
    along = (0.5, 0.5, 0.5, 0.5)
    bar = cs.Obstacle("bar", cs.Cylinder(0.02, 1.0), cs.Pose((0.03, 0.0, -0.03), (HALF, 0.0, 0.0, HALF)))
    cycle = cs.Cycle({"cable": CABLE}, scene=cs.Scene(obstacles=[bar], contact="solve"), model="cosserat")
    plug = cs.FreeEnd(mass=0.1)
    for k in range(5):
        report = cycle.step({"cable": (cs.Pose((0.0, 0.0, 0.0), along), plug)}, stamp=10_000_000 * k)
    shape = report.shapes["cable"]
    assert shape.status is cs.Status.OK
    assert shape.contacts
    force = float(np.linalg.norm(sum(c.force * c.normal for c in shape.contacts)))
    assert force > 0.1 * 9.81
    (margin,) = (m for m in report.margins["cable"] if m.kind is cs.WarningKind.CAUGHT)
    assert margin.limit == pytest.approx(WEIGHT + 0.1 * 9.81, rel=1e-12)
    assert cs.WarningKind.CAUGHT not in kinds(report)
