"""A cable as a fixed number of capsules that hold it, for planners that know no cables: :class:`Capsules`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.shape import CableShape

MAX_CAPSULES = 64


@final
@dataclass(frozen=True, slots=True, eq=False)
class Capsules:
    """A chain of capsules of one radius along a cable.

    Attributes
    ----------
    points : (k + 1, 3) [m], ends of the capsules' axes: points of the centreline, equally far apart in arc length.
    radius : [m]
    """

    points: Array
    radius: float

    @classmethod
    def around(cls, shape: CableShape, diameter: float, count: int, padding: float = 0.0) -> Capsules:
        """The `count` capsules that hold a cable of `diameter` [m] wherever it moves within `padding` [m].

        Raises
        ------
        ArgumentError
            For a count outside of 1 to 64, or one above the number of the shape's intervals.
        """
        positions = shape.positions
        most = min(MAX_CAPSULES, len(positions) - 1)
        count = checks.integer("capsules", count, at_least=1, at_most=most)
        joints = np.round(np.linspace(0.0, len(positions) - 1.0, count + 1)).astype(int)
        bend = np.linalg.norm(positions[2:] - 2.0 * positions[1:-1] + positions[:-2], axis=1).max(initial=0.0)
        capsules = cls(positions[joints], 0.0)
        # between two points an arc is an eighth of the second difference off its chord
        radius = capsules.farthest(positions) + 0.125 * float(bend) + 0.5 * diameter + padding
        return cls(capsules.points, radius)

    def farthest(self, positions: Array) -> float:
        """[m], largest distance from positions (n, 3), which run along the cable, to the axes of their own capsules."""
        start, axis = self.points[:-1], np.diff(self.points, axis=0)
        own = np.minimum(np.arange(len(positions)) * len(axis) // max(1, len(positions) - 1), len(axis) - 1)
        # a point where two capsules meet by rounding may belong to either
        distances = [self._to_axis(positions, start[k], axis[k]) for k in (own, np.maximum(own - 1, 0))]
        distances.append(self._to_axis(positions, *(x[np.minimum(own + 1, len(axis) - 1)] for x in (start, axis))))
        return float(np.min(distances, axis=0).max())

    @staticmethod
    def _to_axis(positions: Array, start: Array, axis: Array) -> Array:
        """(n,) distance of each position from the segment that begins at its `start` and runs along its `axis`."""
        away = positions - start
        along = (away * axis).sum(axis=1) / np.maximum((axis * axis).sum(axis=1), np.finfo(float).tiny)
        return np.asarray(np.linalg.norm(away - np.clip(along, 0.0, 1.0)[:, None] * axis, axis=1))

    def hold(self, shape: CableShape, diameter: float) -> bool:
        """Whether they hold a cable of this shape, too."""
        return self.farthest(shape.positions) + 0.5 * diameter <= self.radius
