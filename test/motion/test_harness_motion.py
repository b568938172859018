"""Harnesses as they swing: one cable in two, junctions, clips, masses, free ends, energy, what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
ARM = cs.Cable(length=0.5, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.02, drag=0.02)
Y = cs.Harness({"a": ARM, "b": ARM, "c": ARM}, [cs.Junction("j", ("a.end", "b.start", "c.start"))])


def at(x: float, y: float, z: float = 0.0) -> cs.Pose:
    return cs.Pose((x, y, z), ALONG)


def held(y: float, third: bool = True) -> dict[str, cs.Pose]:
    ends = {"a.start": at(0.0, y), "b.end": at(0.8, y, 0.1)}
    return ends | ({"c.end": cs.Pose((0.5, y + 0.4, 0.1))} if third else {})


def energy_of(shape: cs.HarnessShape | cs.CableShape) -> float:
    return shape.energy + shape.kinetic_energy


def among(solid: object, at: tuple[float, float, float] = (0.0, 0.0, 0.0), friction: float = 0.0) -> cs.Scene:
    """One body, called "body"."""
    body = cs.Obstacle("body", solid, cs.Pose(at), friction=friction)  # type: ignore[arg-type]
    return cs.Scene(obstacles=[body], contact="solve")


def contacts_of(shape: cs.HarnessShape) -> list[cs.Contact]:
    return [contact for one in shape.segments.values() for contact in one.contacts]


def lowest(shape: cs.HarnessShape) -> float:
    return float(min(one.positions[:, 2].min() for one in shape.segments.values()))


@pytest.mark.parametrize(
    ("scene", "steps", "near"),
    [
        pytest.param(None, 100, 2e-5, id="alone"),
        pytest.param(among(cs.HalfSpace(), (0.0, 0.0, -0.18)), 100, 1e-3, id="on a table"),
        pytest.param(among(cs.HalfSpace(), (0.0, 0.0, -0.18), 0.3), 30, 2e-4, id="on a rough table"),
        pytest.param(among(cs.Cylinder(0.02, 2.0), (0.35, 0.05, 0.0), 0.3), 60, 1e-3, id="against a post"),
    ],
)
def test_two_arms_with_a_straight_junction_are_one_cable(scene: cs.Scene | None, steps: int, near: float):
    """The junction hits the body, and rests on it, as what is inside a cable does.

    On a table it begins to lie aside, on either side: which one neither motion owes the other.
    """
    arm = ARM.replace(diameter=0.01)
    harness = cs.Harness({"a": arm, "b": arm}, [cs.Junction("j", ("a.end", "b.start"))])
    motion = cs.Motion(harness, scene, points=31, elements=20)
    one = cs.Motion(arm.replace(length=1.0), scene, points=61, elements=40)
    shape, other = motion.begin({"a.start": at(0.0, 0.0), "b.end": at(0.7, 0.0)}), one.begin(at(0.0, 0.0), at(0.7, 0.0))
    pushed, aside = set(), np.ones(3)
    if shape.segments["a"].positions[-1, 1] * other.positions[30, 1] < -1e-6:
        aside[1] = -1.0
    for k in range(1, steps + 1):
        y = 0.1 * np.sin(0.1 * k)
        shape = motion.step({"a.start": at(0.0, y), "b.end": at(0.7, 0.5 * y, 0.3 * y)}, 0.01)
        other = one.step(at(0.0, aside[1] * y), at(0.7, aside[1] * 0.5 * y, 0.3 * y), 0.01)
        assert shape.usable, shape.detail
        both = np.concatenate((shape.segments["a"].positions, shape.segments["b"].positions[1:]))
        assert np.abs(both - aside * other.positions).max() < near
        pushed |= {contact.arc_length for contact in shape.segments["a"].contacts}
    assert (scene is None and not pushed) or max(pushed) > 0.49
    if scene is not None:
        return
    assert other.velocity is not None
    assert np.abs(other.velocity).max() > 0.3
    assert shape.velocity is not None
    np.testing.assert_allclose(shape.velocity[:31], other.velocity[:31], atol=2e-3)
    assert shape.kinetic_energy == pytest.approx(other.kinetic_energy, rel=1e-3)
    assert shape.work == pytest.approx(other.work, rel=1e-2, abs=1e-5)
    assert shape.dissipated == pytest.approx(other.dissipated, rel=1e-2, abs=1e-5)


@pytest.mark.parametrize("third", [True, False], ids=["held", "free"])
def test_forces_at_a_junction_are_in_balance_and_energy_is_not_made(third: bool):
    motion = cs.Motion(Y, points=31)
    given = energy_of(motion.begin(held(0.0, third)))
    for k in range(1, 151):
        shape = motion.step(held(0.05 * (1.0 - np.cos(0.1 * k)), third), 0.01)
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-6
        a, b, c = (shape.segments[name] for name in "abc")
        assert np.abs(a.force[-1] - b.force[0] - c.force[0]).max() < 1e-9
        assert np.abs(a.moment[-1] - b.moment[0] - c.moment[0]).max() < 1e-3 * np.abs(a.moment[-1]).max() + 1e-6
        assert np.abs(a.positions[-1] - c.positions[0]).max() < 1e-9
        assert shape.lost == pytest.approx(0.0, abs=1e-3)
    assert shape.velocity is not None
    assert np.abs(shape.velocity).max() > 0.1


def test_it_comes_to_rest_where_it_hangs():
    arm = ARM.replace(retardation_time=0.2, drag=0.5)
    harness = cs.Harness(dict.fromkeys("abc", arm), Y.junctions)
    scene = cs.Scene(
        clips=[cs.Clip(0.25, cs.Pose((0.2, 0.0, -0.05), ALONG), "ball", segment="a")],
        masses=[cs.PointMass(0.3, 0.02, segment="b")],
    )
    motion = cs.Motion(harness, scene, points=31)
    motion.begin(held(0.0))
    for k in range(1, 301):
        shape = motion.step(held(0.05 * min(k / 50.0, 1.0)), 0.02)
        assert shape.usable, shape.detail
        assert np.abs(shape.segments["a"].positions[15] - (0.2, 0.0, -0.05)).max() < 1e-9
    still = cs.Predictor(harness, scene=scene, points=31).predict(held(0.05))
    for name in "abc":
        assert np.abs(shape.segments[name].positions - still.segments[name].positions).max() < 1e-4
    np.testing.assert_allclose(shape.clips[0].force, still.clips[0].force, rtol=3e-3, atol=3e-3)
    assert shape.kinetic_energy < 1e-9


def test_out_of_reach_the_state_is_kept():
    one, other = cs.Motion(Y, points=12), cs.Motion(Y, points=12)
    for motion in (one, other):
        motion.begin(held(0.0))
        motion.step(held(0.01), 0.01)
    far = one.step(held(0.0) | {"b.end": at(3.0, 0.0)}, 0.01)
    assert far.status is cs.Status.OVERSTRETCHED
    assert "kept" in far.detail
    back = [motion.step(held(0.02), 0.01) for motion in (one, other)]
    assert back[0].usable
    np.testing.assert_array_equal(back[0].buffer, back[1].buffer)


def test_what_it_refuses():
    with pytest.raises(cs.ArgumentError, match="Call begin first"):
        cs.Motion(Y).step(held(0.0), 0.01)
    motion = cs.Motion(Y, points=12)
    motion.begin(held(0.0))
    with pytest.raises(cs.ArgumentError, match="begin again"):
        motion.step(held(0.0, third=False), 0.01)
    with pytest.raises(cs.ArgumentError, match=r"segment 'a'.*linear_density"):
        cs.Motion(cs.Harness({"a": ARM.replace(linear_density=0.0)}))
    eyelets = [cs.Clip(0.03 * k, at(0.03 * k, 0.0), "slide", segment="a") for k in range(1, 14)]
    with pytest.raises(cs.ArgumentError, match="12 eyelets"):
        cs.Motion(Y, cs.Scene(clips=eyelets))


ASIDE = {"c.start": cs.Pose((0.0, 0.03, 0.0))}


@pytest.mark.parametrize(
    "junction",
    [
        pytest.param({}, id="rigid"),
        pytest.param({"kind": "ball"}, id="ball"),
        pytest.param({"frames": ASIDE}, id="aside"),
        pytest.param({"mass": 0.05}, id="heavy"),
    ],
)
def test_laid_on_a_table_it_comes_to_rest_where_it_lies(junction: dict[str, Any]):
    """Let down in half a second, junction and all; energy comes from the grips alone, the table carries the weight."""
    arm = cs.Cable(0.5, linear_density=0.1, bending_stiffness=1e-4, retardation_time=0.05, drag=0.3, diameter=0.01)
    harness = cs.Harness(dict.fromkeys("abc", arm), [cs.Junction("j", Y.junctions[0].ends, **junction)])
    table = among(cs.HalfSpace())
    motion, still = cs.Motion(harness, table, points=61), cs.Predictor(harness, scene=table, points=61)

    def let_down(z: float) -> dict[str, cs.Pose]:
        return {"a.start": at(0.0, 0.0, z), "b.end": at(0.9, 0.0, z), "c.end": cs.Pose((0.5, 0.4, z))}

    given = energy_of(motion.begin(let_down(0.3)))
    for k in range(1, 401):
        ends = let_down(0.21 + 0.09 * np.cos(np.pi * min(k / 50.0, 1.0)))
        shape = motion.step(ends, 0.01)
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-6
        assert lowest(shape) > 0.005 - 2e-4
    lying = still.predict(ends)
    for name, one in shape.segments.items():
        assert np.abs(one.positions - lying.segments[name].positions).max() < 2e-3
    carried = sum(contact.force for contact in contacts_of(shape))
    assert carried == pytest.approx(sum(contact.force for contact in contacts_of(lying)), rel=1e-2)
    pulled = sum(
        shape.segments[end[0]].force[0 if end.endswith("start") else -1] * (1.0 if end.endswith("start") else -1.0)
        for end in ends
    )
    weight = 9.81 * (3.0 * 0.05 + junction.get("mass", 0.0))
    assert carried - pulled[2] == pytest.approx(weight, rel=1e-3)
    assert {contact.body for contact in contacts_of(shape)} == {"body"}
    again = cs.Motion(harness, table, points=61)
    first = again.begin(ends)
    assert first.usable, first.detail
    assert contacts_of(first)
    for _ in range(5):
        last = again.step(ends, 0.01)
        assert lowest(last) > 0.005 - 2e-4
    for name in "abc":
        assert np.abs(last.segments[name].positions - first.segments[name].positions).max() < 5e-4
        assert np.abs(first.segments[name].positions - lying.segments[name].positions).max() < first.error_estimate


@pytest.mark.parametrize(("place", "hooked"), [(0.28, "a"), (0.43, "b")])
def test_it_does_not_whip_through_a_post(place: float, hooked: str):
    """Drawn against it at 4 m/s, with the junction beside it, and back: a post thinner than an element."""
    arm = cs.Cable(0.5, linear_density=0.1, bending_stiffness=3e-3, drag=0.05, retardation_time=0.02, diameter=0.006)
    harness = cs.Harness(dict.fromkeys("abc", arm), Y.junctions)
    motion = cs.Motion(harness, among(cs.Cylinder(0.004, 2.0), (place, 0.3, 0.0)), points=51)

    def ends(y: float) -> dict[str, cs.Pose]:
        return {"a.start": at(0.0, y, 0.3), "b.end": at(0.7, y, 0.3)}

    given, pushed, by = energy_of(motion.begin(ends(0.0))), 0, set()
    for k in range(1, 121):
        y = min(0.04 * k, 0.5) if k < 60 else max(0.5 - 0.04 * (k - 60), 0.0)
        shape = motion.step(ends(y), 0.01)
        assert shape.usable, shape.detail
        for one in shape.segments.values():
            off = np.hypot(one.positions[:, 0] - place, one.positions[:, 1] - 0.3)
            assert off.min() > 0.007 - 4e-4
        given += shape.work
        assert energy_of(shape) < given + 1e-5
        pushed += bool(contacts_of(shape))
        by |= {name for name, one in shape.segments.items() if one.contacts}
        if 20 < k < 60:  # hooked on the post
            assert shape.segments[hooked].positions[:, 1].min() < 0.3
    assert pushed > 10
    assert hooked in by


@pytest.mark.parametrize("free", ["c.start", "c.end"])
def test_what_arrives_does_not_bounce(free: str):
    """A mass on a branch whose end is free falls down on a table: it stays there, and so does the end."""
    arm = cs.Cable(0.3, linear_density=0.1, bending_stiffness=0.02, diameter=0.01)
    other = "c.end" if free == "c.start" else "c.start"
    harness = cs.Harness(dict.fromkeys("abc", arm), [cs.Junction("j", ("a.end", "b.start", other), kind="ball")])
    table = cs.Obstacle("table", cs.HalfSpace())
    scene = cs.Scene(obstacles=[table], contact="solve", masses=[cs.PointMass(0.15, 0.02, segment="c")])
    motion = cs.Motion(harness, scene, points=31)
    ends = {"a.start": at(0.0, 0.0, 0.01), "b.end": at(0.58, 0.0, 0.01)}
    assert motion.begin({**ends, free: cs.FreeEnd(force=(0.0, 0.2, 0.8))}).usable
    heights = []
    for _ in range(160):
        shape = motion.step({**ends, free: cs.FreeEnd()}, 0.005)
        assert shape.usable, shape.detail
        branch = shape.segments["c"]
        heights.append((branch.positions[0 if free == "c.start" else -1, 2], branch.positions[15, 2]))
    tip, mass = np.array(heights).T
    for height, least in ((tip, 0.05), (mass, 0.03)):
        down = int(np.argmax(height < 0.0051))
        assert 0 < down < 130
        assert height.max() > least
        assert height[down:].max() < 0.02
    assert sum(contact.force for contact in branch.contacts) > 0.5 * (0.02 + 0.1 * 0.3) * 9.81
    pressed = [contact.arc_length for contact in branch.contacts]
    assert np.abs(np.array(pressed) - 0.15).min() < 1e-9


@pytest.mark.parametrize("mass", [0.0, 0.01])
def test_it_runs_through_eyelets_as_one_cable(mass: float):
    """Two arms with a straight junction; a mass, a knot in a harness and none in a cable, goes through the eyelet."""
    arm = ARM.replace(bending_stiffness=0.003, retardation_time=0.05, drag=0.3)
    harness = cs.Harness({"a": arm, "b": arm}, [cs.Junction("j", ("a.end", "b.start"))])
    places = (0.22, 0.05, 0.05), (0.6, 0.02, 0.05)
    own = [cs.Clip(arc, cs.Pose(place, ALONG), "slide") for arc, place in zip((0.3, 0.83), places, strict=True)]
    named = [replace(own[0], segment="a"), replace(own[1], segment="b", arc_length=0.33)]
    scenes = [
        cs.Scene(clips=own, masses=[cs.PointMass(0.8, mass)] if mass else []),
        cs.Scene(clips=named, masses=[cs.PointMass(0.3, mass, segment="b")] if mass else []),
    ]
    one = cs.Motion(arm.replace(length=1.0), scenes[0], points=61, elements=40)
    motion = cs.Motion(harness, scenes[1], points=31, elements=20)
    other, shape = (
        one.begin(at(0.0, 0.0), at(0.75, 0.0)),
        motion.begin({"a.start": at(0.0, 0.0), "b.end": at(0.75, 0.0)}),
    )
    assert shape.usable, shape.detail
    for k in range(151):
        both = np.concatenate((shape.segments["a"].positions, shape.segments["b"].positions[1:]))
        near = 2e-5 if k > 20 else shape.error_estimate  # of rest at first
        assert np.abs(both - other.positions).max() < near
        for clip, wanted, before in zip(shape.clips, other.clips, (0.0, 0.5), strict=True):
            assert clip.arc_length + before == pytest.approx(wanted.arc_length, abs=near)
            np.testing.assert_allclose(clip.force, wanted.force, atol=10.0 * near)
        assert shape.dissipated == pytest.approx(other.dissipated, rel=1e-3, abs=1e-7)
        if k == 0:
            assert shape.clips[1].arc_length > 0.33
        x = 0.05 * min(k / 100.0, 1.0)
        ends = at(0.3 * x, 0.0, 0.0), at(0.75 + x, 0.3 * x, 0.0)
        other, shape = one.step(*ends, 0.01), motion.step({"a.start": ends[0], "b.end": ends[1]}, 0.01)
        assert shape.usable, shape.detail
    assert shape.clips[1].arc_length < 0.295


def test_branches_that_run_through_eyelets_lie_on_a_table():
    """Both at once: at rest again as the harness at rest, in the eyelet and on the body."""
    arm = cs.Cable(0.5, linear_density=0.1, bending_stiffness=1e-3, retardation_time=0.05, drag=0.5, diameter=0.01)
    harness = cs.Harness(dict.fromkeys("abc", arm), Y.junctions)
    eyelet = cs.Clip(0.3, cs.Pose((0.5, 0.25, 0.05)), "slide", segment="c")
    scene = among(cs.HalfSpace()).replace(clips=[eyelet])
    motion, still = cs.Motion(harness, scene, points=61), cs.Predictor(harness, scene=scene, points=61)

    def moved(x: float) -> dict[str, cs.Pose]:
        return {"a.start": at(0.0, 0.0, 0.1), "b.end": at(0.85, 0.0, 0.1), "c.end": cs.Pose((0.5, 0.4 + x, 0.1))}

    given = energy_of(motion.begin(moved(0.0)))
    first = motion.last.clips[0].arc_length
    for k in range(1, 401):
        shape = motion.step(moved(0.02 * (1.0 - np.cos(np.pi * min(k / 50.0, 1.0)))), 0.01)
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-5
        assert lowest(shape) > 0.005 - 2e-4
    lying = still.predict(moved(0.04))
    for name, one in shape.segments.items():
        assert np.abs(one.positions - lying.segments[name].positions).max() < 2e-3
    assert shape.clips[0].arc_length == pytest.approx(lying.clips[0].arc_length, abs=1e-3)
    assert shape.clips[0].arc_length < first - 0.02
    np.testing.assert_allclose(shape.clips[0].force, lying.clips[0].force, atol=1e-2)
    assert contacts_of(shape)


@pytest.mark.parametrize(
    ("stiffness", "kind", "free", "box", "post"),
    [
        (2.8e-3, "ball", False, (0.54, -0.01), (0.56, 0.14)),
        (1.6e-2, "rigid", False, (0.55, 0.27), (0.6, 0.1)),
        (1.4e-2, "rigid", True, (0.56, -0.15), (0.38, 0.16)),
    ],
)
def test_swept_about_on_rough_bodies_it_loses_no_step(
    stiffness: float, kind: str, free: bool, box: tuple[float, float], post: tuple[float, float]
):
    """Heavy junctions on a table, over edges of a box and a post: each step goes, and none goes too deep."""
    arm = cs.Cable(
        0.5,
        linear_density=0.1,
        bending_stiffness=stiffness,
        retardation_time=0.03,
        drag=0.05,
        diameter=0.007,
        friction=0.4,
    )
    segments = {"a": arm, "b": arm, "c": arm.replace(length=0.4, diameter=0.005), "d": arm.replace(length=0.3)}
    fork = cs.Junction("fork", ("a.end", "b.start", "c.start"), kind=kind, mass=0.02)
    harness = cs.Harness(segments, [fork, cs.Junction("splice", ("c.end", "d.start"))])
    bodies = [
        cs.Obstacle("table", cs.HalfSpace(), friction=0.3),
        cs.Obstacle("box", cs.Box((0.2, 0.2, 0.05)), cs.Pose((*box, 0.025)), friction=0.3),
        cs.Obstacle("post", cs.Cylinder(0.01, 0.08), cs.Pose((*post, 0.04))),
    ]
    motion = cs.Motion(harness, cs.Scene(obstacles=bodies, contact="solve"), points=41)

    def swept(t: float) -> dict[str, cs.Pose]:
        x, y, z = 0.1 * np.sin(5.0 * t), 0.25 * np.sin(3.0 * t), 0.35 - 0.25 * min(t / 0.6, 1.0)
        ends = {"a.start": at(x, y, z), "b.end": at(0.7 + x, 0.5 * y, z)}
        return ends if free else ends | {"d.end": cs.Pose((0.45, 0.4 + y, z))}

    begin = motion.begin(swept(0.0))
    assert begin.usable, begin.detail
    touched, pressed = set(), 0
    for k in range(1, 201):
        shape = motion.step(swept(0.01 * k), 0.01)
        assert shape.usable, (k, shape.detail)
        assert lowest(shape) > 0.0025 - 2e-4
        touched |= {contact.body for contact in contacts_of(shape)}
        pressed += any(contact.arc_length == 0.5 for contact in shape.segments["a"].contacts)
    assert touched >= {"table", "box"}
    assert pressed > 10
