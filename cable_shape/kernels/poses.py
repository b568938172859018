"""Poses as arrays (7,): position [m] and unit quaternion x, y, z, w."""

import math

import numpy as np

from cable_shape.kernels._jit import kernel


@kernel
def compose(a, b):
    """(7,): pose `a` followed by pose `b`, given in a's frame."""
    out = np.empty(7)
    x, y, z, w = a[3], a[4], a[5], a[6]
    # v + w t + u x t with t = 2 u x v
    tx = 2.0 * (y * b[2] - z * b[1])
    ty = 2.0 * (z * b[0] - x * b[2])
    tz = 2.0 * (x * b[1] - y * b[0])
    out[0] = a[0] + b[0] + w * tx + y * tz - z * ty
    out[1] = a[1] + b[1] + w * ty + z * tx - x * tz
    out[2] = a[2] + b[2] + w * tz + x * ty - y * tx
    out[3] = w * b[3] + x * b[6] + y * b[5] - z * b[4]
    out[4] = w * b[4] - x * b[5] + y * b[6] + z * b[3]
    out[5] = w * b[5] + x * b[4] - y * b[3] + z * b[6]
    out[6] = w * b[6] - x * b[3] - y * b[4] - z * b[5]
    norm = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2 + out[6] ** 2)
    for i in range(3, 7):
        out[i] /= norm
    return out
