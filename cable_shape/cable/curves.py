"""Curves and tubes of CAD as preformed cables: CSV, DXF, STL, OBJ, GLB, STEP. :func:`preformed`"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.centreline import Centreline
from cable_shape.cable.preformed import check_crossing
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, FileError
from cable_shape.files.files import read_text, regular
from cable_shape.scene.mesh_files import MAX_FACES, read_triangles

#: [m]
UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254}
MESHES = (".stl", ".obj", ".glb")
#: Bytes of a triangle of a binary STL.
_TRIANGLE = 50


def preformed(
    file: Path, unit: str | None, linear_density: float | None, bending_stiffness: float | None, diameter: float | None
) -> tuple[Cable, Centreline, str]:
    """The cable in a file, where it was drawn, and what became of it, in words.

    Raises
    ------
    FileError, ArgumentError
        Naming the file, the part and the remedy.
    """
    for name, value, what in (
        ("--linear-density", linear_density, "kg/m"), ("--bending-stiffness", bending_stiffness, "N m^2"),
    ):  # fmt: skip
        if value is None:
            raise ArgumentError(f"{name} is missing: no CAD file says it. Give it in {what}.")
    assert linear_density is not None
    assert bending_stiffness is not None
    line, found, told = read_curve(file, unit)
    thick = diameter or found
    if thick is None:
        raise ArgumentError("--diameter is missing: a curve has none. Give it in m.")
    check_crossing(line, 0.5 * thick, str(file))
    cable = Cable.from_centreline(line, linear_density, bending_stiffness, diameter=thick)
    rows = len(cable.rest_curvature)
    text = [
        f"# {file.name}", "",
        f"{line.length:.6f} m long, {1e3 * thick:.4g} mm thick; {rows} rows of rest curvature.", told,
        "Linear density and bending stiffness are as given on the command line: the file says neither.",
    ]  # fmt: skip
    return cable, line, "\n".join(text) + "\n"


def read_curve(file: Path, unit: str | None) -> tuple[Centreline, float | None, str]:
    """The centreline of a file, the diameter [m] where it has one, and how it was found."""
    kind = file.suffix.lower()
    if unit is not None and unit not in UNITS:
        raise ArgumentError.of("--unit", unit, f"it must be one of {', '.join(UNITS)}", "Choose one of these.")
    if kind == ".glb":
        from cable_shape.cable.glb import read_glb
        from cable_shape.cable.tube_mesh import centreline_of

        vertices, faces = read_glb(file)
        line, diameter = centreline_of(vertices * UNITS[unit or "m"], faces, str(file))
        return line, diameter, f"Centreline and diameter fitted to {len(faces)} triangles."
    if kind == ".dxf":
        from cable_shape.cable.dxf_read import read_dxf

        return read_dxf(file, None if unit is None else UNITS[unit]), None, "One chain of lines, arcs and splines."
    if kind in (".step", ".stp"):
        from cable_shape.cable.step import read_step

        return read_step(file)
    if unit is None:
        raise ArgumentError(f"--unit is missing: {file.name} does not say its unit. Give one of {', '.join(UNITS)}.")
    if kind == ".csv":
        line = Centreline.from_points(UNITS[unit] * read_points(file), str(file))
        return line, None, "The smooth curve through its points."
    from cable_shape.cable.tube_mesh import centreline_of

    _check_size(file, kind)
    vertices, faces = read_triangles(file)
    if len(faces) > MAX_FACES:
        raise _too_many(file, len(faces))
    line, diameter = centreline_of(UNITS[unit] * vertices, faces, str(file))
    return line, diameter, f"Centreline and diameter fitted to {len(faces)} triangles."


def read_points(file: Path) -> Array:
    """(n, 3): x, y, z a row, separated by commas, semicolons, tabs or blanks; a first row of words is passed over."""
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(file).splitlines(), start=1):
        words = line.replace(";", " ").replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            row = [float(word) for word in words[:3]]
            if len(row) < 3 or not all(map(math.isfinite, row)):
                raise ValueError
        except ValueError:
            if number == 1:
                continue
            raise FileError(f"{file}, line {number}: it must be three numbers x, y, z. Correct that line.") from None
        rows.append(row)
    if len(rows) < 2:
        raise FileError(f"{file}: it has {len(rows)} points, two or more make a curve. Give x, y, z a row.")
    return np.array(rows)


def _check_size(file: Path, kind: str) -> None:
    """Refuses at once what is far too many triangles."""
    size = regular(file, what="mesh file").stat().st_size
    if kind == ".stl" and size > 84 + _TRIANGLE * 6 * MAX_FACES:
        raise _too_many(file, size // _TRIANGLE)
    with file.open("rb") as stream:
        head = stream.read(84)
    if kind == ".stl" and len(head) == 84:
        count = int.from_bytes(head[80:84], "little")
        if size == 84 + _TRIANGLE * count and count > MAX_FACES:
            raise _too_many(file, count)


def _too_many(file: Path, count: int) -> FileError:
    remedy = "Simplify the mesh: a tube needs some thousands"
    return FileError(f"{file}: {count} triangles, at most {MAX_FACES} are read. {remedy}.")
