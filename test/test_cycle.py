"""Cycle.step: the road from grips to report, without ROS, files or viewer."""

import numpy as np
import pytest

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
START = cs.Pose((0.0, 0.0, 1.0), ALONG_X)
END = cs.Pose((0.8, 0.0, 1.0), ALONG_X)


def lowest(shape: cs.CableShape) -> np.ndarray:
    return np.asarray(shape.positions[shape.positions[:, 2].argmin()])


def test_a_step_reports_shape_clearance_and_warnings() -> None:
    low = lowest(cs.predict(CABLE, START, END, model="gradient4"))
    ball = cs.Obstacle("ball", cs.Sphere(0.1), cs.Pose((low[0], low[1], low[2] - 0.1 - 0.02 - 0.004)))
    cycle = cs.Cycle(CABLE, scene=cs.Scene(obstacles=[ball]), model="gradient4")
    report = cycle.step({"cable": (START, END)}, stamp=1_000)
    assert report.stamp == 1_000
    assert report.shapes["cable"].status is cs.Status.OK
    closest = report.clearance["cable"].closest
    assert closest is not None
    assert closest.body == "ball"
    assert closest.distance == pytest.approx(0.02, abs=1e-4)
    (warning,) = report.warnings
    assert warning.kind is cs.WarningKind.CLEARANCE
    assert warning.severity is cs.Severity.WARN
    assert warning.other == "ball"
    assert not report.robot_checked
    assert report.times["total"] >= report.times["predict"] > 0.0


def test_shapes_are_given_early_and_links_are_asked_for_after_that() -> None:
    finger = cs.Obstacle("finger", cs.Sphere(0.02), link="tool")
    cycle = cs.Cycle(CABLE, robot_links=[finger])
    events: list[object] = []

    def links() -> dict[str, cs.Pose]:
        events.append("links")
        return {"tool": END}

    report = cycle.step({"cable": (START, END)}, 1_000, links, lambda shapes: events.append(dict(shapes)))
    assert events == [{"cable": report.shapes["cable"]}, "links"]
    assert report.links == {"tool": END}
    assert report.robot_checked
    again = cs.Cycle(CABLE, robot_links=[finger]).step({"cable": (START, END)}, 1_000, {"tool": END})
    assert again.clearance["cable"].bodies[0].distance == report.clearance["cable"].bodies[0].distance


def test_links_move_their_geometry_and_are_said_to_be_checked() -> None:
    finger = cs.Obstacle("finger", cs.Sphere(0.05), link="hand")
    cycle = cs.Cycle(CABLE, robot_links=[finger], model="gradient4")
    without = cycle.step({"cable": (START, END)}, stamp=0)
    assert not without.robot_checked
    assert without.clearance["cable"].closest is None
    low = lowest(without.shapes["cable"])
    near = cycle.step({"cable": (START, END)}, stamp=1, links={"hand": cs.Pose(low - (0, 0, 0.06))})
    assert near.robot_checked
    closest = near.clearance["cable"].closest
    assert closest is not None
    assert closest.body == "finger"
    assert closest.distance == pytest.approx(0.006, abs=1e-4)
    assert near.shapes["cable"].reused, "the same grips give the last shape again"
    assert near.skipped["reused"] == 1


def test_several_cables_are_predicted_each_with_its_own_warm_start() -> None:
    cycle = cs.Cycle({"a": CABLE, "b": CABLE.replace(length=1.0)}, model="gradient4")
    report = cycle.step({"a": (START, END), "b": (START, END)}, stamp=0)
    assert report.shapes["a"].length == 1.2
    assert report.shapes["b"].length == 1.0
    assert lowest(report.shapes["a"])[2] < lowest(report.shapes["b"])[2]
    only_b = cycle.step({"b": (START, END)}, stamp=1)
    assert list(only_b.shapes) == ["b"]
    with pytest.raises(cs.ArgumentError, match=r"cable = 'c' .*Known: a, b"):
        cycle.step({"c": (START, END)}, stamp=2)


def test_a_stamp_going_backwards_is_refused_and_reset_forgives() -> None:
    cycle = cs.Cycle(CABLE, model="gradient4")
    cycle.step({"cable": (START, END)}, stamp=2_000_000_000)
    with pytest.raises(cs.StaleInputError, match=r"1500000000 ns is 0.500000 s older than the last one, 2000000000 ns"):
        cycle.step({"cable": (START, END)}, stamp=1_500_000_000)
    assert cycle.step({"cable": (START, END)}, stamp=2_000_000_000).stamp == 2_000_000_000
    cycle.reset()
    assert not cycle.step({"cable": (START, END)}, stamp=0).shapes["cable"].reused


def test_overstretched_is_a_warning_and_the_next_step_recovers() -> None:
    cycle = cs.Cycle(CABLE, model="gradient4")
    report = cycle.step({"cable": (START, cs.Pose((1.3, 0.0, 1.0), ALONG_X))}, stamp=0)
    assert [w.kind for w in report.warnings] == [cs.WarningKind.OVERSTRETCHED]
    assert report.warnings[0].severity is cs.Severity.ERROR
    assert cycle.step({"cable": (START, END)}, stamp=1).warnings == ()


def test_a_cycle_needs_a_cable() -> None:
    with pytest.raises(cs.ArgumentError, match="at least one"):
        cs.Cycle({})


def test_the_scene_of_a_cycle_cannot_be_exchanged() -> None:
    cycle = cs.Cycle(CABLE, scene=cs.Scene(warn_distance=0.1))
    with pytest.raises(cs.ArgumentError, match=r"scene of a Cycle cannot be changed.*Cycle\(cables, scene=scene\)"):
        cycle.scene = cs.Scene()
    assert cycle.scene.warn_distance == 0.1
    with pytest.raises(AttributeError):
        cycle.cables = {}  # type: ignore[misc]


def test_a_shape_says_whether_it_is_usable() -> None:
    start, straight, far = cs.Pose(), cs.Pose((0.5, 0, 0)), cs.Pose((9, 0, 0))
    assert cs.predict(CABLE, start, straight).usable is True
    assert cs.predict(CABLE, start, far).usable is False
