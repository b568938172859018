"""Contact with convex triangle meshes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.mesh_convex import half_thickness, is_convex
from cable_shape.solve.touching.touching import DEEPEST

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
CORNERS = np.array([(x, y, z) for x in (-0.1, 0.1) for y in (-0.3, 0.3) for z in (-0.1, 0.1)])


def hull_of(points):
    """The convex hull as a mesh, triangles counter-clockwise from outside."""
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    for face, plane in zip(faces, hull.equations, strict=True):
        a, b, c = points[face]
        if np.cross(b - a, c - a) @ plane[:3] < 0.0:
            face[1:] = face[:0:-1]
    return cs.Mesh(points, faces)


PLACE = cs.Pose((0.42, 0, -0.05))
BLOCK = hull_of(CORNERS)


def over(solid, pose=PLACE):
    return cs.Scene(obstacles=[cs.Obstacle("part", solid, pose)], contact="solve")


def lowered(scene, heights=tuple(k / 100 for k in range(50, 37, -1))):
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    for height in heights:
        shape = predictor.predict(cs.Pose((0, 0, height), ALONG_X), cs.Pose((0.8, 0, height), ALONG_X))
        assert shape.status is cs.Status.OK, (height, shape)
        found = ClearanceChecker(scene, radius=0.004).check(shape)
        assert max((-body.distance for body in found.bodies), default=0.0) < 2.0 * DEEPEST
    assert shape.contacts
    return shape


def test_a_mesh_of_a_box_is_as_good_as_the_box():
    mesh, box = lowered(over(BLOCK)), lowered(over(cs.Box((0.2, 0.6, 0.2))))
    assert mesh.positions == pytest.approx(box.positions, abs=1e-9)
    assert sum(c.force for c in mesh.contacts) == pytest.approx(sum(c.force for c in box.contacts), rel=1e-9)


def test_a_fine_mesh_of_a_sphere_is_nearly_one():
    k = np.arange(2000) + 0.5
    polar, around = np.arccos(1.0 - k / 1000.0), np.pi * (1.0 + np.sqrt(5.0)) * k
    points = np.stack((np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)), axis=1)
    pose = cs.Pose((0.4, 0.04, -0.04))
    mesh, sphere = lowered(over(hull_of(0.15 * points), pose)), lowered(over(cs.Sphere(0.15), pose))
    assert np.linalg.norm(mesh.positions - sphere.positions, axis=1).max() < 5e-4 * CABLE.length
    assert sum(c.force for c in mesh.contacts) == pytest.approx(sum(c.force for c in sphere.contacts), rel=0.01)


def test_a_mesh_from_a_file_on_a_link(tmp_path):
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in 1e3 * CORNERS)
    text += "".join("f {} {} {}\n".format(*(face + 1)) for face in BLOCK.faces)
    (tmp_path / "block.obj").write_text(text)
    solid = cs.Mesh.from_file(tmp_path / "block.obj", 1e-3)
    scene = cs.Scene(obstacles=[cs.Obstacle("part", solid, link="tool")], contact="solve")
    moving = cs.Predictor(CABLE, scene=scene, model="cosserat")
    ends = cs.Pose((0, 0, 0.5), ALONG_X), cs.Pose((0.8, 0, 0.5), ALONG_X)
    for height in np.arange(-0.05, 0.075, 0.01):
        shape = moving.predict(*ends, {"tool": cs.Pose((0.42, 0, height))})
        assert shape.status is cs.Status.OK, (height, shape)
    fixed = lowered(over(BLOCK, cs.Pose((0.42, 0, height))), heights=[0.5])
    assert shape.contacts
    assert apart(shape, fixed) < shape.error_estimate + fixed.error_estimate < 5e-4 * CABLE.length
    moving.reset()
    shape = moving.predict(*ends, {"tool": cs.Pose((0.42, 0, height))})
    assert apart(shape, fixed) < 2e-6


def apart(shape, other):
    """[m], the farther of two points of the same arc length, of a shape or its mirror image, which is as good here."""
    mirrored = shape.positions * (1.0, -1.0, 1.0)
    return min(np.linalg.norm(p - other.positions, axis=1).max() for p in (shape.positions, mirrored))


def test_a_thin_slanted_plate_is_not_passed():
    half = np.array((0.3, 0.3, 0.002))
    tilt = cs.Pose((0, 0, 0), (0, np.sin(0.3), 0, np.cos(0.3))).matrix()[:3, :3]
    plate = hull_of(CORNERS / np.abs(CORNERS).max(axis=0) * half @ tilt.T)
    assert half_thickness(plate) == pytest.approx(0.002, rel=1e-9)
    scene = cs.Scene(obstacles=[cs.Obstacle("part", plate, link="tool")], contact="solve")
    moving = cs.Predictor(CABLE, scene=scene, model="cosserat")
    ends = cs.Pose((0, 0, 0.5), ALONG_X), cs.Pose((0.8, 0, 0.5), ALONG_X)
    for height in np.arange(-0.12, 0.1, 0.04):  # further at a time than plate and cable are thick
        links = {"tool": cs.Pose((0.4, 0, height))}
        shape = moving.predict(*ends, links)
        assert shape.status is cs.Status.OK, (height, shape)
    above = (shape.positions - (0.4, 0, height)) @ tilt[:, 2]
    near = np.abs((shape.positions - (0.4, 0, height)) @ tilt[:, 0]) < 0.3
    assert shape.contacts
    assert above[near].min() > 0.006 - 2.0 * DEEPEST


def test_which_meshes_are_convex():
    assert is_convex(BLOCK)
    assert half_thickness(BLOCK) == pytest.approx(0.1, rel=1e-12)
    assert not is_convex(cs.Mesh(BLOCK.vertices, BLOCK.faces[:-1])), "open"
    assert not is_convex(cs.Mesh(BLOCK.vertices, BLOCK.faces[:, ::-1])), "inside out"
    assert not is_convex(cs.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])), "flat"
    apex = np.argmax(CORNERS.sum(axis=1))
    dented = CORNERS.copy()
    dented[apex] = (-0.05, -0.15, -0.05)
    assert not is_convex(cs.Mesh(dented, BLOCK.faces)), "dented"
