"""Between ROS messages and the types of cable_shape: the only place of the node that copies fields."""

from __future__ import annotations

import array
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseStamped, Quaternion, TransformStamped, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from cable_shape.cable.cable import TAIL_SIDES
from cable_shape.checks import QUATERNION_TOLERANCE
from cable_shape.errors import ArgumentError
from cable_shape.messages.edits import edit_fields, scene_fields
from cable_shape.messages.fields import (
    FARTHEST,
    POINT_BYTES,
    POINT_FIELDS,
    margin_fields,
    point_rows,
    shape_fields,
    warning_fields,
)
from cable_shape.messages.pairing import SECOND
from cable_shape.pose import Pose
from cable_shape.prediction.edits import Edit
from cable_shape.prediction.layout import Layout
from cable_shape.ros import messages
from cable_shape.ros.diagnostics import Verdict
from cable_shape.safety.report import CableWarning, CycleReport, Severity, WarningKind
from cable_shape.shape import CableShape
from cable_shape.uncertainty.uncertainty import Tube

#: colours of the markers, as red, green, blue: fine, near a limit, beyond it
FINE, WARN, ERROR = (0.10, 0.65, 0.60), (0.95, 0.60, 0.10), (0.85, 0.15, 0.15)
COLOURS = {None: FINE, Severity.WARN: WARN, Severity.ERROR: ERROR}

#: opacity of the shape after a snap
GHOST = 0.35


def nanoseconds(time: Time) -> int:
    """A stamp in ns."""
    return int(time.sec) * SECOND + int(time.nanosec)


def time_of(stamp: int) -> Time:
    """A stamp given in ns."""
    sec, nanosec = divmod(stamp, SECOND)
    return Time(sec=sec, nanosec=nanosec)


def header_of(stamp: int, frame_id: str) -> Header:
    """A header with `stamp` in ns."""
    return Header(stamp=time_of(stamp), frame_id=frame_id)


def pose_of(message: PoseStamped) -> Pose:
    """The pose in a PoseStamped.

    Raises
    ------
    ArgumentError
        For entries that are not finite, a position out of all reach, and a quaternion that is not of unit length.
    """
    return _pose(message.pose.position, message.pose.orientation)


def transform_of(message: TransformStamped) -> Pose:
    """Where the child frame of a TransformStamped is in its parent.

    Raises
    ------
    ArgumentError
        As `pose_of`.
    """
    return _pose(message.transform.translation, message.transform.rotation)


def edits_message(done: Any, stamp: int, frame_id: str, number: int) -> messages.CableEdits:
    """What was done of a request, after the cycle of `stamp` [ns]."""
    header = header_of(stamp, frame_id)
    return messages.CableEdits(header=header, number=number, cable_id=done.cable_id, edits=done.edits)


def edit_message(edit: Edit) -> messages.CableEdit:
    """One edit."""
    fields = edit_fields(edit)
    if "pose" in fields:
        x, y, z, qx, qy, qz, qw = fields["pose"].array.tolist()
        place, turn = Point(x=x, y=y, z=z), Quaternion(x=qx, y=qy, z=qz, w=qw)
        fields["pose"] = PoseMessage(position=place, orientation=turn)
    return messages.CableEdit(**fields)


def scene_message(layout: Layout, stamp: int, frame_id: str, number: int) -> messages.CableScene:
    """What holds and surrounds the cables after the cycle of `stamp` [ns]."""
    return messages.CableScene(header=header_of(stamp, frame_id), number=number, **scene_fields(layout))


def _pose(p: Point | Vector3, q: Quaternion) -> Pose:
    """Position and quaternion of a message, checked."""
    row = np.array((p.x, p.y, p.z, q.x, q.y, q.z, q.w))
    if not (abs(q.x) < 2.0 and abs(q.y) < 2.0 and abs(q.z) < 2.0 and abs(q.w) < 2.0):
        return Pose(row[:3], row[3:])  # says what is wrong, here and below
    length = math.sqrt(float(row[3:] @ row[3:]))
    if not (abs(p.x) <= FARTHEST and abs(p.y) <= FARTHEST and abs(p.z) <= FARTHEST):
        pose = Pose(row[:3], row[3:])
        bound = f"every entry must be within {FARTHEST:g} m of the frame's origin"
        raise ArgumentError.of("position", pose.position.tolist(), bound, "Give it in m, in the frame of the cell.")
    if abs(length - 1.0) > QUATERNION_TOLERANCE:
        return Pose(row[:3], row[3:])
    row[3:] /= length  # the bits of Pose(...), in a third of its time
    row.flags.writeable = False
    return Pose.trusted(row)


def shape_message(cable_id: str, shape: CableShape, header: Header) -> messages.CableShape:
    """The message of every cycle: flat arrays, each filled in one copy."""
    message = messages.CableShape(header=header)
    for name, value in shape_fields(cable_id, shape).items():
        setattr(message, name, array.array("d", value.tobytes()) if isinstance(value, np.ndarray) else value)
    return message


def warnings_message(report: CycleReport, header: Header) -> messages.CableWarnings:
    """All warnings of a report; an empty list when there are none."""
    return messages.CableWarnings(
        header=header,
        robot_checked=report.robot_checked,
        warnings=[_warning_message(warning) for warning in report.warnings],
    )


def _warning_message(warning: CableWarning) -> messages.CableWarning:
    fields = warning_fields(warning)
    for name in ("point_on_cable", "point_on_other"):
        fields[name] = Point(**fields[name])
    return messages.CableWarning(**fields)


def margins_message(report: CycleReport, header: Header) -> messages.CableMargins:
    """All margins of a report."""
    return messages.CableMargins(
        header=header,
        margins=[
            messages.CableMargin(**margin_fields(cable_id, margin))
            for cable_id, margins in report.margins.items()
            for margin in margins
        ],
    )


def tube_message(cable_id: str, tube: Tube, header: Header) -> messages.CableTube:
    """How well a shape is known."""
    message = messages.CableTube(header=header, cable_id=cable_id, confidence=tube.confidence)
    message.radius = array.array("d", np.ascontiguousarray(tube.radius).tobytes())
    message.covariance = array.array("d", np.ascontiguousarray(tube.covariance).tobytes())
    return message


def path_message(shape: CableShape, header: Header) -> Path:
    """The centreline with its frames, as poses."""
    path = Path(header=header)
    for row in np.hstack((shape.positions, shape.quaternions)).tolist():
        stamped = PoseStamped(header=header)
        _fill_pose(stamped.pose, row)
        path.poses.append(stamped)
    return path


def points_message(shapes: Mapping[str, CableShape], header: Header) -> PointCloud2:
    """The centrelines of all cables, see `POINT_FIELDS`."""
    values = point_rows(shapes)
    width, row = len(values), POINT_BYTES
    cloud = PointCloud2(header=header, height=1, width=width, point_step=row, row_step=row * width, is_dense=True)
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate(POINT_FIELDS)
    ]
    cloud.data = array.array("B", values.tobytes())
    return cloud


def marker_message(report: CycleReport, diameters: Mapping[str, float], header: Header, lifetime: float) -> MarkerArray:
    """Each cable and its tails as thick lines coloured by the worst warning, its clearance warnings as lines between
    the witness points, the texts, and pale the shape after a snap that is about to come; markers vanish `lifetime`
    seconds after the last one came."""
    markers = MarkerArray()
    for cable_id, shape in report.shapes.items():
        warnings = [w for w in report.warnings if w.cable_id == cable_id]
        worst = max((w.severity for w in warnings), key=lambda s: s.value, default=None)
        near = [w for w in warnings if w.kind is WarningKind.CLEARANCE]
        line = _marker(cable_id, 0, Marker.LINE_STRIP, header, lifetime, COLOURS[worst])
        line.scale.x = diameters[cable_id]
        line.points = _points(shape.positions)
        gaps = _marker(cable_id, 1, Marker.LINE_LIST, header, lifetime, COLOURS[worst])
        gaps.scale.x = 0.003
        gaps.points = _points([p for w in near for p in (w.point_on_cable, w.point_on_other)])
        text = _marker(cable_id, 2, Marker.TEXT_VIEW_FACING, header, lifetime, COLOURS[worst])
        text.scale.z = 0.03
        text.text = "\n".join(w.text for w in warnings)
        text.pose.position = _points(shape.positions[len(shape.positions) // 2][None])[0]
        text.pose.position.z += 0.05
        shown = [(line, False), (gaps, not near), (text, not warnings)]
        more = [report.tails.get((cable_id, side)) for side in TAIL_SIDES] + [report.after_snap.get(cable_id)]
        for number, (other, alpha) in enumerate(zip(more, (1.0, 1.0, GHOST), strict=True), start=3):
            strip = _marker(cable_id, number, Marker.LINE_STRIP, header, lifetime, COLOURS[worst])
            strip.scale.x, strip.color.a = diameters[cable_id], alpha
            if other is not None:
                strip.points = _points(other.positions)
            shown.append((strip, other is None))
        for marker, empty in shown:
            marker.action = Marker.DELETE if empty else Marker.ADD
            markers.markers.append(marker)
    return markers


def _marker(
    cable_id: str, number: int, kind: int, header: Header, lifetime: float, colour: tuple[float, float, float]
) -> Marker:
    marker = Marker(header=header, ns=cable_id, id=number, type=kind)
    fraction, seconds = math.modf(lifetime)
    marker.lifetime = Duration(sec=int(seconds), nanosec=int(fraction * SECOND))
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=1.0)
    return marker


def diagnostics_message(verdicts: Sequence[Verdict], hardware_id: str, stamp: int) -> DiagnosticArray:
    """Verdicts as a DiagnosticArray; `stamp` in ns."""
    return DiagnosticArray(
        header=header_of(stamp, ""),
        status=[
            DiagnosticStatus(
                level=bytes([verdict.level.value]),
                name=f"{hardware_id}: {verdict.name}",
                message=verdict.message,
                hardware_id=hardware_id,
                values=[KeyValue(key=key, value=value) for key, value in verdict.values.items()],
            )
            for verdict in verdicts
        ],
    )


def _points(rows: Any) -> list[Point]:
    """(n, 3) as Points."""
    return [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in rows]


def _fill_pose(pose: Any, row: Sequence[float]) -> None:
    """Seven numbers, position and quaternion, into a geometry_msgs/Pose."""
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = (float(value) for value in row)
