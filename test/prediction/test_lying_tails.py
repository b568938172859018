"""Tails beyond the grips among bodies: cables with a free end that lie where they fall, with friction and memory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rods import ALONG_X

import cable_shape as cs
from cable_shape.prediction.carried import carried_tails, place_of
from cable_shape.prediction.layout import Laid
from cable_shape.safety.report import Severity
from cable_shape.safety.report import WarningKind as Kind
from cable_shape.safety.warnings import tail_warning

CABLE = cs.Cable(
    length=0.8, linear_density=0.1, bending_stiffness=0.01, diameter=0.008, tails={"start": 0.4, "end": 0.5}
)
START, END = cs.Pose((0.0, 0.0, 0.1), ALONG_X), cs.Pose((0.7, 0.0, 0.08), ALONG_X)
BACK = cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0))
RADIUS, WEIGHT = 0.004, 0.1 * 9.81


def table(height: float = 0.0, friction: float = 0.0, link: str | None = None) -> cs.Obstacle:
    return cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, height)), link=link, friction=friction)


def scene(*bodies: cs.Obstacle, **others) -> cs.Scene:
    return cs.Scene(obstacles=bodies or (table(),), contact="solve", **others)


def step(cycle: cs.Cycle, k: int, by=(0.0, 0.0, 0.0), **keywords) -> cs.CycleReport:
    """One in which both grips have gone by a vector."""
    grips = tuple(cs.Pose(grip.position + np.array(by), ALONG_X) for grip in (START, END))
    return cycle.step({"cable": grips}, 10_000_000 * k, **keywords)


def pressed(shape: cs.CableShape) -> np.ndarray:
    """(3,) [N], what bodies do to a cable in all."""
    return sum((c.force * c.normal + c.tangential_force for c in shape.contacts), np.zeros(3))


def weight_of(length: float, tail: cs.CableShape) -> np.ndarray:
    """(3,) [N], that its grip carries."""
    return pressed(tail) - np.array((0.0, 0.0, WEIGHT * length))


# -- the shape


def test_tails_that_reach_a_table_are_cables_with_a_free_end_in_contact():
    tails = cs.predict_tails(CABLE, START, END, scene=scene())
    for side, held, length in (("start", START * BACK, 0.4), ("end", END, 0.5)):
        tail, own = tails[side], CABLE.replace(length=length, tails=None)
        wanted = cs.predict(own, held, None, scene=scene(), points=tail.points, tolerance=1e-3 * length)
        assert tail.status is cs.Status.OK
        assert len(tail.contacts) == len(wanted.contacts) > 0
        assert np.array_equal(tail.buffer, wanted.buffer)
        assert tail.positions[:, 2].min() == pytest.approx(RADIUS, abs=2e-4)
    free = cs.predict_tails(CABLE, START, END)
    assert free["end"].positions[:, 2].min() < -0.2


def test_what_a_tail_weighs_its_grip_and_the_table_carry():
    report = step(cs.Cycle(CABLE, scene=scene()), 0)
    for side, length in (("start", 0.4), ("end", 0.5)):
        tail = report.tails["cable", side]
        assert tail.force[0] == pytest.approx(weight_of(length, tail), abs=2e-4)
        arms = [c.point - tail.positions[0] for c in tail.contacts]
        lever = sum((np.cross(r, c.force * c.normal) for r, c in zip(arms, tail.contacts, strict=True)), np.zeros(3))
        middle = np.trapezoid(tail.positions - tail.positions[0], tail.arc_length, axis=0)
        lever += np.cross(middle, (0.0, 0.0, -WEIGHT))
        assert tail.moment[0] == pytest.approx(lever, abs=5e-4)
        assert all(0.0 < c.arc_length <= length for c in tail.contacts)  # from the grip outwards


def test_lifted_off_a_tail_is_the_free_one_and_let_down_it_lies_again():
    cycle = cs.Cycle(CABLE, scene=scene())
    lain = step(cycle, 0).tails["cable", "end"]
    for k, z in enumerate((*np.linspace(0.0, 0.6, 30), *np.linspace(0.6, 0.0, 30)), 1):
        report = step(cycle, k, (0.0, 0.0, z))
        tail = report.tails["cable", "end"]
        assert tail.usable
        if z > 0.59:
            free = cs.predict_tails(CABLE, *report.grips["cable"])["end"]
            assert tail.contacts == ()
            assert np.interp(np.linspace(0, 0.5, 9), tail.arc_length, tail.positions[:, 2]) == pytest.approx(
                np.interp(np.linspace(0, 0.5, 9), free.arc_length, free.positions[:, 2]), abs=1e-3
            )
    assert tail.status is cs.Status.OK
    assert tail.positions == pytest.approx(lain.positions, abs=1e-3)


def test_without_contact_being_solved_for_tails_go_through():
    for contact in ("warn", "off"):
        report = step(cs.Cycle(CABLE, scene=cs.Scene(obstacles=[table()], contact=contact)), 0)
        assert report.tails["cable", "end"].positions[:, 2].min() < -0.2
        assert report.tails["cable", "end"].contacts == ()


def test_a_chain_has_no_contact_and_its_tails_none_either():
    chain = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.0, tails={"end": 0.3})
    report = cs.Cycle(chain, scene=cs.Scene(contact="solve")).step({"cable": (START, END)}, 0)
    assert report.tails["cable", "end"].positions[-1, 2] == pytest.approx(0.08 - 0.3)


# -- friction


def test_dragged_to_and_fro_a_tail_is_held_by_what_coulomb_allows_and_loops_come_to_coincide():
    mu, soft = 0.4, CABLE.replace(bending_stiffness=0.002)
    cycle = cs.Cycle(soft, scene=scene(table(friction=mu)))
    loop = [np.arange(0.05, -0.05, -0.005), np.arange(-0.05, 0.05, 0.005)]
    way = np.concatenate([np.arange(0.0, 0.05, 0.005), *loop * 3])
    shapes = [step(cycle, k, (0.0, y, 0.0)).tails["cable", "end"] for k, y in enumerate(way)]
    assert [tail.frictionless for tail in shapes[:3]] == [True, False, False]
    for tail in shapes:
        assert tail.usable
        for c in tail.contacts:
            size = np.linalg.norm(c.tangential_force)
            assert size <= 1.001 * mu * c.force
            fresh = size == 0.0  # what touches there for the first time
            assert fresh or not c.slips or size == pytest.approx(mu * c.force, rel=2e-3)
        assert tail.force[0] == pytest.approx(weight_of(0.5, tail), abs=1e-3)
    told = np.array([pressed(tail)[1] for tail in shapes])
    assert told[-40:].max() > 0.02
    assert told[-40:].min() < -0.02
    first, second, third = told[10:50], told[50:90], told[90:]
    assert np.abs(second - third).max() < 0.12 * np.ptp(third)
    assert np.abs(third[:20] + third[20:]).max() < 0.2 * np.ptp(third)  # the way back is the way there, mirrored
    assert np.abs(first - second).max() > np.abs(second - third).max()
    cycle.reset()
    assert step(cycle, 0, (0.0, 0.02, 0.0)).tails["cable", "end"].frictionless


# -- what is judged


def test_a_tail_that_may_lie_there_is_no_alarm_and_its_force_counts():
    def report(*allow: cs.Allow) -> cs.CycleReport:
        return step(cs.Cycle(CABLE, scene=scene(allow=allow)), 0)

    plain = report()
    (body,) = plain.clearance["cable"].bodies
    assert -2e-4 < body.distance < 1e-4
    assert [w.other for w in plain.warnings if w.kind is Kind.CLEARANCE] == ["table"]
    assert not [w for w in report(cs.Allow("table")).warnings if w.kind is Kind.CLEARANCE]
    assert [w for w in report(cs.Allow("table", start=0.0, end=0.8)).warnings if w.kind is Kind.CLEARANCE]
    parts = [plain.shapes["cable"], *plain.tails.values()]
    carried = sum(c.force for part in parts for c in part.contacts)
    assert carried > 0.4
    (used,) = (m for m in report(cs.Allow("table", max_force=2.0)).margins["cable"] if m.kind is Kind.CONTACT_FORCE)
    assert used.value == pytest.approx(carried, rel=1e-6)
    assert any(w.kind is Kind.CLEARANCE for w in report(cs.Allow("table", max_force=0.5 * carried)).warnings)
    beyond = report(cs.Allow("table", start=0.8, max_force=2.0))
    (used,) = (m for m in beyond.margins["cable"] if m.kind is Kind.CONTACT_FORCE)
    assert used.value == pytest.approx(sum(c.force for c in plain.tails["cable", "end"].contacts), rel=1e-6)
    assert used.arc_length > 0.8


def test_a_tail_bent_too_far_where_it_lies_is_an_alarm():
    tail = step(cs.Cycle(CABLE, scene=scene()), 0).tails["cable", "end"]
    least = float(tail.bend_radius.min())
    for factor, alarms in ((0.9, False), (1.2, True)):
        own = CABLE.replace(min_bend_radius=factor * least, tails={"end": 0.5})
        report = step(cs.Cycle(own, scene=scene(allow=[cs.Allow("table", end=0.8), cs.Allow("table", start=0.81)])), 0)
        beyond = [w for w in report.warnings if w.kind is Kind.CLEARANCE and w.arc_length > 0.8]
        assert bool(beyond) is alarms


def test_a_tail_that_has_jumped_says_so():
    tail = step(cs.Cycle(CABLE, scene=scene()), 0).tails["cable", "end"]
    tail.status = cs.Status.SNAPPED
    warning = tail_warning("cable", "end", tail)
    assert warning.severity is Severity.WARN
    assert "tail at the end: SNAPPED" in warning.text
    assert "not judged" not in warning.text
    tail.status = cs.Status.NOT_CONVERGED
    assert tail_warning("cable", "end", tail).severity is Severity.ERROR


# -- on links


def test_a_table_on_a_link_carries_a_tail_as_one_in_the_world():
    own = cs.Cycle(CABLE, scene=scene(table(link="lift", friction=0.3)))
    world = cs.Cycle(CABLE, scene=scene(table(friction=0.3)))
    for k in range(8):
        z = 0.002 * k
        one = step(own, k, (0.0, 0.0, z), links={"lift": cs.Pose((0.0, 0.0, z))})
        two = step(world, k)
        for side in ("start", "end"):
            a, b = one.tails["cable", side], two.tails["cable", side]
            assert a.status is cs.Status.OK
            assert a.positions - np.array((0.0, 0.0, z)) == pytest.approx(b.positions, abs=1e-6)
    left_out = step(cs.Cycle(CABLE, scene=scene(table(link="lift"))), 0)
    assert left_out.tails["cable", "end"].positions[:, 2].min() < -0.2


def test_what_grips_is_no_body_to_the_tail_within_5_cm_and_beyond_it_is():
    hand = cs.Obstacle("hand", cs.Box((0.06, 0.05, 0.05)), link="gripper")
    rod = dataclasses.replace(
        hand, name="rod", solid=cs.Cylinder(0.01, 0.3), pose=cs.Pose((0.1, 0.0, -0.05), (0.7071068, 0, 0, 0.7071068))
    )
    cycle = cs.Cycle(CABLE, scene=cs.Scene(contact="solve"), robot_links=[hand, rod], gripping_links=["gripper"])
    tail = step(cycle, 0, links={"gripper": cs.Pose(END.position)}).tails["cable", "end"]
    assert tail.status is cs.Status.OK
    assert {c.body for c in tail.contacts} == {"rod"}
    assert all(c.arc_length > 0.05 for c in tail.contacts)


# -- harnesses, edits, tubes


def test_tails_of_a_harness_lie_as_those_of_a_cable():
    halves = {
        "a": CABLE.replace(length=0.4, tails={"start": 0.4}),
        "b": CABLE.replace(length=0.4, tails={"end": 0.5}),
    }
    harness = cs.Harness(halves, [cs.Junction("j", ("a.end", "b.start"))])
    whole = scene(allow=[cs.Allow("table")])
    one = cs.Cycle({"h": harness}, scene=whole, points=150).step({"h": {"a.start": START, "b.end": END}}, 0)
    two = step(cs.Cycle(CABLE, scene=whole), 0)
    for key, side in ((("h/a", "start"), "start"), (("h/b", "end"), "end")):
        tail, wanted = one.tails[key], two.tails["cable", side]
        assert tail.contacts
        every = np.linspace(0.0, tail.length, 7)
        for i in range(3):
            assert np.interp(every, tail.arc_length, tail.positions[:, i]) == pytest.approx(
                np.interp(every, wanted.arc_length, wanted.positions[:, i]), abs=1e-3
            )
    assert not [w for w in one.warnings if w.kind is Kind.CLEARANCE]


def dragged(friction: float = 0.5) -> tuple[cs.Cycle, cs.CycleReport]:
    """A cycle whose tails are held by a table, and its last report."""
    cycle = cs.Cycle(CABLE, scene=scene(table(friction=friction)))
    for k in range(8):
        report = step(cycle, k, (0.0, 0.003 * k, 0.0))
    return cycle, report


def test_an_edit_beside_a_tail_leaves_it_where_friction_holds_it():
    cycle, before = dragged()
    post = cs.Obstacle("post", cs.Cylinder(0.02, 0.3), cs.Pose((0.3, 0.5, 0.15)))
    assert cycle.edit(cs.Add(post))
    after = step(cycle, 8, (0.0, 0.021, 0.0))
    for side in ("start", "end"):
        one, two = before.tails["cable", side], after.tails["cable", side]
        assert not two.frictionless
        assert two.positions == pytest.approx(one.positions, abs=2e-4)
        assert np.linalg.norm(pressed(one)[:2]) > 0.02
        assert pressed(two) == pytest.approx(pressed(one), abs=0.01)


def test_what_a_grip_lets_go_of_becomes_part_of_the_tail_and_stays_where_it_lies():
    """Of a span that hardly sags, which bends the tail hardly less when it is let go."""
    lies = {}
    for friction in (0.0, 0.5):
        cycle = cs.Cycle(CABLE, scene=scene(table(friction=friction)))
        for k in range(8):
            grips = [cs.Pose((x, 0.003 * k, 0.08), ALONG_X) for x in (0.0, 0.798)]
            report = cycle.step({"cable": tuple(grips)}, 10_000_000 * k)
        line, place = report.tails["cable", "end"], place_of(report.shapes["cable"], 0.75)
        assert cycle.edit(cs.Regrip("end", 0.75))
        after = cycle.step({"cable": (grips[0], place)}, 90_000_000).tails["cable", "end"]
        assert after.length == pytest.approx(0.55)
        assert after.frictionless is False
        far = np.linspace(0.4, 0.5, 9)
        for i in range(3):
            assert np.interp(far + 0.05, after.arc_length, after.positions[:, i]) == pytest.approx(
                np.interp(far, line.arc_length, line.positions[:, i]), abs=3e-3
            )
        lies[friction] = after
    assert lies[0.0].positions[-1, 1] == pytest.approx(0.021, abs=1e-5)
    assert lies[0.5].positions[-1, 1] < 0.015  # it stays behind


def test_tails_beyond_other_grips_are_parts_of_the_same_line():
    _, report = dragged()
    before = Laid(CABLE.replace(length=0.8 + 0.9, tails=None), 0.4, 1.2)
    tails = {side: report.tails["cable", side] for side in ("start", "end")}
    for first, last in ((0.4, 1.2), (0.5, 1.1), (0.3, 1.35)):
        own = carried_tails(report.shapes["cable"], tails, before, before.held_from(first, last))
        for side, at, way in (("start", first, -1.0), ("end", last, 1.0)):
            tail = own[side]
            assert tail.length == pytest.approx(first if side == "start" else 1.7 - last)
            for arc, place in zip(tail.arc_length[::12], tail.positions[::12], strict=True):
                made = at + way * arc
                if 0.4 <= made <= 1.2:
                    there = report.shapes["cable"], made - 0.4
                else:
                    there = (tails["start"], 0.4 - made) if made < 0.4 else (tails["end"], made - 1.2)
                wanted = [np.interp(there[1], there[0].arc_length, x) for x in there[0].positions.T]
                assert place == pytest.approx(wanted, abs=1e-9)
            assert np.abs(np.diff(tail.positions, axis=0) / tail.arc_length[1] - tail.tangents[1:]).max() < 0.1
            known = {round(at + way * c.arc_length, 9): c for c in tail.contacts}
            for c in tails[side].contacts:
                same = known.get(round(0.4 - c.arc_length if side == "start" else 1.2 + c.arc_length, 9))
                if same is not None:
                    assert (same.body, same.force) == (c.body, c.force)
            if first >= 0.4 and last <= 1.2:
                assert len(known) >= len(tails[side].contacts)


def test_a_body_is_not_added_where_the_middle_of_a_tail_is():
    cycle, report = dragged(0.0)
    tip = report.tails["cable", "end"].positions[-1]
    assert not cycle.edit(cs.Add(cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose(tip))))
    assert cycle.edit(cs.Add(cs.Obstacle("ball", cs.Sphere(0.03), cs.Pose(tip + np.array((0.1, 0.0, 0.0))))))


def test_a_tube_of_a_tail_lies_on_the_table_with_it():
    known = cs.Uncertainty(start=np.diag([1e-6] * 3 + [1e-5] * 3), end=np.diag([1e-6] * 3 + [1e-5] * 3))
    report = step(cs.Cycle(CABLE.replace(bending_stiffness=0.002), scene=scene(), uncertainty=known), 0)
    tail, tube = report.tails["cable", "end"], report.tail_tubes["cable", "end"]
    lies = tail.arc_length > min(c.arc_length for c in tail.contacts) + 0.02
    height = np.sqrt(tube.covariance[:, 2, 2])
    assert height[5] > 5e-4
    assert np.sqrt(tube.covariance[lies, 1, 1]).min() > 5e-4
    assert height[lies].max() < 2e-4
