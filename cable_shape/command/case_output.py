"""What `cable-shape predict` gives: a table of one shape, and files of it (JSON, CSV, a picture)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.command.case import Case
from cable_shape.errors import ArgumentError
from cable_shape.files.files import finite
from cable_shape.shape import CableShape

Row = tuple[str, str]
SUFFIXES = (".json", ".csv", ".png", ".rrd")

COLUMNS = (
    "arc_length [m]",
    "x [m]",
    "y [m]",
    "z [m]",
    "qx",
    "qy",
    "qz",
    "qw",
    "u1 [1/m]",
    "u2 [1/m]",
    "u3 [1/m]",
    "force x [N]",
    "force y [N]",
    "force z [N]",
    "moment x [N m]",
    "moment y [N m]",
    "moment z [N m]",
)


def check_suffix(path: Path) -> Path:
    """`path`, if it names a format that can be written."""
    if path.suffix.lower() not in SUFFIXES:
        raise ArgumentError(f"-o {path}: its ending must be one of {', '.join(SUFFIXES)}.")
    return path


def rows(case: Case, shape: CableShape) -> Iterator[Row]:
    """The figures of one shape in words."""
    positions, s = shape.positions, shape.arc_length
    yield "cable", case.cable.describe()
    yield "model", shape.model
    yield "status", f"{shape.status.name}: {shape.detail or shape.status.remedy}"
    yield "error estimate", f"{shape.error_estimate:.3g} m"
    yield "residual", f"{shape.residual:.3g}"
    yield "iterations", str(shape.iterations)
    yield "solve time", f"{shape.solve_time * 1e6:.0f} µs"
    yield "energy", f"{shape.energy:.6g} J"
    chord = math.dist(positions[0], positions[-1])
    yield "chord", f"{chord:.6g} m, {100.0 * chord / shape.length:.2f} % of the length"
    yield "force on the start grip", _vector(shape.force[0], "N")
    yield "moment on the start grip", _vector(shape.moment[0], "N m")
    yield "force on the end grip", _vector(-shape.force[-1], "N")
    yield "moment on the end grip", _vector(-shape.moment[-1], "N m")
    for clip in shape.clips:
        yield f"force on the clip at s = {clip.arc_length:.4g} m", _vector(clip.force, "N")
        yield f"moment on the clip at s = {clip.arc_length:.4g} m", _vector(clip.moment, "N m")
    radius = shape.bend_radius
    at = int(np.argmin(radius))
    yield "smallest bend radius", f"{radius[at]:.4g} m at s = {s[at]:.4g} m"
    tension = shape.tension
    at = int(np.argmax(tension))
    yield "largest tension", f"{tension[at]:.4g} N at s = {s[at]:.4g} m"
    at = int(np.argmin(positions[:, 2]))
    yield "lowest point", f"z = {positions[at, 2]:.6g} m at s = {s[at]:.4g} m"
    yield "twist", f"{math.degrees(shape.twist):.4g} deg, {shape.turns} turns"
    if shape.roll_error:
        yield "roll unmet at the end", f"{math.degrees(shape.roll_error):.4g} deg: this model has no twist"
    distance = distance_to_reference(case, shape)
    if distance is not None:
        yield "distance to the reference", f"mean {distance:.3g} of the length, at equal arc length"


def distance_to_reference(case: Case, shape: CableShape) -> float | None:
    """Mean distance at equal arc length to the case's reference, as a fraction of the length; None without one."""
    reference = case.reference
    if reference is None:
        return None
    from scipy.interpolate import CubicSpline

    at = CubicSpline(shape.arc_length, shape.positions)(reference.arc_length)
    return float(np.linalg.norm(at - reference.positions, axis=1).mean() / shape.length)


def as_dict(case: Case, shape: CableShape) -> dict[str, Any]:
    """The shape as plain values; infinite and undefined numbers as None."""
    return {
        "name": case.name,
        "cable": case.cable.as_dict(),
        "model": shape.model,
        "status": shape.status.name,
        "usable": shape.usable,
        "detail": shape.detail,
        "error_estimate": finite(shape.error_estimate),
        "residual": finite(shape.residual),
        "iterations": shape.iterations,
        "solve_time": shape.solve_time,
        "energy": finite(shape.energy),
        "twist": finite(shape.twist),
        "turns": shape.turns,
        "roll_error": finite(shape.roll_error),
        "distance_to_reference": distance_to_reference(case, shape),
        "clips": [
            {"arc_length": clip.arc_length, "force": clip.force.tolist(), "moment": clip.moment.tolist()}
            for clip in shape.clips
        ],
        **{name: getattr(shape, name).tolist() for name in _ARRAYS},
    }


_ARRAYS = ("arc_length", "positions", "quaternions", "curvature", "force", "moment")


def write(case: Case, shape: CableShape, path: Path) -> None:
    """Writes the shape to `path`, in the format of its ending."""
    kind = check_suffix(path).suffix.lower()
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == ".json":
        path.write_text(json.dumps(as_dict(case, shape), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    elif kind == ".csv":
        np.savetxt(path, _table(shape), fmt="%.12g", delimiter=",", header=",".join(COLUMNS), comments="")
    elif kind == ".rrd":
        from cable_shape.command.recorded import record

        record(path, {case.name: case.cable}, {case.name: (case.start, case.end)}, case.scene)
    else:
        _draw(case, shape, path)


def _table(shape: CableShape) -> Array:
    """(n, 17), in the order of COLUMNS."""
    arrays = (shape.arc_length[:, None], *(getattr(shape, name) for name in _ARRAYS[1:]))
    return np.hstack(arrays)


def _draw(case: Case, shape: CableShape, path: Path) -> None:
    """The centreline from two sides, and curvature and tension along it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 7.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{case.name}: {shape.model}, {shape.status.name}")
    axes = figure.subplots(2, 2)
    x, y, z = shape.positions.T
    for axis, across, label in ((axes[0, 0], x, "x"), (axes[0, 1], y, "y")):
        if case.reference is not None:
            reference = case.reference.positions
            axis.plot(reference[:, "xy".index(label)], reference[:, 2], "o", ms=3, color="#999999", label="reference")
            axis.legend(loc="best", fontsize=8)
        axis.plot(across, z, color="#2563a8", lw=1.8)
        axis.set(xlabel=f"{label} [m]", ylabel="z [m]", aspect="equal", adjustable="datalim")
    axes[1, 0].plot(shape.arc_length, shape.curvature, label=["u1", "u2", "u3 (twist)"], lw=1.2)
    axes[1, 0].set(xlabel="arc length [m]", ylabel="curvature [1/m]")
    axes[1, 0].legend(loc="best", fontsize=8)
    axes[1, 1].plot(shape.arc_length, shape.tension, color="#d98e04", lw=1.2)
    axes[1, 1].set(xlabel="arc length [m]", ylabel="tension [N]")
    figure.savefig(path, metadata={"Software": None})


def _vector(v: Array, unit: str) -> str:
    return f"({', '.join(f'{x:.4g}' for x in v)}) {unit}"
