"""predict_batch of cables and harnesses: every row a scene of all of them, as a cycle finds it from nothing."""

from __future__ import annotations

import math
from typing import Any

import forks
import numpy as np
import pytest
from forks import HELD, forked, posed
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.planning.cables_batch import CablesBatch
from cable_shape.safety.report import LOAD_MARGINS, WarningKind

CABLE = forks.CABLE.replace(max_tension=5.0)
TABLE = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25)))
SOLVED = cs.Scene(obstacles=[TABLE], contact="solve", warn_distance=0.05)
TOLERANCE = 1e-6
FORK = forked(CABLE)
ARM = FORK.segments["l"]
PARTS: dict[str, Any] = {"c": CABLE, "h": FORK}
HEIGHTS = (0.25, 0.12, 0.18, 0.11)


def tables(heights: Any = HEIGHTS) -> dict[str, Any]:
    """A cable is held across both arms of a fork, at these heights."""
    across = tuple(np.array([posed((0.25, y, z), 90.0) for z in heights]) for y in (-0.45, 0.45))
    return {"c": across, "h": {end: np.tile(row, (len(heights), 1)) for end, row in HELD.items()}}


def pose(row: np.ndarray) -> cs.Pose:
    return cs.Pose(row[:3], row[3:])


def grips(given: dict[str, Any], row: int) -> dict[str, Any]:
    start, end = given["c"]
    return {"c": (pose(start[row]), pose(end[row])), "h": {name: pose(t[row]) for name, t in given["h"].items()}}


def batch_of(given: dict[str, Any], **options: Any) -> CablesBatch:
    found = cs.predict_batch(PARTS, given, **{"scene": SOLVED, "tolerance": TOLERANCE, "points": 80, **options})
    assert isinstance(found, CablesBatch)
    return found


def cycle_of(**options: Any) -> cs.Cycle:
    return cs.Cycle(PARTS, **{"scene": SOLVED, "tolerance": TOLERANCE, "points": 80, **options})


def strands(shapes: dict[str, Any]) -> dict[str, cs.CableShape]:
    return {"c": shapes["c"], **{f"h/{name}": one for name, one in shapes["h"].segments.items()}}


def touching(batch: CablesBatch) -> list[int]:
    """Rows in which the cable lies on the harness."""
    return [row for row in range(len(batch)) if any(c.body.startswith("h/") for c in batch[row]["c"].contacts)]


def test_every_row_is_the_first_step_of_a_cycle_and_judged_as_there() -> None:
    given = tables()
    batch = batch_of(given)
    assert batch.usable.all(), batch.details
    assert touching(batch) == [1, 3]
    stability = LOAD_MARGINS.index(WarningKind.STABILITY)
    for row in range(len(batch)):
        report = cycle_of().step(grips(given, row), 0)
        found, alone = strands(batch[row]), strands(report.shapes)
        assert isinstance(batch[row]["h"], cs.HarnessShape)
        for name, one in alone.items():
            shape, own = found[name], batch.cables[name]
            assert shape.status is one.status is cs.Status.OK
            np.testing.assert_allclose(shape.positions, one.positions, atol=2.0 * TOLERANCE)
            np.testing.assert_array_equal(batch.positions[name][row], shape.positions)
            assert [contact.body for contact in shape.contacts] == [contact.body for contact in one.contacts]
            for contact, other in zip(shape.contacts, one.contacts, strict=True):
                assert contact.force == pytest.approx(other.force, rel=1e-4)
            near = {body.body: body.distance for body in report.clearance[name].bodies}
            used = {(m.kind, m.other): m.used for m in report.margins[name]}
            for column, body in enumerate(own.bodies):
                told = own.distances[row, column]
                assert told == pytest.approx(near.get(body, math.inf), abs=5.0 * TOLERANCE)
                told = own.used[row, len(LOAD_MARGINS) + column]
                assert told == pytest.approx(used.get((WarningKind.CLEARANCE, body), math.nan), abs=1e-3, nan_ok=True)
            for kind in (WarningKind.TENSION, WarningKind.STABILITY):
                told = own.used[row, LOAD_MARGINS.index(kind)]
                assert told == pytest.approx(used.get((kind, ""), math.nan), rel=1e-3, nan_ok=True)
        assert sum(np.isfinite(batch.used[name][row, stability]) for name in alone if name != "c") == 1
    assert batch.cables["h/l"].bodies == ("table", "c", "h/stem", "h/r", "itself")
    assert batch.harnesses["h"].segments["l"] is batch.cables["h/l"]
    np.testing.assert_array_equal(batch.harnesses["h"].positions["l"], batch.positions["h/l"])
    assert batch.clearance[0] > 0.05
    assert batch.clearance[touching(batch)].max() < 2e-5


def test_rows_in_which_nothing_touches_are_not_solved_together(monkeypatch: pytest.MonkeyPatch) -> None:
    together = list[int]()
    monkeypatch.setattr(
        "cable_shape.planning.cables_batch._Work._solve_together", lambda work, row: together.append(row)
    )
    found = batch_of(tables())
    assert together == [1, 3]
    assert np.flatnonzero(~found.done).tolist() == together
    assert found.partial
    assert found.harnesses["h"].partial
    assert found[1]["h"].status is cs.Status.NOT_CONVERGED
    assert np.isnan(found.harnesses["h"].buffer[1]).all()


def test_no_bit_of_a_row_depends_on_others_or_on_the_threads() -> None:
    known = {"h": cs.Uncertainty({"length:l": 1e-3})}
    whole, order = batch_of(tables(), threads=1, uncertainty=known), [3, 0, 1]
    some = batch_of(tables([HEIGHTS[row] for row in order]), threads=2, uncertainty=known)
    for name, own in whole.cables.items():
        np.testing.assert_array_equal(some.cables[name].buffer, own.buffer[order])
        np.testing.assert_array_equal(some.cables[name].tables, own.tables[order])
        np.testing.assert_array_equal(some.cables[name].margin_rows, own.margin_rows[order])
        far = np.isinf(own.distances)
        assert far.any()
        assert np.isnan(own.tables[far, 1:]).all()
    np.testing.assert_array_equal(some.harnesses["h"].energy, whole.harnesses["h"].energy[order])


def test_tubes_are_those_of_a_cycle() -> None:
    known = {"c": cs.Uncertainty({}, start=(1e-3, 1e-3)), "h": cs.Uncertainty({"length:l": 1e-3}, end=(1e-3, 1e-3))}
    given = tables()
    batch = batch_of(given, uncertainty=known)
    assert touching(batch) == [1, 3]
    for row in range(len(batch)):
        report = cycle_of(uncertainty=known, quasistatic_limit=0.0).step(grips(given, row), 0)
        for name, tube in report.tubes.items():
            radius = batch.radius[name]
            assert radius is not None
            np.testing.assert_allclose(radius[row], tube.radius, rtol=0.02, atol=1e-6)
            assert radius[row].max() > 1e-4
            near = {body.body: body.distance for body in report.clearance[name].bodies}
            for column, body in enumerate(batch.cables[name].bodies):
                told = batch.distances[name][row, column]
                assert told == pytest.approx(near.get(body, math.inf), rel=0.02, abs=1e-4)
            assert batch.cables[name].clearance_of(row).confidence == 0.95


def test_without_contact_solved_for_each_is_what_it_is_alone() -> None:
    scene, given = cs.Scene(obstacles=[TABLE], warn_distance=0.05), tables((0.25, 0.11, 0.09))
    known = cs.Uncertainty({"bending_stiffness": 0.1}, start=(1e-3, 1e-3))
    options: dict[str, Any] = {"scene": scene, "tolerance": TOLERANCE, "points": 80, "uncertainty": known}
    batch = batch_of(given, scene=scene, uncertainty=known)
    cable = cs.predict_batch(CABLE, *given["c"], **options)
    harness = cs.predict_batch(FORK, given["h"], **options)
    np.testing.assert_array_equal(batch.cables["c"].buffer, cable.buffer)
    np.testing.assert_array_equal(batch.harnesses["h"].buffer, harness.buffer)
    np.testing.assert_array_equal(batch.harnesses["h"].energy, harness.energy)
    for name, own in {"c": cable, **{f"h/{name}": one for name, one in harness.segments.items()}}.items():
        np.testing.assert_array_equal(batch.radius[name], own.radius)
        np.testing.assert_array_equal(batch.distances[name][:, :1], own.distances)
        np.testing.assert_array_equal(batch.used[name][:, : len(LOAD_MARGINS) + 1], own.used)
    assert batch.distances["c"][1, batch.cables["c"].bodies.index("h/l")] < -1e-3  # they overlap, and it is told


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_segments_of_one_harness_that_do_not_meet_are_checked_against_each_other(contact: str) -> None:
    bend = cs.Pose(quaternion=Rotation.from_euler("x", 90.0, degrees=True).as_quat())
    joints = [
        cs.Junction("one", ("a.end", "b.start"), frames={"b.start": bend}),
        cs.Junction("other", ("b.end", "c.start"), frames={"c.start": bend}),
    ]
    harness = cs.Harness({"a": ARM, "b": ARM.replace(length=0.05), "c": ARM}, joints)
    scene = cs.Scene(contact=contact, warn_distance=0.05)
    ends = {"a.start": posed((0.0, 0.0, 0.0))[None], "c.end": posed((0.0, 0.04, 0.02), 180.0)[None]}
    batch = cs.predict_batch({"h": harness}, {"h": ends}, scene=scene, tolerance=TOLERANCE, points=80)
    cycle = cs.Cycle({"h": harness}, scene=scene, tolerance=TOLERANCE, points=80)
    report = cycle.step({"h": {end: pose(table[0]) for end, table in ends.items()}}, 0)
    near = {body.body: body.distance for body in report.clearance["h/a"].bodies}
    assert batch.cables["h/a"].bodies == ("h/b", "h/c", "itself")
    assert batch.distances["h/a"][0, 1] == pytest.approx(near["h/c"], abs=5.0 * TOLERANCE)
    assert batch.distances["h/a"][0, 0] == math.inf


def test_kinds_free_ends_clips_loads_and_accelerations_are_those_of_each() -> None:
    given = tables((0.25, 0.12))
    given["h"]["stem.start"][:, 2] = 0.01
    given["h"]["r.end"] = cs.FreeEnd(mass=0.01)
    load = ((0.0, 0.02, -0.1), (0.0, 0.02, -0.1))
    clip = cs.Clip(0.25, cs.Pose((0.2, -0.09, -0.01), posed((0, 0, 0), -25.0)[3:]), kind="ball", segment="r")
    options: dict[str, Any] = {"clips": {"h": [clip]}, "distributed_load": {"h": {"l": load}}}
    moves = {"c": (0.0, 0.5, 0.0), "h": {"stem": (0.0, 0.0, 1.0)}}
    batch = batch_of(given, kinds={"c.end": "swivel", "h/l.end": "pinned"}, acceleration=moves, **options)
    assert batch.usable.all(), batch.details
    for row in range(2):
        start, end = (pose(table[row]) for table in given["c"])
        stem, left = (pose(given["h"][name][row]) for name in ("stem.start", "l.end"))
        held = {"stem.start": stem, "l.end": cs.Grip(left, "pinned"), "r.end": cs.FreeEnd(mass=0.01)}
        ends: dict[str, Any] = {"c": (start, cs.Grip(end, "swivel")), "h": held}
        report = cycle_of(**options).step(ends, 0, acceleration=moves)
        for name, one in strands(report.shapes).items():
            assert one.status is cs.Status.OK
            np.testing.assert_allclose(batch.positions[name][row], one.positions, atol=3.0 * TOLERANCE)
    assert batch[0]["h"].segments["r"].clips[0].arc_length == 0.25
    assert batch.cables["h/r"][1].clips[0].force == pytest.approx(batch[1]["h"].segments["r"].clips[0].force)


@pytest.mark.parametrize(("end", "at"), [("l.end", "h"), ("end", "c")])
def test_a_row_that_is_not_valid_fails_alone_and_with_its_index(end: str, at: str) -> None:
    given = tables((0.25, 0.12, 0.12))
    (given["h"][end] if at == "h" else given["c"][1])[1, 0] = math.nan
    batch = batch_of(given)
    assert list(batch.errors) == [1]
    assert f"{'h/' if at == 'h' else 'c.'}{end}[1]: position" in str(batch.errors[1])
    assert batch.done.tolist() == [True, False, True]
    assert touching(batch) == [2]
    assert not batch.partial
    for name, own in batch.cables.items():
        assert np.isnan(batch.positions[name][1]).all()
        assert list(own.errors) == [1]
    assert batch.harnesses["h"].done.tolist() == [True, False, True]
    assert [batch[1][name].status for name in PARTS] == [cs.Status.NOT_CONVERGED] * 2
    assert "2 OK, 1 not done" in repr(batch)


def test_what_is_done_by_the_time_limit_is_returned() -> None:
    batch = batch_of(tables(), time_limit=1e-6)
    assert batch.partial
    assert not batch.done.any()
    assert np.isnan(batch.harnesses["h"].buffer).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"starts": {"c": tables()["c"]}}, r"starts = \['c'\].*'h' is missing.*of a harness \{end: table\}"),
        ({"starts": {**tables(), "h": tables()["c"]}}, r"starts\['h'\]: ends = .*mapping"),
        ({"starts": {**tables(), "h": {}}}, r"starts\['h'\]: .*no end is held"),
        ({"starts": {**tables(), "h": {"l.start": HELD["l.end"][None]}}}, r"starts\['h'\]: .*in junction 'j'"),
        ({"starts": {**tables(), "h": tables((0.1,))["h"]}}, "as many rows.*Give a pose"),
        ({"kinds": {"h.start": "swivel"}}, "h.start"),
        ({"kinds": {"h/l.end": "glued"}}, r"kinds\['h/l.end'\].*glued"),
        ({"uncertainty": {"h": 1.0}}, r"uncertainty\['h'\] = 1.0.*Uncertainty"),
        ({"acceleration": {"h": (0.0, 0.0, 1.0)}}, "cable 'h': .*acceleration"),
        ({"acceleration": {"h": {"m": (0.0, 0.0, 1.0)}}}, "'m'"),
        ({"model": "catenary"}, "catenary"),
        ({"slopes": True}, "slopes.*of one cable"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"starts": tables(), "scene": SOLVED, **changes}
    with pytest.raises((ArgumentError, UnknownKeyError), match=f"(?i){words}"):
        cs.predict_batch(PARTS, given.pop("starts"), **given)
