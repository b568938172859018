"""Bundles of wires as one cable: :class:`Wire`, and how stiff they are from full slip to full stick.

Wires that slip on each other bend each about its own middle, EI = sum of E I_i (full slip). Wires that stick bend about
that of the bundle, EI = sum of E (I_i + A_i y_i^2) with y_i from the middle of the bundle, the mean of all directions
(full stick). In between friction decides: a bundle is stiff at first and tends to full slip as it is bent further,
which is what a cable in hands or grippers is (K. O. Papailiou, On the bending stiffness of transmission line
conductors, IEEE Transactions on Power Delivery, 1997). So full slip is the default; lay, tape and tension make it
stiffer.

The bundle is packed round: the thickest wire in the middle, each next one where it touches two others nearest to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

#: Wires of one bundle.
MOST_WIRES = 400


@final
@dataclass(frozen=True, slots=True)
class Wire:
    """A wire of a bundle, or `count` alike; or what covers a bundle as a tube.

    Parameters
    ----------
    outside_diameter : float
        [m], insulation included, above 0.
    linear_density : float
        [kg/m], of one, at least 0.
    bending_stiffness : float, optional
        [N m^2], EI of one by itself; this or `youngs_modulus` is needed.
    youngs_modulus : float, optional
        [Pa], of a solid round wire of the outside diameter; of a covering of the tube around the bundle.
    count : int
        At least 1.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    outside_diameter: float
    linear_density: float
    bending_stiffness: float | None = None
    youngs_modulus: float | None = None
    count: int = 1

    def __post_init__(self) -> None:
        put = object.__setattr__
        diameter = checks.number("Wire.outside_diameter", self.outside_diameter, above=0.0, unit="m")
        put(self, "outside_diameter", diameter)
        density = checks.number("Wire.linear_density", self.linear_density, at_least=0.0, unit="kg/m")
        put(self, "linear_density", density)
        for name, unit in (("bending_stiffness", "N m^2"), ("youngs_modulus", "Pa")):
            value = checks.optional_number(f"Wire.{name}", getattr(self, name), above=0.0, unit=unit)
            put(self, name, value)
        if (self.bending_stiffness is None) == (self.youngs_modulus is None):
            given = [self.bending_stiffness, self.youngs_modulus]
            bound = "one of the two is needed, and only one"
            raise ArgumentError.of(
                "Wire.bending_stiffness, youngs_modulus", given, bound, "Give EI if you measured it."
            )
        put(self, "count", checks.integer("Wire.count", self.count, at_least=1, at_most=MOST_WIRES))

    @property
    def own_stiffness(self) -> float:
        """[N m^2], EI of one by itself."""
        if self.bending_stiffness is not None:
            return self.bending_stiffness
        assert self.youngs_modulus is not None
        return self.youngs_modulus * math.pi / 64.0 * self.outside_diameter**4

    @property
    def pull_stiffness(self) -> float:
        """[N], EA of one; of a wire of which EI is known that of a solid round one."""
        return 16.0 * self.own_stiffness / self.outside_diameter**2


def packed(diameters: Sequence[float]) -> tuple[Array, float]:
    """Places (n, 2) [m] of wires packed round about the middle of their areas, and the diameter of the bundle [m].

    The thickest lies in the middle, each next one where it touches two others nearest to the middle.
    """
    order = sorted(range(len(diameters)), key=lambda i: -diameters[i])
    radii = 0.5 * np.array([diameters[i] for i in order])
    places = np.zeros((len(order), 2))
    for n in range(1, len(order)):
        if n == 1:
            places[1] = (radii[0] + radii[1], 0.0)
            continue
        there, reach = places[:n], radii[:n] + radii[n]
        i, j = np.triu_indices(n, 1)
        way = there[j] - there[i]
        apart = np.linalg.norm(way, axis=1)
        near = apart < reach[i] + reach[j]
        i, j, way, apart = i[near], j[near], way[near], apart[near]
        along = 0.5 * (apart + (reach[i] ** 2 - reach[j] ** 2) / apart)
        height = np.sqrt(np.maximum(reach[i] ** 2 - along**2, 0.0))
        t = way / apart[:, None]
        side = np.stack((-t[:, 1], t[:, 0]), axis=1)
        foot = there[i] + along[:, None] * t
        options = np.concatenate((foot + height[:, None] * side, foot - height[:, None] * side))
        gaps = np.linalg.norm(options[:, None] - there, axis=2) - reach
        free = options[(gaps > -1e-9 * radii[0]).all(axis=1)]
        places[n] = free[np.linalg.norm(free, axis=1).argmin()]
    areas = radii**2
    places -= (areas[:, None] * places).sum(axis=0) / areas.sum()
    diameter = 2.0 * float((np.linalg.norm(places, axis=1) + radii).max()) if len(order) > 1 else float(2.0 * radii[0])
    out = np.empty_like(places)
    out[order] = places
    return out, diameter


def keywords_of(wires: Sequence[Wire], covering: Wire | None = None) -> dict[str, Any]:
    """The keywords of the cable that a bundle of wires makes, see :meth:`cable_shape.Cable.from_wires`."""
    given = checks.entries("wires", wires, Wire, "Write [Wire(outside_diameter, linear_density, ...), ...].")
    each = [wire for wire in given for _ in range(wire.count)]
    if not 1 <= len(each) <= MOST_WIRES:
        bound = f"a bundle has 1 to {MOST_WIRES} wires"
        raise ArgumentError.of("wires", len(each), bound, "Give several thin wires as one with their EI and mass.")
    places, diameter = packed([wire.outside_diameter for wire in each])
    low = sum(wire.own_stiffness for wire in each)
    pull = np.array([wire.pull_stiffness for wire in each])
    middle = (pull[:, None] * places).sum(axis=0) / pull.sum()
    high = low + 0.5 * float((pull * ((places - middle) ** 2).sum(axis=1)).sum())
    density = sum(wire.linear_density for wire in each)
    if covering is not None:
        checks.instance("covering", covering, (Wire,), "Write Wire(outside_diameter, linear_density, ...).")
        outer = covering.outside_diameter
        if outer < diameter * (1.0 - 1e-9):
            bound = f"it must be at least the diameter of the bundle, {diameter:.4g} m"
            raise ArgumentError.of("covering.outside_diameter", outer, bound, "Give that over the covering.")
        own = covering.own_stiffness
        if covering.youngs_modulus is not None:
            own *= max(1.0 - (diameter / outer) ** 4, 0.0)
        low, high = low + covering.count * own, high + covering.count * own
        density, diameter = density + covering.count * covering.linear_density, outer
    stiffness = {"bending_stiffness": low, "stiffness_interval": (low, high)}
    return {"linear_density": density, "diameter": diameter, **stiffness}
