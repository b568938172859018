"""Point clouds and height fields as bodies: files, errors, distances."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.points import MAX_POINTS
from cable_shape.viewer.colour import surface_distance

RANDOM = np.random.default_rng(3)
CLOUD = RANDOM.uniform(-0.2, 0.2, (300, 3))
HILLS = 0.02 * np.sin(np.arange(20))[:, None] * np.cos(np.arange(30))
ALONG_X = (0.5, 0.5, 0.5, 0.5)
PLACE = cs.Pose((0.4, 0.1, 0.2), (0.1826, 0.3651, 0.5477, 0.7303))


@pytest.mark.parametrize("solid", [cs.Points(CLOUD, 0.013), cs.HeightField(HILLS, 0.01), cs.Points(CLOUD[:1], 0.02)])
def test_clearance_is_that_of_the_nearest_sphere(solid):
    cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
    shape = cs.predict(cable, cs.Pose((0, 0, 0.6), ALONG_X), cs.Pose((0.8, 0, 0.6), ALONG_X))
    checker = ClearanceChecker(cs.Scene([cs.Obstacle("scan", solid, PLACE)]), cable=cable, horizon=2.0)
    (found,) = checker.check(shape).bodies
    centres = solid.centres @ PLACE.matrix()[:3, :3].T + PLACE.position
    start, way = shape.positions[:-1], np.diff(shape.positions, axis=0)
    t = np.einsum("ijk,ik->ij", centres[None] - start[:, None], way) / (way**2).sum(axis=1)[:, None]
    nearest = start[:, None] + np.clip(t, 0.0, 1.0)[:, :, None] * way[:, None]
    apart = np.linalg.norm(nearest - centres[None], axis=2)
    assert found.distance == pytest.approx(apart.min() - solid.radius - 0.004, abs=1e-12)
    assert np.linalg.norm(found.point_on_cable - found.point_on_body) == pytest.approx(abs(found.distance), abs=1e-12)
    swollen = checker.check(shape, swell=np.full(shape.points, 0.01)).bodies[0]
    assert swollen.distance == pytest.approx(found.distance - 0.01, abs=1e-12)
    seen = np.linalg.norm(shape.positions[:, None] - centres[None], axis=2).min(axis=1) - solid.radius
    assert surface_distance(solid, PLACE, shape.positions) == pytest.approx(seen, abs=1e-9)


def test_a_height_field_goes_through_its_heights():
    tilted = 0.5 * 0.01 * np.arange(9)[:, None] - 0.2 * 0.01 * np.arange(7)
    field = cs.HeightField(tilted, 0.01, 0.03)
    normal = np.array((0.2, -0.5, 1.0)) / np.linalg.norm((0.2, -0.5, 1.0))
    vertices, faces = field.surface()
    assert field.centres + 0.03 * normal == pytest.approx(vertices, abs=1e-12)
    assert vertices[0] == pytest.approx((-0.03, -0.04, 0.0))
    assert vertices[-1] == pytest.approx((0.03, 0.04, tilted[-1, -1]))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()
    assert len(faces) == 2 * 8 * 6


def test_a_scene_names_points_and_heights_and_writes_them_out(tmp_path):
    np.savetxt(tmp_path / "scan.xyz", np.column_stack((1e3 * CLOUD, CLOUD)), header="x y z, and a colour")
    np.save(tmp_path / "ground.npy", HILLS)
    np.savetxt(tmp_path / "ground.csv", HILLS, delimiter=",")
    (tmp_path / "scene.yaml").write_text(
        """
obstacles:
  - {name: scan, points: {file: scan.xyz, radius: 0.01}, scale: 0.001, friction: 0.2}
  - {name: two, points: {vertices: [[0, 0, 0], [0, 0, 20]], radius: 0.02}, scale: 0.001}
  - {name: ground, height_field: {file: ground.npy, spacing: 0.01, radius: 0.02}, link: tool}
  - {name: text, height_field: {file: ground.csv, spacing: 0.01}}
  - {name: flat, height_field: {heights: [[0, 0], [0, 0]], spacing: 0.1}, position: [0, 0, 1]}
"""
    )
    scene = cs.Scene.from_yaml(tmp_path / "scene.yaml")
    scan, two, ground, text, flat = (body.solid for body in scene.obstacles)
    assert scan.points == pytest.approx(CLOUD, abs=1e-15)
    assert two == cs.Points([(0, 0, 0), (0, 0, 0.02)], 0.02)
    assert ground == cs.HeightField(HILLS, 0.01, 0.02) != text
    assert text.heights == pytest.approx(HILLS, abs=1e-15)
    assert flat.radius == flat.spacing == 0.1
    again = cs.Scene.from_mapping(scene.as_dict())
    assert again == scene
    assert {hash(body.solid) for body in again.obstacles} == {hash(body.solid) for body in scene.obstacles}


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("scan.xyz", "0 0 0\n0 0 1\n0 1", r"line 3: it has 2 numbers, and 3 in the first row; is it cut off\?"),
        ("scan.xyz", "0 0 0\n0 0 x", "line 2: a number is missing"),
        ("scan.xyz", "# none\n", "it holds no numbers"),
        ("scan.xyz", "0 0\n1 1", "it has 2 numbers a row, and a point has three"),
        ("scan.xyz", "0 0 nan", "Points.points = .NaN. is not allowed.*finite"),
        ("scan.npy", b"\x93NUMPY\x01\x00v\x00{'descr'", "not a whole .npy file"),
        ("scan.ply", "ply", "is one of .csv, .txt, .xyz, .npy, not .ply"),
    ],
)
def test_a_file_that_is_wrong_is_refused_by_name(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(cs.ArgumentError, match=f"{name}.*{said}"):
        cs.Points.from_file(tmp_path / name, 0.01)


def test_npy_files_that_hold_something_else_are_refused(tmp_path):
    np.save(tmp_path / "whole.npy", CLOUD)
    whole = (tmp_path / "whole.npy").read_bytes()
    (tmp_path / "cut.npy").write_bytes(whole[:-8])
    np.save(tmp_path / "line.npy", CLOUD[0])
    np.save(tmp_path / "objects.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    for name, said in (
        ("cut", "cut off"),
        ("line", "rows and columns"),
        ("objects", "not a whole .npy file of numbers"),
    ):
        with pytest.raises(cs.ArgumentError, match=f"{name}.npy: .*{said}"):
            cs.Points.from_file(tmp_path / f"{name}.npy", 0.01)
    with pytest.raises(cs.ArgumentError, match=r"nowhere.npy: no such file"):
        cs.HeightField.from_file(tmp_path / "nowhere.npy", 0.01)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: cs.Points(CLOUD, -0.1), "Points.radius = -0.1 .* above 0"),
        (lambda: cs.Points(CLOUD[:, :2], 0.1), r"Points.points = .array of shape \(300, 2\)' .*\(n, 3\)"),
        (lambda: cs.Points(np.zeros((MAX_POINTS + 1, 3)), 0.1), f"{MAX_POINTS + 1} points. .* 1 to {MAX_POINTS}"),
        (lambda: cs.Points(np.zeros((0, 3)), 0.1), "0 points. .* 1 to"),
        (lambda: cs.Points([[0, 0, np.inf]], 0.1), "Points.points = .inf. .* finite"),
        (lambda: cs.HeightField([[0, 1]], 0.1), r"HeightField.heights = .array of shape \(1, 2\)' .* at least 2"),
        (lambda: cs.HeightField(HILLS, 0.0), "HeightField.spacing = 0.0 .* above 0"),
        (lambda: cs.HeightField([[0, 1], [0, np.nan]], 0.1), "HeightField.heights = .NaN. .* finite"),
        (lambda: scene_of({"points": {"radius": 0.1}}), r"points = \[\] .* exactly one must be given"),
        (lambda: scene_of({"points": {"vertices": [[0, 0, 0]]}}), "the key 'radius' is missing"),
        (lambda: scene_of({"height_field": {"heights": [[0, 0], [0, 0]]}}), "the key 'spacing' is missing"),
        (lambda: scene_of({"box": [1, 1, 1], "scale": 2}), "only mesh, points, height_field have one"),
    ],
)
def test_bad_numbers_are_refused(make, said):
    with pytest.raises(cs.ArgumentError, match=said):
        make()


def scene_of(solid):
    return cs.Scene.from_mapping({"obstacles": [{"name": "scan", **solid}]})
