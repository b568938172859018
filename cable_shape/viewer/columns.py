"""What changes with time, kept and written together: :class:`Columns`. Imports rerun: see recording."""

from __future__ import annotations

from itertools import groupby
from typing import Any, NamedTuple, final

import numpy as np
import pyarrow as pa
import rerun as rr

from cable_shape.checks import Array

TIMELINE = "stamp"

Time = np.datetime64 | np.timedelta64


class _Row(NamedTuple):
    """An entity at one time: descriptors of its components, by name, and what they hold."""

    time: Time
    descriptors: dict[str, Any]
    arrays: list[pa.Array]


class _Arrow(NamedTuple):
    """A component's values as rerun takes them."""

    array: pa.Array

    def as_arrow_array(self) -> pa.Array:
        """Themselves."""
        return self.array


@final
class Columns:
    """Writes entities at times: each at once, or, `later`, all of an entity together when it is flushed.

    Together they take a fraction of the time; what is read from the recording is the same.
    """

    def __init__(self, recording: rr.RecordingStream, later: bool) -> None:
        self._recording = recording
        self._later = later
        self._now: Time = np.timedelta64(0, "ns")
        self._waiting: dict[str, list[_Row]] = {}

    def at(self, time: Time) -> None:
        """Of what is written from now on."""
        self._now = time
        if self._later:
            return
        if isinstance(time, np.datetime64):
            self._recording.set_time(TIMELINE, timestamp=time)
        else:
            self._recording.set_time(TIMELINE, duration=time)

    def write(self, entity: str, *archetypes: Any) -> None:
        """Writes archetypes to an entity at the present time."""
        if not self._later:
            self._recording.log(entity, *archetypes)
            return
        batches = [batch for one in archetypes for batch in one.as_component_batches()]
        descriptors = {str(batch.component_descriptor()): batch.component_descriptor() for batch in batches}
        arrays = [batch.as_arrow_array() for batch in batches]
        self._waiting.setdefault(entity, []).append(_Row(self._now, descriptors, arrays))

    def flush(self) -> None:
        """Writes what waits."""
        for entity, waiting in self._waiting.items():
            for _, alike in groupby(waiting, key=lambda row: tuple(row.descriptors)):
                rows = list(alike)
                columns = []
                for k, descriptor in enumerate(rows[0].descriptors.values()):
                    lengths = [len(row.arrays[k]) for row in rows]
                    values = _Arrow(pa.concat_arrays([row.arrays[k] for row in rows]))
                    columns.append(rr.ComponentColumn(descriptor, values, lengths=lengths))
                self._recording.send_columns(entity, [times_of([row.time for row in rows])], columns)
        self._waiting.clear()


def times_of(times: list[Time]) -> rr.TimeColumn:
    """The times of rows."""
    column = np.array(times)
    dates = column.dtype.kind == "M"
    return rr.TimeColumn(TIMELINE, timestamp=column) if dates else rr.TimeColumn(TIMELINE, duration=column)


def strips(points: Array) -> pa.Array:
    """Line strips (n, k, 2 or 3) [m], n of k points each, as rerun holds them: what it makes of them itself is slow."""
    count, each, width = points.shape
    kind = (rr.components.LineStrip2DBatch, rr.components.LineStrip3DBatch)[width - 2]._ARROW_DATATYPE
    values = pa.array(np.ascontiguousarray(points, dtype=np.float32).ravel())
    places = pa.FixedSizeListArray.from_arrays(values, type=kind.value_type)
    return pa.ListArray.from_arrays(pa.array(np.arange(count + 1, dtype=np.int32) * each), places, type=kind)


def rgba(colours: np.ndarray[Any, np.dtype[np.uint8]]) -> pa.Array:
    """Colours (n, 4) as rerun holds them."""
    return pa.array(np.ascontiguousarray(colours).view(">u4").astype(np.uint32).ravel())
