"""The smooth surface over many spheres: exact of a plane, derivatives by differences."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.kernels.distance.spheres import spheres_point
from cable_shape.kernels.distance.triangles import STACK_SIZE
from cable_shape.scene.body_tables import body_tables

STACK = np.empty(STACK_SIZE, np.int64)
RANDOM = np.random.default_rng(5)


def surface_of(solid, radius):
    """The smooth surface that a cable of this radius lies on, and the exact one, as functions of a point."""
    table, centres, nodes = body_tables([cs.Obstacle("scan", solid)], (), frozenset())
    exact = table[0].copy()
    table[0, 18] = table[0, 14] + radius
    return (
        lambda p: spheres_point(table[0], centres, nodes, *p, True, STACK),
        lambda p: spheres_point(exact, centres, nodes, *p, True, STACK),
        float(table[0, 19]),
    )


@pytest.mark.parametrize(
    ("spacing", "radius", "thick", "most"), [(2e-3, 5e-3, 4e-3, 2e-7), (5e-3, 5e-3, 4e-3, 4e-6), (5e-3, 1e-2, 0, 2e-6)]
)
def test_over_a_plane_it_is_one(spacing, radius, thick, most):
    smooth, exact, apart = surface_of(cs.HeightField(np.zeros((61, 61)), spacing, radius), thick)
    assert apart == pytest.approx(spacing)
    points = RANDOM.uniform(-4 * spacing, 4 * spacing, (500, 3))
    points[:, 2] = RANDOM.uniform(0.5 * thick, 1.5 * thick + 1e-3, 500)
    off = np.array([smooth(p)[0] - p[2] for p in points])
    dents = np.array([exact(p)[0] - p[2] for p in points])
    assert np.abs(off).max() < 10.0 * most  # half way in as well
    tilt = max(np.hypot(*smooth(p)[1:3]) for p in points)
    assert tilt < 2.0 * np.pi / spacing * 10.0 * most  # that of a wave of this height from point to point
    touching = np.array([(*p[:2], thick) for p in points])
    assert max(abs(smooth(p)[0] - p[2]) for p in touching) < most
    assert dents.max() > 100.0 * most


def test_its_derivatives_are_those_of_differences():
    """Along the surface; across it the gradient is taken to be of length one, which it is over a plane."""
    k = np.arange(3000) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * k / 3000), np.pi * (1.0 + np.sqrt(5.0)) * k
    points = 0.05 * np.stack((np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)), axis=1)
    smooth, _, apart = surface_of(cs.Points(points, 0.005), 0.004)
    step = 1e-7
    for _ in range(50):
        p = RANDOM.normal(size=3)
        p *= 0.059 / np.linalg.norm(p)
        d, *n, H = smooth(p)
        assert d == pytest.approx(0.004, abs=0.05 * apart)
        n, H = np.array(n), np.array(H).reshape(3, 3)
        both = [[smooth(p + sign * step * axis) for sign in (1.0, -1.0)] for axis in np.eye(3)]
        slope = np.array([(ahead[0] - behind[0]) / (2.0 * step) for ahead, behind in both])
        turn = np.array([np.subtract(ahead[1:4], behind[1:4]) / (2.0 * step) for ahead, behind in both])
        assert slope == pytest.approx(np.linalg.norm(slope) * n, abs=1e-6)
        assert np.linalg.norm(slope) == pytest.approx(1.0, abs=0.05)
        along = np.eye(3) - np.outer(n, n)
        assert pytest.approx(along @ turn @ along, abs=1e-5 * np.abs(H).max()) == H
        assert H @ n == pytest.approx(np.zeros(3), abs=1e-9)


def test_of_one_point_and_in_the_middle_of_some_it_is_finite():
    smooth, exact, apart = surface_of(cs.Points([(0, 0, 0)], 0.02), 0.004)
    assert apart == 0.0
    assert exact((0.0, 0.03, 0.0))[:4] == pytest.approx((0.01, 0, 1, 0))
    assert exact((0.0, 0.0, 0.0))[0] == -0.02
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    smooth, *_ = surface_of(cs.Points(0.01 * np.array(corners), 0.02), 0.004)
    assert np.isfinite(np.hstack(smooth((0.0, 0.0, 0.0)))).all()
