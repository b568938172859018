"""A bound on length: a band drawn tight between grips, through clips and on its side of all bodies.

The band is a polygon whose corners stay out of the bodies. Of the same number of corners, evenly spaced on the shortest
way that there is, such a polygon is no longer than that way; so the shortest polygon is no longer, and a cable that is
shorter has no shape.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scene_certificate import Array, signed, thickness
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

import cable_shape as cs

POINTS = 201  # of the band
#: Of the cable's length: nodes nearer to a body have a plane there; how far ends go at once; a step in which no node
#: goes further is the last; how much longer than the cable the band must be.
REACH, PULLED, SETTLED, LONGER = 0.2, 0.02, 1e-6, 2e-5
STEPS, WHOLE, PART = 400, 60, 0.3  # at most; after so many a step goes this part of its way: it may go in circles
NEAR = 0.5  # of half a body's thickness and the cable's: how far a node goes in a step
#: How firm planes are, of the springs between nodes; how often it is looked at which are pressed, and how often all
#: that are wrong change together.
FIRM, SETS, TOGETHER = 1e6, 100, 8
DIFFERENCE = 1e-6  # m
Body = tuple[object, Array, Array]  # a solid, where it is [m], and its axes (3, 3)
Planes = tuple[Array, Array, Array]  # of which nodes (k,), normals (k, 3), and how far along these nodes must be [m]


def planes(bodies: list[Body], radius: float, reach: float, x: Array) -> Planes:
    """At the points of convex bodies that are nearest to nodes (n, 3) less than `reach` [m] away, `radius` off them:
    who is in front of such a plane is out of the body."""
    which: list[Array] = [np.empty(0, dtype=int)]
    normals: list[Array] = [np.empty((0, 3))]
    offsets: list[Array] = [np.empty(0)]
    for solid, place, axes in bodies:
        p = (x - place) @ axes
        gap = signed(solid, p.copy()) - radius
        near = np.flatnonzero(gap < reach)
        beside = p[near, None, :] + DIFFERENCE * np.concatenate((np.eye(3), -np.eye(3)))
        sides = signed(solid, beside.reshape(-1, 3)).reshape(-1, 2, 3)
        normal = (sides[:, 0] - sides[:, 1]) @ axes.T
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        which.append(near)
        normals.append(normal)
        offsets.append((normal * x[near]).sum(axis=1) - gap[near])
    return np.concatenate(which), np.concatenate(normals), np.concatenate(offsets)


def drawn_once(x: Array, held: Array, found: Planes) -> Array:
    """(n, 3): the nodes of least sum of squares from each to the next, in front of their planes; `held` (k,) stay."""
    which, normals, offsets = found
    pressed = (normals * x[which]).sum(axis=1) < offsets + 1e-9
    out = x
    for i in range(SETS):
        band = np.zeros((4, x.size))
        band[0, 3:], band[3] = -1.0, 2.0
        right = np.zeros_like(x)
        k, n = which[pressed], normals[pressed]
        for a in range(3):
            for b in range(a, 3):
                np.add.at(band[3 - (b - a)], 3 * k + b, FIRM * n[:, a] * n[:, b])
        np.add.at(right, k, FIRM * offsets[pressed, None] * n)
        inner = held[(held > 0) & (held < len(x) - 1)]
        right[np.append(inner, 0) + 1] += x[np.append(inner, 0)]
        right[np.append(inner, len(x) - 1) - 1] += x[np.append(inner, len(x) - 1)]
        own = (3 * held[:, None] + np.arange(3)).ravel()
        band[:, own], band[3, own], right[held] = 0.0, 1.0, x[held]
        band[0, (own + 3)[own + 3 < x.size]] = 0.0
        out = solveh_banded(band, right.reshape(-1)).reshape(-1, 3)
        behind = offsets - (normals * out[which]).sum(axis=1)  # a pressed plane gives way a little
        wrong = (behind > 0.0) != pressed
        if not wrong.any():
            break
        if i > TOGETHER:
            amiss = np.where(wrong, np.abs(behind) * np.where(pressed, FIRM, 1.0), 0.0)
            wrong = amiss == amiss.max()
        pressed ^= wrong
    return out


class Band:
    """The cable of one motion as a band, drawn tight only where nothing else tells whether the cable is too short."""

    def __init__(self, cable: cs.Cable, scene: cs.Scene, clips: list[cs.Clip]) -> None:
        self.cable, self.scene, self.clips = cable, scene, clips
        self.shape: cs.CableShape | None = None
        self._drawn: tuple[cs.Pose, cs.Pose, Array, float] | None = None  # where it was last, and what it lacked

    def lie(self, shape: cs.CableShape) -> None:
        """From here it is drawn: the side of the bodies on which the cable is."""
        self.shape, self._drawn = shape, None

    def too_short(self, start: cs.Pose, end: cs.Pose) -> bool:
        """Whether the cable is shorter than the shortest way into which its last shape can be drawn between these
        grips: a way changes by no more than its ends are moved."""
        if self.shape is None:
            return False
        least = LONGER * self.cable.length
        if self._drawn is not None:
            was = self._drawn
            moved = math.dist(start.position, was[0].position) + math.dist(end.position, was[1].position)
            if abs(was[3] - least) > moved:
                return was[3] > least
        x = None if self._drawn is None else self._drawn[2]
        x, lacks = drawn(self.cable, self.scene, self.clips, self.shape, start, end, x)
        if math.isfinite(lacks):
            self._drawn = start, end, x, lacks
        return lacks > least


def drawn(
    cable: cs.Cable, scene: cs.Scene, clips: list[cs.Clip], last: cs.CableShape, start: cs.Pose, end: cs.Pose,
    band: Array | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """The last shape, or a `band` (n, 3) as it was drawn before, drawn tight between these grips.

    Returns it and what the cable lacks [m], below 0 what it has to spare, between those two supports in which it does
    not slide where that is most; -inf where the band has not settled.
    """
    bodies = [
        (body.solid, np.array(body.pose.position), Rotation.from_quat(body.pose.quaternion).as_matrix())
        for body in scene.obstacles
    ]
    length, radius = cable.length, 0.5 * cable.diameter
    x = last.positions if band is None else band
    marks = [int(np.linalg.norm(x - clip.pose.position, axis=1).argmin()) / (len(x) - 1) for clip in clips]
    at = np.linspace(0.0, 1.0, POINTS)
    x = np.stack([np.interp(at, np.linspace(0.0, 1.0, len(x)), c) for c in x.T], axis=1)
    where = np.rint(np.array([0.0, *marks, 1.0]) * (POINTS - 1)).astype(int)
    goal = np.array([pose.position for pose in (start, *[clip.pose for clip in clips], end)])
    furthest = NEAR * min([thickness(body.solid) for body in scene.obstacles] + [0.2 * length]) + NEAR * radius
    settled = False
    for i in range(STEPS):
        left = goal - x[where]
        far = float(np.linalg.norm(left, axis=1).max())
        x[where] += left * min(1.0, PULLED * length / max(far, 1e-300))
        there = far <= PULLED * length
        step = drawn_once(x, where, planes(bodies, radius, REACH * length, x)) - x
        most = float(np.linalg.norm(step, axis=1).max())
        x += step * min(1.0 if i < WHOLE else PART, furthest / max(most, 1e-300))
        settled = there and most < SETTLED * length
        if settled:
            break
    if not settled:
        return x, -math.inf
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))))
    arcs = [0.0, *[clip.arc_length for clip in clips], length]
    fixed = [0, *[k + 1 for k, clip in enumerate(clips) if clip.kind != "slide"], len(arcs) - 1]
    return x, max(float(way[where[b]] - way[where[a]] - (arcs[b] - arcs[a])) for a, b in pairwise(fixed))
