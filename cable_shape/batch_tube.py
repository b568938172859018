"""What makes up the tubes of a batch: :class:`BatchTube`, and what has none: :func:`check_tube`."""

from __future__ import annotations

from typing import final

import numpy as np

from cable_shape.cable import Cable
from cable_shape.calibration.answers import Answers
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import batch_tube, rod_answer
from cable_shape.models.rod_state import RodState
from cable_shape.pose import Grip, Pose
from cable_shape.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.solve.answers import Changes
from cable_shape.uncertainty import Uncertainty, quantiles

_NO_SWING: Array = np.empty((0, 3))


@final
class BatchTube:
    """How well a cable and its grips are known, as :mod:`cable_shape.kernels.batch_tube` takes it; None: not asked."""

    __slots__ = ("confidence", "known")

    def __init__(self, cable: Cable, uncertainty: Uncertainty | None) -> None:
        self.confidence = 0.0
        changes, poses, twists, misses = Changes((), np.empty(0)), np.empty((12, 0)), np.empty((12, 0)), 0.0
        squares = np.zeros(2)
        if uncertainty is not None:
            self.confidence, misses, poses = uncertainty.confidence, uncertainty.misses, uncertainty.poses
            squares = quantiles(uncertainty.confidence)
            answers = _answers_of(uncertainty, cable)
            if answers is not None:
                level = Grip(Pose())
                order = np.argsort(~answers.material, kind="stable")  # those that change the cable first
                changes, twists = answers.changes, answers.twists(level, level)[:, order]
        stiff = np.array([_stiffness(beside) for beside in changes.cables]).reshape(-1, 6)
        rests = [np.atleast_2d(beside.rest_curvature) for beside in changes.cables]
        tables = np.array(rests) if rests else np.empty((0, 1, 3))
        of_cable = stiff, changes.lengths, tables, changes.steps
        self.known = tuple(np.array(a, order="C") for a in (poses, twists, *of_cable, squares, (misses,)))

    def radius(self, state: RodState, shape: CableShape) -> Array:
        """(n,) [m], of the tube of the last solution, which is `shape`."""
        problem, known, points = state.problem, self.known, shape.points
        meshes = rod_answer.neighbours(
            state.mesh, state.elements, known[batch_tube.LENGTHS], known[batch_tube.TABLES], problem.load,
            state.points, state.weights, _NO_SWING, 0.0,
        )  # fmt: skip
        moves, shifts = np.empty((points, 3, 12)), np.empty((points, 3, len(known[batch_tube.STEPS])))
        out = np.empty(points)
        rod = state.par, state.mesh, state.sol, state.work, state.elements, state.width
        batch_tube.tube(*rod, shape.buffer, points, known, meshes, moves, shifts, out)
        return out


def check_tube(uncertainty: Uncertainty, predictor: Predictor, compiled: bool) -> None:
    """Refuses what has no tube in a batch."""
    if not isinstance(uncertainty, Uncertainty):
        raise ArgumentError.of("uncertainty", uncertainty, "it must be an Uncertainty", "Write Uncertainty({...}).")
    if predictor.model not in ("cosserat", "auto") or predictor.cable.mean_bending_stiffness == 0.0:
        bound = f"only the Cosserat rod knows how its shapes change, not model {predictor.model!r} of this cable"
        remedy = "Choose 'cosserat' or 'auto' and a bending stiffness above 0 N m^2, or leave the uncertainty out."
        raise ArgumentError.of("uncertainty", "given", bound, remedy)
    if not compiled:
        bound = "in a batch it is known between two grips alone, not in clips or with contact='solve'"
        remedy = "Take Cycle(..., uncertainty=...) row by row, or leave clips and contact out."
        raise ArgumentError.of("uncertainty", "given", bound, remedy)


def _stiffness(cable: Cable) -> tuple[float, ...]:
    """EI1, EI2, GJ, and the compliances in shear and stretch."""
    shear = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
    stretch = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
    return (*cable.bending_stiffness, cable.twisting_stiffness, shear, shear, stretch)


def _answers_of(uncertainty: Uncertainty, cable: Cable) -> Answers | None:
    """To steps of one standard deviation of the cable's numbers; None if these are all known."""
    try:
        parameters = uncertainty.parameters(cable)
        return None if parameters is None else Answers(parameters, parameters.start, uncertainty.directions())
    except ArgumentError as error:
        raise ArgumentError(f"uncertainty: {error}") from None
