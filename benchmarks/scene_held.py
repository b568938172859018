"""A bound on length that knows friction: a band which is taut stays where friction holds it.

A band of tension T on a surface turns by kappa_n into it and by kappa_g along it, per length. Where it slips, by w
along itself and by v across, friction is against that and at its limit, and no piece grows longer:

    (T', T kappa_g) = mu T kappa_n (w, v) / |(w, v)|,   w' = kappa_g v.

So where kappa_g < mu kappa_n it slips nowhere across alone, and

    (ln |w|)' = kappa_g^2 / sqrt(mu^2 kappa_n^2 - kappa_g^2):

what comes out at its end is what slack there was, times the exponential of that integral at most. Drawn on further, it
is too short, though another way past the bodies is shorter: it would have to be slackened to lie there. Where a last
shape is known to within e only, it may have slack of e times what it turns along surfaces more.
"""

from __future__ import annotations

import math
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from scene_band import LONGER
from scene_certificate import Array

import cable_shape as cs

#: Of sqrt(EI / T), in which what a band turns at once is spread in a cable: where contacts of one body are shorter than
#: that in all, a band would touch elsewhere.
THICK = 2.0
STRAIGHT = 9  #: places on the straight way from a last shape


class Stop(NamedTuple):
    """Where a band turns: in a clip through which it runs, `rubs` 0, or on a body."""

    place: Array
    normal: Array | None = None  # out of the body
    rubs: float = 0.0


def turns(way: list[Stop]) -> tuple[Array, Array]:
    """(n,), (n,): of all but the first and the last, how far the band turns into the body, and along its surface."""
    places = np.array([stop.place for stop in way])
    ahead = np.diff(places, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    pulled = np.diff(ahead, axis=0)
    normals = np.array([np.zeros(3) if stop.normal is None else stop.normal for stop in way[1:-1]]).reshape(-1, 3)
    into = -(pulled * normals).sum(axis=1)
    return into, np.linalg.norm(pulled + into[:, None] * normals, axis=1)


def growth(way: list[Stop]) -> float:
    """How many times what slips in at one end may slip out at the other; inf where friction does not hold the band."""
    into, along = turns(way)
    total = 0.0
    for stop, n, g in zip(way[1:-1], into, along, strict=True):
        if stop.normal is None:
            continue
        if not g < stop.rubs * n:
            return math.inf
        total += g * g / math.sqrt((stop.rubs * n) ** 2 - g * g)
    return math.exp(total)


def bent(cable: cs.Cable, shape: cs.CableShape) -> bool:
    """Whether bending keeps the cable from lying on a body as a band would."""
    touched = sorted(shape.contacts, key=lambda contact: contact.arc_length)
    for _, row in groupby(touched, key=lambda contact: contact.body):
        arcs = [contact.arc_length for contact in row]
        pull = float(
            np.linalg.norm(
                shape.force[np.searchsorted(shape.arc_length, arcs).clip(max=shape.points - 1)], axis=1
            ).min()
        )
        if arcs[-1] - arcs[0] < THICK * math.sqrt(max(cable.bending_stiffness) / pull):
            return True
    return False


def long(way: list[Stop]) -> float:
    """[m], from stop to stop."""
    return sum(math.dist(a.place, b.place) for a, b in pairwise(way))


class Held:
    """The cable of one motion as such a band, from the last shape that it had."""

    def __init__(self, cable: cs.Cable, scene: cs.Scene, clips: list[cs.Clip]) -> None:
        self.cable, self.scene, self.clips = cable, scene, clips
        self._last: cs.CableShape | None = None
        self._long = 0.0  # [m], what it was last time
        self.lacking = 0.0  #: [m], by how much it is too short at least
        self._eased = False  # whether its ends have come nearer since, so that it may lie otherwise

    def lie(self, shape: cs.CableShape) -> None:
        """From here it is drawn."""
        self._last, self._long, self._eased = shape, 0.0, False

    def too_short(self, start: cs.Pose, end: cs.Pose) -> bool:
        """Whether it cannot be drawn between these grips from where its last shape touches."""
        self.lacking = 0.0
        if self._last is None or self._eased:
            return False
        self.lacking, total = drawn_on(self.cable, self.scene, self.clips, self._last, start, end)
        self._eased = self.lacking == 0.0 and total < self._long
        self._long = total
        return self.lacking > 0.0

    def contradicts(self, shape: cs.CableShape, start: cs.Pose, end: cs.Pose) -> bool:
        """Whether a shape between grips for which it was too short just now cannot be, as exact as that says it is.

        What says that friction tells no past may lie anywhere, and so may what had slack on its way.
        """
        return self.lacking > shape.error_estimate and not (shape.frictionless or self.eases(start, end))

    def eases(self, start: cs.Pose, end: cs.Pose) -> bool:
        """Whether it has slack between its last shape and these grips on the straight way there.

        Which a cable goes that had no shape on its own way: it may lie otherwise there, though its own way drew it on.
        """
        if self._last is None:
            return False
        grips = self._last.positions[[0, -1]]
        ways = np.array([start.position, end.position]) - grips
        total = 0.0
        for at in np.linspace(0.0, 1.0, STRAIGHT):
            poses = [cs.Pose(place) for place in grips + at * ways]
            before, (_, total) = total, drawn_on(self.cable, self.scene, self.clips, self._last, *poses)
            if total < before:
                return True
        return False


def drawn_on(
    cable: cs.Cable, scene: cs.Scene, clips: list[cs.Clip], last: cs.CableShape, start: cs.Pose, end: cs.Pose
) -> tuple[float, float]:
    """[m] by how much the cable is too short to be drawn on between these grips, and how long a band is there."""
    rubs = {body.name: max(body.friction, cable.friction) for body in scene.obstacles}
    touched = sorted(last.contacts, key=lambda contact: contact.arc_length)
    arcs = [contact.arc_length for contact in touched]
    if not touched or any(contact.body not in rubs for contact in touched) or len(set(arcs)) < len(arcs):
        return 0.0, 0.0
    if bent(cable, last):
        return 0.0, 0.0
    on = [Stop(c.point + 0.5 * cable.diameter * c.normal, c.normal, rubs[c.body]) for c in touched]
    runs = [clip for clip in clips if clip.kind == "slide"]
    fixed = [(0.0, last.positions[0], np.array(start.position))]
    fixed += [(clip.arc_length, *2 * [np.array(clip.pose.position)]) for clip in clips if clip.kind != "slide"]
    fixed.append((cable.length, last.positions[-1], np.array(end.position)))
    lacking, total = 0.0, 0.0
    for (a, was_a, now_a), (b, was_b, now_b) in pairwise(fixed):
        inner = [(arc, stop) for arc, stop in zip(arcs, on, strict=True) if a < arc < b]
        inner += [(clip.arc_length, Stop(np.array(clip.pose.position))) for clip in runs if a < clip.arc_length < b]
        between = [stop for _, stop in sorted(inner, key=lambda one: one[0])]
        while True:  # only bending presses the cable where a band would not touch
            then = [Stop(was_a), *between, Stop(was_b)]
            into, along = turns(then)
            kept = [s for s, n in zip(between, into, strict=True) if s.normal is None or n > 0.0]
            if len(kept) == len(between):
                break
            between = kept
        now = [Stop(now_a), *between, Stop(now_b)]
        loose = last.error_estimate * sum(g for s, g in zip(between, along, strict=True) if s.normal is not None)
        slack = max(b - a - long(then), 0.0) + loose
        most = max(growth(then), growth(now))
        if most < math.inf:
            lacking = max(lacking, long(now) - long(then) - most * slack - LONGER * cable.length)
        total += long(now)
    return lacking, total
