"""predict_batch of a harness: the same shapes as one by one, whatever the order and the company."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.safety.report import LOAD_MARGINS, WarningKind

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=0.01, diameter=0.008, max_tension=0.2)
FORK = cs.Junction(
    "fork", ("a.end", "b.start", "c.start"), frames={"c.start": cs.Pose(quaternion=(0, 0.48, 0, 0.8773))}
)
HARNESS = cs.Harness({"a": CABLE, "b": CABLE, "c": CABLE.replace(length=0.3)}, [FORK])
SCENE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.1)))], warn_distance=0.05)
ROWS = 12


def tables(rows: int = ROWS) -> dict[str, np.ndarray]:
    """Random grasps of two ends."""
    random = np.random.default_rng(3)
    starts = np.tile((0.0, 0.0, 0.5, *ALONG), (rows, 1))
    ends = np.tile((0.8, 0.1, 0.5, *ALONG), (rows, 1))
    ends[:, :3] += random.uniform(-0.1, 0.1, (rows, 3))
    return {"a.start": starts, "b.end": ends}


def pose(row: np.ndarray) -> cs.Pose:
    return cs.Pose(row[:3], row[3:])


def test_every_row_is_the_cold_prediction_and_judged_as_in_a_cycle() -> None:
    given, plug = tables(), cs.FreeEnd(mass=0.02)
    batch = cs.predict_batch(HARNESS, {**given, "c.end": plug}, kinds={"b.end": "swivel"}, scene=SCENE, points=60)
    assert len(batch) == ROWS
    assert batch.usable.all()
    assert not batch.partial
    for row, shape in enumerate(batch):
        ends = {"a.start": pose(given["a.start"][row]), "b.end": cs.Grip(pose(given["b.end"][row]), "swivel")}
        report = cs.Cycle({"h": HARNESS}, scene=SCENE, points=60).step({"h": {**ends, "c.end": plug}}, stamp=0)
        alone = report.shapes["h"]
        assert isinstance(shape, cs.HarnessShape)
        assert shape.status is alone.status is cs.Status.OK
        for name, one in alone.segments.items():
            np.testing.assert_array_equal(shape.segments[name].buffer, one.buffer)
            np.testing.assert_array_equal(batch.positions[name][row], one.positions)
            body = next((b.distance for b in report.clearance[f"h/{name}"].bodies if b.body == "table"), math.inf)
            assert batch.distances[name][row, 0] == body
            told = {(m.kind, m.other): m.used for m in report.margins[f"h/{name}"]}
            used = batch.used[name][row]
            assert used[LOAD_MARGINS.index(WarningKind.TENSION)] == told[WarningKind.TENSION, ""]
            if body < math.inf:
                assert used[len(LOAD_MARGINS)] == told[WarningKind.CLEARANCE, "table"]
        assert batch.clearance[row] == min(batch.distances[name][row, 0] for name in HARNESS.segments)
    assert batch.worst.max() == max(np.nanmax(used) for used in batch.used.values())


def test_segments_that_leave_a_junction_beside_its_origin_have_rows() -> None:
    beside = cs.Junction("j", ("a.end", "b.start"), frames={"b.start": cs.Pose((0.0, 0.02, 0.0))})
    harness, given = cs.Harness({"a": CABLE, "b": CABLE}, [beside]), tables(2)
    batch = cs.predict_batch(harness, given, points=60)
    assert batch.usable.all()
    for row, shape in enumerate(batch):
        alone = cs.predict(harness, {end: pose(table[row]) for end, table in given.items()}, points=60)
        np.testing.assert_array_equal(shape.buffer, alone.buffer)
        np.testing.assert_array_equal(batch.positions["b"][row], alone.segments["b"].positions)


def test_beside_a_distance_beyond_the_horizon_nothing_is_told() -> None:
    given = tables(2)
    for table in given.values():
        table[1, 2] = 2.0
    batch = cs.predict_batch(HARNESS, given, points=60, scene=SCENE)
    for one in batch.segments.values():
        assert one.distances[1].tolist() == [math.inf]
        assert np.isnan(one.tables[1, 0, 1:]).all()


def test_no_bit_of_a_row_depends_on_others() -> None:
    given, known = tables(), cs.Uncertainty({"bending_stiffness": 0.1}, (0.001, 0.01), (0.002, 0.01))
    whole = cs.predict_batch(HARNESS, given, points=60, uncertainty=known)
    order = np.random.default_rng(1).permutation(ROWS)[:7]
    some = cs.predict_batch(HARNESS, {end: table[order] for end, table in given.items()}, points=60, uncertainty=known)
    np.testing.assert_array_equal(some.buffer, whole.buffer[order])
    for name, radius in some.radius.items():
        np.testing.assert_array_equal(radius, whole.radius[name][order])
        np.testing.assert_array_equal(some.used[name], whole.used[name][order])


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_rows_have_the_tubes_and_the_stability_of_a_cycle(contact: str) -> None:
    """In contact, too; the clearance is that of the tubes."""
    given, scene = tables(3), cs.Scene(obstacles=SCENE.obstacles, warn_distance=0.05, contact=contact)
    known = cs.Uncertainty({"bending_stiffness": 0.1, "length:b": 0.002}, (0.001, 0.01), (0.002, 0.01))
    heights = (1.0, 0.35, 0.2)
    for table in given.values():
        table[:, 2] = heights
    batch = cs.predict_batch(HARNESS, given, scene=scene, points=60, uncertainty=known)
    assert batch.usable.all(), batch.details
    stability, touching = LOAD_MARGINS.index(WarningKind.STABILITY), 0
    for row, shape in enumerate(batch):
        cycle = cs.Cycle({"h": HARNESS}, scene=scene, points=60, uncertainty=known, quasistatic_limit=0.0)
        report = cycle.step({"h": {end: pose(table[row]) for end, table in given.items()}}, stamp=0)
        touching += any(one.contacts for one in shape.segments.values())
        for name, radius in batch.radius.items():
            np.testing.assert_array_equal(radius[row], report.tubes[f"h/{name}"].radius)
            assert radius[row].max() > 1e-4
            body = next((b.distance for b in report.clearance[f"h/{name}"].bodies if b.body == "table"), math.inf)
            assert batch.distances[name][row, 0] == body
        told = {n: [m for m in report.margins[f"h/{n}"] if m.kind is WarningKind.STABILITY] for n in HARNESS.segments}
        (softest,) = (name for name, margins in told.items() if margins)
        assert batch.used[softest][row, stability] == pytest.approx(told[softest][0].used, rel=1e-6)
        assert all(np.isnan(batch.used[name][row, stability]) for name in HARNESS.segments if name != softest)
    assert touching == (2 if contact == "solve" else 0)


def test_a_row_without_a_shape_has_no_tube() -> None:
    given = tables(2)
    given["b.end"][1, 0] = 1.5
    batch = cs.predict_batch(HARNESS, given, points=60, uncertainty=cs.Uncertainty({"bending_stiffness": 0.1}))
    assert batch.usable.tolist() == [True, False]
    assert all(np.isfinite(radius[0]).all() and np.isnan(radius[1]).all() for radius in batch.radius.values())
    assert all(one.confidence == 0.95 for one in batch.segments.values())
    assert [batch.segments["b"].clearance_of(row).confidence for row in (0, 1)] == [0.95, 0.0]


def test_a_row_that_is_not_valid_fails_alone_and_with_its_index() -> None:
    given = tables(3)
    given["b.end"][1, 0] = math.nan
    batch = cs.predict_batch(HARNESS, given, points=60)
    assert list(batch.errors) == [1]
    assert "b.end[1]: position" in str(batch.errors[1])
    assert batch.done.tolist() == [True, False, True]
    assert batch[1].status is cs.Status.NOT_CONVERGED
    assert np.isnan(batch.positions["a"][1]).all()
    assert not batch.partial
    assert "2 OK, 1 not done" in repr(batch)


def test_a_time_limit_gives_what_is_done_and_says_so() -> None:
    batch = cs.predict_batch(HARNESS, tables(), points=60, time_limit=1e-9)
    assert batch.partial
    assert not batch.done.any()


def test_ends_too_far_apart_are_a_status() -> None:
    given = tables(2)
    given["b.end"][1, 0] = 1.5
    batch = cs.predict_batch(HARNESS, given, points=60, scene=SCENE)
    assert batch[1].status is cs.Status.OVERSTRETCHED
    assert batch.usable.tolist() == [True, False]
    assert batch.details[1]


def test_an_empty_batch_is_empty() -> None:
    batch = cs.predict_batch(HARNESS, tables(0), scene=SCENE)
    assert len(batch) == 0
    assert batch.clearance.shape == (0,)
    assert batch.positions["a"].shape == (0, 150, 3)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"starts": {}}, r"ends = \[\] is not allowed: no end is held"),
        ({"starts": {"d.end": np.zeros((2, 7))}}, r"ends: unknown key 'd.end'"),
        ({"starts": {"a.end": tables(2)["b.end"]}}, r"'a.end' is not allowed: it is in junction 'fork'"),
        ({"starts": {"a.start": np.zeros((2, 6))}}, r"a.start = 'array of shape \(2, 6\)' .* shape \(k, 7\)"),
        ({"starts": {"a.start": tables(2)["a.start"], "b.end": tables(3)["b.end"]}}, "all must have as many rows"),
        ({"starts": np.zeros((2, 7))}, r"ends = .* must be a mapping"),
        ({"ends": np.zeros((2, 7))}, r"ends = .* is not allowed: it is known of cables only"),
        ({"start_kind": "swivel"}, "start_kind = 'swivel' is not allowed: it is known of cables only"),
        ({"uncertainty": {"a": cs.Uncertainty({"length": 1e-3})}}, "uncertainty = .* it must be an? Uncertainty"),
        ({"uncertainty": cs.Uncertainty({"length": 2.0})}, "uncertainty, one standard deviation away: .*length"),
        ({"kinds": {"c.end": "swivel"}}, r"kinds: unknown key 'c.end'"),
        ({"kinds": {"a.start": "glued"}}, r"kinds\['a.start'\] = 'glued'"),
        ({"model": "catenary"}, "model = 'catenary'"),
        ({"threads": 0}, "threads = 0"),
    ],
)
def test_bad_arguments_are_named(change: dict, told: str) -> None:
    starts = change.pop("starts", tables(2))
    with pytest.raises(cs.ArgumentError, match=told):
        cs.predict_batch(HARNESS, starts, **change)
    with pytest.raises(cs.ArgumentError, match=r"kinds = .* a cable has two ends"):
        cs.predict_batch(CABLE, np.zeros((1, 7)), None, kinds={})
    with pytest.raises(cs.ArgumentError, match="ends is missing"):
        cs.predict_batch(CABLE, np.zeros((1, 7)))
