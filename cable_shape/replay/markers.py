"""How far tracked markers are from the predicted centreline: :class:`MarkerComparison`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array

#: Shapes and marker frames kept while the other one of a pair may still come.
HISTORY = 64
_Lines = Sequence[Array] | None


@final
@dataclass(frozen=True, slots=True)
class MarkerFigures:
    """Distances of the inner markers to the centreline, over all frames, as a fraction of the cable's length.

    with_tube, inside : of how many the tube is known there, and the share of these that it holds; None for none.
    """

    frames: int
    distances: int
    mean: float
    median: float
    p90: float
    worst: float
    with_tube: int
    inside: float | None


@final
class MarkerComparison:
    """Pairs marker frames with shapes by stamp and collects distances of the inner markers to the centreline.

    A frame goes with the shape whose stamp is nearest, within `max_skew` [ns]. The first and the last marker are left
    out: they sit at the grips; `runs` says which markers are compared with which of several lines instead. The distance
    is that to the closest point of the polyline through the shape's points; where that is known, the marker is inside
    the tube if its distance is at most the tube's radius at that point.

    told: is given the stamp [ns] of each frame that was compared, the distances (m,) [m] of the markers that were seen,
    and the radii of the tube (m,) [m] at the closest points, None without one.
    """

    def __init__(
        self,
        length: float,
        max_skew: int,
        told: Callable[[int, Array, Array | None], None] | None = None,
        runs: Sequence[slice | NDArray[np.intp]] = (slice(1, -1),),
    ) -> None:
        self._runs = tuple(runs)
        self.length = length
        self.max_skew = max_skew
        self._told = told
        self.frames = 0  # with a distance
        self.unpaired = 0  # without a shape within max_skew
        self.unusable = 0  # whose shape may not be acted on
        self.not_finite = 0  # markers
        self._shapes: deque[tuple[int, _Lines, _Lines]] = deque(maxlen=HISTORY)
        self._waiting: deque[tuple[int, Array]] = deque()
        self._distances: list[Array] = []
        self._with_tube = self._inside = 0  # markers
        self.series: list[tuple[int, float]] = []  # stamp [ns], mean distance of that frame [m]
        self.radii: list[float] = []  # mean of the tube at the markers of each frame of the series [m], NaN for none

    def add_shape(self, stamp: int, lines: _Lines, radii: _Lines = None) -> None:
        """Takes the centreline (n, 3) [m] of each run, None if the shape is not usable, and of its tube (n,) [m]."""
        self._shapes.append((stamp, lines, radii))
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
            with_tube=self._with_tube,
            inside=self._inside / self._with_tube if self._with_tube else None,
        )

    def _settle(self, stamp: int, markers: Array) -> None:
        """Measures one frame against the shape nearest in time."""
        nearest = min(self._shapes, key=lambda shape: abs(shape[0] - stamp), default=None)
        if nearest is None or abs(nearest[0] - stamp) > self.max_skew:
            self.unpaired += 1
            return
        _, lines, radii = nearest
        if lines is None:
            self.unusable += 1
            return
        found: list[Array] = []
        wide: list[Array] = []
        for i, (run, line) in enumerate(zip(self._runs, lines, strict=True)):
            inner = markers[run]
            finite = np.isfinite(inner).all(axis=1)
            self.not_finite += int((~finite).sum())
            apart, places = nearest_on_polyline(inner[finite], line)
            found.append(apart)
            if radii is not None:
                wide.append(np.interp(places, np.arange(len(line)), radii[i]))
        distances = np.concatenate(found)
        if not len(distances):
            return
        self.frames += 1
        self._distances.append(distances)
        self.series.append((stamp, float(distances.mean())))
        widths = np.concatenate(wide) if wide else None
        self.radii.append(math.nan if widths is None else float(widths.mean()))
        if widths is not None:
            self._with_tube += len(distances)
            self._inside += int((distances <= widths).sum())
        if self._told is not None:
            self._told(stamp, distances, widths)


def distance_to_polyline(points: Array, line: Array) -> Array:
    """(m,) [m]: distance of each of `points` (m, 3) to the closest point of the polyline through `line` (n, 3)."""
    return nearest_on_polyline(points, line)[0]


def nearest_on_polyline(points: Array, line: Array) -> tuple[Array, Array]:
    """(m,) [m] and (m,): distance of each of `points` (m, 3) to the polyline through `line` (n, 3), and where.

    Where the closest point is: 2.5 is half way from line[2] to line[3].
    """
    start, step = line[:-1], np.diff(line, axis=0)
    to_point = points[:, None, :] - start[None, :, :]
    square = np.einsum("ij,ij->i", step, step)
    along = np.einsum("mij,ij->mi", to_point, step) / np.where(square > 0.0, square, 1.0)
    along = np.clip(along, 0.0, 1.0)
    rest = to_point - along[:, :, None] * step[None, :, :]
    squares = np.einsum("mij,mij->mi", rest, rest)
    which = squares.argmin(axis=1)
    each = np.arange(len(points))
    return np.sqrt(squares[each, which]), which + along[each, which]
