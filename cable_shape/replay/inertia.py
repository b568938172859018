"""How the cable itself moves in a recording, from the markers on it: :class:`Inertia`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import BagError, StaleInputError
from cable_shape.messages.pairing import StampGuard
from cable_shape.replay.bags import Bag
from cable_shape.replay.inputs import MARKERS_TYPE, positions_of, stamp_of
from cable_shape.replay.observations import SMOOTHED, motions

_REMEDY = "Name their topic with --markers-topic, or replay without --inertia."


@final
class Inertia:
    """Accelerations and velocities along the cable at the stamps of a recording, read beforehand: a derivative needs
    what comes after.

    They are those of the markers, see :func:`cable_shape.replay.observations.motions`. `cycles` and `without` count
    what `at` answered.

    Parameters
    ----------
    path : path of the recording
    topic : str
        Of markers (PoseArray), in their order along the cable, the first and the last at the grips.
    max_skew : int
        [ns], markers further away in time than this are not those of a cycle.
    runs : sequence of (slice, (m,) or None)
        Which markers are on each run of what is carried, and at which share of its length, as for `motions`.

    Raises
    ------
    BagError
        If it holds no such markers, or none of which a derivative can be taken.
    """

    source = f"accelerations and velocities of the markers, smoothed over {SMOOTHED:g} s"

    def __init__(
        self,
        path: Path,
        topic: str,
        max_skew: int,
        runs: Sequence[tuple[slice, Array | None]] = ((slice(None), None),),
    ) -> None:
        self.max_skew = max_skew
        self.frame_id: str | None = None  # of the first frame of markers; those in others are left out
        self.cycles = self.without = 0
        parts: list[list[tuple[int, Array]]] = [[]]  # a clock that is set back begins another one
        guard = StampGuard(topic)
        with Bag(path) as bag:
            if bag.types.get(topic) != MARKERS_TYPE:
                raise BagError(
                    f"{path} has no markers ({MARKERS_TYPE}) on {topic}, from whose motion --inertia takes the cable's "
                    f"acceleration. {_REMEDY}"
                )
            for _, _, message in bag.messages((topic,)):
                if self.frame_id is None:
                    self.frame_id = message.header.frame_id
                if message.header.frame_id != self.frame_id:
                    continue
                stamp = stamp_of(message)
                try:
                    if guard.check(stamp):
                        parts.append([])
                except StaleInputError:
                    continue
                parts[-1].append((stamp, positions_of(message.poses)))
        self._parts = [_tabled(part, runs) for part in parts]
        if not any(np.isfinite(table).any() for _, table in self._parts):
            raise BagError(
                f"{path}: the markers on {topic} tell no acceleration: it takes frames of one number of markers, "
                f"evenly recorded, for {SMOOTHED:g} s at least. {_REMEDY}"
            )

    def at(self, stamp: int, restarts: int) -> Array | None:
        """(runs, rows, 6) [m/s^2, m/s], world, at a stamp [ns] after so many restarts of the clock; None: not known."""
        found = None
        if restarts < len(self._parts):
            stamps, table = self._parts[restarts]
            after = int(np.searchsorted(stamps, stamp))
            around = range(max(after - 1, 0), min(after + 1, len(stamps)))
            nearest = min(around, key=lambda i: abs(int(stamps[i]) - stamp), default=None)
            if nearest is not None and abs(int(stamps[nearest]) - stamp) <= self.max_skew:
                found = np.ascontiguousarray(table[nearest]) if np.isfinite(table[nearest]).all() else None
        self.cycles += found is not None
        self.without += found is None
        return found


def _tabled(part: list[tuple[int, Array]], runs: Sequence[tuple[slice, Array | None]]) -> tuple[Array, Array]:
    """Stamps (n,) [ns] and both (n, runs, rows, 6); none where no derivative can be taken."""
    try:
        tables = [motions([(stamp, x[run]) for stamp, x in part], along) for run, along in runs]
    except BagError:
        return np.empty(0), np.empty((0, 1, 1, 6))
    return np.array([stamp for stamp, _ in part], dtype=np.int64), np.stack(tables, axis=1)
