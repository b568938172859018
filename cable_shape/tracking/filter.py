"""What is known of one cable from look to look: :class:`Filter`."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np
from scipy.spatial.transform import Rotation

from cable_shape.checks import Array
from cable_shape.pose import Grip
from cable_shape.tracking.fit import Fit, Noise, fitted
from cable_shape.tracking.rod import Ends, Rod, displaced
from cable_shape.tracking.swing import swung
from cable_shape.tracking.unknown import DRIFT, Unknown

if TYPE_CHECKING:
    from cable_shape.tracking.harness_rod import HarnessRod

#: Names of the ends that are known by the points alone.
Seen = frozenset[str]

#: [s]: looks further apart tell nothing of how the cable swings; over so long the grips' acceleration is taken.
APART, WINDOW = 0.25, 0.12
#: [s], over which the size of the swing is learnt; [m/s^2], least and most.
LEARNS, LEAST, MOST = 0.5, 0.05, 6.0
#: m/s, rad/s: how fast grips move that are only seen.
WALK, TURN = 0.3, 1.0


class Known(NamedTuple):
    """What is expected, or known, at a stamp [ns]: mean (k,), covariance (k, k), and the size of the swing [m/s^2]."""

    stamp: int | None
    mean: Array
    covariance: Array
    swing: float


@final
class Filter:
    """Mean and covariance of what is not known, carried on by the physics and drawn to points.

    Parameters
    ----------
    rod : Rod
    noise : Noise
    swing : float
        [m/s^2], spread of the cable's accelerations at first.
    """

    def __init__(self, rod: Rod | HarnessRod, noise: Noise, swing: float) -> None:
        self.rod, self.noise, self._first = rod, noise, swing
        self.unknown: Unknown = rod.unknown
        self.known: Known
        self._gives: Array
        self._answers: Array
        self._moved: deque[tuple[int, dict[str, Array]]] = deque(maxlen=32)
        self.reset()

    def reset(self) -> None:
        """Everything is as at first."""
        unknown = self.unknown
        self.rod.trail.reset()
        self.known = Known(None, np.zeros(unknown.size), unknown.covariance(self._first), self._first)
        self._gives, self._answers = np.empty(0), np.empty(0)
        self._loose: Array = np.empty(0, dtype=np.int64)  # places that vibrate
        self._moved.clear()

    def expected(self, stamp: int, seen: Seen) -> Known:
        """What is to be expected at a later stamp [ns]; seen: which grips are known by the points alone."""
        known, unknown = self.known, self.unknown
        if known.stamp is None:
            return known._replace(stamp=stamp)
        dt = 1e-9 * (stamp - known.stamp)
        keep = math.exp(-dt / DRIFT)
        change, added, shift = np.eye(unknown.size), np.zeros((unknown.size, unknown.size)), np.zeros(unknown.size)
        stays = unknown.stays
        change[stays, stays] *= keep
        added[stays, stays] = (1.0 - keep**2) * unknown.first[stays, stays]
        for end, own in unknown.grips.items():
            if end in seen:
                change[own, own] = np.eye(6)
                added[own, :] = added[:, own] = 0.0
                added[own, own] = np.diag(np.repeat(((WALK * dt) ** 2, (TURN * dt) ** 2), 3))
        if unknown.rows:
            own = unknown.moving
            if self._gives.size and dt <= APART:
                change[own, own], added[own, own], goal = swung(
                    dt, known.swing, self._gives, self._forced(seen), self._loose, unknown.masses
                )
                shift[own] = goal - change[own, own] @ goal
            else:
                change[own, own] = 0.0
                added[own, own] = unknown.covariance(known.swing)[own, own]
        covariance = change @ known.covariance @ change.T + added
        mean = change @ known.mean + shift
        return Known(stamp, mean, 0.5 * (covariance + covariance.T), known.swing)

    def fit(self, points: Array, ends: Ends, expected: Known, seen: Seen) -> Fit | None:
        """The most likely shape; None where the rod has none."""
        pulled = "start" in seen, "end" in seen
        return fitted(self.rod, points, ends, expected.mean, expected.covariance, self.noise, pulled)

    def take(self, found: Fit, ends: Ends, expected: Known, seen: Seen) -> Ends:
        """Makes what was found the last; returns the ends, those that are only seen where they were found."""
        unknown, before = self.unknown, self.known.stamp
        stamp = expected.stamp
        assert stamp is not None
        z, swing = found.z.copy(), expected.swing
        ends = self.held(ends, z, seen)
        for end, own in unknown.grips.items():
            if end in seen:
                z[own] = 0.0
        if unknown.rows:
            rows, at = unknown.rows, self.rod.at
            self._gives = -found.moves[at][:, :, unknown.swing].reshape(rows, 3, rows, 3)
            self._answers = found.moves[at][:, :, : unknown.material.start]
            self._loose = unknown.vibrate(ends)
            inner = (unknown.swing.start + 3 * self._loose[:, None] + np.arange(3)).ravel()
            size = float((z[inner] ** 2).mean() + np.diag(found.covariance)[inner].mean())
            passed = 0.0 if before is None else 1e-9 * (stamp - before)
            share = min(passed / LEARNS, 1.0)
            swing = min(max(math.sqrt((1.0 - share) * swing**2 + share * size), LEAST), MOST)
        frames = {name: end.cable_frame.array for name, end in ends.items() if isinstance(end, Grip)}
        self._moved.append((stamp, frames))
        self.known = Known(stamp, z, found.covariance, swing)
        return ends

    def held(self, ends: Ends, z: Array, seen: Seen) -> Ends:
        """The ends, those that are only seen where they are."""
        out = dict(ends)
        for name in seen:
            end = ends[name]
            if isinstance(end, Grip):
                out[name] = Grip(displaced(end, z[self.unknown.grips[name]]).cable_frame, end.kind)
        return out

    def _forced(self, seen: Seen) -> Array:
        """(rows, 3) [m/s^2]: how places accelerate with the grips, as told over the last looks; 0 of seen grips."""
        last = self._moved[-1]
        some = [one for one in self._moved if last[0] - one[0] <= 1e9 * WINDOW and one[1].keys() == last[1].keys()]
        twists = np.zeros(self.unknown.material.start)
        if len(some) >= 4:
            t = np.array([1e-9 * (stamp - last[0]) for stamp, _ in some])
            for end in last[1].keys() - seen:
                poses = np.array([frames[end] for _, frames in some])
                here = Rotation.from_quat(poses[-1, 3:]).inv()
                moved = here.apply(poses[:, :3] - poses[-1, :3])
                turned = (here * Rotation.from_quat(poses[:, 3:])).as_rotvec()
                bend = np.polynomial.polynomial.polyfit(t, np.hstack((moved, turned)), 2)[2]
                twists[self.unknown.grips[end]] = 2.0 * bend
        return np.asarray(self._answers @ twists)


def spread_of(moves: Array, covariance: Array, model: float) -> Array:
    """(n, 3, 3) [m^2], of places (n, 3, k) that move with the unknown (k, k), and by what the model is off [m]."""
    across = np.einsum("nik,kl,njl->nij", moves, covariance, moves, optimize=True)
    return np.asarray(across + model**2 * np.eye(3))
