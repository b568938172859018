"""Meshes of solids that are not convex, and how far points are off them, by means of numpy alone."""

from __future__ import annotations

import numpy as np

import cable_shape as cs

#: Of an L in the plane of x and z, its inner corner at (0.05, 0.05), and of a channel, open at the top: corners, and
#: triangles that fill it.
L_SHAPE = (
    [(0, 0), (0.3, 0), (0.3, 0.05), (0.05, 0.05), (0.05, 0.3), (0, 0.3)],
    [(0, 1, 3), (1, 2, 3), (0, 3, 4), (0, 4, 5)],
)
CHANNEL = (
    [(-0.1, 0), (0.1, 0), (0.1, 0.12), (0.05, 0.12), (0.05, 0.04), (-0.05, 0.04), (-0.05, 0.12), (-0.1, 0.12)],
    [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)],
)


def drawn_out(profile, width):
    """A profile in the plane of x and z as a solid from -width / 2 to width / 2 along y, outward triangles."""
    corners, filled = profile
    n = len(corners)
    vertices = [(x, side * width / 2, z) for side in (-1, 1) for x, z in corners]
    faces = [face for a, b, c in filled for face in ((a, b, c), (a + n, c + n, b + n))]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, i + n, j), (j, i + n, j + n)]
    return cs.Mesh(vertices, faces)


def ring(radius, thick, around=32, across=12):
    """A torus about z."""
    u, w = np.meshgrid(*(np.arange(k) * 2 * np.pi / k for k in (around, across)), indexing="ij")
    out = radius + thick * np.cos(w)
    vertices = np.stack((out * np.cos(u), out * np.sin(u), thick * np.sin(w)), axis=-1).reshape(-1, 3)
    a, b = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    c, d = (a + 1) % around, (b + 1) % across
    corners = [x * across + y for x, y in ((a, b), (c, b), (c, d), (a, d))]
    faces = np.concatenate([np.stack([corners[k].ravel() for k in pick], axis=1) for pick in ((0, 1, 2), (0, 2, 3))])
    return cs.Mesh(vertices, faces)


def off_profile(profile, points):
    """(n,) [m], how far points (n, 2) of the plane are outside a polygon, negative inside."""
    corners = np.array(profile[0], dtype=float)
    nearest, crossings = np.full(len(points), np.inf), np.zeros(len(points), dtype=int)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
        over = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        at = a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1] if a[1] != b[1] else 1.0)
        crossings += over & (points[:, 0] < at)
    return np.where(crossings % 2 == 1, -nearest, nearest)
