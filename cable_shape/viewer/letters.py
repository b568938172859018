"""Letters from the control loop to the viewer: a cycle's report as bytes, :func:`encode` and :func:`decode`."""

from __future__ import annotations

import marshal
from functools import lru_cache
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import IDENTITY, FreeEnd, Grip, Pose
from cable_shape.safety.report import BodyDistance, CableWarning, Clearance, CycleReport, Margin, Severity, WarningKind
from cable_shape.scene.plug import PlugError
from cable_shape.shape import TOUCH, CableShape, Status
from cable_shape.uncertainty.uncertainty import Tube


def encode(report: CycleReport) -> bytes:
    """A report as bytes, for :func:`decode` in another process of the same interpreter.

    The standard library's ``marshal`` writes plain tuples, numbers and arrays several times faster than ``pickle``. It
    would write a numpy scalar as an array, hence the conversions below.
    """
    links = report.links
    return marshal.dumps(
        (
            int(report.stamp),
            [(name, _end(start), _end(end)) for name, (start, end) in report.grips.items()],
            None if links is None else (list(links), _joined([pose.array for pose in links.values()])),
            [(name, *_shape(shape)) for name, shape in report.shapes.items()],
            [(name, *_clearance(clearance)) for name, clearance in report.clearance.items()],
            [_warning(warning) for warning in report.warnings],
            [(phase, float(seconds)) for phase, seconds in report.times.items()],
            [(what, int(count)) for what, count in report.skipped.items()],
            [(name, [_margin(margin) for margin in margins]) for name, margins in report.margins.items()],
            [(name, side, *_shape(tail)) for (name, side), tail in report.tails.items()],
            [(name, *_shape(shape)) for name, shape in report.after_snap.items()],
            [(name, *_plug(error)) for name, error in report.plugs.items()],
            [(name, *_tube(tube)) for name, tube in report.tubes.items()],
            [(name, side, *_tube(tube)) for (name, side), tube in report.tail_tubes.items()],
        )
    )


def decode(letter: bytes) -> CycleReport:
    """The report that :func:`encode` wrote."""
    stamp, grips, links, shapes, clearance, warnings, times, skipped, *more = marshal.loads(letter)  # noqa: S302, of the parent process
    margins, tails, after_snap, plugs, tubes, tail_tubes = more
    made = {name: _read_shape(*rest) for name, *rest in shapes}
    hanging = {(name, side): _read_shape(*rest) for name, side, *rest in tails}
    ends = {name: (_read_end(start), _read_end(end)) for name, start, end in grips}
    return CycleReport(
        stamp=stamp,
        grips={name: both for name, both in ends.items() if both != (None, None)},  # type: ignore[misc]
        links=None if links is None else dict(zip(links[0], map(Pose.trusted, _rows(links[1], 7)), strict=True)),
        shapes=made,
        clearance={name: _read_clearance(*rest) for name, *rest in clearance},
        warnings=tuple(_read_warning(*fields) for fields in warnings),
        times=dict(times),
        skipped=dict(skipped),
        margins={name: tuple(Margin(WarningKind(kind), *rest) for kind, *rest in found) for name, found in margins},
        tails=hanging,
        after_snap={name: _read_shape(*rest) for name, *rest in after_snap},
        plugs={name: _read_plug(*fields) for name, *fields in plugs},
        tubes={name: _read_tube(made[name], *rest) for name, *rest in tubes},
        tail_tubes={(name, side): _read_tube(hanging[name, side], *rest) for name, side, *rest in tail_tubes},
    )


def _joined(arrays: list[Array]) -> bytes:
    """The numbers of several arrays, one after the other."""
    return b"".join([array.tobytes() for array in arrays])


def _rows(data: bytes, width: int) -> Array:
    """What :func:`_joined` wrote, as (n, width)."""
    return np.frombuffer(data, dtype=np.float64).reshape(-1, width)


def _end(end: Pose | Grip | FreeEnd | None) -> Any:
    if end is None or isinstance(end, FreeEnd):
        return float(end.mass) if end is not None and end.mass else None
    if isinstance(end, Pose):
        return (np.ascontiguousarray(end.array), end.turns)
    frame, held = _joined([end.pose.array, end.cable_frame.array]), _joined([end.offset.array, end.curvature])
    return (frame, end.pose.turns, held, end.kind)


def _read_end(fields: Any) -> Pose | Grip | FreeEnd | None:
    if fields is None:
        return None
    if isinstance(fields, float):
        return FreeEnd(fields)
    array = np.frombuffer(fields[0], dtype=np.float64)
    pose = Pose.trusted(array[:7], fields[1])
    return pose if len(fields) == 2 else _grip(*fields[2:]).at(pose, Pose.trusted(array[7:], fields[1]))


@lru_cache
def _grip(held: bytes, kind: str) -> Grip:
    """A grip like this one, wherever it is."""
    array = np.frombuffer(held, dtype=np.float64)
    return Grip(IDENTITY, kind, Pose.trusted(array[:7]), array[7:])


def _shape(shape: CableShape) -> tuple[Any, ...]:
    return (
        np.ascontiguousarray(shape.buffer),
        int(shape.points),
        shape.status.value,
        (
            float(shape.length),
            shape.model,
            shape.detail,
            float(shape.energy),
            float(shape.error_estimate),
            float(shape.residual),
            int(shape.iterations),
            float(shape.solve_time),
            bool(shape.reused),
            int(shape.turns),
            float(shape.twist),
            float(shape.roll_error),
        ),
        np.ascontiguousarray(shape.supports),
        np.ascontiguousarray(shape.touches),
        list(shape.bodies),
        None if shape.velocity is None else np.ascontiguousarray(shape.velocity),
    )


#: names of the numbers and words of a shape, in the order in which :func:`_shape` writes them
_SHAPE_FIELDS = (
    "length",
    "model",
    "detail",
    "energy",
    "error_estimate",
    "residual",
    "iterations",
    "solve_time",
    "reused",
    "turns",
    "twist",
    "roll_error",
)


def _read_shape(
    buffer: bytes, points: int, status: int, fields: tuple[Any, ...], supports: bytes, touches: bytes,
    bodies: list[str], velocity: bytes | None,
) -> CableShape:  # fmt: skip
    keywords: dict[str, Any] = dict(zip(_SHAPE_FIELDS, fields, strict=True))
    keywords["velocity"] = None if velocity is None else _rows(velocity, 3)
    keywords.update(supports=_rows(supports, 7), touches=_rows(touches, TOUCH), bodies=tuple(bodies))
    return CableShape(np.frombuffer(buffer, dtype=np.float64), points, status=Status(status), **keywords)


def _clearance(clearance: Clearance) -> tuple[Any, ...]:
    bodies = clearance.bodies
    return (
        [(b.body, float(b.distance), float(b.arc_length)) for b in bodies],
        _joined([point for b in bodies for point in (b.point_on_cable, b.point_on_body)]),
        float(clearance.beyond),
        bool(clearance.robot_checked),
        int(clearance.pairs_culled),
        int(clearance.pairs_exact),
        float(clearance.confidence),
        bool(clearance.holds),
    )


def _read_clearance(bodies: list[tuple[str, float, float]], points: bytes, *counts: Any) -> Clearance:
    pairs = _rows(points, 6)
    listed = (BodyDistance(*body, pair[:3], pair[3:]) for body, pair in zip(bodies, pairs, strict=True))
    return Clearance(tuple(listed), *counts)


def _warning(warning: CableWarning) -> tuple[Any, ...]:
    w = warning
    numbers = np.array(
        (w.value, w.limit, w.margin, w.arc_length, w.time_to_limit, *w.point_on_cable, *w.point_on_other)
    )
    return (w.cable_id, w.kind.value, w.severity.value, w.text, w.other, numbers)


def _read_warning(cable_id: str, kind: int, severity: int, text: str, other: str, numbers: bytes) -> CableWarning:
    value, limit, margin, arc_length, time_to_limit, *points = np.frombuffer(numbers, dtype=np.float64).tolist()
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind(kind),
        severity=Severity(severity),
        text=text,
        value=value,
        limit=limit,
        margin=margin,
        arc_length=arc_length,
        point_on_cable=np.array(points[:3]),
        point_on_other=np.array(points[3:]),
        other=other,
        time_to_limit=time_to_limit,
    )


def _margin(margin: Margin) -> tuple[Any, ...]:
    kind, used, limit, value, arc_length, other, time = margin
    return (kind.value, float(used), float(limit), float(value), float(arc_length), other, float(time))


def _tube(tube: Tube) -> tuple[bytes, float, float]:
    return _joined([tube.covariance, tube.radius]), float(tube.confidence), float(tube.inertia)


def _read_tube(shape: CableShape, numbers: bytes, confidence: float, inertia: float) -> Tube:
    covariance, radius = np.split(np.frombuffer(numbers, dtype=np.float64), [9 * shape.points])
    return Tube(shape, covariance.reshape(-1, 3, 3), radius, confidence, inertia)


def _plug(error: PlugError) -> tuple[Any, ...]:
    numbers = np.array((*error.pose.array, error.position, error.angle, error.axial, error.lateral))
    return (error.socket, numbers)


def _read_plug(socket: str, numbers: bytes) -> PlugError:
    row = np.frombuffer(numbers, dtype=np.float64)
    return PlugError(socket, Pose.trusted(row[:7]), *row[7:].tolist())
