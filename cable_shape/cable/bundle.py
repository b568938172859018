"""What a bundle of wires weighs and how it bends, where a drawing does not say it: :func:`bundle_of`.

No format of harnesses has a bending stiffness. It lies between two bounds, as in `wires`: all strands
of all conductors slip on each other, or all stick. With the area A of a conductor of strands of diameter d, and wires
whose middles fill a disc of radius R evenly,

    slip:   sum (E A d^2 / 16 + EI of the insulation)
    stick:  sum (E A^2 / 4 pi + EI of the insulation + E A R^2 / 4).

The wires of a bundle are not placed one by one: nothing says where they lie.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from cable_shape.cable.kbl_parts import Strand

#: [Pa] and [kg/m^3]: annealed copper; PVC and the like at room temperature, as insulation and as tape or hose.
COPPER, INSULATION, COVER = (1.2e11, 8960.0), (1.0e8, 1400.0), (2.0e7, 1200.0)
#: [m], of a strand of a flexible conductor: 0.19 to 0.4 mm.
STRAND = 3e-4
#: Shares of copper in a wire, and of wires in a bundle.
FILLED, PACKED = 0.3, 0.7
#: [m^2], of the conductor of a wire of which nothing is known.
THIN = 5e-7


class Bundle(NamedTuple):
    """Wires in one segment; `stated` is the part of `linear_density` that a file says."""

    linear_density: float  # [kg/m]
    stated: float  # [kg/m]
    stiffness: tuple[float, float]  # [N m^2], slip and stick
    pull: float  # [N], EA of the conductors
    diameter: float  # [m]
    bend_radius: float | None  # [m], the smallest allowed
    derived: tuple[str, ...]  # what was made up, in words


def bundle_of(strands: Sequence[Strand], area: float | None) -> Bundle:
    """The bundle of these wires, whose cross section [m^2] may be known."""
    derived: dict[str, None] = {}
    if not strands:
        derived["no wire is routed: as one of 0.5 mm2"] = None
        strands = (Strand("", 1, None, None, None, None),)
    sizes = [_size(one, derived) for one in strands]
    density = stated = 0.0
    for one, (copper, thick) in zip(strands, sizes, strict=True):
        if one.mass is None:
            derived["masses of wires without one, of their copper and insulation"] = None
            density += COPPER[1] * copper + INSULATION[1] * max(0.25 * math.pi * thick**2 - copper, 0.0)
        else:
            density, stated = density + one.mass, stated + one.mass
    diameter = _diameter([thick for _, thick in sizes], area)
    low = high = 0.0
    for copper, thick in sizes:
        radius = max(0.5 * (diameter - thick), 0.0)
        insulation = INSULATION[0] * (math.pi / 64.0 * thick**4 - copper**2 / (4.0 * math.pi))
        strand = min(STRAND, math.sqrt(4.0 * copper / math.pi))
        low += COPPER[0] * copper * strand**2 / 16.0 + max(insulation, 0.0)
        high += COPPER[0] * copper * (copper / (4.0 * math.pi) + 0.25 * radius**2) + max(insulation, 0.0)
    radii = [one.bend_radius for one in strands if one.bend_radius is not None]
    pull = COPPER[0] * sum(copper for copper, _ in sizes)
    return Bundle(density, stated, (low, max(low, high)), pull, diameter, max(radii, default=None), tuple(derived))


def covered(diameter: float, mass: float) -> tuple[float, float]:
    """EI [N m^2] and outer diameter [m] that a cover of this mass [kg/m] adds to, and gives, a bundle this thick."""
    wall = mass / (COVER[1] * math.pi * diameter)
    outer = diameter + 2.0 * wall
    return COVER[0] * math.pi / 64.0 * (outer**4 - diameter**4), outer


def _size(one: Strand, derived: dict[str, None]) -> tuple[float, float]:
    """Area of the conductor [m^2] and outer diameter [m] of a wire."""
    copper, thick = one.area, one.diameter
    if copper is None or thick is None:
        derived["cross sections of wires without one"] = None
    if copper is None:
        mass = COPPER[1] + INSULATION[1] * (1.0 - FILLED) / FILLED
        copper = FILLED * 0.25 * math.pi * thick**2 if thick else (one.mass / mass if one.mass else THIN)
    if thick is None:
        thick = math.sqrt(4.0 * copper / (math.pi * FILLED))
    return copper, thick


def _diameter(each: Sequence[float], area: float | None) -> float:
    """[m]: of the area, where one is known, but not below that of the wires together."""
    if area:
        return max(math.sqrt(4.0 * area / math.pi), math.sqrt(sum(thick**2 for thick in each)))
    return each[0] if len(each) == 1 else math.sqrt(sum(thick**2 for thick in each) / PACKED)
