"""The start grip opens: the cable hangs from its end, told from the start as ever."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
LEFT, RIGHT = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.8, 0.0, 1.0), ALONG_X)
ENDS = {"cable": (LEFT, RIGHT)}
MADE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=(0.01, 0.02), twisting_stiffness=0.015, diameter=0.008,
    rest_curvature=[(0.0, 1.0, 0.0), (0.5, 0.0, 1.0), (1.0, 0.0, 0.0)], tails={"start": 0.15},
    sections=[cs.Section(0.2, 0.4, bending_stiffness=0.05, linear_density=0.2, rest_curvature=(0.3, 0.2, 0.1))],
)  # fmt: skip
#: The same cable as somebody describes it who begins at its end: d1 as it was, d2 and d3 reversed.
OTHERWISE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=(0.01, 0.02), twisting_stiffness=0.015, diameter=0.008,
    rest_curvature=[(-1.0, 0.0, 0.0), (-0.5, 0.0, 1.0), (0.0, 1.0, 0.0)], tails={"end": 0.15},
    sections=[cs.Section(0.8, 1.0, bending_stiffness=0.05, linear_density=0.2, rest_curvature=(-0.3, 0.2, 0.1))],
)  # fmt: skip
CLIP = cs.Clip(0.9, cs.Pose((0.62, 0.0, 0.85), ALONG_X), "hinge", name="hook")
MASS = cs.PointMass(0.5, 0.02)
TABLE = cs.Obstacle("table", cs.Box((3.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, 0.6)))
SAME = 1e-5  #: m, both within the tolerance of 1e-5 of the length


def opened(cable: cs.Cable, scene: cs.Scene, ends: object, side: str, load: object = None) -> cs.Cycle:
    cycle = cs.Cycle(cable, scene=scene, distributed_load=load)  # type: ignore[arg-type]
    for stamp in (0, 1):
        assert cycle.step(ends, stamp).shapes["cable"].usable  # type: ignore[arg-type]
    result = cycle.edit(cs.Open(side))
    assert result, result.reason
    return cycle


def shape_of(cycle: cs.Cycle, stamp: int = 2, ends: object = ENDS) -> cs.CableShape:
    shape = cycle.step(ends, stamp).shapes["cable"]  # type: ignore[arg-type]
    assert shape.usable, shape.detail
    return shape


def test_it_is_the_cable_that_is_described_the_other_way_round_and_opened_at_its_end() -> None:
    load = [(0.0, 0.3, 0.0), (0.0, -0.1, 0.2)]
    one = opened(MADE, cs.Scene(clips=[CLIP], masses=[MASS]), ENDS, "start", load)
    turn = cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0))
    hook = cs.Clip(1.2 - 0.9, CLIP.pose * turn, "hinge", name="hook")
    ends = {"cable": (RIGHT * turn, LEFT * turn)}
    other = opened(OTHERWISE, cs.Scene(clips=[hook], masses=[cs.PointMass(0.7, 0.02)]), ends, "end", load[::-1])
    here, there = shape_of(one), shape_of(other, ends=ends)
    assert here.length == there.length == pytest.approx(1.35)
    assert np.abs(here.positions - there.positions[::-1]).max() < SAME
    assert here.force == pytest.approx(-there.force[::-1], abs=1e-4)
    assert here.moment == pytest.approx(-there.moment[::-1], abs=1e-4)
    assert here.energy == pytest.approx(there.energy, abs=1e-6)
    (clip,), (hooked,) = here.clips, there.clips
    assert clip.arc_length == pytest.approx(0.9 + 0.15)  # from the very start, that of the tail
    assert (clip.force, clip.moment) == (pytest.approx(hooked.force, abs=1e-4), pytest.approx(hooked.moment, abs=1e-4))
    margins = [{m.kind: m.value for m in c.step(e, 3).margins["cable"]} for c, e in ((one, ENDS), (other, ends))]  # type: ignore[arg-type]
    assert margins[0] == pytest.approx(margins[1], rel=1e-3)


def test_frames_curvature_and_balance_are_those_of_a_cable_that_hangs_from_its_end() -> None:
    cycle = opened(MADE, cs.Scene(), ENDS, "start")
    shape = shape_of(cycle)
    ds = np.diff(shape.arc_length)[:, None]
    middle = 0.5 * (shape.tangents[1:] + shape.tangents[:-1])
    assert np.abs(np.diff(shape.positions, axis=0) / ds - middle).max() < 3e-3  # bends of 16 1/m over 9 mm
    assert shape.positions[-1] == pytest.approx(RIGHT.position)
    assert abs(shape.quaternions[-1] @ RIGHT.quaternion) == pytest.approx(1.0)
    weight = 9.81 * (0.1 * 1.35 + 0.1 * 0.2)  # the section is heavier
    assert np.linalg.norm(shape.force[0]) < 1e-9
    assert np.linalg.norm(shape.moment[0]) < 1e-9
    assert shape.force[-1] == pytest.approx((0.0, 0.0, weight), abs=1e-6)
    assert cycle.layout.cables["cable"].first == pytest.approx(-0.15)
    assert cycle.layout.cables["cable"].opened == "start"


def test_it_lies_on_a_table_and_is_gripped_again_where_it_is() -> None:
    cable = MADE.replace(rest_curvature=(0.0, 0.0, 0.0), sections=())
    cycle = opened(cable, cs.Scene(obstacles=[TABLE], contact="solve"), ENDS, "start")
    lying = shape_of(cycle)
    assert len(lying.contacts) > 3
    assert lying.contacts[0].arc_length < lying.contacts[-1].arc_length
    carried = sum(contact.force for contact in lying.contacts)
    assert carried - lying.force[-1, 2] == pytest.approx(0.0, abs=cable.linear_density * 9.81 * 1.35)
    moved = {"cable": (LEFT, cs.Pose((0.8, 0.05, 0.95), ALONG_X))}
    lying = shape_of(cycle, 10_000_000, moved)
    assert cycle.edit(cs.Regrip("start", 0.0))
    k = int(np.abs(lying.arc_length - 0.15).argmin())
    at = [np.interp(0.15, lying.arc_length, x) for x in lying.positions.T]
    again = {"cable": (cs.Pose(at, lying.quaternions[k]), moved["cable"][1])}
    shape = shape_of(cycle, 20_000_000, again)
    assert shape.length == pytest.approx(1.2)
    place = np.stack([np.interp(shape.arc_length + 0.15, lying.arc_length, x) for x in lying.positions.T], axis=1)
    assert np.abs(place - shape.positions).max() < 2e-3  # its frame is that of a point up to 5 mm away


def test_margins_and_warnings_tell_arc_lengths_from_the_start() -> None:
    cable = MADE.replace(rest_curvature=(0.0, 0.0, 0.0), sections=(), min_bend_radius=0.3)
    cycle = opened(cable, cs.Scene(), ENDS, "start")
    there = shape_of(cycle).positions[40]
    post = cs.Obstacle("post", cs.Sphere(0.02), cs.Pose(there + np.array((0.0, 0.04, 0.0))))
    assert cycle.edit(cs.Add(post))
    report = cycle.step(ENDS, 3)  # type: ignore[arg-type]
    shape = report.shapes["cable"]
    told = {warning.kind.name: warning.arc_length for warning in report.warnings}
    assert told["BEND_RADIUS"] == pytest.approx(shape.arc_length[int(shape.bend_radius.argmin())], abs=0.01)
    (body,) = report.clearance["cable"].bodies
    nearest = np.linalg.norm(shape.positions - post.pose.position, axis=1).argmin()
    assert body.arc_length == pytest.approx(shape.arc_length[int(nearest)], abs=0.01)
    assert told["CLEARANCE"] == body.arc_length


def test_both_ends_are_not_opened_and_one_is_opened_once() -> None:
    cycle = opened(MADE, cs.Scene(), ENDS, "start")
    before = shape_of(cycle).buffer.tobytes()
    assert "the start is open: something must hold the cable" in cycle.edit(cs.Open("end")).reason
    assert "this end is open already" in cycle.edit(cs.Open("start")).reason
    assert shape_of(cycle, 3).buffer.tobytes() == before
    with pytest.raises(cs.ArgumentError, match="the start is open: something must hold the cable"):
        cycle.step({"cable": (LEFT, None)}, 4)
    assert cycle.step({"cable": (cs.FreeEnd(mass=0.01), RIGHT)}, 4).shapes["cable"].usable  # type: ignore[dict-item]


def test_a_tube_is_told_from_a_start_that_is_held() -> None:
    cycle = cs.Cycle(MADE, uncertainty=cs.Uncertainty({"bending_stiffness": 0.1}))
    cycle.step(ENDS, 0)  # type: ignore[arg-type]
    assert "leave its uncertainty out" in cycle.edit(cs.Open("start")).reason


def test_a_cable_that_lies_over_another_one_hangs_over_it() -> None:
    taut = cs.Cable(length=0.51, linear_density=0.05, bending_stiffness=0.02, diameter=0.008)
    along_y = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)
    low = (cs.Pose((-0.25, 0.0, 0.0), ALONG_X), cs.Pose((0.25, 0.0, 0.0), ALONG_X))
    found = {}
    for side in ("start", "end"):
        cables = {"under": taut, "over": taut.replace(length=0.52)}
        cycle = cs.Cycle(cables, scene=cs.Scene(contact="solve"), model="cosserat")
        for k in range(15):
            height = 0.004 + 0.008 * (14 - k)
            high = (cs.Pose((0.02, -0.25, height), along_y), cs.Pose((0.02, 0.25, height), along_y))
            cycle.step({"under": low, "over": high}, k)
        result = cycle.edit(cs.Open(side), cable="over")
        assert result, result.reason
        for stamp in (100, 101):
            shape = cycle.step({"under": low, "over": high}, stamp).shapes["over"]
            assert shape.status is cs.Status.OK, shape.detail
        (contact,) = shape.contacts
        assert contact.body == "under"
        assert contact.normal[2] > 0.5
        found[side] = shape, contact
    (one, here), (other, there) = found["start"], found["end"]
    assert one.positions[::-1] == pytest.approx(other.positions * (1.0, -1.0, 1.0), abs=1e-5)
    assert here.arc_length == pytest.approx(0.52 - there.arc_length, abs=1e-5)
    assert here.force == pytest.approx(there.force, rel=1e-4)


def test_a_path_goes_on_with_the_start_open() -> None:
    cable = MADE.replace(rest_curvature=(0.0, 0.0, 0.0), sections=())

    def path(*y: float) -> cs.GripPath:
        return cs.GripPath([(*LEFT.position, *ALONG_X)] * len(y), [(0.8, v, 1.0, *ALONG_X) for v in y])

    found = cs.check_trajectory(
        cable, None, None, [path(0.0, 0.05), cs.Open("start"), path(0.05, -0.1), cs.Open("end")]
    )
    assert [violation is None for violation in found.waypoints] == [True] * 4
    assert found.first is not None
    assert "something must hold the cable" in found.first.text
