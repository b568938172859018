"""Edits of harnesses: a cable in two segments is edited as the whole one is, and parts of a real one come and go."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
WHOLE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008, tails={"start": 0.1, "end": 0.2}
)
FIRST = 0.5  # m, of the first segment
LEFT, RIGHT = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.8, 0.0, 1.0), ALONG_X)
TABLE = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, 0.6)))
POST = cs.Obstacle("post", cs.Sphere(0.02), cs.Pose((0.4, 0.0, 0.3)))
SAME = 4e-5  # m, twice 1e-5 of the length, and of the whole one of 1.5 m


def halves() -> cs.Harness:
    a = WHOLE.replace(length=FIRST, tails={"start": 0.1})
    b = WHOLE.replace(length=WHOLE.length - FIRST, tails={"end": 0.2})
    return cs.Harness({"a": a, "b": b}, [cs.Junction("j", ("a.end", "b.start"))])


def clip(arc_length: float, *place: float, name: str, kind: str = "ball") -> tuple[Any, Any]:
    """As the whole cable has it, and as the harness does."""
    segment, at = ("a", arc_length) if arc_length < FIRST else ("b", arc_length - FIRST)
    pose = cs.Pose(place, ALONG_X)
    one, other = (cs.Clip(s, pose, kind, name=name, segment=of) for s, of in ((arc_length, None), (at, segment)))
    return cs.Insert(one), cs.Insert(other)


def both(contact: str) -> tuple[cs.Cycle, cs.Cycle]:
    scene = cs.Scene(contact=contact, obstacles=[TABLE])
    pair = cs.Cycle(WHOLE, scene=scene), cs.Cycle({"h": halves()}, scene=scene)
    for stamp in (0, 1):
        compare(*pair, (LEFT, RIGHT), stamp, SAME)
    return pair


def compare(one: cs.Cycle, other: cs.Cycle, ends: Any, stamp: int, same: float) -> None:
    shape: Any = one.step({"cable": ends}, stamp).shapes["cable"]
    found: Any = other.step({"h": {"a.start": ends[0], "b.end": ends[1]}}, stamp).shapes["h"]
    assert shape.status is cs.Status.OK, shape.detail
    assert found.status is cs.Status.OK, found.detail
    first = 0.0
    for part in found.segments.values():
        at = np.stack([np.interp(part.arc_length + first, shape.arc_length, x) for x in shape.positions.T], axis=1)
        h = shape.arc_length[1]
        straight = float(np.linalg.norm(shape.curvature, axis=1).max()) * h**2 / 8.0  # between two points
        assert np.abs(at - part.positions).max() < same + straight
        first += part.length


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_a_cable_in_two_segments_is_edited_as_the_whole_one(contact: str) -> None:
    one, other = both(contact)
    same = SAME if contact == "warn" else 1.2e-3
    steps: list[tuple[Any, Any]] = [
        clip(0.75, 0.5, 0.05, 0.8, name="b"),
        clip(0.3, 0.2, -0.03, 0.85, name="a", kind="fixed"),
        (cs.Move("b", cs.Pose((0.5, 0.05, 0.85))),) * 2,
        (cs.Add(cs.PointMass(0.9, 0.02)), cs.Add(cs.PointMass(0.4, 0.02, segment="b"))),
        (cs.Release("a"), cs.Release("a")),
        (cs.Add(POST), cs.Add(POST)),
        (cs.Remove("post"), cs.Remove("post")),
        (cs.Regrip("end", 1.15), cs.Regrip("b.end", 0.65)),
        (cs.Regrip("start", -0.05), cs.Regrip("a.start", -0.05)),
    ]
    for stamp, (whole, parts) in enumerate(steps, 2):
        for cycle, edit in ((one, whole), (other, parts)):
            result = cycle.edit(edit)
            assert result, (edit, result.reason)
        compare(one, other, (LEFT, RIGHT), stamp, same)
    of_parts: Any = {"h": {"a.start": LEFT, "b.end": RIGHT}}
    tails = one.step({"cable": (LEFT, RIGHT)}, 20).tails, other.step(of_parts, 20).tails
    assert tails[0]["cable", "end"].length == pytest.approx(tails[1]["h/b", "end"].length)
    assert tails[0]["cable", "start"].length == pytest.approx(tails[1]["h/a", "start"].length)


@pytest.mark.parametrize("side", ["start", "end"])
def test_an_end_of_a_harness_opens_as_that_of_a_cable(side: str) -> None:
    one, other = both("warn")
    assert one.edit(cs.Open(side))
    assert other.edit(cs.Open("a.start" if side == "start" else "b.end"))
    compare(one, other, (LEFT, RIGHT), 2, SAME)
    assert one.edit(cs.Regrip(side, 0.1 if side == "start" else 1.1))
    assert other.edit(cs.Regrip("a.start", 0.1) if side == "start" else cs.Regrip("b.end", 0.6))


def test_a_segment_becomes_another_cable() -> None:
    cycle = cs.Cycle({"h": halves()})
    ends: Any = {"h": {"a.start": LEFT, "b.end": RIGHT}}
    cycle.step(ends, 0)
    stiffer = WHOLE.replace(length=0.6, bending_stiffness=0.03, tails={"end": 0.2})
    assert cycle.edit(cs.SetCable(stiffer), cable="h/b")
    found: Any = cycle.step(ends, 1).shapes["h"]
    again: Any = cs.predict(cycle.layout.harness_of("h"), ends["h"])  # type: ignore[call-overload]
    assert cycle.parts["h/b"] == stiffer
    for name, part in found.segments.items():
        assert np.abs(part.positions - again.segments[name].positions).max() < SAME


@pytest.mark.parametrize("beside", [False, True])
def test_a_segment_in_a_clip_on_a_link_becomes_another_cable(beside: bool) -> None:
    on_link = cs.Clip(0.3, cs.Pose((0.1, 0.0, -0.15)), "ball", name="k", segment="a", link="tool")
    parts: dict[str, Any] = {"h": halves(), **({"c": WHOLE} if beside else {})}
    clips: dict[str, Any] = {"h": [on_link], **({"c": []} if beside else {})}
    grips: dict[str, Any] = {"h": {"a.start": LEFT, "b.end": RIGHT}}
    if beside:
        grips["c"] = tuple(cs.Pose(end.position + np.array((0.0, 0.1, 0.0)), ALONG_X) for end in (LEFT, RIGHT))
    links = {"tool": cs.Pose((0.1, 0.0, 1.0))}
    cycle = cs.Cycle(parts, scene=cs.Scene(contact="solve"), clips=clips)
    cycle.step(grips, 0, links)
    stiffer = WHOLE.replace(length=0.7, bending_stiffness=0.011, tails={"end": 0.2})
    result = cycle.edit(cs.SetCable(stiffer), cable="h/b")
    assert result, result.reason
    found: Any = cycle.step(grips, 1, links).shapes["h"]
    scene = cycle.layout.scene_of_harness("h")
    again: Any = cs.predict(cycle.layout.harness_of("h"), grips["h"], scene=scene, links=links)  # type: ignore[call-overload]
    for name, part in found.segments.items():
        assert np.abs(part.positions - again.segments[name].positions).max() < SAME


REFUSED: list[tuple[Any, str | None, str]] = [
    (cs.Open("b.start"), None, "'b.start' is not allowed: it is in junction 'j', which holds it. Name an open end."),
    (cs.Regrip("a.end", 0.3), "h", "it is in junction 'j', which holds it"),
    (cs.Open("end"), None, "'h' is a harness: it must be an end of a segment. Write 'NAME.end'. Segments: a, b."),
    (cs.Insert(cs.Clip(0.2, cs.Pose())), None, "'h' is a harness: it must name a segment. Segments: a, b."),
    (cs.Insert(cs.Clip(0.2, cs.Pose((0.2, 5.0, 1.0)), segment="a")), None, "cannot follow further"),
    (cs.SetCable(WHOLE), None, "SetCable is about one segment of a harness. Write cable='h/SEGMENT'."),
    (cs.SetCable(WHOLE), "h/a", "nothing hangs beyond it"),
    (cs.Release("none"), "h", "no such clip. Known: none."),
    (cs.Regrip("b.end", 5.0), None, "the cable goes from 0 m to 0.9 m of arc length"),
]


@pytest.mark.parametrize(("edit", "cable", "reason"), REFUSED)
def test_what_cannot_be_is_refused_and_changes_nothing_to_the_bit(edit: Any, cable: str | None, reason: str) -> None:
    ends: Any = {"h": {"a.start": LEFT, "b.end": RIGHT}}
    shapes = []
    for told in (False, True):
        cycle = cs.Cycle({"h": halves()})
        for stamp in (0, 1):
            cycle.step(ends, stamp)
        if told:
            result = cycle.edit(edit, cable=cable)
            assert not result
            assert reason in result.reason
        there: Any = {"h": {**ends["h"], "b.end": cs.Pose((0.8, 0.01, 1.0), ALONG_X)}}
        shapes.append(cycle.step(there, 10_000_000).shapes["h"].buffer.tobytes())
    assert shapes[0] == shapes[1]


def test_both_ends_are_not_opened() -> None:
    cycle = cs.Cycle({"h": halves()})
    cycle.step({"h": {"a.start": LEFT, "b.end": RIGHT}}, 0)  # type: ignore[dict-item]
    assert cycle.edit(cs.Open("a.start"))
    assert "nothing holds the part with the segments a, b" in cycle.edit(cs.Open("b.end")).reason


def twisted(turns: float) -> dict[str, Any]:
    """Ends brought near to each other and turned so many times about the line between them."""
    half = math.pi * turns
    turn = cs.Pose(quaternion=(0.0, 0.0, math.sin(half), math.cos(half)))
    return {"a.start": cs.Pose((0.0, 0.0, 0.0), ALONG_X), "b.end": cs.Pose((0.3, 0.0, 0.0), ALONG_X) * turn}


def test_segments_that_lie_on_each_other_stay_so_as_bodies_and_clips_come_and_go() -> None:
    thin = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)
    parts = {"a": thin.replace(length=0.37), "b": thin.replace(length=0.63)}
    harness = cs.Harness(parts, [cs.Junction("j", ("a.end", "b.start"))])
    cycle = cs.Cycle({"h": harness}, scene=cs.Scene(contact="solve"))
    for stamp, turns in enumerate(np.arange(0.3, 2.4, 0.02)):
        last: Any = cycle.step({"h": twisted(turns)}, stamp).shapes["h"]
        assert last.status is cs.Status.OK
    pressed = last.segments["a"].contacts[0]
    assert pressed.body == "h/b"
    here = last.segments["a"]
    held = cs.Clip(float(here.arc_length[40]), cs.Pose(here.positions[40]), "ball", name="held", segment="a")
    for stamp, edit in enumerate((cs.Add(POST), cs.Insert(held), cs.Release("held"), cs.Remove("post")), 1000):
        result = cycle.edit(edit)
        assert result, result.reason
        now: Any = cycle.step({"h": twisted(turns)}, stamp).shapes["h"]
        assert now.status is cs.Status.OK, now.detail
        for name, part in now.segments.items():
            np.testing.assert_allclose(part.positions, last.segments[name].positions, atol=SAME)
        (again,) = now.segments["a"].contacts
        assert again.force == pytest.approx(pressed.force, rel=1e-3)
