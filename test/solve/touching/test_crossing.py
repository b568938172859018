"""Cables that rest on each other and on themselves: a plain rod under a point load, balance, motions, refusals."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from rods import integrated_residual
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.distance import passing

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
SOLVE = cs.Scene(contact="solve")
BARE = cs.Cable(0.6, 0.0, 0.01, 0.008, diameter=0.008)
HEAVY = cs.Cable(0.6, 0.05, 0.01, 0.008, diameter=0.008)
LIMP = cs.Cable(0.6, 0.05, 0.001, 0.0008, diameter=0.008)
TWISTED = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)


def posed(place, turn=None):
    """A pose whose d3 is the turned x axis."""
    return cs.Pose(place, ((turn or Rotation.identity()) * ALONG_X).as_quat())


def across(angle, chord, height, aside=(0.0, 0.0)):
    """Grips `chord` apart at `angle` [degrees] to the x axis."""
    turn = Rotation.from_euler("z", angle, degrees=True)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    middle = np.array((*aside, height))
    return posed(middle - half, turn), posed(middle + half, turn)


def pressed(heights, cable=HEAVY, angle=70.0, aside=(0.02, 0.01), mirror=False, **options):
    """A cycle in which `over` was let down onto `under`; `mirror`: everything through the plane y = 0."""
    cycle = cs.Cycle({"under": cable, "over": cable}, scene=SOLVE, model="cosserat", **options)
    sign = -1.0 if mirror else 1.0
    for k, height in enumerate(heights):
        grips = {
            "under": across(0.0, 0.5, 0.0),
            "over": across(sign * angle, 0.5, height, (aside[0], sign * aside[1])),
        }
        report = cycle.step(grips, stamp=10_000_000 * k)
        assert all(shape.status is cs.Status.OK for shape in report.shapes.values()), (height, report.shapes)
    return report, cycle


def grip_force(shape):
    """(3,) [N], of both grips on the cable."""
    return shape.force[-1] - shape.force[0]


DOWN = np.linspace(0.02, -0.04, 41)


def test_equal_cables_at_a_right_angle_are_plain_rods_under_a_point_load():
    cable, radius, gravity = BARE.replace(axial_stiffness=200.0), 0.5 * BARE.diameter, 10.0
    cycle = cs.Cycle({"a": cable, "b": cable}, scene=SOLVE, model="cosserat", gravity=(0, 0, 0))
    for k, height in enumerate(np.linspace(0.01, -0.02, 16)):  # taut by 1 N, pressed on each other
        held = {"a": across(0.0, 0.603, -height), "b": across(90.0, 0.603, height)}
        report = cycle.step(held, stamp=k)
    a, b = report.shapes["a"], report.shapes["b"]
    assert a.status is b.status is cs.Status.OK
    (on_a,), (on_b,) = a.contacts, b.contacts
    assert on_a.force == on_b.force > 0.1
    assert (on_a.body, on_b.body) == ("b", "a")
    assert on_a.normal == pytest.approx((0, 0, -1), abs=1e-6)
    assert on_a.point == pytest.approx((0, 0, 0), abs=1e-8)
    for shape, name, sign in ((a, "a", -1.0), (b, "b", 1.0)):
        load = cs.Scene(masses=[cs.PointMass(0.5 * cable.length, on_a.force / gravity)])
        alone = cs.predict(
            cable, *held[name], model="cosserat", gravity=(0, 0, sign * gravity), scene=load, points=301, tolerance=1e-8
        )
        assert alone.status is cs.Status.OK
        assert alone.positions[150] == pytest.approx((0, 0, sign * radius), abs=1e-6)
        found = np.stack([np.interp(shape.arc_length, alone.arc_length, x) for x in alone.positions.T], axis=1)
        assert np.abs(found - shape.positions).max() < 5e-6  # compared in straight lines between the points


def test_forces_balance_and_both_cables_tell_the_same_contact():
    report, _ = pressed(DOWN)
    under, over = report.shapes["under"], report.shapes["over"]
    (low,), (high,) = under.contacts, over.contacts
    assert low.force == high.force > 0.1
    assert low.normal == pytest.approx(-high.normal, abs=1e-12)
    weight = np.array((0.0, 0.0, -9.81 * HEAVY.linear_density * HEAVY.length))
    for shape, contact in ((under, low), (over, high)):
        assert grip_force(shape) + weight + contact.force * contact.normal == pytest.approx(np.zeros(3), abs=1e-6)
        k = int(np.searchsorted(shape.arc_length, contact.arc_length))
        step = shape.arc_length[1]
        jump = shape.force[k - 1] - shape.force[k] - weight * step / HEAVY.length
        assert jump == pytest.approx(contact.force * contact.normal, abs=1e-6)
        tangent = shape.tangents[k - 1] + shape.tangents[k]
        assert abs(contact.normal @ tangent) < 0.1
    assert np.linalg.norm(low.point - high.point) < 1e-9 + np.linalg.norm(low.point - low.point)
    (near,) = [b for b in report.clearance["under"].bodies if b.body == "over"]
    assert abs(near.distance) < 2e-4


def test_a_mirrored_scene_has_the_mirrored_answer():
    (a, _), (b, _) = pressed(DOWN), pressed(DOWN, mirror=True)
    for name in ("under", "over"):
        mirrored = b.shapes[name].positions * (1, -1, 1)
        assert np.abs(a.shapes[name].positions - mirrored).max() < 1e-5 * HEAVY.length
        assert a.shapes[name].contacts[0].force == pytest.approx(b.shapes[name].contacts[0].force, rel=1e-4)


@pytest.mark.parametrize(("angle", "heights"), [(35.0, DOWN), (110.0, DOWN), (145.0, DOWN), (8.0, DOWN[:24])])
def test_forces_agree_with_a_much_finer_mesh(angle, heights):
    """At 8 degrees the upper one slides off the lower one if it is pressed further."""
    (rough, _), (fine, _) = pressed(heights, angle=angle), pressed(heights, angle=angle, tolerance=1e-5 * 0.6 / 256)
    ours, reference = (r.shapes["under"].contacts[0] for r in (rough, fine))
    assert ours.force == pytest.approx(reference.force, rel=2e-3)
    assert ours.arc_length == pytest.approx(reference.arc_length, abs=1e-4)


def test_a_cable_lifted_off_is_free_again():
    report, cycle = pressed([*DOWN, *DOWN[::-1]])
    assert not report.shapes["under"].contacts
    for name, ends in report.grips.items():
        alone = cs.predict(HEAVY, *ends, model="cosserat")
        assert np.abs(alone.positions - report.shapes[name].positions).max() < 2e-5 * HEAVY.length
    assert not any(cable.predictor.touching for cable in cycle._cables.values())


def test_cables_that_touch_go_on_under_another_acceleration():
    """It grows, turns round and goes: the over cable stays above, as it does where gravity is tilted from the start."""
    report, cycle = pressed(DOWN)
    push = np.array((0.5, 1.0, 2.0))
    for k, share in enumerate((0.3, 1.0, -0.5, 1.0, 0.0), 100):
        moving = {"under": share * push, "over": np.array((0.5 * share * push, 1.5 * share * push))} if share else None
        found = cycle.step(report.grips, stamp=10_000_000 * k, acceleration=moving)
        assert all(shape.status is cs.Status.OK and len(shape.contacts) == 1 for shape in found.shapes.values())
        assert found.shapes["over"].contacts[0].normal[2] > 0.5
        assert not any(shape.reused for shape in found.shapes.values())
    for name in ("under", "over"):  # nothing of it is left
        apart = np.abs(found.shapes[name].positions - report.shapes[name].positions).max()
        assert apart < 2e-5 * HEAVY.length
    moved = cycle.step(report.grips, stamp=2_000_000_000, acceleration=dict.fromkeys(("under", "over"), push))
    tilted, _ = pressed(DOWN, gravity=(0, 0, -9.81) - push)
    for name in ("under", "over"):
        assert np.abs(moved.shapes[name].positions - report.shapes[name].positions).max() > 1e-4 * HEAVY.length
        assert np.abs(moved.shapes[name].positions - tilted.shapes[name].positions).max() < 2e-5 * HEAVY.length
        ours, theirs = moved.shapes[name].contacts[0], tilted.shapes[name].contacts[0]
        assert ours.force == pytest.approx(theirs.force, rel=1e-3)


def test_a_jump_does_not_carry_a_cable_through_another():
    stepped, _ = pressed(DOWN)
    jumped, _ = pressed([DOWN[0], DOWN[-1]])
    for name in ("under", "over"):
        apart = np.abs(stepped.shapes[name].positions - jumped.shapes[name].positions).max()
        assert apart < 1e-4 * HEAVY.length


def lies_over(report):
    """Whether `over` is above `under` where they cross."""
    under, over = (report.shapes[name].positions for name in ("under", "over"))
    apart = np.linalg.norm(under[:, None, :2] - over[None, :, :2], axis=2)
    i, j = np.unravel_index(apart.argmin(), apart.shape)
    return over[j, 2] > under[i, 2]


def let_down(cycle, heights, first=100):
    """The reports of steps to these heights of `over`."""
    for k, height in enumerate(heights, first):
        grips = {"under": across(0.0, 0.5, 0.0), "over": across(70.0, 0.5, height, (0.02, 0.01))}
        yield cycle.step(grips, stamp=10_000_000 * k)


@pytest.mark.parametrize("heights", [np.arange(-0.04, -0.45, -0.02), (-0.2, -0.5), (-0.5,)])
def test_a_cable_drawn_against_another_is_never_taken_to_have_come_through_it(heights):
    _, cycle = pressed(DOWN)
    for report in let_down(cycle, heights):
        assert all(not shape.usable for shape in report.shapes.values()) or lies_over(report)
    assert {shape.status for shape in report.shapes.values()} == {cs.Status.NOT_CONVERGED}
    assert "through a cable" in report.shapes["over"].detail
    for report in let_down(cycle, [*np.arange(heights[-1], 0.0, 0.05), *[-0.04] * 17], first=200):
        assert all(not shape.usable for shape in report.shapes.values()) or lies_over(report)
    assert {shape.status for shape in report.shapes.values()} == {cs.Status.OK}
    assert report.shapes["over"].contacts
    cycle.reset()
    (report,) = let_down(cycle, [-0.5])
    assert {shape.status for shape in report.shapes.values()} == {cs.Status.OK}
    assert not lies_over(report)


FAR = [
    (HEAVY, 0.45, (101.0, 0.42, -0.02, (0.01, 0.05)), (118.0, 0.32, -0.14, (-0.14, 0.13)), True),
    (LIMP, 0.47, (34.0, 0.3, -0.02, (-0.04, 0.0)), (87.0, 0.25, -0.02, (-0.06, 0.07)), True),
    (HEAVY, 0.3, (72.0, 0.48, -0.02, (-0.03, -0.01)), (127.0, 0.39, -0.1, (-0.01, 0.12)), True),
    (HEAVY, 0.42, (84.0, 0.49, -0.02, (-0.03, -0.01)), (57.0, 0.22, -0.08, (0.04, 0.15)), False),
]


def leapt(cable, chord, ways):
    """The last report of a cycle whose cable `over` is held in these ways, and the least distance there."""
    cycle = cs.Cycle({"under": cable, "over": cable}, scene=SOLVE, model="cosserat", quasistatic_limit=0.0)
    for k, way in enumerate(ways):
        report = cycle.step({"under": across(0.0, chord, 0.0), "over": across(*way)}, stamp=10_000_000_000 * k)
    under, over = (report.shapes[name].positions for name in ("under", "over"))
    return report, np.linalg.norm(under[:, None] - over, axis=2).min()


@pytest.mark.parametrize(("cable", "chord", "first", "last", "same"), FAR)
def test_contacts_that_are_lost_in_a_large_step_are_kept_in_smaller_ones(cable, chord, first, last, same):
    """On the whole way at once the pair of points that touch is left behind, and cables overlap elsewhere.

    From there more than one equilibrium may lie on the same side; the cables come through each other in none.
    """
    above = (*first[:2], 0.06, first[3])
    report, least = leapt(cable, chord, [above, first, last])
    assert {shape.status for shape in report.shapes.values()} == {cs.Status.OK}
    assert least > cable.diameter - 2e-4
    ends = list(zip(first, last, strict=True))
    ways = [tuple((1.0 - x) * np.array(p) + x * np.array(q) for p, q in ends) for x in np.linspace(0.0, 1.0, 31)]
    slowly, _ = leapt(cable, chord, [above, *ways])
    if same:
        for name, shape in report.shapes.items():
            assert np.abs(shape.positions - slowly.shapes[name].positions).max() < 1e-4 * cable.length
    lines = [[one.shapes[name].positions for name in ("under", "over")] for one in (slowly, report)]
    (under, over), (under_now, over_now) = lines
    assert passing.crossings(under, under_now, over, over_now, 0, np.empty((passing.MOST_CROSSINGS, 4))) == 0


def swept(steps):
    """The last report of a cable laid over another one in so many steps, in which contacts come to lie elsewhere."""
    under, turn = cs.Cable(1.06, 0.2, 0.00126, 0.00066, diameter=0.0043), Rotation.from_euler("z", 85.0, degrees=True)
    cables = {"under": under, "over": under.replace(diameter=0.0057)}
    cycle = cs.Cycle(cables, scene=SOLVE, model="cosserat", points=101)
    half = turn.apply((0.425, 0.0, 0.0))
    for k, x in enumerate(np.linspace(0.0, 1.0, steps + 1)):
        middle = (1.0 - x) * np.array((0.447, 0.009, 0.02)) + x * np.array((0.501, -0.001, -0.004))
        over = posed(middle - half, turn), posed(middle + half, turn)
        report = cycle.step({"under": (posed((0, 0, 0)), posed((0.85, 0, 0))), "over": over}, stamp=10_000_000 * k)
    return report


def test_a_cable_that_came_through_another_beside_a_place_looked_at_is_put_over_it():
    one, many = swept(1), swept(10)
    for report in (one, many):
        assert all(shape.status is cs.Status.OK for shape in report.shapes.values())
        assert lies_over(report)
    for name in ("under", "over"):
        assert np.abs(one.shapes[name].positions - many.shapes[name].positions).max() < 1e-4 * 1.06
    assert one.shapes["over"].contacts[0].force == pytest.approx(many.shapes["over"].contacts[0].force, rel=1e-3)


def test_overlapping_cables_are_pushed_apart_from_nothing():
    report, cycle = pressed([-0.005])
    (contact,) = report.shapes["under"].contacts
    assert contact.force > 0.0
    again = cycle.step(report.grips, stamp=1)
    assert all(shape.reused for shape in again.shapes.values())


def looped(cycle, chord=0.3, last=1.3):
    for k, turns in enumerate(np.arange(0.3, last, 0.01)):
        end = posed((chord, 0, 0), Rotation.from_rotvec((2.0 * math.pi * turns, 0, 0)))
        yield cycle.step({"cable": (posed((0, 0, 0)), end)}, stamp=10_000_000 * k)


def test_a_twisted_cable_rests_on_itself():
    cycle = cs.Cycle(TWISTED, scene=SOLVE, model="cosserat", points=301)
    for report in looped(cycle):
        shape = report.shapes["cable"]
        assert shape.status is cs.Status.OK
        assert all(b.distance > -2e-4 for b in report.clearance["cable"].bodies if b.body == "itself")
    one, two = shape.contacts
    assert one.body == two.body == "itself"
    assert one.force == two.force > 0.03
    assert one.normal == pytest.approx(-two.normal, abs=1e-12)
    weight = np.array((0.0, 0.0, -9.81 * TWISTED.linear_density))
    assert grip_force(shape) + weight == pytest.approx(np.zeros(3), abs=1e-6)
    at = np.searchsorted(shape.arc_length, (0.0, one.arc_length, two.arc_length, 1.0 + 1e-9))
    for i, j in pairwise(at):
        assert integrated_residual(TWISTED, piece(shape, i, j), weight) < 1e-4
    for contact, k in ((one, at[1]), (two, at[2])):
        jump = shape.force[k - 1] - shape.force[k] - weight * shape.arc_length[1]
        assert jump == pytest.approx(contact.force * contact.normal, abs=1e-5)
        assert shape.moment[k - 1] == pytest.approx(shape.moment[k], abs=5e-4)


def test_a_twisted_cable_whose_ends_come_nearer_snaps_onto_itself():
    """At first it bows, and slides from there until its strands meet, far from any equilibrium on the way."""
    cable = cs.Cable(0.95, 0.06, 0.0023, 0.002, diameter=0.0097)
    cycle = cs.Cycle(cable, scene=SOLVE, model="cosserat")
    shapes, mu = [], []
    for k, x in enumerate(np.linspace(0.0, 1.0, 30)):
        end = posed((0.95 * (0.8 - 0.5 * x), 0, 0), Rotation.from_rotvec((3.0 * math.pi * x, 0, 0)))
        report = cycle.step({"cable": (posed((0, 0, 0)), end)}, stamp=10_000_000 * k)
        shapes.append(report.shapes["cable"])
        mu += [m.value for m in report.margins["cable"] if m.kind is cs.WarningKind.STABILITY]
    assert len(mu) == 30  # on itself, too
    assert min(mu) > 0.0
    assert all(shape.usable for shape in shapes)
    assert [shape.status for shape in shapes].count(cs.Status.SNAPPED) == 1
    snapped = next(shape for shape in shapes if shape.status is cs.Status.SNAPPED)
    assert [contact.body for contact in snapped.contacts] == ["itself", "itself"]
    assert [len(shape.contacts) for shape in shapes[: shapes.index(snapped)]] == [0] * shapes.index(snapped)


def piece(shape, i, j):
    """Some of a shape's points as a shape."""
    arrays = (shape.arc_length, shape.positions, shape.quaternions, shape.curvature, shape.force, shape.moment)
    buffer = np.concatenate([array[i:j].ravel() for array in arrays])
    return cs.CableShape(buffer, j - i, length=shape.length, model=shape.model, status=shape.status)


def test_without_contact_the_strands_pass_through_each_other():
    cycle = cs.Cycle(TWISTED, model="cosserat")
    nearest = [
        body.distance for report in looped(cycle) for body in report.clearance["cable"].bodies if body.body == "itself"
    ]
    assert min(nearest) < -0.5 * TWISTED.diameter


def test_a_predictor_by_itself_keeps_its_cable_out_of_itself():
    predictor = cs.Predictor(TWISTED, scene=SOLVE)
    for turns in np.arange(0.3, 1.2, 0.01):
        shape = predictor.predict(
            posed((0, 0, 0)), posed((0.3, 0, 0), Rotation.from_rotvec((2.0 * math.pi * turns, 0, 0)))
        )
        assert shape.status is cs.Status.OK
    assert len(shape.contacts) == 2
    assert predictor.touching
    assert predictor.sensitivity().shape == (150, 3, 12)
    predictor.reset()
    assert not predictor.touching


def test_closed_forms_know_no_contact_between_cables():
    with pytest.raises(cs.ArgumentError, match="knows no contact with other cables"):
        cs.Cycle({"a": HEAVY, "b": HEAVY}, scene=SOLVE, model="catenary")


def test_a_cable_dragged_off_another_is_told_to_have_snapped():
    cycle = cs.Cycle({"under": HEAVY, "over": HEAVY}, scene=SOLVE, model="cosserat")
    seen = []
    for k in range(120):
        height, aside = max(-0.02, 0.02 - 0.002 * k), 0.02 + 0.004 * max(0, k - 20)
        report = cycle.step({"under": across(0.0, 0.5, 0.0), "over": across(70.0, 0.5, height, (aside, 0.0))}, stamp=k)
        seen.append({shape.status for shape in report.shapes.values()})
    assert seen.count({cs.Status.SNAPPED}) == 1
    assert all(status in ({cs.Status.OK}, {cs.Status.SNAPPED}) for status in seen)
    assert not report.shapes["over"].contacts


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])  # the smaller one needs a finer mesh
def test_two_contacts_of_three_cables(tolerance):
    cycle = cs.Cycle(dict.fromkeys("abc", HEAVY), scene=SOLVE, model="cosserat", tolerance=tolerance)
    for k, height in enumerate(np.linspace(0.02, -0.03, 51)):
        low, high = across(80.0, 0.5, height, (0.01, 0.0)), across(40.0, 0.5, 2.0 * height + 0.01, (0.05, 0.03))
        report = cycle.step({"a": across(0.0, 0.5, 0.0), "b": low, "c": high}, stamp=k)
        assert all(report.shapes[name].status for name in "abc")
    assert [sorted(c.body for c in report.shapes[name].contacts) for name in "abc"] == [["b"], ["a", "c"], ["b"]]
    weight = np.array((0.0, 0.0, -9.81 * HEAVY.linear_density * HEAVY.length))
    for shape in report.shapes.values():
        pushed = sum(c.force * c.normal for c in shape.contacts)
        assert grip_force(shape) + weight + pushed == pytest.approx(np.zeros(3), abs=1e-5)
    assert all(b.distance > -2e-4 for c in report.clearance.values() for b in c.bodies)


def test_a_cable_without_a_shape_leaves_those_in_contact_not_usable():
    cycle = cs.Cycle(dict.fromkeys(("under", "over", "far"), HEAVY), scene=SOLVE, model="cosserat")

    def step(height, chord, k):
        far = across(0.0, chord, 0.0, (0.0, 0.5))
        over = across(70.0, 0.5, height, (0.02, 0.01))
        return cycle.step({"under": across(0.0, 0.5, 0.0), "over": over, "far": far}, k)

    for k, height in enumerate(DOWN[:31]):
        report = step(height, 0.5, k)
    assert report.shapes["over"].contacts
    lost = step(DOWN[30], 0.61, 100).shapes
    assert lost["far"].status is cs.Status.OVERSTRETCHED
    assert lost["over"].status is lost["under"].status is cs.Status.NOT_CONVERGED


def test_derivatives_in_contact_are_those_of_differences():
    """By the poses of the cable's own ends and of its clips, the other cable's standing still."""
    clip = cs.Clip(0.12, cs.Pose((-0.14, 0.0, -0.03)))
    size = 1e-4

    def held(step, axis, sign):
        """Both cables' ends, one of those of `over` moved or turned a little about the world's axes."""
        ends = {"under": across(0.0, 0.5, 0.0), "over": across(70.0, 0.5, -0.03, (0.02, 0.01))}
        if step is not None:
            pose, unit = ends["over"][step], sign * size * np.eye(3)[axis % 3]
            turn = Rotation.from_rotvec(unit if axis > 2 else np.zeros(3)) * Rotation.from_quat(pose.quaternion)
            moved = cs.Pose(pose.position + (unit if axis < 3 else 0.0), turn.as_quat())
            ends["over"] = (moved, ends["over"][1]) if step == 0 else (ends["over"][0], moved)
        return ends

    cycle = cs.Cycle({"under": HEAVY, "over": HEAVY}, scene=SOLVE, clips={"under": [clip]}, model="cosserat")
    for k, height in enumerate(np.linspace(0.02, -0.03, 26)):
        grips = held(None, 0, 0)
        grips["over"] = across(70.0, 0.5, height, (0.02, 0.01))
        cycle.step(grips, stamp=10_000_000 * k)
    predictor = cycle._cables["over"].predictor
    assert predictor.touching
    told = predictor.sensitivity(("start", "end"))
    under = cycle._cables["under"].predictor.sensitivity(("clip:clip0",))
    assert under.shape == (150, 3, 6)
    assert np.abs(under[:, :, :3]).max() > 0.5
    stamp = 1_000_000_000
    for step in (0, 1):
        for axis in range(6):
            seen = []
            for sign in (1.0, -1.0):
                stamp += 10_000_000
                report = cycle.step(held(step, axis, sign), stamp=stamp)
                seen.append(report.shapes["over"].positions)
            column = (seen[0] - seen[1]) / (2.0 * size)
            assert told[:, :, 6 * step + axis] == pytest.approx(column, abs=1e-2 * max(1.0, np.abs(column).max()))
    assert under.shape == (150, 3, 6)


def laid_on(cable, shift=(0.0, 0.0, 0.0), **options):
    """A cycle in which this cable was let down onto one like HEAVY, its start shifted a little at last."""
    cycle = cs.Cycle({"under": HEAVY, "over": cable}, scene=SOLVE, model="cosserat", tolerance=1e-6, **options)
    for k, height in enumerate((*np.linspace(0.02, -0.03, 26), -0.03)):
        start, end = across(70.0, 0.5, height, (0.02, 0.01))
        if k == 26:
            start = cs.Pose(start.position + shift, start.quaternion)
        report = cycle.step({"under": across(0.0, 0.5, 0.0), "over": (start, end)}, 1_000_000_000 * k)
    assert len(report.shapes["over"].contacts) == 1
    return cycle, report


@pytest.mark.parametrize("name", ["length", "linear_density", "bending_stiffness", "twisting_stiffness"])
def test_derivatives_by_numbers_are_those_of_differences(name):
    """Of a cable on another one, which stays what it is."""
    told = laid_on(HEAVY)[0]._cables["over"].predictor.sensitivity((name,))[:, :, 0]
    step, number = 1e-3, np.mean(getattr(HEAVY, name))
    cables = [HEAVY.replace(**{name: (1.0 + sign * step) * number}) for sign in (1.0, -1.0)]
    above, below = (laid_on(cable)[1].shapes["over"].positions for cable in cables)
    column = (above - below) / (2.0 * step * number)
    assert told == pytest.approx(column, abs=1e-2 * np.abs(column).max())


def test_each_has_a_tube():
    """That of its own length and start, the other cable as it is."""
    off = 1e-3
    known = cs.Uncertainty({"length": off}, start=(off, 0.0))
    report = laid_on(HEAVY, uncertainty=known)[1]
    assert set(report.tubes) == {"under", "over"}
    pairs = [[laid_on(HEAVY.replace(length=HEAVY.length + sign * off)) for sign in (1.0, -1.0)]]
    pairs += [[laid_on(HEAVY, sign * shift) for sign in (1.0, -1.0)] for shift in off * np.eye(3)]
    ways = [0.5 * np.subtract(*(report.shapes["over"].positions for _, report in pair)) for pair in pairs]
    expected = sum(way[:, :, None] * way[:, None, :] for way in ways)
    assert report.tubes["over"].covariance == pytest.approx(expected, abs=0.05 * np.abs(expected).max())


def test_a_cable_on_itself_has_a_tube():
    def wound(cable, **options):
        cycle = cs.Cycle(cable, scene=SOLVE, model="cosserat", tolerance=1e-6, quasistatic_limit=0.0, **options)
        return list(looped(cycle, last=1.1))[-1]

    off = 1e-4
    report = wound(TWISTED, uncertainty=cs.Uncertainty({"length": off}))
    assert len(report.shapes["cable"].contacts) == 2
    lengths = TWISTED.length + off, TWISTED.length - off
    way = 0.5 * np.subtract(*(wound(TWISTED.replace(length=x)).shapes["cable"].positions for x in lengths))
    expected = way[:, :, None] * way[:, None, :]
    assert report.tubes["cable"].covariance == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_a_cable_that_slides_to_the_mouth_of_a_grip_is_held_there_until_it_slips_off():
    half = math.sqrt(0.5)
    across = (-half, 0.0, 0.0, half)
    lower, upper = cs.Cable(0.8, 0.05, 5e-3, diameter=0.008), cs.Cable(0.9, 0.08, 5e-3, diameter=0.006)
    cycle = cs.Cycle({"lower": lower, "upper": upper}, scene=cs.Scene(contact="solve"), model="cosserat", points=400)
    held = cs.Pose((0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.5)), cs.Pose((0.7, 0.0, 0.0), (0.5, 0.5, 0.5, 0.5))
    way = [(0.02, z) for z in np.linspace(0.3, 0.23, 15)] + [(x, 0.23) for x in np.linspace(0.02, -0.16, 91)]
    nearest, slipped = [], False
    for k, (x, z) in enumerate(way):
        ends = tuple(cs.Pose((x, y, z), across) for y in (-0.35, 0.35))
        shapes = cycle.step({"lower": held, "upper": ends}, stamp=k * 10_000_000).shapes
        assert all(shape.usable for shape in shapes.values()), (x, z)
        if shapes["lower"].contacts:
            assert not slipped
            (own,), (other,) = shapes["lower"].contacts, shapes["upper"].contacts
            assert own.force == pytest.approx(other.force, rel=1e-9)
            assert other.arc_length == pytest.approx(0.45, abs=0.002)
            nearest.append(own.arc_length)
        slipped = bool(nearest) and not shapes["lower"].contacts
    assert nearest[10:] == sorted(nearest[10:], reverse=True)
    assert 0.0005 < nearest[-1] < 0.006
    assert slipped
    below = shapes["upper"].positions[200]
    assert below[2] < -0.02
    assert below[0] < -0.1
