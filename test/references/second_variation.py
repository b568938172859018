"""The smallest eigenvalue of a rod's second variation by linear elements: of reference shapes, without our solver.

A rotation theta(s) and, where the cable gives, a change p(s) of r', both in the cable frame, turn R into R exp(theta)
and r' into R exp(theta) (V + p). What is of second order in the energy, with moment M and force N in the cable frame:

    1/2 (theta' + u x theta) K (theta' + u x theta) + 1/2 M . (theta x (theta x u) - theta x theta')
    + 1/2 p p / give - N . (theta x p) - 1/2 N . (theta x (theta x V))

between held places only with the integral of R (p + theta x V) = 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from collocation import Rod, strains, turned
from scipy.linalg import eigh, null_space

Array = np.ndarray


def hat(v: Array) -> Array:
    return np.array(((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0)))


def twice(a: Array, b: Array) -> Array:
    """The matrix of theta -> a . (theta x (theta x b))."""
    return 0.5 * (np.outer(a, b) + np.outer(b, a)) - (a @ b) * np.eye(3)


def smallest(rods: Sequence[Rod], states: Sequence[Array], held: Sequence[str]) -> float:
    """Against the integral of |theta|^2, of a stable shape. states: (13, k) at the middles of the k elements of each
    rod; held: of each stop from the start to the end "frame", "place" or "" (the start has a frame)."""
    counts = [Y.shape[1] for Y in states]
    elements, soft = sum(counts), np.flatnonzero(rods[0].give)
    size = 3 * (elements + 1)
    A, B = np.zeros((2, size + soft.size * elements, size + soft.size * elements))
    closed, rows, e = [], np.zeros((3, len(A))), 0
    fixed = list(range(3))
    for rod, Y, after in zip(rods, states, held[1:], strict=True):
        h = rod.length / Y.shape[1]
        s = h * (np.arange(Y.shape[1]) + 0.5)
        us, Vs, Ns = strains(rod, s, Y)
        Ks = rod.stiffness(s)
        for k in range(Y.shape[1]):
            u, V, N, K, M = us[:, k], Vs[:, k], Ns[:, k], np.diag(Ks[:, k]), Y[7:10, k]
            at = np.concatenate((np.arange(3 * e, 3 * e + 6), size + soft.size * e + np.arange(soft.size)))
            mean = np.hstack((0.5 * np.eye(3), 0.5 * np.eye(3)))
            slope = np.hstack((-np.eye(3), np.eye(3))) / h
            bend = slope + hat(u) @ mean
            turn = mean.T @ hat(M) @ slope
            local = np.zeros((at.size, at.size))
            local[:6, :6] = bend.T @ K @ bend + mean.T @ (twice(M, u) - twice(N, V)) @ mean + 0.5 * (turn + turn.T)
            local[6:, 6:] = np.diag(1.0 / np.asarray(rod.give)[soft])
            local[6:, :6] = -(hat(N) @ mean)[soft]
            local[:6, 6:] = local[6:, :6].T
            A[np.ix_(at, at)] += h * local
            B[np.ix_(at[:6], at[:6])] += h * np.kron(((1 / 3, 1 / 6), (1 / 6, 1 / 3)), np.eye(3))
            R = np.stack([turned(Y[3:7, k], axis) for axis in np.eye(3)], axis=1)
            rows[:, at] += h * np.hstack((-R @ hat(V) @ mean, R[:, soft]))
            e += 1
        if after:
            closed.append(rows)
            rows = np.zeros_like(rows)
        if after == "frame":
            fixed += range(3 * e, 3 * e + 3)
    free = np.setdiff1d(np.arange(len(A)), fixed)
    A, B = A[np.ix_(free, free)], B[np.ix_(free, free)]
    if closed:
        Z = null_space(np.vstack(closed)[:, free])
        A, B = Z.T @ A @ Z, Z.T @ B @ Z
    return float(1.0 / eigh(B, A, eigvals_only=True, subset_by_index=(len(A) - 1, len(A) - 1))[0])
