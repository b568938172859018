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
    """An entity at one time: the components of an archetype and what they hold, one row of an array an instance."""

    time: Time
    kind: Any
    values: dict[str, Any]


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
        self._batches: dict[Any, dict[str, Any]] = {}  # of an archetype with these components: one of each, by name

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
        for one in archetypes:
            batches = _named(one)
            key = type(one), *batches
            self._batches.setdefault(key, batches)
            arrays = {name: batch.as_arrow_array() for name, batch in batches.items()}
            self._waiting.setdefault(entity, []).append(_Row(self._now, key, arrays))

    def put(self, entity: str, kind: Any, **values: Any) -> None:
        """Writes an archetype that is written again and again: of each component an array or list of its instances.

        Numbers are arrays with a row for each instance, colours (n, 4), texts lists of str.
        """
        if not self._later:
            self._recording.log(entity, kind(**values))
            return
        key = kind, *values
        if key not in self._batches:
            self._batches[key] = _named(kind(**values))
        self._waiting.setdefault(entity, []).append(_Row(self._now, key, values))

    def flush(self) -> None:
        """Writes what waits."""
        for entity, waiting in self._waiting.items():
            for key, alike in groupby(waiting, key=lambda row: row.kind):
                rows = list(alike)
                columns = []
                for name, batch in self._batches[key].items():
                    parts = [row.values[name] for row in rows]
                    values = _Arrow(_joined(parts, batch.as_arrow_array().type))
                    descriptor = batch.component_descriptor()
                    columns.append(rr.ComponentColumn(descriptor, values, lengths=[len(part) for part in parts]))
                self._recording.send_columns(entity, [times_of([row.time for row in rows])], columns)
        self._waiting.clear()


def _named(archetype: Any) -> dict[str, Any]:
    """Its components by name."""
    batches = archetype.as_component_batches()
    return {batch.component_descriptor().component.rpartition(":")[2]: batch for batch in batches}


def _joined(parts: list[Any], kind: pa.DataType) -> pa.Array:
    """Values of several rows as rerun holds them: what it makes of each of them itself is slow."""
    if isinstance(parts[0], pa.Array):
        return pa.concat_arrays(parts)
    if pa.types.is_string(kind) or pa.types.is_boolean(kind):
        return pa.array([value for part in parts for value in part], type=kind)
    values = np.concatenate(parts)
    if pa.types.is_list(kind):
        return strips(values)
    if kind == pa.uint32():
        return rgba(values)
    flat = pa.array(np.ascontiguousarray(values, dtype=np.float32).ravel())
    return pa.FixedSizeListArray.from_arrays(flat, type=kind) if pa.types.is_fixed_size_list(kind) else flat


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
