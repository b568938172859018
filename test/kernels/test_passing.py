"""Cables that go through each other on the straight way: counted as numpy does it by itself, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scene_certificate import crossings as counted_by_numpy

from cable_shape.kernels.distance.passing import CROSSING, MOST_CROSSINGS, crossings
from cable_shape.solve.touching.places import came_through


def counted(*lines, apart=0):
    """Rows of crossings."""
    out = np.empty((MOST_CROSSINGS, CROSSING))
    return out[: crossings(*lines, apart, out)]


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


def loop(height):
    """(61, 3), a line that comes back over, or under, its own beginning."""
    turn = np.linspace(-0.5, 2.0 * np.pi + 0.5, 61)
    return np.stack((turn * 0.05 + np.sin(turn), 1.0 - np.cos(turn), height * turn), axis=1)


def test_a_line_that_comes_through_itself_crosses_there_once():
    over, under = loop(0.1), loop(-0.1)
    (row,) = counted(over, under, over, under, apart=6)
    (back,) = counted(under, over, under, over, apart=6)
    assert back[1] == -row[1]
    assert row[0] == pytest.approx(0.5, abs=1e-6)
    assert row[3] - row[2] > 30.0
    raised = over + np.array((0.0, 0.0, 1.0))
    assert counted(over, raised, over, raised, apart=6).size == 0
    assert len(came_through([(np.arange(61.0), over)] * 2, [under] * 2, 1.5, np.zeros((2, 2)), own=True)) == 1


def test_a_line_must_have_come_through_unless_it_went_back_or_off_an_end():
    arcs, y = np.linspace(0.0, 2.0, 41), np.linspace(-1.0, 1.0, 41)
    bar, across = line((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 41), np.stack((0.3 + 0.0 * y, y, 0.1 + 0.0 * y), axis=1)
    hairpin = np.stack((0.1 * np.sign(y), 0.7 - 1.5 * np.abs(y), 0.1 + 0.0 * y), axis=1)
    down = np.array((0.0, 0.0, -0.2))

    def through(above, reach=0.05):
        return came_through([(arcs, bar), (arcs, above)], [bar, above + down], reach, np.zeros((2, 2)), own=False)

    ((time, _, on_bar, on_line),) = through(across)
    assert (time, on_bar, on_line) == pytest.approx((0.5, 1.3, 1.0), abs=1e-6)
    assert not len(through(across, reach=0.5))  # it is so thick that its end may slip off there
    assert not len(through(hairpin))  # both legs: it may as well be pulled out
    assert len(counted(bar, bar, hairpin, hairpin + down)) == 2
