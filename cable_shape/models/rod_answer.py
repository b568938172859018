"""How the rod's last solution answers a change of its cable: :class:`Changes` and :func:`answers`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels import rod_answer, rod_stability
from cable_shape.models.rod_state import RodState

_NO_SWING: Array = np.empty((0, 3))


@final
class Changes:
    """Directions in which a cable may change, each told by two cables, `steps` (k,) of it above and below.

    stiff (2 k, 6): stiffness and compliance; lengths (2 k,) [m]; tables (2 k, m, 3) [1/m]: rest curvature.
    """

    __slots__ = ("lengths", "steps", "stiff", "tables")

    def __init__(self, pairs: Sequence[tuple[Cable, Cable]], steps: Array) -> None:
        cables = [cable for pair in pairs for cable in pair]
        self.steps = np.array(steps, dtype=np.float64)
        self.lengths = np.array([cable.length for cable in cables])
        self.stiff = np.array([_stiffness(cable) for cable in cables]).reshape(-1, 6)
        rests = [np.atleast_2d(cable.rest_curvature) for cable in cables]
        self.tables = np.array(rests) if rests else np.empty((0, 1, 3))

    @property
    def longer(self) -> Array:
        """(k,) [m]: how much longer the cable is a unit of each direction."""
        return np.asarray(0.5 * (self.lengths[0::2] - self.lengths[1::2]) / self.steps)


def answers(state: RodState, changes: Changes) -> Array:
    """(n, 3, k): change of the last solution's positions, a unit of each direction, both ends being held still.

    Points keep their share of the length.
    """
    problem = state.problem
    out = np.empty((problem.points, 3, len(changes.steps)))
    rod = state.par, state.mesh, state.sol, state.work, state.elements, state.width
    rod_stability.refresh(*rod, True)
    meshes = rod_answer.neighbours(
        state.mesh, state.elements, changes.lengths, changes.tables, problem.load, state.points, state.weights,
        _NO_SWING if problem.swing is None else problem.swing, problem.cable.linear_density,
    )  # fmt: skip
    rod_answer.answers(*rod, changes.stiff, meshes, changes.steps, problem.points, out)
    return out


def _stiffness(cable: Cable) -> tuple[float, ...]:
    """EI1, EI2, GJ, and the compliances in shear and stretch."""
    shear = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
    stretch = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
    return (*cable.bending_stiffness, cable.twisting_stiffness, shear, shear, stretch)
