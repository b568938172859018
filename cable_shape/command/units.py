"""Numbers that are allowed and hardly meant: slips of units in a cable and a scene, with what they may have been."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

from cable_shape.cable.cable import Cable
from cable_shape.scene.scene import Scene

#: kg/m^3, from foam to lead, of the whole section
DENSITIES = (50.0, 12000.0)

#: Pa, steel has 2.1e11: a homogeneous round section of this modulus is stiffer than any cable
STIFFEST = 3e11

#: m, of cables and of the places of obstacles in a cell
LENGTHS = (0.01, 100.0)

CHECK_UNITS = "Everything is in SI units: m, kg/m, N m^2."


@final
@dataclass(frozen=True, slots=True)
class Slip:
    """What was found, and what to do about it."""

    found: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.found}. {self.remedy}"


def slips_of(cable: Cable, scene: Scene | None = None) -> list[Slip]:
    """Of a cable that no material could be like, or that is no length between grippers, and of its scene."""
    found = []
    low, high = LENGTHS
    if not low <= cable.length <= high:
        found.append(_slip(f"length = {cable.length:g} m is no length between two grippers", "in mm?"))
    outer, inner = cable.diameter, cable.inner_diameter
    area = 0.25 * math.pi * (outer**2 - inner**2)
    if area > 0.0 and cable.linear_density > 0.0:
        density = cable.linear_density / area
        if not DENSITIES[0] <= density <= DENSITIES[1]:
            text = f"linear_density and diameter make {density:.3g} kg/m^3, water has 1000"
            found.append(_slip(text, "linear_density in g/m, or diameter in mm or as a radius?"))
    second_moment = math.pi / 64.0 * (outer**4 - inner**4)
    if second_moment > 0.0:
        modulus = cable.mean_bending_stiffness / second_moment
        if modulus > STIFFEST:
            text = f"bending_stiffness and diameter make a modulus of {modulus:.3g} Pa, steel has 2.1e11: is it a pipe?"
            found.append(_slip(text, "bending_stiffness in N mm^2 (1e-6 N m^2), or diameter in another unit?"))
    return [*found, *(slips_in(scene) if scene is not None else ())]


def slips_in(scene: Scene) -> list[Slip]:
    """Of a scene with obstacles far from any cell."""
    found = []
    for obstacle in scene.obstacles:
        far = float(abs(obstacle.pose.position).max())
        if far > LENGTHS[1]:
            found.append(_slip(f"obstacle {obstacle.name!r} lies {far:g} m away", "its position in mm?"))
    return found


def _slip(found: str, guess: str) -> Slip:
    return Slip(found, f"{CHECK_UNITS} Was it given {guess}")
