"""Cables in contact against the planar elastica, solved as an initial value problem by scipy with its contacts unknown.

With the tangent (cos th, sin th) in the x-z plane: th' = M / EI, M' = sin th n_x - cos th n_z, n' = (0, w).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

import cable_shape as cs

Array = NDArray[np.float64]
RADIUS = 0.002


def heading(angle):
    """(4,) of a cable frame that points there in the x-z plane, d2 along y: it bends there by the second stiffness."""
    along, across = np.array((math.cos(angle), 0.0, math.sin(angle))), np.array((0.0, 1.0, 0.0))
    return Rotation.from_matrix(np.stack((np.cross(across, along), across, along), axis=1)).as_quat()


def piece(start, end, begin, stiffness, weight):
    """The elastica from one arc length [m] to another; begin: x, z, th, M, n_x, n_z."""

    def slopes(_, y):
        x, z = math.cos(y[2]), math.sin(y[2])
        return x, z, y[3] / stiffness, z * y[4] - x * y[5], 0.0, weight

    return solve_ivp(slopes, (start, end), begin, rtol=1e-11, atol=1e-13, dense_output=True)


def begins(shape):
    """Moment and forces of a shape at its start, as `piece` has them."""
    return -shape.moment[0, 1], shape.force[0, 0], shape.force[0, 2]


@pytest.mark.parametrize(("stiffness", "height", "angle"), [(0.005, 0.3, 0.0), (0.005, 0.3, -0.6), (0.02, 0.2, 0.3)])
def test_a_heavy_elastica_meets_its_table_where_its_equation_has_it(stiffness, height, angle):
    """From its grip it hangs down to where it lies flat and without moment, and a free end leaves no force along."""
    weight, length = 0.1 * 9.81, 1.0
    cable = cs.Cable(length, 0.1, stiffness, diameter=2.0 * RADIUS)
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    start = cs.Pose((0.0, 0.0, height + RADIUS), heading(angle))
    shape = cs.predict(cable, start, None, scene=scene, model="cosserat", points=501)
    assert shape.status is cs.Status.OK

    def hangs(down, moment, force):
        return piece(0.0, down, (0.0, height, angle, moment, 0.0, force), stiffness, weight)

    def amiss(unknown):
        return hangs(*unknown).y[1:4, -1]

    moment, _, force = begins(shape)
    found = root(amiss, (shape.contacts[0].arc_length, moment, force), tol=1e-12)
    assert found.success
    down = found.x[0]
    exact = hangs(*found.x)
    assert exact.y[1].min() > -1e-9
    places = exact.sol(np.minimum(shape.arc_length, down))
    x = places[0] + np.maximum(shape.arc_length - down, 0.0)
    off = np.hypot(shape.positions[:, 0] - x, shape.positions[:, 2] - RADIUS - places[1])
    assert off.max() < 1e-4 * length
    assert off.mean() < shape.error_estimate
    assert (
        abs(force - found.x[2]) < 1e-4 * weight * length
    )  # the grip carries what hangs, but for what the edge carries
    assert abs(moment - found.x[1]) < 1e-4 * weight * length**2
    touches = [np.interp(down, shape.arc_length, column) for column in shape.positions[:, ::2].T]
    assert np.abs(touches - (exact.y[:2, -1] + (0.0, RADIUS))).max() < 1e-4 * length
    assert abs(shape.contacts[0].arc_length - down) < 5e-3 * length  # it is a node


def pressed(start, end, length, stiffness, unknown):
    """What is amiss with an elastica that touches a wall on the left, then a floor, and its three pieces."""
    moment, x, z, wall, push, floor, lift = unknown
    first = piece(0.0, wall, (*start, moment, x, z), stiffness, 0.0)
    turned = first.y[:, -1] - (0.0, 0.0, 0.0, 0.0, push, 0.0)
    second = piece(wall, floor, turned, stiffness, 0.0)
    lifted = second.y[:, -1] - (0.0, 0.0, 0.0, 0.0, 0.0, lift)
    last = piece(floor, length, lifted, stiffness, 0.0)
    upright, flat = turned[[0, 2]] - (RADIUS, -0.5 * math.pi), lifted[1:3] - (RADIUS, 0.0)
    return np.concatenate((upright, flat, last.y[:3, -1] - end)), (first, second, last)


@pytest.mark.parametrize(("down", "out"), [(0.31, 0.31), (0.31, 0.305), (0.308, 0.312)])
def test_a_strip_pressed_into_a_corner_is_the_elastica_with_two_contacts(down, out):
    """Its push on both walls, where it touches them, and all of its shape."""
    length, stiffness = 0.6, 0.01
    strip = cs.Cable(length, 0.0, (20.0 * stiffness, stiffness), 20.0 * stiffness, diameter=2.0 * RADIUS)
    upright = cs.Pose((0.0, 0.0, 0.0), Rotation.from_euler("y", 90.0, degrees=True).as_quat())
    walls = [cs.Obstacle("floor", cs.HalfSpace()), cs.Obstacle("wall", cs.HalfSpace(), upright)]
    scene = cs.Scene(obstacles=walls, contact="solve")
    predictor = cs.Predictor(strip, scene=scene, model="cosserat", gravity=(0.0, 0.0, 0.0), points=301)
    start, end = (0.05, down, -0.5 * math.pi), (out, 0.05, 0.0)
    for away in np.linspace(0.15, 0.0, 16):
        shape = predictor.predict(*(cs.Pose((x + away, 0.0, z + away), heading(angle)) for x, z, angle in (start, end)))
        assert shape.usable
    assert shape.status is cs.Status.OK
    assert np.abs(shape.positions[:, 1]).max() < 1e-9
    pushes = {name: shape.presses(name).sum() for name in ("wall", "floor")}
    at = {name: np.mean([contact.arc_length for contact in shape.contacts if contact.body == name]) for name in pushes}
    guess = (*begins(shape), at["wall"], pushes["wall"], at["floor"], pushes["floor"])
    found = root(lambda u: pressed(start, end, length, stiffness, u)[0], guess, tol=1e-11)
    assert found.success
    pieces = pressed(start, end, length, stiffness, found.x)[1]
    assert found.x[[4, 6]] == pytest.approx((pushes["wall"], pushes["floor"]), rel=2e-3)
    assert found.x[[3, 5]] == pytest.approx((at["wall"], at["floor"]), abs=1e-4 * length)
    bounds = found.x[3], found.x[5]
    exact = np.array([pieces[np.searchsorted(bounds, s)].sol(s)[:2] for s in shape.arc_length])
    assert exact.min() > RADIUS - 1e-6  # touches nowhere else
    off = np.linalg.norm(shape.positions[:, ::2] - exact, axis=1).max()
    assert off < max(2.0 * shape.error_estimate, 2e-5 * length)
