"""Cables that rest on each other and on bodies, or are held in clips there: balance, plain solvers, motions."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scene_random import motion, run, run_motion
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.one_cable import OneCable
from cable_shape.solve.touching.pile import Pile
from cable_shape.solve.touching.places import Places
from cable_shape.solve.touching.spot import Spot
from cable_shape.solve.touching.strands import Strands

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
CABLE = cs.Cable(1.0, 0.1, 0.008, 0.006, diameter=0.008)
PAIR = {"under": CABLE, "over": CABLE}
TABLE = cs.Obstacle("table", cs.HalfSpace())
ON_TABLE = cs.Scene(obstacles=[TABLE], contact="solve")
WEIGHT = 9.81 * CABLE.linear_density * CABLE.length


def across(angle, chord, height, aside=(0.0, 0.0)):
    """Grips `chord` apart at `angle` [degrees] to the x axis."""
    turn = Rotation.from_euler("z", angle, degrees=True)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    quaternion = (turn * ALONG_X).as_quat()
    middle = np.array((*aside, height))
    return cs.Pose(middle - half, quaternion), cs.Pose(middle + half, quaternion)


def lowered(heights, scene=ON_TABLE, low=0.04, angle=70.0, aside=(0.02, 0.01), **options):
    """A cycle in which `over` was let down onto `under`, and its reports."""
    cycle = cs.Cycle(PAIR, scene=scene, model="cosserat", **options)
    reports = []
    for k, height in enumerate(heights):
        grips = {"under": across(0.0, 0.9, low), "over": across(angle, 0.9, height, aside)}
        reports.append(cycle.step(grips, stamp=10_000_000 * k))
        assert all(shape.status for shape in reports[-1].shapes.values()), (height, reports[-1].shapes)
    return reports, cycle


DOWN = np.linspace(0.21, 0.06, 61)


def strands_of(names, problems):
    """Cables by these names, of which nothing is solved for."""
    pairs = zip(names, problems, strict=True)
    return Strands([OneCable(name, SimpleNamespace(problem=problem)) for name, problem in pairs])


def total(contacts, *bodies):
    """(3,) [N], of those bodies on the cable."""
    return sum((c.force * c.normal for c in contacts if c.body in bodies), np.zeros(3))


def test_the_table_carries_the_weight_and_the_press():
    reports, _ = lowered(DOWN)
    under, over = (reports[-1].shapes[name] for name in ("under", "over"))
    press = total(under.contacts, "over")
    assert press[2] < -0.05
    assert total(over.contacts, "under") == pytest.approx(-press, abs=1e-9)
    for shape, other in ((under, "over"), (over, "under")):
        grips = shape.force[-1] - shape.force[0]
        table = total(shape.contacts, "table")
        assert grips + table + total(shape.contacts, other) + (0.0, 0.0, -WEIGHT) == pytest.approx(
            np.zeros(3), abs=1e-5 * WEIGHT
        )
    before = total(reports[0].shapes["under"].contacts, "table")[2]
    assert total(under.contacts, "table")[2] - before == pytest.approx(-press[2], rel=0.5)  # the grips take the rest
    assert [c.arc_length for c in under.contacts] == sorted(c.arc_length for c in under.contacts)
    for clearance in reports[-1].clearance.values():
        assert all(body.distance > -2e-4 for body in clearance.bodies)


def test_taut_and_pressed_onto_the_table_is_a_point_mass_there():
    """At a right angle, middle on middle: what is pressed to the table is a cable with a mass as heavy as the press."""
    cable = cs.Cable(0.6, 0.005, 0.01, 0.008, diameter=0.008, axial_stiffness=200.0)
    cycle = cs.Cycle(dict.fromkeys(PAIR, cable), scene=ON_TABLE, model="cosserat")
    for k, height in enumerate(np.linspace(0.03, 0.006, 25)):  # taut by 1 N
        grips = {"under": across(0.0, 0.603, 0.008), "over": across(90.0, 0.603, height)}
        report = cycle.step(grips, stamp=k)
        assert all(shape.status is cs.Status.OK for shape in report.shapes.values())
    under = report.shapes["under"]
    (contact,) = [c for c in under.contacts if c.body == "over"]
    assert contact.arc_length == pytest.approx(0.3, abs=1e-4)
    assert contact.normal == pytest.approx((0, 0, -1), abs=1e-4)
    loaded = cs.Scene(obstacles=[TABLE], masses=[cs.PointMass(0.3, contact.force / 9.81)], contact="solve")
    alone = cs.predict(cable, *across(0.0, 0.603, 0.008), scene=loaded, model="cosserat")
    assert alone.status is cs.Status.OK
    assert np.abs(alone.positions - under.positions).max() < 1e-5
    ours, theirs = (total(shape.contacts, "table")[2] for shape in (under, alone))
    assert 0.1 * contact.force < ours < contact.force
    assert ours == pytest.approx(theirs, rel=1e-3)


def test_what_crosses_in_a_clip_is_the_clipped_cable_under_a_point_mass():
    clip = cs.Clip(0.3, cs.Pose((-0.19, 0.0, 0.02)))
    cycle = cs.Cycle(PAIR, scene=cs.Scene(contact="solve"), clips={"under": [clip]}, model="cosserat")
    for k, height in enumerate(np.linspace(0.25, 0.12, 41)):
        grips = {"under": across(0.0, 0.9, 0.1), "over": across(90.0, 0.9, height, (0.06, 0.0))}
        report = cycle.step(grips, stamp=k)
    under, over = report.shapes["under"], report.shapes["over"]
    (contact,), (load,) = under.contacts, under.clips
    assert not over.clips
    assert load.arc_length == 0.3
    assert np.abs(under.positions[int(0.3 * 149)] - clip.pose.position).max() < 0.01
    push = contact.force * contact.normal
    mass = cs.PointMass(contact.arc_length, -push[2] / 9.81)
    scene = cs.Scene(clips=[clip], masses=[mass], contact="warn")
    alone = cs.predict(CABLE, *across(0.0, 0.9, 0.1), scene=scene, model="cosserat")
    assert np.linalg.norm(push[:2]) < 0.05 * np.linalg.norm(push)  # so that a weight is nearly the same
    assert np.abs(alone.positions - under.positions).max() < 5e-3 * CABLE.length
    outside = under.force[-1] - under.force[0] + over.force[-1] - over.force[0] - load.force
    assert outside == pytest.approx((0.0, 0.0, 2.0 * WEIGHT), abs=1e-5 * WEIGHT)


@pytest.mark.parametrize(
    ("solid", "low", "angle", "aside"),
    [
        (cs.Obstacle("box", cs.Box((0.3, 0.5, 0.2))), 0.1, 91.0, (0.018, 0.018)),
        (
            cs.Obstacle("post", cs.Capsule(0.03, 0.8), cs.Pose((0, 0, -0.08), (0.70710678, 0, 0, 0.70710678))),
            0.1,
            70.0,
            (0.01, 0.02),
        ),
    ],
    ids=["box", "post"],
)
def test_neither_cable_goes_into_a_body_or_the_other(solid, low, angle, aside):
    scene = cs.Scene(obstacles=[solid], contact="solve")
    reports, _ = lowered(np.linspace(0.32, 0.12, 101), scene, low, angle, aside)
    touched = set()
    for report in reports:
        for clearance in report.clearance.values():
            assert all(body.distance > -2e-4 for body in clearance.bodies)
        touched |= {(name, c.body) for name, shape in report.shapes.items() for c in shape.contacts}
    assert {("under", solid.name), ("under", "over"), ("over", "under")} <= touched


def test_lifted_off_again_both_lie_as_they_did():
    reports, cycle = lowered([*DOWN, *DOWN[::-1]])
    assert not cycle._cables["under"].predictor.touching
    for name in PAIR:
        first, last = reports[0].shapes[name], reports[-1].shapes[name]
        assert np.abs(first.positions - last.positions).max() < 1e-3 * CABLE.length
        assert {c.body for c in last.contacts} <= {"table"}


def test_cables_found_in_the_same_place_on_a_table_go_over_each_other():
    cycle = cs.Cycle(PAIR, scene=ON_TABLE, model="cosserat")
    grips = {"under": across(0.0, 0.9, 0.05), "over": across(90.0, 0.9, 0.05, (0.03, 0.02))}
    report = cycle.step(grips, stamp=0)
    assert all(shape.status is cs.Status.OK for shape in report.shapes.values())
    assert total(report.shapes["over"].contacts, "under")[2] > 0.05
    assert all(shape.reused for shape in cycle.step(grips, stamp=1).shapes.values())


def test_a_cable_loops_on_itself_on_a_table():
    cable = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.03)))
    predictor = cs.Predictor(cable, scene=cs.Scene(obstacles=[table], contact="solve"), model="cosserat")
    touched = set()
    for turns in np.arange(0.3, 1.2, 0.01):
        roll = Rotation.from_rotvec((2.0 * np.pi * turns, 0.0, 0.0)) * ALONG_X
        start, end = cs.Pose((0.0, 0.0, 0.0), ALONG_X.as_quat()), cs.Pose((0.3, 0.0, 0.0), roll.as_quat())
        shape = predictor.predict(start, end)
        assert shape.status
        touched.add(frozenset(c.body for c in shape.contacts))
    assert frozenset({"itself", "table"}) in touched


def test_cables_on_a_plate_that_a_link_carries_go_with_it():
    """Let down onto the plate and each other, then lifted by it."""
    plate = cs.Obstacle("plate", cs.Box((2.0, 2.0, 0.02)), cs.Pose((0.0, 0.0, -0.01)), link="tool")
    cycle = cs.Cycle(PAIR, scene=cs.Scene(contact="solve"), robot_links=[plate], model="cosserat")
    grips = {}
    for k, (height, lift) in enumerate([*((h, 0.0) for h in DOWN[::2]), *((DOWN[-1], 0.001 * i) for i in range(1, 9))]):
        grips = {"under": across(0.0, 0.9, 0.04), "over": across(70.0, 0.9, height, (0.02, 0.01))}
        report = cycle.step(grips, stamp=k, links={"tool": cs.Pose((0.0, 0.0, lift))})
        assert all(shape.status for shape in report.shapes.values())
        for clearance in report.clearance.values():
            assert all(body.distance > -2e-4 for body in clearance.bodies)
    assert {c.body for c in report.shapes["under"].contacts} == {"plate", "over"}
    apart = cycle.step(grips, stamp=1000)  # where the link is is not known: it keeps nothing out
    assert all("plate" not in {c.body for c in shape.contacts} for shape in apart.shapes.values())


def test_a_cable_that_is_not_near_another_is_not_looked_at():
    far, _ = lowered([0.4, 0.3995])
    assert far[-1].skipped["crossings"] == 3  # the pair, and each with itself
    near, _ = lowered([*DOWN, DOWN[-1] - 0.0005])
    assert near[-1].skipped["crossings"] == 2


def test_bounds_rule_out_nothing_that_touches():
    """With and without them the shapes are the same to the bit."""
    seen = []
    for cull in (True, False):
        cycle = cs.Cycle(PAIR, scene=ON_TABLE, model="cosserat")
        for k, height in enumerate(DOWN[::4]):
            grips = {"under": across(0.0, 0.9, 0.04), "over": across(70.0, 0.9, height, (0.02, 0.01))}
            report = cycle.step(grips, stamp=k)
            cycle._crossing[1]._places.cull = cull
        seen.append(report)
    assert total(seen[0].shapes["under"].contacts, "over")[2] < -0.05
    assert seen[0].skipped["crossings"] > seen[1].skipped["crossings"] == 0
    for name in PAIR:
        assert np.array_equal(*(report.shapes[name].buffer for report in seen))


def test_clips_of_one_cable():
    with pytest.raises(cs.CableShapeError, match="under"):
        cs.Cycle(PAIR, clips={"udner": []})


def test_what_cannot_be_held_is_named():
    clip = cs.Clip(0.3, cs.Pose((-0.19, 0.0, 0.02)))
    problems = [Problem(CABLE, scene=cs.Scene(clips=[clip], contact="solve")), Problem(CABLE, scene=ON_TABLE)]
    places = Places(strands_of(("under", "over"), problems))

    def spot(*arcs):
        return Spot((0, 1), np.array(arcs), np.zeros((2, 3)), 0.008, np.array(arcs))

    assert not places.crowded([spot(0.4, 0.3), spot(0.5, 0.5)])
    assert "'under' is touched at a grip, at a clip" in places.crowded([spot(0.3, 0.5)])
    assert "'over' is touched" in places.crowded([spot(0.5, 1.0)])
    assert "'under' is touched" in places.crowded([spot(0.5, 0.2), spot(0.5, 0.7)])


def test_eyelets_leave_cables_to_warnings():
    ring = cs.Clip(0.3, cs.Pose((-0.19, 0.0, 0.02)), kind="slide")
    cycle = cs.Cycle(PAIR, scene=cs.Scene(contact="solve"), clips={"under": [ring]}, model="cosserat")
    assert not cycle._solves_crossing


def test_a_pile_keeps_and_restores():
    _, cycle = lowered(DOWN)
    group = cycle._crossing[1]._group
    assert isinstance(group, Pile)
    kept, frames = group.keep(), group.frames.copy()
    spot = group.spots[0].copy()
    moved = frames.copy()
    moved[2:4, 2] -= 0.001
    assert group.go(moved)
    assert group.spots[0].press != spot.press
    group.restore(kept)
    assert np.array_equal(group.frames, frames)
    assert group.go(frames)
    assert group.spots[0].press == pytest.approx(spot.press, rel=1e-5)


def test_a_crossing_is_followed_over_the_edge_that_its_cable_lies_on():
    """There the meshes that lead nowhere are those on which the crossing comes next to the contact on the edge."""
    box = cs.Scene(obstacles=[cs.Obstacle("box", cs.Box((0.3, 0.5, 0.2)))], contact="solve")
    cycle = cs.Cycle(PAIR, scene=box, model="cosserat")
    down = [(height, 0.0) for height in np.linspace(0.3, 0.13, 60)]
    for k, (height, drawn) in enumerate([*down, *((0.13, along) for along in np.linspace(0.0, 0.05, 40))]):
        grips = {"under": across(0.0, 0.9, 0.1), "over": across(120.0, 0.9, height, (0.02 + drawn, 0.01))}
        report = cycle.step(grips, stamp=10_000_000 * k)
        assert all(shape.status for shape in report.shapes.values()), (k, report.shapes)
        shapes = report.shapes.values()
        held = sum((s.force[-1] - s.force[0] + total(s.contacts, "box") for s in shapes), np.zeros(3))
        assert held == pytest.approx((0.0, 0.0, 2.0 * WEIGHT), abs=2e-3 * WEIGHT)


def test_a_crossing_comes_as_near_as_it_likes_to_where_its_cable_touches_a_body():
    """A contact keeps off the next node by a part of both its elements: a long one held it off the body's contact."""
    found = run("cables on bodies", 66)
    assert found.lost == ()
    assert not found.wrong, found.first


def test_cables_whose_branch_ends_are_found_where_their_pair_has_turned_round():
    """Slid against drag, with whole rows of contacts on a round body, they are not."""
    given = motion("cables on bodies", 30)
    found = run_motion(given._replace(steps=given.steps[5:17]), "cables on bodies 30")
    assert found.lost == ()
    assert not found.wrong, found.first


def test_limp_cables_on_a_table_are_let_down_on_each_other_from_nothing(monkeypatch):
    bending = 2e-3 * 9.81 * 0.05 * 0.5**3
    thin = cs.Cable(0.5, 0.05, bending, 0.8 * bending, diameter=0.006)
    cables = {"thin": thin, "thick": thin.replace(diameter=0.0075)}
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.133)))], contact="solve")
    grips = {"thin": across(0.0, 0.205, 0.0), "thick": across(61.0, 0.205, -0.004, (-0.01, -0.001))}

    def shapes():
        return cs.Cycle(cables, scene=scene, model="cosserat").step(grips, stamp=0).shapes

    found = shapes()
    assert all(shape.status is cs.Status.OK for shape in found.values())
    press = total(found["thin"].contacts, "thick")
    assert abs(press[2]) > 1e-3
    assert total(found["thick"].contacts, "thin") == pytest.approx(-press, abs=1e-9)
    for name, shape in found.items():
        carried = shape.force[-1] - shape.force[0] + sum((c.force * c.normal for c in shape.contacts), np.zeros(3))
        weight = 9.81 * cables[name].linear_density * cables[name].length
        assert carried - np.array((0.0, 0.0, weight)) == pytest.approx(np.zeros(3), abs=1e-5 * weight)
    gaps = np.linalg.norm(found["thin"].positions[:, None] - found["thick"].positions, axis=2)
    assert gaps.min() > 0.5 * (0.006 + 0.0075) - 1e-4
    monkeypatch.setattr(Crossing, "_let_down", lambda *_: [])  # pushed apart where they lie, they have none
    assert not any(shape.usable for shape in shapes().values())


def test_ends_and_links_are_held_where_frames_have_them():
    post = cs.Obstacle("post", cs.Sphere(0.02), link="arm")
    clip = cs.Clip(0.4, cs.Pose((0.1, 0.0, 0.0)), link="hand")
    scene = cs.Scene(obstacles=[post], clips=[clip], contact="solve")
    offset = cs.Pose((0.0, 0.02, 0.1), (0.0, 0.6, 0.0, 0.8))
    grips = [cs.Grip(pose, offset=offset) for pose in across(20.0, 0.9, 0.3)]
    links = {"arm": cs.Pose((0.0, 0.0, 0.2)), "hand": cs.Pose((0.1, 0.0, 0.2)), "other": cs.Pose()}
    problems = [Problem(CABLE, scene=scene).move(grips[0], end, links) for end in (grips[1], None)]
    cables = strands_of("ab", problems)
    frames = cables.frames()
    frames[:, :3] += np.arange(3.0 * len(frames)).reshape(-1, 3)
    frames[3] = frames[2]  # of a free end
    cables.hold(frames)
    assert cables.frames() == pytest.approx(frames, abs=1e-12)
    assert problems[0].links["other"] is links["other"]
