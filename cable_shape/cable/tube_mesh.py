"""The centreline and diameter of a tube of triangles: :func:`centreline_of`.

A first line joins the middles of bands of equal geodesic distance from one end (A. Verroust and F. Lazarus, Extracting
skeletal curves from 3D scattered data, The Visual Computer, 2000). Then a cubic B-spline c and a radius R make the sum
of (|v - c(nearest)| - R)^2 over the vertices v least, by Gauss and Newton's method; what is far from R, such as caps
and inner walls, does not count. So noise is averaged, and holes do no harm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from cable_shape.cable.centreline import Centreline
from cable_shape.checks import Array
from cable_shape.errors import FileError

#: A piece of a mesh with fewer of its vertices than this share is dirt.
_DIRT = 0.02
#: Vertices that are off the radius by more than this share of it do not count.
_FAR = 0.3
#: Control points a radius of length, at most so many, and how often the curve is fitted.
_DENSE, _MOST, _ROUNDS = 0.7, 120, 5
#: So many vertices for each of them tell its place; more would take their time only.
_PLENTY = 60
#: Length of the mean of unit vectors to vertices above which they are all on one side.
_ONE_SIDED = 0.4
#: Weight of the curve's roughness beside one vertex.
_SMOOTH = 0.3
#: Bands that have to be in several pieces before a mesh counts as forked.
_FORKED = 4


def centreline_of(vertices: Array, faces: Any, where: str) -> tuple[Centreline, float]:
    """The centreline, and the diameter [m], of a tube: vertices (v, 3) [m], faces (f, 3).

    Raises
    ------
    FileError
        Naming `where`: several bodies, a fork, a closed ring, something that is as thick as it is long.
    """
    v, f = _welded(vertices, faces)
    v, f = _one_body(v, f, where)
    line, radius = _first_line(v, f, where)
    r = _to_the_rims(v, line, radius)
    for _ in range(2):  # only the second time it begins and ends at the rims
        curve, radius = _fitted(v, r, radius)
        r = _between_ends(v, curve, radius)
    found = Centreline.from_points(r, where)
    if found.length < 3.0 * radius:
        raise FileError(f"{where}: it is {found.length:.3g} m long and {2 * radius:.3g} m thick: no tube. Give one.")
    return found, 2.0 * radius


def _welded(vertices: Array, faces: Any) -> tuple[Array, Any]:
    """Equal vertices made one, and triangles without area left out."""
    v, same = np.unique(vertices, axis=0, return_inverse=True)
    f = same.reshape(-1)[np.asarray(faces)]
    return v, f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]


def _graph(v: Array, f: Any) -> Any:
    """Edges by their lengths."""
    a, b = np.concatenate((f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]])).T
    size = np.linalg.norm(v[a] - v[b], axis=1)
    graph = coo_matrix((np.maximum(size, 1e-12), (a, b)), shape=(len(v), len(v))).tocsr()
    return graph.maximum(graph.T)


def _one_body(v: Array, f: Any, where: str) -> tuple[Array, Any]:
    """The only body, without dirt."""
    if not len(f):
        raise FileError(f"{where}: it has no triangle with an area. Export it again.")
    _, body = connected_components(_graph(v, f), directed=False)
    sizes = np.bincount(body[np.unique(f)], minlength=body.max() + 1)
    large = np.flatnonzero(sizes > _DIRT * sizes.sum())
    if len(large) > 1:
        raise FileError(f"{where}: it has {len(large)} bodies that do not touch. Export one tube a file.")
    kept = body == large[0]
    number = np.cumsum(kept) - 1
    return v[kept], number[f[kept[f[:, 0]]]]


def _first_line(v: Array, f: Any, where: str) -> tuple[Array, float]:
    """Middles (n, 3) of bands of equal distance from one end, and about the radius [m]."""
    graph = _graph(v, f)
    one = int(dijkstra(graph, directed=False, indices=0).argmax())
    from_one = dijkstra(graph, directed=False, indices=one)
    far = float(from_one.max())
    area = 0.5 * np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1).sum()
    wide = max(area / (np.pi * far), 1e-9)  # about the diameter
    edge = float(np.median(graph.data))
    count = int(np.clip(far / max(0.5 * wide, 1.5 * edge), 4, 400))
    band = np.minimum((from_one / far * count).astype(int), count - 1)
    edges = graph.tocoo()
    inside = band[edges.row] == band[edges.col]
    same = coo_matrix((np.ones(inside.sum()), (edges.row[inside], edges.col[inside])), shape=graph.shape)
    _, piece = connected_components(same, directed=False)
    middles, forked = [], []
    for i in range(count):
        here = np.flatnonzero(band == i)
        if not len(here):
            continue
        _, size = np.unique(piece[here], return_counts=True)
        places = [v[here[piece[here] == p]].mean(axis=0) for p in np.unique(piece[here])[size > 0.2 * len(here)]]
        if len(places) > 1 and np.linalg.norm(np.ptp(places, axis=0)) > 1.2 * wide:
            forked.append(places[0])
        if 1.5 * wide < (i + 0.5) / count * far < far - 1.5 * wide:  # nearer to an end a band is no ring yet
            middles.append(v[here].mean(axis=0))
    if len(forked) >= _FORKED:
        at = ", ".join(f"{x:.4g}" for x in forked[0])
        raise FileError(f"{where}: it forks near ({at}) m, or is a closed ring. Give each branch as a file of its own.")
    line = np.array(middles)
    if len(line) < 2:
        raise FileError(f"{where}: it is {far:.3g} m long and about {wide:.3g} m thick: no tube. Give one.")
    return line, 0.5 * wide


def _to_the_rims(v: Array, line: Array, radius: float) -> Array:
    """The line, straight on at both ends as far as the vertices next to them go."""
    from scipy.spatial import cKDTree

    nearest = cKDTree(line).query(v)[1]
    ends = []
    for i, before in ((0, 1), (len(line) - 1, len(line) - 2)):
        ahead = (line[i] - line[before]) / np.linalg.norm(line[i] - line[before])
        reach = ((v[nearest == i] - line[i]) @ ahead).max(initial=0.0)
        ends.append(line[i] + max(float(reach), 0.1 * radius) * ahead)
    return np.concatenate(([ends[0]], line, [ends[1]]))


def _fitted(v: Array, points: Array, radius: float) -> tuple[BSpline, float]:
    """The spline over about its arc length [m], from rim to rim, and the radius [m]."""
    s = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    n = int(np.clip(_DENSE * s[-1] / radius, 6, _MOST))
    if len(v) > _PLENTY * n:
        v = v[np.random.default_rng(0).permutation(len(v))[: _PLENTY * n]]
    knots = np.concatenate((np.zeros(3), np.linspace(0.0, s[-1], n - 2), np.full(3, s[-1])))
    grid = np.linspace(0.0, s[-1], 8 * n)
    start = np.stack([np.interp(grid, s, x) for x in points.T], axis=1)
    second = np.diff(np.eye(n), n=2, axis=0)
    third = np.diff(np.eye(n), n=3, axis=0)
    on_grid = BSpline.design_matrix(grid, knots, 3).toarray()
    c = np.linalg.solve(on_grid.T @ on_grid + 0.1 * second.T @ second, on_grid.T @ start)
    rough = _SMOOTH * third.T @ third + 1e-9 * np.eye(n)
    radius = float(np.quantile(_around(v, BSpline(knots, c, 3))[1], 0.75))
    for _ in range(_ROUNDS):
        curve = BSpline(knots, c, 3)
        u, off, way, along = _around(v, curve)
        counts = (np.abs(off - radius) < _FAR * radius) & (np.abs(along) < 0.5 * radius)
        if counts.sum() < 12:
            break
        direction = way[counts] / off[counts, None]
        B = BSpline.design_matrix(u[counts], knots, 3).toarray()
        A = np.concatenate([direction[:, [i]] * B for i in range(3)] + [np.ones((len(B), 1))], axis=1)
        H, right = A.T @ A, A.T @ (off[counts] - radius)
        for i in range(3):
            H[i * n : (i + 1) * n, i * n : (i + 1) * n] += rough
            right[i * n : (i + 1) * n] -= _SMOOTH * third.T @ (third @ c[:, i])
        ahead = curve.derivative(1)(grid)
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        along_it = np.concatenate([ahead[:, [i]] * on_grid for i in range(3)], axis=1)
        H[: 3 * n, : 3 * n] += along_it.T @ along_it  # no step along the curve, of which vertices say nothing
        step = np.linalg.solve(H, right)
        c, radius = c + step[:-1].reshape(3, n).T, radius + float(step[-1])
        if np.abs(step).max() < 1e-5 * radius:
            break
    return BSpline(knots, c, 3), radius


def _around(v: Array, curve: BSpline) -> tuple[Array, Array, Array, Array]:
    """Of points: the parameter nearest to them, the distance from the tangent there, the way to them across and along
    it, which is not 0 beyond the ends."""
    u = _nearest(curve, v, float(curve.t[-1]), len(curve.c))
    d = curve.derivative(1)(u)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    way = v - curve(u)
    along = (way * d).sum(axis=1)
    way = way - along[:, None] * d
    return u, np.linalg.norm(way, axis=1), way, along


def _nearest(curve: BSpline, v: Array, end: float, n: int) -> Array:
    """Parameters (v,) at which the curve is nearest to points."""
    from scipy.spatial import cKDTree

    grid = np.linspace(0.0, end, 12 * n)
    u = grid[cKDTree(curve(grid)).query(v)[1]]
    d1, d2 = curve.derivative(1), curve.derivative(2)
    for _ in range(3):
        way, d = v - curve(u), d1(u)
        slope = (d * d).sum(axis=1) - (way * d2(u)).sum(axis=1)
        u = np.clip(u + (way * d).sum(axis=1) / np.maximum(slope, 0.2 * (d * d).sum(axis=1)), 0.0, end)
    return np.asarray(u)


def _between_ends(v: Array, curve: BSpline, radius: float) -> Array:
    """Points (m, 3) along the curve from the first to the last of the tube's rims, straight on where it is short."""
    end = float(curve.t[-1])
    u, off, way, along = _around(v, curve)
    on = (np.abs(off - radius) < _FAR * radius) & (np.abs(along) < radius)
    order = np.argsort((u + along)[on])
    at, side = (u + along)[on][order], (way[on] / off[on, None])[order]
    low, high = _rim(at, side, radius), -_rim(-at[::-1], side[::-1], radius)
    at = np.linspace(low, high, max(8, 3 * len(curve.c)))
    inside = np.clip(at, 0.0, end)
    d = curve.derivative(1)(inside)
    return np.asarray(curve(inside) + ((at - inside) / np.linalg.norm(d, axis=1))[:, None] * d)


def _rim(at: Array, side: Array, radius: float) -> float:
    """Where along the curve the first vertices lie all around it: ascending `at` (n,), on these sides (n, 3)."""
    for i in range(0, len(at) // 2, 2):
        near = slice(i, max(int(np.searchsorted(at, at[i] + 0.5 * radius)), i + 6))
        if np.linalg.norm(side[near].mean(axis=0)) < _ONE_SIDED:
            return float(np.median(at[near][at[near] < at[i] + 0.15 * radius]))
    return float(at[0])
