"""What many steps at once have led to: :class:`Run`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array

#: [s], the longest single step of what goes on by itself from one pose of its grips to the next, seen or commanded.
STEP = 0.0105
#: By how much nodes are moved for a difference, in derivatives of them.
_NEAR = 1e-6


class Derivative(NamedTuple):
    """How the nodes of a cable after each of T steps would be others, a unit of each of p numbers.

    Of places [m] (T, n, 3, p), tangents and velocities [m/s], and of the nodes' arc length (n, p), beside the nodes
    themselves as in :class:`Run`. Columns are those that `begin` was given names for, then those of `twists`.
    """

    s: Array
    at_places: Array
    at_tangents: Array
    places: Array
    tangents: Array
    velocities: Array
    longer: Array

    def at(self, arc_length: Array) -> Array:
        """(T, m, 3, p), of :meth:`Run.at` at fixed arc lengths (m,) [m]."""
        x = np.asarray(arc_length, dtype=np.float64)
        along, ways = weights(self.s, x)
        out = np.einsum("mn,tncp->tmcp", along, self.places) + np.einsum("mn,tncp->tmcp", ways, self.tangents)
        for p in np.flatnonzero(self.longer.any(axis=0)):
            step = _NEAR * self.longer[:, p]
            above, below = weights(self.s + step, x), weights(self.s - step, x)
            for i, nodes in enumerate((self.at_places, self.at_tangents)):
                out[..., p] += np.einsum("mn,tnc->tmc", (above[i] - below[i]) / (2.0 * _NEAR), nodes)
        return np.asarray(out)


class Run(NamedTuple):
    """The nodes of a cable after each of T steps.

    s (n,) [m]: their arc length. places (T, n, 3) [m], tangents (T, n, 3) and velocities (T, n, 3) [m/s], world.
    lost: how many steps could not be taken; there the cable stays as it was.
    derivative: where derivatives were asked for.
    """

    s: Array
    places: Array
    tangents: Array
    velocities: Array
    lost: int
    derivative: Derivative | None = None

    def after(self, steps: list[int]) -> Run:
        """The same after these steps alone, counted from 0, without a derivative."""
        return self._replace(
            places=self.places[steps], tangents=self.tangents[steps], velocities=self.velocities[steps], derivative=None
        )

    def at(self, arc_length: Array) -> Array:
        """(T, m, 3) [m], of the cubic between the nodes at arc lengths (m,) [m]; beyond the ends: straight on."""
        places, ways = weights(self.s, np.asarray(arc_length, dtype=np.float64))
        return np.asarray(np.einsum("mn,tnc->tmc", places, self.places) + np.einsum("mn,tnc->tmc", ways, self.tangents))


def joined(runs: Sequence[Run]) -> Run:
    """Runs of one cable, each of which goes on from the one before, as one, without a derivative."""
    return Run(
        runs[0].s,
        np.concatenate([run.places for run in runs]),
        np.concatenate([run.tangents for run in runs]),
        np.concatenate([run.velocities for run in runs]),
        sum(run.lost for run in runs),
    )


def weights(s: Array, x: Array) -> tuple[Array, Array]:
    """(m, n) each: of the places and tangents of nodes at s (n,) [m] in the cubic between them at x (m,) [m]."""
    inside = np.clip(x, s[0], s[-1])
    e = np.clip(np.searchsorted(s, inside, "right") - 1, 0, len(s) - 2)
    h = s[e + 1] - s[e]
    t = (inside - s[e]) / h
    u = 1.0 - t
    places, ways = np.zeros((len(x), len(s))), np.zeros((len(x), len(s)))
    k = np.arange(len(x))
    places[k, e], places[k, e + 1] = u * u * (1.0 + 2.0 * t), t * t * (1.0 + 2.0 * u)
    ways[k, e], ways[k, e + 1] = h * t * u * u, -h * t * t * u
    ways[k, e] += np.minimum(x - s[0], 0.0)
    ways[k, e + 1] += np.maximum(x - s[-1], 0.0)
    return places, ways
