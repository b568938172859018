"""Stress in a round or tubular section: :func:`stress_of`, from force and moment to the worst fibre.

The section of :class:`~cable_shape.cable.cable.Cable` (`diameter`, `inner_diameter`) is taken as of one material that
carries all loads; of a cable made of strands and sheath the stress is nominal, comparable only with a limit found in
the same way. Longitudinal, torsional and transverse shear stress are combined fibre by fibre, see
:mod:`cable_shape.kernels.safety.stress`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.kernels.safety import stress as kernels
from cable_shape.shape import CableShape


@final
@dataclass(frozen=True, slots=True)
class Stress:
    """Stress along one shape.

    von_mises : (n,) [Pa], of the worst fibre of each section.
    safety_factor : allowable_stress / the greatest of them; infinite without stress, NaN without an allowable one.
    """

    von_mises: Array
    safety_factor: float

    @property
    def worst(self) -> int:
        """Index of the most stressed section."""
        return int(self.von_mises.argmax())


def stress_of(cable: Cable, shape: CableShape) -> Stress:
    """Von Mises stress and safety factor of a shape.

    With N the axial force, V the shear force, M the bending moment, T the torsion, r the outer radius:
    sigma = N / A + M r / I cos(phi) and tau = T r / J + k V / A sin(psi - phi) at the fibre phi of the surface, with
    k = 4/3 for a solid section and 4/3 (D^2 + D d + d^2) / (D^2 + d^2) for a tube; the stress is the largest
    sqrt(sigma^2 + 3 tau^2).

    Raises
    ------
    ArgumentError
        If these are no Cable and no CableShape.
    """
    checks.instance("cable", cable, (Cable,), "Write Cable(length=..., ...).")
    checks.instance("shape", shape, (CableShape,), "Give what predict returns.")
    von_mises, own = np.empty(shape.points), np.empty(shape.points)
    for first, last, one in pieces_of(cable):
        kernels.von_mises(shape.buffer, shape.points, section_of(one), own)
        here = (shape.arc_length >= first) & (shape.arc_length <= last)
        von_mises[here] = own[here]
    greatest = float(von_mises.max())
    if cable.allowable_stress is None:
        return Stress(von_mises, math.nan)
    return Stress(von_mises, cable.allowable_stress / greatest if greatest > 0.0 else math.inf)


def section_of(cable: Cable) -> Array:
    """(5,): area [m^2], outer radius [m], I and J [m^4], and k = (largest transverse shear stress) A / V."""
    outer, inner = cable.diameter, cable.inner_diameter
    area = math.pi / 4.0 * (outer**2 - inner**2)
    inertia = math.pi / 64.0 * (outer**4 - inner**4)
    shear = 4.0 / 3.0 * (outer**2 + outer * inner + inner**2) / (outer**2 + inner**2)
    return np.array((area, 0.5 * outer, inertia, 2.0 * inertia, shear))
