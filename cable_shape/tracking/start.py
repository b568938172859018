"""Where the ends of a cable may be in a cloud of points that nobody has put in order: :func:`paths`."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cable_shape.checks import Array
from cable_shape.pose import Pose

#: Fractions of the length: cells in which points are put together, gaps that a path may leap, the part of a path that
#: tells its direction, how long a line may be.
_CELL, _LEAP, _TELLS, _LONGEST = 0.012, 0.75, 0.08, 1.1
#: Parts of a line by which its length is told.
_PARTS = 20
#: Cells at most; neighbours that a cell must have nearer than three cells to be no stray point; cells that have them by
#: which a cloud is dense; share of the usual number of points that one has there; of all points, that a piece has.
_MOST, _FRIENDS, _DENSE, _THIN, _SHARE = 600, 2, 5, 0.25, 0.008


def paths(points: Array, length: float) -> list[Array]:
    """Lines (m, 3) [m] along the cloud (n, 3), in one direction and the other; none where there is no line in it.

    A dense cloud falls into pieces, each with a line along it, which are joined at their ends where that bends least,
    the largest first. Of a thin one it is the longest way in the shortest tree through its cells.
    """
    cells, counts = cells_of(points, _CELL * length)
    if len(cells) < 3:
        return []
    near = cKDTree(cells)
    friends = near.query_ball_point(cells, 3.0 * _CELL * length, return_length=True) - 1
    if (friends >= _FRIENDS).sum() >= _DENSE:
        dense = friends >= _FRIENDS
        usual = np.median(np.repeat(counts[dense], counts[dense]))  # around a point, not in a cell
        dense &= counts >= _THIN * usual
        line = _joined(_pieces(cells[dense], counts[dense], length), length)
    else:
        line = _along(cells, _LEAP * length)
    return [line, line[::-1]] if len(line) >= 3 else []


def _pieces(cells: Array, counts: Any, length: float) -> list[Array]:
    """Lines along what hangs together, that of the most points first."""
    reach = 3.0 * _CELL * length
    pairs = cKDTree(cells).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    _, part = connected_components(graph, directed=False)
    weights = np.bincount(part, counts)
    order = np.argsort(-weights, kind="stable")
    lines = [_along(cells[part == k], reach) for k in order if weights[k] >= _SHARE * counts.sum()]
    return [line for line in lines if len(line) >= 2]


def _along(cells: Array, leap: float) -> Array:
    """(m, 3): the longest way in the shortest tree through cells (k, 3), its largest part without longer leaps."""
    apart = np.linalg.norm(cells[:, None] - cells, axis=2)
    grown = minimum_spanning_tree(apart)
    grown.data[grown.data > leap] = 0.0
    grown.eliminate_zeros()
    _, part = connected_components(grown, directed=False)
    largest = np.flatnonzero(part == np.bincount(part).argmax())
    grown = grown[largest][:, largest]
    far = dijkstra(grown, directed=False, indices=0)
    first = int(np.argmax(far))
    far, before = dijkstra(grown, directed=False, indices=first, return_predecessors=True)
    at, way = int(np.argmax(far)), []
    while at >= 0:
        way.append(at)
        at = int(before[at])
    return np.asarray(cells[largest[way]])


def _joined(pieces: list[Array], length: float) -> Array:
    """One line of the pieces, the first as it is; those that would make it too long are left out."""
    if not pieces:
        return np.empty((0, 3))
    hidden = max(length - sum(map(_size, pieces)), 0.05 * length)
    line = pieces[0]
    for piece in pieces[1:]:
        ways = [(a, b) for a in (line, line[::-1]) for b in (piece, piece[::-1])]
        first, then = min(ways, key=lambda way: _odd(way[0], way[1], hidden, length))
        longer = np.concatenate((first, then))
        if _size(longer) <= _LONGEST * length:
            line = longer
    return line


def _odd(line: Array, then: Array, hidden: float, length: float) -> float:
    """[rad], how much more or less a line turns that goes from the end of one to the start of the other than an arc of
    a circle of that length [m] between them; plus how much too short that is.
    """
    way = then[0] - line[-1]
    there, here = _direction(line[::-1], length), _direction(then, length)
    chord = max(float(np.linalg.norm(way)), 1e-12)
    turns = np.clip([-there @ way / chord, here @ way / chord], -1.0, 1.0)
    slack = 1.0 - chord / hidden
    return float(abs(np.arccos(turns).sum() - np.sqrt(24.0 * max(slack, 0.0))) + 24.0 * max(-slack, 0.0))


def _size(line: Array) -> float:
    """[m], of a line through cells to both sides of a cable."""
    some = np.unique(np.linspace(0, len(line) - 1, min(len(line), _PARTS)).astype(np.int64))
    return float(_arc(line[some])[-1])


def _arc(line: Array) -> Array:
    """(m,) [m], arc lengths along a line."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))))


def _direction(line: Array, length: float) -> Array:
    """(3,): of a line where it begins."""
    s = _arc(line)
    i = max(1, int(np.searchsorted(s, max(_TELLS * length, 1.5 * s[-1] / len(line)))))
    way = line[min(i, len(line) - 1)] - line[0]
    return np.asarray(way / np.linalg.norm(way))


def cells_of(points: Array, size: float) -> tuple[Array, Any]:
    """(m, 3), (m,): means of the points in each cell of a grid, in its order, and how many they are; larger cells where
    there are many."""
    while True:
        keys = np.floor(points / size).astype(np.int64)
        _, which, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        if len(counts) <= _MOST:
            sums = np.zeros((len(counts), 3))
            order = np.lexsort(points.T)  # the same sum in whatever order points come
            np.add.at(sums, which.ravel()[order], points[order])
            return np.asarray(sums / counts[:, None]), counts
        size *= 1.3


def poses(line: Array, length: float) -> tuple[Pose, Pose]:
    """Cable frames at both ends of a line; their roll is any, the same by parallel transport."""
    near, far = _direction(line, length), -_direction(line[::-1], length)
    across = np.cross(near, (0.0, 0.0, 1.0))
    if np.linalg.norm(across) < 0.1:
        across = np.cross(near, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    frame = Rotation.from_matrix(np.stack((across, np.cross(near, across), near), axis=1))
    steps = np.diff(line, axis=0)
    steps = np.concatenate((near[None], steps[np.linalg.norm(steps, axis=1) > 0.0], far[None]))
    tangents = steps / np.linalg.norm(steps, axis=1)[:, None]
    out = frame
    for a, b in pairwise(tangents):
        turn = np.cross(a, b)
        sine = float(np.linalg.norm(turn))
        if sine > 1e-9:
            out = Rotation.from_rotvec(turn * (np.arctan2(sine, float(a @ b)) / sine)) * out
    return Pose(line[0], frame.as_quat()), Pose(line[-1], out.as_quat())
