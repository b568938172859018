"""Cycles of cables that swing: the steps of `cs.Motion` by stamps, gaps, looks ahead, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(
    length=1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.02, drag=0.02, max_tension=0.8
)
MS = 1_000_000  # ns
ARM = cs.Cable(length=0.5, linear_density=0.08, bending_stiffness=0.01, retardation_time=0.02, drag=0.02)
FORK = cs.Harness({"a": ARM, "b": ARM, "c": ARM}, [cs.Junction("fork", ("a.end", "b.start", "c.start"))])


def ends(t: float) -> tuple[cs.Pose, cs.Pose]:
    """Both grips go 0.3 m sideways in 0.3 s, and stop."""
    x = min(max(t / 0.3, 0.0), 1.0)
    y = 0.3 * x * x * (3.0 - 2.0 * x)
    return cs.Pose((0.0, y, 1.0), ALONG), cs.Pose((0.7, y, 1.0), ALONG)


def fork_ends(t: float) -> dict[str, cs.Pose | cs.FreeEnd]:
    """Of FORK: both grips go as those of `ends`, at 0.8 of their distance; the third arm hangs, with a plug."""
    start, end = ends(t)
    return {"a.start": start, "b.end": end, "c.end": cs.FreeEnd(mass=0.01)}


def test_a_cycle_takes_the_steps_of_a_motion():
    cycle, motion = cs.Cycle(CABLE, motion="dynamic", points=41), cs.Motion(CABLE, points=41)
    shape = motion.begin(*ends(0.0))
    still, most = cs.Cycle(CABLE, points=41), 0.0
    for k in range(60):
        report = cycle.step({"cable": ends(0.01 * k)}, 10 * k * MS)
        if k:
            shape = motion.step(*ends(0.01 * k), 0.01)
        assert report.shapes["cable"].usable
        np.testing.assert_array_equal(report.shapes["cable"].buffer, shape.buffer)
        assert report.shapes["cable"].velocity is not None
        at_rest = still.step({"cable": ends(0.01 * k)}, 10 * k * MS)
        most = max(most, np.abs(at_rest.shapes["cable"].positions - shape.positions).max())
        kinds = {margin.kind for margin in report.margins["cable"]}
        assert cs.WarningKind.QUASISTATIC not in kinds
    assert most > 0.02  # it swings
    tension = [margin for margin in report.margins["cable"] if margin.kind is cs.WarningKind.TENSION]
    assert tension[0].value == pytest.approx((shape.force * shape.tangents).sum(axis=1).max(), rel=1e-9)


def test_a_harness_takes_the_steps_of_its_motion_and_looks_ahead():
    wall = cs.Obstacle("wall", cs.Box((2.0, 0.02, 2.0)), cs.Pose((0.35, 0.42, 0.8)))
    scene = cs.Scene(obstacles=[wall])
    cycle = cs.Cycle({"h": FORK}, scene=scene, motion="dynamic", points=41, look_ahead=0.3)
    motion = cs.Motion(FORK, points=41)
    shape, said = motion.begin(fork_ends(0.0)), []
    for k in range(40):
        if k in (33, 34, 35):  # late
            continue
        report = cycle.step({"h": fork_ends(0.01 * k)}, 10 * k * MS)
        for part in range(4 if k == 36 else min(k, 1)):
            ways = part - 3 if k == 36 else 0
            shape = motion.step(fork_ends(0.01 * (k + ways)), 0.01)
        found = report.shapes["h"]
        assert found.usable
        # the grips stand still where inputs are missing: there the straight way is the way
        np.testing.assert_allclose(found.segments["b"].buffer, shape.segments["b"].buffer, rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(found.segments["b"].velocity.shape, (41, 3))
        texts = [warning.text for warning in report.warnings]
        assert any("0.04 s" in text for text in texts) == (k == 36)
        said += [text for text in texts if "when the grips stop" in text]
        assert report.ahead.keys() == {"h/a", "h/b", "h/c"}
        assert not any(margin.kind is cs.WarningKind.QUASISTATIC for one in report.margins.values() for margin in one)
    assert said
    assert all("'wall'" in text for text in said)
    again = cycle.step({"h": fork_ends(0.39)}, 390 * MS).shapes["h"]
    assert again.reused
    cycle.reset()
    fresh = cycle.step({"h": fork_ends(0.39)}, 0).shapes["h"]
    assert np.abs(fresh.segments["c"].velocity).max() < 1e-9


@pytest.mark.parametrize("swings", [CABLE, FORK], ids=["a cable", "a harness"])
def test_what_swings_stays_out_of_bodies_and_of_links_that_move(swings: cs.Cable | cs.Harness):
    table = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.35, 0.0, 0.7)), friction=0.3)
    lift = cs.Obstacle("lift", cs.Box((0.1, 0.8, 0.1)), link="lifter")
    scene = cs.Scene(obstacles=[table], contact="solve")
    cycle = cs.Cycle({"cable": swings}, scene=scene, robot_links=[lift], motion="dynamic", points=41)
    motion = cs.Motion(swings, cs.Scene(obstacles=[table, lift], contact="solve"), points=41)

    def placed(k: int) -> dict[str, cs.Pose]:
        return {"lifter": cs.Pose((0.35, 0.0, 0.5 + 0.01 * k))}

    both, heights, touched = ends(0.0), [], set()
    held: Any = both if swings is CABLE else fork_ends(0.0)
    given = both if swings is CABLE else (held,)
    for k in range(40):
        if k in (20, 21, 22):  # missing: ends and links go the straight way meanwhile
            motion.step(*given, 0.01, placed(k))
            continue
        report = cycle.step({"cable": held}, 10 * k * MS, placed(k))
        found = report.shapes["cable"]
        shape = motion.step(*given, 0.01, placed(k)) if k else motion.begin(*given, links=placed(0))
        assert found.usable
        np.testing.assert_allclose(found.buffer, shape.buffer, rtol=0.0, atol=1e-8)
        parts = {"": found} if swings is CABLE else found.segments
        assert min(one.closest.distance for one in report.clearance.values()) > -1e-3
        heights.append(next(iter(parts.values())).positions[-1 if swings is FORK else 20, 2])
        touched |= {contact.body for one in parts.values() for contact in one.contacts}
    assert touched == {"table", "lift"}
    assert heights[-1] > heights[0] + 0.1


def test_clearance_of_cables_that_swing_is_that_to_each_other():
    scene = cs.Scene(contact="solve")
    cycle = cs.Cycle({"a": CABLE, "b": CABLE}, scene=scene, motion="dynamic", points=41)
    near, over = ends(0.0), tuple(cs.Pose((*pose.position[:2], 1.02), ALONG) for pose in ends(0.0))
    for k in range(3):
        report = cycle.step({"a": near, "b": over}, 10 * k * MS)
    assert all(shape.usable for shape in report.shapes.values())
    assert report.clearance["a"].closest.body == "b"


def test_the_same_inputs_make_the_same_swing_to_the_bit():
    rng = np.random.default_rng(3)
    stamps = np.cumsum(rng.integers(2, 40, 80)) * MS
    runs = []
    cycle = cs.Cycle(CABLE, motion="dynamic", look_ahead=0.1)
    for _ in range(2):
        cycle.reset()
        runs.append([cycle.step({"cable": ends(1e-9 * int(t))}, int(t)).shapes["cable"].buffer.copy() for t in stamps])
    np.testing.assert_array_equal(runs[0], runs[1])
    plain = cs.Cycle(CABLE, motion="dynamic")
    for t, before in zip(stamps.tolist(), runs[0], strict=True):  # a look ahead changes nothing
        np.testing.assert_array_equal(plain.step({"cable": ends(1e-9 * t)}, t).shapes["cable"].buffer, before)


def test_late_inputs_are_bridged_and_said():
    cycle, whole = (cs.Cycle(CABLE, motion="dynamic", points=41) for _ in range(2))
    for k in range(40):
        steady = whole.step({"cable": ends(0.01 * k)}, 10 * k * MS)
        if 20 <= k < 28:
            continue
        report = cycle.step({"cable": ends(0.01 * k)}, 10 * k * MS)
        texts = [warning.text for warning in report.warnings if warning.other == "input"]
        assert bool(texts) == (k == 28)
        assert not texts or "0.09 s" in texts[0]
    off = np.abs(report.shapes["cable"].positions - steady.shapes["cable"].positions).max()
    assert 0.0 < off < 0.02
    again = cycle.step({"cable": ends(0.39)}, 390 * MS)
    assert again.shapes["cable"].reused
    np.testing.assert_array_equal(again.shapes["cable"].buffer, report.shapes["cable"].buffer)
    later = cycle.step({"cable": ends(0.39)}, 3000 * MS)
    assert np.abs(later.shapes["cable"].velocity).max() < 1e-9  # it begins anew, at rest
    assert any(warning.other == "input" for warning in later.warnings)


def test_out_of_reach_and_back():
    cycle = cs.Cycle(CABLE, motion="dynamic", points=41)
    far = cs.Pose((1.3, 0.0, 1.0), ALONG)
    for k in range(10):
        cycle.step({"cable": ends(0.01 * k)}, 10 * k * MS)
    report = cycle.step({"cable": (ends(0.1)[0], far)}, 100 * MS)
    assert report.shapes["cable"].status is cs.Status.OVERSTRETCHED
    back = cycle.step({"cable": ends(0.11)}, 110 * MS).shapes["cable"]
    assert back.usable
    np.testing.assert_allclose(back.positions[-1], ends(0.11)[1].position, atol=1e-9)


def test_it_looks_ahead_where_the_cable_swings_if_the_grips_stop():
    wall = cs.Obstacle("wall", cs.Box((2.0, 0.02, 2.0)), cs.Pose((0.35, 0.4, 0.8)))
    cycle = cs.Cycle(CABLE, scene=cs.Scene(obstacles=[wall]), motion="dynamic", look_ahead=0.4)
    said = []
    for k in range(31):
        report = cycle.step({"cable": ends(0.01 * k)}, 10 * k * MS)
        said += [warning for warning in report.warnings if "when the grips stop" in warning.text]
        if said:
            break
    assert said
    assert said[0].kind is cs.WarningKind.CLEARANCE
    assert said[0].other == "wall"
    ahead = report.ahead["cable"]
    assert ahead.body is not None
    assert ahead.body.distance < 0.03 < distance(report)
    stop, nearest = ends(0.01 * k), np.inf
    for i in range(1, 41):  # and so it comes
        now = cycle.step({"cable": stop}, (10 * k + 10 * i) * MS)
        nearest = min(nearest, distance(now))
    assert nearest == pytest.approx(ahead.body.distance, abs=1e-3)


def distance(report: cs.CycleReport) -> float:
    """[m], to the nearest body, infinite if none is near."""
    closest = report.clearance["cable"].closest
    return np.inf if closest is None else closest.distance


def test_what_is_loaded_swings_under_its_load():
    load = np.array(((0.0, 0.3, -0.2), (0.0, 0.1, -0.4)))
    for cable, held, given in (
        (CABLE, {"cable": ends(0.0)}, load),
        ({"h": FORK}, {"h": fork_ends(0.0)}, {"h": {"a": load, "b": 0.5 * load}}),
    ):
        swung, still = (cs.Cycle(cable, distributed_load=given, motion=one) for one in ("dynamic", "quasistatic"))
        free = cs.Cycle(cable, motion="dynamic")
        lines = []
        for cycle in (swung, still, free):
            shape = next(iter(cycle.step(held, 0).shapes.values()))
            parts = shape.segments.values() if isinstance(shape, cs.HarnessShape) else (shape,)
            lines.append(np.concatenate([part.positions for part in parts]))
        assert np.abs(lines[0] - lines[1]).max() < 1e-4
        assert np.abs(lines[0] - lines[2]).max() > 1e-2


def test_what_does_not_go_together():
    for more, match in (
        ({"model": "catenary"}, "model"),
        ({"motion": "fast"}, "motion"),
    ):
        with pytest.raises(cs.ArgumentError, match=match):
            cs.Cycle(CABLE, **{"motion": "dynamic", **more})
    with pytest.raises(cs.ArgumentError, match="look_ahead"):
        cs.Cycle(CABLE, look_ahead=0.5)
    harness = cs.Cycle({"h": FORK}, motion="dynamic")
    with pytest.raises(cs.ArgumentError, match="inertia"):
        harness.step({"h": fork_ends(0.0)}, 0, acceleration={"h": {"a": (0.0, 0.0, 1.0)}})
    cycle = cs.Cycle(CABLE, motion="dynamic")
    with pytest.raises(cs.ArgumentError, match="inertia"):
        cycle.step({"cable": ends(0.0)}, 0, acceleration={"cable": (0.0, 0.0, 1.0)})
