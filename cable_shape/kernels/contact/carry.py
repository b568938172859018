"""The last solution of a cable in contact on another mesh: :func:`carry`."""

from __future__ import annotations

import math

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import BARE, HELD, PRESS, RUB
from cable_shape.kernels.rod_algebra import get4


@kernel
def carry(
    old_nodes: Array, old_q: Array, old_near: Array, old_on: Array, nodes: Array, q: Array, near: Array, on: Array,
    apart: float, new: Array,
) -> None:  # fmt: skip
    """Fills q (n, 4), near and on (n, ..) at `nodes` (n,) [m] from those at `old_nodes`; both ascend.

    Quaternions are linear between nodes. A node nearer than `apart` [m] to an old one is that one, with its contacts;
    `new` (n,), bool, are the others. What contacts pressed at nodes that are no more goes to those beside them.
    """
    last = old_nodes.shape[0] - 1
    signs = np.ones(last + 1)
    for k in range(last):
        a, b = get4(old_q, k), get4(old_q, k + 1)
        along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
        signs[k + 1] = -signs[k] if along < 0.0 else signs[k]
    j = 0
    for k in range(nodes.shape[0]):
        while j < last - 1 and old_nodes[j + 1] <= nodes[k]:
            j += 1
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = between(old_nodes, old_q, signs, j, nodes[k])
        i = j + 1 if abs(old_nodes[j + 1] - nodes[k]) < abs(old_nodes[j] - nodes[k]) else j
        new[k] = not abs(old_nodes[i] - nodes[k]) < apart
        if not new[k]:
            near[k, :] = old_near[i, :]
            on[k, :] = old_on[i, :]
    k = 1
    for j in range(last + 1):
        while k < nodes.shape[0] - 1 and nodes[k] < old_nodes[j]:
            k += 1
        if old_on[j, 0] != BARE and old_nodes[j] != nodes[k] and old_nodes[j] != nodes[k - 1]:
            part = (old_nodes[j] - nodes[k - 1]) / (nodes[k] - nodes[k - 1])
            hand_over(old_near, old_on, j, near, on, k - 1, 1.0 - part)
            hand_over(old_near, old_on, j, near, on, k, part)


@kernel
def between(s: Array, q: Array, signs: Array, j: int, at: float) -> tuple[float, float, float, float]:
    """The unit quaternion at an arc length, linear between nodes j and j + 1, of these signs."""
    a, b = get4(q, j), get4(q, j + 1)
    x = min(max(at - s[j], 0.0), s[j + 1] - s[j]) / (s[j + 1] - s[j])
    u, v = signs[j] * (1.0 - x), signs[j + 1] * x
    out = (u * a[0] + v * b[0], u * a[1] + v * b[1], u * a[2] + v * b[2], u * a[3] + v * b[3])
    size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3])
    if size == 0.0:
        return out
    return out[0] / size, out[1] / size, out[2] / size, out[3] / size


@kernel
def hand_over(old_near: Array, old_on: Array, j: int, near: Array, on: Array, k: int, part: float) -> None:
    """Gives a part of what a contact pressed at the old node j to node k, if it is one with the same body."""
    if on[k, 0] == old_on[j, 0]:
        near[k, PRESS] += part * old_near[j, PRESS]
        for first in (RUB, HELD):
            for i in range(first, first + 3):
                near[k, i] += part * old_near[j, i]
