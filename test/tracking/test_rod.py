"""What is not known of a cable, and how the rod answers it: against differences, and the exponential of a matrix."""

from __future__ import annotations

import numpy as np
import pytest
from clouds import CABLE, END, START
from scipy.linalg import expm

import cable_shape as cs
from cable_shape.tracking.rod import Rod
from cable_shape.tracking.swing import DAMPED, swung
from cable_shape.tracking.unknown import Unknown

KNOWN = cs.Uncertainty({"bending_stiffness": 0.3, "length": 0.01}, (0.003, 0.05), (0.003, 0.05))


@pytest.mark.parametrize(
    ("cable", "end"),
    [
        (CABLE, cs.Grip(END)),
        (CABLE, cs.Grip(END, kind="swivel", offset=cs.Pose((0.01, 0.0, 0.03)))),
        (CABLE.replace(rest_curvature=[[0.0, 0.5, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.2]]), cs.Grip(END)),
        (CABLE, cs.FreeEnd()),
        (CABLE.replace(sections=[cs.Section(0.3, 0.6, linear_density=0.2, bending_stiffness=0.01)]), cs.Grip(END)),
    ],
)
def test_moves_are_those_of_shapes_beside(cable, end):
    unknown = Unknown(cable, KNOWN, 5, 0.0 if cable.sections else 1.0)
    rod = Rod(cable, unknown, points=31, tolerance=1e-9)
    ends, rng = {"start": cs.Grip(START), "end": end}, np.random.default_rng(3)
    z = 0.5 * rng.normal(size=unknown.size) * np.sqrt(np.diag(unknown.covariance(1.0)))
    assert rod.solve(z, ends).status
    moves = rod.moves()
    assert not moves[:, :, unknown.rates].any()
    for j in range(unknown.rates.start):
        step = np.zeros(unknown.size)
        step[j] = 1e-5 if j < 12 else 1e-3
        above, below = rod.solve(z + step, ends).positions, rod.solve(z - step, ends).positions
        beside = (above - below) / (2.0 * step[j])
        scale = np.abs(beside).max()
        if scale < 1e-7:
            assert np.abs(moves[:, :, j]).max() < 1e-6
        else:
            assert np.abs(moves[:, :, j] - beside).max() < 1e-3 * scale, j


def test_what_a_calibration_found_is_where_it_belongs():
    names = {"start_offset": 0.001, "start_tilt": 0.02, "end_tilt": 0.03, "roll": 0.04, "drag": 1.0, "length": 0.002}
    unknown = Unknown(CABLE, cs.Uncertainty(names), 5, 0.0)
    assert unknown.parameters is not None
    assert unknown.parameters.names == ("length",)
    spread = np.sqrt(np.diag(unknown.first))
    np.testing.assert_allclose(spread[:6], (0.001, 0.001, 0.001, 0.02, 0.02, 0.0))
    np.testing.assert_allclose(spread[6:13], (0.0, 0.0, 0.0, 0.03, 0.03, 0.04, 0.002))


def test_a_swing_goes_on_as_its_equation_says():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(9, 9))
    masses = np.array((9.0, 0.4, 1.0, 2.0, 9.0))  # those of the ends count for nothing
    weights = np.repeat(masses[1:4], 3)
    own = 0.01 * (root @ root.T / 9.0 + 0.3 * np.eye(9)) * weights
    gives = np.zeros((5, 3, 5, 3))
    gives[1:4, :, 1:4, :] = own.reshape(3, 3, 3, 3)
    forced = rng.normal(size=(5, 3))
    change, added, goal = swung(0.03, 0.8, gives, forced, np.arange(1, 4), masses)
    stiff = np.linalg.inv(own)
    roots = np.sqrt(weights)
    values, vectors = np.linalg.eigh(roots[:, None] * stiff / roots)
    damp = 2.0 * DAMPED * ((vectors * np.sqrt(values)) @ vectors.T) * roots / roots[:, None]
    matrix = np.block([[np.zeros((9, 9)), np.eye(9)], [-stiff, -damp]])
    inner = [*range(3, 12), *range(18, 27)]
    np.testing.assert_allclose(change[np.ix_(inner, inner)], expm(0.03 * matrix), atol=1e-10)
    np.testing.assert_array_equal(goal[:15], forced.ravel())
    # in the long run it spreads by so much, whatever the step
    long = np.zeros((18, 18))
    share = np.diag(weights.mean() / weights)  # a lighter place swings further
    long[:9, :9], long[9:, 9:] = 0.64 * share, 0.64 * stiff @ share
    step = change[np.ix_(inner, inner)]
    np.testing.assert_allclose(step @ long @ step.T + added[np.ix_(inner, inner)], long, atol=1e-9 * long.max())
    assert np.linalg.eigvalsh(added).min() > -1e-9 * long.max()
