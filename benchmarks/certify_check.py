"""A certificate of shapes from their own numbers, many at once in numpy: nothing of the solver's code takes part.

Of a shape it takes places r, frames q, forces n and moments m at its points, of the cable its stiffness, rest
curvature, weight and masses, and where the ends are to be. From point to point

    r' = R V,   q' = q (0, k) / 2,   m' = n x r',   n' = -w,    V = e3 + C R^T n,   k = k0 + K^-1 R^T m

are integrated by a symmetric rule of sixth order (first, second and third derivatives at both points; its error is
h^7 y^(7) / 100,800). What is left over in each interval, together with what is left at the ends, is the right-hand side
of the linearised equations. Their answer, one Newton step in linear finite elements on the shape's points, says how far
the exact equilibrium is from the shape, in metres, newtons and newton metres. The matrix of that step is the second
variation of the energy: the equilibrium is a minimum where it has three negative eigenvalues, one for each component
of the force that holds the ends together. `reserve` takes a share of the stiffness off the second variation, so that
a shape is called stable only with so much to spare, whatever the elements' length does to the eigenvalues.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from certify_reduction import product, solve

Array = np.ndarray
#: Ends hold all rotation, leave that about the tangent, leave all, or all but that about the tangent.
CLAMPED, SWIVEL, PINNED, NO_ROLL = range(4)


class Shapes(NamedTuple):
    """k shapes of n points each; SI units, world axes unless said otherwise."""

    length: Array  # (k,)
    weight: Array  # (k, 3) load per length
    stiffness: Array  # (k, 3) EI1, EI2, GJ
    compliance: Array  # (k, 3) 1/GA, 1/GA, 1/EA; 0: rigid
    rest: Array  # (k, 3) rest curvature at the start, cable frame
    slope: Array  # (k, 3) its derivative
    ends: Array  # (k, 2, 7) where the ends are to be
    kinds: Array  # (k, 2) CLAMPED, SWIVEL, PINNED or NO_ROLL
    r: Array  # (k, n, 3)
    q: Array  # (k, n, 4)
    curvature: Array  # (k, n, 3)
    n: Array  # (k, n, 3)
    m: Array  # (k, n, 3)
    masses: Array | None = None  # (k, n, 3) weights at points; None: nowhere


class Certificate(NamedTuple):
    """What was found of k shapes."""

    away: Array  # (k,) [m], estimated largest distance from the exact equilibrium
    force: Array  # (k,) [N], estimated error of the force
    moment: Array  # (k,) [N m], estimated largest error of the moment
    stable: Array  # (k,) bool: the second variation is positive, with the reserve
    balance: Array  # (k,) largest deviation of the force from its balance / largest force or weight
    law: Array  # (k,) largest deviation of the moment from the law of the material / largest moment
    frames: Array  # (k,) largest deviation of the held directions at the ends, and of |q| from 1
    turn: Array  # (k,) [rad], most that a frame turns from point to point
    layers: Array  # (k,) spacing of the points / shortest boundary layer


def cross(a: Array, b: Array) -> Array:
    """Of vectors (3, ...)."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))


def dot(a: Array, b: Array) -> Array:
    """Of vectors (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Array) -> Array:
    """Of vectors (3, ...)."""
    return np.sqrt(dot(a, a))


def turned(R: Array, a: Array) -> Array:
    """R a of matrices (3, 3, ...)."""
    return np.einsum("ij...,j...->i...", R, a)


def turned_back(R: Array, a: Array) -> Array:
    """R^T a of matrices (3, 3, ...)."""
    return np.einsum("ji...,j...->i...", R, a)


def skew(a: Array) -> Array:
    """(3, 3, ...) with skew(a) b = a x b."""
    zero = np.zeros_like(a[0])
    return np.stack((
        np.stack((zero, -a[2], a[1])),
        np.stack((a[2], zero, -a[0])),
        np.stack((-a[1], a[0], zero)),
    ))  # fmt: skip


def matrices(q: Array) -> Array:
    """(3, 3, ...) of quaternions (4, ...), whose columns are d1, d2, d3."""
    x, y, z, w = q
    return np.stack((
        np.stack((1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w))),
        np.stack((2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w))),
        np.stack((2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y))),
    ))  # fmt: skip


def times(q: Array, a: Array) -> Array:
    """q (a, 0) of quaternions (4, ...) and vectors (3, ...)."""
    return np.concatenate((q[3] * a + cross(q[:3], a), -dot(q[:3], a)[None]))


class _Side(NamedTuple):
    """At all points, beside a mass on one side of it: derivatives by arc length, and the force."""

    n: Array
    r: tuple[Array, Array, Array]
    q: tuple[Array, Array, Array]
    m: tuple[Array, Array, Array]


class _Points(NamedTuple):
    """What does not depend on the side of a mass."""

    s: Array  # (n,) shares of the length
    h: Array  # (k, 1) m
    R: Array
    q: Array
    m: Array
    k: Array  # (3, k, n) curvature by the law
    K: Array  # (3, k, 1)
    C: Array
    slope: Array
    w: Array


def _first(a: Array) -> Array:
    """(k, n, c) or (k, c) with its components first, (c, k, n) or (c, k, 1)."""
    return np.ascontiguousarray(np.moveaxis(a, 2, 0)) if a.ndim == 3 else a.T[:, :, None].copy()


def _points(shapes: Shapes) -> _Points:
    count = shapes.r.shape[1]
    q = _first(shapes.q)
    q[:, :, 1:] *= np.cumprod(np.sign((q[:, :, 1:] * q[:, :, :-1]).sum(axis=0)), axis=1)
    s = np.linspace(0.0, 1.0, count)
    R, m, K = matrices(q), _first(shapes.m), _first(shapes.stiffness)
    slope = _first(shapes.slope)
    rest = _first(shapes.rest) + slope * (s * shapes.length[:, None])
    k = rest + turned_back(R, m) / K
    h = shapes.length[:, None] / (count - 1)
    return _Points(s, h, R, q, m, k, K, _first(shapes.compliance), slope, _first(shapes.weight))


def _side(at: _Points, n: Array) -> _Side:
    """Three derivatives of places, frames and moments, from the equations alone."""
    R, k, K, C = at.R, at.k, at.K, at.C
    p = turned_back(R, np.broadcast_to(-at.w, n.shape))
    N = turned_back(R, n)
    N1 = p - cross(k, N)
    V, V1 = C * N, C * N1
    V[2] += 1.0
    a = V1 + cross(k, V)  # R^T r''
    r1, r2 = turned(R, V), turned(R, a)
    m1 = cross(n, r1)
    m2 = cross(n, r2) - cross(at.w, r1)
    M = turned_back(R, at.m)
    X = turned_back(R, m1)
    M1 = X - cross(k, M)
    k1 = at.slope + M1 / K
    N2 = -cross(k, p) - cross(k1, N) - cross(k, N1)
    r3 = turned(R, C * N2 + cross(k1, V) + cross(k, V1) + cross(k, a))
    m3 = cross(n, r3) - 2.0 * cross(at.w, r2)
    k2 = (turned_back(R, m2) - cross(k, X) - cross(k1, M) - cross(k, M1)) / K
    q1 = 0.5 * times(at.q, k)
    q2 = 0.5 * (times(q1, k) + times(at.q, k1))
    q3 = 0.5 * (times(q2, k) + 2.0 * times(q1, k1) + times(at.q, k2))
    return _Side(n, (r1, r2, r3), (q1, q2, q3), (m1, m2, m3))


def _left_over(y: Array, h: Array, after: tuple[Array, ...], before: tuple[Array, ...]) -> Array:
    """Of each interval: the difference of y, less what its derivatives at both points make of it."""
    (a1, a2, a3), (b1, b2, b3) = ([d[:, :, :-1] for d in after], [d[:, :, 1:] for d in before])
    whole = h / 2.0 * (a1 + b1) + h**2 / 10.0 * (a2 - b2) + h**3 / 120.0 * (a3 + b3)
    return y[:, :, 1:] - y[:, :, :-1] - whole


def _forces(shapes: Shapes, at: _Points) -> tuple[Array, Array, Array]:
    """After and before the masses, by the balance from the first point on; and how far the shape is off it."""
    given = _first(shapes.n)
    steady = given[:, :, :1] - at.w * (at.s * shapes.length[:, None])
    scale = np.maximum(norm(given).max(axis=1), norm(at.w[:, :, 0]) * shapes.length)
    if shapes.masses is None:
        return steady, steady, norm(given - steady).max(axis=1) / scale
    jumps = _first(shapes.masses)
    after = steady - np.cumsum(jumps, axis=2)
    before = after + jumps
    off = np.minimum(norm(given - after), norm(given - before))
    return after, before, off.max(axis=1) / scale


def _tensor(R: Array, a: Array) -> Array:
    """R diag(a) R^T."""
    return np.einsum("ij...,j...,cj...->ic...", R, np.broadcast_to(a, (3, *R.shape[2:])), R)


def _second(at: _Points, side: _Side, elastic: bool) -> tuple[Array, Array, Array | None]:
    """What multiplies theta twice, theta and the change of the force, and this twice."""
    n, v = side.n, side.r[0]
    nv = n[:, None] * v[None]
    P = -0.5 * (nv + nv.transpose(1, 0, 2, 3))
    for i in range(3):
        P[i, i] += dot(n, v)
    G = -skew(v)
    if not elastic:
        return P, G, None
    C, N = _tensor(at.R, at.C), skew(n)
    NC = product(N, C)
    return P + product(NC, N), G + NC, C


def certify(shapes: Shapes, reserve: float = 0.0) -> Certificate:
    """The certificates of these shapes."""
    with np.errstate(all="ignore"):
        return _certify(shapes, reserve)


def _certify(shapes: Shapes, reserve: float) -> Certificate:
    at, rows = _points(shapes), len(shapes.r)
    h, r = at.h, _first(shapes.r)
    n_after, n_before, balance = _forces(shapes, at)
    after = _side(at, n_after)
    before = after if n_before is n_after else _side(at, n_before)
    e_r = _left_over(r, h, after.r, before.r)
    e_m = _left_over(at.m, h, after.m, before.m)
    d_q = _left_over(at.q, h, after.q, before.q)
    q = at.q[:, :, 1:]
    e_q = 2.0 * (q[3] * d_q[:3] - d_q[3] * q[:3] + cross(q[:3], d_q[:3]))  # the vector of 2 dq q^-1

    # the second variation: theta turns the frames of the points, linear between them
    elastic = bool(np.any(shapes.compliance))
    P_a, G_a, C = _second(at, after, elastic)
    P_b, G_b, _ = (P_a, G_a, C) if before is after else _second(at, before, elastic)
    P_a, G_a, P_b, G_b = P_a[..., :-1], G_a[..., :-1], P_b[..., 1:], G_b[..., 1:]
    K = _tensor(at.R, at.K)
    K = 0.5 * (K[..., :-1] + K[..., 1:])
    m = 0.5 * (at.m[..., :-1] + at.m[..., 1:])
    stiff = (1.0 - reserve) / h * K
    D = np.zeros((3, 3, *at.m.shape[1:]))
    D[..., :-1] += stiff + (5.0 / 12.0) * h * P_a
    D[..., 1:] += stiff + (5.0 / 12.0) * h * P_b
    U = 0.5 * skew(m) - stiff + h / 24.0 * (P_a + P_b)
    B = np.zeros((3, 4, *at.m.shape[1:]))
    B[:, :3, :, :-1] += 0.5 * h * G_a
    B[:, :3, :, 1:] += 0.5 * h * G_b
    bent = turned(K, e_q) / h
    B[:, 3, :, :-1] += 0.5 * e_m + bent
    B[:, 3, :, 1:] += 0.5 * e_m - bent
    S = np.zeros((3, 4, rows))
    if C is not None:
        S[:, :3] = -h[:, 0] * (C.sum(axis=3) - 0.5 * (C[..., 0] + C[..., -1]))
    off_start = shapes.ends[:, 0, :3].T - r[:, :, 0]
    off_end = shapes.ends[:, 1, :3].T - r[:, :, -1]
    S[:, 3] = off_start - off_end - e_r.sum(axis=2)
    B[:, 3, :, 0] += at.m[:, :, 0]
    B[:, 3, :, -1] -= at.m[:, :, -1]
    frames = _hold(shapes, at, D, U, B)
    theta, change, negative = solve(D, U, B, S)

    # how far that is
    mu = change.T[:, :, None]
    part = [cross(theta[..., k], side.r[0][..., k]) for side, k in ((after, slice(-1)), (before, slice(1, None)))]
    if C is not None:
        more = [
            turned(C[..., k], mu - cross(theta[..., k], side.n[..., k]))
            for side, k in ((after, slice(-1)), (before, slice(1, None)))
        ]
        part = [a + b for a, b in zip(part, more, strict=True)]
    steps = 0.5 * h * (part[0] + part[1]) - e_r
    moved = off_start[:, :, None] + np.concatenate((np.zeros((3, rows, 1)), np.cumsum(steps, axis=2)), axis=2)
    mean = 0.5 * (theta[..., :-1] + theta[..., 1:])
    moment = turned(K, np.diff(theta, axis=2) + e_q) / h + cross(mean, m)
    stiffness = shapes.stiffness[:, :2].min(axis=1)
    largest = np.maximum(norm(n_after).max(axis=1), norm(n_before).max(axis=1))
    law = norm(at.K * (_first(shapes.curvature) - at.k)).max(axis=1) / norm(at.m).max(axis=1)
    unit = np.abs(norm_4(at.q) - 1.0).max(axis=1)
    return Certificate(
        norm(moved).max(axis=1),
        np.linalg.norm(change, axis=1),
        norm(moment).max(axis=1),
        negative == 3,
        balance,
        law,
        np.maximum(frames, unit),
        (norm(at.k) * h).max(axis=1),
        h[:, 0] * np.sqrt(largest / stiffness),
    )


def norm_4(q: Array) -> Array:
    """Of quaternions (4, ...)."""
    return np.sqrt((q * q).sum(axis=0))


def _hold(shapes: Shapes, at: _Points, D: Array, U: Array, B: Array) -> Array:
    """Takes out of the system what the ends hold; how far the held directions of the shape are from there."""
    rows = len(shapes.r)
    worst = np.zeros(rows)
    for end, point in ((0, 0), (1, -1)):
        kind = shapes.kinds[:, end]
        R, asked = at.R[:, :, :, point], matrices(shapes.ends[:, end, 3:].T)
        d3 = R[:, 2]
        along = d3[:, None] * d3[None]
        one = np.eye(3)[:, :, None]
        free = np.where(kind == SWIVEL, along, np.where(kind == PINNED, one, np.where(kind == NO_ROLL, one - along, 0)))
        off = np.abs(R - asked)
        worst = np.maximum(worst, np.where(kind == CLAMPED, off.max(axis=(0, 1)), 0.0))
        worst = np.maximum(worst, np.where(kind == SWIVEL, off[:, 2].max(axis=0), 0.0))
        held = np.abs(np.trace(D[:, :, :, point])) * (one - free)
        D[:, :, :, point] = product(product(free, D[:, :, :, point]), free) + held
        B[:, :, :, point] = product(free, B[:, :, :, point])
        if end == 0:
            U[..., 0] = product(free, U[..., 0])
        else:
            U[..., -1] = product(U[..., -1], free)
    return worst
