"""How fast a cable moves, and where it has just been: :class:`Swing`. Imports rerun: see recording."""

from __future__ import annotations

from collections import deque
from typing import final

import numpy as np
import rerun as rr

from cable_shape.checks import Array
from cable_shape.shape import CableShape
from cable_shape.viewer import colour as colours
from cable_shape.viewer.columns import Columns

#: Centrelines of a trail, [ns] between them, and points of each.
TRAIL, APART, POINTS = 8, 40_000_000, 41
#: Arrows of the speed, each as long as the cable goes in so many seconds.
ARROWS, SECONDS = 11, 0.1
_FAINTEST, _STRONGEST = 20, 150  # opacity of the oldest line, and of the newest
_ARROW_COLOUR = np.array([colours.SPEED], dtype=np.uint8)


@final
class Swing:
    """Writes arrows and a trail that fades of one cable that swings to two entities, which go when it has no speed."""

    def __init__(self, base: str) -> None:
        self._speed, self._trail = f"{base}/speed", f"{base}/trail"
        self._lines: deque[tuple[int, Array]] = deque(maxlen=TRAIL)
        self._shown = False

    def write(self, shape: CableShape, diameter: float, stamp: int, columns: Columns) -> None:
        """Those of a shape at a stamp [ns], the columns' present time; diameter [m], of the cable."""
        if shape.velocity is None or not shape.status:
            if self._shown:
                columns.write(self._speed, rr.Clear(recursive=True))
                columns.write(self._trail, rr.Clear(recursive=True))
            self._lines.clear()
            self._shown = False
            return
        self._shown = True
        at = _spread(shape.points, ARROWS)
        columns.put(
            self._speed, rr.Arrows3D, origins=shape.positions[at], vectors=SECONDS * shape.velocity[at],
            colors=_ARROW_COLOUR, radii=np.array([0.35 * diameter]),
        )  # fmt: skip
        if self._lines and not 0 <= stamp - self._lines[-1][0] <= TRAIL * APART:
            self._lines.clear()  # a bag that begins again, or a gap
        if not self._lines or stamp - self._lines[-1][0] >= APART:
            self._lines.append((stamp, shape.positions[_spread(shape.points, POINTS)].astype(np.float32)))
        opacity = np.linspace(_FAINTEST, _STRONGEST, TRAIL)[-len(self._lines) :]
        colour = np.tile(np.array(colours.SPEED, dtype=np.uint8), (len(opacity), 1))
        colour[:, 3] = opacity
        lines = np.stack([line for _, line in self._lines])
        columns.put(self._trail, rr.LineStrips3D, strips=lines, colors=colour, radii=np.array([0.2 * diameter]))


def _spread(points: int, count: int) -> Array:
    """Which of so many points are shown, `count` at most."""
    return np.unique(np.linspace(0, points - 1, min(points, count)).round().astype(int))
