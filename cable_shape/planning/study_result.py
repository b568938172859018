"""What a study found: :class:`StudyResult`, and its tables as CSV and Parquet."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of
from cable_shape.planning.study_beside import Beside
from cable_shape.planning.study_case import Cases
from cable_shape.planning.study_chunk import REFUSED, Chunk, write
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_vary import Axis, Sample
from cable_shape.shape import Status

ENDINGS = (".csv", ".parquet")


class Question(Protocol):
    """What a study is to who solves it and who tells of it."""

    name: str
    axes: tuple[Axis, ...]
    measures: tuple[Measure, ...]
    at: str
    sample: Sample
    cases: Cases

    @property
    def points(self) -> Array: ...

    @property
    def chunks(self) -> int: ...

    @property
    def beside(self) -> Beside | None: ...

    @property
    def fingerprint(self) -> str: ...

    def solve(self, chunk: int) -> Chunk: ...


@final
class StudyResult:
    """What was found at p points for q measures.

    Attributes
    ----------
    study : Study
    points : (p, axes), what varied
    value, instant, place, limit, segment, instants, usable, snapped, first, status, detail, over
        As of :class:`cable_shape.planning.study_chunk.Chunk`, of all points.
    """

    def __init__(self, study: Question, chunks: Sequence[Chunk]) -> None:
        self.study, self.points = study, study.points
        whole = joined(chunks)
        self.value, self.instant, self.place, self.limit = whole.value, whole.instant, whole.place, whole.limit
        self.segment, self.instants, self.usable, self.snapped = (
            whole.segment, whole.instants, whole.usable, whole.snapped
        )  # fmt: skip
        self.first, self.status, self.detail, self.over = whole.first, whole.status, whole.detail, whole.over

    def __len__(self) -> int:
        return len(self.points)

    def of(self, name: str) -> Array:
        """(p,), the worst values of a measure."""
        names = [measure.name for measure in self.study.measures]
        if name not in names:
            raise ArgumentError.of("name", name, f"it must be one of {', '.join(names)}", "Choose one of these.")
        return np.asarray(self.value[:, names.index(name)])

    @property
    def used(self) -> Array:
        """(p, q), how much of each limit is used, 1 at it; NaN without one."""
        out = np.full(self.value.shape, math.nan)
        for k, measure in enumerate(self.study.measures):
            out[:, k] = measure.used(self.value[:, k], self.limit[:, k])
        out[np.isnan(self.limit)] = math.nan
        return out

    @property
    def complete(self) -> NDArray[np.bool_]:
        """(p,): whether there is a shape at every instant."""
        return np.asarray(self.first < 0)

    @property
    def within(self) -> NDArray[np.bool_]:
        """(p,): whether it is complete, and no limit is passed at any instant."""
        out = self.complete.copy()
        for k, measure in enumerate(self.study.measures):
            out &= ~measure.beyond(self.value[:, k], self.limit[:, k])
        return out

    def why(self, point: int) -> str:
        """Why a point has no shape somewhere; empty where it has one everywhere."""
        if self.first[point] < 0:
            return ""
        if self.status[point] == REFUSED:
            return str(self.detail[point])
        name = Status(int(self.status[point])).name
        return f"{name} at instant {self.first[point]}. {self.detail[point]}".strip()

    def columns(self) -> dict[str, NDArray[Any]]:
        """The table of the worst instants: a row a point."""
        out: dict[str, Any] = {"point": np.arange(len(self))}
        out |= {axis.name: axis.column(self.points[:, i]) for i, axis in enumerate(self.study.axes)}
        out |= {"within": self.within, "instants": self.instants, "usable": self.usable, "snapped": self.snapped}
        out |= {"first_without_shape": self.first, "reason": np.array([self.why(i) for i in range(len(self))])}
        for k, measure in enumerate(self.study.measures):
            out[measure.name] = self.value[:, k]
            out[f"{measure.name} instant"] = self.instant[:, k]
            out[f"{measure.name} arc_length"] = self.place[:, k]
            if (self.segment[:, k] != "").any():
                out[f"{measure.name} segment"] = self.segment[:, k]
            if not np.isnan(self.limit[:, k]).all():
                out[f"{measure.name} limit"] = self.limit[:, k]
        return out

    def all_instants(self) -> dict[str, NDArray[Any]]:
        """The table of all instants: a row a point and instant; of a study that was run with `at` "all"."""
        if self.study.at != "all":
            raise ArgumentError("at: every instant is kept only by a study with at='all'. Write at: all.")
        p, m, _ = self.over.shape
        out: dict[str, Any] = {"point": np.repeat(np.arange(p), m), "instant": np.tile(np.arange(m), p)}
        out |= {axis.name: np.repeat(axis.column(self.points[:, i]), m) for i, axis in enumerate(self.study.axes)}
        out |= {measure.name: self.over[:, :, k].ravel() for k, measure in enumerate(self.study.measures)}
        return out

    def save(self, path: str | Path, instants: bool = False) -> Path:
        """Writes the table of worst instants, or of all, as .csv or .parquet (extra `studies`)."""
        file = path_of(path, "table")
        if file.suffix not in ENDINGS:
            raise ArgumentError.of("path", str(file), f"it must end in {' or '.join(ENDINGS)}", "Name another file.")
        table = self.all_instants() if instants else self.columns()
        write(file, _parquet(table) if file.suffix == ".parquet" else _csv(table))
        return file


def joined(chunks: Sequence[Chunk]) -> Chunk:
    """All points in one."""
    longest = max((chunk.over.shape[1] for chunk in chunks), default=0)
    parts: list[Any] = []
    for name in Chunk._fields:
        arrays = [getattr(chunk, name) for chunk in chunks]
        if name == "over":
            wide = [np.full((len(a), longest, a.shape[2]), math.nan) for a in arrays]
            for to, a in zip(wide, arrays, strict=True):
                to[:, : a.shape[1]] = a
            arrays = wide
        parts.append(np.concatenate(arrays))
    return Chunk(*parts)


def _csv(table: dict[str, NDArray[Any]]) -> bytes:
    """Numbers as they are read back to the same bits; nothing for NaN."""
    import csv

    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(table)
    columns = [["" if x != x else x for x in column.tolist()] for column in table.values()]
    out.writerows(zip(*columns, strict=True))
    return text.getvalue().encode()


def _parquet(table: dict[str, NDArray[Any]]) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    out = pa.BufferOutputStream()
    parquet.write_table(pa.table({name: pa.array(column) for name, column in table.items()}), out)
    content: bytes = out.getvalue().to_pybytes()
    return content
