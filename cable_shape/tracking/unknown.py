"""What is not known of a cable that is seen, as one vector of deviations: :class:`Unknown`.

    grips       how both cable frames lie beside what is told of the grips, in themselves: moved [m], turned [rad]
    material    logarithm of EI, length [m], what else an `Uncertainty` names, and rest curvature about d1 and d2 [1/m]
                at supports evenly along the cable, linear between: bends that the cable has beside those that are told
    swing       acceleration [m/s^2], world, at places evenly along the cable, linear between
    rates       the same of how fast it changes [m/s^3]

Grips and material stay, but for a slow drift. Bends are a Gaussian process along the cable, stationary, correlated as
exp(-distance / reach).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.calibration.parameters import ALONG, ROWS, Parameters
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip
from cable_shape.tracking.swing import QUICK
from cable_shape.uncertainty.uncertainty import Uncertainty

if TYPE_CHECKING:
    from cable_shape.calibration.harness_parameters import HarnessParameters

ENDS = ("start", "end")
#: Names of material by which the shape at rest changes.
MATERIAL = (
    "bending_stiffness", "bending_stiffness_along", "twisting_stiffness", "axial_stiffness", "length", "rest_curvature",
    ALONG,
)  # fmt: skip
#: Reach of the bends, as a fraction of the length.
REACH = 0.5
#: [s]: what stays is known anew after so long, but for what its first spread says.
DRIFT = 100.0
#: Where the names that calibrations have for the grips are in the vector.
_OF_GRIPS = {
    f"{side}_{name}": first + i
    for side, first in (("start", 0), ("end", 6))
    for i, name in enumerate(("x", "y", "z", "tilt_1", "tilt_2", "roll"))
} | {"roll": 11}


class Unknown:
    """Where each number is in the vector, how far they spread at first, and how far they drift.

    Parameters
    ----------
    cable : Cable
    uncertainty : Uncertainty
        Of cable and grips, beside the bends; numbers by which no cable at rest changes are left out.
    rows : int
        Places of the swing, 3 at least; 0: it does not swing.
    bends : float
        [1], standard deviation of the bends times the length of the cable.
    """

    parameters: Parameters | HarnessParameters | None
    first: Array  # (k, k), at first, the swing left out
    masses: Array  # (rows,) [kg], that swing with each place, times any number
    at_ends: Mapping[str, int]  # the places that are ends, by their names

    def __init__(self, cable: Cable, uncertainty: Uncertainty, rows: int, bends: float) -> None:
        told, _ = uncertainty.parameters(cable)
        names = [] if told is None else [name for name in told.names if name in MATERIAL]
        bent = bends > 0.0 and "rest_curvature" not in names
        if bent and ALONG not in names:
            names.append(ALONG)
        supports = told.supports if told is not None and ALONG in told.names else ROWS
        known = self.parameters = Parameters(cable, names, supports=supports) if names else None
        self.lay_out(ENDS, 0 if known is None else len(known.start), rows)
        self.at_ends = {"start": 0, "end": rows - 1} if rows else {}
        self.masses = np.ones(rows)
        for name in names:
            assert known is not None
            own = known.where(name)
            self.parts.append(slice(12 + own.start, 12 + own.stop))
        first = np.zeros((self.size, self.size))
        first[:6, :6], first[6:12, 6:12] = uncertainty.start, uncertainty.end
        if told is not None:
            places = np.array(self._places(told))
            spread = uncertainty.covariance
            if len(places) > len(spread):  # a bundle of wires says itself how stiff it may be
                spread = np.pad(spread, (0, 1))
                spread[-1, -1] = cable.stiffness_spread**2
            here = places >= 0
            first[np.ix_(places[here], places[here])] += spread[np.ix_(here, here)]
        if bent:
            assert known is not None
            bends_at = known.where(ALONG)
            at = np.arange(12 + bends_at.start, 12 + bends_at.stop)
            field = (bends / cable.length) ** 2 * correlated(supports, REACH)
            first[np.ix_(at, at)] += np.kron(field, np.eye(2))
        self.first = first

    def lay_out(self, ends: Sequence[str], count: int, rows: int) -> None:
        """Where things are: grips at these ends, so many numbers of material, so many places of the swing."""
        grips = 6 * len(ends)
        self.ends, self.rows = tuple(ends), rows
        self.grips = {end: slice(6 * i, 6 * i + 6) for i, end in enumerate(ends)}
        self.material = slice(grips, grips + count)
        self.stays = slice(0, grips + count)
        self.swing = slice(grips + count, grips + count + 3 * rows)
        self.rates = slice(self.swing.stop, self.swing.stop + 3 * rows)
        self.moving = slice(self.swing.start, self.rates.stop)
        self.size = self.rates.stop
        #: What belongs together of what stays: place and direction of each grip, each number of the cable, its bends.
        self.parts = [slice(i, i + 3) for i in range(0, grips, 3)]

    def end_of(self, part: slice) -> str | None:
        """The end of which a part is; None: of the cable."""
        return self.ends[part.start // 6] if part.start < self.material.start else None

    def vibrate(self, ends: Mapping[str, Grip | FreeEnd]) -> Array:
        """(i,): the places that no grip holds."""
        held = [place for end, place in self.at_ends.items() if isinstance(ends.get(end), Grip)]
        return np.setdiff1d(np.arange(self.rows), held)

    def _places(self, told: Parameters) -> list[int]:
        """Where in the vector the numbers of a calibration are; -1: nowhere."""
        mine = {} if self.parameters is None else {p.name: 12 + j for j, p in enumerate(self.parameters.each)}
        return [_OF_GRIPS.get(parameter.name, mine.get(parameter.name, -1)) for parameter in told.each]

    def covariance(self, swing: float) -> Array:
        """(k, k), at first; swing [m/s^2]: standard deviation of each component of the acceleration."""
        out = self.first.copy()
        np.fill_diagonal(out[self.swing, self.swing], swing**2)
        np.fill_diagonal(out[self.rates, self.rates], (swing * QUICK) ** 2)
        return out


def correlated(count: int, reach: float) -> Array:
    """(count, count): correlations between places evenly from 0 to 1, exp(-distance / reach)."""
    at = np.linspace(0.0, 1.0, count)
    return np.asarray(np.exp(-np.abs(at[:, None] - at) / reach))
