"""Planes of bodies between the nodes of a network that moves against drag: no edge gets through an element unseen."""

from __future__ import annotations

import numpy as np
import pytest
from scene_certificate import distances, outward

import cable_shape as cs
from cable_shape.kernels.contact.between import guard_between
from cable_shape.kernels.contact.points import GAP, on_curve
from cable_shape.kernels.network import props
from cable_shape.kernels.network.motion import N_PROPS, PROPS
from cable_shape.kernels.network.tables import NOW
from cable_shape.solve.touching.bodies import TouchBodies

RADIUS, REACH, NEARER = 0.004, 0.1, 1e-4


def guarded(settling, solid, pose):
    """Points between nodes, and the least gap told [m]."""
    bodies = TouchBodies()
    bodies.take((cs.Obstacle("it", solid, pose),), frozenset(), None, RADIUS, {})
    one = np.ones(len(settling.places))
    kernel = bodies.kernel._replace(then=bodies.frames)
    _, cosine, gap = guard_between(
        settling.ints, settling.floats, settling.sols, settling.moving, kernel, RADIUS * one, one, REACH, NEARER
    )
    assert cosine == 1.0
    return settling.motion.props[: int(settling.motion.par[N_PROPS])].copy(), gap


@pytest.mark.parametrize("seed", range(40))
def test_what_an_edge_is_nearest_to_between_two_nodes_has_a_plane_with_the_body_behind(settling, seed):
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=4)
    k = int(rng.integers(5, len(settling.places) - 5))
    place = 0.5 * (settling.places[k] + settling.places[k + 1]) + 0.01 * rng.normal(size=3)
    solid = cs.Box((0.3, 0.002, 0.02)) if rng.random() < 0.7 else cs.Cylinder(0.002, 0.2)
    pose = cs.Pose(place, turn / np.linalg.norm(turn))
    settling.motion.par[N_PROPS] = 0.0
    points, told = guarded(settling, solid, pose)
    x, y, z, w = settling.solution(NOW).q.T
    tangents = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
    least = []
    for e, h in enumerate(settling.model.h):
        a, b = settling.places[e : e + 2]
        line = np.array([on_curve.py_func(h, x, a, b, *tangents[e : e + 2]) for x in np.linspace(0.0, 1.0, 101)])
        gaps = distances(solid, pose, line) - RADIUS
        own = points[points[:, props.ELEMENT] == e]
        least += own[:, GAP].tolist()
        if gaps.min() < -0.5 * RADIUS:  # all but through the body
            continue
        for point in own:
            assert point[GAP] == pytest.approx(gaps.min(), abs=1e-4)
            n = point[props.NORMAL : props.NORMAL + 3]
            assert n @ line[round(100 * point[props.SHARE])] - point[props.LEVEL] == pytest.approx(point[GAP], abs=2e-4)
        ends, far = (a, b), (gaps[0], gaps[-1])
        faced = [outward(solid, pose, ends[i]) @ (ends[1 - i] - ends[i]) + far[i] > -NEARER for i in (0, 1)]
        if gaps.min() < min(gaps[0], gaps[-1], REACH) - 2.0 * NEARER and not any(faced) and len(points) < PROPS:
            assert len(own) == 1, (e, gaps.min())
    assert told == min(least, default=np.inf)


def test_between_two_nodes_on_one_face_there_is_no_plane(settling):
    low = settling.places[:, 2].argmin()
    pose = cs.Pose((*settling.places[low, :2], settling.places[low, 2] - RADIUS + 1e-3), (0, 0, 0, 1))
    points, gap = guarded(settling, cs.HalfSpace(), pose)
    assert not len(points)
    assert gap == np.inf
