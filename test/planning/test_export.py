"""Shapes as files of other programs, read back by other libraries where there is one."""

import csv

import mujoco
import numpy as np
import pygltflib
import pytest
from scipy.io import netcdf_file
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.cable.dxf_read import read_dxf

ALONG = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.02, diameter=0.01)


def moved(cable=CABLE, scene=None, points=60):
    predictor = cs.Predictor(cable, points=points, scene=scene)
    return [predictor.predict(cs.Pose((0, 0, 1), ALONG), cs.Pose((0.8 + 0.01 * k, 0.1, 1.05), ALONG)) for k in range(6)]


SHAPES = moved()


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("kind", ["stl", "obj"])
def test_a_tube_is_closed_and_as_thick_as_the_cable(tmp_path, kind):
    """MuJoCo reads the file; it takes no mesh that is not closed or inside out."""
    file = cs.export(SHAPES[0], tmp_path / f"tube.{kind}", CABLE)
    mesh = f'<mesh name="tube" file="{file}" inertia="exact"/>'
    xml = f'<mujoco><asset>{mesh}</asset><worldbody><geom type="mesh" mesh="tube" density="1"/></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    vertices = model.mesh_vert @ Rotation.from_quat(np.roll(model.mesh_quat[0], -1)).as_matrix().T + model.mesh_pos[0]
    expected = 0.5 * 16 * np.sin(2.0 * np.pi / 16) * 0.005**2 * 1.2
    assert volume(vertices, model.mesh_face) == pytest.approx(expected, rel=2e-3)
    apart = np.linalg.norm(vertices[:, None] - SHAPES[0].positions, axis=2).min(axis=1)
    assert apart.max() < 0.005 + 1e-4
    assert np.isclose(apart, 0.0, atol=1e-6).sum() == 2  # the middles of the caps


def accessor(file, data, number):
    told = file.accessors[number]
    view = file.bufferViews[told.bufferView]
    kind = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[told.componentType]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[told.type]
    return np.frombuffer(data, kind, told.count * width, view.byteOffset or 0).reshape(told.count, width)


def test_the_animation_moves_the_tube_as_the_cable_moves(tmp_path):
    file = pygltflib.GLTF2().load(str(cs.export(SHAPES, tmp_path / "cable.glb", CABLE, period=0.1)))
    data = file.binary_blob()
    own = file.meshes[0].primitives[0].attributes
    vertices, joints = accessor(file, data, own.POSITION), accessor(file, data, own.JOINTS_0)[:, 0]
    skin = file.skins[0]
    inverse = accessor(file, data, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    tracks = {}
    for channel in file.animations[0].channels:
        sampler = file.animations[0].samplers[channel.sampler]
        assert accessor(file, data, sampler.input).ravel() == pytest.approx(0.1 * np.arange(6))
        tracks[channel.target.node, channel.target.path] = accessor(file, data, sampler.output)
    up = Rotation.from_quat(file.nodes[0].rotation)
    assert up.apply((0, 0, 1)) == pytest.approx((0, 1, 0))
    for i, shape in enumerate(SHAPES):
        for v in (0, 7, 200, 555, len(vertices) - 1):
            node = skin.joints[joints[v]]
            local = (inverse[joints[v]] @ np.append(vertices[v], 1.0))[:3]
            at = Rotation.from_quat(tracks[node, "rotation"][i]).apply(local) + tracks[node, "translation"][i]
            k = joints[v]
            across = at - shape.positions[k]
            assert np.linalg.norm(across) == pytest.approx(0.0 if v == len(vertices) - 1 else 0.005, abs=1e-6)
            assert across @ shape.tangents[k] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("kind", ["usda", "usdc"])
def test_curves_of_usd(tmp_path, kind):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(cs.export(SHAPES, tmp_path / f"cable.{kind}", CABLE, period=0.1)))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/cables/cable"))
    assert list(curve.GetCurveVertexCountsAttr().Get()) == [60]
    assert np.allclose(curve.GetWidthsAttr().Get(), 0.01)
    assert stage.GetTimeCodesPerSecond() == pytest.approx(10.0)
    for i, shape in enumerate(SHAPES):
        assert np.allclose(curve.GetPointsAttr().Get(Usd.TimeCode(i)), shape.positions, atol=1e-6)


def test_centrelines(tmp_path):
    line = read_dxf(cs.export(SHAPES[2], tmp_path / "cable.dxf", CABLE))
    assert line.length == pytest.approx(1.2, rel=1e-3)
    assert line.start.position == pytest.approx(SHAPES[2].positions[0], abs=1e-9)
    with cs.export(SHAPES, tmp_path / "cable.csv", CABLE).open() as file:
        rows = list(csv.DictReader(file))
    for i, shape in enumerate(SHAPES):
        table = [[float(row[c]) for c in ("arc_length", "x", "y", "z")] for row in rows if row["instant"] == str(i)]
        assert np.array_equal(table, np.column_stack((shape.arc_length, shape.positions)))


def test_netcdf(tmp_path):
    with netcdf_file(cs.export(SHAPES, tmp_path / "cable.nc", CABLE, period=0.1), mmap=False) as file:
        for name in ("positions", "quaternions", "curvature", "force", "moment"):
            assert np.array_equal(file.variables[name][:], [getattr(shape, name) for shape in SHAPES])
        assert file.variables["force"].units == b"N"
        assert file.variables["time"][:] == pytest.approx(0.1 * np.arange(6))


@pytest.mark.parametrize("clip", [False, True])
def test_mujoco_rests_where_the_cable_rests(tmp_path, clip):
    scene = cs.Scene(clips=[cs.Clip(0.6, cs.Pose((0.4, 0.05, 0.8)))]) if clip else None
    bent = CABLE.replace(bending_stiffness=(0.02, 0.03), rest_curvature=(0.0, 0.4, 0.0))
    shape = moved(bent, scene)[0]
    model = mujoco.MjModel.from_xml_path(str(cs.export(shape, tmp_path / "cable.xml", bent)))
    data = mujoco.MjData(model)
    bodies = [model.body(f"B{k}").id for k in range(61)]
    s = np.linspace(0.0, 1.2, 61)
    there = np.column_stack([np.interp(s, shape.arc_length, x) for x in shape.positions.T])

    def off():
        middles = data.xpos[bodies] + data.xmat[bodies].reshape(-1, 3, 3) @ (0.0, 0.0, 0.01)
        return np.linalg.norm(middles - there, axis=1).max() / 1.2

    mujoco.mj_forward(model, data)
    assert off() < 0.002
    for _ in range(40):
        for _ in range(100):
            mujoco.mj_step(model, data)
            data.qvel *= 0.99
        if np.abs(data.qvel).max() < 1e-5:
            break
    assert np.abs(data.qvel).max() < 1e-3
    assert off() < 0.005


def test_harnesses(tmp_path):
    harness = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.start"))])
    shape = cs.predict(harness, {"a.start": cs.Pose((0, 0, 1), ALONG), "b.end": cs.Pose((1.8, 0, 1), ALONG)}, points=30)
    text = cs.export(shape, tmp_path / "h.obj", harness).read_text()
    assert [line for line in text.splitlines() if line.startswith("o ")] == ["o a", "o b"]
    file = pygltflib.GLTF2().load(str(cs.export([shape, shape], tmp_path / "h.glb", harness)))
    assert [mesh.name for mesh in file.meshes] == ["a", "b"]
    with pytest.raises(cs.ArgumentError, match="not of a harness"):
        cs.export(shape, tmp_path / "h.xml", harness)


@pytest.mark.parametrize(
    ("shapes", "name", "cable", "words"),
    [
        (SHAPES, "a.step", CABLE, "it must end in"),
        (SHAPES, "a.stl", CABLE, "has one shape, and these are 6"),
        (SHAPES[0], "a.stl", None, "Give the cable"),
        ([], "a.glb", CABLE, "at least"),
        (SHAPES[0], "nowhere/a.stl", CABLE, "cannot be written"),
        (SHAPES[0], "a.xml", CABLE.replace(sections=[cs.Section(0.1, 0.2, bending_stiffness=1.0)]), "the same stiff"),
        ([1], "a.stl", CABLE, "CableShape"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path, shapes, name, cable, words):
    with pytest.raises(cs.ArgumentError, match=words):
        cs.export(shapes, tmp_path / name, cable)
