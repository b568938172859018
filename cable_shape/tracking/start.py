"""Where the ends of a cable may be in a cloud of points that nobody has put in order: :func:`paths`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cable_shape.checks import Array
from cable_shape.pose import Pose

#: Fractions of the length: cells in which points are put together, gaps that a path may leap, the part of a path that
#: tells its direction.
_CELL, _LEAP, _TELLS = 0.012, 0.75, 0.08
#: Cells at most; neighbours that a cell must have nearer than three cells to be no stray point.
_MOST, _FRIENDS = 600, 2


def paths(points: Array, length: float) -> list[Array]:
    """Lines (m, 3) [m] along the cloud (n, 3), in one direction and the other; none where there is no line in it.

    The longest way in the shortest tree through the cloud's cells, those that stand alone left out, and pieces of it
    with less than a third of the cable's share of the points.
    """
    cells = cells_of(points, _CELL * length)
    if len(cells) < 3:
        return []
    tree = cKDTree(cells)
    friends = tree.query_ball_point(cells, 3.0 * _CELL * length, return_length=True) - 1
    if (friends >= _FRIENDS).sum() >= 5:  # a dense cloud; else all are kept
        cells = cells[friends >= _FRIENDS]
        cells = _large(cells, 3.0 * _CELL * length)
    apart = np.linalg.norm(cells[:, None] - cells, axis=2)
    grown = minimum_spanning_tree(apart)
    grown.data[grown.data > _LEAP * length] = 0.0
    grown.eliminate_zeros()
    _, part = connected_components(grown, directed=False)
    largest = np.flatnonzero(part == np.bincount(part).argmax())
    if len(largest) < 3:
        return []
    grown = grown[largest][:, largest]
    cells = cells[largest]
    far = dijkstra(grown, directed=False, indices=0)
    first = int(np.argmax(far))
    far, before = dijkstra(grown, directed=False, indices=first, return_predecessors=True)
    at, way = int(np.argmax(far)), []
    while at >= 0:
        way.append(at)
        at = int(before[at])
    line = cells[way]
    return [line, line[::-1]] if len(line) >= 3 else []


def _large(cells: Array, reach: float) -> Array:
    """Cells that hang together with a twentieth of all at least."""
    pairs = cKDTree(cells).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    _, part = connected_components(graph, directed=False)
    sizes = np.bincount(part)
    kept = cells[sizes[part] >= max(3, 0.04 * len(cells))]
    return kept if len(kept) >= 3 else cells


def cells_of(points: Array, size: float) -> Array:
    """(m, 3): means of the points in each cell of a grid, in its order; larger cells where there are many."""
    while True:
        keys = np.floor(points / size).astype(np.int64)
        _, which, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        if len(counts) <= _MOST:
            sums = np.zeros((len(counts), 3))
            order = np.lexsort(points.T)  # the same sum in whatever order points come
            np.add.at(sums, which.ravel()[order], points[order])
            return np.asarray(sums / counts[:, None])
        size *= 1.3


def poses(line: Array, length: float) -> tuple[Pose, Pose]:
    """Cable frames at both ends of a line; their roll is any, the same by parallel transport."""
    s = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))))
    reach = max(_TELLS * length, 1.5 * s[-1] / len(line))
    i = max(1, int(np.searchsorted(s, reach)))
    j = min(len(line) - 2, int(np.searchsorted(s, s[-1] - reach)))
    near, far = line[min(i, len(line) - 1)] - line[0], line[-1] - line[max(j, 0)]
    near, far = near / np.linalg.norm(near), far / np.linalg.norm(far)
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
