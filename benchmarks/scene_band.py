"""A bound on length: a band drawn tight between grips, through clips and on its side of all bodies."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scene_certificate import Array, signed
from scipy.spatial.transform import Rotation

import cable_shape as cs

#: Points of the band and most steps in which it is drawn tight, coarse at first; a band already drawn takes the last.
LEVELS = ((51, 2000), (101, 1000), (201, 3000))
#: Steps in which it may still become shorter by that part of the cable's length when it counts as tight; and how much
#: longer than the cable it must be, of the same.
LOOK, SETTLED, LONGER = 100, 1e-6, 1e-3
DIFFERENCE = 1e-6  # m
Body = tuple[object, Array, Array]  # a solid, where it is [m], and its axes (3, 3)


def out_of(bodies: list[Body], radius: float, x: Array) -> None:
    """Pushes points (n, 3) that are nearer than `radius` to a body out of it along its normal."""
    for solid, place, axes in bodies:
        p = (x - place) @ axes
        gap = signed(solid, p.copy()) - radius
        deep = np.flatnonzero(gap < 0.0)
        if not deep.size:
            continue
        beside = p[deep, None, :] + DIFFERENCE * np.concatenate((np.eye(3), -np.eye(3)))
        sides = signed(solid, beside.reshape(-1, 3)).reshape(-1, 2, 3)
        normal = sides[:, 0] - sides[:, 1]
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        x[deep] -= gap[deep, None] * (normal @ axes.T)


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
            if math.isfinite(was[3]) and abs(was[3] - least) > moved:
                return was[3] > least
        x = None if self._drawn is None else self._drawn[2]
        x, lacks = drawn(self.cable, self.scene, self.clips, self.shape, start, end, x)
        self._drawn = start, end, x, lacks
        return lacks > least


def drawn(
    cable: cs.Cable, scene: cs.Scene, clips: list[cs.Clip], last: cs.CableShape, start: cs.Pose, end: cs.Pose,
    band: Array | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """The last shape, or a `band` (n, 3) as it was drawn before, drawn tight between these grips.

    Returns it and what the cable lacks [m], below 0 what it has to spare, between those two supports in which it does
    not slide where that is most; -inf where the band has not settled. Points are outside of all bodies, what lies
    between them need not be: the way is a polygon, no longer than the true one.
    """
    bodies = [
        (body.solid, np.array(body.pose.position), Rotation.from_quat(body.pose.quaternion).as_matrix())
        for body in scene.obstacles
    ]
    x = last.positions if band is None else band
    marks = [int(np.linalg.norm(x - clip.pose.position, axis=1).argmin()) / (len(x) - 1) for clip in clips]
    held = dict(zip((0.0, *marks, 1.0), (start, *[clip.pose for clip in clips], end), strict=True))
    for count, steps in LEVELS if band is None else LEVELS[-1:]:
        at = np.linspace(0.0, 1.0, count)
        x = np.stack([np.interp(at, np.linspace(0.0, 1.0, len(x)), c) for c in x.T], axis=1)
        where = np.rint(np.array(list(held)) * (count - 1)).astype(int)
        begin, goal = x[where].copy(), np.array([pose.position for pose in held.values()])
        settled, way = False, np.array([math.inf])
        for step in range(steps):
            part = min(1.0, (step + 1.0) / LOOK)  # the grips go slowly, at first
            x[1:-1] = 0.5 * (x[:-2] + x[2:])
            x[where] = (1.0 - part) * begin + part * goal
            out_of(bodies, 0.5 * cable.diameter, x)
            if step % LOOK == LOOK - 1 and part == 1.0:
                before, way = way[-1], np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))))
                settled = abs(before - way[-1]) <= SETTLED * cable.length
                if settled:
                    break
    if not settled:
        return x, -math.inf
    arcs = [0.0, *[clip.arc_length for clip in clips], cable.length]
    fixed = [0, *[k + 1 for k, clip in enumerate(clips) if clip.kind != "slide"], len(arcs) - 1]
    return x, max(float(way[where[b]] - way[where[a]] - (arcs[b] - arcs[a])) for a, b in pairwise(fixed))
