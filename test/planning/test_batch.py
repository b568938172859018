"""predict_batch: the same shapes as one by one, whatever the order, the company and the threads."""

from __future__ import annotations

import numpy as np
import pytest
from rods import CABLE
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.network import batch_cells
from cable_shape.safety.report import LOAD_MARGINS

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
TOLERANCE = 1e-4 * CABLE.length
LIMITED = CABLE.replace(min_bend_radius=0.05, max_tension=20.0, max_twist_rate=8.0)
SCENE = cs.Scene(
    obstacles=[
        cs.Obstacle("ball", cs.Sphere(0.05), cs.Pose((0.4, 0.05, -0.25))),
        cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.4))),
        cs.Obstacle("far", cs.Box((0.1, 0.1, 0.1)), cs.Pose((3.0, 0.0, 0.0))),
    ],
    masses=[cs.PointMass(0.4, 0.02)],
)


def grasps(rows: int, reach: float = 0.08, turn: float = 0.3, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Random grasps (rows, 7) around one."""
    random = np.random.default_rng(seed)
    poses = []
    for place, frame in ((0.0, 0.0, 0.0), ALONG_X), ((0.7, 0.3, -0.1), Rotation.from_euler("z", 0.8) * ALONG_X):
        turns = Rotation.from_rotvec(random.uniform(-turn, turn, (rows, 3)))
        poses.append(np.hstack((place + random.uniform(-reach, reach, (rows, 3)), (turns * frame).as_quat())))
    return poses[0], poses[1]


def pair(starts: np.ndarray, ends: np.ndarray, row: int) -> tuple[cs.Pose, cs.Pose]:
    """One row as poses."""
    return cs.Pose(starts[row, :3], starts[row, 3:]), cs.Pose(ends[row, :3], ends[row, 3:])


def batch_of(starts: np.ndarray, ends: np.ndarray, **options) -> cs.ShapeBatch:
    """Of the rod, to the tolerance of these tests."""
    return cs.predict_batch(LIMITED, starts, ends, **{"model": "cosserat", "tolerance": TOLERANCE, **options})


def assert_same(a: cs.ShapeBatch, rows: np.ndarray, b: cs.ShapeBatch) -> None:
    """Rows of `a` are those of `b`, bit by bit."""
    for name in ("buffer", "tables", "margin_rows", "status", "several", "energy", "error_estimate", "twist"):
        np.testing.assert_array_equal(getattr(a, name)[rows], getattr(b, name), err_msg=name)


def test_every_row_is_the_cold_prediction_within_its_estimate() -> None:
    starts, ends = grasps(60)
    batch = batch_of(starts, ends, scene=SCENE)
    assert batch.usable.all()
    for row, shape in enumerate(batch):
        exact = cs.predict(
            LIMITED, *pair(starts, ends, row), model="cosserat", tolerance=1e-8 * CABLE.length, scene=SCENE
        )
        apart = np.linalg.norm(shape.positions - exact.positions, axis=1).max()
        assert apart < shape.error_estimate < TOLERANCE
        np.testing.assert_allclose(shape.moment, exact.moment, atol=2e-3 * np.abs(exact.moment).max())
        assert shape.energy == pytest.approx(exact.energy, abs=1e-5)
        assert shape.twist == pytest.approx(exact.twist, abs=1e-3)
        frames = np.abs((shape.quaternions * exact.quaternions).sum(axis=1))
        assert 1.0 - frames.min() < 1e-6


def test_order_company_and_threads_change_no_bit() -> None:
    starts, ends = grasps(300, reach=0.15, turn=0.5)
    starts[7] = starts[8]
    whole = batch_of(starts, ends, scene=SCENE, threads=1)
    order = np.random.default_rng(3).permutation(len(starts))
    assert_same(whole, order, batch_of(starts[order], ends[order], scene=SCENE, threads=2))
    some = order[:40]
    assert_same(whole, some, batch_of(starts[some], ends[some], scene=SCENE, threads=3))
    assert_same(whole, order[:1], batch_of(starts[order[:1]], ends[order[:1]], scene=SCENE, threads=1))


def test_the_sign_of_a_quaternion_changes_no_shape() -> None:
    starts, ends = grasps(30)
    flipped = np.hstack((ends[:, :3], -ends[:, 3:]))
    np.testing.assert_array_equal(batch_of(starts, ends).positions, batch_of(starts, flipped).positions)


def test_clearance_and_margins_are_those_of_a_cycle() -> None:
    starts, ends = grasps(25)
    batch = batch_of(starts, ends, scene=SCENE)
    assert batch.bodies == ("ball", "table", "far")
    for row in range(len(batch)):
        cycle = cs.Cycle(LIMITED, scene=SCENE, model="cosserat", tolerance=TOLERANCE)
        report = cycle.step({"cable": pair(starts, ends, row)}, 0)
        clearance, ours = report.clearance["cable"], batch.clearance_of(row)
        assert [b.body for b in ours.bodies] == [b.body for b in clearance.bodies]
        for a, b in zip(ours.bodies, clearance.bodies, strict=True):
            assert a.distance == pytest.approx(b.distance, abs=2.0 * TOLERANCE)
        assert batch.distances[row, 2] == np.inf
        columns = {**{kind: i for i, kind in enumerate(LOAD_MARGINS)}, "ball": 6, "table": 7}
        told = {columns[m.other or m.kind]: m.used for m in report.margins["cable"]}
        assert set(np.flatnonzero(~np.isnan(batch.used[row]))) == set(told)
        for column, used in told.items():
            assert batch.used[row, column] == pytest.approx(used, rel=2e-2), column


def test_a_row_that_is_not_valid_fails_alone_and_with_its_index() -> None:
    starts, ends = grasps(12)
    whole = batch_of(starts, ends)
    starts[3, 1], ends[5, 3:] = np.nan, (0.0, 0.0, 0.0, 2.0)
    batch = batch_of(starts, ends)
    good = np.array([0, 1, 2, 4, 6, 7, 8, 9, 10, 11])
    assert sorted(batch.errors) == [3, 5]
    assert "starts[3]" in str(batch.errors[3])
    assert "nan" in str(batch.errors[3])
    assert "ends[5]" in str(batch.errors[5])
    np.testing.assert_array_equal(batch.buffer[good], whole.buffer[good])
    assert not batch.usable[[3, 5]].any()
    assert not batch[3].status
    assert "starts[3]" in batch[3].detail
    assert np.isnan(batch[3].positions).all()
    assert not batch.partial


def test_a_time_limit_gives_what_is_done_and_says_so() -> None:
    starts, ends = grasps(200)
    batch_of(starts[:2], ends[:2])
    batch = batch_of(starts, ends, time_limit=1e-9)
    assert batch.partial
    assert not batch.done.any()
    assert not batch.usable.any()
    assert np.isnan(batch.positions).all()
    assert "200 not done" in repr(batch)
    assert not batch_of(starts, ends, time_limit=1e3).partial


def test_ends_too_far_apart_are_a_status() -> None:
    starts, ends = grasps(5)
    ends[2, 0] = 2.0
    batch = batch_of(starts, ends)
    assert batch[2].status is cs.Status.OVERSTRETCHED
    assert "further apart" in batch.details[2]
    assert batch.usable.tolist() == [True, True, False, True, True]


@pytest.mark.parametrize("model", ["catenary", "gradient4", "auto"])
def test_other_models_are_those_of_predict(model: str) -> None:
    starts, ends = grasps(4)
    batch = cs.predict_batch(CABLE, starts, ends, model=model, tolerance=1e-3)
    for row, shape in enumerate(batch):
        single = cs.predict(CABLE, *pair(starts, ends, row), model=model, tolerance=1e-3)
        if model == "auto":
            assert np.linalg.norm(shape.positions - single.positions, axis=1).max() < 1e-3
        else:
            np.testing.assert_allclose(shape.buffer, single.buffer, rtol=1e-12, atol=1e-14)
            assert shape.model == single.model


AT = (0.3, 0.1, -0.4)  # well below the grips: between them the cable has several shapes
HELD = cs.Scene(clips=[cs.Clip(0.6, cs.Pose(AT), kind="ball")], masses=[cs.PointMass(0.3, 0.02)])
WAVE = np.linspace(0.0, np.pi, 9)[:, None]
BENT = np.column_stack((0.5 + np.sin(2.0 * WAVE[:, 0]), 0.3 * np.cos(WAVE[:, 0]), np.full(9, 0.1)))
#: What rows have in common, beside two clamped ends.
HOLDS = {
    "swivel and pinned": {"start_kind": "swivel", "end_kind": "pinned"},
    "ball clip": {"scene": HELD},
    "hinge clip": {
        "scene": HELD.replace(clips=[cs.Clip(0.6, cs.Pose((0.35, 0.15, -0.2), (0.5, 0.5, 0.5, 0.5)), kind="hinge")])
    },
    "accelerated": {"acceleration": np.column_stack((2.0 * np.sin(WAVE), 0.5 * WAVE, 0.0 * WAVE))},
    "accelerated in a ball clip": {
        "scene": HELD,
        "acceleration": np.column_stack((2.0 * np.sin(WAVE), 0.5 * WAVE, 0.0 * WAVE)),
    },
    "bent at rest": {"cable": CABLE.replace(rest_curvature=BENT)},
    "extensible": {"cable": CABLE.replace(axial_stiffness=50.0, shear_stiffness=30.0)},
}


@pytest.mark.parametrize("hold", HOLDS)
def test_rows_that_are_held_otherwise_are_cold_predictions_too(hold: str, monkeypatch) -> None:
    options = dict(HOLDS[hold])
    cable = options.pop("cable", CABLE)
    starts, ends = grasps(60, reach=0.02, turn=0.05)
    alone: list[int] = []
    monkeypatch.setattr("cable_shape.planning.batch._Work._solve_alone", lambda work, row: alone.append(row))
    batch = cs.predict_batch(cable, starts, ends, model="cosserat", tolerance=TOLERANCE, **options)
    assert len(alone) <= 6, alone
    several = 0
    kinds = [options.pop(f"{end}_kind", "clamped") for end in ("start", "end")]
    acceleration = options.pop("acceleration", None)
    fine = cs.Predictor(cable, model="cosserat", tolerance=1e-7 * cable.length, **options)
    for row in sorted(set(range(0, 60, 7)) - set(alone)):
        grips = (cs.Grip(pose, kind) for pose, kind in zip(pair(starts, ends, row), kinds, strict=True))
        fine.reset()
        exact, shape = fine.predict(*grips, acceleration=acceleration), batch[row]
        assert exact.status
        assert shape.status
        apart = np.linalg.norm(shape.positions - exact.positions, axis=1).max()
        if apart > 0.02 * CABLE.length and batch.several[row]:
            several += 1  # on another branch, and says that there is one
            continue
        assert apart < shape.error_estimate < TOLERANCE
        np.testing.assert_allclose(shape.moment, exact.moment, atol=5e-3 * np.abs(exact.moment).max())
        assert shape.energy == pytest.approx(exact.energy, abs=2e-5)
        if shape.clips:
            np.testing.assert_allclose(shape.clips[0].force, exact.clips[0].force, rtol=0.0, atol=2e-3)
            assert shape.clips[0].arc_length == pytest.approx(exact.clips[0].arc_length, abs=1e-4)
    assert several <= 1


@pytest.mark.parametrize("plug", [None, cs.FreeEnd(0.02, moment=(0.0, 2e-3, 0.0))], ids=["bare", "plug"])
def test_free_ends_hang(plug: cs.FreeEnd | None) -> None:
    starts, _ = grasps(30, turn=0.6)
    batch = cs.predict_batch(CABLE, starts, plug, model="cosserat", tolerance=TOLERANCE)
    assert batch.usable.all()
    assert np.isnan(batch.used[:, 0]).all()  # nothing to stretch it between
    for row in range(0, 30, 5):
        exact = cs.predict(CABLE, cs.Pose(starts[row, :3], starts[row, 3:]), plug, tolerance=1e-7 * CABLE.length)
        shape = batch[row]
        assert np.linalg.norm(shape.positions - exact.positions, axis=1).max() < shape.error_estimate < TOLERANCE
        assert shape.energy == pytest.approx(exact.energy, abs=1e-5)


def test_no_bit_of_a_row_in_clips_depends_on_others() -> None:
    starts, ends = grasps(80, reach=0.05, turn=0.1)
    whole = batch_of(starts, ends, threads=1, **HOLDS["ball clip"])
    order = np.random.default_rng(3).permutation(len(starts))[:50]
    assert_same(whole, order, batch_of(starts[order], ends[order], threads=2, **HOLDS["ball clip"]))


def test_eyelets_are_solved_row_by_row() -> None:
    starts, ends = grasps(2, reach=0.01, turn=0.02)
    scene = cs.Scene(clips=[cs.Clip(0.6, cs.Pose(AT), kind="slide")])
    batch = cs.predict_batch(CABLE, starts, ends, model="cosserat", scene=scene)
    single = cs.predict(CABLE, *pair(starts, ends, 1), model="cosserat", scene=scene)
    np.testing.assert_array_equal(batch[1].positions, single.positions)
    assert batch[1].clips[0].arc_length == single.clips[0].arc_length


def test_an_empty_batch_is_empty() -> None:
    batch = cs.predict_batch(CABLE, np.empty((0, 7)), np.empty((0, 7)))
    assert len(batch) == 0
    assert not batch.partial
    assert batch.positions.shape == (0, 150, 3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"starts": np.zeros((3, 6))}, r"starts.*shape \(k, 7\)"),
        ({"ends": np.zeros((2, 7))}, "ends.*as many as starts, 3"),
        ({"starts": "here"}, "starts.*must be numbers"),
        ({"threads": 0}, "threads.*at least 1"),
        ({"threads": 1.5}, "threads.*whole number"),
        ({"time_limit": 0.0}, "time_limit.*above 0"),
        ({"model": "spring"}, "model.*one of"),
        ({"start_kind": "glued"}, "start_kind.*one of"),
        ({"end_kind": "free"}, "end_kind.*one of"),
        ({"acceleration": (np.nan, 0.0, 0.0)}, "acceleration.*finite"),
        ({"points": 100_000, "starts": np.zeros((700, 7)), "ends": np.zeros((700, 7))}, "700 rows.*Split"),
    ],
)
def test_bad_arguments_are_named(change: dict, words: str) -> None:
    starts, ends = grasps(3)
    with pytest.raises(cs.ArgumentError, match=words):
        cs.predict_batch(CABLE, **{"starts": starts, "ends": ends, **change})


@pytest.mark.parametrize("wide", [batch_cells.DIMENSIONS, batch_cells.IN_CLIPS])
def test_cells_are_the_nearest_points_of_the_lattice(wide: int) -> None:
    random = np.random.default_rng(5)
    key, x = np.empty(wide, np.int64), np.empty(wide)
    for _ in range(50):
        place = random.uniform(-3.0, 3.0, wide)
        batch_cells.nearest(place, key)
        batch_cells.centre(key, x)
        least = np.linalg.norm(place - x)
        assert least <= np.sqrt(wide * (wide + 2) / (12.0 * (wide + 1))) + 1e-12  # the lattice's covering radius
        for _ in range(200):
            other = np.empty(wide)
            batch_cells.centre(key + random.integers(-1, 2, wide), other)
            assert np.linalg.norm(place - other) >= least - 1e-12


@pytest.mark.parametrize("wide", [batch_cells.DIMENSIONS, batch_cells.IN_CLIPS])
def test_a_cells_grasp_has_the_cells_coordinates(wide: int) -> None:
    key = np.array((1, -2, 0, 3, 1, 0, -1, 2, 1, 2, 0, -1))[:wide]
    again, x = np.empty(wide, np.int64), np.empty(wide)
    start, end = np.empty((2, 7))
    batch_cells.grasp(key, 0.3, 0.3, np.inf, start, end)
    batch_cells.coordinates(start, end, 0.3, 0.3, x)
    batch_cells.nearest(x, again)
    np.testing.assert_array_equal(again, key)
