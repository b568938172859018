"""A chunk of a study: some of its points, solved, measured, and kept in a file until all are there."""

from __future__ import annotations

import io
import json
import math
import os
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, FileError, UnknownKeyError
from cable_shape.planning.study_beside import Beside
from cable_shape.planning.study_case import Case, Cases
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_walk import Rows, walk
from cable_shape.shape import Status

#: In place of a status where the point has no case: a clip beyond the end of its cable, say.
REFUSED = -1
#: Points that are solved in one compiled call, where that is possible.
TOGETHER = 128


@final
class Chunk(NamedTuple):
    """What is told of v points and q measures.

    Attributes
    ----------
    value, instant, place, limit : (v, q)
        Worst value over all instants, NaN where there is none; its instant, -1; its arc length [m]; what it is judged
        by, NaN for nothing.
    segment : (v, q) str, of a harness
    instants, usable, snapped : (v,) int
        How many there are, have a shape, and were snapped to.
    first : (v,) int
        The first instant without a shape, -1 where all have one; `status` is that of it, `detail` what it means.
    over : (v, m, q), values at all instants, NaN where there is no shape; m = 0 where they are not asked for
    """

    value: Array
    instant: NDArray[np.int64]
    place: Array
    limit: Array
    segment: NDArray[np.str_]
    instants: NDArray[np.int64]
    usable: NDArray[np.int64]
    snapped: NDArray[np.int64]
    first: NDArray[np.int64]
    status: NDArray[np.int64]
    detail: NDArray[np.str_]
    over: Array

    def save(self, file: Path) -> None:
        """All of it or nothing of it."""
        content = io.BytesIO()
        np.savez(content, **self._asdict())
        write(file, content.getvalue())


def load_chunk(file: Path) -> Chunk | None:
    """What `save` has kept; None where there is nothing, or half a file."""
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as told:
            return Chunk(**{name: told[name] for name in Chunk._fields})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def write(file: Path, content: bytes) -> None:
    """Writes a file, all of it or nothing of it.

    Raises
    ------
    FileError
        Where it cannot be: the disk is full.
    """
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{file.name}-", dir=file.parent)
        try:
            with os.fdopen(handle, "wb") as out:
                out.write(content)
            os.chmod(temporary, 0o644)
            os.replace(temporary, file)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        remedy = "What was done is kept: make room, and give the same command again."
        raise FileError(f"{file}: cannot be written: {error.strerror}. {remedy}") from None


def solve_chunk(
    cases: Cases, measures: Sequence[Measure], rows: Array, over: bool, beside: Beside | None = None
) -> Chunk:
    """Solves some points (v, axes), each from its first instant on by itself, or from the shape in their middle."""
    v, q = len(rows), len(measures)
    out = Chunk(
        np.full((v, q), math.nan), np.full((v, q), -1), np.full((v, q), math.nan), np.full((v, q), math.nan),
        np.full((v, q), "", dtype="<U64"), np.zeros(v, np.int64), np.zeros(v, np.int64), np.zeros(v, np.int64),
        np.full(v, -1), np.zeros(v, np.int64), np.full(v, "", dtype="<U400"), np.empty((v, 0, q)),
    )  # fmt: skip
    series: list[Array] = [np.empty((0, q))] * v
    left = np.arange(v) if beside is None else _together(beside, measures, rows, out, series)
    for i in left.tolist():
        try:
            case = cases.at(rows[i].tolist())
            found = walk(case)
        except UnknownKeyError:
            raise
        except ArgumentError as error:
            out.status[i], out.first[i], out.detail[i] = REFUSED, 0, str(error)
            continue
        _tell(out, i, found)
        values, places, names = measured(case.instants, measures, found)
        for k, measure in enumerate(measures):
            worst = _worst(measure, values[:, k])
            out.limit[i, k] = _limit(measure, case, found)
            if worst >= 0:
                out.value[i, k], out.instant[i, k], out.place[i, k] = values[worst, k], worst, places[worst, k]
                out.segment[i, k] = names[worst, k]
        series[i] = values
    if not over:
        return out
    longest = max((len(values) for values in series), default=0)
    all_values = np.full((v, longest, q), math.nan)
    for i, values in enumerate(series):
        all_values[i, : len(values)] = values
    return out._replace(over=all_values)


def _together(
    beside: Beside, measures: Sequence[Measure], rows: Array, out: Chunk, series: list[Array]
) -> NDArray[np.int64]:
    """Solves points from the shape in their middle, and returns those that were not reached."""
    left, stability = [], any(measure.name == "stability" for measure in measures)
    for first in range(0, len(rows), TOGETHER):
        found = beside.rows(rows[first : first + TOGETHER], stability)
        good = np.flatnonzero(found.usable)
        left.append(first + np.flatnonzero(~found.usable))
        values, places, _ = measured(len(found), measures, {"": found})
        at = first + good
        out.value[at], out.place[at] = values[good], places[good]
        out.instant[at] = np.where(np.isnan(values[good]), -1, 0)
        out.limit[at] = [_limit(measure, beside.case, {"": found}) for measure in measures]
        out.instants[at] = out.usable[at] = 1
        for i in good.tolist():
            series[first + i] = values[i : i + 1]
    return np.concatenate(left)


def _limit(measure: Measure, case: Case, found: Mapping[str, Rows]) -> float:
    """The narrowest limit of all segments, NaN where there is none."""
    limits = [measure.limit_of(rows, case.scene) for rows in found.values()]
    return min(limits, key=lambda x: (math.isnan(x), x if measure.worst == "most" else -x))


def _tell(out: Chunk, i: int, found: Mapping[str, Rows]) -> None:
    """Which of the instants have a shape."""
    rows = next(iter(found.values()))
    out.instants[i], out.usable[i] = len(rows), int(rows.usable.sum())
    out.snapped[i] = int((rows.status == Status.SNAPPED.value).sum())
    bad = np.flatnonzero(~rows.usable)
    if bad.size:
        out.first[i], out.status[i] = bad[0], rows.status[bad[0]]
        out.detail[i] = rows.details.get(int(bad[0]), "")


def measured(m: int, measures: Sequence[Measure], found: Mapping[str, Rows]) -> tuple[Array, Array, NDArray[np.str_]]:
    """Values (m, q), their arc lengths (m, q) and segments (m, q), the worst of all segments; NaN without a shape."""
    values, places = np.full((m, len(measures)), math.nan), np.full((m, len(measures)), math.nan)
    names = np.full((m, len(measures)), "", dtype="<U64")
    for name, rows in found.items():
        for k, measure in enumerate(measures):
            told, at = measure.of(rows)
            told = np.where(rows.usable, told, math.nan)
            worse = told < values[:, k] if measure.worst == "least" else told > values[:, k]
            take = np.isnan(values[:, k]) | worse
            values[take, k], places[take, k], names[take, k] = told[take], at[take], name
    return values, places, names


def _worst(measure: Measure, values: Array) -> int:
    """The worst instant, the first of several; -1 where there is no value."""
    if np.isnan(values).all():
        return -1
    return int(np.nanargmin(values) if measure.worst == "least" else np.nanargmax(values))


def as_json(values: Mapping[str, object]) -> str:
    """A study's mapping as text, the same for the same study."""
    return json.dumps(values, sort_keys=True, default=_plain)


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)
