"""Friction on the road: what holds the nodes of a cable that moves against drag along the bodies that push them.

The law is that of `kernels.contact.friction`, t = t' - k d and no longer than mu p, with d from where the point was in
the last solution; steps in time are taken again until p is the push after them. In terms of a place c, t = k (c - x)
along the surface: `kernels.network.motion.rubbing`.
"""

from __future__ import annotations

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact.friction import FAINT, FIRMNESS, forget_limits, limits
from cable_shape.kernels.contact.near import (
    ARC,
    BARE,
    FIRM,
    HELD,
    LIMIT,
    MATE,
    ON,
    PRESS,
    SECOND,
    SECOND_PRESS,
    WAS,
)
from cable_shape.kernels.network import motion

_FLAT = 1e-6  # sine of the angle between two normals, from which on there is an edge


class HeldAlong:
    """What nodes remember of the bodies that they are pressed on.

    near (n, NEAR): rows of the last solution; s (n,) [m]; rough (n,), (m,): coefficients of cables and of bodies; least
    [N]: weight + EI / L^2 of the cable; length [m].
    """

    def __init__(self, near: Array, s: Array, rough: Array, of_bodies: Array, least: float, length: float) -> None:
        self.near, self.on = near.copy(), np.full((s.size, ON), BARE)
        self.mate = near[:, MATE].astype(int) - 1  # -1: none
        self.along, self._part = s - near[:, ARC], 1.0
        self.rough, self.of_bodies, self.faint, self.length = rough, of_bodies, FAINT * least, length

    def begin(self, body: Array, push: Array) -> None:
        """Begins a step in time, limits those of pushes [N] by bodies (n, 2), see `tell`."""
        self.on[:, 0] = np.where(self._press(body, push), self.mate, BARE)
        forget_limits(self.near)
        self._part, _, _ = limits(self.rough, self.of_bodies, self.near, self.on, 1.0)

    def _press(self, body: Array, push: Array) -> Array:
        """Tells the pushes now; (n,), whether it is still the body touched before that pushes a node."""
        pressed = (self.mate >= 0) & (push[:, 0] > 0.0) & (body[:, 0] == self.mate)
        self.on[:, SECOND] = np.where(pressed & (push[:, 1] > 0.0), body[:, 1], BARE)
        self.near[:, PRESS] = np.where(pressed, push[:, 0], 0.0)
        self.near[:, SECOND_PRESS] = push[:, 1]
        return np.asarray(pressed)

    def tell(self, out: Array, push: Array, normal: Array, frames: Array, tangents: Array) -> None:
        """Fills `Motion.rough` (n, ROUGH) for nodes pressed by two bodies, `push` (n, 2) [N] and `normal` (n, 2, 3).

        The first is the one that was touched before, if it pushes; all as when the step began. frames (m, 4, 3): of
        the bodies; tangents (n, 3).
        """
        out[:] = 0.0
        k = np.flatnonzero(self.on[:, 0] != BARE)
        if not k.size:
            return
        b, n, m, second = self.mate[k], normal[k, 0], normal[k, 1], push[k, 1] > 0.0
        limit, was, held = self.near[k, LIMIT], self.near[k, WAS : WAS + 3], self.near[k, HELD : HELD + 3]
        firm = np.maximum(self.near[k, FIRM], np.maximum(limit, self.faint) / (FIRMNESS * self.length))
        axes, origin = frames[b, :3], frames[b, 3]
        was = origin + np.einsum("ki,kij->kj", was, axes) + self.along[k, None] * tangents[k]
        kept = np.einsum("ki,kij->kj", held, axes)
        edge = np.cross(n, m)
        sine = np.linalg.norm(edge, axis=1)
        second &= sine > _FLAT
        axis = np.where(second[:, None], edge / np.maximum(sine, _FLAT)[:, None], n)
        on_axis = (kept * axis).sum(axis=1)[:, None] * axis
        turned = np.where(second[:, None], on_axis, kept - on_axis)
        size = np.linalg.norm(turned, axis=1, keepdims=True)
        whole = np.linalg.norm(kept, axis=1, keepdims=True)
        kept = np.where(size > 0.0, turned * whole / np.where(size > 0.0, size, 1.0), 0.0)
        out[k, motion.FIRM], out[k, motion.LIMIT] = np.where(limit > 0.0, firm, 0.0), limit
        out[k, motion.CENTRE : motion.CENTRE + 3] = was + kept / firm[:, None]
        out[k, motion.AXIS : motion.AXIS + 3], out[k, motion.EDGE] = axis, second

    def follow(self, body: Array, push: Array) -> float:
        """Takes limits on towards those of pushes; returns by how much they were off at most, of the largest."""
        self._press(body, push)
        self._part, left, largest = limits(self.rough, self.of_bodies, self.near, self.on, self._part)
        return float(left / max(largest, self.faint))


def pulls(rough: Array, places: Array) -> Array:
    """(n, 3) [N], what rows of `Motion.rough` pull nodes at `places` by."""
    axis = rough[:, motion.AXIS : motion.AXIS + 3]
    way = rough[:, motion.CENTRE : motion.CENTRE + 3] - places
    along = (way * axis).sum(axis=1)[:, None] * axis
    pull = rough[:, motion.FIRM, None] * np.where(rough[:, motion.EDGE, None] != 0.0, along, way - along)
    size = np.linalg.norm(pull, axis=1, keepdims=True)
    shrink = np.minimum(1.0, rough[:, motion.LIMIT, None] / np.where(size > 0.0, size, 1.0))
    return np.asarray(pull * shrink)
