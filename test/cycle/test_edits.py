"""Edits of a cycle: what they change, what they refuse, and that refusing changes nothing."""

from __future__ import annotations

import gc
import math
import weakref

import numpy as np
import pytest

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008, tails={"end": 0.2})
ENDS = (cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.8, 0.0, 1.0), ALONG_X))
GRIPS = {"cable": ENDS}
POST = cs.Obstacle("post", cs.Cylinder(0.02, 0.4), cs.Pose((0.4, 0.5, 0.9)))
TABLE = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, 0.6)))
CLIP = cs.Clip(0.6, cs.Pose((0.4, 0.0, 0.75), ALONG_X), "ball", name="middle")
#: m, warm and from nothing are this near each other on one branch: both are within the tolerance of 1e-5 of the length.
SAME = 2.4e-5
#: The same in contact, where a shape is asked for 5e-4 of the length.
SAME_IN_CONTACT = 1.2e-3


def stepped(scene: cs.Scene | None = None, cable: cs.Cable = CABLE, **options: object) -> cs.Cycle:
    cycle = cs.Cycle(cable, scene=scene or cs.Scene(), **options)  # type: ignore[arg-type]
    for stamp in (0, 1):
        assert cycle.step(GRIPS, stamp).shapes["cable"].usable
    return cycle


def from_nothing(cycle: cs.Cycle, grips: object = GRIPS) -> cs.CableShape:
    again = cs.Cycle(dict(cycle.cables), scene=cycle.scene)
    return again.step(grips, 0).shapes["cable"]  # type: ignore[arg-type]


def apart(one: cs.CableShape, other: cs.CableShape) -> float:
    assert one.usable
    assert other.usable
    return float(np.abs(one.positions - other.positions).max())


def at(shape: cs.CableShape, arc_length: float) -> np.ndarray:
    return np.array([np.interp(arc_length, shape.arc_length, x) for x in shape.positions.T])


def everything(report: cs.CycleReport) -> bytes:
    """What a report says of the cable, to the bit."""
    shape = report.shapes["cable"]
    bodies = [(b.body, b.distance, b.arc_length) for b in report.clearance["cable"].bodies]
    return shape.buffer.tobytes() + repr((bodies, report.margins, report.warnings)).encode()


# -- what they change


def test_bodies_come_and_go_and_move() -> None:
    cycle = stepped()
    assert cycle.edit(cs.Add(POST), cs.Add(TABLE))
    assert [body.name for body in cycle.scene.obstacles] == ["post", "table"]
    place = cs.Pose((0.4, 0.05, 0.6))
    assert cycle.edit(cs.Move("post", place), cs.Remove("table"))
    assert cycle.scene.obstacles == (cs.Obstacle("post", POST.solid, place),)
    report = cycle.step(GRIPS, 2)
    again = cs.Cycle(CABLE, scene=cycle.scene).step(GRIPS, 0)
    distances = [one.clearance["cable"].bodies[0].distance for one in (report, again)]
    assert distances[0] == pytest.approx(distances[1], abs=SAME)
    assert [warning.other for warning in report.warnings] == [warning.other for warning in again.warnings] != []


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_a_clip_takes_the_cable_along_and_lets_it_go_again(contact: str) -> None:
    cycle = stepped(cs.Scene(contact=contact))
    before = cycle.step(GRIPS, 2).shapes["cable"]
    assert cycle.edit(cs.Insert(CLIP))
    held = cycle.step(GRIPS, 3).shapes["cable"]
    assert at(held, 0.6) == pytest.approx(CLIP.pose.position, abs=SAME)
    assert apart(held, from_nothing(cycle)) < SAME
    there = cs.Pose((0.4, 0.0, 0.8), ALONG_X)
    assert cycle.edit(cs.Move("middle", there))
    held = cycle.step(GRIPS, 4).shapes["cable"]
    assert at(held, 0.6) == pytest.approx(there.position, abs=SAME)
    assert apart(held, from_nothing(cycle)) < SAME
    assert cycle.edit(cs.Release("middle"))
    assert apart(cycle.step(GRIPS, 5).shapes["cable"], before) < SAME
    assert cycle.scene.clips == ()


def test_a_clip_where_the_cable_is_changes_nothing_of_it() -> None:
    cycle = stepped()
    before = cycle.step(GRIPS, 2).shapes["cable"]
    for i, kind in enumerate(("ball", "slide")):
        s = 0.3 + 0.4 * i
        assert cycle.edit(cs.Insert(cs.Clip(s, cs.Pose(at(before, s)), kind)))
    after = cycle.step(GRIPS, 3).shapes["cable"]
    # where the centreline lies between two points of a shape, straight lines are off by curvature h^2 / 8
    h = float(before.arc_length[1])
    bend = float(np.linalg.norm(before.curvature, axis=1).max())
    assert apart(after, before) < bend * h**2 / 8.0 + SAME
    assert [clip.name for clip in cycle.scene.clips] == ["clip0", "clip1"]


def test_clips_keep_the_names_that_they_were_called_by() -> None:
    one = cs.Clip(0.6, cs.Pose((0.4, 0.0, 0.75), ALONG_X))
    cycle = stepped(cs.Scene(clips=[one]))
    shape = cycle.step(GRIPS, 2).shapes["cable"]
    assert cycle.edit(cs.Insert(cs.Clip(0.2, cs.Pose(at(shape, 0.2)))))
    assert [(clip.name, clip.arc_length) for clip in cycle.scene.clips] == [("clip1", 0.2), ("clip0", 0.6)]
    assert cycle.edit(cs.Release("clip0"))
    assert [clip.name for clip in cycle.scene.clips] == ["clip1"]


@pytest.mark.parametrize("end", ["start", "end"])
def test_a_cable_that_is_gripped_elsewhere_keeps_its_shape(end: str) -> None:
    cycle = stepped(cs.Scene(clips=[CLIP]))
    before = cycle.step(GRIPS, 2).shapes["cable"]
    s = 0.25 if end == "start" else 1.0
    k = int(np.abs(before.arc_length - s).argmin())
    s = float(before.arc_length[k])
    assert cycle.edit(cs.Regrip(end, s))
    length = 1.2 - s if end == "start" else s
    assert cycle.cables["cable"].length == pytest.approx(length, abs=1e-12)
    tails = {"start": s, "end": 0.2} if end == "start" else {"end": 0.2 + 1.2 - s}
    assert dict(cycle.cables["cable"].tails) == pytest.approx(tails, abs=1e-12)
    assert cycle.scene.clips[0].arc_length == pytest.approx(0.6 - (s if end == "start" else 0.0), abs=1e-12)
    there = cs.Pose(before.positions[k], before.quaternions[k])
    grips = {"cable": (there, ENDS[1]) if end == "start" else (ENDS[0], there)}
    report = cycle.step(grips, 3)
    after = report.shapes["cable"]
    assert after.usable
    first = s if end == "start" else 0.0
    for own in np.linspace(0.0, length, 40):
        bend = 20.0 * float(before.arc_length[1]) ** 2 / 8.0  # both are read off straight lines between points
        assert at(after, own) == pytest.approx(at(before, first + own), abs=SAME + bend)
    assert ("cable", end) in report.tails
    back = cs.Regrip(end, 0.0 if end == "start" else 1.2)
    assert cycle.edit(back)
    assert cycle.cables == {"cable": CABLE}
    assert apart(cycle.step(GRIPS, 4).shapes["cable"], before) < SAME


def test_an_end_that_is_opened_hangs_until_it_is_gripped() -> None:
    cycle = stepped()
    assert cycle.edit(cs.Open("end"))
    report = cycle.step(GRIPS, 2)  # whatever the open gripper does
    shape = report.shapes["cable"]
    assert shape.length == pytest.approx(1.4, abs=1e-12)
    assert report.tails == {}
    assert shape.moment[-1] == pytest.approx(np.zeros(3), abs=1e-9)
    hanging = cs.predict(CABLE.replace(length=1.4, tails=None), ENDS[0], None)
    assert apart(shape, hanging) < 2e-5
    assert cycle.edit(cs.Regrip("end", 1.0))
    there = cs.Pose(at(shape, 1.0) + np.array((0.01, 0.0, 0.0)), shape.quaternions[round(149 * 1.0 / 1.4)])
    after = cycle.step({"cable": (ENDS[0], there)}, 3).shapes["cable"]
    assert after.usable
    assert after.length == 1.0
    assert after.positions[-1] == pytest.approx(there.position, abs=1e-9)


def test_other_numbers_are_those_of_another_cable() -> None:
    cycle = stepped()
    for other in (CABLE.replace(bending_stiffness=0.03), CABLE.replace(length=1.3, linear_density=0.2)):
        assert cycle.edit(cs.SetCable(other))
        assert cycle.cables == {"cable": other}
        assert apart(cycle.step(GRIPS, 2).shapes["cable"], from_nothing(cycle)) < SAME


def test_a_connector_weighs_on_the_cable() -> None:
    cycle = stepped()
    low = cycle.step(GRIPS, 2).shapes["cable"].positions[:, 2].min()
    assert cycle.edit(cs.Add(cs.PointMass(0.6, 0.1)))
    shape = cycle.step(GRIPS, 3).shapes["cable"]
    assert shape.positions[:, 2].min() < low
    assert apart(shape, from_nothing(cycle)) < SAME


def test_edits_before_the_first_step_say_what_there_is() -> None:
    cycle = cs.Cycle(CABLE)
    assert cycle.edit(cs.Add(POST), cs.Insert(CLIP), cs.Regrip("end", 1.0))
    assert cycle.cables["cable"].length == 1.0
    assert cycle.cables["cable"].tails["end"] == pytest.approx(0.4, abs=1e-12)
    assert cycle.scene == cs.Scene(obstacles=[POST], clips=[CLIP])
    assert cycle.step(GRIPS, 0).shapes["cable"].buffer.tobytes() == from_nothing(cycle).buffer.tobytes()


def test_the_load_of_a_stretch_is_that_of_the_cable_there() -> None:
    load = np.array(((0.0, 0.0, 0.0), (0.0, 1.2, 0.0)))
    cycle = stepped(distributed_load=load)
    assert cycle.edit(cs.Regrip("start", 0.2))
    got = cycle.step(GRIPS, 2).shapes["cable"]
    cable = CABLE.replace(length=1.0, tails={"start": 0.2, "end": 0.2})
    asked = cs.predict(cable, *ENDS, distributed_load=((0.0, 0.2, 0.0), (0.0, 1.2, 0.0)))
    assert apart(got, asked) < SAME


def test_of_several_cables_one_is_meant() -> None:
    cables = {"a": CABLE, "b": CABLE}
    grips = {"a": ENDS, "b": tuple(cs.Pose(end.position + np.array((0.0, 0.5, 0.0)), ALONG_X) for end in ENDS)}
    cycle = cs.Cycle(cables)
    cycle.step(grips, 0)  # type: ignore[arg-type]
    refused = cycle.edit(cs.Insert(CLIP))
    assert not refused
    assert "Name it: a, b." in refused.reason
    assert cycle.edit(cs.Insert(CLIP), cable="a")
    assert cycle.scenes["a"].clips == (CLIP,)
    assert cycle.scenes["b"].clips == cycle.scene.clips == ()
    assert cycle.edit(cs.Regrip("end", 1.1), cable="b")
    report = cycle.step(grips, 1)  # type: ignore[arg-type]
    assert at(report.shapes["a"], 0.6) == pytest.approx(CLIP.pose.position, abs=SAME)
    assert report.shapes["b"].length == 1.1
    assert cycle.edit(cs.Release("middle"))
    assert not cycle.edit(cs.Release("middle"), cable="c")


# -- what they refuse

HELD = cs.Scene(obstacles=[POST], clips=[CLIP], masses=[cs.PointMass(0.2, 0.01)])
REFUSED = [
    ([cs.Remove("nothing")], "no such body or clip. Known: post, middle."),
    ([cs.Release("post")], "no such clip. Known: middle."),
    ([cs.Move("nothing", cs.Pose())], "no such body or clip"),
    ([cs.Add(POST)], "names must be unique"),
    ([cs.Insert(CLIP)], "names must be unique"),
    ([cs.Add(cs.Obstacle("middle", cs.Sphere(0.1)))], "names must be unique"),
    ([cs.Insert(cs.Clip(1.2, cs.Pose()))], "between the grips, above 0 m and below 1.2 m"),
    ([cs.Insert(cs.Clip(0.6001, cs.Pose((0.4, 0.0, 0.75), ALONG_X)))], "at least 0.0012 m beyond clips"),
    ([cs.Insert(cs.Clip(0.9, cs.Pose((0.4, 3.0, 0.75), ALONG_X)))], "cannot follow further"),
    ([cs.Move("middle", cs.Pose((0.4, 0.0, 3.0), ALONG_X))], "cannot follow further"),
    ([cs.Regrip("end", 0.5)], "clip 'middle' holds the cable at 0.6 m, beyond that grip. Release the clip first."),
    ([cs.Regrip("start", 0.6)], "Release the clip first."),
    ([cs.Regrip("start", 0.3)], "a point mass at 0.2 m would be on a tail"),
    ([cs.Regrip("end", 1.5)], "the cable goes from 0 m to 1.4 m of arc length"),
    ([cs.Regrip("start", -0.1)], "the cable goes from 0 m to 1.4 m of arc length"),
    ([cs.SetCable(CABLE.replace(length=0.7))], "cannot follow further"),
    ([cs.SetCable(CABLE.replace(length=0.5))], "clips[0].arc_length"),
    ([cs.Release("middle"), cs.Remove("post"), cs.Open("end"), cs.Release("middle")], "no such clip. Known: none."),
]


@pytest.mark.parametrize(("edits", "reason"), REFUSED)
@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_what_cannot_be_is_refused_and_changes_nothing_to_the_bit(
    edits: list[object], reason: str, contact: str
) -> None:
    one, other = (stepped(HELD.replace(contact=contact)) for _ in range(2))
    result = one.edit(*edits)  # type: ignore[arg-type]
    assert not result
    assert not result.done
    assert reason in result.reason
    assert one.cables == other.cables
    assert one.scene == other.scene
    assert one.last_stamp == other.last_stamp
    for stamp, x in ((2, 0.8), (3, 0.79), (4, 0.78)):
        grips = {"cable": (ENDS[0], cs.Pose((x, 0.0, 1.0), ALONG_X))}
        assert everything(one.step(grips, stamp)) == everything(other.step(grips, stamp))


def test_a_body_does_not_appear_in_the_middle_of_the_cable() -> None:
    cycle = stepped(cs.Scene(contact="solve"))
    low = at(cycle.step(GRIPS, 2).shapes["cable"], 0.6)
    across = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    refused = cycle.edit(cs.Add(cs.Obstacle("bar", cs.Cylinder(0.05, 1.0), cs.Pose(low, across))))
    assert "the middle of the cable must be outside, at most 0.004 m deep. Add it beside the cable" in refused.reason
    below = cs.Obstacle("bar", cs.Cylinder(0.05, 1.0), cs.Pose(low - (0.0, 0.0, 0.06), across))
    assert cycle.edit(cs.Add(below), cs.Move("bar", cs.Pose(low, across)))
    lifted = cycle.step(GRIPS, 3).shapes["cable"]
    assert at(lifted, 0.6)[2] == pytest.approx(low[2] + 0.054, abs=2e-4)
    assert [contact.body for contact in lifted.contacts] == ["bar"] * len(lifted.contacts) != []
    refused = cycle.edit(cs.Add(cs.Obstacle("wall", cs.Box((2.0, 2.0, 2.0)), cs.Pose((0.4, 0.0, 1.9)))))
    assert "wall" in refused.reason


def test_what_is_no_edit_is_no_argument() -> None:
    cycle = stepped()
    with pytest.raises(cs.ArgumentError, match=r"edits\[0\] = 'post' is not allowed"):
        cycle.edit("post")  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError, match=r"Add\.part"):
        cs.Add("post")  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError, match=r"Regrip\.end"):
        cs.Regrip("middle", 0.1)
    with pytest.raises(cs.ArgumentError, match=r"Regrip\.arc_length = nan"):
        cs.Regrip("end", math.nan)
    with pytest.raises(cs.ArgumentError, match=r"Open\.end"):
        cs.Open("a.middle")


def test_a_cable_beside_a_harness_is_edited_and_bodies_are_those_of_both() -> None:
    harness = cs.Harness({"a": CABLE.replace(tails=None)}, [])
    aside = tuple(cs.Pose(pose.position + np.array((0.0, 0.5, 0.0)), ALONG_X) for pose in ENDS)
    grips = {"cable": ENDS, "h": {"a.start": aside[0], "a.end": aside[1]}}
    cycle = cs.Cycle({"cable": CABLE, "h": harness})
    alone = stepped()
    for stamp in (0, 1):
        first = cycle.step(grips, stamp)  # type: ignore[arg-type]
    for edit in (cs.Insert(CLIP), cs.Regrip("end", 1.3), cs.Release("middle")):
        assert cycle.edit(edit)
        assert alone.edit(edit)
        report = cycle.step(grips, 2)  # type: ignore[arg-type]
        assert everything(alone.step(GRIPS, 2))[:1000] == everything(report)[:1000]
        assert np.array_equal(report.shapes["h"].segments["a"].positions, first.shapes["h"].segments["a"].positions)
    assert cycle.edit(cs.Add(cs.Obstacle("post", POST.solid, cs.Pose((0.4, 0.5, 0.7)))))
    report = cycle.step(grips, 3)  # type: ignore[arg-type]
    assert [body.body for body in report.clearance["h/a"].bodies] == ["post"]


# -- stamps


def test_no_fresh_stamp_goes_on_an_old_shape() -> None:
    cycle = stepped(cs.Scene(contact="solve"))
    before = cycle.step(GRIPS, 2).shapes["cable"]
    assert before.reused  # nothing has moved
    shape = before
    for edit in (cs.Insert(CLIP), cs.SetCable(CABLE.replace(linear_density=0.2)), cs.Add(POST), cs.Release("middle")):
        assert cycle.edit(edit)
        after = cycle.step(GRIPS, 3).shapes["cable"]
        assert not after.reused
        assert after.buffer.tobytes() != shape.buffer.tobytes()
        assert apart(after, from_nothing(cycle)) < SAME
        shape = after


def test_an_edit_has_its_place_among_the_stamps() -> None:
    cycle = stepped()
    with pytest.raises(cs.StaleInputError, match="older than the last one"):
        cycle.edit(cs.Add(POST), stamp=0)
    assert not cycle.edit(cs.Remove("nothing"), stamp=10)
    assert cycle.last_stamp == 1
    assert cycle.edit(cs.Add(POST), stamp=10)
    with pytest.raises(cs.StaleInputError, match="older than the last one"):
        cycle.step(GRIPS, 9)
    assert cycle.step(GRIPS, 10).clearance["cable"].bodies == ()


def test_speeds_and_loads_are_remembered() -> None:
    """In the very next cycle it is known how the grips move, what their inertia does, and when limits are reached."""
    cable = CABLE.replace(max_tension=2.0)
    one, other = cs.Cycle(cable), cs.Cycle(cable)
    for k in range(40):
        grips = {"cable": (ENDS[0], cs.Pose((0.8 + 0.02 * math.sin(0.2 * k), 0.0, 1.0), ALONG_X))}
        if k == 30:
            assert one.edit(cs.Add(POST))
        told = [
            {m.kind: m for m in cycle.step(grips, 10_000_000 * k).margins["cable"] if not m.other}
            for cycle in (one, other)
        ]
        assert told[0].keys() == told[1].keys()
        for kind, margin in told[0].items():
            known = told[1][kind]
            assert margin.value == pytest.approx(known.value, rel=1e-3), (k, kind)
            if kind is not cs.WarningKind.QUASISTATIC or k != 30:
                assert margin.time_to_limit == pytest.approx(known.time_to_limit, rel=0.1, nan_ok=True), (k, kind)
    assert told[0][cs.WarningKind.QUASISTATIC].value > 0.1


def test_the_jump_of_an_edit_is_no_speed() -> None:
    """A clip bends the cable at once: that is no rate at which the limit of its bending comes nearer."""
    cycle = stepped(cable=CABLE.replace(min_bend_radius=0.01))
    before, told, again = [], [], []
    for k, z in enumerate((0.76, 0.85)):
        edit = cs.Move("middle", cs.Pose((0.4, 0.0, z), ALONG_X)) if k else cs.Insert(CLIP)
        for stamp, margins in enumerate((before, before, told, again), 4 * k + 2):
            if margins is told:
                assert cycle.edit(edit)
            found = cycle.step(GRIPS, stamp * 10_000_000).margins["cable"]
            margins.append(next(m for m in found if m.kind is cs.WarningKind.BEND_RADIUS))
        assert abs(told[-1].used - before[-1].used) > 1e-3
        assert [before[-1].time_to_limit, again[-1].time_to_limit] == [math.inf, math.inf]
        assert math.isnan(told[-1].time_to_limit)


def test_contact_and_friction_go_on_as_if_there_had_been_no_edit() -> None:
    """A body that comes and moves far away leaves a cable that friction holds where it is, mesh and all."""
    rough = cs.Obstacle("table", TABLE.solid, cs.Pose((0.4, 0.0, 0.7)), friction=0.4)
    one, other = (stepped(cs.Scene(obstacles=[rough], contact="solve")) for _ in range(2))
    for k in range(12):
        ends = ENDS[0], cs.Pose((0.8, 0.004 * k, 1.0), ALONG_X)
        shapes = [cycle.step({"cable": ends}, k + 2).shapes["cable"] for cycle in (one, other)]
        assert apart(*shapes) < 1e-3 * SAME
        if k == 6:
            assert len(shapes[0].touches)
            nodes = one._cables["cable"].predictor.memory.nodes
            assert one.edit(cs.Add(POST))
            assert one.edit(cs.Move("post", cs.Pose((0.4, 0.6, 0.9))))
            assert one._cables["cable"].predictor.memory.nodes == pytest.approx(nodes, abs=1e-7)  # not a new mesh
    assert shapes[0].touches[:, 9:12].any()


def test_what_an_edit_replaces_is_free_at_once() -> None:
    """Not when garbage is looked for: until then a node would hold hundreds of solvers that nobody uses."""
    cycle = stepped(cs.Scene(obstacles=[TABLE], contact="solve"))
    gc.disable()
    try:
        old = weakref.ref(cycle._cables["cable"].predictor)
        assert cycle.edit(cs.Add(POST))
        assert old() is None
    finally:
        gc.enable()


def test_standing_warnings_are_remembered() -> None:
    """One that stands is over 5 % below where it began, also where a body was moved by an edit."""
    cycle = stepped()
    low = at(cycle.step(GRIPS, 2).shapes["cable"], 0.6)
    ball = cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose(low - (0.0, 0.0, 0.054 + 0.029)))
    assert cycle.edit(cs.Add(ball))
    assert [warning.other for warning in cycle.step(GRIPS, 3).warnings] == ["ball"]
    assert cycle.edit(cs.Move("ball", cs.Pose(low - (0.0, 0.0, 0.054 + 0.031))))
    assert [warning.other for warning in cycle.step(GRIPS, 4).warnings] == ["ball"]
    assert cs.Cycle(CABLE, scene=cycle.scene).step(GRIPS, 0).warnings == ()


def test_a_third_gripper_takes_the_cable_and_hands_it_over() -> None:
    cycle = stepped()
    before = cycle.step(GRIPS, 2).shapes["cable"]
    k = int(np.abs(before.arc_length - 0.9).argmin())
    s, place = float(before.arc_length[k]), cs.Pose(before.positions[k], before.quaternions[k])
    assert cycle.edit(cs.Insert(cs.Clip(s, place, "fixed", name="third")))
    assert cycle.edit(cs.Open("end"))
    lifted = cs.Pose(place.position + np.array((-0.05, 0.02, 0.1)), place.quaternion)
    assert cycle.edit(cs.Move("third", lifted))
    hanging = cycle.step(GRIPS, 3).shapes["cable"]
    assert at(hanging, s) == pytest.approx(lifted.position, abs=SAME)
    refused = cycle.edit(cs.Regrip("end", s - 0.1))
    assert "clip 'third' holds the cable" in refused.reason
    assert cycle.edit(cs.Regrip("end", s))
    assert cycle.scene.clips == ()
    report = cycle.step({"cable": (ENDS[0], lifted)}, 4)
    handed = report.shapes["cable"]
    assert handed.length == s
    assert report.tails["cable", "end"].length == pytest.approx(1.4 - s)
    for arc in np.linspace(0.0, s, 20):
        h = float(hanging.arc_length[1])  # between points of a shape straight lines are off by curvature h^2 / 8
        assert at(handed, arc) == pytest.approx(at(hanging, arc), abs=SAME + 20.0 * h**2 / 8.0)
    assert apart(handed, from_nothing(cycle, {"cable": (ENDS[0], lifted)})) < SAME
