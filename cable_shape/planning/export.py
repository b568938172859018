"""Shapes as files of other programs: :func:`export`."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cable.pieces import radius_of, thicker
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of
from cable_shape.planning.export_glb import glb
from cable_shape.planning.export_mesh import obj, stl, tube
from cable_shape.planning.export_mjcf import mjcf
from cable_shape.planning.study_chunk import write
from cable_shape.planning.swept import Swept
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape

#: Endings, and whether all instants of a motion are told, or one shape only.
ENDINGS = {
    ".stl": False, ".obj": False, ".glb": True, ".usda": True, ".usdc": True, ".usd": True, ".dxf": True,
    ".csv": True, ".xml": False, ".nc": True,
}  # fmt: skip
_CSV = ("instant", "segment", "arc_length", "x", "y", "z")


def export(
    shapes: CableShape | HarnessShape | Swept | Sequence[CableShape | HarnessShape],
    path: str | Path,
    cable: Cable | Harness | None = None,
    *,
    period: float = 0.02,
) -> Path:
    """Writes one shape, or a motion, in the format of the path's ending; lengths are in metres, z points up.

    ==================  ========================================================================================
    .stl, .obj          the cable as a closed tube, or a swept space
    .glb                the tube with the motion as an animation; y points up, as glTF has it
    .usda, .usdc, .usd  BasisCurves with widths, a time sample an instant (extra `usd`)
    .dxf, .csv          centrelines
    .xml                MuJoCo's MJCF of the cable in this shape, to go on from in a simulation
    .nc                 netCDF of all that a shape has (extra `netcdf`)
    ==================  ========================================================================================

    Parameters
    ----------
    shapes : CableShape, HarnessShape or a sequence of these
        Usable ones; or what :func:`swept` returns, for .stl and .obj.
    cable : Cable or Harness
        Whose shapes they are: for its diameter and stiffness. Not needed of a swept space.
    period : float
        [s], between two instants.

    Raises
    ------
    ArgumentError
        For an ending that is not known, a motion where one shape is told, shapes that cannot be used.
    FileError
        If the file cannot be written.
    DependencyError
        Without the library of an extra.
    """
    file = path_of(path, "path")
    kind = file.suffix.lower()
    if kind not in ENDINGS:
        raise ArgumentError.of("path", str(file), f"it must end in {', '.join(ENDINGS)}", "Name another file.")
    checks.number("period", period, above=0.0, unit="s")
    if isinstance(shapes, Swept):
        if kind not in (".stl", ".obj"):
            raise ArgumentError.of("path", str(file), "a swept space is told as .stl or .obj", "Name another file.")
        mesh = shapes.vertices, shapes.faces
        write(file, stl(*mesh) if kind == ".stl" else obj({"swept": mesh}))
        return file
    motions, cables = _parts(shapes, cable)
    count = len(next(iter(motions.values())))
    if count > 1 and not ENDINGS[kind]:
        bound = f"a {kind} file has one shape, and these are {count}"
        raise ArgumentError.of("path", str(file), bound, "Give one shape, or name a .glb or .usda file.")
    write(file, _content(kind, motions, cables, period))
    return file


def _parts(shapes: Any, cable: Any) -> tuple[dict[str, list[CableShape]], dict[str, Cable]]:
    """Shapes at all instants by segment, and what they are of."""
    checks.instance("cable", cable, (Cable, Harness), "Give the cable or harness whose shapes they are.")
    of_one: Any = HarnessShape if isinstance(cable, Harness) else CableShape
    alone = isinstance(shapes, (CableShape, HarnessShape))
    given = checks.entries("shapes", [shapes] if alone else shapes, of_one, "Give a shape of this cable, or a list.")
    if not given:
        raise ArgumentError.of("shapes", shapes, "there must be one at least", "Give a shape, or a list of them.")
    for i, shape in enumerate(given):
        if not shape.usable:
            raise ArgumentError.of(f"shapes[{i}]", shape, "it must be usable", "Leave such instants out.")
    if isinstance(cable, Harness):
        return {name: [one.segments[name] for one in given] for name in cable.segments}, dict(cable.segments)
    return {"": list(given)}, {"": cable}


def _content(kind: str, motions: dict[str, list[CableShape]], cables: Mapping[str, Cable], period: float) -> bytes:
    """The bytes of a file."""
    radius = {name: _radius(cable, motions[name][0]) for name, cable in cables.items()}
    if kind == ".glb":
        return glb(motions, radius, period)
    if kind == ".xml":
        if len(cables) > 1:
            raise ArgumentError.of("path", kind, "MJCF is told of one cable, not of a harness", "Export a segment.")
        (name,) = cables
        return mjcf(motions[name][0], cables[name])
    if kind in (".stl", ".obj"):
        tubes = {name: tube(shapes[0], radius[name]) for name, shapes in motions.items()}
        if kind == ".obj":
            return obj(tubes)
        first = np.cumsum([0, *(len(vertices) for vertices, _ in tubes.values())])
        faces = [own + at for (_, own), at in zip(tubes.values(), first, strict=False)]
        return stl(np.concatenate([vertices for vertices, _ in tubes.values()]), np.concatenate(faces))
    if kind == ".csv":
        return _csv(motions)
    if kind == ".dxf":
        return _dxf(motions)
    return _netcdf(motions, period) if kind == ".nc" else _usd(kind, motions, radius, period)


def _radius(cable: Cable, shape: CableShape) -> Array:
    """(n,) [m]."""
    more = thicker(cable, shape.arc_length) if cable.sections else None
    return np.asarray(np.full(shape.points, radius_of(cable)) + (0.0 if more is None else more))


def _csv(motions: Mapping[str, Sequence[CableShape]]) -> bytes:
    lines = [",".join(_CSV)]
    for name, shapes in motions.items():
        for i, shape in enumerate(shapes):
            rows = np.column_stack((shape.arc_length, shape.positions)).tolist()
            lines += [f"{i},{name},{s!r},{x!r},{y!r},{z!r}" for s, x, y, z in rows]
    return ("\n".join(lines) + "\n").encode()


def _dxf(motions: Mapping[str, Sequence[CableShape]]) -> bytes:
    """A polyline an instant, on a layer of its segment."""
    from ezdxf.filemanagement import new

    drawing = new("R2010", setup=False)
    drawing.header["$INSUNITS"] = 6
    for name, shapes in motions.items():
        layer = name or "cable"
        if layer not in drawing.layers:
            drawing.layers.add(layer)
        for shape in shapes:
            drawing.modelspace().add_polyline3d(shape.positions.tolist(), dxfattribs={"layer": layer})
    text = io.StringIO()
    drawing.write(text)
    return text.getvalue().encode()


def _netcdf(motions: Mapping[str, Sequence[CableShape]], period: float) -> bytes:
    """Classic netCDF, which everything reads; variables of a segment have its name before theirs."""
    import xarray

    data: dict[str, Any] = {}
    for name, shapes in motions.items():
        before = f"{name}/".lstrip("/").replace("/", "_")
        units = {"positions": "m", "quaternions": "1", "curvature": "m-1", "force": "N", "moment": "N m"}
        data[f"{before}arc_length"] = ((f"{before}point",), shapes[0].arc_length, {"units": "m"})
        for field, unit in units.items():
            wide = "xyzw" if field == "quaternions" else "xyz"
            dims = ("instant", f"{before}point", wide)
            data[before + field] = (dims, np.array([getattr(shape, field) for shape in shapes]), {"units": unit})
        data[f"{before}status"] = (("instant",), np.array([shape.status.value for shape in shapes]))
    count = len(next(iter(motions.values())))
    table = xarray.Dataset(
        data, {"time": (("instant",), period * np.arange(count), {"units": "s"})}, {"source": "cable_shape"}
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shapes.nc"
        table.to_netcdf(file, engine="scipy", format="NETCDF3_64BIT")
        return file.read_bytes()


def _usd(kind: str, motions: Mapping[str, Sequence[CableShape]], radius: Mapping[str, Array], period: float) -> bytes:
    """Curves with their widths; a time code is an instant."""
    from pxr import Gf, Usd, UsdGeom, Vt

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"shapes{kind}"
        stage = Usd.Stage.CreateNew(str(file))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/cables").GetPrim())
        count = len(next(iter(motions.values())))
        if count > 1:
            stage.SetTimeCodesPerSecond(1.0 / period)
            stage.SetStartTimeCode(0)
            stage.SetEndTimeCode(count - 1)
        for name, shapes in motions.items():
            word = "".join(c if c.isalnum() else "_" for c in name) or "cable"
            curve = UsdGeom.BasisCurves.Define(stage, f"/cables/{'_' if word[0].isdigit() else ''}{word}")
            curve.CreateTypeAttr(UsdGeom.Tokens.linear)
            curve.CreateCurveVertexCountsAttr(Vt.IntArray([shapes[0].points]))
            curve.CreateWidthsAttr(Vt.FloatArray((2.0 * radius[name]).tolist()))
            curve.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
            points = curve.CreatePointsAttr()
            for i, shape in enumerate(shapes):
                told = Vt.Vec3fArray([Gf.Vec3f(*row) for row in shape.positions.tolist()])
                points.Set(told, Usd.TimeCode(i) if count > 1 else Usd.TimeCode.Default())
        stage.GetRootLayer().Save()
        return file.read_bytes()
