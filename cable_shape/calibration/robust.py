"""Robust nonlinear least squares of points in space, and what the data say of the parameters.

Minimised is the sum over points of c^2/2 log(1 + (d / c sigma)^2), d the length of a point's miss (Cauchy's loss: a
stray point pulls the less the further it is off), plus 1/2 (p - p0)^T P (p - p0), P the precision of what was known
before. The scale sigma is that of the middle half of the misses. Levenberg and Marquardt's method, with the weights of
the present misses.

Misses jump where a shape goes over to another branch. A descent follows the branches on which it began; where it ends
all is predicted from nothing, and if that is another shape somewhere, the next descent begins there. The least loss of
what is predicted from nothing counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np

from cable_shape.checks import Array

#: c: with it 95 % of the efficiency of least squares is kept for normal noise.
TUNING = 2.385
#: Medians of the length of a normal vector of unit variance in one to three dimensions.
_MEDIANS: Array = np.array((math.nan, 0.6744897501960817, math.sqrt(2.0 * math.log(2.0)), 1.5381722544550522))
_MOST_ITERATIONS = 60
_MOST_DESCENTS = 5
#: A descent ends where another step would be below this fraction of the standard errors told, root mean square over all
#: directions, or where an iteration wins no more than such a step would.
_STEP = 0.1
#: The same where no step makes the loss less: shapes are no more exact.
_STUCK = 0.3
#: Steps with the same derivatives at most; all but the first win this part of what they promise.
_CHORDS, _PAYS = 5, 0.2
#: Shares of a step that are taken, least and most, and those that are as good as the whole.
_LEAST, _MOST, _NEAR = 0.1, 2.5, (0.7, 1.5)
#: Loss that another descent has to win, and change of a mean miss [1] that makes it worth a try.
_WORTH, _OTHER = 0.1, 1e-3
#: So many groups make their own scatter a better measure of the errors than that of single points.
FEWEST_GROUPS = 12
#: Relative eigenvalue of the scaled information matrix below which a combination of parameters is not seen at all.
_BLIND = 1e-9


@final
@dataclass(slots=True)
class Fit:
    """Where the fit ended.

    covariance (k, k): of the parameters; infinite on the diagonal where the data say nothing. scale [m]: of the misses.
    freedom: degrees of freedom behind the covariance. blind (b, k): unit combinations that the data do not see.
    misses (n, 3) [m]: of what is predicted from nothing; followed (n, 3) [m]: on the branches of the descent.
    """

    values: Array
    covariance: Array
    scale: float
    freedom: int
    iterations: int
    converged: bool
    misses: Array
    followed: Array
    weights: Array
    blind: Array
    clustered: bool


class _Place(NamedTuple):
    """Where a descent ended."""

    values: Array
    misses: Array
    converged: bool


class _Trial(NamedTuple):
    """Where a step leads, and how much less the loss is there."""

    values: Array
    misses: Array
    won: float


class _Scatter(NamedTuple):
    """Covariance (k, k) of the right-hand side of the normal equations, with what is known before."""

    matrix: Array
    freedom: float  # degrees behind it
    clustered: bool  # each direction by the scatter of groups


@final
class Robust:
    """One fit: `forward` gives misses, `derivative` their derivatives at (values, misses)."""

    def __init__(
        self,
        forward: Callable[[Array], Array],
        derivative: Callable[[Array, Array], Array],
        afresh: Callable[[Array], Array],
        freedom: Array,
        groups: Array,
        steps: Array,
        precision: Array,
    ) -> None:
        """forward(values): misses of shapes followed from those where the last derivative was taken; afresh(values):
        those of shapes predicted from nothing, from which `forward` goes on.

        freedom (n,): in how many directions, 1 to 3, a point may be off; an arc length that is not known takes one, and
        so does a plane in which all was seen; groups (n,): of each point; steps (k,); precision (k, k)."""
        self._forward, self._derivative, self._afresh = forward, derivative, afresh
        self._freedom = np.asarray(freedom, dtype=np.float64)
        self._medians = _MEDIANS[np.asarray(freedom, dtype=np.int64)]
        self._groups = groups
        self._most, self._precision = steps, precision
        self._iteration = 0

    def run(
        self, values: Array, proceed: Callable[[int, float], bool] | None = None, about: Array | None = None
    ) -> Fit:
        """From these values to the least loss; `proceed`, given iteration and scale [m], may end it before.

        about (k,): what was known before, default: where it begins.
        """
        about = values if about is None else about
        self._iteration = 0
        best: tuple[int, float] | None = None
        place, misses = _Place(values, self._afresh(values), False), None
        scale = math.nan
        for _ in range(_MOST_DESCENTS):
            fixed = None if best is None else scale  # else each descent would go on to where fewer points count
            there = self._descend(place.values, place.misses if misses is None else misses, about, proceed, fixed)
            misses = self._afresh(there.values)
            if np.isnan(misses[:, 0]).all():  # nothing is known of what is predicted from nothing there
                place, misses = (place, self._afresh(place.values)) if best else (there, there.misses)
                return self._finish(place._replace(converged=False), misses)
            scale = self.scale(misses) if best is None else scale
            lost = int(np.isnan(misses[:, 0]).sum())
            loss = lost, self._loss(misses, scale, there.values - about)
            if best is not None and not loss < (best[0], best[1] - _WORTH):
                misses = self._afresh(place.values)
                break
            best, place = loss, there
            if not there.converged or not _differ(misses, there.misses):
                break
        assert misses is not None
        return self._finish(place, misses)

    def _descend(
        self, values: Array, misses: Array, about: Array, proceed: Callable[[int, float], bool] | None,
        fixed: float | None,
    ) -> _Place:  # fmt: skip
        """From values, and their misses on the branches to follow, to the least loss on these branches.

        fixed: the scale [m]; None: that of the misses.
        """
        damping = 1e-4
        while self._iteration < _MOST_ITERATIONS:
            self._iteration += 1
            scale = self.scale(misses) if fixed is None else fixed
            if proceed is not None and not proceed(self._iteration, scale):
                break
            J = self._derivative(values, misses)
            won = 0.0
            for chord in range(_CHORDS):  # derivatives cost far more than misses: several steps with the same ones
                weights = _weights(misses, scale)
                A, g = self._normal(J, misses, weights, scale, values - about)
                spread = np.sqrt(np.maximum(np.diag(A), 1e-300))
                scaled = A / np.outer(spread, spread)
                scatter = self._scatter(J, misses, weights, scale).matrix
                left = _left(scatter, g)
                if left < _STEP:
                    break
                loss = self._loss(misses, scale, values - about)
                found = None
                while damping < 1e8:
                    step = _within(scaled + damping * np.eye(len(values)), g / spread, self._most * spread) / spread
                    promised = float(g @ step)
                    found = self._search(values, misses, step, promised, loss, scale, about)
                    if found is not None and chord and found.won < _PAYS * promised:
                        found = None
                    if found is not None or chord:
                        break
                    damping = max(10.0 * damping, 1e-3)
                if found is None:
                    break
                values, misses, won = found.values, found.misses, won + found.won
                damping = max(0.01 * damping, 1e-9)
                scale = self.scale(misses) if fixed is None else fixed
            if chord == 0 and left < _STEP:
                return _Place(values, misses, True)
            if chord == 0:
                return _Place(values, misses, left < _STUCK)
            if won < 0.5 * _STEP**2 * _noise(A, scatter):
                return _Place(values, misses, True)
        return _Place(values, misses, False)

    def _search(
        self, values: Array, misses: Array, step: Array, promised: float, loss: float, scale: float, about: Array
    ) -> _Trial | None:
        """The better of a step and of as much of it as a parabola through both losses asks for; None: both are worse.

        promised: by how much the loss falls along the whole step, to first order.
        """
        best, share = None, 1.0
        for _ in range(2):
            there = values + share * step
            trial = self._forward(there)
            lost = (np.isnan(trial[:, 0]) & ~np.isnan(misses[:, 0])).any()
            won = -math.inf if lost else loss - self._loss(trial, scale, there - about)
            if won >= (0.0 if best is None else best.won):
                best = _Trial(there, trial, won)
            bent = promised - won
            share = min(max(promised / (2.0 * bent), _LEAST), _MOST) if bent > 0.0 else _MOST
            if _NEAR[0] < share < _NEAR[1]:
                break
        return best

    def scale(self, r: Array) -> float:
        """[m], of misses (n, 3), per component: what makes their median that of a normal vector."""
        seen = np.isfinite(r[:, 0])
        d = np.linalg.norm(r[seen], axis=1) / self._medians[seen]
        return max(float(np.median(d)), 1e-12)

    def _loss(self, r: Array, scale: float, moved: Array) -> float:
        square = np.nan_to_num((r * r).sum(axis=1)) / (TUNING * scale) ** 2
        return float(0.5 * TUNING**2 * np.log1p(square).sum() + 0.5 * moved @ self._precision @ moved)

    def _normal(self, J: Array, r: Array, weights: Array, scale: float, moved: Array) -> tuple[Array, Array]:
        """Matrix and right-hand side of the weighted normal equations."""
        r = np.nan_to_num(r)
        A = np.einsum("n,nij,nik->jk", weights, J, J) / scale**2 + self._precision
        g = -np.einsum("n,nij,ni->j", weights, J, r) / scale**2 - self._precision @ moved
        return A, g

    def _scatter(self, J: Array, r: Array, weights: Array, scale: float) -> _Scatter:
        """Where the errors of the answer come from: how much the pull of single points, or of groups of them, varies.

        Many groups tell the scatter in each direction. Few tell by how much points that hang together make that of
        single points larger, on the mean over all directions (Kish's design effect, never below 1).
        """
        seen, k = np.isfinite(r[:, 0]), J.shape[2]
        r = np.nan_to_num(r)
        groups = np.unique(self._groups[seen])
        freedom = max(float(self._freedom[seen].sum()) - k, 1.0)
        single = np.einsum("nij,nik->jk", J[seen], J[seen]) / scale**4
        single *= (weights**2 * (r * r).sum(axis=1)).sum() / freedom
        if len(groups) < 2:
            return _Scatter(single + self._precision, freedom, False)
        pull = np.einsum("n,nij,ni->nj", weights, J, r) / scale**2
        sums = np.array([pull[self._groups == group].sum(axis=0) for group in groups])
        sums -= sums.mean(axis=0)
        joint = sums.T @ sums * len(groups) / (len(groups) - 1.0)
        if len(groups) >= max(FEWEST_GROUPS, 2 * k):
            return _Scatter(joint + self._precision, float(len(groups) - 1), True)
        spread = np.sqrt(np.maximum(np.diag(single), 1e-300))
        sizes, vectors = np.linalg.eigh(single / np.outer(spread, spread))
        told = sizes > _BLIND * max(float(sizes[-1]), 1e-300)
        along = sums / spread @ vectors[:, told]
        design = float((along**2 / sizes[told]).sum()) * len(groups) / (len(groups) - 1.0) / max(int(told.sum()), 1)
        freedom = min(freedom, float((len(groups) - 1) * max(int(told.sum()), 1)))
        return _Scatter(max(design, 1.0) * single + self._precision, freedom, False)

    def _finish(self, place: _Place, misses: Array) -> Fit:
        values = place.values
        J = self._derivative(values, misses)
        r = misses
        seen = np.isfinite(r[:, 0])
        scale = self.scale(r)
        r = np.nan_to_num(r)
        weights = np.where(seen, _weights(r, scale), 0.0)
        prior = self._precision
        # curvature of the loss: along a miss it is less than across
        along = np.einsum("ni,nij->nj", r, J)
        A = np.einsum("n,nij,nik->jk", weights, J, J) / scale**2
        curvature = A - 2.0 / (TUNING**2 * scale**4) * np.einsum("n,nj,nk->jk", weights**2, along, along)
        spread = np.sqrt(np.maximum(np.diag(A + prior), 1e-300))
        if np.linalg.eigvalsh((curvature + prior) / np.outer(spread, spread))[0] > 0.1 * _BLIND:
            A = curvature
        A, scatter = A + prior, self._scatter(J, misses, weights, scale)
        scaled = A / np.outer(spread, spread)
        sizes, vectors = np.linalg.eigh(scaled)
        blind = (vectors[:, sizes < _BLIND] / spread[:, None]).T
        blind /= np.maximum(np.linalg.norm(blind, axis=1, keepdims=True), 1e-300)
        inverse = (vectors[:, sizes >= _BLIND] / sizes[sizes >= _BLIND]) @ vectors[:, sizes >= _BLIND].T
        inverse /= np.outer(spread, spread)
        covariance = inverse @ scatter.matrix @ inverse
        unseen = (np.abs(vectors[:, sizes < _BLIND]) > 1e-3).any(axis=1)
        covariance[unseen, unseen] = math.inf
        return Fit(
            values=values, covariance=covariance, scale=scale, freedom=max(1, int(scatter.freedom)),
            iterations=self._iteration, converged=place.converged, misses=misses, followed=place.misses,
            weights=weights, blind=blind, clustered=scatter.clustered,
        )  # fmt: skip


def _within(A: Array, g: Array, most: Array) -> Array:
    """(k,): the step x to where A x = g, no component above `most`; the others are the best beside those at theirs.

    Of a number that is next to nothing, and whose logarithm is fitted, all would wait for its endless step otherwise.
    """
    x, free = np.zeros(len(g)), np.ones(len(g), dtype=bool)
    while free.any():
        x[free] = np.linalg.solve(A[np.ix_(free, free)], (g - A[:, ~free] @ x[~free])[free])
        over = free & (np.abs(x) > most)
        if not over.any():
            break
        worst = int(np.argmax(np.where(over, np.abs(x) / most, 0.0)))
        x[worst], free[worst] = math.copysign(most[worst], x[worst]), False
    return x


def _noise(A: Array, scatter: Array) -> float:
    """[1], of the loss: twice what it differs by at the answer and at the truth, on the mean over all directions."""
    spread = np.sqrt(np.maximum(np.diag(A), 1e-300))
    scaled = A / np.outer(spread, spread) + _BLIND * np.eye(len(A))
    return float(np.trace(np.linalg.solve(scaled, scatter / np.outer(spread, spread)))) / len(A)


def _left(scatter: Array, g: Array) -> float:
    """[1], of how many standard errors Newton's step is, root mean square over all directions.

    Of A^-1 g with the covariance A^-1 B A^-1, B the scatter of g: the sum of squares is g^T B^-1 g, whatever A is.
    """
    spread = np.sqrt(np.maximum(np.diag(scatter), 1e-300))
    scaled = scatter / np.outer(spread, spread) + _BLIND * np.eye(len(g))
    return math.sqrt(max(float(g / spread @ np.linalg.solve(scaled, g / spread)), 0.0) / len(g))


def _differ(a: Array, b: Array) -> bool:
    """Whether misses (n, 3) are those of different shapes."""
    sizes = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    if not np.array_equal(np.isnan(sizes[0]), np.isnan(sizes[1])):
        return True
    means = [float(np.nanmean(size)) if np.isfinite(size).any() else 0.0 for size in sizes]
    return abs(means[0] - means[1]) > _OTHER * max(means)


def _weights(r: Array, scale: float) -> Array:
    """Of each point: 1 where it is met, falling with the square of its miss."""
    square = (r * r).sum(axis=1) / (TUNING * scale) ** 2
    return np.where(np.isfinite(square), 1.0 / (1.0 + np.nan_to_num(square)), 0.0)
