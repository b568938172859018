"""Which bodies a point of a cable is near, where another cable presses it on them."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import GRIP_EXCLUSION, MARGIN
from cable_shape.kernels.distance.surface import touch
from cable_shape.kernels.rod_algebra import get3, put3, put9

GROUND = 13  # gap | outward normal 3 | second derivative of the gap 9


@kernel
def grounds(
    point: Array, arc: float, length: float, bodies: Array, frames: Array, triangles: Array, nodes: Array,
    radius: float, pressed: Array, sides: Array, stack: Array, out: Array,
) -> None:  # fmt: skip
    """Fills out (m, GROUND) for the cable's point (3,) at `arc` [m]; the gap [m] to bodies that are not near is inf.

    pressed (m,): not 0 for bodies that it is pressed on, with the normals `sides` (m, 3) before.
    """
    p = (point[0], point[1], point[2])
    for b in range(bodies.shape[0]):
        out[b, 0] = math.inf
        exclusion = GRIP_EXCLUSION if bodies[b, 12] != 0.0 else 0.0
        if arc < exclusion or arc > length - exclusion:
            continue
        held = pressed[b] != 0.0
        d, n, H = touch(bodies[b], frames[b], triangles, nodes, p, get3(sides, b), True, stack)
        if d - radius < MARGIN or held:
            out[b, 0] = d - radius
            put3(out, b, 1, n)
            put9(out, b, 4, H)
