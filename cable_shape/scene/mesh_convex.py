"""Whether a triangle mesh is a convex solid, and how thin it is."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cable_shape.scene.solids import Mesh

#: A mesh is convex if it fills its convex hull but for this fraction of the volume, and has no more surface.
_SLACK = 1e-6
#: Faces of the hull from which the thickness is measured.
_MOST_FACES = 2000


def is_convex(mesh: Mesh) -> bool:
    """Whether the mesh is closed, its triangles counter-clockwise from outside, and convex but for rounding."""
    return half_thickness(mesh) > 0.0


@functools.lru_cache(maxsize=256)
def half_thickness(mesh: Mesh) -> float:
    """[m], half of how far a convex mesh reaches behind that of its faces behind which it reaches least.

    0 if it is not convex, see `is_convex`.
    """
    from scipy.spatial import ConvexHull, QhullError

    used = mesh.vertices[np.unique(mesh.faces)]
    try:
        hull = ConvexHull(used)
    except QhullError:  # flat, or fewer than four points
        return 0.0
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - used.mean(axis=0) for k in range(3))
    normals = np.cross(b - a, c - a)
    volume = float(np.einsum("ij,ij->", normals, a)) / 6.0
    area = 0.5 * float(np.linalg.norm(normals, axis=1).sum())
    if not (volume > (1.0 - _SLACK) * hull.volume and area < (1.0 + _SLACK) * hull.area):
        return 0.0
    corners, least = used[hull.vertices], math.inf
    for plane in hull.equations[:: math.ceil(len(hull.equations) / _MOST_FACES)]:
        least = min(least, -float((corners @ plane[:3]).min() + plane[3]))
    return 0.5 * least
