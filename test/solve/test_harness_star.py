"""Harnesses of three arms against collocation of the coupled problem, which shares no code with the solver."""

from __future__ import annotations

import numpy as np
import pytest
import stars

import cable_shape as cs


@pytest.mark.parametrize(("free", "couple"), stars.CASES)
def test_three_arms_are_what_collocation_finds(free, couple):
    """To a millionth of the length, forces and moments to that of EI / L^2 and EI / L; within its own estimates."""
    harness, ends = stars.harness(free, couple)
    found = stars.solved(free, couple)
    for tolerance, share, unit in ((1e-9, 1e-8, 1e-6), (1e-6, 1e-6, 1e-3)):
        shape = cs.predict(harness, ends, points=161, tolerance=tolerance)
        assert shape.status is cs.Status.OK
        for one, arm, stiffness in zip(shape.segments.values(), found, stars.STIFFNESS, strict=True):
            step, bend = (one.points - 1) // (stars.POINTS - 1), stiffness[0]
            off = np.linalg.norm(one.positions[::step] - arm.positions, axis=1).max()
            assert off <= min(max(share * one.length, shape.error_estimate), 1e-6 * one.length)
            assert np.abs(one.force[::step] - arm.forces).max() <= unit * bend / one.length**2 * 100.0
            assert np.abs(one.moment[::step] - arm.moments).max() <= unit * bend / one.length * 10.0
