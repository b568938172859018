"""What the calibration of a harness found, with error bars: :class:`HarnessCalibration`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import STANDARD_GRAVITY
from cable_shape.cable.harness import Harness
from cable_shape.calibration.harness_forward import lies, missed, problem_of
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_parameters import HarnessParameters
from cable_shape.calibration.result import STRAY, Estimate, Found, misses_in_words, trouble_of
from cable_shape.checks import Array
from cable_shape.files.files import path_of
from cable_shape.solve import harness_search
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY


@final
@dataclass(frozen=True, slots=True, eq=False)
class HarnessCalibration(Found):
    """The calibrated harness and how well it is known.

    harness : the calibrated harness.
    estimates : of each fitted number; of segments that share a stiffness or a density that of the first.
    correlation : (k, k), of the estimates, of logarithms where these are fitted; NaN where the data say nothing.
    scale : [m], of the misses that remain, per component; robust.
    distances : (n,) [m], from each observed point to the prediction, NaN where there was none.
    weights : (n,), 1: the point counts in full; small: it was taken for a stray one.
    remarks : what the data cannot tell, and what else to know before the numbers are used.
    parameters, values, covariance : what was fitted, where the fit ended (k,), and (k, k) of it.
    freedom : degrees of freedom behind the covariance.
    groups : how many groups the observations came in; 0: none were named.
    inertia : root mean square of the accelerations given with them, of the segment with the largest, as a fraction of
        gravity.
    """

    harness: Harness
    estimates: tuple[Estimate, ...]
    correlation: Array
    scale: float
    distances: Array
    weights: Array
    iterations: int
    converged: bool
    remarks: tuple[str, ...]
    parameters: HarnessParameters
    values: Array
    covariance: Array
    freedom: int
    groups: int = 0
    inertia: float = 0.0

    @property
    def trouble(self) -> str:
        """Why this is no calibration, with the remedy; empty if it is one. See :attr:`Calibration.trouble`."""
        return trouble_of(self.converged, self.distances[self.weights > STRAY], self.harness.length)

    def held(self, ends: Mapping[str, End]) -> dict[str, End]:
        """The ends as this calibration has them: tilts, rolls and offsets that were fitted are in the grips."""
        return self.parameters.held(self.values, ends)

    def predict(self, seen: HarnessObservation, *, gravity: ArrayLike = GRAVITY) -> HarnessShape:
        """The shape of an observation, from nothing, with the numbers found; its points are not looked at."""
        seen.check(self.harness)
        harness, ends = self.parameters.make(self.values, seen.lengths), self.held(seen.ends)
        if seen.lies:
            return lies(harness, seen, gravity=gravity).predict(ends, acceleration=seen.acceleration)
        return harness_search.solve(problem_of(harness, seen, gravity=gravity).move(ends))[0]

    def distances_to(self, seen: HarnessObservation, *, gravity: ArrayLike = GRAVITY) -> dict[str, Array]:
        """[m], from points of an observation, which may be one that was not fitted, to its prediction; by the keys of
        its points, NaN without a usable shape."""
        sizes = np.linalg.norm(missed(seen, self.predict(seen, gravity=gravity)), axis=1)
        ends = np.cumsum([len(points) for points in seen.points.values()])
        return dict(zip(seen.points, np.split(sizes, ends[:-1]), strict=True))

    def report(self) -> str:
        """In words, one line each."""
        lines = [f"{e.name:<28} {e}" for e in self.estimates]
        for name, cable in self.harness.segments.items():
            weight = cable.linear_density * STANDARD_GRAVITY
            if weight > 0.0:
                lines.append(f"{f'EI / weight of {name}':<28} {cable.mean_bending_stiffness / weight:.4g} m^3")
        lines += misses_in_words(self.distances, self.weights, self.harness.length, 28)
        lines.append(f"{'iterations':<28} {self.iterations}{'' if self.converged else ', not converged'}")
        return "\n".join([*lines, *(f"note: {remark}" for remark in self.remarks)])

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers, for JSON; None for what is not finite."""
        from cable_shape.calibration.result import told_of

        return {
            "harness": self.harness.as_dict(),
            **told_of(self.estimates, self.correlation, self.scale, self.distances),
            "converged": self.converged,
            "trouble": self.trouble,
            "remarks": list(self.remarks),
        }

    def yaml(self, more: Mapping[str, Any] | None = None) -> str:
        """The file of the harness with the uncertainties in comments; tilts and offsets of grips are in these alone.

        more: other keys of the file.
        """
        import yaml

        lines = ["# Calibrated; standard errors and 95 % intervals of what was fitted."]
        lines += [f"# not to be used: {self.trouble}"] if self.trouble else []
        lines += [f"# {e.name}: {e}" for e in self.estimates]
        lines += [f"# note: {remark}" for remark in self.remarks]
        keys = {**self.harness.as_dict(), **(more or {})}
        told = yaml.safe_dump(keys, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
        return "\n".join([*lines, str(told)])

    def save(self, path: str | Path) -> Path:
        """Writes `yaml` to a file, whose folder must be there."""
        file = path_of(path)
        file.write_text(self.yaml(), encoding="utf-8")
        return file
