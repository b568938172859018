"""Cables that go through each other on the straight way: counted as numpy does it by itself, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scene_certificate import crossings as counted_by_numpy

from cable_shape.kernels.distance.passing import CROSSING, MOST_CROSSINGS, crossings


def counted(*lines):
    """Rows of crossings."""
    out = np.empty((MOST_CROSSINGS, CROSSING))
    return out[: crossings(*lines, out)]


def line(start, end, count):
    """(count, 3)"""
    return np.linspace(start, end, count)


@pytest.mark.parametrize("count", [2, 11, 12, 40])
def test_a_line_let_down_through_another_crosses_it_once_in_its_middle(count):
    a = line((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), count)
    above, below = (line((0.0, -1.0, z), (0.0, 1.0, z), count) for z in (0.1, -0.3))
    (row,) = counted(a, a, above, below)
    middle = 0.5 * (count - 1)
    assert row == pytest.approx((0.25, row[1], middle, middle), abs=1e-6 * count)
    (back,) = counted(a, a, below, above)
    assert back[1] == -row[1]
    assert abs(row[1]) == 1.0
    assert counted(a, a, above, above).size == 0
    assert counted(a, a - (0.0, 0.0, 0.4), above, below).size == 0  # the other one goes along


def test_random_lines_cross_as_numpy_has_it():
    rng = np.random.default_rng(0)
    sums = []
    for _ in range(60):
        lines = [np.cumsum(rng.normal(size=(20, 3)) * 0.3, axis=0) for _ in range(4)]
        rows = counted(*lines)
        assert len(rows) < MOST_CROSSINGS
        sums.append(int(rows[:, 1].sum()))
        assert sums[-1] == sum(counted_by_numpy(*lines))
    assert len(set(sums)) > 2
