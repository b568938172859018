"""Cables and harnesses in one pile: the same as cables, balance, derivatives, two harnesses, jumps, edits, tubes."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.solve.touching.crossing import Crossing

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
SOLVE = cs.Scene(contact="solve")
CABLE = cs.Cable(1.0, 0.05, 0.01, 0.008, diameter=0.008)
ARM = CABLE.replace(length=0.5, diameter=0.006)
STAMPS = count(0, 10_000_000_000)  # ns


def posed(place, yaw=0.0):
    """A pose whose d3 is the x axis turned by an angle [degrees] about z."""
    return cs.Pose(place, (Rotation.from_euler("z", yaw, degrees=True) * ALONG_X).as_quat())


def leaving(yaw):
    """Frame of an end that leaves a junction along x at that angle."""
    turn = ALONG_X.inv() * Rotation.from_euler("z", yaw, degrees=True) * ALONG_X
    return cs.Pose((0.0, 0.0, 0.0), turn.as_quat())


def forked(cable=ARM, **joint):
    """A stem that forks into two arms."""
    frames = {"l.start": leaving(25.0), "r.start": leaving(-25.0)}
    fork = cs.Junction("j", ("stem.end", *frames), frames={**frames, **joint.pop("frames", {})}, **joint)
    return cs.Harness(dict.fromkeys(("stem", "l", "r"), cable), [fork])


LEVER = {"l.start": cs.Pose((0.0, 0.006, 0.0), leaving(25.0).quaternion)}
FORK = {
    "stem.start": posed((-0.48, 0.0, 0.0)),
    "l.end": posed((0.42, 0.2, 0.0), 25.0),
    "r.end": posed((0.42, -0.2, 0.0), -25.0),
}
DOWN = np.linspace(0.14, -0.02, 33)


def over(height, x=0.25):
    """Ends of a cable across, along y, that high [m]."""
    return posed((x, -0.45, height), 90.0), posed((x, 0.45, height), 90.0)


def clipped(aside=0.0):
    """The stem in a clip, `aside` [m] off where it hangs."""
    shape = cs.predict(forked(), FORK).segments["stem"]
    place = [np.interp(0.2, shape.arc_length, x) for x in shape.positions.T]
    return cs.Clip(0.2, cs.Pose(np.add(place, (0.0, aside, aside))), name="k", segment="stem")


def raised(ends, height):
    return {end: cs.Pose(pose.position + np.array((0.0, 0.0, height)), pose.quaternion) for end, pose in ends.items()}


def lines(shapes):
    """The strands of shapes of cables and harnesses, by what a cycle calls them."""
    out = {}
    for name, shape in shapes.items():
        parts = getattr(shape, "segments", None)
        out.update({name: shape} if parts is None else {f"{name}/{one}": part for one, part in parts.items()})
    return out


def gap(a, b):
    """[m], least distance of the surfaces of two strands."""
    return np.linalg.norm(a.positions[:, None] - b.positions, axis=2).min() - 0.5 * (CABLE.diameter + ARM.diameter)


def lowered(cycle, heights=DOWN, **more):
    """The reports as a cable "c" comes down on a fork "h"."""
    reports = []
    for height in heights:
        report = cycle.step({"c": over(height), "h": FORK, **more}, stamp=next(STAMPS))
        assert {name: shape.status.name for name, shape in report.shapes.items()} == dict.fromkeys(report.shapes, "OK")
        reports.append(report)
    return reports


def test_a_cable_lies_on_two_arms_and_both_carry_what_presses():
    harness = forked(frames=LEVER, mass=0.01)
    cycle = cs.Cycle({"c": CABLE, "h": harness}, scene=SOLVE)
    free = lowered(cs.Cycle({"c": CABLE, "h": harness}, scene=cs.Scene(contact="warn")))
    reports = lowered(cycle)
    for report, alone in zip(reports, free, strict=True):
        found, apart = lines(report.shapes), lines(alone.shapes)
        for arm in ("h/l", "h/r"):
            assert gap(found["c"], found[arm]) > -2e-5
        if min(gap(apart["c"], apart[arm]) for arm in ("h/l", "h/r")) > 5e-3 and not found["c"].contacts:
            for name, shape in found.items():
                assert np.array_equal(shape.buffer, apart[name].buffer)
    assert min(gap(*(lines(report.shapes)[name] for name in ("c", "h/l"))) for report in free) < -0.5 * ARM.diameter
    contacts = {contact.body: contact for contact in found["c"].contacts}
    assert contacts.keys() == {"h/l", "h/r"}
    weight = {name: shape.length * 0.05 * 9.81 for name, shape in found.items()}
    carried = {name: np.zeros(3) for name in found}
    for name, on_cable in contacts.items():
        (on_arm,) = found[name].contacts
        assert on_arm.body == "c"
        assert on_arm.force == on_cable.force > 0.05
        np.testing.assert_allclose(on_arm.normal, -on_cable.normal, atol=1e-12)
        carried[name] = on_arm.force * on_arm.normal
        carried["c"] = carried["c"] + on_cable.force * on_cable.normal
    assert not found["h/stem"].contacts
    for name, shape in found.items():
        held = shape.force[-1] - shape.force[0] + carried[name]
        np.testing.assert_allclose(held, (0.0, 0.0, weight[name]), atol=1e-6)
    stem, left, right = (found[f"h/{name}"].force for name in ("stem", "l", "r"))
    np.testing.assert_allclose(left[0] + right[0] - stem[-1], (0.0, 0.0, 0.01 * 9.81), atol=1e-6)
    whole = report.shapes["h"]
    levers = whole.energy - sum(part.energy for part in whole.segments.values())
    assert levers == pytest.approx(0.01 * 9.81 * whole.junctions["j"].position[2], abs=1e-6)


def test_a_cable_in_two_segments_lies_on_another_as_the_whole_one_does():
    cut = 0.37
    halves = {"a": CABLE.replace(length=cut), "b": CABLE.replace(length=CABLE.length - cut)}
    harness = cs.Harness(halves, [cs.Junction("j", ("a.end", "b.start"))])
    start, end = posed((-0.4, 0.0, 0.0)), posed((0.4, 0.1, 0.0))
    cables = cs.Cycle({"c": CABLE, "d": CABLE}, scene=SOLVE, tolerance=1e-7)
    mixed = cs.Cycle({"c": CABLE, "h": harness}, scene=SOLVE, tolerance=1e-7)
    for height in DOWN:
        across = over(height, x=0.15)
        one = cables.step({"c": across, "d": (start, end)}, stamp=next(STAMPS))
        two = mixed.step({"c": across, "h": {"a.start": start, "b.end": end}}, stamp=next(STAMPS))
        assert one.shapes["d"].status is two.shapes["h"].status is cs.Status.OK
        np.testing.assert_allclose(two.shapes["c"].positions, one.shapes["c"].positions, atol=1e-6)
        ends = [one.shapes["d"].force[row] for row in (0, -1)]
        parts = two.shapes["h"].segments
        np.testing.assert_allclose([parts["a"].force[0], parts["b"].force[-1]], ends, atol=1e-5)
    (on_whole,), (on_part,) = one.shapes["d"].contacts, parts["b"].contacts
    assert on_part.arc_length + cut == pytest.approx(on_whole.arc_length, abs=1e-6)
    assert on_part.force == pytest.approx(on_whole.force, rel=1e-5)


def test_segments_without_junctions_are_cables():
    loose = cs.Harness({"d": CABLE.replace(length=0.9)})
    ends = posed((-0.4, 0.0, 0.0)), posed((0.4, 0.1, 0.0))
    cables = cs.Cycle({"c": CABLE, "d": loose.segments["d"]}, scene=SOLVE)
    mixed = cs.Cycle({"c": CABLE, "h": loose}, scene=SOLVE)
    for height in DOWN[::2]:
        one = cables.step({"c": over(height, 0.1), "d": ends}, stamp=next(STAMPS))
        grips = {"d.start": ends[0], "d.end": ends[1]}
        two = mixed.step({"c": over(height, 0.1), "h": grips}, stamp=next(STAMPS))
        np.testing.assert_allclose(two.shapes["c"].positions, one.shapes["c"].positions, atol=1e-6)
        np.testing.assert_allclose(two.shapes["h"].segments["d"].positions, one.shapes["d"].positions, atol=1e-6)
    assert one.shapes["c"].contacts


def test_two_harnesses_and_a_cable_lie_over_each_other():
    upper = forked(CABLE)
    cycle = cs.Cycle({"c": CABLE, "h": forked(), "u": upper}, scene=SOLVE)
    turn = cs.Pose((0.3, -0.4, 0.0), Rotation.from_euler("z", 90.0, degrees=True).as_quat())
    yaws = {"stem.start": 0.0, "l.end": 25.0, "r.end": -25.0}
    above = {end: turn * posed(pose.position * 1.5, yaws[end]) for end, pose in FORK.items()}
    scene = {}
    for height in np.linspace(0.3, 0.08, 45):
        scene = {"c": over(0.0, -0.2), "h": FORK, "u": raised(above, height)}
        report = cycle.step(scene, stamp=next(STAMPS))
        assert all(shape.status is cs.Status.OK for shape in report.shapes.values())
    found = lines(report.shapes)
    pressed = {(name, contact.body) for name, shape in found.items() for contact in shape.contacts}
    assert pressed == {(b, a) for a, b in pressed}
    assert any(a.startswith("h/") and b.startswith("u/") for a, b in pressed)
    total = np.zeros(3)
    for shape in found.values():
        total += sum((c.force * c.normal for c in shape.contacts), np.zeros(3))
    np.testing.assert_allclose(total, 0.0, atol=1e-12)
    back = cycle.step(scene, stamp=next(STAMPS))
    assert all(shape.reused for shape in back.shapes.values())


@pytest.mark.parametrize("height", [-0.3, -1.0])
def test_no_shape_is_ok_after_a_jump_through_a_harness(height):
    cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE)
    lowered(cycle, DOWN[:8])
    report = cycle.step({"c": over(height), "h": FORK}, stamp=next(STAMPS))
    above = report.shapes["c"].positions[75, 2] > lines(report.shapes)["h/l"].positions[:, 2].min() - 0.02
    assert above or not report.shapes["c"].status
    again = cycle.step({"c": over(height), "h": FORK}, stamp=next(STAMPS))
    assert above or not again.shapes["c"].status
    up = cycle.step({"c": over(0.3), "h": FORK}, stamp=next(STAMPS))
    assert all(shape.usable for shape in up.shapes.values())
    back = lowered(cycle, DOWN[:8])[-1]
    assert gap(*(lines(back.shapes)[name] for name in ("c", "h/l"))) > 0.0
    cycle.reset()
    below = cycle.step({"c": over(-0.5), "h": FORK}, stamp=next(STAMPS))
    assert all(shape.status is cs.Status.OK for shape in below.shapes.values())


def test_led_back_they_come_free_and_nothing_is_left_of_it():
    cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE)
    first = lowered(cycle)[0]
    for height in DOWN[::-1]:
        back = cycle.step({"c": over(height), "h": FORK}, stamp=next(STAMPS))
        assert all(shape.status is cs.Status.OK for shape in back.shapes.values())
    for name, shape in lines(back.shapes).items():
        assert not shape.contacts
        np.testing.assert_allclose(shape.positions, lines(first.shapes)[name].positions, atol=2e-5)


def test_a_cable_found_through_a_harness_goes_over_it():
    for height in (0.11, 0.115, 0.12):
        cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE)
        report = cycle.step({"c": over(height), "h": FORK}, stamp=next(STAMPS))
        found = lines(report.shapes)
        assert all(shape.status is cs.Status.OK for shape in found.values())
        assert min(gap(found["c"], found[arm]) for arm in ("h/l", "h/r")) > -2e-5
        assert found["c"].contacts


def test_derivatives_of_both_are_differences():
    clip = clipped()
    cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE, clips={"h": [clip], "c": []}, tolerance=1e-7)
    lowered(cycle)
    harness, cable = cycle._harnesses["h"].predictor, cycle._cables["c"].predictor
    assert harness.touching
    assert cable.touching
    by = ("r.end", "l.end", "clip:k", "length:l", "bending_stiffness:r")
    told, of_cable = harness.sensitivity(by), cable.sensitivity(("end", "bending_stiffness"))
    step = 1e-4
    for axis in range(3):
        place = np.eye(3)[axis] * step
        sides, cables = [], []
        for sign in (-1.0, 1.0):
            ends = {**FORK, "l.end": cs.Pose(FORK["l.end"].position + sign * place, FORK["l.end"].quaternion)}
            sides.append(harness.ahead()(ends))
            start, end = over(DOWN[-1])
            cables.append(cable.ahead()(cs.Grip(start), cs.Grip(cs.Pose(end.position + sign * place, end.quaternion))))
        for name in ("stem", "l", "r"):
            found = (sides[1].segments[name].positions - sides[0].segments[name].positions) / (2.0 * step)
            np.testing.assert_allclose(told[name][:, :, 6 + axis], found, atol=2e-3)
        found = (cables[1].positions - cables[0].positions) / (2.0 * step)
        np.testing.assert_allclose(of_cable[:, :, axis], found, atol=2e-3)
    for column, (name, number, far) in enumerate((("l", "length", 1e-4), ("r", "bending_stiffness", 1e-5))):
        pair = []
        for sign in (-1.0, 1.0):
            changed = ARM.replace(**{number: np.mean(getattr(ARM, number)) + sign * far})
            other = cs.Predictor(
                harness.harness.replace({**harness.harness.segments, name: changed}),
                scene=cs.Scene(contact="solve", clips=[clip]),
                tolerance=1e-7,
            )
            pair.append(harness.predict_beside(other, FORK, None, None))
        for one in ("stem", "l", "r"):
            found = (pair[1].segments[one].positions - pair[0].segments[one].positions) / (2.0 * far)
            most = np.abs(told[one][:, :, 18 + column]).max()
            np.testing.assert_allclose(told[one][:, :, 18 + column], found, atol=0.01 * most + 2e-3)
    again = cycle.step({"c": over(DOWN[-1]), "h": FORK}, stamp=next(STAMPS))
    assert again.shapes["h"].reused
    assert again.shapes["c"].reused  # all that was asked beside them left them as they are
    assert again.margins["h/l"]


def test_edits_take_both_along_where_they_touch():
    clip = clipped()
    cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE, clips={"h": [clip], "c": []})
    before = lowered(cycle)[-1]
    grips = {"c": over(DOWN[-1]), "h": FORK}
    assert cycle.edit(cs.Move("k", clipped(0.01).pose), cable="h")
    assert cycle.edit(cs.Add(cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.5)))))
    report = cycle.step(grips, stamp=next(STAMPS))
    assert all(shape.status is cs.Status.OK for shape in report.shapes.values())
    found = lines(report.shapes)
    assert {contact.body for contact in found["c"].contacts} == {"h/l", "h/r"}
    clips = {"h": cycle.layout.scene_of_harness("h").clips, "c": []}
    plain = cs.Cycle({"c": CABLE, "h": forked()}, scene=cycle.scene, clips=clips)
    same = lines(lowered(plain)[-1].shapes)
    for name, shape in found.items():
        np.testing.assert_allclose(shape.positions, same[name].positions, atol=2e-5)
    assert cycle.edit(cs.Release("k"), cable="h")
    assert cycle.edit(cs.SetCable(ARM.replace(bending_stiffness=0.012)), cable="h/l")
    last = cycle.step(grips, stamp=next(STAMPS))
    assert all(shape.status is cs.Status.OK for shape in last.shapes.values())
    assert min(gap(lines(last.shapes)["c"], lines(last.shapes)[arm]) for arm in ("h/l", "h/r")) > -2e-5
    assert before.shapes["h"].status is cs.Status.OK


def test_tubes_of_a_harness_are_of_one_that_others_touch():
    known = cs.Uncertainty({"bending_stiffness": 0.2})
    cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE, uncertainty=known)
    report = lowered(cycle)[-1]
    assert {"c", "h/stem", "h/l", "h/r"} <= report.tubes.keys()
    sides = []
    for factor in (0.8, 1.2):
        stiff = ARM.replace(bending_stiffness=factor * 0.01, twisting_stiffness=factor * 0.008)
        other = cs.Cycle({"c": CABLE, "h": forked(stiff)}, scene=SOLVE)
        sides.append(lines(lowered(other)[-1].shapes)["h/l"].positions)
    spread = 0.5 * np.linalg.norm(sides[1] - sides[0], axis=1).max()
    assert spread < report.tubes["h/l"].radius.max() < 6.0 * spread


def test_what_is_in_an_eyelet_is_left_to_warnings():
    ring = cs.Clip(0.2, clipped().pose, kind="slide", segment="stem")
    cycle = cs.Cycle({"c": CABLE, "d": CABLE, "h": forked()}, scene=SOLVE, clips={"h": [ring], "c": [], "d": []})
    reports = lowered(cycle, d=over(0.3, x=-0.1))
    assert min(gap(*(lines(report.shapes)[name] for name in ("c", "h/l"))) for report in reports) < -0.5 * ARM.diameter
    assert any(warning.other == "h/l" for report in reports for warning in report.warnings)


def test_parts_are_asked_for_by_themselves():
    ring = cs.Clip(0.2, cs.Pose((-0.2, -0.9, 0.0)), kind="slide")
    cycle = cs.Cycle({"c": CABLE, "h": forked(), "u": forked()}, scene=SOLVE, clips={"c": [ring], "h": [], "u": []})
    aside = {end: cs.Pose(pose.position + np.array((0.0, 2.0, 0.0)), pose.quaternion) for end, pose in FORK.items()}
    for grips in ({"c": over(0.2)}, {"h": FORK}, {"h": FORK, "u": aside}, {"u": aside, "c": over(0.2)}):
        report = cycle.step(grips, stamp=next(STAMPS))
        assert report.shapes.keys() == grips.keys()
        for name in grips.keys() - {"c"}:
            assert report.shapes[name].status is cs.Status.OK


@pytest.mark.parametrize("upper", ["c", "h"])
def test_what_cannot_be_pushed_apart_is_let_down_on_the_other(monkeypatch, upper):
    monkeypatch.setattr(Crossing, "_grown", lambda *_: False)
    cycle = cs.Cycle({"c": CABLE, "h": forked(frames=LEVER)}, scene=SOLVE)
    height = 0.12 if upper == "c" else 0.11  # the cable's middle is above that of the arms, or below
    grips = {"c": over(height), "h": FORK}
    report = cycle.step(grips, stamp=next(STAMPS))
    assert {name: shape.status.name for name, shape in report.shapes.items()} == {"c": "OK", "h": "OK"}
    found = lines(report.shapes)
    assert {contact.body for contact in found["c"].contacts} & {"h/l", "h/r"}
    assert all((contact.normal[2] > 0.0) == (upper == "c") for contact in found["c"].contacts)
    assert cycle.step({**grips, "c": over(height + 1e-3)}, stamp=next(STAMPS)).shapes["h"].status is cs.Status.OK


def test_a_harness_goes_on_from_its_last_equilibrium_however_much_is_found_after():
    predictor = cs.Predictor(forked(), scene=SOLVE)
    shape = predictor.predict(FORK)
    predictor.begin(shape, FORK, None)
    part = predictor.crossing.strands.part_with(0)
    for _ in range(40):
        part.alone()
    assert part.as_one(list(shape.segments.values())) is shape


def test_segments_that_lie_on_each_other_are_no_nearer_for_their_tubes():
    loose = cs.Harness({"d": CABLE, "e": CABLE})
    cycle = cs.Cycle({"h": loose}, scene=SOLVE, uncertainty=cs.Uncertainty({"bending_stiffness": 0.2}))
    ends = {"d.start": posed((-0.4, 0.0, 0.0)), "d.end": posed((0.4, 0.1, 0.0))}
    for height in np.linspace(0.0, -0.12, 25):
        pair = dict(zip(("e.start", "e.end"), over(height, 0.1), strict=True))
        report = cycle.step({"h": {**ends, **pair}}, stamp=next(STAMPS))
    (contact,) = report.shapes["h"].segments["d"].contacts
    assert contact.body == "h/e"
    (near,) = (body for body in report.clearance["h/d"].bodies if body.body == "h/e")
    assert near.distance == pytest.approx(0.0, abs=5e-5)
    assert report.tubes["h/d"].radius.max() > 1e-4


@pytest.mark.parametrize(("cable", "end"), [("c", "start"), ("c", "end"), ("h", "r.end")])
def test_an_end_that_opens_lets_its_part_hang_over_the_other(cable, end):
    cycle = cs.Cycle({"c": CABLE, "h": forked()}, scene=SOLVE)
    lowered(cycle, DOWN[:12])
    assert cycle.edit(cs.Open(end), cable=cable)
    for height in DOWN[12:16]:
        report = cycle.step({"c": over(height), "h": FORK}, stamp=next(STAMPS))
        found = lines(report.shapes)
        assert all(shape.status is cs.Status.OK for shape in found.values())
        (contact,) = found["c"].contacts
        assert found[contact.body].contacts[0].force == contact.force > 0.05
        assert min(gap(found["c"], found[arm]) for arm in ("h/l", "h/r")) > -2e-5
