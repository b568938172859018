"""A cable as capsules: they hold it, and what moves within the padding."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cable_shape as cs
from cable_shape.errors import ArgumentError
from cable_shape.messages.capsules import Capsules

CABLE = cs.Cable(1.2, 0.1, 0.01, 0.008)
START = cs.Pose((0, 0, 1), (0.5, 0.5, 0.5, 0.5))


def shape_at(x: float, z: float = 1.0, points: int = 150) -> cs.CableShape:
    return cs.predict(CABLE, START, cs.Pose((x, 0.1, z), START.quaternion), points=points)


def outside(positions: np.ndarray, capsules: Capsules) -> float:
    """Largest distance from the nearest axis [m], by brute force."""
    t = np.linspace(0.0, 1.0, 400)[:, None]
    axes = np.concatenate([(1 - t) * a + t * b for a, b in zip(capsules.points[:-1], capsules.points[1:], strict=True)])
    return float(np.linalg.norm(positions[:, None] - axes, axis=2).min(axis=1).max())


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.integers(1, 20), st.floats(0.2, 1.15), st.floats(0.6, 1.3), st.floats(0.0, 0.02))
def test_they_hold_the_cable(count, x, z, padding):
    shape, fine = (shape_at(x, z, points) for points in (60, 590))  # the finer one has points between the coarser's
    capsules = Capsules.around(shape, CABLE.diameter, count, padding)
    assert capsules.points.shape == (count + 1, 3)
    assert (capsules.points[[0, -1]] == shape.positions[[0, -1]]).all()
    reach = outside(fine.positions, capsules) + 0.5 * CABLE.diameter + padding
    assert reach <= capsules.radius + 1e-5
    assert capsules.hold(shape, CABLE.diameter)
    assert capsules.hold(shape, CABLE.diameter + 1.9 * padding)
    assert not capsules.hold(shape, CABLE.diameter + 2.0 * padding + 0.01)


def test_more_capsules_are_thinner_and_one_is_the_chord():
    shape = shape_at(0.7)
    radii = [Capsules.around(shape, CABLE.diameter, count).radius for count in (1, 2, 4, 8, 16)]
    assert (np.diff(radii) < 0.0).all()
    sag = np.ptp(shape.positions[:, 2])
    assert radii[0] == pytest.approx(sag + 0.5 * CABLE.diameter, rel=0.02)
    assert radii[-1] < 0.5 * CABLE.diameter + 0.01


def test_a_cable_that_moves_away_is_no_longer_held():
    capsules = Capsules.around(shape_at(0.7), CABLE.diameter, 8, padding=0.01)
    assert capsules.hold(shape_at(0.702), CABLE.diameter)
    assert not capsules.hold(shape_at(0.75), CABLE.diameter)


@pytest.mark.parametrize("count", [0, 65, 2.5, True])
def test_a_count_that_cannot_be(count):
    with pytest.raises(ArgumentError, match=r"capsules"):
        Capsules.around(shape_at(0.7), CABLE.diameter, count)
