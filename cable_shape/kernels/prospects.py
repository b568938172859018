"""What a look at a cable's ends tells of the closed forms between them, before any is solved for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.catenary import uniform
from cable_shape.kernels.rod_algebra import scale, subtract
from cable_shape.kernels.rod_guess import angle_axis, norm, tangent

Array = Any


@kernel
def prospects(
    near: Array, far: Array, load: Array, length: float, bend: float, held0: bool, held1: bool, out: Array
) -> bool:  # fmt: skip
    """What the catenary for the mean load tells of closed forms between two ends (7,); False if there is none.

    out: 0 how far the bent ends, which it lacks, move it [m]: 2 l sin(theta / 2), l = sqrt(EI / |n|); 1 the largest
    theta [rad], by which its tangent misses a held grip; 2 how much the tensions at its ends differ, of the larger; 3
    the thinner boundary layer [m].
    """
    force = np.empty(3)
    if not uniform(far[:3] - near[:3], load, length, force):
        return False
    n0 = (force[0], force[1], force[2])
    n1 = subtract(n0, scale(length, (load[0], load[1], load[2])))
    size0, size1 = norm(n0), norm(n1)
    least = 1e-300
    a0, _ = angle_axis(scale(1.0 / max(size0, least), n0), tangent((near[3], near[4], near[5], near[6])))
    a1, _ = angle_axis(scale(1.0 / max(size1, least), n1), tangent((far[3], far[4], far[5], far[6])))
    a0, a1 = a0 if held0 else 0.0, a1 if held1 else 0.0
    shift0 = math.sqrt(bend / max(size0, least)) * math.sin(0.5 * a0)
    shift1 = math.sqrt(bend / max(size1, least)) * math.sin(0.5 * a1)
    out[0], out[1] = 2.0 * max(shift0, shift1), max(a0, a1)
    out[2] = abs(size0 - size1) / max(size0, size1, least)
    out[3] = math.sqrt(bend / max(size0, size1, least))
    return True
