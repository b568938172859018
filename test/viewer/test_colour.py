"""The colours of a cable in the viewer, and the distances that they show."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reports import (
    CABLE,
    POINTS,
    RADIUS,
    TRIANGLE,
    arc,
)

from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose
from cable_shape.scene.scene import Box, Capsule, Cylinder, HalfSpace, Obstacle, Scene, Sphere
from cable_shape.viewer.colour import by_clearance, by_curvature, check_colouring, scale, surface_distance


def solids() -> st.SearchStrategy[tuple[object, np.ndarray, np.ndarray]]:
    """(solid, a point of its surface, the unit normal there) in the solid's frame, edges and rims included."""
    size = st.floats(0.01, 1.0)
    unit = st.floats(0.0, 1.0)
    turn = st.floats(-math.pi, math.pi)

    def direction(a: float, b: float) -> np.ndarray:
        return np.array((math.cos(a) * math.sin(b), math.sin(a) * math.sin(b), math.cos(b)))

    def box(x: float, y: float, z: float, u: float, v: float, b: float) -> tuple[object, np.ndarray, np.ndarray]:
        # an edge along z at +x +y: every normal between the two faces' normals belongs to it
        b = 0.5 * math.pi * (b / math.pi * 0.5 + 0.5)
        point = np.array((0.5 * x, 0.5 * y, (u - 0.5) * z))
        if v < 0.5:  # or inside the face +x
            return Box(np.array((x, y, z))), point * (1, 2 * v - 0.5, 1), np.array((1.0, 0.0, 0.0))
        return Box(np.array((x, y, z))), point, np.array((math.cos(b), math.sin(b), 0.0))

    def cylinder(r: float, h: float, a: float, u: float, v: float) -> tuple[object, np.ndarray, np.ndarray]:
        out = np.array((math.cos(a), math.sin(a), 0.0))
        if u < 0.4:
            return Cylinder(r, h), out * r + (0, 0, (v - 0.5) * h), out
        if u < 0.7:
            return Cylinder(r, h), out * r * v + (0, 0, 0.5 * h), np.array((0.0, 0.0, 1.0))
        tilt = 0.5 * math.pi * v
        return Cylinder(r, h), out * r + (0, 0, 0.5 * h), out * math.cos(tilt) + np.array((0, 0, math.sin(tilt)))

    def capsule(r: float, h: float, a: float, b: float) -> tuple[object, np.ndarray, np.ndarray]:
        n = direction(a, b)
        return Capsule(r, h), r * n + (0, 0, math.copysign(0.5 * h, n[2])), n

    return st.one_of(
        st.builds(lambda r, a, b: (Sphere(r), r * direction(a, b), direction(a, b)), size, turn, turn),
        st.builds(box, size, size, size, unit, unit, turn),
        st.builds(cylinder, size, size, turn, unit, unit),
        st.builds(capsule, size, size, turn, turn),
        st.builds(lambda x, y: (HalfSpace(), np.array((x, y, 0.0)), np.array((0.0, 0.0, 1.0))), size, size),
    )


@settings(derandomize=True, deadline=None, max_examples=200)
@given(solids(), st.floats(0.0, 2.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_surface_distance_along_the_normal(
    case: tuple[object, np.ndarray, np.ndarray], height: float, a: float, b: float
) -> None:
    """A point `height` above the surface of a convex solid, along its normal, is exactly that far from it."""
    solid, point, normal = case
    q = np.array((math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), 0.0, math.cos(a)))
    pose = Pose((a, b, 1.0), q)
    world = (pose * Pose(point + height * normal)).position
    assert surface_distance(solid, pose, world[None])[0] == pytest.approx(height, abs=1e-9)


def test_surface_distance_is_negative_inside() -> None:
    centre = np.zeros((1, 3))
    assert surface_distance(Box(np.array((0.2, 0.4, 0.6))), Pose(), centre)[0] == pytest.approx(-0.1)
    assert surface_distance(Cylinder(0.3, 0.2), Pose(), centre)[0] == pytest.approx(-0.1)
    assert surface_distance(Sphere(0.3), Pose(), centre)[0] == pytest.approx(-0.3)
    assert math.isinf(surface_distance(TRIANGLE, Pose(), centre)[0])


def test_colours() -> None:
    assert scale(np.array((-1.0, 0.0, 2.0)))[:, :3].tolist() == [[38, 198, 218], [38, 198, 218], [244, 54, 76]]
    np.testing.assert_allclose(by_curvature(CABLE, arc()), 0.2 / RADIUS)
    scene = Scene((Obstacle("table", HalfSpace()),), warn_distance=0.03, error_distance=0.01)
    # the cable's lowest point, its end, is at height - RADIUS; its surface half a diameter lower
    fraction = by_clearance(CABLE, arc(RADIUS + 0.05 + 0.5 * CABLE.diameter), scene, (), None)
    assert fraction[-1] == pytest.approx((0.09 - 0.05) / (0.09 - 0.01))
    assert fraction[0] == 0.0
    body = Obstacle("arm", Sphere(0.01), link="arm")
    middle = Pose(arc().positions[POINTS // 2])
    near = by_clearance(CABLE, arc(), Scene(), (body,), {"arm": middle})
    assert near.max() == 1.0
    gripper = by_clearance(CABLE, arc(), Scene(), (body,), {"arm": Pose(arc().positions[0])})
    assert gripper.max() == 0.0
    with pytest.raises(ArgumentError, match=r"colour = 'rainbow' is not allowed: it must be one of curvature, clear"):
        check_colouring("rainbow")
