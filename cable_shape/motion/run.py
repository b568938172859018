"""What many steps at once have led to: :class:`Run`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array


class Run(NamedTuple):
    """The nodes of a cable after each of T steps.

    s (n,) [m]: their arc length. places (T, n, 3) [m], tangents (T, n, 3) and velocities (T, n, 3) [m/s], world.
    lost: how many steps could not be taken; there the cable stays as it was.
    """

    s: Array
    places: Array
    tangents: Array
    velocities: Array
    lost: int

    def at(self, arc_length: Array) -> Array:
        """(T, m, 3) [m], of the cubic between the nodes at arc lengths (m,) [m]; beyond the ends: straight on."""
        x = np.asarray(arc_length, dtype=np.float64)
        inside = np.clip(x, 0.0, self.s[-1])
        e = np.clip(np.searchsorted(self.s, inside, "right") - 1, 0, len(self.s) - 2)
        h = self.s[e + 1] - self.s[e]
        t = (inside - self.s[e]) / h
        u = 1.0 - t
        places, ways = np.zeros((len(self.s), len(x))), np.zeros((len(self.s), len(x)))
        k = np.arange(len(x))
        places[e, k], places[e + 1, k] = u * u * (1.0 + 2.0 * t), t * t * (1.0 + 2.0 * u)
        ways[e, k], ways[e + 1, k] = h * t * u * u, -h * t * t * u
        ways[e, k] += np.minimum(x, 0.0)
        ways[e + 1, k] += np.maximum(x - self.s[-1], 0.0)
        return np.asarray(np.einsum("nm,tnc->tmc", places, self.places) + np.einsum("nm,tnc->tmc", ways, self.tangents))
