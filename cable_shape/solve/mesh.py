"""Where the nodes of a network go: the density of each span's mesh, and how many elements that makes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import rod_mesh

#: Abscissae [m] and density of a span's nodes.
Piece = tuple[Array, Array]
#: Elements of a span's first mesh, by how long its boundary layer is at least, as a fraction of the span.
_FIRST = ((0.3, 5), (0.1, 8), (0.02, 12), (0.0, 22))
_ABSCISSAE = 65  #: points at which the density of a span's first mesh is given


def layered(arcs: Array, layers: Array) -> tuple[list[Piece], Array]:
    """Half of each span's nodes within a few of its boundary layers (m,) [m]; arcs (m+1,) [m], of the supports."""
    pieces, shares = [], []
    for (a, b), layer in zip(pairwise(arcs), layers, strict=True):
        length = b - a
        x, density = np.empty(_ABSCISSAE), np.empty(_ABSCISSAE)
        rod_mesh.layered(length, min(max(layer, 1e-5 * length), length), x, density)
        pieces.append((x + a, density))
        shares.append(next(count for reach, count in _FIRST if layer > reach * length or reach == 0.0))
    return pieces, np.array(shares, dtype=np.float64)


def indicated(
    nodes: Array, runs: list[tuple[int, int]], q: Array, errors: Array, excess: float, turn: float
) -> tuple[list[Piece], Array]:
    """What a solution's errors (N,) ask for, see ``rod_mesh.indicated``: one share for all elements of the cable.

    runs: first and last node of each span, as their elements follow; excess: how many times its aim the error is.
    """
    pieces, shares = [], np.empty(len(runs))
    worst, whole = errors.max(), errors.sum()
    first = 0
    for j, (a, b) in enumerate(runs):
        x, density = np.empty(b - a + 2), np.empty(b - a + 2)
        own = errors[first : first + b - a]
        first += b - a
        most, part = own.max(), 0.0
        if most > 0.0:  # `rod_mesh.indicated` of this span alone comes to the cable's share
            part = excess * errors.size * worst / whole * (most / worst) ** (6.0 / 7.0)
            part *= own.sum() / ((b - a) * most)
        shares[j] = rod_mesh.indicated(nodes[a : b + 1], q[a : b + 1], own, part, turn, x, density)
        pieces.append((x, density))
    return pieces, shares


def interpolated(at: Array, s: Array, q: Array) -> Array:
    """Quaternions (k, 4) at arc lengths `at`, linear between those at s."""
    signs = np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    chain = q * np.concatenate(([1.0], np.cumprod(signs)))[:, None]
    out = np.stack([np.interp(at, s, column) for column in chain.T], axis=1)
    size = np.linalg.norm(out, axis=1, keepdims=True)
    return np.asarray(out / np.where(size > 0.0, size, 1.0))
