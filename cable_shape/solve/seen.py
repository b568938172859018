"""What was seen of a cable: the smooth path through its points, :func:`seen_of`, and a shape on it, :func:`laid_on`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, multiply, rotate
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.solve.cables import FREE_ROTATIONS
from cable_shape.solve.rod_common import MODEL

_ALONG = np.array((0.0, 0.0, 1.0))
_TWO_PI = 2.0 * math.pi
#: Of the length: so far a path is run on straight beyond its ends.
_FAR = 100.0


class Seen(NamedTuple):
    """A path through what was seen, and how fast it moves."""

    places: CubicSpline
    velocity: CubicSpline
    apart: float  # m, mean arc length between points


def seen_of(
    start: Grip, end: Grip | FreeEnd, length: float, arc_length: ArrayLike | None, points: ArrayLike,
    velocity: ArrayLike | None,
) -> Seen:  # fmt: skip
    """The smooth path from grip to grip through points (k, 3), and velocities (k, 3) along it.

    arc_length (k,) [m], ascending; None: as their distances share the length, of a free end as far apart as they are.
    """
    r = _rows("points", points, None, "m")
    known = [start.cable_frame.position, *r]
    held = isinstance(end, Grip)
    if isinstance(end, Grip):
        known.append(end.cable_frame.position)
    if arc_length is None:
        chords = np.linalg.norm(np.diff(known, axis=0), axis=1)
        share = length / chords.sum()  # of a free end it is not known what lies beyond the last point
        s = (np.cumsum(chords) * (share if held else min(share, 1.0)))[: len(r)]
    else:
        s = checks.vector("arc_length", arc_length, len(r), "m")
        if not (np.diff(s) > 0.0).all() or s[0] < 0.0 or s[-1] > length:
            bound = f"it must ascend from 0 to at most the length of the cable, {length:g} m"
            raise ArgumentError.of("arc_length", s.tolist(), bound, "Give that of each point, from the start grip on.")
    v = np.zeros_like(r) if velocity is None else _rows("velocity", velocity, len(r), "m/s")
    inside = (s > 1e-6 * length) & ((s < (1.0 - 1e-6) * length) | (not held))
    s, r, v = s[inside], r[inside], v[inside]
    if s.size == 0:
        raise ArgumentError.of("points", len(r), "none is between the ends", "Give at least one.")
    at = np.concatenate(([0.0], s, [length] if held else []))
    bounds = [_tangent(start), _tangent(end) if isinstance(end, Grip) else None]
    sides = [(2, np.zeros(3)) if t is None else (1, t) for t in bounds]
    rate = CubicSpline(s, v) if s.size > 1 else CubicSpline(at[[0, -1]], v[[0, 0]])
    kept = np.array([True, *inside, *[True] * held])
    return Seen(CubicSpline(at, np.array(known)[kept], bc_type=tuple(sides)), rate, length / s.size)


def laid_on(seen: Seen, start: Grip, end: Grip | FreeEnd, length: float, points: int, turns: int = 0) -> CableShape:
    """A shape without loads on the path of a cable of this length [m], as a start: it is no equilibrium.

    Its frames twist evenly from grip to grip, by less than half a turn and `turns` more; not at all where an end may
    turn about the cable.
    """
    s = np.linspace(0.0, length, points)
    places, tangents = seen.places(s), seen.places(s, 1)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    q = np.empty((points, 4))
    q[0] = multiply(_turned(rotate(start.cable_frame.quaternion, _ALONG), tangents[0]), start.cable_frame.quaternion)
    for i in range(1, points):
        q[i] = multiply(_turned(tangents[i - 1], tangents[i]), q[i - 1])
    twist = 0.0
    if isinstance(end, Grip) and not (FREE_ROTATIONS[start.kind][2] or FREE_ROTATIONS[end.kind][2]):
        _, _, z, w = multiply(q[-1] * (-1.0, -1.0, -1.0, 1.0), end.cable_frame.quaternion)
        twist = math.remainder(2.0 * math.atan2(z, w), _TWO_PI) + _TWO_PI * turns
    half = 0.5 * twist * s / length
    none = np.zeros(points)
    buffer = np.zeros(NUMBERS_PER_POINT * points)
    buffer[:points], buffer[points : 4 * points] = s, places.ravel()
    buffer[4 * points : 8 * points] = multiply(q.T, np.array((none, none, np.sin(half), np.cos(half)))).T.ravel()
    return CableShape(buffer, points, length=length, model=MODEL, status=Status.OK, twist=twist)


def turns_of(shape: CableShape) -> int:
    """How many times the end of a shape has been turned right-handed, as the `turns` of its pose count it.

    By its twist and the writhe of its centreline, run on straight beyond both ends: their sum is the angle between the
    frames of the ends, and whole turns (Calugareanu, White, Fuller).
    """
    x, y, z, w = shape.quaternions[0]
    _, _, c, d = multiply(np.array((-x, -y, -z, w)), shape.quaternions[-1])
    angle = 2.0 * math.atan2(c, d) if d >= 0.0 else 2.0 * math.atan2(-c, -d)
    far = _FAR * shape.length
    first, last = shape.positions[0] - far * shape.tangents[0], shape.positions[-1] + far * shape.tangents[-1]
    return round((shape.twist - angle) / _TWO_PI + writhe(np.vstack((first, shape.positions, last))))


def writhe(points: Array) -> float:
    """[1], of the polygon through points (n, 3): crossings seen, right-handed less left-handed, mean over all views.

    Each pair of edges is seen to cross in a solid angle that is a spherical quadrangle (Klenin and Langowski 2000).
    """
    i, j = np.triu_indices(len(points) - 1, 2)
    a, b, c, d = points[i], points[i + 1], points[j], points[j + 1]
    sides = [np.cross(c - a, d - a), np.cross(d - a, d - b), np.cross(d - b, c - b), np.cross(c - b, c - a)]
    sizes = [np.linalg.norm(side, axis=1) for side in sides]
    good = np.min(sizes, axis=0) > 0.0
    n = [side[good] / size[good, None] for side, size in zip(sides, sizes, strict=True)]
    area = sum(np.arcsin(np.clip((n[k] * n[(k + 1) % 4]).sum(axis=1), -1.0, 1.0)) for k in range(4))
    sign = np.sign((np.cross(d - c, b - a) * (c - a)).sum(axis=1)[good])
    return float((area * sign).sum() / _TWO_PI)


def _turned(a: Array, b: Array) -> Array:
    """(4,), the quaternion of the least rotation that takes the unit vector a to b."""
    w = 1.0 + float(a @ b)
    axis = np.cross(a, b) if w > 1e-12 else np.cross(a, np.eye(3)[np.abs(a).argmin()])
    q = np.array((*axis, w))
    return np.asarray(q / np.linalg.norm(q))


def _tangent(grip: Grip) -> Array | None:
    """(3,), where the grip gives it."""
    return None if grip.kind == "pinned" else rotate(grip.cable_frame.quaternion, _ALONG)


def _rows(name: str, values: ArrayLike, rows: int | None, unit: str) -> Array:
    """(k, 3), finite."""
    remedy = f"Give rows of three finite numbers in {unit}."
    a = checks.numbers(name, values, remedy)
    if a.ndim != 2 or a.shape[1] != 3 or len(a) == 0 or not (np.abs(a) <= checks.MOST).all():
        raise ArgumentError.of(name, f"shape {a.shape}", "it must be (k, 3), of finite numbers", remedy)
    if rows is not None and len(a) != rows:
        raise ArgumentError.of(name, f"{len(a)} rows", f"it must have as many as points, {rows}", remedy)
    return a
