"""Clips on robot links: as good as clips in the world where the links put them, wherever cables are predicted."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.prediction.cables_predictor import CablesPredictor
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).resolve().parents[2] / "config" / "robots" / "dual_arm.yaml"
ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
START, END = cs.Pose((0, 0, 0.5), ALONG_X), cs.Pose((0.8, 0, 0.5), ALONG_X)
#: of the clip in its link's frame: beside the link's origin, and turned
OWN = cs.Pose((0.03, 0.05, 0.02), (0.55, 0.45, 0.5, math.sqrt(1.0 - 0.755)))
KINDS = ("ball", "hinge", "fixed", "slide")


def link_at(k: float) -> cs.Pose:
    """Where the link is at an instant: it moves and turns."""
    return cs.Pose((0.4, 0.012 * k, 0.42 + 0.01 * k), (0.0, 0.0, math.sin(0.03 * k), math.cos(0.03 * k)))


def on_link(kind: str = "ball", link: str = "tool") -> cs.Clip:
    return cs.Clip(0.5, OWN, kind=kind, name="guide", link=link)


def in_world(clip: cs.Clip, link: cs.Pose) -> cs.Clip:
    return dataclasses.replace(clip, pose=link * clip.pose, link=None)


@pytest.mark.parametrize("kind", KINDS)
def test_a_clip_on_a_link_is_a_clip_where_that_puts_it(kind: str) -> None:
    clip = on_link(kind)
    for k in range(3):
        links = {"tool": link_at(k), "other": cs.Pose()}
        a = cs.predict(CABLE, START, END, scene=cs.Scene(clips=[clip]), links=links)
        b = cs.predict(CABLE, START, END, scene=cs.Scene(clips=[in_world(clip, link_at(k))]))
        assert a.status is b.status is cs.Status.OK
        assert np.array_equal(a.buffer, b.buffer)
        assert np.array_equal(a.supports, b.supports)


@pytest.mark.parametrize("contact", ["warn", "solve"])
@pytest.mark.parametrize("kind", KINDS)
def test_it_takes_the_cable_along_from_shape_to_shape(kind: str, contact: str) -> None:
    """As clip and body in the world do that are moved there, on the same branch; the bar is below the cable."""
    bar = cs.Obstacle("bar", cs.Capsule(0.03, 0.3), cs.Pose((0.2, 0.0, -0.1), (0.7071, 0, 0, 0.7071)), link="tool")
    scene = cs.Scene(clips=[on_link(kind)], obstacles=[bar], contact=contact)
    linked = cs.Predictor(CABLE, scene=scene, model="cosserat", points=151)
    moved = cs.Predictor(CABLE, model="cosserat", points=151)
    for k in np.arange(0.0, 4.0, 0.5):
        link = link_at(k)
        shape = linked.predict(START, END, {"tool": link})
        there = dataclasses.replace(bar, pose=link * bar.pose, link=None)
        moved.scene = scene.replace(clips=[in_world(on_link(kind), link)], obstacles=[there])
        other = moved.predict(START, END)
        assert shape.status is other.status is cs.Status.OK
        assert not shape.reused
        assert np.abs(shape.positions - other.positions).max() < 1e-6
    assert bool(shape.contacts) == (contact == "solve")
    if kind != "slide":
        assert shape.positions[75] == pytest.approx((link_at(3.5) * OWN).position, abs=1e-6)


def test_only_a_link_that_moves_asks_for_a_new_shape() -> None:
    predictor = cs.Predictor(CABLE, scene=cs.Scene(clips=[on_link()]))
    links = {"tool": link_at(0.0), "other": cs.Pose()}
    predictor.predict(START, END, links)
    assert predictor.predict(START, END, links).reused
    links["other"] = cs.Pose((1, 2, 3))
    assert predictor.predict(START, END, links).reused
    links["tool"] = link_at(1.0)  # the same mapping, which says something else now
    assert not predictor.predict(START, END, links).reused


def test_where_a_link_is_must_be_known() -> None:
    predictor = cs.Predictor(CABLE, scene=cs.Scene(clips=[cs.Clip(0.5, OWN, link="tool")]))
    with pytest.raises(cs.ArgumentError, match=r"clip 'clip0' is on link 'tool'.*Give links=") as told:
        predictor.predict(START, END)
    assert "without a link" in str(told.value)
    with pytest.raises(cs.ArgumentError, match="the pose of link 'tool' is missing, which carries 'clip0'"):
        predictor.predict(START, END, {"tolo": link_at(0.0)})
    assert predictor.predict(START, END, {"tool": link_at(0.0)}).status is cs.Status.OK
    starts, ends = (np.tile(pose.array, (2, 1)) for pose in (START, END))
    with pytest.raises(cs.ArgumentError, match="clip 'clip0' is on link 'tool'"):
        cs.predict_batch(CABLE, starts, ends, scene=predictor.scene)
    with pytest.raises(cs.ArgumentError, match="clip 'clip0' is on link 'tool'"):
        cs.Motion(CABLE, scene=predictor.scene).begin(START, END)
    with pytest.raises(cs.ArgumentError, match=r"Clip\.link"):
        cs.Clip(0.5, OWN, link="")


def test_files_say_the_link() -> None:
    clip = on_link("hinge")
    told = cs.Scene(clips=[clip]).as_dict()
    assert told["clips"][0]["link"] == "tool"
    assert cs.Scene.from_mapping(told).clips == (clip,)
    assert "link" not in cs.Scene(clips=[in_world(clip, link_at(0.0))]).as_dict()["clips"][0]


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_the_clip_are_those_of_differences(kind: str) -> None:
    """Of the link moved so that the clip's origin moves along, and turns about, world axes."""
    predictor = cs.Predictor(CABLE, scene=cs.Scene(clips=[on_link(kind)]), tolerance=1e-9)
    base = link_at(2.0)
    predictor.predict(START, END, {"tool": base})
    found = predictor.sensitivity(("clip:guide",))
    origin, step = (base * OWN).position, 1e-4

    def moved(axis: int, by: float) -> np.ndarray:
        shift, half = np.zeros(3), np.zeros(3)
        (shift if axis < 3 else half)[axis % 3] = by
        turn = cs.Pose((0, 0, 0), (*(0.5 * half), math.sqrt(1.0 - 0.25 * by**2)))
        way = cs.Pose(origin + shift) * turn * cs.Pose(-origin)
        return predictor.predict(START, END, {"tool": way * base}).positions

    for axis in range(6):
        wanted = (moved(axis, step) - moved(axis, -step)) / (2.0 * step)
        assert found[:, :, axis] == pytest.approx(wanted, abs=1e-3 * max(1e-3, np.abs(found).max()))


def test_a_harness_is_held_on_links_too() -> None:
    harness = cs.Harness(
        {"a": CABLE.replace(length=0.4), "b": CABLE.replace(length=0.4)}, [cs.Junction("j", ("a.end", "b.start"))]
    )
    clip = cs.Clip(0.2, OWN, kind="hinge", segment="b", link="tool")
    linked = cs.Predictor(harness, scene=cs.Scene(clips=[clip]))
    for k in range(3):
        ends = {"a.start": START, "b.end": cs.Pose((0.72, 0, 0.5), ALONG_X)}
        link = cs.Pose((0.52, 0.01 * k - 0.05, 0.42))
        shape = linked.predict(ends, links={"tool": link})
        fixed = cs.predict(harness, ends, scene=cs.Scene(clips=[in_world(clip, link)]))
        assert shape.status is fixed.status is cs.Status.OK
        for name, segment in shape.segments.items():
            assert np.abs(segment.positions - fixed.segments[name].positions).max() < 1e-5
    again = linked.predict(ends, links={"tool": link})
    assert all(segment.reused for segment in again.segments.values())
    with pytest.raises(cs.ArgumentError, match="clip 'clip0' is on link 'tool'"):
        linked.predict(ends)


@pytest.mark.parametrize("harness", [False, True], ids=["cable", "harness"])
def test_what_swings_goes_along_as_two_cables_that_end_there_do(harness: bool) -> None:
    swings, half = CABLE.replace(drag=0.05, retardation_time=0.02), CABLE.replace(length=0.5)
    half = half.replace(drag=0.05, retardation_time=0.02)
    clip = dataclasses.replace(on_link("fixed"), segment="a" if harness else None)
    whole = cs.Motion(
        cs.Harness({"a": swings}) if harness else swings, scene=cs.Scene(clips=[clip]), points=41, elements=40
    )
    parts = [cs.Motion(half, points=21, elements=20) for _ in range(2)]
    ends: Any = ({"a.start": START, "a.end": END},) if harness else (START, END)
    shape = whole.begin(*ends, links={"tool": link_at(0)})
    halves = [parts[0].begin(START, link_at(0) * OWN), parts[1].begin(link_at(0) * OWN, END)]
    for k in range(1, 31):
        link = link_at(0.2 * k)
        shape = whole.step(*ends, 0.01, {"tool": link})
        halves = [parts[0].step(START, link * OWN, 0.01), parts[1].step(link * OWN, END, 0.01)]
        assert shape.usable, shape.detail
        both = np.concatenate((halves[0].positions, halves[1].positions[1:]))
        line = shape.segments["a"].positions if harness else shape.positions
        assert np.abs(line - both).max() < 1e-7
        load = shape.clips[0].force
        np.testing.assert_allclose(load, halves[1].force[0] - halves[0].force[-1], atol=1e-6)
        assert shape.work == pytest.approx(sum(one.work for one in halves), abs=1e-9)
    assert np.abs(shape.velocity).max() > 0.1
    stays = whole.step(*ends, 0.01)
    line = stays.segments["a"].positions if harness else stays.positions
    assert line[20] == pytest.approx((link_at(6.0) * OWN).position, abs=1e-9)


@pytest.mark.parametrize("harness", [False, True], ids=["cable", "harness"])
def test_what_swings_runs_through_an_eyelet_that_moves(harness: bool) -> None:
    """Drawn along by it, and at rest where the cable is at rest in it; energy comes from what moves the eyelet."""
    swings = CABLE.replace(drag=0.3, retardation_time=0.05)
    clip = dataclasses.replace(on_link("slide"), segment="a" if harness else None)
    options: dict[str, Any] = {"scene": cs.Scene(clips=[clip]), "points": 61}
    cable = cs.Harness({"a": swings}) if harness else swings
    motion, still = cs.Motion(cable, **options), cs.Predictor(cable, **options)
    ends: Any = ({"a.start": START, "a.end": END},) if harness else (START, END)
    begin = motion.begin(*ends, links={"tool": link_at(0)})
    given, worked = begin.energy, 0.0
    for k in range(1, 401):
        link = link_at(0.06 * min(k, 100))
        shape = motion.step(*ends, 0.01, {"tool": link})
        assert shape.usable, shape.detail
        given, worked = given + shape.work, worked + abs(shape.work)
        assert shape.energy + shape.kinetic_energy < given + 1e-6
        line = shape.segments["a"] if harness else shape
        place = [np.interp(shape.clips[0].arc_length, line.arc_length, x) for x in line.positions.T]
        np.testing.assert_allclose(place, (link * OWN).position, atol=5e-4)
    lying = still.predict(*ends, links={"tool": link})
    there = lying.segments["a"] if harness else lying
    assert np.abs(line.positions - there.positions).max() < 5e-4
    assert shape.clips[0].arc_length == pytest.approx(lying.clips[0].arc_length, abs=5e-4)
    assert worked > 0.005


def test_cables_that_touch_each_other_go_with_their_clips() -> None:
    """One lies over the other, each in a clip on a link of its own, in another order than their names are in."""
    across = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    own = {
        "under": [cs.Clip(0.2, cs.Pose((0.0, 0.0, 0.02)), link="low", name="same")],
        "over": [cs.Clip(0.15, cs.Pose((0.01, 0.0, 0.0)), link="high", name="same")],
    }
    cable = cs.Cable(length=0.6, linear_density=0.05, bending_stiffness=0.01, diameter=0.008)
    predictor = CablesPredictor(dict.fromkeys(own, cable), scene=cs.Scene(contact="solve"), clips=own)
    for k in range(8):
        height = 0.02 - 0.006 * k
        grips = {
            "under": (cs.Pose((-0.28, 0, 0), ALONG_X), cs.Pose((0.28, 0, 0), ALONG_X)),
            "over": (cs.Pose((0.02, -0.28, height), across), cs.Pose((0.02, 0.28, height), across)),
        }
        links = {"high": cs.Pose((0.01, -0.15, height - 0.05)), "low": cs.Pose((-0.1, 0.001 * k, -0.07))}
        shapes = predictor.predict(grips, links)
        assert all(shape.status is cs.Status.OK for shape in shapes.values()), k
    assert shapes["under"].contacts
    for name, clip in (("under", own["under"][0]), ("over", own["over"][0])):
        shape = shapes[name]
        there = np.array([np.interp(clip.arc_length, shape.arc_length, x) for x in shape.positions.T])
        assert there == pytest.approx((links[clip.link] * clip.pose).position, abs=2e-5)


def test_a_robot_without_the_link_is_told_at_once() -> None:
    robot = Robot.from_yaml(ROBOT)
    check_links(robot, cs.Scene(clips=[on_link(link="left_tool")]))
    with pytest.raises(cs.RobotError, match=r"'guide' is on a link of the scene.*no link 'left_tol'.*'left_tool'"):
        check_links(robot, cs.Scene(clips=[on_link(link="left_tol")]))
    with pytest.raises(cs.RobotError, match="'box' is on a link"):
        check_links(robot, cs.Scene(obstacles=[cs.Obstacle("box", cs.Sphere(0.1), link="no")]))
    with pytest.raises(cs.RobotError, match="clip 'guide' is on link 'left_tool', and no joint positions tell"):
        check_links(None, cs.Scene(clips=[on_link(link="left_tool")]))
    check_links(None, cs.Scene(obstacles=[cs.Obstacle("box", cs.Sphere(0.1), link="no")]))  # left out, as ever
