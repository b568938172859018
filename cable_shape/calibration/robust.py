"""Robust nonlinear least squares of points in space, and what the data say of the parameters.

Minimised is the sum over points of c^2/2 log(1 + (d / c sigma)^2), d the length of a point's miss (Cauchy's loss: a
stray point pulls the less the further it is off), plus 1/2 (p - p0)^T P (p - p0), P the precision of what was known
before. The scale sigma is that of the middle half of the misses. Levenberg and Marquardt's method, with the weights of
the present misses.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from cable_shape.checks import Array

#: c: with it 95 % of the efficiency of least squares is kept for normal noise.
TUNING = 2.385
#: Medians of the length of a normal vector of unit variance in one to three dimensions.
_MEDIANS: Array = np.array((math.nan, 0.6744897501960817, math.sqrt(2.0 * math.log(2.0)), 1.5381722544550522))
_MOST_ITERATIONS = 60
_MOST_RETRIES = 4
#: The fit ends with a step below this fraction of the standard errors.
_STEP = 1e-2
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
    """

    values: Array
    covariance: Array
    scale: float
    freedom: int
    iterations: int
    converged: bool
    misses: Array
    weights: Array
    blind: Array
    clustered: bool


@final
class Robust:
    """One fit: `forward` gives misses, `derivative` their derivatives at (values, misses)."""

    def __init__(
        self,
        forward: Callable[[Array], Array],
        derivative: Callable[[Array, Array], Array],
        retry: Callable[[Array, Array], bool],
        freedom: Array,
        groups: Array,
        steps: Array,
        precision: Array,
    ) -> None:
        """retry(values, misses): looks for better shapes at the same values, and says whether it found some.

        freedom (n,): in how many directions, 1 to 3, a point may be off; an arc length that is not known takes one, and
        so does a plane in which all was seen; groups (n,): of each point; steps (k,); precision (k, k)."""
        self._forward, self._derivative, self._retry = forward, derivative, retry
        self._freedom = np.asarray(freedom, dtype=np.float64)
        self._medians = _MEDIANS[np.asarray(freedom, dtype=np.int64)]
        self._groups = groups
        self._most, self._precision = steps, precision

    def run(self, values: Array, proceed: Callable[[int, float], bool] | None = None) -> Fit:
        """From these values to the least loss; `proceed`, given iteration and scale [m], may end it before."""
        start = values
        misses = self._forward(values)
        damping, converged, retries = 1e-4, False, 0
        iteration = 0
        for iteration in range(1, _MOST_ITERATIONS + 1):
            r = misses
            scale = self.scale(r)
            if proceed is not None and not proceed(iteration, scale):
                converged = False
                break
            J = self._derivative(values, misses)
            weights = _weights(r, scale)
            A, g = self._normal(J, r, weights, scale, values - start)
            loss = self._loss(r, scale, values - start)
            spread = np.sqrt(np.maximum(np.diag(A), 1e-300))
            step = np.zeros_like(values)
            accepted = False
            while damping < 1e8:
                scaled = A / np.outer(spread, spread) + damping * np.eye(len(values))
                step = np.linalg.solve(scaled, g / spread) / spread
                step *= min(1.0, float((self._most / np.maximum(np.abs(step), 1e-300)).min()))
                trial = self._forward(values + step)
                lost = np.isnan(trial[:, 0]) & ~np.isnan(misses[:, 0])
                if not lost.any() and self._loss(trial, scale, values + step - start) <= loss:
                    accepted = True
                    break
                damping = max(10.0 * damping, 1e-3)
            if accepted:
                values, misses = values + step, trial
                damping = max(0.1 * damping, 1e-9)
                converged = float((np.abs(step) * spread).max()) < _STEP
            else:
                converged = float(np.abs(g / spread).max()) < _STEP * math.sqrt(len(r))
            if converged or not accepted:
                if retries == _MOST_RETRIES or not self._retry(values, misses):
                    break
                retries, damping, converged = retries + 1, 1e-4, False
                misses = self._forward(values)
        return self._finish(values, misses, iteration, converged)

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

    def _finish(self, values: Array, misses: Array, iterations: int, converged: bool) -> Fit:
        J = self._derivative(values, misses)
        r = misses
        seen = np.isfinite(r[:, 0])
        scale = self.scale(r)
        r, k = np.nan_to_num(r), len(values)
        weights = np.where(seen, _weights(r, scale), 0.0)
        prior = self._precision
        # curvature of the loss: along a miss it is less than across
        along = np.einsum("ni,nij->nj", r, J)
        A = np.einsum("n,nij,nik->jk", weights, J, J) / scale**2
        curvature = A - 2.0 / (TUNING**2 * scale**4) * np.einsum("n,nj,nk->jk", weights**2, along, along)
        spread = np.sqrt(np.maximum(np.diag(A + prior), 1e-300))
        if np.linalg.eigvalsh((curvature + prior) / np.outer(spread, spread))[0] > 0.1 * _BLIND:
            A = curvature
        A = A + prior
        freedom = float(self._freedom[seen].sum()) - k
        groups = np.unique(self._groups[seen])
        clustered = len(groups) >= max(FEWEST_GROUPS, 2 * k)
        if clustered:
            pull = np.einsum("n,nij,ni->nj", weights, J, r) / scale**2
            sums = np.array([pull[self._groups == group].sum(axis=0) for group in groups])
            B = sums.T @ sums * len(groups) / (len(groups) - 1.0)
            freedom = float(len(groups) - 1)
        else:
            whole = np.einsum("nij,nik->jk", J[seen], J[seen])
            B = (weights**2 * (r * r).sum(axis=1)).sum() / max(freedom, 1.0) * whole / scale**4
        B = B + prior
        scaled = A / np.outer(spread, spread)
        sizes, vectors = np.linalg.eigh(scaled)
        blind = (vectors[:, sizes < _BLIND] / spread[:, None]).T
        blind /= np.maximum(np.linalg.norm(blind, axis=1, keepdims=True), 1e-300)
        inverse = (vectors[:, sizes >= _BLIND] / sizes[sizes >= _BLIND]) @ vectors[:, sizes >= _BLIND].T
        inverse /= np.outer(spread, spread)
        covariance = inverse @ B @ inverse
        unseen = (np.abs(vectors[:, sizes < _BLIND]) > 1e-3).any(axis=1)
        covariance[unseen, unseen] = math.inf
        return Fit(
            values=values, covariance=covariance, scale=scale, freedom=max(1, int(freedom)), iterations=iterations,
            converged=converged, misses=misses, weights=weights, blind=blind, clustered=clustered,
        )  # fmt: skip


def _weights(r: Array, scale: float) -> Array:
    """Of each point: 1 where it is met, falling with the square of its miss."""
    square = (r * r).sum(axis=1) / (TUNING * scale) ** 2
    return np.where(np.isfinite(square), 1.0 / (1.0 + np.nan_to_num(square)), 0.0)
