"""Files of other programs: KBL, WireViz, curves and meshes in, formboards out; and what is refused."""

from __future__ import annotations

import json
import math
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.cable.b_spline import basis, clamped, spans
from cable_shape.cable.centreline import Centreline
from cable_shape.cable.curves import read_curve
from cable_shape.cable.formboard import dxf, laid_flat, svg
from cable_shape.cable.kbl_read import read_kbl
from cable_shape.cable.step import read_step
from cable_shape.cable.tube_mesh import centreline_of
from cable_shape.cable.wireviz import from_wireviz
from cable_shape.command.cli import main
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError, FileError

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data" / "kbl"
LISTED = json.loads((DATA / "expected.json").read_text()) if (DATA / "expected.json").is_file() else []
listed = pytest.mark.skipif(not LISTED, reason="the KBL files (CC BY-SA) are not in ../shared/data/kbl")


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The file that examples/make_kbl.py writes."""
    file = tmp_path_factory.mktemp("kbl") / "example.kbl"
    subprocess.run([sys.executable, str(ROOT / "examples" / "make_kbl.py"), str(file)], check=True, capture_output=True)
    return file


# -- KBL


@listed
@pytest.mark.parametrize("told", LISTED, ids=lambda told: told["file"][:34])
def test_a_real_file_gives_the_numbers_found_without_us(told):
    harness = cs.Harness.from_kbl(DATA / told["file"])
    lengths = {name: 1e3 * cable.length for name, cable in harness.segments.items()}
    assert len(lengths) == told["segments"]
    assert sum(lengths.values()) == pytest.approx(told["total_length_mm"], rel=1e-5)
    least, _, most = told["length_min_median_max"]
    assert (min(lengths.values()), max(lengths.values())) == pytest.approx((least, most), rel=1e-5, abs=1e-3)
    joints = sorted(len(junction.ends) for junction in harness.junctions)
    assert len(harness.open_ends) == told["ends"]
    assert joints.count(2) == told["inliners"]
    assert sum(n > 2 for n in joints) == told["junctions"]
    if told["largest_junction"]:
        largest = max(harness.junctions, key=lambda junction: len(junction.ends))
        assert (largest.name, len(largest.ends)) == (
            told["largest_junction"]["id"],
            told["largest_junction"]["segments"],
        )
    assert 1e3 * harness.wire_mass == pytest.approx(told["wire_mass_g"], abs=0.06)
    places = [(clip.segment, 1e3 * clip.arc_length) for clip in harness.clips]
    wanted = [(one["segment"], one["at_mm"]) for one in told["fixings_on_segments"]]
    assert sorted(places) == [(name, pytest.approx(at, abs=0.006)) for name, at in sorted(wanted)]
    drawn = harness.imported.drawn
    assert all(drawn[name].length == pytest.approx(1e-3 * length, rel=1e-4) for name, length in lengths.items())


@listed
@pytest.mark.parametrize("told", LISTED, ids=lambda told: told["file"][:34])
def test_a_real_file_hangs(told):
    harness = cs.Harness.from_kbl(DATA / told["file"])
    shape = cs.predict(harness, harness.imported.ends, scene=cs.Scene(clips=harness.clips))
    assert shape.usable, shape.detail
    for clip in harness.clips:
        one = shape.segments[clip.segment]
        at = [np.interp(clip.arc_length, one.arc_length, x) for x in one.positions.T]
        assert math.dist(at, clip.pose.position) < 2e-3  # between points of the shape


def test_the_example_hangs_by_two_commands(example, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["import", str(example), "-o", str(out)]) == 0
    assert "180 segments" in capsys.readouterr().out
    assert main(["predict", str(out / "harness.yaml"), "--picture"]) == 0
    assert (out / "harness.png").read_bytes().startswith(b"\x89PNG")
    assert (out / "harness.rrd").read_bytes().startswith(b"RRF")
    assert {file.name for file in out.iterdir()} == {
        "harness.yaml", "import.md", "formboard.svg", "formboard.dxf", "harness.png", "harness.rrd"
    }  # fmt: skip
    again = HarnessFile.from_yaml(out / "harness.yaml").harness
    made = cs.Harness.from_kbl(example)
    assert again.segments.keys() == made.segments.keys()
    assert again.length == pytest.approx(made.length, rel=1e-8)


def test_wires_weigh_what_they_are_routed(example):
    harness = cs.Harness.from_kbl(example)
    way = sum(
        harness.segments[f"{side}{k}"].length + sum(harness.segments[f"T{i}"].length for i in range(1, k + 1))
        for k in range(1, 61) for side in "LR"
    )  # fmt: skip
    assert harness.wire_mass == pytest.approx(0.006 * way, rel=1e-9)
    assert harness.segments["T1"].linear_density == pytest.approx(120 * 0.006)


def test_short_segments_are_merged_when_asked(example):
    harness = cs.Harness.from_kbl(example, merge_below=0.0605)
    assert all(cable.length >= 0.0605 for cable in harness.segments.values())
    assert len(harness.segments) + len(harness.imported.merged) == 180


def test_a_uniform_spline_is_not_a_bezier_curve():
    """Both bases sum to one; the uniform one of degree 3 begins at (P0 + 4 P1 + P2) / 6."""
    for of in (basis, clamped):
        assert np.allclose(of(6).sum(axis=1), [0] * 6 + [1])
    points = np.random.default_rng(0).normal(size=(4, 3))
    assert np.allclose(spans(points, 3, basis(3))[-1, 0], (points[0] + 4 * points[1] + points[2]) / 6)
    assert np.allclose(spans(points, 3, clamped(3))[-1, 0], points[0])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda t: t.replace("<Unit_component>mm</Unit_component>", "", 1), "its unit is missing"),
        (lambda t: t.replace('<Unit id="mm">', '<Unit id="nn">'), "there is no Unit 'mm'"),
        (lambda t: t.replace("<Si_prefix>milli</Si_prefix>", "<Si_prefix>micro</Si_prefix>"), "Correct the unit"),
        (lambda t: t.replace("?>", '?><!DOCTYPE k [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>', 1), "a DOCTYPE"),
        (lambda t: t.replace("?>", '?><!DOCTYPE k SYSTEM "file:///etc/passwd">', 1), "a DOCTYPE"),
        (lambda t: t.replace("<Start_node>N0<", "<Start_node>N999<"), "there is no node 'N999'"),
        (lambda t: t.replace("KBL_container", "KBL_box"), "the top element is <KBL_box>"),
        (lambda t: t.replace("<Location>0.5<", "<Location>1.5<", 1), "is not on the segment"),
        (lambda t: t.replace("<Degree>3<", "<Degree>three<", 1), "it must be a number"),
        (lambda t: t[: len(t) // 2], "not well-formed XML"),
    ],
)
def test_a_bad_kbl_is_refused_and_leaves_nothing(example, tmp_path, change, told, capsys):
    bad = tmp_path / "bad.kbl"
    bad.write_text(change(example.read_text()))
    assert main(["import", str(bad), "-o", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["bad.kbl"]


def test_an_encoding_that_is_not_what_is_said_is_refused(example, tmp_path):
    bad = tmp_path / "bad.kbl"
    bad.write_bytes(example.read_bytes().replace(b"clip 1<", b"Geh\xe4use<"))
    with pytest.raises(FileError, match="UTF-8"):
        read_kbl(bad)
    bad.write_bytes(bad.read_bytes().replace(b"UTF-8", b"ISO-8859-1"))
    assert read_kbl(bad).segments["T1"].fixings[0].id == "Gehäuse"


# -- preformed cables


def helix(turns=1.0, n=200):
    t = np.linspace(0.0, 2.0 * math.pi * turns, n)
    return np.stack([0.15 * np.cos(t), 0.15 * np.sin(t) + 0.03 * np.sin(2 * t), 0.05 * t], axis=1)


def arc_between_lines():
    s, a = np.linspace(0.0, 0.3, 40), np.linspace(0.0, 0.5 * math.pi, 40)
    bend = np.stack([0.3 + 0.05 * np.sin(a), 0.05 - 0.05 * np.cos(a), 0 * a], axis=1)
    return np.concatenate([np.stack([s, 0 * s, 0 * s], 1)[:-1], bend, np.stack([0.35 + 0 * s, 0.05 + s, 0 * s], 1)[1:]])


@pytest.mark.parametrize(
    "points", [helix(0.4), helix(0.4)[:, ::-1], arc_between_lines()], ids=["helix", "turned", "pipe"]
)
def test_a_preformed_cable_rests_as_it_was_drawn(points):
    line = Centreline.from_points(points)
    cable = cs.Cable.from_centreline(points, 0.2, 0.05, diameter=0.012)
    for end in (line.end, None):
        shape = cs.predict(cable, line.start, end, gravity=(0.0, 0.0, 0.0))
        assert shape.usable
        assert np.linalg.norm(shape.positions - line.at(shape.arc_length), axis=1).max() < 1e-6 * line.length
    assert line.nearest(points)[1].max() < 1e-9
    moved = cs.predict(cable, line.start, cs.Pose(line.end.position + np.array([0.02, 0.0, 0.02]), line.end.quaternion))
    assert moved.usable


def test_a_piece_of_a_curve_is_that_piece():
    line = Centreline.from_points(helix())
    piece = line.cut(0.7, 0.2)
    assert piece.length == pytest.approx(0.5, abs=1e-9)
    assert np.allclose(piece.at([0.0, 0.1, 0.5]), line.at([0.7, 0.6, 0.2]), atol=1e-9)


@pytest.mark.parametrize(
    ("points", "told"),
    [
        ([[0, 0, 0]], "n from 2"),
        ([[0, 0, 0], [0, 0, 0], [1, 0, 0]], "the same point"),
        ([[0, 0, 0], [1, 0, 0], [0.1, 0.01, 0]], "turns back"),
        ([[0, 0, 0], [math.nan, 0, 0]], "finite"),
        (np.stack([np.sin(t := np.linspace(0, 6, 80)), np.sin(2 * t), 0 * t], 1), "through itself"),
    ],
)
def test_what_is_no_cable_is_refused(points, told):
    with pytest.raises(ArgumentError, match=told):
        cs.Cable.from_centreline(points, 0.1, 0.01)


# -- tubes


def tube(points, radius, rings=150, around=16):
    line = Centreline.from_points(points)
    angle = 2.0 * math.pi * np.arange(around) / around
    circle = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    s = np.linspace(0.0, line.length, rings)
    vertices = np.concatenate([[(pose * cs.Pose(p)).position for p in circle] for pose in line.poses(s)])
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    faces = np.concatenate([np.stack([a, b, a + around], 1), np.stack([b, b + around, a + around], 1)])
    return line, vertices, faces


def far_apart(found, line):
    s = np.linspace(0.0, 1.0, 400)
    here, there = found.at(s * found.length), line.at(s * line.length)
    return max(line.nearest(here)[1].max(), found.nearest(there)[1].max())


@pytest.mark.parametrize("radius", [0.004, 0.008])
def test_a_tube_gives_its_centreline_back(radius):
    line, vertices, faces = tube(helix(), radius)
    found, diameter = centreline_of(vertices, faces, "tube")
    assert far_apart(found, line) < 1e-4
    assert diameter == pytest.approx(2 * radius, rel=0.02)
    chance = np.random.default_rng(1)
    rough = vertices + chance.normal(size=vertices.shape) * 2e-4 / math.sqrt(3.0)
    left = faces[np.linalg.norm(vertices[faces].mean(axis=1) - vertices[900], axis=1) > radius]
    found, diameter = centreline_of(rough, left[chance.random(len(left)) > 0.05], "tube")
    assert far_apart(found, line) < 2e-4
    assert diameter == pytest.approx(2 * radius, rel=0.02)


def test_meshes_that_are_no_tube_are_refused():
    _, v, f = tube(helix(0.3), 0.005)
    side = np.array([[0.0, 0.0, 0.3]])
    with pytest.raises(FileError, match="2 bodies"):
        centreline_of(np.concatenate([v, v + side]), np.concatenate([f, f + len(v)]), "two")
    ring = helix(1.0) * [1, 1, 0]
    _, v, f = tube(ring[:-1], 0.005, rings=150)
    first, last = np.arange(16), np.arange(16) + 149 * 16
    sewn = np.stack([last, np.roll(last, -1), first], 1)
    with pytest.raises(FileError, match=r"forks|ring"):
        centreline_of(v, np.concatenate([f, sewn]), "ring")


def write_stl(file, vertices, faces):
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel(), 0) for face in faces)
    file.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + body)


def write_glb(file, vertices, faces):
    r, f = vertices.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    head = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [{"byteLength": len(r)}, {"byteOffset": len(r), "byteLength": len(f)}],
        "buffers": [{"byteLength": len(r) + len(f)}],
    }  # fmt: skip
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(r + f), b"BIN\0") + r + f
    file.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


@pytest.mark.parametrize("kind", ["stl", "glb", "csv"])
def test_a_hose_of_a_file_becomes_a_cable(kind, tmp_path, capsys):
    line, vertices, faces = tube(helix(0.4), 0.006)
    file = tmp_path / f"hose.{kind}"
    if kind == "csv":
        np.savetxt(file, 1e3 * helix(0.4), delimiter=",", header="x,y,z", comments="")
    else:
        (write_stl if kind == "stl" else write_glb)(file, vertices * (1.0 if kind == "glb" else 1e3), faces)
    unit = [] if kind == "glb" else ["--unit", "mm"]
    options = ["--linear-density", "0.1", "--bending-stiffness", "0.05", "--diameter", "0.012"]
    assert main(["import", str(file), "-o", str(tmp_path / "out"), *unit, *options]) == 0
    assert cs.Cable.from_yaml(tmp_path / "out" / "cable.yaml").length == pytest.approx(line.length, abs=2e-4)
    assert main(["predict", str(tmp_path / "out" / "case.yaml")]) == 0
    capsys.readouterr()


def test_a_dxf_gives_its_chain(tmp_path):
    ezdxf = pytest.importorskip("ezdxf", reason="DXF is read with the extra drawings")
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 4
    space = drawing.modelspace()
    space.add_line((0, 0), (300, 0))
    space.add_arc((300, 50), 50, -90, 0)
    space.add_line((350, 350), (350, 50))
    drawing.saveas(tmp_path / "pipe.dxf")
    line, _, _ = read_curve(tmp_path / "pipe.dxf", None)
    assert line.length == pytest.approx(0.6 + 0.025 * math.pi, rel=1e-4)
    assert line.nearest(arc_between_lines())[1].max() < 1e-4
    space.add_line((0, 0), (-100, 0))
    space.add_line((0, 0), (0, -100))
    drawing.saveas(tmp_path / "fork.dxf")
    with pytest.raises(FileError, match="fork"):
        read_curve(tmp_path / "fork.dxf", None)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.csv", b"x,y,z\n1,2,3\n1,2\n", "line 3"),
        ("a.csv", b"\xff\xfe\0", "UTF-8"),
        ("a.stl", b"\0" * 80 + (1_000_000).to_bytes(4, "little") + b"\0" * 50_000_000, "1000000 triangles"),
        ("a.glb", b"glTF\2\0\0\0", "not a well-formed GLB"),
        ("a.obj", b"v 0 0 0\n", "no face"),
    ],
)
def test_bad_curves_and_meshes_are_refused(name, content, told, tmp_path, capsys):
    (tmp_path / name).write_bytes(content)
    options = ["--unit", "mm", "--linear-density", "0.1", "--bending-stiffness", "0.05", "--diameter", "0.01"]
    assert main(["import", str(tmp_path / name), "-o", str(tmp_path / "out"), *options]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# -- WireViz and formboards

WIREVIZ = """
connectors: {X1: {pincount: 4}, X2: {pincount: 2}, X3: {pincount: 2}}
cables:
  W1: {category: bundle, length: 800 mm, gauge: 0.5 mm2, wirecount: 4}
  W2: {length: 1.5, gauge: 20 AWG, wirecount: 2}
connections:
  - [X1: [1, 2], W1: [1, 2], X2: 1-2]
  - [X1: 3-4, W1: [3, 4], X3: [1, 2]]
  - [X2: [1, 2], W2: [1, 2], X3: [1, 2]]
"""


def test_wireviz_asks_where_a_bundle_branches(tmp_path):
    file, branches = tmp_path / "w.yml", tmp_path / "b.yaml"
    file.write_text(WIREVIZ)
    with pytest.raises(ArgumentError, match=r"cables\.W1: it goes X1 to X2, X1 to X3"):
        from_wireviz(file)
    branches.write_text("W1: {from: X1, trunk: 0.3}\n")
    harness = from_wireviz(file, branches)
    lengths = {name: cable.length for name, cable in harness.segments.items()}
    assert lengths == pytest.approx({"W1-trunk": 0.3, "W1-X2": 0.5, "W1-X3": 0.5, "W2": 1.5})
    assert harness.segments["W1-trunk"].linear_density == pytest.approx(2 * harness.segments["W1-X2"].linear_density)
    file.write_text(WIREVIZ.replace("800 mm", "8 cubits"))
    with pytest.raises(ArgumentError, match="cubits"):
        from_wireviz(file, branches)


def test_a_formboard_is_true_to_length(example):
    board = laid_flat(cs.Harness.from_kbl(example))
    assert len(board.lines) == 180
    for line in board.lines:
        assert math.dist(line.start, line.end) == pytest.approx(line.length, rel=1e-12)
    drawn = svg(board)
    assert drawn.count("<line ") == 180
    x = [[float(v) for v in re.findall(r'[xy][12]="([-\d.]+)"', one)] for one in re.findall(r"<line [^>]*>", drawn)]
    assert [math.dist(one[:2], one[2:]) for one in x] == pytest.approx(
        [1e3 * line.length for line in board.lines], abs=2e-3
    )
    assert all(name in drawn for name in ("XL1", "XR60", "T30"))
    assert dxf(board).count("\nLINE\n") == 180


def test_a_tube_of_a_step_file_is_found_to_a_tenth_of_a_millimetre(tmp_path: Path) -> None:
    pytest.importorskip("OCP", reason="cadquery-ocp is not installed: pip install 'cable_shape[cad]'")
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
    from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipe
    from OCP.GeomAPI import GeomAPI_PointsToBSpline
    from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt
    from OCP.OCP.collections import Array1_gp_Pnt
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    def curve(t: np.ndarray) -> np.ndarray:
        return np.stack([600.0 * t, 80.0 * np.sin(3.0 * t), 50.0 * np.cos(2.0 * t)], axis=1)  # mm

    drawn = curve(np.linspace(0.0, 1.0, 40))
    points = Array1_gp_Pnt(1, len(drawn))
    for i, point in enumerate(drawn.tolist(), 1):
        points.SetValue(i, gp_Pnt(*point))
    spine = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(GeomAPI_PointsToBSpline(points).Curve()).Edge()).Wire()
    circle = gp_Circ(gp_Ax2(gp_Pnt(*drawn[0].tolist()), gp_Dir(*(drawn[1] - drawn[0]).tolist())), 6.0)
    rim = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(circle).Edge()).Wire()
    writer = STEPControl_Writer()
    writer.Transfer(BRepOffsetAPI_MakePipe(spine, BRepBuilderAPI_MakeFace(rim).Face()).Shape(), STEPControl_AsIs)
    writer.Write(str(tmp_path / "tube.step"))
    line, diameter, _ = read_step(tmp_path / "tube.step")
    assert diameter == pytest.approx(0.012, rel=0.02)
    fine = 1e-3 * curve(np.linspace(0.0, 1.0, 4001))
    seen = np.array([pose.position for pose in line.poses(np.linspace(0.0, line.length, 100))])
    assert np.linalg.norm(seen[:, None] - fine, axis=2).min(axis=1).max() < 1e-4
    (tmp_path / "broken.step").write_text("ISO-10303-21;\n")
    with pytest.raises(cs.FileError, match="not a well-formed STEP file"):
        read_step(tmp_path / "broken.step")


def test_step_without_its_extra_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "OCP", None)
    file = tmp_path / "tube.step"
    file.write_text("ISO-10303-21;\n")
    told = ["--linear-density", "0.1", "--bending-stiffness", "0.01", "-o", str(tmp_path / "out")]
    assert main(["import", str(file), *told]) != 0
    assert "OCP is not installed. Run: pip install 'cable_shape[cad]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_tube_that_forks_is_refused():
    x = np.linspace(0.0, 0.3, 61)
    trunk = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    away = np.maximum(x - 0.02, 0.0)
    branch = np.stack([0.15 + 0.5 * x, 0.7 * away, 0.0 * x], axis=1)
    _, v, f = tube(trunk, 0.004, rings=61)
    _, w, g = tube(branch, 0.004, rings=61)
    ring = v[30 * 16 : 31 * 16]
    w[:16] = ring[np.linalg.norm(w[:16, None] - ring, axis=2).argmin(axis=1)]
    with pytest.raises(FileError, match=r"fork"):
        centreline_of(np.concatenate([v, w]), np.concatenate([f, g + len(v)]), "tree")
