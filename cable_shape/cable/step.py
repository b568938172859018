"""Tubes from STEP files by OpenCASCADE (extra `cad`): :func:`read_step`. Its triangles, to a tenth of a millimetre."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.cable.centreline import Centreline
from cable_shape.cable.tube_mesh import centreline_of
from cable_shape.errors import FileError
from cable_shape.files.files import TEXT_BYTES, regular

#: [mm], [rad]: how near the triangles are to the surface.
_SAG, _ANGLE = 0.05, 0.4
_MILLIMETRE = 1e-3


def read_step(path: str | Path) -> tuple[Centreline, float | None, str]:
    """The centreline and diameter [m] of the one tube in a STEP file, whose unit it says itself.

    Raises
    ------
    FileError
        Naming the file: no STEP, no solid or face, several bodies, a fork.
    DependencyError
        Without cadquery-ocp.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    file = regular(path, 4 * TEXT_BYTES, "STEP file")
    reader: Any = STEPControl_Reader()
    if int(reader.ReadFile(str(file))) != 1 or reader.TransferRoots() < 1:
        raise FileError(f"{file}: not a well-formed STEP file. Export it again as AP203, AP214 or AP242.")
    shape = reader.OneShape()
    BRepMesh_IncrementalMesh(shape, _SAG, False, _ANGLE, False)
    vertices: list[Any] = []
    faces: list[Any] = []
    explorer: Any = TopExp_Explorer(shape, TopAbs_FACE)
    while explorer.More():
        place = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(TopoDS.Face(explorer.Current()), place)
        if mesh is not None:
            move, first = place.Transformation(), len(vertices)
            for i in range(1, mesh.NbNodes() + 1):
                p = mesh.Node(i).Transformed(move)
                vertices.append((p.X(), p.Y(), p.Z()))
            for i in range(1, mesh.NbTriangles() + 1):
                faces.append([first + k - 1 for k in mesh.Triangle(i).Get()])  # noqa: PERF401
        explorer.Next()
    if not faces:
        raise FileError(f"{file}: it has no surface. Export the cable as a solid, or its centreline as DXF or CSV.")
    points = _MILLIMETRE * np.round(np.array(vertices), 6)  # edges that faces share become one
    line, diameter = centreline_of(points, np.array(faces), str(file))
    return line, diameter, f"Centreline and diameter fitted to {len(faces)} triangles of its surface."
