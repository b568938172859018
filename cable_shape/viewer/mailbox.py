"""From the control loop to the viewer process: a mailbox that holds only the newest report, and what a letter says.

The mailbox is a piece of memory that both processes map, a ring of slots, and a pipe that wakes the reader. The writer
never waits: it fills the next slot and moves on. The reader takes the newest letter and passes over the older ones.
"""

from __future__ import annotations

import contextlib
import marshal
import mmap
import os
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.plug import PlugError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.report import BodyDistance, CableWarning, Clearance, CycleReport, Margin, Severity, WarningKind
from cable_shape.shape import CableShape, Status
from cable_shape.uncertainty import Tube

SLOTS = 8
#: [bytes] of one slot. Pages that are never written take no memory, so this is an upper bound and not a cost.
SLOT_BYTES = 16 * 1024 * 1024
_HEAD_BYTES = 4096
_NEWEST, _TAKEN, _LENGTHS = 0, 1, 2  # words of the head: newest letter, letters taken, length of each slot's letter


@final
class Mailbox:
    """A ring of slots in shared memory; letters count from 1. One process writes, one reads.

    Parameters
    ----------
    file : int
        Descriptor of the memory, from :meth:`memory`; the mailbox takes it over.
    """

    def __init__(self, file: int) -> None:
        self.file = file
        self._map = mmap.mmap(file, _HEAD_BYTES + SLOTS * SLOT_BYTES)
        self._bytes = memoryview(self._map)
        self._words = self._bytes[:_HEAD_BYTES].cast("q")

    @staticmethod
    def memory() -> int:
        """A new descriptor of zeroed memory that vanishes with its last user."""
        file = os.memfd_create("cable_shape_viewer", os.MFD_CLOEXEC)
        os.ftruncate(file, _HEAD_BYTES + SLOTS * SLOT_BYTES)
        return file

    @property
    def newest(self) -> int:
        """Number of the newest letter, 0 before the first."""
        return self._words[_NEWEST]

    @property
    def taken(self) -> int:
        """How many letters the reader has taken."""
        return self._words[_TAKEN]

    def put(self, letter: bytes) -> bool:
        """Writes a letter without waiting; False if it is longer than a slot."""
        length = len(letter)
        if length > SLOT_BYTES:
            return False
        number = self._words[_NEWEST] + 1
        slot = number % SLOTS
        begin = _HEAD_BYTES + slot * SLOT_BYTES
        self._bytes[begin : begin + length] = letter
        self._words[_LENGTHS + slot] = length
        self._words[_NEWEST] = number
        return True

    def take(self, after: int) -> tuple[int, bytes] | None:
        """Number and text of the newest letter, None if there is none after number `after`."""
        while (number := self._words[_NEWEST]) > after:
            slot = number % SLOTS
            begin = _HEAD_BYTES + slot * SLOT_BYTES
            letter = bytes(self._bytes[begin : begin + self._words[_LENGTHS + slot]])
            # The slot is written again for letter number + SLOTS, which begins once number + SLOTS - 1 is the newest.
            if self._words[_NEWEST] < number + SLOTS - 1:
                self._words[_TAKEN] += 1
                return number, letter
        return None

    def close(self) -> None:
        """Lets go of the memory."""
        self._words.release()
        self._bytes.release()
        self._map.close()
        with contextlib.suppress(OSError):
            os.close(self.file)


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
            [(name, _joined([t.covariance, t.radius]), float(t.confidence)) for name, t in report.tubes.items()],
        )
    )


def decode(letter: bytes) -> CycleReport:
    """The report that :func:`encode` wrote."""
    stamp, grips, links, shapes, clearance, warnings, times, skipped, *more = marshal.loads(letter)
    margins, tails, after_snap, plugs, tubes = more
    made = {name: _read_shape(*rest) for name, *rest in shapes}
    ends = {name: (_read_end(start), _read_end(end)) for name, start, end in grips}
    return CycleReport(
        stamp=stamp,
        grips={name: (start, end) for name, (start, end) in ends.items() if start is not None},
        links=None if links is None else dict(zip(links[0], map(Pose.trusted, _rows(links[1], 7)), strict=True)),
        shapes=made,
        clearance={name: _read_clearance(*rest) for name, *rest in clearance},
        warnings=tuple(_read_warning(*fields) for fields in warnings),
        times=dict(times),
        skipped=dict(skipped),
        margins={name: tuple(Margin(WarningKind(kind), *rest) for kind, *rest in found) for name, found in margins},
        tails={(name, side): _read_shape(*rest) for name, side, *rest in tails},
        after_snap={name: _read_shape(*rest) for name, *rest in after_snap},
        plugs={name: _read_plug(*fields) for name, *fields in plugs},
        tubes={name: _read_tube(made[name], *rest) for name, *rest in tubes},
    )


def _joined(arrays: list[Array]) -> bytes:
    """The numbers of several arrays, one after the other."""
    return b"".join([array.tobytes() for array in arrays])


def _rows(data: bytes, width: int) -> Array:
    """What :func:`_joined` wrote, as (n, width)."""
    return np.frombuffer(data, dtype=np.float64).reshape(-1, width)


def _end(end: Pose | Grip | FreeEnd | None) -> Any:
    if end is None or isinstance(end, FreeEnd):
        return None
    if isinstance(end, Pose):
        return (np.ascontiguousarray(end.array), end.turns)
    return (_joined([end.pose.array, end.offset.array, end.curvature]), end.pose.turns, end.kind)


def _read_end(fields: tuple[Any, ...] | None) -> Pose | Grip | None:
    if fields is None:
        return None
    array = np.frombuffer(fields[0], dtype=np.float64)
    pose = Pose.trusted(array[:7], fields[1])
    return pose if len(fields) == 2 else Grip(pose, fields[2], Pose.trusted(array[7:14]), array[14:])


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
    buffer: bytes, points: int, status: int, fields: tuple[Any, ...], supports: bytes, touches: bytes, bodies: list[str]
) -> CableShape:
    keywords: dict[str, Any] = dict(zip(_SHAPE_FIELDS, fields, strict=True))
    keywords.update(supports=_rows(supports, 7), touches=_rows(touches, 9), bodies=tuple(bodies))
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


def _read_tube(shape: CableShape, numbers: bytes, confidence: float) -> Tube:
    covariance, radius = np.split(np.frombuffer(numbers, dtype=np.float64), [9 * shape.points])
    return Tube(shape, covariance.reshape(-1, 3, 3), radius, confidence)


def _plug(error: PlugError) -> tuple[Any, ...]:
    numbers = np.array((*error.pose.array, error.position, error.angle, error.axial, error.lateral))
    return (error.socket, numbers)


def _read_plug(socket: str, numbers: bytes) -> PlugError:
    row = np.frombuffer(numbers, dtype=np.float64)
    return PlugError(socket, Pose.trusted(row[:7]), *row[7:].tolist())
