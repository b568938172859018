"""How a shape answers the numbers of a calibration, to first order: :class:`Answers`."""

from __future__ import annotations

from typing import final

import numpy as np

from cable_shape.calibration.ends import moving, velocities
from cable_shape.calibration.parameters import Parameters
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip
from cable_shape.solve.answers import Changes, Solved, answers, sensitivity

#: Cables beside one are this far from it, in steps of finite differences of whole shapes: nothing is solved for there,
#: so that the gradient's rounding is all that counts.
NEAR = 1e-2


@final
class Answers:
    """The derivatives in directions (m, k) of the parameters, a row each, at `values` (k,); default: each by itself."""

    def __init__(self, parameters: Parameters, values: Array, directions: Array | None = None) -> None:
        whole = np.eye(len(values)) if directions is None else directions
        self._parameters, self._values, self._whole = parameters, values, whole
        self._ends = moving(parameters)
        own = np.setdiff1d(np.arange(len(values)), self._ends)
        #: (m,), of the directions: whether they change the cable itself
        self.material = whole[:, own].any(axis=1)
        rows = whole[self.material]
        unit = np.array([p.step for p in parameters.each])[own]
        steps = NEAR / np.abs(rows[:, own] / unit).max(axis=1, initial=0.0)
        pairs = [
            (parameters.make_cable(values + by * row), parameters.make_cable(values - by * row))
            for by, row in zip(steps.tolist(), rows, strict=True)
        ]
        self.changes = Changes(pairs, steps)

    @property
    def longer(self) -> Array:
        """(m,) [m]: how much longer the cable is a unit of each direction."""
        out = np.zeros(len(self._whole))
        out[self.material] = self.changes.longer
        return out

    def twists(self, start: Grip, end: Grip | FreeEnd) -> Array:
        """(12, m): velocity and angular velocity of the cable's start, then of its end, world axes.

        start, end: as the parameters find them, without what they displace them by.
        """
        return velocities(self._parameters, self._values, self._ends, start, end) @ self._whole[:, self._ends].T

    def moves(self, state: Solved, start: Grip, end: Grip | FreeEnd) -> Array:
        """(n, 3, m): change of the last solution's positions, at the same share of the length."""
        out = np.zeros((state.problem.points, 3, len(self._whole)))
        if self._ends:
            out += sensitivity(state) @ self.twists(start, end)
        if self.material.any():
            out[:, :, self.material] += answers(state, self.changes)
        return out
