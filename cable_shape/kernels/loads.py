"""Where a shape is loaded most."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel


@kernel
def most_loaded(quaternions: Array, curvature: Array, force: Array) -> tuple[int, float, int, float, int, float]:
    """Index and value of the greatest tension [N], bending curvature and |twist rate| [1/m] of n points."""
    i = j = k = 0
    tension, bending, twist = -math.inf, -math.inf, -math.inf
    for m in range(quaternions.shape[0]):
        x, y, z, w = quaternions[m]
        along = (
            2.0 * (x * z + w * y) * force[m, 0]
            + 2.0 * (y * z - w * x) * force[m, 1]
            + (1.0 - 2.0 * (x * x + y * y)) * force[m, 2]
        )
        if along > tension:
            i, tension = m, along
        bent = math.hypot(curvature[m, 0], curvature[m, 1])
        if bent > bending:
            j, bending = m, bent
        twisted = abs(curvature[m, 2])
        if twisted > twist:
            k, twist = m, twisted
    return i, tension, j, bending, k, twist
