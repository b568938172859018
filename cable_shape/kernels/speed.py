"""How fast poses move."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import get4, qconj, qlog, qmul

Array = Any


@kernel
def twists(before: Array, now: Array, seconds: float) -> Array:
    """(6 k,): mean velocity [m/s] and angular velocity [rad/s], world axes, between two tables (k, 7) of poses.

    Turns are taken the short way round.
    """
    out = np.empty(6 * now.shape[0])
    for k in range(now.shape[0]):
        turn = qmul(get4(now[:, 3:], k), qconj(get4(before[:, 3:], k)))
        if turn[3] < 0.0:
            turn = (-turn[0], -turn[1], -turn[2], -turn[3])
        w = qlog(turn)
        for i in range(3):
            out[6 * k + i] = (now[k, i] - before[k, i]) / seconds
            out[6 * k + 3 + i] = w[i] / seconds
    return out
