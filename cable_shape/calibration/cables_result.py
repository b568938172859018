"""What the calibration of several cables found, with error bars: :class:`CablesCalibration`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from cable_shape.cable.cable import GRIPS, STANDARD_GRAVITY, Cable
from cable_shape.cable.cable_file import SIDES, CableFile, Held
from cable_shape.calibration.cables_parameters import CablesParameters
from cable_shape.calibration.result import STRAY, Estimate, Found, misses_in_words, told_of, trouble_of
from cable_shape.checks import Array


@final
@dataclass(frozen=True, slots=True, eq=False)
class CablesCalibration(Found):
    """The calibrated cables and how well they are known.

    cables : the calibrated cables, by name.
    estimates : of each fitted number; of cables that share one that of the first.
    grips : how start and end of each were held, and where what was fitted puts the cable's frames.
    correlation, scale, distances, weights, iterations, converged, remarks, values, covariance, freedom, groups, inertia
        As of :class:`cable_shape.Calibration`; points are those of one look after the other, cable by cable.
    parameters : what was fitted.
    """

    cables: Mapping[str, Cable]
    grips: Mapping[str, tuple[Held, Held]]
    estimates: tuple[Estimate, ...]
    correlation: Array
    scale: float
    distances: Array
    weights: Array
    iterations: int
    converged: bool
    remarks: tuple[str, ...]
    parameters: CablesParameters
    values: Array
    covariance: Array
    freedom: int
    groups: int = 0
    inertia: float = 0.0

    @property
    def trouble(self) -> str:
        """Why this is no calibration, with the remedy; empty if it is one. See :attr:`Calibration.trouble`."""
        return trouble_of(self.converged, self.distances[self.weights > STRAY], self._longest)

    @property
    def files(self) -> dict[str, CableFile]:
        """Each cable with its grips: ``found.files["a"].start.grip(pose)`` is a start as this calibration has it."""
        return {name: CableFile(cable, *self.grips[name]) for name, cable in self.cables.items()}

    @property
    def _longest(self) -> float:
        return max(cable.length for cable in self.cables.values())

    def report(self) -> str:
        """In words, one line each."""
        lines = [f"{e.name:<28} {e}" for e in self.estimates]
        for name, cable in self.cables.items():
            weight = cable.linear_density * STANDARD_GRAVITY
            if weight > 0.0:
                lines.append(f"{f'EI / weight of {name}':<28} {cable.mean_bending_stiffness / weight:.4g} m^3")
        lines += misses_in_words(self.distances, self.weights, self._longest, 28)
        lines.append(f"{'iterations':<28} {self.iterations}{'' if self.converged else ', not converged'}")
        return "\n".join([*lines, *(f"note: {remark}" for remark in self.remarks)])

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers, for JSON; None for what is not finite."""
        return {
            "cables": {name: cable.as_dict() for name, cable in self.cables.items()},
            **told_of(self.estimates, self.correlation, self.scale, self.distances),
            "converged": self.converged,
            "trouble": self.trouble,
            "remarks": list(self.remarks),
            GRIPS: {
                name: {side: held.as_dict() for side, held in zip(SIDES, both, strict=True)}
                for name, both in self.grips.items()
            },
        }
