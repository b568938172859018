"""Closed meshes that are not convex, divided into convex parts for contact: :func:`divided`.

The division is that of CoACD (Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware
concavity and tree search", 2022). It is approximate: how far the surface of the parts is off that of the mesh is
measured, and finer divisions are tried as long as it is too far. What takes seconds is done once and kept
(mesh_parts_cache.py).
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, lacking
from cable_shape.kernels.distance.triangles import STACK_SIZE, mesh_points
from cable_shape.scene import mesh_parts_cache
from cable_shape.scene.mesh_convex import half_thickness, is_convex
from cable_shape.scene.mesh_tree import mesh_tables, spheres_tables
from cable_shape.scene.points import HeightField, Points
from cable_shape.scene.scene_parts import Obstacle
from cable_shape.scene.solids import Mesh

#: CoACD's concavity of the divisions that are tried, and the deviation that is enough, both of the size of the mesh.
CONCAVITIES, ENOUGH = (0.05, 0.02, 0.01), 1e-3
SETTINGS: dict[str, Any] = {"preprocess_mode": "off", "mcts_iterations": 100, "merge": True, "seed": 0}
#: Points on the mesh, and on the parts together, at which the deviation is measured, beside all corners.
SAMPLES = 20_000
#: Of the size of a mesh: where two parts are nearer to each other than this lies a seam, into which no cable comes.
_SEAM = 1e-3
#: Of how far points are apart: the least radius.
_DENSE = 0.75


class Parts(NamedTuple):
    """Convex meshes in place of one that is not, and how far [m] their surface is off that of the mesh."""

    meshes: tuple[Mesh, ...]
    deviation: float


def divided(bodies: Iterable[Obstacle]) -> tuple[list[Obstacle], Array]:
    """The bodies with which contact is solved for, and (k,) [m] how far each is off what it is in place of.

    Closed meshes that are not convex are divided, each part an obstacle of the same name.

    Raises
    ------
    ArgumentError
        For a mesh that is not closed, and for points with gaps between their spheres.
    DependencyError
        Where CoACD is not installed and a mesh has to be divided.
    """
    out: list[Obstacle] = []
    off: list[float] = []
    for body in bodies:
        if isinstance(body.solid, Mesh) and not is_convex(body.solid):
            parts = _parts_of(body.name, body.solid)
            out += [replace(body, solid=mesh) for mesh in parts.meshes]
            off += [parts.deviation] * len(parts.meshes)
        else:
            if isinstance(body.solid, (Points, HeightField)):
                _check_dense(body.name, body.solid)
            out.append(body)
            off.append(0.0)
    return out, np.array(off)


def _parts_of(name: str, mesh: Mesh) -> Parts:
    """The parts of the mesh of obstacle `name`."""
    wrong = _not_solid(name, mesh)
    if wrong:
        raise ArgumentError.of(
            f"obstacle {name!r}", mesh, f"contact is solved for with closed meshes, and {wrong}",
            "Close it and turn its triangles counter-clockwise from outside, or write contact='warn'.",
        )  # fmt: skip
    try:
        return parts_of(mesh)
    except _DividingError as error:
        remedy = "Divide it into convex parts, one obstacle each, or write contact='warn'."
        raise ArgumentError.of(f"obstacle {name!r}", mesh, str(error), remedy) from None


def _check_dense(name: str, solid: Points | HeightField) -> None:
    """Refuses points between which a cable would lie in dents, or slip through."""
    apart = spheres_tables(solid)[2]
    if solid.radius < _DENSE * apart:
        bound = f"its points are {apart:g} m apart, and contact is solved for from {_DENSE:g} of that on"
        raise ArgumentError.of(
            f"obstacle {name!r}: radius", solid.radius, bound, "Raise the radius, or write contact='warn'."
        )


def _not_solid(name: str, mesh: Mesh) -> str:
    """Why a mesh is no solid, in words; empty if it is one."""
    triangles, _, closed = mesh_tables(name, mesh)
    if not closed:
        return "this one has edges that do not join two triangles of one side out"
    a, b, c = triangles[:, :3], triangles[:, 3:6], triangles[:, 6:9]
    volume = float(np.einsum("ij,ij->", np.cross(b - a, c - a), a - mesh.vertices.mean(axis=0)))
    return "" if volume > 0.0 else "this one is inside out"


class _DividingError(Exception):
    """Why a mesh cannot be divided, in words."""


@functools.lru_cache(maxsize=64)
def parts_of(mesh: Mesh) -> Parts:
    """A closed mesh in convex parts, from the cache if it was divided before."""
    coacd = _coacd()
    key = mesh_parts_cache.key_of(mesh, (version("coacd"), SETTINGS, CONCAVITIES, ENOUGH, SAMPLES))
    kept = mesh_parts_cache.read(key)
    if kept is not None:
        return Parts(*kept)
    print(f"cable_shape: dividing {mesh} into convex parts, once, which may take a minute", file=sys.stderr, flush=True)
    best, enough = Parts((), np.inf), ENOUGH * _size(mesh)
    for concavity in CONCAVITIES:
        meshes = _divide(coacd, mesh, concavity)
        if meshes:
            found = Parts(meshes, deviation(mesh, meshes))
            best = min(best, found, key=lambda parts: parts.deviation)
        if best.deviation <= enough:
            break
    if not best.meshes:
        raise _DividingError("no convex parts are found of it")
    mesh_parts_cache.write(key, *best)
    return best


def _coacd() -> Any:
    """The library."""
    try:
        import coacd
    except ModuleNotFoundError as error:
        known = lacking(error)
        if known is None:
            raise
        raise known from None
    coacd.set_log_level("error")
    return coacd


def _divide(coacd: Any, mesh: Mesh, concavity: float) -> tuple[Mesh, ...]:
    """Convex parts, thin ones left out."""
    try:
        found = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=concavity, **SETTINGS)
    except RuntimeError as error:
        raise _DividingError(f"CoACD cannot divide it ({error})") from None
    hulls = (_hull(vertices) for vertices, _ in found)
    return tuple(hull for hull in hulls if hull is not None and half_thickness(hull) > 0.0)


def _hull(points: Array) -> Mesh | None:
    """The convex hull of points (n, 3), triangles counter-clockwise from outside; None: it is flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces = number[hull.simplices]
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points[hull.vertices], faces)


def deviation(mesh: Mesh, parts: Sequence[Mesh]) -> float:
    """[m], how far the surface of the parts together is off that of the mesh, and the other way round.

    Measured at corners and at points spread evenly over both surfaces. Where one part meets another is no surface.
    """
    seam = _SEAM * _size(mesh)
    own = _Sides(mesh)
    solids = [_Sides(part) for part in parts]
    bare = np.min([solid.distances(own.spread(SAMPLES)) for solid in solids], axis=0)
    most = float(bare.max(initial=0.0))
    area = sum(solid.area for solid in solids)
    for i, solid in enumerate(solids):
        points = solid.spread(max(int(SAMPLES * solid.area / area), 1))
        for other in (*solids[:i], *solids[i + 1 :]):
            points = points[other.distances(points) > seam]
        most = max(most, float(np.abs(own.distances(points)).max(initial=0.0)))
    return most


def _size(mesh: Mesh) -> float:
    """[m], its longest side along an axis."""
    return float(np.ptp(mesh.vertices, axis=0).max())


class _Sides:
    """A closed mesh as the side of which points are."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._triangles, self._nodes, self._closed = mesh_tables("mesh", mesh)
        self._stack = np.empty(STACK_SIZE, np.int64)
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        self._areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        self.area = float(self._areas.sum())

    def distances(self, points: Array) -> Array:
        """(n,) [m], signed, of points (n, 3)."""
        out = np.empty(len(points))
        mesh_points(self._triangles, self._nodes, 0, self._closed, points, True, self._stack, out)
        return out

    def spread(self, count: int) -> Array:
        """(n, 3) [m]: the corners, and about so many points, each triangle its share by area and one at least."""
        random = np.random.default_rng(0)
        share = np.maximum(np.ceil(count * self._areas / self.area), 1.0).astype(int)
        which = np.repeat(np.arange(share.size), share)
        u, v = random.random((2, which.size))
        over = u + v > 1.0
        u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
        a, b, c = (self._mesh.vertices[self._mesh.faces[which, k]] for k in range(3))
        inside = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        return np.ascontiguousarray(np.concatenate((self._mesh.vertices[np.unique(self._mesh.faces)], inside)))
