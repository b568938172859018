"""What makes up the tubes of a batch: :class:`BatchTube`, and what has none: :func:`check_tube`."""

from __future__ import annotations

from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.calibration.answers import Answers
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import mesh
from cable_shape.kernels.safety import batch_spread as batch_tube
from cable_shape.pose import Grip, Pose
from cable_shape.prediction.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.solve.answers import Changes
from cable_shape.solve.network import Network
from cable_shape.uncertainty.uncertainty import Uncertainty, quantiles


@final
class BatchTube:
    """How well a cable and its grips are known, as `kernels.safety.batch_spread` takes it; None: not asked."""

    __slots__ = ("confidence", "known")

    def __init__(self, network: Network | None, uncertainty: Uncertainty | None) -> None:
        self.confidence = 0.0
        changes, poses, twists, misses = Changes((), np.empty(0)), np.empty((12, 0)), np.empty((12, 0)), 0.0
        squares = np.zeros(2)
        models, before, after = np.empty((0, 0)), np.empty(0), np.empty((0, 0))
        if uncertainty is not None and network is not None:
            self.confidence, misses, poses = uncertainty.confidence, uncertainty.misses, uncertainty.poses
            squares = quantiles(uncertainty.confidence)
            answers = _answers_of(uncertainty, network.problem.cable)
            if answers is not None:
                level = Grip(Pose())
                order = np.argsort(~answers.material, kind="stable")  # those that change the cable first
                changes, twists = answers.changes, answers.twists(level, level)[:, order]
                models, before, after = network.beside(changes.cables)
        self.known = batch_tube.Known(
            np.ascontiguousarray(poses),
            np.ascontiguousarray(twists),
            changes.steps,
            models,
            before,
            after,
            squares,
            misses,
        )

    def radius(self, state: Network, shape: CableShape) -> Array:
        """(n,) [m], of the tube of the last solution, which is `shape`."""
        known, points = self.known, shape.points
        network = state.ints, state.floats, state.sols, state.work
        models = mesh.neighbours(state.bare, known.models, state.ints, state.floats, known.before, known.after)
        moves, shifts = np.empty((points, 3, 12)), np.empty((points, 3, len(known.steps)))
        out = np.empty(points)
        batch_tube.tube(*network, shape.buffer, points, known, models, moves, shifts, out)
        return out


def check_tube(uncertainty: Uncertainty, predictor: Predictor) -> None:
    """Refuses what has no tube in a batch."""
    if not isinstance(uncertainty, Uncertainty):
        raise ArgumentError.of("uncertainty", uncertainty, "it must be an Uncertainty", "Write Uncertainty({...}).")
    if predictor.model not in ("cosserat", "auto") or predictor.cable.mean_bending_stiffness == 0.0:
        bound = f"only the Cosserat rod knows how its shapes change, not model {predictor.model!r} of this cable"
        remedy = "Choose 'cosserat' or 'auto' and a bending stiffness above 0 N m^2, or leave the uncertainty out."
        raise ArgumentError.of("uncertainty", "given", bound, remedy)


def _answers_of(uncertainty: Uncertainty, cable: Cable) -> Answers | None:
    """To steps of one standard deviation of the cable's numbers; None if these are all known."""
    try:
        parameters, directions = uncertainty.parameters(cable)
        return None if parameters is None else Answers(parameters, parameters.start, directions)
    except ArgumentError as error:
        raise ArgumentError(f"uncertainty: {error}") from None
