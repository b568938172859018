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
    with pytest.raises(cs.ArgumentError, match=r"scene of a Cycle cannot be exchanged.*Cycle\(cables, scene=scene\)"):
        cycle.scene = cs.Scene()
    assert cycle.scene.warn_distance == 0.1
    with pytest.raises(AttributeError):
        cycle.cables = {}  # type: ignore[misc]


def test_a_shape_says_whether_it_is_usable() -> None:
    start, straight, far = cs.Pose(), cs.Pose((0.5, 0, 0)), cs.Pose((9, 0, 0))
    assert cs.predict(CABLE, start, straight).usable is True
    assert cs.predict(CABLE, start, far).usable is False


TABLE = ((0.0, 1.0, 0.0), (3.0, 0.0, 1.0), (-1.0, 2.0, 0.5), (0.0, -2.0, 2.0), (1.0, 0.0, 0.0))
LOAD = ((0.0, 0.2, 0.0), (0.0, 0.4, 0.1))


def test_cables_that_move_and_cables_at_rest_are_predicted_as_by_themselves() -> None:
    cycle = cs.Cycle({"a": CABLE, "b": CABLE}, model="cosserat")
    grips = {"a": (START, END), "b": (END, cs.Pose((1.4, 0.3, 1.0), ALONG_X))}
    still = {name: cs.predict(CABLE, *ends, model="cosserat").positions for name, ends in grips.items()}
    moving = {name: cs.predict(CABLE, *e, model="cosserat", acceleration=TABLE).positions for name, e in grips.items()}
    assert np.abs(still["a"] - moving["a"]).max() > 0.01
    for k, swung in enumerate(((), ("a",), ("a", "b"), ("b",), ())):
        report = cycle.step(grips, 1_000 * k, acceleration=dict.fromkeys(swung, TABLE))
        for name, shape in report.shapes.items():
            wanted = moving[name] if name in swung else still[name]
            assert shape.status is cs.Status.OK
            np.testing.assert_allclose(shape.positions, wanted, rtol=0.0, atol=2e-5)
    assert all(shape.reused for shape in cycle.step(grips, 9_000).shapes.values())


def test_a_constant_acceleration_is_another_gravity_for_shapes_margins_and_tubes() -> None:
    push = np.array((1.0, -2.0, 3.0))
    cable = CABLE.replace(max_tension=2.0, min_bend_radius=0.05)
    spread = cs.Uncertainty({"length": 1e-3, "bending_stiffness": 0.1}, start=(1e-3, 0.01))
    ball = cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.4, 0.1, 0.7)))
    options = {"scene": cs.Scene(obstacles=[ball]), "uncertainty": spread, "model": "cosserat", "tolerance": 1e-8}
    moved = cs.Cycle(cable, **options).step({"cable": (START, END)}, 0, acceleration={"cable": push})
    tilted = cs.Cycle(cable, gravity=(0, 0, -9.81) - push, **options).step({"cable": (START, END)}, 0)
    for report in (moved, tilted):
        assert report.shapes["cable"].status is cs.Status.OK
    near, far = (report.tubes["cable"] for report in (moved, tilted))
    np.testing.assert_allclose(moved.shapes["cable"].positions, tilted.shapes["cable"].positions, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(near.radius, far.radius, rtol=0.0, atol=1e-6)
    assert near.radius.max() > 1e-3
    ours, theirs = moved.margins["cable"], tilted.margins["cable"]
    assert [margin.kind for margin in ours] == [margin.kind for margin in theirs]
    np.testing.assert_allclose([m.used for m in ours], [m.used for m in theirs], rtol=1e-4)


def test_distributed_loads_are_of_all_cables_or_of_each() -> None:
    grips = {"a": (START, END), "b": (END, cs.Pose((1.4, 0.3, 1.0), ALONG_X))}
    for given, loaded in ((LOAD, ("a", "b")), ({"b": LOAD}, ("b",)), (None, ())):
        cycle = cs.Cycle({"a": CABLE, "b": CABLE}, model="cosserat", distributed_load=given)
        for name, shape in cycle.step(grips, 0).shapes.items():
            own = LOAD if name in loaded else None
            wanted = cs.predict(CABLE, *grips[name], model="cosserat", distributed_load=own)
            np.testing.assert_array_equal(shape.positions, wanted.positions)


def test_an_acceleration_that_is_refused_is_named_before_anything_is_predicted() -> None:
    grips = {"a": (START, END), "b": (END, cs.Pose((1.4, 0.3, 1.0), ALONG_X))}
    refused = [
        (cs.Cycle({"a": CABLE, "b": CABLE}, model="gradient4"), {"b": TABLE}, r"\['b'\]: .*gradient4.*linear"),
        (cs.Cycle({"a": CABLE, "b": CABLE}, scene=cs.Scene(contact="solve")), {"b": TABLE}, "contact='solve'.*linear"),
        (cs.Cycle({"a": CABLE, "b": CABLE}), {"c": (0, 0, 1)}, "unknown key 'c'"),
    ]
    for cycle, acceleration, words in refused:
        before = cycle.step(grips, 5)
        with pytest.raises(cs.ArgumentError, match=words):
            cycle.step(grips, 6, acceleration=acceleration)
        assert cycle.last_stamp == 5
        for name, shape in cycle.step(grips, 6).shapes.items():
            np.testing.assert_array_equal(shape.positions, before.shapes[name].positions)
    with pytest.raises(cs.ArgumentError, match="unknown key 'b'"):  # it is not stepped
        cs.Cycle({"a": CABLE, "b": CABLE}).step({"a": grips["a"]}, 0, acceleration={"b": (0, 0, 1)})
