"""A harness that is seen: answers against differences, hidden segments, ends that nobody tells, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from clouds import cloud

import cable_shape as cs
from cable_shape.tracking.harness_rod import HarnessRod
from cable_shape.tracking.harness_tracker import HarnessTracker
from cable_shape.tracking.harness_unknown import HarnessUnknown

STEP = 10_000_000  # ns
ALONG_X = (0.5, 0.5, 0.5, 0.5)
TRUNK = cs.Cable(length=0.5, linear_density=0.08, bending_stiffness=0.01)
BRANCH = cs.Cable(length=0.4, linear_density=0.03, bending_stiffness=0.003)
FORK = cs.Junction("fork", ("trunk.end", "left.start", "right.start"), mass=0.01)
KNOWN = cs.Harness({"trunk": TRUNK, "left": BRANCH, "right": BRANCH.replace(length=0.45)}, [FORK])
TRUE = KNOWN.replace(
    segments={
        "trunk": TRUNK.replace(bending_stiffness=0.014, rest_curvature=(0.5, 0.0, 0.0)),
        "left": BRANCH.replace(bending_stiffness=0.002, rest_curvature=(0.0, 0.6, 0.0)),
        "right": BRANCH.replace(length=0.452, bending_stiffness=0.004),
    }
)
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.93)))], contact="solve")
NAMES = {"bending_stiffness:each": 0.3, "length:trunk": 0.003, "length:left": 0.003, "length:right": 0.003}


def ends_at(k: int) -> dict[str, cs.Pose]:
    """Where the grips are at look k; the end of the trunk's branches moves."""
    return {
        "trunk.start": cs.Pose((0.0, 0.0, 1.0), ALONG_X),
        "left.end": cs.Pose((0.7 + 0.002 * k, 0.15, 1.0), ALONG_X),
        "right.end": cs.Pose((0.7, -0.2, 0.95), ALONG_X),
    }


def seen_of(shape, seed: int, hidden: tuple[str, ...] = ()) -> np.ndarray:
    """(n, 3) [m]: a cloud of all segments but the hidden ones, in no order."""
    names = [name for name in shape.segments if name not in hidden]
    parts = [cloud(shape.segments[name], seed + i, count=200) for i, name in enumerate(names)]
    return np.random.default_rng(seed).permutation(np.concatenate(parts))


def off(shape, true) -> dict[str, float]:
    """[m], in the mean over each segment."""
    return {
        name: float(np.linalg.norm(one.positions - true.segments[name].positions, axis=1).mean())
        for name, one in shape.segments.items()
    }


@pytest.mark.parametrize(
    ("names", "scene", "free"),
    [
        ({"bending_stiffness:each": 0.3, "length:each": 0.01}, None, False),
        ({"twisting_stiffness": 0.3, "frames": 0.1, "tilt:left.end": 0.1}, None, True),
        (
            {"length:each": 0.01},
            cs.Scene(clips=[cs.Clip(0.2, cs.Pose((0.18, 0.0, 0.97), ALONG_X), kind="ball", segment="trunk")]),
            False,
        ),
        ({"bending_stiffness:each": 0.3, "length:each": 0.01}, TABLE, False),
    ],
    ids=["stiffness and length", "twist and junction, one end free", "in a clip", "on a table"],
)
def test_moves_are_those_of_shapes_beside(names, scene, free):
    unknown = HarnessUnknown(KNOWN, cs.Uncertainty(names, (0.003, 0.05), (0.003, 0.05)), 0.5, swings=scene is not TABLE)
    rod = HarnessRod(KNOWN, unknown, points=21, tolerance=1e-9, scene=scene)
    ends = {name: cs.Grip(pose) for name, pose in ends_at(0).items()}
    if free:
        ends["right.end"] = cs.FreeEnd(mass=0.01)
    rng = np.random.default_rng(3)
    z = 0.3 * rng.normal(size=unknown.size) * np.sqrt(np.diag(unknown.covariance(1.0)))
    shape = rod.solve(z, ends)
    assert shape.status
    assert any(one.contacts for one in shape.segments.values()) is (scene is TABLE)
    assert unknown.parameters is not None
    lengths = [one.name.startswith("length") for one in unknown.parameters.each]
    lengths += [False] * unknown.rows * 3
    moves = rod.moves()
    assert not moves[:, :, unknown.rates].any()
    for j in range(unknown.rates.start):
        step = np.zeros(unknown.size)
        step[j] = 1e-3
        if j < unknown.material.start or lengths[j - unknown.material.start]:
            step[j] = 1e-5  # m or rad
        lines = []
        for by in (1.0, -1.0):
            assert rod.solve(z, ends).status
            lines.append(rod.line(rod.solve(z + by * step, ends)))
        above, below = lines
        beside = (above - below) / (2.0 * step[j])
        scale = np.abs(beside).max()
        meshes = 1.5e-6 / step[j] if scene is TABLE else 0.0  # by which two shapes on a table differ
        if scale < 1e-7:
            assert np.abs(moves[:, :, j]).max() < 1e-6
        else:
            assert np.abs(moves[:, :, j] - beside).max() < 2e-3 * scale + meshes, j


def test_a_harness_is_followed_though_half_of_it_is_hidden():
    uncertainty = cs.Uncertainty(NAMES, (0.001, 0.02), (0.001, 0.02))
    tracker = cs.Tracker(KNOWN, noise=0.002, uncertainty=uncertainty, points=51)
    assert isinstance(tracker, HarnessTracker)
    predictor = cs.Predictor(TRUE, points=51)
    for k in range(6):
        true = predictor.predict(ends_at(k))
        shape = tracker.update(seen_of(true, 10 * k, ("left",)), stamp=k * STEP, ends=ends_at(k))
    assert shape.usable
    assert not tracker.lost
    assert tracker.innovation < 3.0
    plain = off(cs.predict(KNOWN, ends_at(5), points=51), true)
    now = off(shape, true)
    assert now["trunk"] < 0.3 * plain["trunk"]
    assert now["right"] < 0.3 * plain["right"]
    assert now["left"] < 0.7 * plain["left"]  # nobody sees it
    tube = tracker.tube
    assert tube["left"].radius[25] > 2.0 * tube["right"].radius[25]
    inside = [
        np.linalg.norm(one.shape.positions - true.segments[n].positions, axis=1) < one.radius for n, one in tube.items()
    ]
    assert np.mean(inside) > 0.9
    before = tracker.predicted(stamp=6 * STEP, ends=ends_at(6))
    _, later = tracker.expected(6 * STEP, ends_at(6))
    assert later is not None
    np.testing.assert_allclose(later["left"].shape.positions, before.segments["left"].positions, atol=1e-9)


def test_a_harness_on_a_table_stays_on_it_though_half_of_it_is_hidden():
    tracker = cs.Tracker(KNOWN, TABLE, noise=0.002, points=51)
    predictor = cs.Predictor(TRUE, points=51, scene=TABLE)
    for k in range(4):
        true = predictor.predict(ends_at(k))
        shape = tracker.update(seen_of(true, 10 * k, ("left",)), stamp=k * STEP, ends=ends_at(k))
    assert not tracker.lost
    plain, now = off(cs.predict(KNOWN, ends_at(3), points=51, scene=TABLE), true), off(shape, true)
    assert now["trunk"] < 0.5 * plain["trunk"]
    assert now["right"] < 0.5 * plain["right"]
    assert any(one.contacts for one in shape.segments.values())
    for name, one in shape.segments.items():  # the trunk by the node of another that stands in for their junction
        assert abs(one.positions[:, 2].min() - 0.93 - 0.5 * KNOWN.segments[name].diameter) < 1e-4, name


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_a_clip_and_a_body_on_a_link_go_along_with_it(contact):
    clip = cs.Clip(0.25, cs.Pose((0.0, 0.0, 0.01), ALONG_X), kind="ball", segment="trunk", link="tool")
    scene = cs.Scene(clips=[clip], contact=contact)
    plate = cs.Obstacle("plate", cs.Box((0.3, 0.6, 0.02)), cs.Pose((0.35, 0.0, -0.02)), link="tool")
    keywords = {"robot_links": [plate], "gripping_links": []}
    tracker = cs.Tracker(KNOWN, scene, noise=0.002, points=31, **keywords)
    predictor = cs.Predictor(TRUE, points=31, scene=scene, **keywords)
    for k in range(4):
        links = {"tool": cs.Pose((0.23, 0.01 * k, 0.95))}
        true = predictor.predict(ends_at(k), links=links)
        shape = tracker.update(seen_of(true, 10 * k), stamp=k * STEP, ends=ends_at(k), links=links)
    assert not tracker.lost
    assert max(off(shape, true).values()) < 0.003
    at = np.interp(0.25, shape.segments["trunk"].arc_length, shape.segments["trunk"].positions[:, 1])
    assert at == pytest.approx(0.03, abs=2e-4)
    assert any(one.contacts for one in shape.segments.values()) is (contact == "solve")
    later = tracker.predicted(stamp=4 * STEP, ends=ends_at(3), links={"tool": cs.Pose((0.23, 0.05, 0.95))})
    at = np.interp(0.25, later.segments["trunk"].arc_length, later.segments["trunk"].positions[:, 1])
    assert at == pytest.approx(0.05, abs=2e-4)
    with pytest.raises(cs.ArgumentError, match="link"):
        tracker.predicted(stamp=4 * STEP, ends=ends_at(3))


def test_a_grip_that_is_told_no_more_is_followed_by_what_is_seen():
    tracker = cs.Tracker(KNOWN, noise=0.002, points=31)
    predictor = cs.Predictor(TRUE, points=31)
    for k in range(8):
        true = predictor.predict(ends_at(k))
        ends = {name: end for name, end in ends_at(k).items() if k < 3 or name != "left.end"}
        shape = tracker.update(seen_of(true, 10 * k), stamp=k * STEP, ends=ends)
    assert not tracker.lost
    assert max(off(shape, true).values()) < 0.004
    assert tracker.ends is not None
    assert np.linalg.norm(tracker.ends["left.end"].pose.position - ends_at(7)["left.end"].position) < 0.01
    tracker.update(np.empty((0, 3)), stamp=8 * STEP, ends={**ends_at(8), "left.end": cs.FreeEnd()})
    assert isinstance(tracker.ends["left.end"], cs.FreeEnd)


def test_a_harness_is_lost_and_found_again():
    tracker = cs.Tracker(KNOWN, noise=0.002, points=31)
    nowhere = tracker.update(np.empty((0, 3)), stamp=0)
    assert not nowhere.usable
    assert "Give ends" in nowhere.detail
    assert np.isnan(tracker.tube["left"].radius).all()
    true = cs.predict(TRUE, ends_at(0), points=31)
    tracker.update(seen_of(true, 0), stamp=STEP, ends=ends_at(0))
    assert not tracker.lost
    strays = np.random.default_rng(0).uniform((-0.2, -0.5, 0.3), (1.0, 0.6, 1.3), (300, 3))
    tracker.update(strays, stamp=2 * STEP, ends=ends_at(0))
    assert tracker.lost
    assert tracker.innovation == math.inf
    shape = tracker.update(seen_of(true, 1), stamp=3 * STEP, ends=ends_at(0))
    assert not tracker.lost
    assert max(off(shape, true).values()) < 0.004


def test_what_is_not_tracked_is_refused():
    with pytest.raises(cs.ArgumentError, match="it must be a Cable or a Harness"):
        cs.Tracker("harness.yaml")
    tracker = cs.Tracker(KNOWN)
    with pytest.raises(cs.ArgumentError, match="no look yet"):
        _ = tracker.tube
    with pytest.raises(cs.ArgumentError, match=r"trunk\.end"):
        tracker.update(np.empty((0, 3)), stamp=0, ends={"trunk.end": cs.Pose()})
    with pytest.raises(cs.ArgumentError, match="nothing holds the part"):
        tracker.predicted(stamp=0)
