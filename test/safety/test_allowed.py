"""Contact that is meant: where it is allowed it does not alarm, and elsewhere, or when it is too hard, it does."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cable_shape as cs

ALONG_X = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008, min_bend_radius=0.01)
TABLE = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, -0.05)))
GRIPS = {"cable": (cs.Pose((0.0, 0.0, 0.1), ALONG_X), cs.Pose((0.8, 0.0, 0.1), ALONG_X))}


def report_of(*allow: cs.Allow, cable: cs.Cable = CABLE, **scene: object) -> cs.CycleReport:
    """Of a cable that lies on a table."""
    keywords = {"obstacles": [TABLE], "contact": "solve", **scene}
    cycle = cs.Cycle(cable, scene=cs.Scene(allow=allow, **keywords))  # type: ignore[arg-type]
    report = cycle.step(GRIPS, 0)
    assert report.shapes["cable"].contacts or keywords["contact"] != "solve"
    return report


def kinds(report: cs.CycleReport) -> dict[cs.WarningKind, cs.CableWarning]:
    return {warning.kind: warning for warning in report.warnings}


def force_of(report: cs.CycleReport, low: float = -math.inf, high: float = math.inf) -> float:
    return sum(c.force for c in report.shapes["cable"].contacts if low <= c.arc_length <= high)


def test_contact_that_is_meant_is_no_alarm() -> None:
    asked, allowed = report_of(), report_of(cs.Allow("table"))
    assert set(kinds(asked)) == {cs.WarningKind.CLEARANCE}
    assert allowed.warnings == ()
    assert cs.WarningKind.CLEARANCE not in {margin.kind for margin in allowed.margins["cable"]}
    assert allowed.shapes["cable"].buffer.tobytes() == asked.shapes["cable"].buffer.tobytes()
    # where the table is stays told
    assert allowed.clearance["cable"].bodies[0].distance == asked.clearance["cable"].bodies[0].distance


def test_another_body_alarms_as_ever() -> None:
    ball = cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.0, 0.07, 0.1)))
    report = report_of(cs.Allow("table"), obstacles=[TABLE, ball])
    assert [warning.other for warning in report.warnings] == ["ball"]
    assert report_of(cs.Allow("ball")).warnings[0].other == "table"


def test_the_force_has_a_margin_and_too_much_of_it_alarms() -> None:
    pressed = force_of(report_of())
    weight = 0.1 * 9.81 * 1.2
    assert 0.2 * weight < pressed < weight
    calm = report_of(cs.Allow("table", max_force=2.0 * pressed))
    (margin,) = (m for m in calm.margins["cable"] if m.kind is cs.WarningKind.CONTACT_FORCE)
    assert margin.other == "table"
    assert margin.value == pytest.approx(pressed, rel=1e-12)
    assert margin.used == pytest.approx(0.5, rel=1e-12)
    assert calm.warnings == ()
    near = kinds(report_of(cs.Allow("table", max_force=pressed / 0.95)))
    assert {kind: warning.severity for kind, warning in near.items()} == {
        cs.WarningKind.CONTACT_FORCE: cs.Severity.WARN
    }
    beyond = kinds(report_of(cs.Allow("table", max_force=0.5 * pressed)))
    assert beyond[cs.WarningKind.CONTACT_FORCE].severity is cs.Severity.ERROR
    assert f"{pressed:.3g} N of at most {0.5 * pressed:.3g} N" in beyond[cs.WarningKind.CONTACT_FORCE].text
    assert cs.WarningKind.CLEARANCE in beyond  # it is not what was meant
    assert cs.WarningKind.CONTACT_FORCE.value == 11


def test_a_cable_that_is_bent_too_far_where_it_lies_alarms() -> None:
    shape = report_of().shapes["cable"]
    sharpest = float(shape.bend_radius.min())
    bent = CABLE.replace(min_bend_radius=1.01 * sharpest)
    assert cs.WarningKind.CLEARANCE in kinds(report_of(cs.Allow("table"), cable=bent))
    fine = CABLE.replace(min_bend_radius=0.99 * sharpest)
    assert cs.WarningKind.CLEARANCE not in kinds(report_of(cs.Allow("table"), cable=fine))
    # elsewhere on the cable it is no matter of this contact
    inside = (shape.arc_length >= 0.3) & (shape.arc_length <= 0.9)
    assert shape.bend_radius[inside].min() > 1.1 * sharpest
    lying = report_of(cs.Allow("table", 0.3, 0.9), cable=bent, warn_distance=0.001, error_distance=0.0)
    assert cs.WarningKind.CLEARANCE not in kinds(lying)


def test_elsewhere_along_the_cable_clearance_is_judged() -> None:
    """The table is as near to the rest of the cable as the points of that rest are to its top, the radius apart."""
    low, high = 0.3, 0.9
    report = report_of(cs.Allow("table", start=low, end=high), warn_distance=0.09)
    shape = report.shapes["cable"]
    lowest = min(
        float(np.interp(at, shape.arc_length, shape.positions[:, 2]))
        for at in (*shape.arc_length[(shape.arc_length < low) | (shape.arc_length > high)], low, high)
    )
    expected = lowest - 0.5 * CABLE.diameter
    assert 0.0 < expected < 0.09
    (margin,) = (m for m in report.margins["cable"] if m.kind is cs.WarningKind.CLEARANCE)
    assert margin.value == pytest.approx(expected, abs=1e-9)
    assert margin.arc_length in (pytest.approx(low), pytest.approx(high))
    warning = kinds(report)[cs.WarningKind.CLEARANCE]
    assert warning.value == margin.value
    assert report_of(cs.Allow("table", start=low, end=high), warn_distance=0.9 * expected).warnings == ()
    outside = report_of(cs.Allow("table", start=0.0, end=0.1))
    assert kinds(outside)[cs.WarningKind.CLEARANCE].value == kinds(report_of())[cs.WarningKind.CLEARANCE].value


def test_only_the_force_on_the_stretch_counts() -> None:
    contacts = report_of().shapes["cable"].contacts
    middle = 0.5 * (contacts[0].arc_length + contacts[-1].arc_length) if len(contacts) > 1 else 0.6
    report = report_of(cs.Allow("table", end=middle, max_force=10.0), cs.Allow("table", start=middle, max_force=20.0))
    (margin,) = (m for m in report.margins["cable"] if m.kind is cs.WarningKind.CONTACT_FORCE)
    shares = force_of(report, high=middle) / 10.0, force_of(report, low=middle) / 20.0
    assert margin.used == pytest.approx(max(shares), rel=1e-12)
    assert report.warnings == ()


def test_without_solving_what_overlaps_alarms() -> None:
    above = cs.Obstacle("table", TABLE.solid, cs.Pose((0.4, 0.0, -0.41)))
    inside = kinds(report_of(cs.Allow("table"), contact="warn"))
    assert "overlaps" in inside[cs.WarningKind.CLEARANCE].text
    assert report_of(cs.Allow("table"), contact="warn", obstacles=[above]).warnings == ()


def test_tails_may_touch_where_they_are_meant_to() -> None:
    cable = CABLE.replace(tails={"end": 0.6})
    report = report_of(cs.Allow("table", end=1.2), cable=cable)
    below = next(tail.positions[:, 2].min() for tail in report.tails.values())
    assert below < 0.004
    assert kinds(report)[cs.WarningKind.CLEARANCE].arc_length > 1.2
    assert "rests on 'table' on the tail" in kinds(report)[cs.WarningKind.CLEARANCE].text
    assert cs.WarningKind.CLEARANCE not in kinds(report_of(cs.Allow("table"), cable=cable))


def test_it_goes_with_the_cable_when_that_is_gripped_elsewhere() -> None:
    allow = cs.Allow("table", start=0.3, end=0.9)
    cycle = cs.Cycle(CABLE, scene=cs.Scene(obstacles=[TABLE], contact="solve", allow=[allow]))
    cycle.step(GRIPS, 0)
    assert cycle.edit(cs.Regrip("start", 0.1))
    (moved,) = cycle.scene.allow
    assert (moved.start, moved.end) == (pytest.approx(0.2), pytest.approx(0.8))
    assert cycle.edit(cs.Regrip("start", 0.0))
    assert cycle.scene.allow == (allow,)


def test_harnesses_are_allowed_it_as_well() -> None:
    harness = cs.Harness({"a": CABLE}, [])
    ends = {"a.start": GRIPS["cable"][0], "a.end": GRIPS["cable"][1]}
    for allow, found in (((), {cs.WarningKind.CLEARANCE}), ((cs.Allow("table", max_force=10.0),), set())):
        scene = cs.Scene(obstacles=[TABLE], contact="solve", allow=allow)
        report = cs.Cycle({"h": harness}, scene=scene).step({"h": ends}, 0)  # type: ignore[dict-item]
        assert {warning.kind for warning in report.warnings} == found
    assert cs.WarningKind.CONTACT_FORCE in {margin.kind for margin in report.margins["h/a"]}


def test_files_say_it_and_wrong_values_are_refused() -> None:
    allow = (cs.Allow("table"), cs.Allow("post", start=0.1, end=0.4, max_force=5.0))
    scene = cs.Scene(obstacles=[TABLE], contact="solve", allow=allow)
    assert cs.Scene.from_mapping(scene.as_dict()) == scene
    assert scene.as_dict()["allow"] == [
        {"body": "table"},
        {"body": "post", "start": 0.1, "end": 0.4, "max_force": 5.0},
    ]
    with pytest.raises(cs.ArgumentError, match=r"allow\[0\].max_force = 5.0 is not allowed: contact='warn' knows no"):
        cs.Scene(allow=[cs.Allow("table", max_force=5.0)])
    with pytest.raises(cs.ArgumentError, match=r"Allow.end = 0.1 is not allowed: it must be above start, 0.2 m"):
        cs.Allow("table", 0.2, 0.1)
    with pytest.raises(cs.ArgumentError, match=r"Allow.max_force = 0.0"):
        cs.Allow("table", max_force=0.0)
    with pytest.raises(cs.ArgumentError, match=r"allow\[0\].*the key 'body' is missing"):
        cs.Scene.from_mapping({"allow": [{"start": 0.1}]})
