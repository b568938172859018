"""A cable that is seen: hidden stretches, stray points, other cables, loss and recovery, grips that nobody told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from clouds import ALONG_X, CABLE, END, START, cloud, places

import cable_shape as cs
from cable_shape.tracking.start import paths

STEP = 10_000_000  # ns
KNOWN = cs.Uncertainty({"bending_stiffness": 0.5, "length": 0.003}, (0.001, 0.02), (0.001, 0.02))
TRUE = CABLE.replace(bending_stiffness=0.006, rest_curvature=(0.4, -0.3, 0.0))


def end_at(k: int) -> cs.Pose:
    """Where the right grip is at look k."""
    return cs.Pose((0.7 + 0.002 * k, 0.1, 1.0), ALONG_X)


def off(shape: cs.CableShape, true: cs.CableShape) -> np.ndarray:
    """(n,) [m], at equal share of the length."""
    there = places(true, true.length * shape.arc_length / shape.length)
    return np.asarray(np.linalg.norm(shape.positions - there, axis=1))


def tracked(tracker: cs.Tracker, looks: int, *, known: bool = True, **how: object) -> tuple[cs.CableShape, ...]:
    """The last shape, and the true one, after so many looks at a cable whose right grip moves."""
    predictor = cs.Predictor(TRUE, points=201)
    for k in range(looks):
        true = predictor.predict(START, end_at(k))
        told = {"start": START, "end": end_at(k)} if known else {}
        shape = tracker.update(cloud(true, k, **how), stamp=k * STEP, **told)  # type: ignore[arg-type]
    return shape, true


def test_a_cable_is_followed_though_half_of_it_is_hidden():
    tracker = cs.Tracker(CABLE, noise=0.002, uncertainty=KNOWN)
    shape, true = tracked(tracker, 8, hidden=(0.3, 0.8))
    assert shape.usable
    assert not tracker.lost
    assert tracker.innovation < 3.0
    unseen = cs.predict(CABLE, START, end_at(7), points=101)
    assert off(shape, true).mean() < 0.5 * off(unseen, true).mean()
    assert off(shape, true).mean() < 0.003
    tube = tracker.tube
    assert tube.shape is shape
    assert tube.holds
    across = tube.radius
    assert across[55] > 1.5 * across[20]  # nobody sees the middle
    assert (off(shape, true) < across).mean() > 0.9


def test_the_order_of_points_is_of_no_account():
    true = cs.predict(TRUE, START, END, points=201)
    seen = cloud(true, 1)
    shapes = [
        cs.Tracker(CABLE).update(points, stamp=0, start=START, end=END).positions for points in (seen, seen[::-1])
    ]
    np.testing.assert_allclose(*shapes, atol=1e-7)


def test_without_points_it_is_predicted_and_the_tube_grows():
    tracker = cs.Tracker(CABLE, noise=0.002)
    shape, _ = tracked(tracker, 8)
    before = tracker.tube.radius.mean()
    radii = []
    for k in range(8, 40):
        shape = tracker.update(np.empty((0, 3)), stamp=k * STEP, start=START, end=end_at(7))
        radii.append(tracker.tube.radius.mean())
        assert not tracker.lost
        assert math.isnan(tracker.innovation)
    true = cs.predict(TRUE, START, end_at(7), points=201)
    assert off(shape, true).mean() < 0.01
    assert before < radii[0] < radii[-1]
    tracker.update([], stamp=58 * STEP, start=START, end=end_at(7))
    assert tracker.lost
    tracker.update(cloud(true, 3), stamp=59 * STEP, start=START, end=end_at(7))
    assert not tracker.lost
    assert off(tracker.tube.shape, true).mean() < 0.003


def test_stray_points_alone_are_no_cable():
    rng = np.random.default_rng(0)
    strays = rng.uniform((-0.2, -0.5, 0.3), (1.0, 0.6, 1.3), (300, 3))
    tracker = cs.Tracker(CABLE)
    shape = tracker.update(strays, stamp=0, start=START, end=END)
    assert tracker.lost
    assert tracker.innovation == math.inf
    np.testing.assert_allclose(shape.positions, cs.predict(CABLE, START, END, points=101).positions, atol=1e-3)
    alone = cs.Tracker(CABLE)
    shape = alone.update(np.empty((0, 3)), stamp=0)
    assert alone.lost
    assert not shape.usable
    assert "Give start and end" in shape.detail
    assert np.isnan(alone.tube.radius).all()


@pytest.mark.parametrize(
    "other",
    [CABLE.replace(length=1.1), CABLE.replace(rest_curvature=(6.0, 0.0, 0.0)), CABLE.replace(bending_stiffness=1.0)],
    ids=["longer", "bent", "stiffer"],
)
def test_another_cable_is_odd(other):
    known = cs.Uncertainty({"bending_stiffness": 0.2, "length": 0.003}, (0.001, 0.01), (0.001, 0.01))
    tracker = cs.Tracker(CABLE, uncertainty=known)
    true = cs.predict(CABLE, START, END, points=201)
    for k in range(3):
        tracker.update(cloud(true, k), stamp=k * STEP, start=START, end=END)
    assert tracker.innovation < 2.0
    tracker.reset()
    true = cs.predict(other, START, END, points=201)
    for k in range(3):
        tracker.update(cloud(true, k), stamp=k * STEP, start=START, end=END)
    assert tracker.innovation > 3.0


@pytest.mark.parametrize("hidden", [(0.09, 0.6), (0.03, 0.55), (0.25, 0.75), (0.42, 0.95)])
def test_ends_are_found_though_most_between_them_is_hidden(hidden):
    """A piece that is seen at one end is nearer to the middle of the other piece than to its end."""
    for seed in range(3):
        true = cs.predict(TRUE, START, cs.Pose((0.55, 0.1, 1.0), ALONG_X), points=201)
        points = cloud(true, seed, count=2000, noise=0.003, stray=0.2, hidden=hidden)
        line = paths(points, CABLE.length)[0]
        ends, there = line[[0, -1]], true.positions[[0, -1]]
        apart = min(np.linalg.norm(ends - way, axis=1).max() for way in (there, there[::-1]))
        assert apart < 0.04, seed
    tracker = cs.Tracker(CABLE, noise=0.003)
    shape = tracker.update(points, stamp=0)
    ways = (shape.positions, shape.positions[::-1])
    there = places(true, np.linspace(0.0, true.length, len(shape.positions)))
    assert min(np.linalg.norm(way - there, axis=1).mean() for way in ways) < 0.02


def test_grips_that_nobody_told_are_found_among_the_points():
    tracker = cs.Tracker(CABLE)
    shape, true = tracked(tracker, 5, known=False)
    assert shape.usable
    assert not tracker.lost
    assert tracker.ends is not None
    flipped = np.linalg.norm(shape.positions[0] - true.positions[-1]) < 0.05
    points = true.positions[::-1] if flipped else true.positions
    assert np.linalg.norm(shape.positions - points[::2], axis=1).mean() < 0.01


def test_a_grip_that_is_told_no_more_is_followed_by_what_is_seen():
    tracker = cs.Tracker(CABLE, noise=0.002)
    tracked(tracker, 4)
    predictor = cs.Predictor(TRUE, points=201)
    for k in range(4, 12):
        true = predictor.predict(START, end_at(k))
        shape = tracker.update(cloud(true, k), stamp=k * STEP, start=START)
    assert off(shape, true).mean() < 0.004


def test_a_free_end_is_followed():
    start = cs.Pose((0.0, 0.0, 1.0), (0.0, 0.70710678, 0.0, 0.70710678))
    true = cs.predict(TRUE, start, None, points=201)
    tracker = cs.Tracker(CABLE, noise=0.002)
    for k in range(4):
        shape = tracker.update(cloud(true, k), stamp=k * STEP, start=start, end=cs.FreeEnd())
    assert off(shape, true).mean() < 0.005


def test_a_cable_on_a_table_stays_on_it():
    table = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.005, diameter=0.008)
    start, end = cs.Pose((0.0, 0.0, 0.06), ALONG_X), cs.Pose((0.75, 0.0, 0.06), ALONG_X)
    true = cs.predict(cable.replace(bending_stiffness=0.008), start, end, points=201, scene=table)
    tracker = cs.Tracker(cable, table, noise=0.002)
    for k in range(3):
        shape = tracker.update(cloud(true, k, hidden=(0.6, 0.9)), stamp=k * STEP, start=start, end=end)
    assert shape.contacts
    assert shape.positions[:, 2].min() > 0.0035
    assert off(shape, true).mean() < 0.004


def test_a_cable_in_a_clip_where_it_has_a_kink_is_followed():
    scene = cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.35, 0.05, 0.8), ALONG_X), kind="ball")])
    tracker, predictor = cs.Tracker(CABLE, scene, noise=0.002), cs.Predictor(TRUE, scene=scene, points=201)
    for k in range(4):
        true = predictor.predict(START, end_at(k))
        shape = tracker.update(cloud(true, k), stamp=k * STEP, start=START, end=end_at(k))
    assert not tracker.lost
    assert off(shape, true).mean() < 0.003


def behind(made, scene: cs.Scene) -> tuple[cs.Pose, cs.Pose]:
    """Takes what predicts or tracks to where a cable hangs behind a post, from where it hangs beside it."""
    for k in range(31):
        ends = tuple(cs.Pose((x, -0.12 + 0.01 * k, 1.0), ALONG_X) for x in (0.0, 0.7))
        made(ends, k)
    return ends


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_cable_behind_a_post_stays_there_whatever_is_seen_meanwhile(seed):
    post = cs.Obstacle("post", cs.Cylinder(0.015, 2.0), cs.Pose((0.35, 0.0, 1.0)))
    scene = cs.Scene(obstacles=[post], contact="solve")
    predictor = cs.Predictor(TRUE, scene=scene, points=101)
    tracker = cs.Tracker(CABLE, scene, noise=0.002)
    shapes = []

    def both(ends, k: int) -> None:
        shapes.append(predictor.predict(*ends))
        shape = tracker.update(cloud(shapes[-1], k + 1000 * seed), stamp=k * STEP, start=ends[0], end=ends[1])
        assert off(shape, shapes[-1]).max() < 0.01, k

    start, end = behind(both, scene)
    true = shapes[-1]
    assert true.contacts
    assert np.abs(true.positions - cs.predict(TRUE, start, end, scene=scene, points=101).positions).max() > 0.1
    strays = np.random.default_rng(seed).uniform((0.0, -0.4, 0.4), (0.7, 0.4, 1.2), (200, 3))
    for k, (points, lost) in enumerate(((strays, True), (np.empty((0, 3)), False), (cloud(true, 7 + seed), False))):
        shape = tracker.update(points, stamp=(31 + k) * STEP, start=start, end=end)
        assert tracker.lost is lost or not len(points)
        assert off(shape, true).max() < 0.01, k
    assert off(shape, true).mean() < 0.004


def test_segments_are_a_hook():
    true = cs.predict(TRUE, START, END, points=201)
    image = {"points": cloud(true, 1)}
    tracker = cs.Tracker(CABLE, segment=lambda picture: picture["points"])
    shape = tracker.update(image, stamp=0, start=START, end=END)
    assert off(shape, true).mean() < 0.004


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([[0.0, 0.0, math.nan]], r"points\[0\].*finite"),
        ([[0.0, 0.0]], r"shape \(1, 2\).*\(n, 3\)"),
        (["a"], "must be numbers"),
        ([1.0, 2.0, 3.0], r"shape \(3,\)"),
    ],
)
def test_points_that_are_none_are_refused(points, said):
    with pytest.raises(cs.ArgumentError, match=said):
        cs.Tracker(CABLE).update(points, stamp=0, start=START, end=END)


def test_stamps_go_on():
    tracker = cs.Tracker(CABLE)
    tracker.update(np.empty((0, 3)), stamp=5, start=START, end=END)
    with pytest.raises(cs.StaleInputError, match=r"stamp = 4 ns .* older than the last one, 5 ns"):
        tracker.update(np.empty((0, 3)), stamp=4, start=START, end=END)
    tracker.reset()
    tracker.update(np.empty((0, 3)), stamp=4, start=START, end=END)


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"noise": 0.0}, "noise"),
        ({"outliers": 1.0}, "outliers"),
        ({"outliers": 0.0}, "outliers"),
        ({"segment": 3}, "segment"),
        ({"uncertainty": 0.1}, "uncertainty"),
        ({"points": 4}, "points"),
    ],
)
def test_wrong_arguments_are_refused(keywords, said):
    with pytest.raises(cs.ArgumentError, match=said):
        cs.Tracker(CABLE, **keywords)
    with pytest.raises(cs.ArgumentError, match="cable"):
        cs.Tracker("cable")  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError, match="Call update first"):
        _ = cs.Tracker(CABLE).tube
