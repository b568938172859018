"""Several cables, and harnesses, of a cycle that are kept out of each other as they swing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cable_shape as cs

X, Y = (0.5, 0.5, 0.5, 0.5), (-0.7071, 0.0, 0.0, 0.7071)  # d3 along x, and along y
CABLE = cs.Cable(0.55, linear_density=0.05, bending_stiffness=0.01, diameter=0.008, retardation_time=0.02, drag=0.05)
SOLVED = cs.Scene(contact="solve")
MS = 1_000_000  # ns


def across(z: float, x: float = 0.02) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    """A cable along x, and one along y that is so much higher."""
    return {
        "under": (cs.Pose((-0.25, 0.0, 0.0), X), cs.Pose((0.25, 0.0, 0.0), X)),
        "over": (cs.Pose((x, -0.25, z), Y), cs.Pose((x, 0.25, z), Y)),
    }


def down(k: int) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    """The upper one is let down on the lower one, in 44 steps."""
    return across(max(0.04 - 0.001 * k, -0.004))


def run(cycle: cs.Cycle, first: int, last: int, names: tuple[str, ...] = ("under", "over")) -> cs.CycleReport:
    """Steps of 10 ms."""
    for k in range(first, last):
        held = down(k)
        report = cycle.step({name: held[name] for name in names}, 10 * k * MS)
        assert all(shape.usable for shape in report.shapes.values())
    return report


def touched(report: cs.CycleReport) -> dict[str, set[str]]:
    """What each rests on."""
    return {name: {contact.body for contact in shape.contacts} for name, shape in report.shapes.items()}


def test_they_take_the_steps_of_one_motion_of_all():
    cycle = cs.Cycle({"under": CABLE, "over": CABLE}, scene=SOLVED, motion="dynamic", look_ahead=0.05)
    motion = cs.Motion(cs.Harness({"under": CABLE, "over": CABLE}, []), SOLVED)
    for k in range(55):
        held = down(k)
        report = cycle.step(held, 10 * k * MS)
        ends = {
            f"{name}.{side}": end
            for name, both in held.items()
            for side, end in zip(("start", "end"), both, strict=True)
        }
        shape = motion.step(ends, 0.01) if k else motion.begin(ends)
        for name, one in shape.segments.items():
            np.testing.assert_array_equal(report.shapes[name].buffer, one.buffer)
            assert np.isnan(report.shapes[name].kinetic_energy)  # it is told of all together alone
    assert touched(report) == {"under": {"over"}, "over": {"under"}}
    assert set(report.ahead) == {"under", "over"}
    assert report.shapes["over"].velocity is not None
    assert [warning.text.split(" at ")[0] for warning in report.warnings] == [
        "under: rests on 'over'", "over: rests on 'under'"
    ]  # fmt: skip
    again = cycle.step(down(54), 540 * MS)
    assert again.shapes["over"].reused
    np.testing.assert_array_equal(again.shapes["over"].buffer, report.shapes["over"].buffer)


@pytest.mark.parametrize(
    ("scene", "known"),
    [(None, None), (cs.Scene(), None), (cs.Scene(), cs.Uncertainty(start=(1e-3, 0.0)))],
    ids=["nothing", "warn", "tubes"],
)
def test_otherwise_each_swings_for_itself_to_the_bit(scene: cs.Scene | None, known: cs.Uncertainty | None):
    cables = {"under": CABLE, "over": CABLE}
    options: dict[str, Any] = {"scene": scene, "uncertainty": known, "motion": "dynamic", "points": 41}
    both = cs.Cycle(cables, **options)
    report = run(both, 0, 55)
    for name in cables:
        own = run(cs.Cycle({name: CABLE}, **options), 0, 55, (name,))
        np.testing.assert_array_equal(report.shapes[name].buffer, own.shapes[name].buffer)
    assert touched(report) == {"under": set(), "over": set()}


@pytest.mark.parametrize("known", [("under",), ("under", "over")])
def test_what_is_kept_out_of_each_other_has_no_tube_as_it_swings(known: tuple[str, ...]):
    """Each tube would be of a motion by itself, and that goes through the other cable."""
    spread = cs.Uncertainty(start=(1e-3, 0.0))
    options: dict[str, Any] = {"uncertainty": dict.fromkeys(known, spread), "scene": SOLVED, "points": 41}
    cables = {"under": CABLE, "over": CABLE}
    with pytest.raises(cs.ArgumentError, match=r"would pass through other cables.*Leave the uncertainty out"):
        cs.Cycle(cables, motion="dynamic", **options)
    cs.Cycle(cables, motion="quasistatic", **options)
    alone = cs.Cycle({"under": CABLE}, motion="dynamic", scene=SOLVED, uncertainty=spread)
    assert run(alone, 0, 3, ("under",)).tubes["under"].radius.max() > 0.5e-3


def test_what_holds_and_loads_each_is_that_of_each():
    """Far from each other they swing as each by itself: in clips of one name, with masses and loads."""
    clips = {"under": [cs.Clip(0.275, cs.Pose((0.0, 0.0, -0.1), X), kind="ball", name="c")]}
    load = {"over": np.array(((0.3, 0.0, 0.0), (0.4, 0.0, 0.0)))}  # it bows to one side
    shapes = []
    for far in (0.5, 0.0):
        clips["over"] = [cs.Clip(0.275, cs.Pose((0.02, 0.0, far - 0.1), Y), kind="ball", name="c")]
        scene = cs.Scene(contact="solve", masses=[cs.PointMass(0.1, 0.02)])
        cables = {"under": CABLE, "over": CABLE.replace(bending_stiffness=0.02)}
        options: dict[str, Any] = {"scene": scene, "motion": "dynamic", "points": 61}
        names = ("under", "over") if far else ("over",)
        cycle = cs.Cycle(
            {name: cables[name] for name in names}, clips={name: clips[name] for name in names},
            distributed_load=load, **options,
        )  # fmt: skip
        for k in range(40):
            held = across(far + 0.01 * np.sin(0.3 * k))
            report = cycle.step({name: held[name] for name in names}, 10 * k * MS)
            assert all(shape.usable for shape in report.shapes.values())
        shapes.append(report.shapes["over"])
    up = np.array((0.0, 0.0, 0.5))
    assert np.abs(shapes[0].positions - up - shapes[1].positions).max() < 1e-5
    np.testing.assert_allclose(shapes[0].clips[0].force, shapes[1].clips[0].force, atol=1e-3)


def test_a_harness_and_a_cable_touch_each_other():
    arm = CABLE.replace(length=0.28)
    fork = cs.Harness({"a": arm, "b": arm}, [cs.Junction("j", ("a.end", "b.start"))])
    cycle = cs.Cycle({"h": fork, "over": CABLE}, scene=SOLVED, motion="dynamic", points=61)
    for k in range(60):
        held = down(k)
        ends: Any = {"h": {"a.start": held["under"][0], "b.end": held["under"][1]}, "over": held["over"]}
        report = cycle.step(ends, 10 * k * MS)
        assert all(shape.usable for shape in report.shapes.values())
    on = {contact.body for contact in report.shapes["over"].contacts}
    assert on
    assert on <= {"h/a", "h/b"}
    parts = report.shapes["h"].segments
    assert {contact.body for one in parts.values() for contact in one.contacts} == {"over"}
    np.testing.assert_allclose(parts["a"].positions[-1], parts["b"].positions[0], atol=1e-9)
    assert report.shapes["h"].junctions["j"].position == pytest.approx(parts["a"].positions[-1])


def test_one_that_falls_silent_and_comes_back_goes_on():
    cycle = cs.Cycle({"under": CABLE, "over": CABLE}, scene=SOLVED, motion="dynamic", points=61)
    lying = run(cycle, 0, 70).shapes
    alone = run(cycle, 70, 74, ("over",)).shapes["over"]
    assert np.abs(alone.positions - lying["over"].positions).max() < 5e-3  # it goes on from where it was
    assert not alone.contacts
    back = run(cycle, 74, 75)
    assert np.abs(back.shapes["under"].positions - lying["under"].positions).max() < 5e-3
    assert touched(run(cycle, 75, 100)) == {"under": {"over"}, "over": {"under"}}


def test_edits_leave_them_swinging():
    """A body that comes far away changes nothing, to the bit; a clip takes one of them."""
    cables = {"under": CABLE, "over": CABLE}
    runs = []
    for edits in (False, True):
        cycle = cs.Cycle(cables, scene=SOLVED, motion="dynamic", points=61)
        run(cycle, 0, 20)
        if edits:
            box = cs.Obstacle("box", cs.Box((0.1, 0.1, 0.1)), cs.Pose((0.0, 0.0, -2.0)))
            assert cycle.edit(cs.Add(box)).done
        runs.append(run(cycle, 20, 30))
    for name in cables:
        np.testing.assert_array_equal(runs[0].shapes[name].buffer, runs[1].shapes[name].buffer)
    before = run(cycle, 30, 57).shapes
    over = before["over"]
    place = cs.Pose([np.interp(0.2, over.arc_length, column) for column in over.positions.T], Y)
    assert cycle.edit(cs.Insert(cs.Clip(0.2, place, kind="ball", name="c")), cable="over").done
    after = run(cycle, 57, 58)
    assert touched(after) == {"under": {"over"}, "over": {"under"}}
    for name in cables:
        assert np.abs(after.shapes[name].positions - before[name].positions).max() < 2e-3
    assert len(after.shapes["over"].clips) == 1


def test_out_of_reach_and_back():
    cycle = cs.Cycle({"under": CABLE, "over": CABLE}, scene=SOLVED, motion="dynamic", points=61)
    good = run(cycle, 0, 50)
    held = down(50)
    far = {**held, "over": (held["over"][0], cs.Pose((0.02, 0.5, 0.0), Y))}
    report = cycle.step(far, 500 * MS)
    assert not any(shape.usable for shape in report.shapes.values())
    assert "'over.end'" in report.shapes["under"].detail
    back = run(cycle, 51, 52)
    assert np.abs(back.shapes["over"].positions - good.shapes["over"].positions).max() < 5e-2
    cycle.reset()
    run(cycle, 0, 2)


def test_an_acceleration_is_refused_before_anything_moves():
    cycle = cs.Cycle({"under": CABLE, "over": CABLE}, scene=SOLVED, motion="dynamic", points=41)
    run(cycle, 0, 3)
    with pytest.raises(cs.ArgumentError, match="inertia"):
        cycle.step(down(3), 30 * MS, acceleration={"over": (0.0, 0.0, 1.0)})
    own = cs.Cycle({"under": CABLE, "over": CABLE}, scene=SOLVED, motion="dynamic", points=41)
    run(own, 0, 3)
    np.testing.assert_array_equal(run(cycle, 3, 4).shapes["over"].buffer, run(own, 3, 4).shapes["over"].buffer)
