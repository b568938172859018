"""A bound on length: a band drawn tight between grips, through clips and on its side of all bodies."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scene_certificate import Array, distances

import cable_shape as cs

#: Points of the band; steps in which it is drawn tight; by how much it may still become shorter in the last tenth of
#: them, and by how much it must be longer than the cable, of whose length.
POINTS, STEPS, SETTLED, LONGER = 201, 8000, 1e-5, 1e-3
DIFFERENCE = 1e-6  # m


def out_of(scene: cs.Scene, radius: float, x: Array) -> None:
    """Pushes points (n, 3) that are nearer than `radius` to a body out of it along its normal."""
    for body in scene.obstacles:
        gap = distances(body.solid, body.pose, x) - radius
        deep = np.flatnonzero(gap < 0.0)
        if not deep.size:
            continue
        sides = [distances(body.solid, body.pose, x[deep] + s * DIFFERENCE * e) for e in np.eye(3) for s in (1.0, -1.0)]
        normal = np.stack([a - b for a, b in zip(sides[::2], sides[1::2], strict=True)], axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        x[deep] -= gap[deep, None] * normal


def too_short(
    cable: cs.Cable, scene: cs.Scene, clips: list[cs.Clip], last: cs.CableShape, start: cs.Pose, end: cs.Pose
) -> bool:
    """Whether the cable is shorter than the shortest way into which its last shape can be drawn between these grips.

    Between two supports in which it does not slide; the way from the last shape there passes no body. Points are
    outside of all bodies, what lies between them need not be: the way is a polygon, no longer than the true one.
    """
    x = np.stack([np.interp(np.linspace(0, 1, POINTS), last.arc_length / last.length, c) for c in last.positions.T], 1)
    held = {0: start.position, POINTS - 1: end.position}
    arcs, holds = {0: 0.0, POINTS - 1: cable.length}, {0: True, POINTS - 1: True}
    for clip in clips:
        k = int(np.linalg.norm(x - clip.pose.position, axis=1).argmin())
        held[k], arcs[k], holds[k] = clip.pose.position, clip.arc_length, clip.kind != "slide"
    begin, radius = x.copy(), 0.5 * cable.diameter
    lengths = []
    for step in range(STEPS):
        at = min(1.0, 10.0 * step / STEPS)  # the grips go slowly, at first
        x[1:-1] = 0.5 * (x[:-2] + x[2:])
        for _ in range(2):
            for k, place in held.items():
                x[k] = (1.0 - at) * begin[k] + at * np.array(place)
            out_of(scene, radius, x)
        if step in (STEPS - STEPS // 10, STEPS - 1):
            lengths.append(np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))))
    if lengths[0][-1] - lengths[1][-1] > SETTLED * cable.length:
        return False
    fixed = [k for k in sorted(held) if holds[k]]
    way = lengths[1]
    return any(way[b] - way[a] > arcs[b] - arcs[a] + LONGER * cable.length for a, b in pairwise(fixed))
