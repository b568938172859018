"""Junctions that come down on a floor: none touches anything itself, a node beside it does."""

from __future__ import annotations

import numpy as np
import pytest
from harness_random import balance

import cable_shape as cs

ALONG = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
FLOOR = cs.Scene(obstacles=[cs.Obstacle("floor", cs.HalfSpace())], contact="solve")
SEEDS = range(12)
HEAVY = 0.05


def segment(rng):
    return cs.Cable(length=0.4, linear_density=0.05, bending_stiffness=10 ** rng.uniform(-3.5, -2.0), diameter=0.006)


def link(rng):
    """Two segments in a ball with a mass."""
    cable = segment(rng)
    joint = cs.Junction("joint", ("a.end", "b.start"), kind="ball", mass=HEAVY * rng.random())
    high = 0.05 + 0.1 * rng.random(2)
    ends = {"a.start": cs.Pose((0.0, 0.0, high[0]), ALONG), "b.end": cs.Pose((0.65, 0.0, high[1]), ALONG)}
    return cs.Harness({"a": cable, "b": cable}, [joint]), ends


def fork(rng):
    """Three segments in a ball, of which one is thicker."""
    cable = segment(rng)
    segments = {"stem": cable, "left": cable.replace(diameter=0.01), "right": cable}
    joint = cs.Junction("joint", ("stem.end", "left.start", "right.start"), kind="ball", mass=HEAVY * rng.random())
    high = 0.05 + 0.1 * rng.random(3)
    ends = {"stem.start": cs.Pose((0.0, 0.0, high[0]), ALONG)}
    for (name, side), z in zip((("left", 0.2), ("right", -0.2)), high[1:], strict=True):
        ends[f"{name}.end"] = cs.Pose((0.62 * rng.uniform(0.8, 1.0), side, z), ALONG)
    return cs.Harness(segments, [joint]), ends


def bend(rng):
    """Three segments in a rigid junction that is bent down."""
    cable = segment(rng)
    along = cs.Pose(quaternion=ALONG)
    frames = {}
    for name in ("left", "right"):
        half = 0.5 * rng.uniform(0.3, 0.9)
        frames[f"{name}.start"] = along.inverse() * cs.Pose(quaternion=(0.0, -np.sin(half), 0.0, np.cos(half))) * along
    joint = cs.Junction("joint", ("stem.end", *frames), frames=frames)
    harness, ends = fork(rng)
    return cs.Harness(dict.fromkeys(harness.segments, cable), [joint]), ends


def lowest(shape, harness):
    """[m], of what is lowest of any segment: its surface."""
    cables = harness.segments
    return min(one.positions[:, 2].min() - 0.5 * cables[name].diameter for name, one in shape.segments.items())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("make", [link, fork])
def test_it_rests_on_the_floor_found_from_nothing(make, seed):
    """In balance where its segments meet, and as a whole under what the floor pushes."""
    harness, ends = make(np.random.default_rng(seed))
    hanging = cs.predict(harness, ends)
    shape = cs.predict(harness, ends, scene=FLOOR)
    assert shape.status is cs.Status.OK, shape.detail
    if lowest(hanging, harness) < 0.0:
        assert sum(touch.force for one in shape.segments.values() for touch in one.contacts) > 0.0
    assert lowest(shape, harness) > -3e-5
    force, moment, gap = balance(shape)
    assert max(force, moment, gap) < 1e-9


def test_bent_junctions_often_do_too():
    """Where there is a shape it is in balance; half of them may have none."""
    lost = 0
    for seed in SEEDS:
        harness, ends = bend(np.random.default_rng(seed))
        shape = cs.predict(harness, ends, scene=FLOOR)
        lost += not shape.usable
        if shape.usable:
            assert lowest(shape, harness) > -3e-5
            assert max(balance(shape)) < 1e-9
    assert lost <= len(SEEDS) // 2


@pytest.mark.parametrize("seed", SEEDS)
def test_let_down_it_comes_to_the_same(seed):
    harness, ends = fork(np.random.default_rng(seed))
    predictor = cs.Predictor(harness, scene=FLOOR)
    for high in np.arange(0.3, -0.005, -0.01):
        up = np.array((0.0, 0.0, high))
        shape = predictor.predict({name: cs.Pose(pose.position + up, ALONG) for name, pose in ends.items()})
        assert shape.usable, shape.detail
        assert lowest(shape, harness) > -3e-5
    cold = cs.predict(harness, ends, scene=FLOOR)
    for name, one in shape.segments.items():
        apart = np.abs(one.positions - cold.segments[name].positions).max()
        assert apart < shape.error_estimate + cold.error_estimate
