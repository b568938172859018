"""Scenes: what is kept, what is refused and how the refusal reads; meshes from files."""

import math
import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import cable_shape as cs
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.scene.scene import Box, Capsule, Clip, Cylinder, HalfSpace, Mesh, Obstacle, PointMass, Scene, Sphere

CONFIG = Path(__file__).parents[2] / "config"
TETRAHEDRON = Mesh(
    [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)],
    [(0, 2, 3), (0, 3, 1), (0, 1, 2), (1, 3, 2)],
)


def refusal(values, error=ArgumentError) -> str:
    with pytest.raises(error) as caught:
        Scene.from_mapping(values, where="cell.yaml")
    return str(caught.value)


def test_the_short_way_to_write_a_scene():
    scene = cs.Scene(obstacles=[cs.Obstacle("post", cs.Cylinder(0.03, 0.4), cs.Pose((0.5, 0, 0.2)))])
    assert scene.obstacles[0].solid == Cylinder(0.03, 0.4)
    assert isinstance(scene.obstacles, tuple)
    assert scene == Scene((Obstacle("post", Cylinder(0.03, 0.4), cs.Pose((0.5, 0, 0.2))),))
    wider = scene.replace(warn_distance=0.1)
    assert wider.warn_distance == 0.1
    assert wider.obstacles == scene.obstacles
    with pytest.raises(UnknownKeyError, match="warn_distance"):
        scene.replace(warn_distanc=0.1)


def test_the_size_of_a_box_is_a_copy_that_stays():
    size = np.array([0.1, 0.2, 0.3])
    box = Box(size)
    size[0] = 9.0
    assert box.size.tolist() == [0.1, 0.2, 0.3]
    with pytest.raises(ValueError, match="read-only"):
        box.size[0] = 9.0
    assert box == Box((0.1, 0.2, 0.3))
    assert box != Box((0.1, 0.2, 0.4))
    assert len({box, Box((0.1, 0.2, 0.3)), TETRAHEDRON, Mesh(TETRAHEDRON.vertices, TETRAHEDRON.faces)}) == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box((0.1, -0.2, 0.3)), r"Box\.size = \[0\.1, -0\.2, 0\.3\].*above 0 m"),
        (lambda: Box((0.1, 0.2)), r"Box\.size.*shape \(3,\)"),
        (lambda: Sphere(0.0), r"Sphere\.radius = 0\.0.*above 0 m"),
        (lambda: Sphere(math.nan), r"Sphere\.radius = nan.*finite"),
        (lambda: Cylinder(0.1, math.inf), r"Cylinder\.length = inf.*finite"),
        (lambda: Capsule("wide", 1.0), r"Capsule\.radius = 'wide'.*number"),
        (lambda: Mesh([(0, 0, math.nan)] * 3, [(0, 1, 2)]), r"Mesh\.vertices.*finite"),
        (lambda: Mesh([(0, 0, 0)] * 3, [(0, 1, 3)]), r"Mesh\.faces = 'indices 0 to 3'.*0 to 2"),
        (lambda: Mesh([(0, 0, 0)] * 3, np.empty((0, 3), int)), r"Mesh\.faces = '0 triangles'"),
        (lambda: Mesh([(0, 0, 0)] * 3, [(0.0, 1.0, 2.0)]), r"Mesh\.faces.*whole numbers"),
        (lambda: Obstacle("", Sphere(0.1)), r"Obstacle\.name = ''"),
        (lambda: Obstacle("ball", 0.1), r"Obstacle\.solid = 0\.1.*Box or Sphere"),
        (lambda: Obstacle("ball", Sphere(0.1), (0, 0, 0)), r"Obstacle\.pose.*Pose"),
        (lambda: Clip(-0.1, cs.Pose()), r"Clip\.arc_length = -0\.1.*at least 0 m"),
        (lambda: Clip(0.1, cs.Pose(), "glue"), r"Clip\.kind = 'glue'.*ball, fixed, hinge, slide"),
        (lambda: PointMass(0.1, -0.1), r"PointMass\.mass = -0\.1.*at least 0 kg"),
        (lambda: Scene(warn_distance=-0.1), r"warn_distance = -0\.1.*at least 0 m"),
        (lambda: Scene(obstacles=[Sphere(0.1)]), r"obstacles\[0\] = Sphere.*Obstacle"),
        (lambda: Scene(masses=PointMass(0.1, 0.1)), r"masses = PointMass.*list"),
        (lambda: Scene([Obstacle("a", Sphere(0.1)), Obstacle("a", Sphere(0.2))]), r"obstacles = 'a'.*unique"),
    ],
)
def test_refused_values(make, message):
    with pytest.raises(ArgumentError, match=message):
        make()


# --- YAML -------------------------------------------------------------------------------------------------------------


def test_every_kind_of_entry(tmp_path):
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 1000 0 0\nv 0 1000 0\nf 1 2 3\n")
    (tmp_path / "cell.yaml").write_text(
        """
warn_distance: 0.05
error_distance: 0.02
obstacles:
  - {name: table, box: [1.2, 0.8, 0.04], position: [0.5, 0, -0.02]}
  - {name: ball, sphere: 0.05}
  - {name: post, cylinder: {radius: 0.03, length: 0.4}, quaternion: [0, 0.6, 0, 0.8]}
  - {name: rail, capsule: {radius: 0.01, length: 0.4}}
  - {name: floor, half_space: true}
  - {name: part, mesh: part.obj, scale: 0.001}
  - {name: camera, box: [0.03, 0.09, 0.03], link: left_tool}
clips:
  - {arc_length: 0.5, position: [0.5, 0, 0.3]}
  - {arc_length: 0.6, position: [0.6, 0, 0.3], quaternion: [0, 0, 0, 1], kind: fixed}
masses:
  - {arc_length: 0.5, mass: 0.02}
"""
    )
    scene = Scene.from_yaml(tmp_path / "cell.yaml")
    solids = {o.name: o.solid for o in scene.obstacles}
    assert solids["table"] == Box((1.2, 0.8, 0.04))
    assert solids["ball"] == Sphere(0.05)
    assert solids["post"] == Cylinder(0.03, 0.4)
    assert solids["rail"] == Capsule(0.01, 0.4)
    assert solids["floor"] == HalfSpace()
    assert solids["part"].vertices.max() == 1.0
    assert [o.link for o in scene.obstacles] == [None] * 6 + ["left_tool"]
    assert scene.obstacles[0].pose == cs.Pose((0.5, 0, -0.02))
    assert scene.obstacles[2].pose.quaternion.tolist() == [0.0, 0.6, 0.0, 0.8]
    assert [c.kind for c in scene.clips] == ["ball", "fixed"]
    assert scene.masses == (PointMass(0.5, 0.02),)
    assert (scene.warn_distance, scene.error_distance) == (0.05, 0.02)


numbers = st.floats(min_value=1e-3, max_value=10.0)
solids = st.one_of(
    st.builds(Box, st.tuples(numbers, numbers, numbers)),
    st.builds(Sphere, numbers),
    st.builds(Cylinder, numbers, numbers),
    st.builds(Capsule, numbers, numbers),
    st.just(HalfSpace()),
    st.just(TETRAHEDRON),
)
poses = st.builds(
    lambda p, a: cs.Pose(p, (0.0, math.sin(a), 0.0, math.cos(a))), st.tuples(numbers, numbers, numbers), numbers
)
scenes = st.builds(
    lambda bodies, clips, masses, warn, error: Scene(
        [Obstacle(f"body {i}", *body) for i, body in enumerate(bodies)], clips, masses, warn, error
    ),
    st.lists(st.tuples(solids, poses, st.sampled_from([None, "tool"])), max_size=4),
    st.lists(
        st.one_of(
            st.builds(Clip, numbers, poses, st.sampled_from(["ball", "fixed", "hinge", "slide"])),
            st.builds(lambda arc, pose, mu: Clip(arc, pose, "slide", friction=mu), numbers, poses, numbers),
        ),
        max_size=2,
        unique_by=lambda clip: clip.arc_length,
    ).map(lambda clips: sorted(clips, key=lambda clip: clip.arc_length)),
    st.lists(st.builds(PointMass, numbers, numbers), max_size=2),
    numbers,
    numbers,
)


@settings(derandomize=True, deadline=None, max_examples=50)
@given(scenes)
def test_a_scene_survives_yaml(scene):
    again = Scene.from_mapping(yaml.safe_load(yaml.safe_dump(scene.as_dict())))
    assert again.obstacles == scene.obstacles or all(
        a.solid == b.solid
        and (a.name, a.link) == (b.name, b.link)
        and np.allclose(a.pose.array, b.pose.array, atol=1e-15)
        for a, b in zip(again.obstacles, scene.obstacles, strict=True)
    )
    assert again.masses == scene.masses
    told = [[(c.arc_length, c.kind, c.friction) for c in one.clips] for one in (again, scene)]
    assert told[0] == told[1]
    assert (again.warn_distance, again.error_distance) == (scene.warn_distance, scene.error_distance)


def test_unknown_keys_name_the_nearest():
    assert "cell.yaml: unknown key 'obstacle'. Did you mean 'obstacles'?" in refusal({"obstacle": []}, UnknownKeyError)
    text = refusal({"obstacles": [{"name": "a", "sphere": 1.0, "positon": [0, 0, 0]}]}, UnknownKeyError)
    assert "cell.yaml: obstacles[0] (a): unknown key 'positon'. Did you mean 'position'?" in text
    text = refusal({"obstacles": [{"name": "a", "capsule": {"radius": 1.0, "lenght": 1.0}}]}, UnknownKeyError)
    assert "capsule: unknown key 'lenght'. Did you mean 'length'?" in text


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"obstacles": [{"name": "a", "box": [1, 1, -1]}]}, ("obstacles[0] (a)", "Box.size", "above 0 m")),
        ({"obstacles": [{"name": "a", "sphere": math.nan}]}, ("Sphere.radius = nan", "finite")),
        ({"obstacles": [{"name": "a", "box": [1, 1, 1], "sphere": 1}]}, ("['box', 'sphere']", "exactly one")),
        ({"obstacles": [{"name": "a"}]}, ("solid = []", "exactly one")),
        ({"obstacles": [{"sphere": 1.0}]}, ("obstacles[0]", "'name' is missing")),
        ({"obstacles": [{"name": "a", "cylinder": {"radius": 1.0}}]}, ("'length' is missing",)),
        ({"obstacles": [{"name": "a", "half_space": 3}]}, ("half_space: true",)),
        ({"obstacles": [{"name": "a", "sphere": 1.0, "scale": 2.0}]}, ("only mesh, points, height_field",)),
        ({"obstacles": [{"name": "a", "mesh": "nowhere.stl"}]}, ("obstacles[0] (a)", "nowhere.stl", "no such file")),
        ({"obstacles": [{"name": "a", "mesh": "part.step"}]}, (".stl and .obj",)),
        ({"obstacles": [{"name": "a", "sphere": 1.0, "quaternion": [0, 0, 0, 0]}]}, ("quaternion", "length is 0")),
        ({"obstacles": [{"name": "a", "sphere": 1.0, "position": [0, 0, math.inf]}]}, ("position", "finite")),
        ({"obstacles": {"name": "a"}}, ("obstacles", "list")),
        ({"obstacles": ["a"]}, ("obstacles[0]", "mapping")),
        ({"clips": [{"arc_length": 0.1}]}, ("clips[0]", "'position' is missing")),
        ({"masses": [{"arc_length": 0.1, "mass": -1.0}]}, ("masses[0]", "PointMass.mass = -1.0")),
        ({"warn_distance": "far"}, ("warn_distance = 'far'",)),
    ],
)
def test_refused_entries(values, words):
    text = refusal(values)
    assert text.startswith("cell.yaml: ")
    for word in words:
        assert word in text


# --- meshes -----------------------------------------------------------------------------------------------------------


def triangles_of(mesh: Mesh) -> np.ndarray:
    """The corners of all triangles in an order of their own."""
    corners = mesh.vertices[mesh.faces]
    first = [int(np.lexsort(t.T[::-1])[0]) for t in corners]
    turned = [np.roll(t, -i, axis=0) for t, i in zip(corners, first, strict=True)]
    return np.array(sorted(t.ravel().tolist() for t in turned))


def write_mesh(path: Path, mesh: Mesh, kind: str) -> None:
    corners = mesh.vertices[mesh.faces]
    if kind == "binary":
        records = b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in corners)
        path.write_bytes(b"solid, yet binary".ljust(80) + struct.pack("<I", len(corners)) + records)
    elif kind == "ascii":
        facets = "".join(
            "facet normal 0 0 0\n outer loop\n"
            + "".join(f"  vertex {x!r} {y!r} {z!r}\n" for x, y, z in t.tolist())
            + " endloop\nendfacet\n"
            for t in corners
        )
        path.write_text(f"solid part\n{facets}endsolid part\n")
    else:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += ["vn 0 0 1", "usemtl grey", "f " + " ".join(f"{i + 1}/1/1" for i in mesh.faces[0])]
        lines += ["f " + " ".join(str(i - len(mesh.vertices)) for i in face) for face in mesh.faces[1:]]
        path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("kind", "suffix", "tolerance"), [("binary", "stl", 1e-6), ("ascii", "STL", 0.0), ("obj", "obj", 0.0)]
)
def test_a_mesh_survives_its_file(tmp_path, kind, suffix, tolerance):
    rng = np.random.default_rng(3)
    mesh = Mesh(TETRAHEDRON.vertices + rng.uniform(-0.1, 0.1, (4, 3)), TETRAHEDRON.faces)
    path = tmp_path / f"part.{suffix}"
    write_mesh(path, mesh, kind)
    again = Mesh.from_file(path)
    assert len(again.vertices) == 4, "corners are merged"
    np.testing.assert_allclose(triangles_of(again), triangles_of(mesh), atol=tolerance)
    np.testing.assert_allclose(Mesh.from_file(path, 0.001).vertices, again.vertices * 0.001)


def test_polygons_become_triangles(tmp_path):
    path = tmp_path / "quad.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert Mesh.from_file(path).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("cut.stl", b"x" * 80 + struct.pack("<I", 5) + b"\0" * 60, r"cut\.stl.*cut off"),
        ("cut.stl", b"solid a\nfacet\nvertex 0 0 0\nvertex 1 0 0\n", r"cut\.stl.*cut off"),
        ("words.stl", b"solid a vertex a b c vertex 0 0 0 vertex 0 0 0 endsolid", r"words\.stl.*well-formed"),
        ("empty.stl", b"solid a\nendsolid a\n", r"empty\.stl.*no triangle"),
        ("empty.stl", b"", r"empty\.stl.*neither"),
        ("empty.obj", b"# nothing\n", r"empty\.obj.*no face"),
        ("bad.obj", b"v 0 0 0\nf 1 2 3\n", r"bad\.obj.*Mesh\.faces"),
        ("bad.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", r"bad\.obj.*three or more"),
        ("bad.obj", b"v 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", r"bad\.obj.*well-formed"),
    ],
)
def test_damaged_meshes(tmp_path, name, data, message):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ArgumentError, match=message):
        Mesh.from_file(tmp_path / name)


def test_huge_mesh_files_are_refused_unread(tmp_path):
    path = tmp_path / "huge.stl"
    with path.open("wb") as file:
        file.truncate(65 * 1024 * 1024)
    with pytest.raises(ArgumentError, match=r"huge\.stl: \d+ bytes, at most"):
        Mesh.from_file(path)


def test_scale_must_be_positive(tmp_path):
    with pytest.raises(ArgumentError, match=r"scale = 0\.0.*above 0"):
        Mesh.from_file(tmp_path / "part.stl", scale=0.0)


# --- what comes with the package --------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", sorted((CONFIG / "scenes").glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_scenes_load(path):
    scene = Scene.from_yaml(path)
    assert scene.obstacles
    assert scene.error_distance < scene.warn_distance


@pytest.mark.parametrize(
    "path", sorted(p for p in (CONFIG / "cables").glob("*.yaml") if p.stem != "three"), ids=lambda p: p.stem
)
def test_shipped_cables_are_plausible(path):
    cable = cs.Cable.from_yaml(path)
    solid = cable.linear_density / (math.pi / 4.0 * cable.diameter**2)
    assert 500.0 < solid < 4000.0, "kg/m^3, between a hose and a cable full of copper"
    assert 0.01 < (cable.mean_bending_stiffness / (9.81 * cable.linear_density)) ** (1.0 / 3.0) < 1.0
    assert "would" in cable.describe()
