"""Centrelines from DXF files by ezdxf: one chain of lines, arcs, polylines and splines. :func:`read_dxf`"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.cable.centreline import Centreline
from cable_shape.checks import Array
from cable_shape.errors import FileError
from cable_shape.files.files import TEXT_BYTES, regular

#: $INSUNITS, to m.
UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 13: 1e-6, 14: 0.1}
#: Ends nearer than this share of the drawing meet.
_JOINT = 1e-6
_KINDS = "LINE ARC CIRCLE ELLIPSE SPLINE LWPOLYLINE POLYLINE"


def read_dxf(path: str | Path, unit: float | None = None) -> Centreline:
    """The one open chain in a drawing's model space; unit [m] of its numbers, where it does not say it.

    Raises
    ------
    FileError
        Naming the file: no DXF, no unit, no curve, several chains, a fork or a ring.
    DependencyError
        Without ezdxf.
    """
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError
    from ezdxf.path import make_path

    file = regular(path, TEXT_BYTES, "DXF file")
    try:
        drawing = readfile(file)
    except (OSError, DXFError, UnicodeError, ValueError) as error:
        reason = type(error).__name__
        raise FileError(f"{file}: not a well-formed DXF file ({reason}). Export it again, as ASCII DXF.") from None
    known = UNITS.get(int(drawing.header.get("$INSUNITS", 0)))
    scale = known if unit is None else unit
    if scale is None:
        raise FileError(f"{file}: it does not say its unit ($INSUNITS). Give it with --unit.")
    pieces = []
    for entity in drawing.modelspace().query(_KINDS):
        try:
            path_of_it: Any = make_path(entity)
        except (TypeError, ValueError, DXFError):
            continue
        points = np.array([tuple(p) for p in path_of_it.flattening(_sag(path_of_it), segments=24)])
        if len(points) > 1:
            pieces.append(scale * points)
    if not pieces:
        raise FileError(f"{file}: no line, arc, polyline or spline is in its model space. Draw the centreline there.")
    return Centreline.from_points(_through(_chained(pieces, str(file))), str(file))


def _sag(one: Any) -> float:
    """By how much chords may miss a curve, in its own unit."""
    points = np.array([tuple(p) for p in one.control_vertices()])
    return max(float(np.ptp(points, axis=0).max()) * 1e-5, 1e-9)


def _chained(pieces: list[Array], where: str) -> Array:
    """All pieces as one, end to end."""
    whole = np.concatenate(pieces)
    near = _JOINT * max(float(np.ptp(whole, axis=0).max()), 1e-9)
    tips = np.array([(p[0], p[-1]) for p in pieces]).reshape(-1, 3)
    meets = np.linalg.norm(tips[:, None] - tips, axis=2) <= near
    count = meets.sum(axis=1)
    if (count > 2).any():
        at = ", ".join(f"{x:.4g}" for x in tips[int(count.argmax())])
        raise FileError(f"{where}: its curves fork at ({at}) m. Leave one cable in the drawing.")
    loose = np.flatnonzero(count == 1)
    if len(loose) != 2:
        what = "are a closed ring" if not len(loose) else f"are {len(loose) // 2} chains that do not meet"
        raise FileError(f"{where}: its curves {what}. Draw one open centreline.")
    tip, out, used = int(loose[0]), list[Array](), set[int]()
    while True:
        i, side = divmod(tip, 2)
        used.add(i)
        piece = pieces[i] if side == 0 else pieces[i][::-1]
        out.append(piece if not out else piece[1:])
        other = 2 * i + 1 - side
        following = [int(k) for k in np.flatnonzero(meets[other]) if int(k) // 2 not in used]
        if not following:
            return np.concatenate(out)
        tip = following[0]


def _through(points: Array) -> Array:
    """Points with more between those that are far apart, so that a spline through them keeps straight stretches."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    most = max(float(np.median(step)) * 2.0, float(step.sum()) / 400.0)
    out = [points[:1]]
    for a, b, size in zip(points[:-1], points[1:], step, strict=True):
        n = int(np.ceil(size / most))
        out.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(out)
