"""Meshes and points prepared for distance: normals of every feature and a tree of bounding boxes."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance.triangles import NODE_COLUMNS, TRIANGLE_COLUMNS
from cable_shape.scene.points import HeightField, Points
from cable_shape.scene.solids import Mesh

LEAF_SIZE = 4  # triangles


@functools.lru_cache(maxsize=64)
def mesh_tables(name: str, mesh: Mesh) -> tuple[Array, Array, bool]:
    """The tables of :mod:`cable_shape.kernels.distance.triangles` for the obstacle `name`.

    Returns
    -------
    triangles : (f, 30)
        Corners and normals, leaf by leaf; triangles without area are left out.
    nodes : (k, 8)
        Indices count from this mesh's first triangle and node.
    closed : bool
        Whether every edge joins two triangles that agree on which side is out.
    """
    corners = mesh.vertices[mesh.faces]  # (f, 3, 3)
    sides = np.roll(corners, -1, axis=1) - corners  # AB, BC, CA
    cross = np.cross(sides[:, 0], -sides[:, 2])
    twice_area = np.linalg.norm(cross, axis=1)
    # below this a triangle is a line at the rounding of its coordinates
    proper = twice_area > 1e-14 * (sides**2).sum(axis=(1, 2))
    if not proper.any():
        raise ArgumentError(f"{name}: its mesh has no triangle with an area. Check the file and its scale.")
    faces, sides, corners = mesh.faces[proper], sides[proper], corners[proper]
    normal = cross[proper] / twice_area[proper, None]

    along = sides / np.linalg.norm(sides, axis=2, keepdims=True)
    cosine = -np.einsum("fij,fij->fi", along, np.roll(along, 1, axis=1))
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    at_vertex = np.zeros_like(mesh.vertices)
    np.add.at(at_vertex, faces, angle[:, :, None] * normal[:, None, :])

    ends = np.stack((faces, np.roll(faces, -1, axis=1)), axis=2).reshape(-1, 2)  # AB, BC, CA of each
    _, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    edge = edge.reshape(-1)
    at_edge = np.zeros((edge.max() + 1, 3))
    np.add.at(at_edge, edge, np.repeat(normal, 3, axis=0))
    direction = np.where(ends[:, 0] < ends[:, 1], 1, -1)
    closed = bool((np.bincount(edge) == 2).all() and (np.bincount(edge, weights=direction) == 0).all())

    table = np.concatenate(
        (corners.reshape(-1, 9), normal, at_edge[edge].reshape(-1, 9), at_vertex[faces].reshape(-1, 9)), axis=1
    )
    order, nodes = _tree(corners)
    return table[order], nodes, closed


@functools.lru_cache(maxsize=64)
def spheres_tables(solid: Points | HeightField) -> tuple[Array, Array, float]:
    """The tables of :mod:`cable_shape.kernels.distance.spheres`: centres, nodes, and how far centres are apart [m].

    That is how far most have their fourth neighbour, 0 of a single one: on a lattice, its spacing.
    """
    from scipy.spatial import KDTree

    centres = solid.centres
    order, nodes = _tree(centres[:, None])
    table = np.zeros((len(centres), TRIANGLE_COLUMNS))
    table[:, :3] = centres[order]
    several = min(len(centres), 5)
    apart = 0.0 if several == 1 else float(np.median(KDTree(centres).query(centres, several)[0][:, -1]))
    return table, nodes, apart


def _tree(corners: Array) -> tuple[NDArray[np.int64], Array]:
    """Triangles (f, 3, 3), or points (n, 1, 3), leaf by leaf and the nodes above them.

    Split at medians along the longest edge of their box, all of one level at once.
    """
    middle = corners.mean(axis=1)
    order = np.arange(len(corners))
    first, last = np.array([0]), np.array([len(corners)])
    levels: list[Array] = []
    count = 1
    while first.size:
        sizes = last - first
        part = np.repeat(np.arange(first.size), sizes)
        starts = np.cumsum(sizes) - sizes
        places = np.arange(part.size) + np.repeat(first - starts, sizes)
        centre, half, axes = _boxes(corners[order[places]], starts, sizes)
        parted = sizes > LEAF_SIZE
        child = count + 2 * np.cumsum(parted) - 2
        pair = np.where(parted[:, None], np.stack((child, 0 * child), axis=1), np.stack((first, sizes), axis=1))
        levels.append(np.concatenate((centre, half, pair, axes[:, :, 0], axes[:, :, 1]), axis=1))
        count += 2 * int(parted.sum())
        inside = order[places]
        order[places] = inside[np.lexsort((np.einsum("ni,ni->n", middle[inside], axes[part, :, 0]), part))]
        first, last = first[parted], last[parted]
        half_way = first + (last - first) // 2
        first, last = np.stack((first, half_way), axis=1).ravel(), np.stack((half_way, last), axis=1).ravel()
    return order, np.concatenate(levels).reshape(-1, NODE_COLUMNS)


def _boxes(corners: Array, starts: NDArray[np.int64], sizes: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Centres (k, 3), half edges (k, 3) and edges (k, 3, 3), as columns, of boxes that lie as what is in them does.

    corners (n, m, 3): of what is in the first box, then of what is in the next; longest edges come first.
    """
    part = np.repeat(np.arange(sizes.size), sizes)
    points = corners - (np.add.reduceat(corners.mean(axis=1), starts) / sizes[:, None])[part, None]
    spread = np.add.reduceat(np.einsum("nmi,nmj->nij", points, points), starts)
    axes = np.linalg.eigh(spread)[1][:, :, ::-1].copy()
    axes[:, :, 2] = np.cross(axes[:, :, 0], axes[:, :, 1])
    along = np.einsum("nmi,nij->nmj", corners, axes[part])
    low, high = np.minimum.reduceat(along.min(axis=1), starts), np.maximum.reduceat(along.max(axis=1), starts)
    longest = np.argsort(low - high, axis=1, kind="stable")
    low, high = np.take_along_axis(low, longest, axis=1), np.take_along_axis(high, longest, axis=1)
    axes = np.take_along_axis(axes, longest[:, None, :], axis=2)
    return np.einsum("kij,kj->ki", axes, 0.5 * (low + high)), 0.5 * (high - low), axes
