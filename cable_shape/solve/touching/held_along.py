"""Friction on the road: what holds the nodes of a cable that moves against drag along the bodies that push them.

The law is that of `kernels.contact.friction`, t = t' - k d and no longer than mu p, with d from where the point was in
the last solution; steps in time are taken again until p is the push after them. In terms of a place c, t = k (c - x)
along the surface: `kernels.network.motion.rubbing`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact.friction import FAINT, FIRMNESS, LEAST
from cable_shape.kernels.contact.near import ARC, FIRM, HELD, MATE, WAS
from cable_shape.kernels.network import motion

_FLAT = 1e-6  # sine of the angle between two normals, from which on there is an edge


class HeldAlong:
    """What nodes remember of the bodies that they are pressed on.

    near (n, NEAR): rows of the last solution; s (n,) [m]; rough (n,), (m,): coefficients of cables and of bodies; least
    [N]: weight + EI / L^2 of the cable; length [m].
    """

    def __init__(self, near: Array, s: Array, rough: Array, of_bodies: Array, least: float, length: float) -> None:
        self.mate = near[:, MATE].astype(int) - 1  # -1: none
        self.was, self.held = near[:, WAS : WAS + 3].copy(), near[:, HELD : HELD + 3].copy()
        self.along, self.firm = s - near[:, ARC], near[:, FIRM].copy()
        self._limit, self._off, self._part = np.full(s.size, -1.0), np.zeros(s.size), 1.0
        self.rough, self.of_bodies, self.faint, self.length = rough, of_bodies, FAINT * least, length

    def tell(self, out: Array, body: Array, push: Array, normal: Array, frames: Array, tangents: Array) -> None:
        """Fills `Motion.rough` (n, ROUGH) for nodes pressed by two bodies (n, 2), `push` [N] and `normal` (n, 2, 3).

        The first is the one that was touched before, if it pushes. frames (m, 4, 3): of the bodies; tangents (n, 3).
        """
        out[:] = 0.0
        k = np.flatnonzero((self.mate >= 0) & (push[:, 0] > 0.0) & (body[:, 0] == self.mate))
        if not k.size:
            return
        b, n, m, second = self.mate[k], normal[k, 0], normal[k, 1], push[k, 1] > 0.0
        limit = self._limit[k] = np.where(self._limit[k] < 0.0, self._allowed(k, body, push), self._limit[k])
        firm = np.maximum(self.firm[k], np.maximum(limit, self.faint) / (FIRMNESS * self.length))
        axes, origin = frames[b, :3], frames[b, 3]
        was = origin + np.einsum("ki,kij->kj", self.was[k], axes) + self.along[k, None] * tangents[k]
        kept = np.einsum("ki,kij->kj", self.held[k], axes)
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

    def _allowed(self, k: Any, body: Array, push: Array) -> Array:
        """[N], mu p of nodes k, see `tell`; of two bodies the sum."""
        rough, bodies = self.rough[k, None], np.maximum(body[k].astype(int), 0)
        return np.asarray((np.maximum(rough, self.of_bodies[bodies]) * np.maximum(push[k], 0.0)).sum(axis=1))

    def follow(self, body: Array, push: Array, *, first: bool) -> float:
        """Takes limits on towards those of pushes, as `kernels.contact.friction.limits` does.

        first: of a step in time. Returns by how much they were off at most, of the largest.
        """
        k = np.flatnonzero(self._limit >= 0.0)
        if not k.size:
            return 0.0
        allowed = self._allowed(k, body, push)
        off = allowed - self._limit[k]
        turned = off - self._off[k]
        bent = float(turned @ turned)
        if first:
            self._part = 1.0
        elif bent > 0.0:
            self._part = min(max(-self._part * float(self._off[k] @ turned) / bent, LEAST), 1.0)
        self._limit[k] += self._part * off
        self._off[k] = off
        return float(np.abs(off).max() / max(float(allowed.max()), self.faint))

    def forget(self) -> None:
        """The next limits are those of the pushes."""
        self._limit[:] = -1.0


def pulls(rough: Array, places: Array) -> Array:
    """(n, 3) [N], what rows of `Motion.rough` pull nodes at `places` by."""
    axis = rough[:, motion.AXIS : motion.AXIS + 3]
    way = rough[:, motion.CENTRE : motion.CENTRE + 3] - places
    along = (way * axis).sum(axis=1)[:, None] * axis
    pull = rough[:, motion.FIRM, None] * np.where(rough[:, motion.EDGE, None] != 0.0, along, way - along)
    size = np.linalg.norm(pull, axis=1, keepdims=True)
    shrink = np.minimum(1.0, rough[:, motion.LIMIT, None] / np.where(size > 0.0, size, 1.0))
    return np.asarray(pull * shrink)
