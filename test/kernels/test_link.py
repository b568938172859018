"""Pairs of knots that press on each other: second derivatives of the least distance, against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from cable_shape.kernels.contact import link
from cable_shape.kernels.contact.near import APART, NEAR, ON, TOWARD
from cable_shape.kernels.contact.pair_friction import RUBS
from cable_shape.kernels.contact.tables import Lying
from cable_shape.kernels.network.tables import L_BENT, LINK_MODEL

REACH, STEP, PUSH = 0.01, 0.002, 3.0


def pair(seed, *, stays=False):
    """Nodes 1 and 4 of two pieces of cable where they come nearest, in general position, as `Lying` and its arrays."""
    random = np.random.default_rng(seed)
    first, angle = Rotation.random(random_state=seed), random.uniform(0.5, 2.6)
    across = first.as_matrix()[:, 0]  # at right angles to both tangents
    second = Rotation.from_rotvec(angle * across) * first
    frames = [first, second * Rotation.from_rotvec((0.0, 0.0, random.uniform(0.0, 6.0)))]
    bends = [random.uniform(-8.0, 8.0, 3) for _ in range(2)]
    q, near = np.zeros((6, 4)), np.zeros((6, NEAR))
    for i, (frame, bend) in enumerate(zip(frames, bends, strict=True)):
        for side in (-1, 0, 1):
            q[3 * i + 1 + side] = (frame * Rotation.from_rotvec(side * STEP * bend)).as_quat()
    for k, sign in ((1, 1.0), (4, -1.0)):
        near[k, TOWARD : TOWARD + 3], near[k, APART] = sign * across, REACH
    empty = np.zeros((0, 0))
    lying = Lying(
        np.zeros(0, np.int64), empty, np.zeros(6), np.full(5, STEP), np.ones(6), np.ones(6), np.zeros(5), q, q[None],
        near[None], np.zeros((3, 6, ON), np.int64), empty, empty, empty, empty, empty, np.array((REACH,)),
        np.array(((1, 4, stays),)), np.zeros(6), np.zeros((3, 1, RUBS)),
    )  # fmt: skip
    return lying, q, near, frames, bends, across


def least_distance(z, frames, bends, across, *, stays=False):
    """[m], after turns and shifts z (12,) of both frames, along the curves of second order; or the second only."""
    curves = []
    for i, (frame, bend) in enumerate(zip(frames, bends, strict=True)):
        turned = frame * Rotation.from_rotvec(z[6 * i : 6 * i + 3])
        place = (0.5 if i == 0 else -0.5) * REACH * across + z[6 * i + 3 : 6 * i + 6]
        curves.append((place, turned.apply((0.0, 0.0, 1.0)), turned.apply((bend[1], -bend[0], 0.0))))

    def between(s):
        way = (0.0, s[1] / 1e3) if stays else s / 1e3
        a, b = (place + x * t + 0.5 * x * x * u for x, (place, t, u) in zip(way, curves, strict=True))
        return np.linalg.norm(a - b) / REACH

    found = minimize(between, np.zeros(2), method="BFGS", options={"gtol": 1e-12})
    return REACH * float(found.fun)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.booleans())
def test_second_derivative_is_that_of_the_least_distance(seed, stays):
    lying, q, near, frames, bends, across = pair(seed, stays=stays)
    ra, rb, w11, w12, w22 = link.slopes(lying, q, near, 0)
    assert max(abs(ra), abs(rb)) < 1e-12
    links = np.zeros((1, LINK_MODEL))
    link.fill_rows(links, 0, q, tuple(across), REACH, 1, 4)
    link.fill_bent(links, 0, tuple(across), REACH, PUSH, w11, w12, w22)
    told, at = np.zeros((12, 12)), L_BENT
    for x in range(4):
        for y in range(x, 4):
            block = links[0, at : at + 9].reshape(3, 3)
            told[3 * x : 3 * x + 3, 3 * y : 3 * y + 3] = block
            told[3 * y : 3 * y + 3, 3 * x : 3 * x + 3] = block.T
            at += 9
    random = np.random.default_rng(seed)
    scales = np.tile((1e-2, 1e-2, 1e-2, 1e-4, 1e-4, 1e-4), 2)
    for _ in range(6):
        way = scales * random.normal(size=12)
        ends = [least_distance(f * way, frames, bends, across, stays=stays) for f in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        wide, close = ends[0] - 2.0 * ends[2] + ends[4], 4.0 * (ends[1] - 2.0 * ends[2] + ends[3])
        change = -PUSH * (4.0 * close - wide) / 3.0  # without the fourth derivative (Richardson)
        assert way @ told @ way == pytest.approx(change, rel=2e-2, abs=3e-8)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3))
def test_a_pair_runs_to_the_nearest_points(seed, first, second):
    """Nodes a little off the nearest points tell the way back there."""
    lying, q, near, frames, bends, across = pair(seed)
    ends = []
    for i, (k, off) in enumerate(((1, first), (4, second))):
        turned = frames[i] * Rotation.from_rotvec(off * bends[i])
        q[k] = turned.as_quat()
        t, u = frames[i].apply((0.0, 0.0, 1.0)), frames[i].apply((bends[i][1], -bends[i][0], 0.0))
        ends.append((0.5 - i) * REACH * across + off * t + 0.5 * off * off * u)
    apart = ends[0] - ends[1]
    size = np.linalg.norm(apart)
    for k, sign in ((1, 1.0), (4, -1.0)):
        near[k, TOWARD : TOWARD + 3], near[k, APART] = sign * apart / size, size
    ra, rb, w11, w12, w22 = link.slopes(lying, q, near, 0)
    ways = -(w11 * ra + w12 * rb), -(w12 * ra + w22 * rb)
    assert ways == pytest.approx((-first, -second), abs=0.1 * max(abs(first), abs(second)) + 1e-12)
