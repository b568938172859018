"""The space that a moving cable sweeps, as one closed mesh that holds it: :func:`swept`.

Between two instants a point of the cable moves along the chord D, and a little beside it. The cubic through both places
with the velocities v_a and v_b there leaves the chord by at most 4/27 (\\|v_a - D\\| + \\|v_b - D\\|); velocities are
those of the parabolas through three instants, and twice as much is held. So the centreline sweeps strips of triangles,
each swollen by that, by what the bilinear patch between four points is off them, and by what instants that are left out
are off the straight way.

The distance d to a set makes d^2 - |x|^2 concave. On a grid of width h, edges up to e = sqrt(3) h, the surface where
linear interpolation gives d = level is therefore nowhere nearer to the set than

    sqrt(level^2 - e^2 / 4 - e^2 / 3),

e^2 / 4 lost at its corners and e^2 / 3 on its triangles. The level is chosen so that this is the margin: the mesh holds
the space, whatever the grid. That it is not much further away is bounded by the slope of d, which is 1: by e / 2 at
corners, by e / sqrt(3) more on a triangle.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance import swept as kernels
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.planning.study_walk import Rows
from cable_shape.shape import CableShape

#: Grids of more corners are refused.
MOST_CORNERS = 200_000_000
#: This share of the looseness instants that are left out may be off.
_LEFT_OUT = 0.1
#: What the cubic's bound is multiplied with.
_SAFETY = 2.0
#: Of the width of the grid, and of its square: see above.
_FURTHER, _NEARER = 0.5 * math.sqrt(3.0) + 1.0, 3.0 * (1.0 / 4.0 + 1.0 / 3.0)


@final
class Swept:
    """A closed mesh that holds all that a cable sweeps.

    Attributes
    ----------
    vertices : (v, 3) [m]
    faces : (f, 3) indices, counter-clockwise from outside
    margin : float [m], how far around the centreline everything is held
    looseness : float [m], no point of the mesh is further from what it holds
    beside : float [m], how far the cable may be off the straight way between two instants, which is held, too
    """

    __slots__ = ("beside", "faces", "looseness", "margin", "vertices")

    def __init__(
        self, vertices: Array, faces: NDArray[np.int64], margin: float, looseness: float, beside: float
    ) -> None:
        self.vertices, self.faces = vertices, faces
        self.margin, self.looseness, self.beside = margin, looseness, beside

    @property
    def volume(self) -> float:
        """[m^3]."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    @property
    def bounds(self) -> Array:
        """(2, 3) [m], of the box around it."""
        return np.array((self.vertices.min(axis=0), self.vertices.max(axis=0)))

    def __repr__(self) -> str:
        return f"Swept({len(self.faces)} triangles, {1e3 * self.volume:.4g} l, loose by {1e3 * self.looseness:.3g} mm)"


def swept(
    shapes: Sequence[CableShape] | ShapeBatch | Rows | Array, margin: float, *, looseness: float = 0.005
) -> Swept:
    """The space that is swept by a cable whose shapes these are, one after the other, and by all between them.

    Parameters
    ----------
    shapes : sequence of CableShape, ShapeBatch, Rows, or (m, n, 3) array [m]
        In the order of the motion, so close together that the way between two is nearly that of its neighbours. All
        must be usable.
    margin : float
        [m], how far around the centreline: the cable's radius, and what shall stay free about it.
    looseness : float
        [m], how far the mesh may be from what it holds; the finer, the more triangles. Where instants are so far apart
        that more lies between them, `Swept.looseness` tells more: give more instants.

    Raises
    ------
    ArgumentError
        For shapes that cannot be used, or a looseness too small for a grid.
    """
    positions = _positions(shapes)
    margin = checks.number("margin", margin, above=0.0, unit="m")
    looseness = checks.number("looseness", looseness, above=0.0, unit="m")
    off_way = beside(positions)
    thinned, off = _thinned(positions, off_way, _LEFT_OUT * looseness)
    triangles, extra = _strips(thinned, off)
    most = float(extra.max(initial=0.0))
    h = _width(max(looseness - most, 0.5 * most), margin)
    level = math.sqrt(margin * margin + _NEARER * h * h)
    field, origin = _field(triangles, extra, level + 2.0 * h, h)
    count = kernels.surface(field, level, np.empty((0, 3), np.int64), False)
    edges = np.empty((count, 3), np.int64)
    kernels.surface(field, level, edges, True)
    keys, faces = np.unique(edges, return_inverse=True)
    vertices = np.empty((len(keys), 3))
    kernels.crossings(field, level, keys, origin, h, vertices)
    told = _FURTHER * h + level - margin + most
    return Swept(vertices, faces.reshape(-1, 3), margin, told, float(off_way.max(initial=0.0)))


def _width(looseness: float, margin: float) -> float:
    """[m], of a grid on which the bound above is the looseness: _FURTHER h + _NEARER h^2 / (2 margin)."""
    return float(2.0 * looseness / (_FURTHER + math.sqrt(_FURTHER**2 + 2.0 * _NEARER * looseness / margin)))


def _positions(shapes: Any) -> Array:
    """(m, n, 3) of usable shapes."""
    remedy = "Give a list of CableShape, or an array of positions (m, n, 3)."
    if isinstance(shapes, Rows):
        if not shapes.usable.all():
            bad = int(np.flatnonzero(~shapes.usable)[0])
            raise ArgumentError.of("shapes", f"instant {bad}", "it has no usable shape", "Leave such instants out.")
        return np.ascontiguousarray(shapes.part(1, 3))
    if isinstance(shapes, ShapeBatch):
        shapes = list(shapes)
    if isinstance(shapes, np.ndarray):
        table = checks.numbers("shapes", shapes, remedy)
    else:
        told = checks.entries("shapes", shapes, CableShape, remedy)
        for i, shape in enumerate(told):
            if not shape.usable:
                raise ArgumentError.of(f"shapes[{i}]", shape, "it must be usable", "Leave such instants out.")
        if len({shape.points for shape in told}) > 1:
            raise ArgumentError.of("shapes", "shapes of several sizes", "all must have as many points", remedy)
        table = np.array([shape.positions for shape in told])
    if table.ndim != 3 or table.shape[2] != 3 or not table.shape[0] or table.shape[1] < 2:
        raise ArgumentError.of("shapes", f"array of shape {table.shape}", "it must have shape (m, n, 3)", remedy)
    if not np.isfinite(table).all():
        raise ArgumentError.of("shapes", "NaN or infinity", "positions must be finite", "Leave such instants out.")
    return table


def beside(positions: Array) -> Array:
    """(m - 1, n) [m], how far points may be off their chords between instants."""
    chords = np.diff(positions, axis=0)
    turns = np.zeros((len(chords) + 1, positions.shape[1]))
    turns[1:-1] = 0.5 * np.linalg.norm(np.diff(chords, axis=0), axis=2)
    if len(chords) > 1:
        turns[0], turns[-1] = turns[1], turns[-2]
    return np.asarray(_SAFETY * 4.0 / 27.0 * (turns[:-1] + turns[1:]))


def _thinned(positions: Array, beside: Array, share: float) -> tuple[Array, Array]:
    """Instants that are enough, and how far all others and the ways between are off the straight, (k - 1, n) [m]."""
    kept, off, i, last = [0], [], 0, len(positions) - 1
    stride = 1
    while i < last:
        stride = min(2 * stride, last - i)
        while True:
            x = np.arange(stride + 1)[:, None, None] / stride
            straight = (1.0 - x) * positions[i] + x * positions[i + stride]
            apart = np.linalg.norm(positions[i : i + stride + 1] - straight, axis=2).max(axis=0)
            if stride == 1 or apart.max() <= share:
                break
            stride = max(1, stride // 2)
        off.append(apart + beside[i : i + stride].max(axis=0))
        i += stride
        kept.append(i)
    if not off:
        return positions[[0, 0]], np.zeros((1, positions.shape[1]))
    return positions[kept], np.array(off)


def _strips(positions: Array, off: Array) -> tuple[Array, Array]:
    """Triangles (t, 9) between instants, and by how much each is swollen (t,) [m]."""
    a, b = positions[:-1, :-1], positions[:-1, 1:]  # at one instant
    c, d = positions[1:, :-1], positions[1:, 1:]  # at the next one
    warped = 0.25 * np.linalg.norm(a - b - c + d, axis=2)
    extra = np.maximum(off[:, :-1], off[:, 1:]) + warped
    both = np.stack((np.stack((d, a, c), axis=2), np.stack((a, d, b), axis=2)), axis=2)
    return np.ascontiguousarray(both.reshape(-1, 9)), np.repeat(extra.ravel(), 2)


def _field(triangles: Array, extra: Array, reach: float, h: float) -> tuple[Array, Array]:
    """Distances (nx, ny, nz) [m] to the triangles, none above `reach`, on a grid from `origin`, in threads."""
    points = triangles.reshape(-1, 3)
    room = reach + float(extra.max(initial=0.0)) + h
    origin = points.min(axis=0) - room
    size = np.ceil((points.max(axis=0) + room - origin) / h).astype(int) + 1
    if float(size.astype(float).prod()) > MOST_CORNERS:
        bound = f"the grid would have {size[0]} x {size[1]} x {size[2]} corners, at most {MOST_CORNERS} are allowed"
        raise ArgumentError.of("looseness", h, bound, "Allow more looseness.")
    field = np.full(size, reach)
    threads = len(os.sched_getaffinity(0))
    cuts = np.linspace(0, size[0], 4 * threads + 1).astype(int).tolist()

    def run(first: int, last: int) -> None:
        low, high = origin[0] + first * h - room, origin[0] + last * h + room
        x = triangles[:, 0::3]
        near = (x.max(axis=1) >= low) & (x.min(axis=1) <= high)
        kernels.stamp(field, origin, h, first, last, triangles[near], extra[near], reach)

    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(run, cuts[:-1], cuts[1:]):
            pass
    return field, origin
