"""Block tridiagonal matrices with a border, many at once in numpy: their inertia, and what solves them.

    [ H  B ] [x]   [f]        H: blocks D_i on the diagonal, U_i between i and i + 1, all 3 x 3
    [ B' S ] [y] = [g]        B: 3 x 3 a node, S: 3 x 3

Every other node is eliminated at a time, for all rows and nodes in one go. Arrays carry the rows k and the nodes m
last; the border and the right-hand side lie beside each other, in columns 0 to 2 and 3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Solved(NamedTuple):
    """x (3, k, m), y (k, 3), and how many eigenvalues of each matrix are negative (k,)."""

    x: Array
    y: Array
    negative: Array


class _Level(NamedTuple):
    """Of the nodes eliminated together: what they answer to their left and right neighbours, border and f."""

    left: Array
    right: Array
    border: Array
    nodes: int


def product(a: Array, b: Array) -> Array:
    """Matrices (i, j, ...) times matrices (j, c, ...)."""
    return np.einsum("ij...,jc...->ic...", a, b)


def product_t(a: Array, b: Array) -> Array:
    """The transposes of matrices (j, i, ...) times matrices (j, c, ...)."""
    return np.einsum("ji...,jc...->ic...", a, b)


def _answer(D: Array, W: Array) -> tuple[Array, Array]:
    """D^-1 W of symmetric 3 x 3 matrices, and how many pivots are negative in each."""
    d1 = D[0, 0]
    a, b = D[1, 0] / d1, D[2, 0] / d1
    d2 = D[1, 1] - a * D[1, 0]
    t = D[2, 1] - b * D[1, 0]
    c = t / d2
    d3 = D[2, 2] - b * D[2, 0] - c * t
    X = np.empty_like(W)
    y1 = W[1] - a * W[0]
    X[2] = (W[2] - b * W[0] - c * y1) / d3
    X[1] = y1 / d2 - c * X[2]
    X[0] = W[0] / d1 - a * X[1] - b * X[2]
    return X, (d1 < 0.0).astype(np.int64) + (d2 < 0.0) + (d3 < 0.0)


def _even(D: Array, U: Array, B: Array) -> tuple[Array, Array, Array]:
    """With a node more, which nothing ties to the others, where the last one would have no neighbour on its right."""
    k = D.shape[2]
    one = np.broadcast_to(np.eye(3)[:, :, None, None], (3, 3, k, 1))
    return (
        np.concatenate((D, one), axis=3),
        np.concatenate((U, np.zeros((3, 3, k, 1))), axis=3),
        np.concatenate((B, np.zeros((3, 4, k, 1))), axis=3),
    )


def solve(D: Array, U: Array, B: Array, S: Array) -> Solved:
    """D (3, 3, k, m), U (3, 3, k, m - 1), B (3, 4, k, m) with f in its last column, S (3, 4, k) with g in its last.

    D, B and S are used up.
    """
    levels = []
    negative = np.zeros(D.shape[2], dtype=np.int64)
    while D.shape[3] > 1:
        nodes = D.shape[3]
        if nodes % 2 == 0:
            D, U, B = _even(D, U, B)
        before, after = U[..., 0::2], U[..., 1::2]  # of each odd node, to its left and to its right
        own = B[..., 1::2]
        W = np.concatenate((before.transpose(1, 0, 2, 3), after, own), axis=1)
        X, below = _answer(D[..., 1::2], W)
        negative += below.sum(axis=1)
        left, right, border = X[:, :3], X[:, 3:6], X[:, 6:]
        D, B = D[..., 0::2].copy(), B[..., 0::2].copy()
        D[..., :-1] -= product(before, left)
        D[..., 1:] -= product_t(after, right)
        B[..., :-1] -= product(before, border)
        B[..., 1:] -= product_t(after, border)
        S -= np.einsum("jikm,jckm->ick", own[:, :3], border)
        U = -product(before, right)
        if nodes % 2 == 0:
            D, U, B = D[..., :-1], U[..., :-1], B[..., :-1]
        levels.append(_Level(left, right, border, nodes))
    X, below = _answer(D, B)
    negative += below.sum(axis=1)
    S -= np.einsum("jikm,jckm->ick", B[:, :3], X)
    matrices, sides = np.moveaxis(S[:, :3], 2, 0), S[:, 3].T
    matrices = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    good = np.isfinite(matrices).all(axis=(1, 2))
    matrices = np.where(good[:, None, None], matrices, np.eye(3))
    negative += (np.linalg.eigvalsh(matrices) < 0.0).sum(axis=1)
    y = np.linalg.solve(matrices, sides[:, :, None])[:, :, 0]
    y[~good] = np.nan
    x = X[:, 3] - np.einsum("jckm,kc->jkm", X[:, :3], y)
    for level in reversed(levels):
        if level.nodes % 2 == 0:
            x = np.concatenate((x, np.zeros((3, x.shape[1], 1))), axis=2)
        own = level.border[:, 3] - np.einsum("jckm,kc->jkm", level.border[:, :3], y)
        own -= np.einsum("ijkm,jkm->ikm", level.left, x[:, :, :-1])
        own -= np.einsum("ijkm,jkm->ikm", level.right, x[:, :, 1:])
        whole = np.empty((3, x.shape[1], 2 * x.shape[2] - 1))
        whole[:, :, 0::2], whole[:, :, 1::2] = x, own
        x = whole[:, :, : level.nodes]
    return Solved(x, y, np.where(good, negative, -1))
