"""The fields of cable_shape_msgs as plain values: what the node and the replay put in their messages.

A flat array is a contiguous float64 numpy array; whoever fills a message turns it into what his message class wants.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.safety.report import CableWarning, Margin
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status

#: the arrays of cable_shape_msgs/CableShape in the order of a shape's buffer, with their numbers per point
ARRAYS = (("arc_length", 1), ("positions", 3), ("quaternions", 4), ("curvature", 3), ("force", 3), ("moment", 3))

#: what cable/points holds for each point, as little-endian float32: place [m], arc length [m], tension [N]
POINT_FIELDS = ("x", "y", "z", "arc_length", "tension")
POINT_BYTES = 4 * len(POINT_FIELDS)

#: [m], of grips, bodies and clips from their frame; farther away, doubles no longer tell tenths of a micrometre
FARTHEST = 1e6


def point_rows(shapes: Mapping[str, CableShape]) -> Any:
    """(points of all shapes, 5) little-endian float32, see `POINT_FIELDS`."""
    rows = np.empty((sum(shape.points for shape in shapes.values()), len(POINT_FIELDS)), dtype="<f4")
    first = 0
    for shape in shapes.values():
        here = rows[first : first + shape.points]
        here[:, :3], here[:, 3], here[:, 4] = shape.positions, shape.arc_length, shape.tension
        first += shape.points
    return rows


def shape_fields(cable_id: str, shape: CableShape) -> dict[str, Any]:
    """All fields of cable_shape_msgs/CableShape but the header; arrays are flat views of the shape's buffer."""
    fields: dict[str, Any] = {
        "cable_id": cable_id,
        "model": shape.model,
        "status": shape.status.value,
        "usable": shape.usable,
        "detail": shape.detail,
        "length": float(shape.length),
        "energy": float(shape.energy),
        "error_estimate": float(shape.error_estimate),
        "reused": bool(shape.reused),
        "solve_time": float(shape.solve_time),
    }
    first = 0
    for name, width in ARRAYS:
        last = first + width * shape.points
        fields[name] = shape.buffer[first:last]
        first = last
    return fields


def shape_from(message: Any) -> CableShape:
    """The shape in a cable_shape_msgs/CableShape, whichever library made the message; arrays are copied."""
    points = len(message.arc_length)
    buffer = CableShape.new_buffer(points)
    first = 0
    for name, width in ARRAYS:
        last = first + width * points
        buffer[first:last] = np.asarray(getattr(message, name), dtype=np.float64)
        first = last
    assert first == NUMBERS_PER_POINT * points
    return CableShape(
        buffer,
        points,
        length=message.length,
        model=message.model,
        status=Status(message.status),
        detail=message.detail,
        energy=message.energy,
        error_estimate=message.error_estimate,
        reused=bool(message.reused),
        solve_time=message.solve_time,
    )


def warning_fields(warning: CableWarning) -> dict[str, Any]:
    """All fields of cable_shape_msgs/CableWarning; points are dicts of x, y, z."""
    return {
        "cable_id": warning.cable_id,
        "kind": warning.kind.value,
        "severity": warning.severity.value,
        "other": warning.other,
        "arc_length": float(warning.arc_length),
        "value": float(warning.value),
        "limit": float(warning.limit),
        "margin": float(warning.margin),
        "point_on_cable": _xyz(warning.point_on_cable),
        "point_on_other": _xyz(warning.point_on_other),
        "time_to_limit": float(warning.time_to_limit),
        "text": warning.text,
    }


def margin_fields(cable_id: str, margin: Margin) -> dict[str, Any]:
    """All fields of cable_shape_msgs/CableMargin."""
    return {
        "cable_id": cable_id,
        "kind": margin.kind.value,
        "other": margin.other,
        "used": float(margin.used),
        "limit": float(margin.limit),
        "value": float(margin.value),
        "arc_length": float(margin.arc_length),
        "time_to_limit": float(margin.time_to_limit),
    }


def _xyz(point: Array) -> dict[str, float]:
    return {"x": float(point[0]), "y": float(point[1]), "z": float(point[2])}
