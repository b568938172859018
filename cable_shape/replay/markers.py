"""How far tracked markers are from the predicted centreline: :class:`MarkerComparison`."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import final

import numpy as np

from cable_shape.checks import Array

#: Shapes and marker frames kept while the other one of a pair may still come.
HISTORY = 64


@final
@dataclass(frozen=True, slots=True)
class MarkerFigures:
    """Distances of the inner markers to the centreline, over all frames, as a fraction of the cable's length."""

    frames: int
    distances: int
    mean: float
    median: float
    p90: float
    worst: float


@final
class MarkerComparison:
    """Pairs marker frames with shapes by stamp and collects distances of the inner markers to the centreline.

    A frame goes with the shape whose stamp is nearest, within `max_skew` [ns]. The first and the last marker are left
    out: they sit at the grips. The distance is that to the closest point of the polyline through the shape's points.
    """

    def __init__(self, length: float, max_skew: int) -> None:
        self.length = length
        self.max_skew = max_skew
        self.frames = 0  # with a distance
        self.unpaired = 0  # without a shape within max_skew
        self.unusable = 0  # whose shape may not be acted on
        self.not_finite = 0  # markers
        self._shapes: deque[tuple[int, Array | None]] = deque(maxlen=HISTORY)
        self._waiting: deque[tuple[int, Array]] = deque()
        self._distances: list[Array] = []
        self.series: list[tuple[int, float]] = []  # stamp [ns], mean distance of that frame [m]

    def add_shape(self, stamp: int, positions: Array | None) -> None:
        """Takes the centreline (n, 3) [m] of one cycle; None if its shape is not usable."""
        self._shapes.append((stamp, positions))
        while self._waiting and self._waiting[0][0] <= stamp:
            self._settle(*self._waiting.popleft())

    def add_markers(self, stamp: int, markers: Array) -> None:
        """Takes one frame of markers (m, 3) [m], in their order along the cable."""
        if self._shapes and stamp <= self._shapes[-1][0]:
            self._settle(stamp, markers)
            return
        self._waiting.append((stamp, markers))
        if len(self._waiting) > HISTORY:
            self._settle(*self._waiting.popleft())

    def finish(self) -> None:
        """Settles the frames that still wait; no shape comes any more, or stamps begin anew."""
        while self._waiting:
            self._settle(*self._waiting.popleft())
        self._shapes.clear()

    def figures(self) -> MarkerFigures | None:
        """None if no frame had a distance."""
        if not self._distances:
            return None
        relative = np.concatenate(self._distances) / self.length
        return MarkerFigures(
            frames=self.frames,
            distances=len(relative),
            mean=float(relative.mean()),
            median=float(np.median(relative)),
            p90=float(np.percentile(relative, 90.0)),
            worst=float(relative.max()),
        )

    def _settle(self, stamp: int, markers: Array) -> None:
        """Measures one frame against the shape nearest in time."""
        nearest = min(self._shapes, key=lambda shape: abs(shape[0] - stamp), default=None)
        if nearest is None or abs(nearest[0] - stamp) > self.max_skew:
            self.unpaired += 1
            return
        if nearest[1] is None:
            self.unusable += 1
            return
        inner = markers[1:-1]
        finite = np.isfinite(inner).all(axis=1)
        self.not_finite += int((~finite).sum())
        if not finite.any():
            return
        distances = distance_to_polyline(inner[finite], nearest[1])
        self.frames += 1
        self._distances.append(distances)
        self.series.append((stamp, float(distances.mean())))


def distance_to_polyline(points: Array, line: Array) -> Array:
    """(m,) [m]: distance of each of `points` (m, 3) to the closest point of the polyline through `line` (n, 3)."""
    start, step = line[:-1], np.diff(line, axis=0)
    to_point = points[:, None, :] - start[None, :, :]
    square = np.einsum("ij,ij->i", step, step)
    along = np.einsum("mij,ij->mi", to_point, step) / np.where(square > 0.0, square, 1.0)
    rest = to_point - np.clip(along, 0.0, 1.0)[:, :, None] * step[None, :, :]
    return np.asarray(np.sqrt(np.einsum("mij,mij->mi", rest, rest).min(axis=1)))
