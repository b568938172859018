"""Every kind of warning on both sides of its limits, and what each field says."""

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.report import BodyDistance, Clearance, Severity, WarningKind
from cable_shape.safety.warnings import warnings_of
from cable_shape.scene.scene import HalfSpace, Obstacle, Scene, Sphere
from cable_shape.shape import CableShape, Status

POINTS = 11
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01)
SCENE = Scene(warn_distance=0.03, error_distance=0.01)


def shape_of(status: Status = Status.OK, **keywords) -> CableShape:
    """A straight, level, unloaded shape 0.1 m above the floor."""
    shape = CableShape(np.zeros(17 * POINTS), POINTS, length=1.0, model="cosserat", status=status, **keywords)
    shape.arc_length[:] = np.linspace(0.0, 1.0, POINTS)
    shape.positions[:, 0] = shape.arc_length
    shape.positions[:, 2] = 0.1
    shape.quaternions[:] = (0.5, 0.5, 0.5, 0.5)  # d3 = x
    return shape


def warnings(shape=None, clearance=None, cable=CABLE, scene=SCENE, **keywords):
    return warnings_of("left", cable, scene, shape or shape_of(), clearance or Clearance(), **keywords)


def body(distance: float, name: str = "post") -> BodyDistance:
    return BodyDistance(name, distance, 0.4, np.array((0.4, 0.0, 0.1)), np.array((0.4, distance, 0.1)))


def test_nothing_wrong_nothing_said():
    limits = CABLE.replace(min_bend_radius=0.05, max_tension=10.0, max_twist_rate=3.0)
    assert warnings(cable=limits, clearance=Clearance(bodies=(body(0.05),))) == ()


@pytest.mark.parametrize(
    ("distance", "severity"),
    [
        (0.0301, None),
        (0.03, None),
        (0.0299, Severity.WARN),
        (0.01, Severity.WARN),
        (0.0099, Severity.ERROR),
        (0.0, Severity.ERROR),
        (-0.002, Severity.ERROR),
    ],
)
def test_clearance(distance, severity):
    found = warnings(clearance=Clearance(bodies=(body(distance),)))
    assert [w.severity for w in found] == ([] if severity is None else [severity])
    for warning in found:
        assert warning.kind is WarningKind.CLEARANCE
        assert warning.cable_id == "left"
        assert warning.other == "post"
        assert (warning.value, warning.limit, warning.arc_length) == (distance, 0.03, 0.4)
        assert warning.margin == pytest.approx(1.0 + (0.03 - distance) / 0.03)
        assert warning.point_on_other[1] == distance
        assert "'post' at 0.400 m" in warning.text


def test_clearance_in_words():
    (near,) = warnings(clearance=Clearance(bodies=(body(0.0123),)))
    assert (
        near.text
        == "left: 12.3 mm from 'post' at 0.400 m from the start grip (warning below 30.0 mm). Keep away from it."
    )
    (nearer,) = warnings(clearance=Clearance(bodies=(body(0.0042),)))
    assert "4.2 mm from 'post'" in nearer.text
    assert "(error below 10.0 mm)" in nearer.text
    (overlap,) = warnings(clearance=Clearance(bodies=(body(-0.0031),)))
    assert "overlaps 'post' at 0.400 m from the start grip by 3.1 mm" in overlap.text


def test_clearance_from_a_real_check():
    scene = Scene(
        [Obstacle("floor", HalfSpace()), Obstacle("post", Sphere(0.05), cs.Pose((0.5, 0.0, 0.2)))], (), (), 0.2
    )
    shape = shape_of()
    found = warnings(shape, ClearanceChecker(scene, radius=0.004).check(shape), scene=scene)
    assert [(w.other, round(w.value, 9)) for w in found] == [("post", 0.046), ("floor", 0.096)]
    np.testing.assert_allclose(found[0].point_on_cable, (0.5, 0.0, 0.104), atol=1e-12)
    np.testing.assert_allclose(found[0].point_on_other, (0.5, 0.0, 0.15), atol=1e-12)


def test_without_warning_distances_only_overlap_is_told():
    silent = SCENE.replace(warn_distance=0.0, error_distance=0.0)
    assert warnings(clearance=Clearance(bodies=(body(0.0),)), scene=silent) == ()
    (found,) = warnings(clearance=Clearance(bodies=(body(-1e-6),)), scene=silent)
    assert found.severity is Severity.ERROR
    assert found.margin == math.inf


@pytest.mark.parametrize(
    ("fraction", "severity"),
    [(0.8999, None), (0.9001, Severity.WARN), (0.9999, Severity.WARN), (1.0, Severity.ERROR), (1.5, Severity.ERROR)],
)
@pytest.mark.parametrize("kind", [WarningKind.TENSION, WarningKind.BEND_RADIUS, WarningKind.TWIST_RATE])
def test_loads(kind, fraction, severity):
    shape = shape_of()
    at = 4
    if kind is WarningKind.TENSION:
        cable, limit, value = CABLE.replace(max_tension=8.0), 8.0, 8.0 * fraction
        shape.force[at] = (value, 100.0, 0.0)  # along d3 = x; shear does not count
    elif kind is WarningKind.BEND_RADIUS:
        cable, limit, value = CABLE.replace(min_bend_radius=0.0625), 0.0625, 0.0625 / fraction
        shape.curvature[at] = (0.6 / value, -0.8 / value, 50.0)  # twist does not count
    else:
        cable, limit, value = CABLE.replace(max_twist_rate=4.0), 4.0, 4.0 * fraction
        shape.curvature[at] = (50.0, 0.0, -value)
    assert [w for w in warnings(shape) if w.kind is kind] == [], "no limit, no warning"
    found = warnings(shape, cable=cable)
    assert [w.severity for w in found] == ([] if severity is None else [severity])
    for warning in found:
        assert warning.kind is kind
        assert warning.value == pytest.approx(value)
        assert warning.limit == limit
        assert warning.margin == pytest.approx(fraction)
        assert warning.arc_length == pytest.approx(0.4)
        np.testing.assert_array_equal(warning.point_on_cable, shape.positions[at])
        np.testing.assert_array_equal(warning.point_on_other, shape.positions[at])
        assert warning.other == ""
        assert warning.text.startswith("left: at 0.400 m from the start grip, ")


def test_compression_is_no_tension():
    shape = shape_of()
    shape.force[:, 0] = -100.0
    assert warnings(shape, cable=CABLE.replace(max_tension=8.0)) == ()


@pytest.mark.parametrize("status", [Status.UNSTABLE, Status.SNAPPED, Status.BUDGET])
def test_a_usable_status_that_is_not_ok_warns(status):
    near = Clearance(bodies=(body(0.02),))
    state, clearance = sorted(warnings(shape_of(status, error_estimate=2e-3), near), key=lambda w: -w.kind.value)
    assert state.kind is WarningKind.STATUS
    assert state.severity is Severity.WARN
    assert (state.value, state.limit, state.margin) == (2e-3, 1e-3, pytest.approx(2.0))
    assert status.remedy in state.text
    assert clearance.kind is WarningKind.CLEARANCE
    (state,) = warnings(shape_of(status, error_estimate=2e-3, detail="The belly flips."), tolerance=4e-3)
    assert state.margin == pytest.approx(0.5)
    assert "The belly flips." in state.text


@pytest.mark.parametrize("status", [Status.NOT_CONVERGED, Status.BUDGET_EXCEEDED])
def test_a_shape_that_is_none_gets_no_other_warning(status):
    shape = shape_of(status)
    shape.force[:] = 1e3
    (found,) = warnings(shape, Clearance(bodies=(body(-0.1),)), cable=CABLE.replace(max_tension=1.0))
    assert found.kind is WarningKind.STATUS
    assert found.severity is Severity.ERROR
    assert status.name in found.text
    assert "Clearance and loads were not judged." in found.text


def test_overstretched():
    shape = shape_of(Status.OVERSTRETCHED)
    shape.positions[:, 0] *= 1.1
    shape.force[:] = math.inf
    found = warnings(shape, Clearance(bodies=(body(0.02),)), cable=CABLE.replace(max_tension=1.0))
    assert [w.kind for w in found] == [WarningKind.OVERSTRETCHED, WarningKind.CLEARANCE]
    assert found[0].severity is Severity.ERROR
    assert (found[0].value, found[0].limit) == (pytest.approx(1.1), 1.0)
    assert found[0].margin == pytest.approx(1.1)
    assert "1.100 m apart, 100.0 mm more than the cable is long" in found[0].text


def test_errors_first_then_the_smallest_reserve():
    bodies = (body(0.025, "a"), body(0.005, "b"), body(-0.001, "c"), body(0.015, "d"))
    shape = shape_of()
    shape.force[3, 0] = 9.5
    found = warnings(shape, Clearance(bodies=bodies), cable=CABLE.replace(max_tension=10.0))
    assert [w.other for w in found] == ["c", "b", "d", "a", ""]


def test_a_cable_that_rests_on_a_body_as_the_scene_wants_it_is_warned_of_as_such():
    cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    table = cs.Obstacle("table", cs.HalfSpace())
    ends = cs.Pose((0, 0, 0.3), (0.5, 0.5, 0.5, 0.5)), cs.Pose((0.8, 0, 0.3), (0.5, 0.5, 0.5, 0.5))
    cycle = cs.Cycle(cable, scene=cs.Scene(obstacles=[table], contact="solve"))
    report = cycle.step({"cable": ends}, 0)
    (warning,) = (w for w in report.warnings if w.other == "table")
    force = sum(contact.force for contact in report.shapes["cable"].contacts)
    assert warning.severity is Severity.WARN
    assert "rests on 'table'" in warning.text
    assert f"{force:.2g} N" in warning.text
    # the table and the grips carry the cable's weight
    shape = report.shapes["cable"]
    assert force + shape.force[-1, 2] - shape.force[0, 2] == pytest.approx(0.1 * 1.2 * 9.81, rel=1e-3)
    through = cs.Cycle(cable, scene=cs.Scene(obstacles=[table])).step({"cable": ends}, 0)
    (overlap,) = (w for w in through.warnings if w.other == "table")
    assert overlap.severity is Severity.ERROR
    assert "overlaps 'table'" in overlap.text
