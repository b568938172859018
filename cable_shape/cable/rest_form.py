"""The form that a cable has at rest, without load, and turns of many frames at once.

R' = R hat(u) with u linear in each step by Magnus' fourth order method (S. Blanes, F. Casas, J. A. Oteo and J. Ros, The
Magnus expansion and some of its applications, Physics Reports 470, 2009), positions by Simpson's rule. Quaternions are
x, y, z, w.
"""

from __future__ import annotations

import numpy as np

from cable_shape.checks import Array


def form(h: Array, left: Array, right: Array, first: Array) -> tuple[Array, Array]:
    """Positions (n + 1, 3) from the origin, and frames (n + 1, 4) from `first` (4,), after steps of length h (n,).

    left, right: (n, 3) [1/m], the Darboux vector where each step begins and ends.
    """
    middle = 0.5 * (left + right)
    h = h[:, None]
    halves = np.empty((2 * len(h), 3))  # linear in each half, so the two ends of one say all
    halves[::2] = 0.25 * h * (left + middle) + 0.25 * h * h / 12.0 * cross(left, middle)
    halves[1::2] = 0.25 * h * (middle + right) + 0.25 * h * h / 12.0 * cross(middle, right)
    q = running(np.concatenate((first[None], exponential(halves))), left=False)
    t = third_axis(q)
    moved = h / 6.0 * (t[:-1:2] + 4.0 * t[1::2] + t[2::2])
    return np.concatenate((np.zeros((1, 3)), np.cumsum(moved, axis=0))), q[::2]


def cross(a: Array, b: Array) -> Array:
    """Vector products (n, 3); numpy's own takes three times as long."""
    out = np.empty_like(a)
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


def running(q: Array, left: bool) -> Array:
    """Products of the first, the first two, the first three ... quaternions (n, 4); `left`: each before the last."""
    shift = 1
    while shift < len(q):
        pair = (q[shift:], q[:-shift]) if left else (q[:-shift], q[shift:])
        q = np.concatenate((q[:shift], times(*pair)))
        shift *= 2
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def times(p: Array, q: Array) -> Array:
    """Hamilton products of quaternions (n, 4)."""
    px, py, pz, pw = p.T
    qx, qy, qz, qw = q.T
    return np.stack(
        (
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ), axis=1,
    )  # fmt: skip


def conjugate(q: Array) -> Array:
    """Inverse turns (n, 4)."""
    return np.asarray(q * np.array((-1.0, -1.0, -1.0, 1.0)))


def exponential(turn: Array) -> Array:
    """Quaternions of rotation vectors (n, 3) [rad]."""
    half = 0.5 * np.linalg.norm(turn, axis=1, keepdims=True)
    return np.concatenate((0.5 * np.sinc(half / np.pi) * turn, np.cos(half)), axis=1)


def logarithm(q: Array) -> Array:
    """Rotation vectors (n, 3) [rad] of quaternions, the shorter way round."""
    q = np.where(q[:, 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    return np.asarray(
        q[:, :3] * np.where(sine > 1e-12, 2.0 * np.arctan2(sine, q[:, 3:]) / np.maximum(sine, 1e-12), 2.0)
    )


def third_axis(q: Array) -> Array:
    """(n, 3), d3 of frames."""
    x, y, z, w = q.T
    return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)


def turned(q: Array, v: Array) -> Array:
    """Vectors (n, 3) turned by quaternions (n, 4), or all by one (1, 4)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, v)
    return np.asarray(v + w * t + np.cross(u, t))
