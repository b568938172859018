"""The most likely shape for what was expected of it and the points that were seen: :func:`fitted`."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.distance import cloud
from cable_shape.kernels.distance.cloud import MISS, PLACE, SUMS, WEIGHT
from cable_shape.shape import Status
from cable_shape.tracking.rod import Ends, Rod

if TYPE_CHECKING:
    from cable_shape.tracking.harness_rod import HarnessRod

#: Rounds of a fit at most, shares of its step that are tried.
ROUNDS, SHARES = 12, (1.0, 0.5, 0.2, 0.05)
#: From round to round lines are so many times as sharp.
_SHARPER = 3.0
#: [1], of the noise: a line that is no softer by more is sharp, and one that moves by less is still.
_SHARP, _STILL = 1.0, 0.3
#: Of the cost, by which a step may make it worse: rounding.
_WORSE = 1e-6


@final
@dataclass(frozen=True, slots=True)
class Noise:
    """What points and model are off by.

    points [m]: standard deviation of a point in each direction across the cable; model [m]: of the centreline of a rod
    with the right numbers, on each piece between two points of the shape; outliers: share of points that are of
    something else; volume [m^3] over which these are spread.
    """

    points: float
    model: float
    outliers: float
    volume: float

    @property
    def variance(self) -> float:
        """[m^2], of a point about the line."""
        return self.points**2 + self.model**2

    @property
    def outside(self) -> float:
        """[1/m^3], density of what is not of the cable, in terms of that of the cable's points."""
        return self.outliers / ((1.0 - self.outliers) * self.volume)


class Fit(NamedTuple):
    """What was found.

    z (k,), covariance (k, k); shape, with its line (n, 3) and moves (n, 3, k); told (m,): how likely each point is of
    the cable; residual: sum of squares of normalised misses of so many pieces; shift: square of the normalised change
    of z; directions: how many numbers the points tell.
    """

    z: Array
    covariance: Array
    shape: Any
    line: Array
    moves: Array
    told: Array
    residual: float
    pieces: float
    shift: float
    directions: float
    cost: float


def fitted(
    rod: Rod | HarnessRod, points: Array, ends: Ends, mean: Array, covariance: Array, noise: Noise,
    pulled: tuple[bool, bool] = (False, False),
) -> Fit | None:  # fmt: skip
    """Begins at the mean (k,) with its covariance (k, k); None where the rod has no usable shape there.

    Rounds of expectation (:func:`cable_shape.kernels.distance.cloud.assign`) and maximisation (Gauss and Newton's step
    on the rod's own derivatives, cut until the points become more likely), about lines that are the sharper the nearer
    they have come.
    """
    shape: Any = rod.solve(mean, ends)
    if not shape.status:
        return None
    line, moves, unit = rod.line(shape), rod.moves(), np.eye(len(mean))
    y = np.zeros(len(mean))  # z = mean + covariance y: numbers without a spread stay
    seen = _Seen(points, rod.length, rod.gaps, noise, pulled)
    soft = seen.softness(line, moves, covariance)
    for _ in range(ROUNDS):
        variance = noise.variance + soft**2
        A, b, cost = seen.equations(line, moves, variance)
        cost += float(y @ covariance @ y)
        to = np.linalg.solve(unit + A @ covariance, b + A @ (covariance @ y))
        if soft > 0.0:
            ahead = line + moves @ (covariance @ (to - y))
            A, b, _ = seen.equations(ahead, moves, variance)
            to = np.linalg.solve(unit + A @ covariance, b + A @ (covariance @ to))
        moved = math.inf
        for share in SHARES:
            trial = y + share * (to - y)
            there: Any = rod.solve(mean + covariance @ trial, ends)
            if there.status and there.status is not Status.SNAPPED:
                moved_to = rod.line(there)
                better = seen.cost(moved_to, variance) + float(trial @ covariance @ trial)
                if better <= cost + _WORSE:
                    moved = float(np.abs(moved_to - line).max())
                    y, shape, line = trial, there, moved_to
                    if moved >= _STILL * math.sqrt(noise.variance):
                        moves = rod.moves()
                    break
            rod.trail.go_back()
        sharp = soft < _SHARP * math.sqrt(noise.variance)
        if sharp and (moved == math.inf or moved < _STILL * math.sqrt(noise.variance)):
            break
        soft = 0.0 if sharp else soft / _SHARPER
    A, _, cost = seen.equations(line, moves, noise.variance)
    now = np.linalg.solve(unit + covariance @ A, covariance)
    return Fit(
        mean + covariance @ y, 0.5 * (now + now.T), shape, line, moves, seen.told, seen.residual, seen.pieces,
        float(y @ covariance @ y), float(np.trace(A @ now)), cost,
    )  # fmt: skip


class _Seen:
    """The points, and the normal equations of one assignment."""

    def __init__(self, points: Array, length: float, gaps: Array, noise: Noise, pulled: tuple[bool, bool]) -> None:
        self._points, self._length, self._noise, self._pulled = points, length, noise, pulled
        self._pieces = 1.0 - gaps  # 0: none
        self.told = np.zeros(len(points))
        self.residual = self.pieces = 0.0
        self._last: deque[tuple[Array, Array, Array, Array, float]] = deque(maxlen=2)  # a trial, and what it is beside

    def _tangents(self, line: Array) -> Array:
        """(n - 1, 3), of the pieces; anything where there is none."""
        steps = line[1:] - line[:-1]
        steps[self._pieces == 0.0] = (1.0, 0.0, 0.0)
        return np.asarray(steps / np.linalg.norm(steps, axis=1)[:, None])

    def _assign(self, line: Array, spread: Array) -> tuple[Array, float]:
        """Sums over the pieces of a line, which stays as it is, and the logarithm of the likelihood; fills told."""
        for there, wide, sums, told, likely in self._last:
            if there is line and np.array_equal(wide, spread):
                self.told = told
                return sums, likely
        sums, self.told = np.empty((len(line) + 1, SUMS)), np.empty(len(self._points))
        outside = self._noise.outside
        likely = float(cloud.assign(line, spread, self._points, self._length, outside, self._pulled, sums, self.told))
        self._last.append((line, spread, sums, self.told, likely))
        return sums, likely

    def softness(self, line: Array, moves: Array, covariance: Array) -> float:
        """[m]: how far the line is expected to be off where points are."""
        tangents = self._tangents(line)
        middle = 0.5 * (moves[1:] + moves[:-1])
        across = middle - tangents[:, :, None] * np.einsum("ni,nik->nk", tangents, middle)[:, None, :]
        known = 0.5 * np.einsum("nik,kl,nil->n", across, covariance, across, optimize=True)
        sums, _ = self._assign(line, self._pieces * (self._noise.variance + known))
        w = sums[:-2, WEIGHT]
        return math.sqrt(float(w @ known) / float(w.sum())) if w.sum() > 0.0 else 0.0

    def cost(self, line: Array, variance: float) -> float:
        """Minus twice the logarithm of the likelihood."""
        return -2.0 * self._assign(line, self._pieces * variance)[1]

    def equations(self, line: Array, moves: Array, variance: float) -> tuple[Array, Array, float]:
        """(k, k), (k,): information of the points, and what pulls; and the cost."""
        n = len(line)
        tangents = self._tangents(line)
        sums, likely = self._assign(line, self._pieces * variance)
        weights = sums[:, WEIGHT]
        some = weights > 1e-9
        w, rows = weights[some], np.flatnonzero(some)
        i = np.where(rows == n - 1, 0, np.where(rows == n, n - 2, rows))
        t = (sums[some, PLACE] / w)[:, None, None]
        way = (1.0 - t) * moves[i] + t * moves[i + 1]
        inner = (rows < n - 1).astype(np.float64)[:, None]
        along = np.einsum("ni,nik->nk", tangents[i], way) * inner
        way = way - tangents[i][:, :, None] * along[:, None, :]
        miss = sums[some, MISS : MISS + 3] / w[:, None]
        model = self._noise.model**2
        told = w / (variance - model + w * model)  # information of each piece
        flat = (np.sqrt(told)[:, None, None] * way).reshape(-1, moves.shape[2])
        self.residual = float((told * (miss * miss).sum(axis=1)).sum())
        self.pieces = float(np.minimum(w, 1.0).sum())
        return flat.T @ flat, flat.T @ (np.sqrt(told)[:, None] * miss).ravel(), -2.0 * likely
