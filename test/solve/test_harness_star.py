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


def _moved():
    """Three arms in a rigid junction, and 200 places of their ends, of which one moves by 2 mm each time."""
    cable = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
    down, along = cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0)), cs.Pose(quaternion=(0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)))
    ends, frames = {"a.start": down}, {}
    for name, turn in (("b", 0.0), ("c", np.pi)):
        out = cs.Pose(quaternion=(0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn))) * along
        frames[f"{name}.start"] = down.inverse() * out
        ends[f"{name}.end"] = cs.Pose((out * cs.Pose((0.0, 0.0, 0.45))).position - (0.0, 0.0, 0.45), out.quaternion)
    joint = cs.Junction("fork", ("a.end", *frames), frames=frames)
    x, y = 0.01 * (1.0 + np.sin(0.11 * np.arange(200))), 0.02 * np.cos(0.13 * np.arange(200))
    moved = [cs.Pose(ends["b.end"].position + way, along.quaternion) for way in np.stack((x, y, 0.5 * x), axis=1)]
    return cs.Harness({"a": cable, "b": cable, "c": cable}, [joint]), [{**ends, "b.end": pose} for pose in moved]


def test_what_moves_is_within_its_estimates():
    """Also where the last step and the correction were made with the factors of the one before."""
    harness, moved = _moved()
    coarse, fine = cs.Predictor(harness, points=31), cs.Predictor(harness, points=31, tolerance=1e-9)
    above = 0
    for ends in moved:
        shape, true = coarse.predict(ends), fine.predict(ends)
        off = max(
            np.linalg.norm(one.positions - other.positions, axis=1).max()
            for one, other in zip(shape.segments.values(), true.segments.values(), strict=True)
        )
        assert off < coarse.problem.tolerance
        above += off > shape.error_estimate
    assert above <= 0.01 * len(moved)
