"""Which points are of a line: the kernel against sums written out, and what no order of points may change."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import erf
from scipy.stats import norm

from cable_shape.kernels.distance import cloud
from cable_shape.kernels.distance.cloud import MISS, PLACE, SUMS, WEIGHT

LENGTH, OUTSIDE = 1.0, 0.3
RNG = np.random.default_rng(5)
LINE = np.cumsum(np.concatenate(([[0.0, 0.0, 0.0]], RNG.normal([0.03, 0.0, 0.0], 0.01, (30, 3)))), axis=0)
SPREAD = RNG.uniform(4e-5, 5e-5, 30)
POINTS = LINE[RNG.integers(0, 31, 60)] + RNG.normal(0.0, 0.02, (60, 3))


def assigned(points, pulled=(False, False), spread=SPREAD):
    sums, told = np.empty((len(LINE) + 1, SUMS)), np.empty(len(points))
    return cloud.assign(LINE, spread, points, LENGTH, OUTSIDE, pulled, sums, told), sums, told


def written_out(points, pulled=(False, False)):
    """The same, piece by piece and point by point, nothing left out."""
    pieces = len(LINE) - 1
    sums, whole, told = np.zeros((pieces + 2, SUMS)), 0.0, []
    for p in points:
        shares, rows = [], []
        for i in range(pieces):
            d = LINE[i + 1] - LINE[i]
            t = (p - LINE[i]) @ d / (d @ d)
            miss, s = p - LINE[i] - t * d, math.sqrt(SPREAD[i])
            h = np.linalg.norm(d)
            on = norm.cdf((1.0 - t) * h / s) - norm.cdf(-t * h / s)
            shares.append(on * math.exp(-0.5 * miss @ miss / s**2) / (2.0 * math.pi * s**2) / LENGTH)
            rows.append((i, min(1.0, max(0.0, t)), miss))
        for end, i, node in ((0, 0, 0), (1, pieces - 1, -1)):
            d = LINE[i + 1] - LINE[i]
            t = (p - LINE[i]) @ d / (d @ d)
            if pulled[end] and (t < 0.0 if end == 0 else t > 1.0):
                miss = p - LINE[node]
                shares.append(0.5 * math.exp(-0.5 * miss @ miss / SPREAD[i]) / (2.0 * math.pi * SPREAD[i]) / LENGTH)
                rows.append((pieces + end, float(end), miss))
        total = sum(shares) + OUTSIDE
        whole += math.log(total)
        told.append(sum(shares) / total)
        for share, (i, t, miss) in zip(shares, rows, strict=True):
            sums[i] += share / total * np.array((1.0, t, *miss))
    return whole, sums, np.array(told)


@pytest.mark.parametrize("pulled", [(False, False), (True, True)])
def test_sums_are_those_written_out(pulled):
    beyond = np.array((LINE[0] - 0.004, LINE[-1] + 0.004))
    points = np.concatenate((POINTS, beyond))
    found, expected = assigned(points, pulled), written_out(points, pulled)
    # what is more than 20 variances further away than the nearest piece is left out: exp(-10)
    assert found[0] == pytest.approx(expected[0], abs=2e-3)
    np.testing.assert_allclose(found[1], expected[1], atol=2e-3)
    np.testing.assert_allclose(found[2], expected[2], atol=2e-4)
    assert 5 < found[1][:, WEIGHT].sum() < 55  # some are of the line, some are not


def test_a_point_on_the_line_is_of_it_and_one_far_away_is_not():
    middle = 0.5 * (LINE[10] + LINE[11])
    _, sums, told = assigned(np.array((middle, middle + 0.5)))
    assert told[0] > 0.999
    assert told[1] == 0.0
    assert sums[10, PLACE] / sums[10, WEIGHT] == pytest.approx(0.5)
    assert np.abs(sums[10, MISS:]).max() < 1e-12


def test_a_point_beyond_an_end_pulls_only_where_it_may():
    beyond = (LINE[0] - 0.5 * (LINE[1] - LINE[0]))[None]
    without, pulled = assigned(beyond)[1], assigned(beyond, (True, False))[1]
    assert without[-2:, WEIGHT].sum() == 0.0
    assert pulled[-2, WEIGHT] > 0.0
    np.testing.assert_allclose(pulled[-2, MISS:] / pulled[-2, WEIGHT], (beyond - LINE[0])[0])


def test_pieces_without_spread_are_none():
    spread = SPREAD.copy()
    spread[10] = 0.0
    _, sums, told = assigned(np.array((0.5 * (LINE[10] + LINE[11]),)), spread=spread)
    assert sums[10, WEIGHT] == 0.0
    assert math.isfinite(told[0])


def test_the_order_of_points_is_of_no_account():
    order = RNG.permutation(len(POINTS))
    one, other = assigned(POINTS), assigned(POINTS[order])
    assert one[0] == pytest.approx(other[0], rel=1e-12)
    np.testing.assert_allclose(one[1], other[1], atol=1e-12)
    np.testing.assert_array_equal(one[2][order], other[2])


def test_shares_of_pieces_that_follow_each_other_add_up():
    """Along a straight line a point is of all its pieces together as if they were one."""
    straight = np.linspace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 11)
    sums, told, v = np.empty((12, SUMS)), np.empty(1), 4e-4
    found = cloud.assign(
        straight, np.full(10, v), np.array([[0.5, 0.01, 0.0]]), LENGTH, OUTSIDE, (False, False), sums, told
    )
    whole = math.exp(-0.5 * 1e-4 / v) / (2.0 * math.pi * v) * erf(0.5 / math.sqrt(2.0 * v))
    assert found == pytest.approx(math.log(whole + OUTSIDE), rel=1e-4)
