"""How fast the ends of a cable move."""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import get4, qconj, qlog, qmul


@kernel
def follow(before: Array, now: Array, held: bool, seconds: float, twists: Array) -> None:
    """Fills twists (12,) with how an end frame moved from `before` to `now` (14,), and takes `now` over into `before`.

    Frames (7,) of start and end: position, quaternion; turns are taken the short way round. twists: mean velocity [m/s]
    and angular velocity [rad/s] of the start, then of the end, world axes; zero for an end that is not held, NaN where
    `seconds` is NaN or a frame was not known.
    """
    a, b = before.reshape(2, 7), now.reshape(2, 7)
    for k in range(2):
        turn = qmul(get4(b[:, 3:], k), qconj(get4(a[:, 3:], k)))
        if turn[3] < 0.0:
            turn = (-turn[0], -turn[1], -turn[2], -turn[3])
        w = qlog(turn)
        for i in range(3):
            twists[6 * k + i] = (b[k, i] - a[k, i]) / seconds
            twists[6 * k + 3 + i] = w[i] / seconds
    for i in range(14):
        before[i] = now[i]
    if not held:
        before[7:] = math.nan
        twists[6:] = 0.0
    if math.isnan(twists[0] + twists[3] + twists[6] + twists[9]):
        twists[:] = math.nan
