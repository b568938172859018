"""Every shape with its tube: :class:`TubeWatch`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable import Cable
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.models.rod_common import MODEL
from cable_shape.pose import Ends, FreeEnd, Grip, Pose, as_grip
from cable_shape.predictor import Predictor
from cable_shape.shape import CableShape
from cable_shape.uncertainty import Tube, Uncertainty


@final
class TubeWatch:
    """The covariance of one cable's shapes, first order in the grips' poses and of second order in the cable's numbers.

    Poses count through the rod's sensitivity. Of the cable each principal direction of what is not known has two rods
    of its own, one standard deviation to either side, that are warm and move along: half their difference is how far
    the shape moves. Where one of the two has no usable shape (it is too short to reach, say), how far the other is from
    the prediction counts.

    Parameters
    ----------
    cable : Cable
    uncertainty : Uncertainty
    parameters, values : optional
        Of a calibration, and where they are; default: those of the cable, as it is.
    **options
        Keywords of :class:`cable_shape.Predictor`.
    """

    def __init__(
        self,
        cable: Cable,
        uncertainty: Uncertainty,
        parameters: Parameters | None = None,
        values: Array | None = None,
        **options: Any,
    ) -> None:
        if cable.mean_bending_stiffness == 0.0:
            raise ArgumentError.of(
                "uncertainty",
                "of a cable without bending stiffness",
                "it is told by the Cosserat rod",
                "Give a bending stiffness above 0 N m^2, or leave the uncertainty out.",
            )
        self.uncertainty = uncertainty
        self.trouble = ""  # why the last shape has no tube
        self._poses = uncertainty.poses
        self._last: Tube | None = None
        self._rods: list[tuple[Predictor, Pose | None, Pose | None]] = []
        given = uncertainty.parameters(cable) if parameters is None else parameters
        if given is None:
            return
        middle = given.start if values is None else values
        for step in uncertainty.directions():
            for at in (middle + step, middle - step):
                try:
                    rod = Predictor(given.make_cable(at), model=MODEL, **options)
                except ArgumentError as error:
                    raise ArgumentError(f"uncertainty, one standard deviation away: {error}") from None
                self._rods.append((rod, given.offset(at, "start"), given.offset(at, "end")))

    def reset(self) -> None:
        """Forgets the last shape."""
        self._last = None
        for rod, _, _ in self._rods:
            rod.reset()

    def tube(
        self,
        predictor: Predictor,
        shape: CableShape,
        ends: Ends,
        links: Mapping[str, Pose] | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Tube | None:
        """The tube of the shape that `predictor` has just given between these ends; None where it is not known.

        `trouble` says why then. Where a rod beside it takes another stable shape, the tube is as wide as that is far.
        """
        self.trouble = ""
        if shape.reused and self._last is not None:
            self._last = Tube(shape, self._last.covariance, self._last.radius, self._last.confidence)
            return self._last
        self._last = None
        if not shape.status:
            self.trouble = "there is no usable shape"
            return None
        moved: list[Array] = []
        if self._poses.shape[1]:
            if predictor.touching:
                self.trouble = "the cable touches itself or another one"
                return None
            answers = predictor.sensitivity(at="gripper").reshape(-1, 12) @ self._poses
            moved.append(answers.reshape(shape.points, 3, -1))
        start, end = as_grip("start", ends[0]), ends[1]
        far = FreeEnd() if end is None else end if isinstance(end, FreeEnd) else as_grip("end", end)
        lines = []
        for rod, near_offset, far_offset in self._rods:
            near = held(start, near_offset)
            assert isinstance(near, Grip)
            beside = rod.predict(near, held(far, far_offset), links, acceleration=acceleration)
            lines.append(beside.positions if beside.status else None)
        for one, other in zip(lines[0::2], lines[1::2], strict=True):
            if one is not None and other is not None:
                step = 0.5 * (one - other)
            elif one is not None:
                step = one - shape.positions
            elif other is not None:
                step = other - shape.positions
            else:
                self.trouble = "cables one standard deviation away have no usable shape"
                return None
            moved.append(step[:, :, None])
        if moved:
            steps = np.concatenate(moved, axis=2)
            covariance = steps @ steps.transpose(0, 2, 1)
        else:
            covariance = np.zeros((shape.points, 3, 3))
        radius = self.uncertainty.radius(covariance, shape.tangents)
        self._last = Tube(shape, covariance, radius, self.uncertainty.confidence)
        return self._last
