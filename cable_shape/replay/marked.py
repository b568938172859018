"""Which markers of a recording are where on what is carried: :class:`Marked`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import run_of
from cable_shape.checks import Array
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.prediction.layout import cable_id
from cable_shape.safety.report import CycleReport

#: [m], a marker this near to the end of a segment that is held sits at the grip.
_AT_GRIP = 1e-6


@final
class Marked:
    """Markers run by run: a cable is one, a harness has those of the key `markers` of its file.

    count : of the markers in a message; None: any.
    length : [m], of the longest run.
    runs : which markers are compared with the line of each run; those at grips are not.
    along : which markers of a message are on each run, and at which share of its length; None: as far apart as they are
        seen, the first and the last at its ends.
    """

    def __init__(self, name: str, what: Cable | HarnessFile) -> None:
        self._name = name
        self.count: int | None = None
        self._segments: list[tuple[str, ...]] = [()]
        self._lengths: list[list[float]] = [[]]
        self.runs: list[slice | NDArray[np.intp]] = [slice(1, -1)]
        self.along: list[tuple[slice, Array | None]] = [(slice(None), None)]
        if isinstance(what, Cable):
            self.length = what.length
            return
        self._segments, self._lengths, self.runs, self.along = [], [], [], []
        self.count, self.length = 0, 0.0
        for key, given in what.markers.items():
            run, at = run_of(key, what.harness), np.array(given)
            lengths = [what.harness.segments[one].length for one in run]
            whole = sum(lengths)
            seen = np.ones(len(at), dtype=np.bool_)
            for end, place in ((f"{run[0]}.start", 0.0), (f"{run[-1]}.end", whole)):
                if end in what.grips:
                    seen &= np.abs(at - place) > _AT_GRIP
            self._segments.append(run)
            self._lengths.append(lengths)
            self.runs.append(self.count + np.flatnonzero(seen))
            self.along.append((slice(self.count, self.count + len(at)), at / whole))
            self.count += len(at)
            self.length = max(self.length, whole)

    def lines(self, report: CycleReport) -> list[Array] | None:
        """(n, 3) [m] of each run; None where the shape may not be acted on."""
        shape: Any = report.shapes[self._name]
        if not shape.status:
            return None
        if self.count is None:
            return [shape.positions]
        return [np.concatenate([shape.segments[one].positions for one in run]) for run in self._segments]

    def radii(self, report: CycleReport) -> list[Array] | None:
        """(n,) [m] of the tubes; None where they are not known."""
        runs = [[cable_id(self._name, one) for one in run] or [self._name] for run in self._segments]
        if any(one not in report.tubes for run in runs for one in run):
            return None
        return [np.concatenate([report.tubes[one].radius for one in run]) for run in runs]

    def loads(self, tables: Sequence[Array]) -> Array | Mapping[str, Array]:
        """What a cycle takes as accelerations, from accelerations and velocities along each run (rows, 6)."""
        if self.count is None:
            return tables[0]
        out = {}
        for run, lengths, table in zip(self._segments, self._lengths, tables, strict=True):
            first, whole, rows = 0.0, sum(lengths), np.linspace(0.0, 1.0, len(table))
            for one, length in zip(run, lengths, strict=True):
                at = np.linspace(first, first + length, len(table)) / whole
                out[one] = np.stack([np.interp(at, rows, x) for x in table[:, :3].T], axis=1)
                first += length
        return out
