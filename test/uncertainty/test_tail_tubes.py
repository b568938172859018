"""Tubes of tails: covariance and coverage against drawn samples, and clearance with them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.prediction.tails import Tail, held_frame
from cable_shape.uncertainty.uncertainty import Tube

ALONG_X = (0.5, 0.5, 0.5, 0.5)
LONG = {"start": 0.25, "end": 0.4}
POINTS = {"start": 38, "end": 60}
CABLE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004, tails=LONG)
START = cs.Grip(cs.Pose((0.0, 0.0, 1.0), ALONG_X), offset=cs.Pose((0.0, 0.02, 0.05)))
END = cs.Pose((0.75, 0.1, 1.05), ALONG_X)
KNOWN = cs.Uncertainty(
    {"bending_stiffness": 0.15, "length": 0.002, "rest_curvature": 0.1}, (0.001, 0.015), (0.0015, 0.01)
)


def moved(grip: cs.Grip, sample: np.ndarray) -> cs.Grip:
    """The gripper moved by (3,) and turned by the rotation vector (3,), world axes, about its own origin."""
    pose = grip.pose
    turned = Rotation.from_rotvec(sample[3:]) * Rotation.from_quat(pose.quaternion)
    return cs.Grip(cs.Pose(pose.position + sample[:3], turned.as_quat()), grip.kind, grip.offset)


def tail_tubes(ends, known: cs.Uncertainty = KNOWN) -> dict[str, Tube]:
    report = cs.Cycle(CABLE, model="cosserat", uncertainty=known).step({"cable": ends}, 0)
    return {side: report.tail_tubes["cable", side] for side in LONG}


def drawn(ends, count: int) -> dict[str, np.ndarray]:
    """(count, n, 3) positions by side, of cables and grips drawn at random, each predicted by itself."""
    rng = np.random.default_rng(11)
    lines: dict[str, list[np.ndarray]] = {side: [] for side in LONG}
    for _ in range(count):
        factor = math.exp(0.15 * rng.normal())
        changed = CABLE.replace(
            length=1.0 + 0.002 * rng.normal(),
            bending_stiffness=0.004 * factor,
            twisting_stiffness=CABLE.twisting_stiffness * factor,
            rest_curvature=(*(0.1 * rng.normal(size=2)), 0.0),
        )
        sizes = ((0.001, 0.015), (0.0015, 0.01))
        grips = {
            side: moved(grip, np.repeat(size, 3) * rng.normal(size=6))
            for side, grip, size in zip(LONG, ends, sizes, strict=True)
        }
        span = cs.Predictor(changed, model="cosserat", points=300)
        shape = None
        if any(grip.kind != "clamped" for grip in ends):
            shape = span.predict(grips["start"], grips["end"])
            assert shape.status is cs.Status.OK
        for side, grip in grips.items():
            frame = grip.cable_frame if shape is None else held_frame(grip, shape, side)
            lines[side].append(Tail(changed, side, LONG[side], own_points=POINTS[side]).predict(frame).positions.copy())
    return {side: np.array(found) for side, found in lines.items()}


@pytest.mark.parametrize("kind", ["clamped", "swivel", "pinned"])
def test_the_tube_of_a_tail_is_that_of_samples(kind: str) -> None:
    ends = START, cs.Grip(END, kind)
    tubes, lines = tail_tubes(ends), drawn(ends, 800 if kind == "clamped" else 500)
    for side, tube in tubes.items():
        off = lines[side] - lines[side].mean(axis=0)
        covariance = np.einsum("kni,knj->nij", off, off) / (len(off) - 1)
        np.testing.assert_allclose(tube.covariance, covariance, rtol=0.0, atol=0.15 * np.abs(covariance).max())
        off = lines[side] - tube.shape.positions
        along = np.einsum("kni,ni->kn", off, tube.shape.tangents)
        away = np.sqrt(np.maximum((off**2).sum(axis=2) - along**2, 0.0))
        inside = (away <= tube.radius).mean(axis=0)
        assert (inside > 0.92).all(), side
        assert (inside < 0.98).all(), side
        assert 0.93 < inside.mean() < 0.97, side


def test_the_free_end_of_a_tail_is_known_worst() -> None:
    tubes = tail_tubes((START, cs.Grip(END)), cs.Uncertainty(start=(0.0, 0.02), end=(0.001, 0.0)))
    root = tubes["end"].radius
    np.testing.assert_allclose(root, root[0], rtol=1e-6, err_msg="a shift moves the whole tail")
    assert root[0] == pytest.approx(0.001 * math.sqrt(-2.0 * math.log(0.05)), rel=1e-6)
    turned = tubes["start"].radius
    assert turned[-1] > 3.0 * turned[0] > 0.0
    arm = np.linalg.norm(START.cable_frame.position - START.pose.position)
    assert turned[0] < 0.02 * arm * 2.5


def test_clearance_of_a_tail_is_that_of_its_tube() -> None:
    ends = START, cs.Grip(END)
    tip = cs.Cycle(CABLE, model="cosserat").step({"cable": ends}, 0).tails["cable", "end"].positions[-1]
    scene = cs.Scene(obstacles=[cs.Obstacle("ball", cs.Sphere(0.01), cs.Pose(tip - (0.0, 0.0, 0.06)))])
    without = cs.Cycle(CABLE, scene=scene, model="cosserat").step({"cable": ends}, 0).clearance["cable"].closest
    report = cs.Cycle(CABLE, scene=scene, model="cosserat", uncertainty=KNOWN).step({"cable": ends}, 0)
    closest = report.clearance["cable"].closest
    assert closest.arc_length > CABLE.length
    lost = without.distance - closest.distance
    radius = report.tail_tubes["cable", "end"].radius
    assert 0.9 * radius.min() < lost <= radius.max() * (1.0 + 1e-9)
    again = cs.Cycle(CABLE, scene=scene, model="cosserat", uncertainty=KNOWN)
    for stamp in range(2):
        second = again.step({"cable": ends}, stamp)
    assert second.shapes["cable"].reused
    np.testing.assert_array_equal(second.tail_tubes["cable", "end"].radius, radius)


def test_a_free_end_leaves_the_other_tail_its_tube() -> None:
    cable = CABLE.replace(tails={"start": 0.2})
    report = cs.Cycle(cable, model="cosserat", uncertainty=KNOWN).step({"cable": (START, None)}, 0)
    assert set(report.tail_tubes) == {("cable", "start")}
