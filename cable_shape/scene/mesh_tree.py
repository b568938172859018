"""Meshes prepared for distance: normals of every feature and a tree of bounding boxes. :func:`mesh_tables`"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance.triangles import NODE_COLUMNS
from cable_shape.scene.solids import Mesh

LEAF_SIZE = 4  # triangles


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


def _tree(corners: Array) -> tuple[NDArray[np.int64], Array]:
    """The triangles (f, 3, 3) leaf by leaf and the nodes above them, split at medians along the longest axis."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = low + high
    order = np.arange(len(corners))
    parts = [(0, len(corners))]
    nodes: list[tuple[float, ...]] = []
    for first, last in parts:  # grows as it goes
        part = order[first:last]
        least, most = low[part].min(axis=0), high[part].max(axis=0)
        if last - first <= LEAF_SIZE:
            nodes.append((*least, *most, first, last - first))
            continue
        half = (last - first) // 2
        order[first:last] = part[np.argpartition(middle[part, (most - least).argmax()], half)]
        nodes.append((*least, *most, len(parts), 0))
        parts += [(first, first + half), (first + half, last)]
    return order, np.array(nodes).reshape(-1, NODE_COLUMNS)
