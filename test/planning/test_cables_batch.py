"""predict_batch of several cables: every row a scene of all of them, as a cycle finds it from nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.planning.cables_batch import CablesBatch
from cable_shape.safety.report import LOAD_MARGINS, WarningKind

CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.01, diameter=0.008, max_tension=5.0)
CABLES = {"under": CABLE, "over": CABLE.replace(linear_density=0.08, diameter=0.01)}
POST = cs.Obstacle("post", cs.Sphere(0.05), cs.Pose((0.0, 0.1, -0.3)))
SOLVED = cs.Scene(obstacles=[POST], contact="solve", warn_distance=0.05)
TOLERANCE = 1e-6
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
G = np.array((0.0, 0.0, -9.81))
Ends = tuple[np.ndarray, Any]


def pair(heading: float, height: float, chord: float = 0.7, aside: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Poses (7,) of two grips about a place on the z axis, or beside it along y."""
    turn = Rotation.from_euler("z", heading, degrees=True)
    half = turn.apply((0.5 * chord, 0.0, 0.0))
    q, middle = (turn * ALONG_X).as_quat(), np.array((0.02, 0.01 + aside, height))
    return np.concatenate((middle - half, q)), np.concatenate((middle + half, q))


def tables(heights: np.ndarray) -> dict[str, Ends]:
    """The one is held across the other, at these heights above it."""
    over = [pair(70.0, height) for height in heights]
    under = [pair(0.0, 0.0)] * len(heights)
    return {name: (np.array([a for a, _ in rows]), np.array([b for _, b in rows]))
            for name, rows in (("under", under), ("over", over))}  # fmt: skip


HEIGHTS = np.linspace(0.05, -0.05, 21)
GIVEN = tables(HEIGHTS)


def pose(row: np.ndarray) -> cs.Pose:
    return cs.Pose(row[:3], row[3:])


def grips(given: dict[str, Ends], row: int) -> dict[str, Any]:
    """The ends of a row, for a cycle."""
    return {name: tuple(pose(table[row]) for table in both) for name, both in given.items()}


def batch_of(given: dict[str, Any], **options: Any) -> CablesBatch:
    keywords = {"scene": SOLVED, "model": "cosserat", "tolerance": TOLERANCE, **options}
    found = cs.predict_batch(CABLES, given, **keywords)
    assert isinstance(found, CablesBatch)
    return found


def touches(batch: CablesBatch) -> list[int]:
    """Rows in which the cables touch each other."""
    return [row for row in range(len(batch)) if any(c.body == "over" for c in batch[row]["under"].contacts)]


def test_every_row_is_the_first_step_of_a_cycle_and_judged_as_there() -> None:
    batch = batch_of(GIVEN)
    assert batch.done.all()
    assert batch.usable.all()
    assert 2 <= len(touches(batch)) < len(HEIGHTS) // 2
    for row in range(len(batch)):
        report = cs.Cycle(CABLES, scene=SOLVED, model="cosserat", tolerance=TOLERANCE).step(grips(GIVEN, row), 0)
        for name, alone in report.shapes.items():
            shape, own = batch[row][name], batch.cables[name]
            assert shape.status is alone.status
            np.testing.assert_allclose(shape.positions, alone.positions, atol=2.0 * TOLERANCE)
            assert len(shape.contacts) == len(alone.contacts)
            for one, other in zip(shape.contacts, alone.contacts, strict=True):
                assert one.body == other.body
                assert one.force == pytest.approx(other.force, rel=1e-4)
            near = {body.body: body.distance for body in report.clearance[name].bodies}
            for column, body in enumerate(own.bodies):
                told = own.distances[row, column]
                assert told == pytest.approx(near.get(body, math.inf), abs=5.0 * TOLERANCE)
            used = {(m.kind, m.other): m.used for m in report.margins[name]}
            tension = own.used[row, LOAD_MARGINS.index(WarningKind.TENSION)]
            assert tension == pytest.approx(used[WarningKind.TENSION, ""], rel=1e-3)
            stability = own.used[row, LOAD_MARGINS.index(WarningKind.STABILITY)]
            assert stability == pytest.approx(used[WarningKind.STABILITY, ""], rel=1e-3)
            for column, body in enumerate(own.bodies):
                told = own.used[row, len(LOAD_MARGINS) + column]
                assert told == pytest.approx(used.get((WarningKind.CLEARANCE, body), math.nan), abs=1e-3, nan_ok=True)
    assert batch.cables["under"].bodies == ("post", "over", "itself")
    assert batch.clearance.min() < 2e-5 < batch.clearance[0]
    assert batch.worst.max() == pytest.approx(2.0, abs=1e-3)


def test_forces_balance_where_cables_touch() -> None:
    """Each carries its weight with what grips and contacts do, and what one does to the other is what it gets back."""
    batch = batch_of(GIVEN)
    for row in touches(batch):
        shapes, between = batch[row], []
        for name, shape in shapes.items():
            pushes = sum((contact.force * contact.normal for contact in shape.contacts), np.zeros(3))
            weight = CABLES[name].linear_density * CABLES[name].length * G
            left = shape.force[-1] - shape.force[0] + pushes + weight
            assert np.abs(left).max() < 1e-5 * float(np.linalg.norm(weight))
            between.append(sum(c.force * c.normal for c in shape.contacts if c.body in CABLES))
        assert np.linalg.norm(between[0]) > 0.01
        np.testing.assert_allclose(between[0], -between[1], atol=1e-9)


def test_no_bit_of_a_row_depends_on_others_or_on_the_threads() -> None:
    whole = batch_of(GIVEN, threads=1)
    order = np.random.default_rng(1).permutation(len(HEIGHTS))[:12]
    assert set(order) & set(touches(whole))
    some = batch_of({name: (a[order], b[order]) for name, (a, b) in GIVEN.items()}, threads=2)
    for name, own in whole.cables.items():
        np.testing.assert_array_equal(some.cables[name].buffer, own.buffer[order])
        np.testing.assert_array_equal(some.cables[name].tables, own.tables[order])
        np.testing.assert_array_equal(some.cables[name].margin_rows, own.margin_rows[order])


def test_rows_that_nothing_touches_are_solved_by_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, together = batch_of(GIVEN), list[int]()
    pressed = [row for row in range(len(whole)) if any(len(shape.contacts) for shape in whole[row].values())]
    monkeypatch.setattr(
        "cable_shape.planning.cables_batch._Work._solve_together", lambda work, row: together.append(row)
    )
    found = batch_of(GIVEN)
    assert together == pressed
    assert np.flatnonzero(~found.done).tolist() == pressed
    assert found.partial


def test_without_contact_solved_for_cables_are_what_each_is_alone() -> None:
    scene = cs.Scene(obstacles=[POST], warn_distance=0.05)
    batch = batch_of(GIVEN, scene=scene)
    for name, (starts, ends) in GIVEN.items():
        alone = cs.predict_batch(CABLES[name], starts, ends, scene=scene, model="cosserat", tolerance=TOLERANCE)
        np.testing.assert_array_equal(batch.positions[name], alone.positions)
        np.testing.assert_array_equal(batch.distances[name][:, :1], alone.distances)
        assert batch.cables[name].several.tolist() == alone.several.tolist()
    assert batch.distances["under"][:, 1].min() < -1e-3  # they overlap, and it is told
    np.testing.assert_array_equal(batch.distances["under"][:, 1], batch.distances["over"][:, 1])


def test_tubes_are_those_of_a_cycle() -> None:
    known = {"over": cs.Uncertainty({"length": 1e-3}, start=(1e-3, 1e-3))}
    batch = batch_of(GIVEN, uncertainty=known)
    assert batch.radius["under"] is None
    assert batch.radius["over"] is not None
    free = next(row for row in range(len(HEIGHTS)) if row not in touches(batch))
    for row in (free, *touches(batch)):
        cycle = cs.Cycle(
            CABLES, scene=SOLVED, model="cosserat", tolerance=TOLERANCE, uncertainty=known, quasistatic_limit=0.0
        )
        report = cycle.step(grips(GIVEN, row), 0)
        np.testing.assert_allclose(batch.radius["over"][row], report.tubes["over"].radius, rtol=0.02, atol=1e-6)
        for name, own in batch.cables.items():
            near = {body.body: body.distance for body in report.clearance[name].bodies}
            for column, body in enumerate(own.bodies):
                told = own.distances[row, column]
                assert told == pytest.approx(near.get(body, math.inf), rel=0.02, abs=1e-4)


def test_kinds_free_ends_clips_and_loads_are_those_of_each_cable() -> None:
    starts, ends = GIVEN["over"]
    clip = cs.Clip(0.5, cs.Pose((0.02, 0.01, -0.25), ALONG_X.as_quat()), kind="ball")
    options: dict[str, Any] = {
        "clips": {"under": [clip]},
        "distributed_load": {"over": ((0.0, 0.0, -0.1), (0.0, 0.0, -0.1))},
    }
    moves = {"over": (0.0, 0.5, 0.0)}
    given = {"under": GIVEN["under"], "over": (starts, cs.FreeEnd(mass=0.01))}
    batch = batch_of(given, kinds={"under.end": "swivel"}, acceleration=moves, **options)
    for row in (0, 10):
        cycle = cs.Cycle(CABLES, scene=SOLVED, model="cosserat", tolerance=TOLERANCE, **options)
        (a, b), start = grips(GIVEN, row)["under"], pose(starts[row])
        held = {"under": (a, cs.Grip(b, "swivel")), "over": (start, cs.FreeEnd(mass=0.01))}
        report = cycle.step(held, 0, acceleration=moves)
        for name, alone in report.shapes.items():
            assert alone.status is cs.Status.OK
            np.testing.assert_allclose(batch[row][name].positions, alone.positions, atol=3.0 * TOLERANCE)
    assert batch[0]["under"].clips[0].arc_length == 0.5
    assert len(ends) == len(batch)


def test_a_row_that_is_not_valid_fails_alone_and_with_its_index() -> None:
    given = {name: (a[:3].copy(), b[:3].copy()) for name, (a, b) in GIVEN.items()}
    given["over"][1][1, 0] = math.nan
    batch = batch_of(given)
    assert list(batch.errors) == [1]
    assert "over.end[1]: position" in str(batch.errors[1])
    assert batch.done.tolist() == [True, False, True]
    assert not batch.partial
    for name in CABLES:
        assert batch[1][name].status is cs.Status.NOT_CONVERGED
        assert np.isnan(batch.positions[name][1]).all()
        assert list(batch.cables[name].errors) == [1]
    assert "2 OK, 1 not done" in repr(batch)


def test_what_is_done_by_the_time_limit_is_returned() -> None:
    batch = batch_of(GIVEN, time_limit=1e-6)
    assert batch.partial
    assert not batch.done.any()
    assert np.isnan(batch.positions["over"]).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"starts": {"under": GIVEN["under"]}}, r"starts = \['under'\].*'over' is missing.*Write"),
        ({"starts": {**GIVEN, "ovr": GIVEN["over"]}}, r"ovr.*over"),
        ({"starts": {**GIVEN, "over": (GIVEN["over"][0][:3], GIVEN["over"][1][:3])}}, "as many rows.*Give a pose"),
        ({"starts": {**GIVEN, "over": GIVEN["over"][0]}}, r"starts\['over'\].*\(starts, ends\).*Write"),
        ({"starts": None}, "starts = None.*Write"),
        ({"ends": GIVEN["over"][1]}, r"ends = 'given'.*one mapping.*Write"),
        ({"start_kind": "swivel"}, r"start_kind.*of one cable.*kinds=\{'a.start'"),
        ({"kinds": {"over.middle": "swivel"}}, "over.middle"),
        ({"kinds": {"over.end": "glued"}}, r"kinds\['over.end'\].*glued"),
        ({"clips": {"top": []}}, "top"),
        ({"uncertainty": {"top": cs.Uncertainty({"length": 1e-3})}}, "top"),
        ({"acceleration": {"over": (1.0, 2.0)}}, r"acceleration\['over'\]|cable 'over'.*acceleration"),
        ({"model": "catenary"}, "cable 'under'.*catenary|knows no contact"),
        ({"points": 10**6}, "points"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"starts": GIVEN, "scene": SOLVED, **changes}
    with pytest.raises((ArgumentError, UnknownKeyError), match=words):
        cs.predict_batch(CABLES, given.pop("starts"), **given)


def test_what_is_of_several_cables_is_refused_of_one() -> None:
    starts, ends = GIVEN["over"]
    with pytest.raises(ArgumentError, match=r"clips.*scene"):
        cs.predict_batch(CABLE, starts, ends, clips={"over": []})
    with pytest.raises(ArgumentError, match=r"uncertainty.*one cable"):
        cs.predict_batch(CABLE, starts, ends, uncertainty={"over": cs.Uncertainty({"length": 1e-3})})
    with pytest.raises(ArgumentError, match="at least one"):
        cs.predict_batch({}, {})
