"""What is not known of a harness that is seen, as one vector of deviations: :class:`HarnessUnknown`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from cable_shape.cable.harness import SIDES, Harness, split_end
from cable_shape.calibration.harness_parameters import OF_ENDS, HarnessParameters, Target
from cable_shape.checks import Array
from cable_shape.tracking.unknown import Unknown
from cable_shape.uncertainty.uncertainty import Uncertainty

#: Kinds of numbers by which the shape at rest changes, of segments and of ends in junctions.
MATERIAL = ("bending_stiffness", "twisting_stiffness", "length", "rest_curvature", "tilt", "roll")
#: Where the numbers of a grip are among its six.
_OF_GRIP = {"offset": (0, 1, 2), "tilt": (3, 4), "roll": (5,)}


@final
class HarnessUnknown(Unknown):
    """As :class:`Unknown`: grips of all open ends, numbers of the segments, and how they swing.

    Places of the swing are the junctions, the open ends and the middle of each segment. A segment of which no rest
    curvature is told may have a constant one.

    Parameters
    ----------
    harness : Harness
    uncertainty : Uncertainty
    bends : float
        [1], standard deviation of that curvature times the length of the segment.
    swings : bool
        False: it rests, and has no such places.
    """

    parameters: HarnessParameters | None

    def __init__(self, harness: Harness, uncertainty: Uncertainty, bends: float, *, swings: bool = True) -> None:
        told, steps = uncertainty.harness_parameters(harness)
        targets = [] if told is None else told.targets
        mine = [one for one in targets if one.kind in MATERIAL and not self._of_grip(one, harness)]
        bent_already = {segment for one in mine if one.kind == "rest_curvature" for segment in one.of}
        bent = [
            name
            for name, cable in harness.segments.items()
            if bends > 0.0 and name not in bent_already and cable.rest_curvature.ndim == 1 and not cable.sections
        ]
        names = [one.name for one in mine] + [f"rest_curvature:{name}" for name in bent]
        self.parameters = HarnessParameters(harness, names) if names else None
        places, at_ends, rows = _places(harness) if swings else ([], {}, {})
        self.lay_out(harness.open_ends, 0 if self.parameters is None else len(self.parameters.start), len(places))
        self.at_ends, self.rows_of = at_ends, rows  # rows_of: of each segment, its places from start to end
        self.masses = _masses(harness, rows, len(places))
        grips = self.material.start
        for target in () if self.parameters is None else self.parameters.targets:
            self.parts.append(slice(grips + target.first, grips + target.first + len(target.parts)))
        first = np.zeros((self.size, self.size))
        for end, own_grip in self.grips.items():
            first[own_grip, own_grip] = getattr(uncertainty, split_end(end)[1])
        where: list[int] = []
        for one in targets:
            where += self._where(one, harness, mine)
        kept = np.array(where, dtype=np.int64)
        known = steps.T @ steps
        here = kept >= 0
        first[np.ix_(kept[here], kept[here])] += known[np.ix_(here, here)]
        for name in bent:
            own_bend = self._numbers(f"rest_curvature:{name}")
            first[own_bend, own_bend] = (bends / harness.segments[name].length) ** 2
        self.first: Array = first

    @staticmethod
    def _of_grip(target: Target, harness: Harness) -> bool:
        return target.kind in OF_ENDS and harness.junction_of(target.of[0]) is None

    def _numbers(self, name: str) -> list[int]:
        """Where the numbers of a name are in the vector."""
        assert self.parameters is not None
        target = next(one for one in self.parameters.targets if one.name == name)
        first = self.material.start + target.first
        return list(range(first, first + len(target.parts)))

    def _where(self, target: Target, harness: Harness, mine: list[Target]) -> list[int]:
        """Where the numbers that an uncertainty tells are in the vector; -1: nowhere."""
        if self._of_grip(target, harness):
            first = self.grips[target.of[0]].start
            return [first + i for i in _OF_GRIP[target.kind]]
        return self._numbers(target.name) if target in mine else [-1] * len(target.parts)


def _masses(harness: Harness, rows_of: Mapping[str, tuple[int, int, int]], places: int) -> Array:
    """(places,) [kg]."""
    out: Array = np.zeros(places)
    for name, rows in rows_of.items():
        cable = harness.segments[name]
        out[list(rows)] += cable.length * (cable.linear_density or 1.0) * np.array((0.25, 0.5, 0.25))
    if rows_of:
        for i, junction in enumerate(harness.junctions):
            out[i] += junction.mass
    return out


def _places(harness: Harness) -> tuple[list[str], dict[str, int], dict[str, tuple[int, int, int]]]:
    """Names of the places, those of open ends, and of each segment those at its start, middle and end."""
    places = [junction.name for junction in harness.junctions]
    at_ends = {end: len(places) + i for i, end in enumerate(harness.open_ends)}
    places += harness.open_ends
    of_junction = {end: i for i, junction in enumerate(harness.junctions) for end in junction.ends}
    rows = {}
    for name in harness.segments:
        first, last = (
            of_junction[end] if end in of_junction else at_ends[end] for end in (f"{name}.{side}" for side in SIDES)
        )
        rows[name] = (first, len(places), last)
        places.append(name)
    return places, at_ends, rows
