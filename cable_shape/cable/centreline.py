"""Curves that somebody drew, by arc length, and the rest curvature of a cable that has their form: :class:`Centreline`.

Every curve is piecewise polynomial. Its frames turn as little as they can (no twist): with the tangent t they follow
R' = hat(t x t') R, integrated by Magnus' fourth order method with two Gauss points (Blanes, Casas, Oteo and Ros, The
Magnus expansion and some of its applications, Physics Reports 2009, eq. 252).

The table of rest curvature, linear between its rows, is the L2 projection of the turning of these frames onto such
tables: it keeps the integral and the first moment over every two neighbouring cells, so what the rest shape misses of
the curve is of fourth order in the rows' distance, and of second order at a jump of curvature.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.rest_form import conjugate, cross, exponential, form, logarithm, running, third_axis, times
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

#: Rows of a table of rest curvature: as few as the tolerance allows.
ROWS = (9, 17, 33, 65, 129, 257, 513, 1025, 2049, 4097)
#: By how much the rest shape may miss the curve, as a share of its length.
TOLERANCE = 2e-7
#: Points that one curve may be given by.
MOST_POINTS = 200_000
#: Tangents that differ by more [rad] where two pieces meet are a corner.
CORNER = 0.02
#: Pieces are parted so often, with so many Gauss points each, to find their arc length.
_PARTS = 16
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
#: Frames are followed in so many steps from one row of a table to the next.
_STEPS, _FRAMES = 4, 256
_GAUSS_TWO = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)
#: Points that a curve is looked at with where it may cross itself.
_LOOKED_AT = 600


@final
class Centreline:
    """A curve in space, parametrised by arc length.

    Made by :meth:`from_points`, and by what reads files. `start` and `end` are the frames, d3 along the curve, between
    which a cable made of it (:meth:`cable_shape.Cable.from_centreline`) rests without load in just this form.

    Raises
    ------
    ArgumentError
        Naming the place: a curve with a corner, without length, or that crosses itself where that is asked.
    """

    __slots__ = ("_parts", "_poly", "_s", "_seen", "_slopes", "length")

    length: float

    def __init__(self, poly: PPoly, where: str = "centreline") -> None:
        self._poly, self._slopes = poly, (poly.derivative(1), poly.derivative(2))
        x = poly.x
        self._parts: Array = np.append((x[:-1, None] + np.diff(x)[:, None] * np.arange(_PARTS) / _PARTS).ravel(), x[-1])
        lengths = self._span(self._parts[:-1], self._parts[1:])
        self._s: Array = np.concatenate(([0.0], np.cumsum(lengths)))
        self.length = float(self._s[-1])
        if not (np.isfinite(self.length) and self.length >= 1e-6 and (lengths > 0.0).all()):
            raise ArgumentError(f"{where}: the curve has no length, or stands still somewhere. Remove points twice.")
        self._check_corners(where)
        self._seen: dict[int, tuple[Array, Array, Array]] = {}

    @classmethod
    def from_points(cls, points: ArrayLike, where: str = "points") -> Centreline:
        """The smooth curve through points (n, 3) [m], n of at least 2, along it: a spline of up to fifth degree.

        Raises
        ------
        ArgumentError
            For points that are no table of numbers, are the same twice in a row, or turn back.
        """
        from scipy.interpolate import PPoly, make_interp_spline

        r = checks.numbers(where, points, "Give a table of x, y, z in m, a row a point, along the cable.")
        if r.ndim != 2 or r.shape[1] != 3 or not 2 <= len(r) <= MOST_POINTS:
            bound = f"it must be (n, 3) with n from 2 to {MOST_POINTS}"
            raise ArgumentError.of(where, f"shape {r.shape}", bound, "Give a row a point.")
        if not (np.abs(r) <= 1e6).all():
            raise ArgumentError.of(where, "a number", "they must be finite and below 1e6 m", "Give metres.")
        step = np.diff(r, axis=0)
        chord = np.linalg.norm(step, axis=1)
        if (chord <= 1e-9 * chord.sum()).any():
            i = int(np.argmin(chord))
            bound = f"rows {i} and {i + 1} are the same point"
            raise ArgumentError.of(where, r[i].tolist(), bound, "Leave one of them out.")
        ahead = step / chord[:, None]
        turn = (ahead[1:] * ahead[:-1]).sum(axis=1)
        if len(turn) and turn.min() < -0.2:
            i = int(np.argmin(turn)) + 1
            bound = f"the way turns back at row {i}"
            raise ArgumentError.of(where, r[i].tolist(), bound, "Give points in their order along the cable, and more.")
        s = np.concatenate(([0.0], np.cumsum(chord)))
        degree = min(5, len(r) - 1)
        spline = make_interp_spline(s, r, k=degree)
        x = np.unique(spline.t)
        c = [spline.derivative(m)(x[:-1]) / math.factorial(m) for m in range(degree, 0, -1)]
        return cls(PPoly(np.array([*c, spline(x[:-1])]), x), where)

    # -- what it is at an arc length

    def at(self, s: ArrayLike) -> Array:
        """Positions (n, 3) [m] at arc lengths (n,) [m]."""
        return np.asarray(self._poly(self._parameter(s)))

    def tangents(self, s: ArrayLike) -> Array:
        """Unit tangents (n, 3) at arc lengths (n,) [m]."""
        d: Array = self._slopes[0](self._parameter(s))
        return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))

    def curvatures(self, s: ArrayLike) -> Array:
        """Curvature vectors (n, 3) [1/m], in world axes, at arc lengths (n,) [m]."""
        t = self._parameter(s)
        return self._bends(t)[1]

    def poses(self, s: ArrayLike) -> list[Pose]:
        """Frames at arc lengths (n,) [m], d3 along the curve, which turn as little as they can from the start."""
        at = np.atleast_1d(np.asarray(s, dtype=np.float64))
        q = self._frames_at(_FRAMES)
        cells = len(q) - 1
        i = np.clip(np.rint(at / self.length * cells).astype(int), 0, cells)
        near = _aligned(q[i], self.tangents(at))
        return [Pose(r, quaternion) for r, quaternion in zip(self.at(at), near, strict=True)]

    @property
    def start(self) -> Pose:
        """The frame at the start."""
        return self._end(0)

    @property
    def end(self) -> Pose:
        """The frame at the end."""
        return self._end(-1)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Arc lengths (n,) [m] at which the curve is nearest to points (n, 3) [m], and the distances (n,) [m]."""
        from scipy.spatial import cKDTree

        s = np.linspace(0.0, self.length, 16 * (len(self._parts) - 1) + 1)
        found = s[cKDTree(self.at(s)).query(points)[1]]
        for _ in range(6):
            t = self._parameter(found)
            d, r = self._slopes[0](t), self._poly(t)
            speed = np.linalg.norm(d, axis=1)
            along = ((points - r) * d).sum(axis=1) / speed
            bend = ((points - r) * self._bends(t)[1]).sum(axis=1)
            found = np.clip(found + along / np.maximum(1.0 - bend, 0.2), 0.0, self.length)
        return found, np.linalg.norm(points - self.at(found), axis=1)

    def cut(self, start: float, end: float) -> Centreline:
        """The piece from one arc length [m] to another; the other way round where `start` is the larger."""
        from scipy.interpolate import PPoly

        a, b = (float(t) for t in self._parameter(np.array((min(start, end), max(start, end)))))
        x = self._poly.x
        inner = x[(x > a + 1e-12 * x[-1]) & (x < b - 1e-12 * x[-1])]
        x = np.concatenate(([a], inner, [b]))
        piece = np.clip(np.searchsorted(self._poly.x, 0.5 * (x[1:] + x[:-1]), side="right") - 1, 0, None)
        c = _shifted(self._poly.c[:, piece], x[:-1] - self._poly.x[piece])
        if start > end:
            c = _shifted(c, np.diff(x))[:, ::-1]
            c = c * ((-1.0) ** np.arange(len(c) - 1, -1, -1))[:, None, None]
            x = x[-1] - x[::-1]
        return Centreline(PPoly(c, x))

    # -- what a cable of this form is

    def rest_curvature(self, tolerance: float = TOLERANCE, apart: float = 0.0) -> tuple[Array, float]:
        """(n, 3) [1/m]: a table, linear between its rows, whose rest shape is this curve; in the frames of `poses`.

        tolerance: by how much the rest shape may miss it, as a share of the length; n is as small as that allows, and
        rows are not nearer than `apart` [m] where that leaves nine of them. With it how far [m] it is missed.
        """
        for rows in ROWS:
            if rows > ROWS[0] and self.length < apart * (rows - 1):
                break
            table = self._table(rows)
            missed = self._missed(table)
            if missed <= tolerance * self.length:
                break
        return table, missed

    def crosses_itself(self, within: float) -> tuple[float, float] | None:
        """Two arc lengths [m] at which it comes `within` [m] of itself, from both of which it has gone away between."""
        s = np.linspace(0.0, self.length, _LOOKED_AT)
        r = self.at(s)
        gap = np.linalg.norm(r[:, None] - r, axis=2)
        step = s[1] - s[0]
        far = (s[None, :] - s[:, None]) > np.maximum(np.pi * np.maximum(within, step), 2.0 * gap)
        gap = np.where(far, gap, np.inf)
        i, j = np.unravel_index(int(gap.argmin()), gap.shape)
        return (float(s[i]), float(s[j])) if gap[i, j] < max(within, 0.5 * step) else None

    # -- inside

    def _span(self, a: Array, b: Array) -> Array:
        """Arc lengths (n,) between parameters that lie in one part each."""
        x, w = _NODES, _WEIGHTS
        t = a[:, None] + (b - a)[:, None] * 0.5 * (x + 1.0)
        d = self._slopes[0](t)
        return np.asarray(0.5 * (b - a) * (np.sqrt((d * d).sum(axis=2)) @ w))

    def _parameter(self, s: ArrayLike) -> Array:
        """The parameters of arc lengths, by Newton's method from a linear guess in the part that holds each."""
        s = np.clip(np.asarray(s, dtype=np.float64), 0.0, self.length)
        flat = np.atleast_1d(s).ravel()
        i = np.clip(np.searchsorted(self._s, flat, side="right") - 1, 0, len(self._s) - 2)
        a, b, rest = self._parts[i], self._parts[i + 1], flat - self._s[i]
        t = a + (b - a) * rest / (self._s[i + 1] - self._s[i])
        for _ in range(2):
            d = self._slopes[0](t)
            t = np.clip(t - (self._span(a, t) - rest) / np.maximum(np.sqrt((d * d).sum(axis=1)), 1e-300), a, b)
        return t.reshape(s.shape)

    def _bends(self, t: Array) -> tuple[Array, Array]:
        """Unit tangents and curvature vectors at parameters."""
        d, dd = self._slopes[0](t), self._slopes[1](t)
        square = (d * d).sum(axis=-1, keepdims=True)
        return d / np.sqrt(square), (dd - (dd * d).sum(axis=-1, keepdims=True) / square * d) / square

    def _check_corners(self, where: str) -> None:
        x = self._poly.x[1:-1]
        if not len(x):
            return
        step = 1e-9 * np.diff(self._poly.x)
        before, after = (self._slopes[0](x - step[:-1]), self._slopes[0](x + step[1:]))
        size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        turn = np.linalg.norm(np.cross(before, after), axis=1) / size
        turn = np.where((before * after).sum(axis=1) < 0.0, 2.0, turn)
        worst = int(turn.argmax())
        if turn[worst] > CORNER:
            place = ", ".join(f"{v:.4g}" for v in self._poly(x[worst]))
            raise ArgumentError(
                f"{where}: a corner at ({place}) m, where two pieces meet. No cable bends so: draw an arc between them."
            )

    def _end(self, i: int) -> Pose:
        r = self._poly(self._poly.x[[0, -1]])
        return Pose(r[i], (_first(self.tangents(np.zeros(1))[0]) if i == 0 else self._frames_at(_FRAMES)[i]))

    def _frames_at(self, cells: int) -> Array:
        """Quaternions (cells + 1, 4) of the frames at equal steps of arc length."""
        return self._looked_at(cells)[0]

    def _looked_at(self, cells: int) -> tuple[Array, Array, Array]:
        """At equal steps of arc length: frames (cells + 1, 4), positions, and the integral of u up to there (., 3)."""
        if cells not in self._seen:
            h = self.length / cells
            s = np.concatenate([(np.arange(cells) + share) * h for share in (0.0, *_GAUSS_TWO)])
            t = self._parameter(np.append(s, self.length))
            tangents, bends = self._bends(t)
            around = cross(tangents[cells:-1], bends[cells:-1])
            turn = 0.5 * h * (around[:cells] + around[cells:])
            turn -= math.sqrt(3.0) / 12.0 * h * h * cross(around[:cells], around[cells:])
            nodes: Any = np.append(np.arange(cells), -1)
            q = running(np.concatenate((_first(tangents[0])[None], exponential(turn))), left=True)
            q = _aligned(q, tangents[nodes])
            sums = np.zeros((cells + 1, 3))
            np.cumsum(logarithm(times(conjugate(q[:-1]), q[1:])), axis=0, out=sums[1:])
            sums[:, 2] = 0.0  # these frames do not twist: what is there stems from turns that do not commute
            self._seen[cells] = q, self._poly(t[nodes]), sums
        return self._seen[cells]

    def _table(self, rows: int) -> Array:
        """The L2 projection of the frames' turning onto tables of so many rows.

        The integral of a hat times u is taken by parts, Simpson's rule on the integral of u.
        """
        from scipy.linalg import solveh_banded

        cells = rows - 1
        every = max(_STEPS, _FRAMES // cells)
        sums = self._looked_at(every * cells)[2]
        weight = np.full(every + 1, 4.0)
        weight[2:-1:2] = 2.0
        weight[[0, -1]] = 1.0
        windows = np.lib.stride_tricks.sliding_window_view(sums, every + 1, axis=0)[::every]
        mean = windows @ (weight / weight.sum())
        right = np.zeros((rows, 3))
        right[:-1] += mean
        right[1:] -= mean
        right[-1] += sums[-1]
        h = self.length / cells
        band = np.empty((2, rows))
        band[0], band[1] = h / 6.0, 2.0 * h / 3.0
        band[1, [0, -1]] = h / 3.0
        return np.asarray(solveh_banded(band, right))

    def _missed(self, table: Array) -> float:
        """[m], largest distance between the curve and the rest shape of a table, both from the start's frame."""
        cells = len(table) - 1
        steps = max(2, min(4, 256 // cells))
        line = self._looked_at(max(_STEPS, _FRAMES // cells) * cells)[1]
        r = rest_shape(table, self.length, self.start, steps)[0]
        return float(np.linalg.norm(r - line[:: (len(line) - 1) // (len(r) - 1)], axis=1).max())


def rest_shape(table: Array, length: float, start: Pose, steps: int = 4) -> tuple[Array, Array]:
    """Positions (m, 3) [m] and frames (m, 4) of a cable with this rest curvature (n, 3) [1/m], `steps` a row."""
    cells = steps * (len(table) - 1)
    share = (np.arange(steps) / steps)[None, :, None]
    u = np.concatenate(((table[:-1, None] + share * np.diff(table, axis=0)[:, None]).reshape(-1, 3), table[-1:]))
    r, q = form(np.full(cells, length / cells), u[:-1], u[1:], start.quaternion)
    return start.position + r, q


def _shifted(c: Array, by: Array) -> Array:
    """Coefficients (k + 1, m, 3) of polynomials whose arguments begin `by` (m,) later."""
    out = c.copy()
    for i in range(1, len(c)):
        for j in range(1, len(c) - i + 1):
            out[j] += out[j - 1] * by[:, None]
    return out


def _first(t: Array) -> Array:
    """A quaternion (4,) whose third axis is t, turned least from the world's."""
    if t[2] < -0.999999:
        return np.array((1.0, 0.0, 0.0, 0.0))
    q = np.array((-t[1], t[0], 0.0, 1.0 + t[2]))
    return np.asarray(q / np.linalg.norm(q))


def _aligned(q: Array, t: Array) -> Array:
    """Quaternions turned by the least that brings their third axes onto t (n, 3), which are near."""
    d = third_axis(q)
    least: Any = np.concatenate((cross(d, t), 1.0 + (d * t).sum(axis=1, keepdims=True)), axis=1)
    return np.asarray(times(least / np.linalg.norm(least, axis=1, keepdims=True), q))
