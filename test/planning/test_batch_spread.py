"""Tubes of a batch: against those of single predictions, drawn samples and the clearance of a swollen cable."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_batch import LIMITED, SCENE, TOLERANCE, assert_same, batch_of, grasps, pair

import cable_shape as cs
from cable_shape.planning.batch_spread import BatchTube
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.uncertainty.tube_watch import TubeWatch

KNOWN = cs.Uncertainty(
    {"bending_stiffness": 0.04, "length": 5e-4, "start_tilt": 2e-3, "end_offset": 3e-4, "roll": 4e-3},
    (3e-4, 3e-3),
    (4e-4, 2e-3),
    misses=2e-4,
)


def root_of(seed: int) -> np.ndarray:
    """A square root of a covariance of a grip's pose, m and rad."""
    return np.random.default_rng(seed).normal(size=(6, 6)) * np.array((1, 1, 1, 5, 5, 5))[:, None] * 1e-4


def full() -> cs.Uncertainty:
    """Correlated: a cable bent at rest in a calibration, and grips."""
    made = cs.Uncertainty(None, root_of(1) @ root_of(1).T, root_of(2) @ root_of(2).T)
    root = np.random.default_rng(3).normal(size=(4, 4)) * np.array((0.03, 3e-4, 0.02, 0.02))[:, None]
    made.names, made.covariance = ("bending_stiffness", "length", "rest_curvature"), root @ root.T
    return made


CLIPPED = SCENE.replace(clips=[cs.Clip(0.6, cs.Pose((0.3, 0.1, -0.4)))])


@pytest.mark.parametrize(("known", "scene"), [(KNOWN, SCENE), (full(), SCENE), (KNOWN, CLIPPED)],
                         ids=["plain", "correlated", "in a clip"])  # fmt: skip
def test_the_tube_of_a_row_is_that_of_a_prediction(known: cs.Uncertainty, scene: cs.Scene) -> None:
    """Which takes differences of shapes for the cable's numbers."""
    starts, ends = grasps(15, 0.03, 0.1)
    # first derivatives come from the row's own mesh, and a clip's spans are short
    tolerance = TOLERANCE if scene is SCENE else 0.1 * TOLERANCE
    radius = batch_of(starts, ends, scene=scene, uncertainty=known, tolerance=tolerance).radius
    assert radius is not None
    for row in range(len(starts)):
        options = {"scene": scene, "tolerance": 1e-8}
        predictor = cs.Predictor(LIMITED, model="cosserat", **options)
        shape = predictor.predict(*pair(starts, ends, row))
        tube = TubeWatch(LIMITED, known, **options).tube(predictor, shape, pair(starts, ends, row))
        assert tube is not None
        np.testing.assert_allclose(radius[row], tube.radius, rtol=0.0, atol=5e-3 * tube.radius.max())


IN_AN_EYELET = cs.Scene(clips=[cs.Clip(0.6, cs.Pose((0.35, 0.0, -0.25), (0.5, 0.5, 0.5, 0.5)), kind="slide")])
ON_A_TABLE = cs.Scene(
    obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25)))], contact="solve"
)  # fmt: skip


@pytest.mark.parametrize("scene", [IN_AN_EYELET, ON_A_TABLE], ids=["in an eyelet", "on a table"])
def test_rows_that_are_solved_one_by_one_have_tubes(scene: cs.Scene) -> None:
    """That of the exact derivatives of a shape from nothing."""
    off = 2e-4
    known = cs.Uncertainty({"length": off}, (off, 0.0))
    starts, ends = grasps(3, 0.01, 0.03)
    batch = batch_of(starts, ends, scene=scene, uncertainty=known, tolerance=1e-7)
    assert batch.radius is not None
    for row in range(len(starts)):
        predictor = cs.Predictor(LIMITED, model="cosserat", scene=scene, tolerance=1e-7)
        shape = predictor.predict(*pair(starts, ends, row))
        assert shape.status is cs.Status.OK
        assert bool(shape.contacts) is (scene is ON_A_TABLE)
        ways = off * predictor.sensitivity(("length", "start"))[:, :, :4]
        expected = known.radius(ways @ ways.transpose(0, 2, 1), shape.tangents)
        np.testing.assert_allclose(batch.radius[row], expected, rtol=0.0, atol=0.02 * expected.max())


def test_the_tube_holds_as_many_cables_as_it_says() -> None:
    starts, ends = grasps(1)
    count = 1500
    rng = np.random.default_rng(8)
    known = cs.Uncertainty({"bending_stiffness": 0.05, "length": 1e-3}, (5e-4, 5e-3), (5e-4, 5e-3))
    batch = batch_of(starts, ends, uncertainty=known)
    lines = []
    for _ in range(count):
        factor = math.exp(0.05 * rng.normal())
        cable = LIMITED.replace(
            length=LIMITED.length + 1e-3 * rng.normal(),
            bending_stiffness=factor * LIMITED.mean_bending_stiffness,
            twisting_stiffness=factor * LIMITED.twisting_stiffness,
        )
        poses = [
            cs.Pose(p[:3] + 5e-4 * rng.normal(size=3), (turn * Rotation.from_quat(p[3:])).as_quat())
            for p in (starts[0], ends[0])
            for turn in (Rotation.from_rotvec(5e-3 * rng.normal(size=3)),)
        ]
        shape = cs.predict(cable, *poses, model="cosserat", tolerance=TOLERANCE)
        assert shape.status is cs.Status.OK
        lines.append(shape.positions.copy())
    off = np.array(lines) - batch.positions[0]
    along = np.einsum("kni,ni->kn", off, batch[0].tangents)
    away = np.sqrt(np.maximum((off**2).sum(axis=2) - along**2, 0.0))
    inside = (away <= batch.radius[0]).mean(axis=0)
    assert (inside > 0.93).all()
    assert (inside < 0.97).all()


def test_clearance_is_that_of_the_tube_and_nothing_else_changes() -> None:
    starts, ends = grasps(40)
    plain = batch_of(starts, ends, scene=SCENE)
    batch = batch_of(starts, ends, scene=SCENE, uncertainty=KNOWN)
    assert plain.radius is None
    assert plain.clearance_of(0).confidence == 0.0
    np.testing.assert_array_equal(batch.buffer, plain.buffer)
    np.testing.assert_array_equal(batch.used[:, :6], plain.used[:, :6])
    checker = ClearanceChecker(SCENE, radius=0.5 * LIMITED.diameter)
    for row, shape in enumerate(batch):
        expected = checker.check(shape, swell=batch.radius[row])
        assert expected.table is not None
        near = np.isfinite(expected.table[:, 0])
        np.testing.assert_array_equal(np.isfinite(batch.distances[row]), near)
        np.testing.assert_allclose(batch.distances[row, near], expected.table[near, 0], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(batch.used[row, 6:][near], 2.0 - batch.distances[row, near] / 0.03)
        assert batch.clearance_of(row).confidence == 0.95
        assert len(batch.clearance_of(row).bodies) == near.sum()
    assert (np.isfinite(batch.distances) & (batch.distances < plain.distances)).any()


def test_order_and_threads_change_no_bit_of_a_tube() -> None:
    starts, ends = grasps(200, reach=0.15, turn=0.5)
    whole = batch_of(starts, ends, scene=SCENE, threads=1, uncertainty=KNOWN)
    order = np.random.default_rng(3).permutation(len(starts))
    other = batch_of(starts[order], ends[order], scene=SCENE, threads=2, uncertainty=KNOWN)
    assert_same(whole, order, other)
    np.testing.assert_array_equal(whole.radius[order], other.radius)
    assert np.isfinite(whole.radius[whole.usable]).all()


def test_a_row_that_is_solved_by_itself_has_the_same_tube() -> None:
    starts, ends = grasps(3)
    radius = batch_of(starts, ends, uncertainty=KNOWN).radius
    for row in range(3):
        state = Network(Problem(LIMITED, tolerance=TOLERANCE))
        shape = cosserat.solve(state.problem.move(*pair(starts, ends, row)), state)
        own = BatchTube(state, KNOWN).radius(state, shape)  # on another mesh
        np.testing.assert_allclose(own, radius[row], rtol=0.0, atol=2e-3 * own.max())


def test_a_row_without_a_shape_has_no_tube() -> None:
    starts, ends = grasps(3)
    ends[1, 0] = 2.0
    batch = batch_of(starts, ends, uncertainty=KNOWN)
    assert np.isnan(batch.radius[1]).all()
    assert np.isfinite(batch.radius[[0, 2]]).all()
    assert batch.clearance_of(1).confidence == 0.0
    empty = batch_of(starts[:0], ends[:0], uncertainty=KNOWN)
    assert empty.radius.shape == (0, 150)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"model": "gradient4"}, "only the Cosserat rod.*'gradient4'.*Choose 'cosserat'"),
        ({"cable": LIMITED.replace(bending_stiffness=0.0), "model": "auto"}, "bending stiffness above 0"),
        ({"uncertainty": 0.1}, "uncertainty = 0.1.*an Uncertainty"),
        ({"uncertainty": cs.Uncertainty({"axial_stiffness": 0.1})}, "axial_stiffness.*above 0"),
    ],
)
def test_what_has_no_tube_is_refused(change: dict, words: str) -> None:
    starts, ends = grasps(2)
    given = {"cable": LIMITED, "model": "cosserat", "uncertainty": KNOWN, **change}
    with pytest.raises(cs.ArgumentError, match=words):
        cs.predict_batch(given.pop("cable"), starts, ends, **given)
