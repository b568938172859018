"""Planes that keep a network in motion in front of bodies: :func:`guard`.

At the point of a convex body that is nearest to a node lies a plane with all of the body behind it. Where a node is in
front of its plane before a step and after it, so is the way between, and what a step may have done to what is between
two nodes is seen by `check.passes`.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.check import carried
from cable_shape.kernels.contact.near import BARE, GRIP_EXCLUSION, NONE
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.distance.surface import touch
from cable_shape.kernels.network.compiled import inline
from cable_shape.kernels.network.motion import Motion, motion_of
from cable_shape.kernels.network.tables import Floats, Whole, model_of, plan_of
from cable_shape.kernels.network.walls import (
    AT,
    BODY,
    FIRM,
    KEPT,
    OUT,
    PUSHED,
    REF,
    ROUGH,
    RUB,
    STIFF,
    WALL,
    WALLS,
    along,
)
from cable_shape.kernels.rod_algebra import Vector, add, dot, get3, put3, scale, take3


@kernel
def guard(
    ints: Whole, floats: Floats, moving: Floats, bodies: Bodies, thick: Array, wholes: Array, reach: float,
    stiff: Array,
) -> tuple[float, float]:  # fmt: skip
    """Gives every node that nothing holds the planes of the bodies within `reach` [m], and their pushes from before.

    thick, wholes, stiff (n,): radius [m] and length [m] of each node's cable, and how stiff its planes are [N/m].
    Returns how far [m] nodes may move before there may be one in a body that has no plane for it, and the least cosine
    of the angle by which a plane that pushes has turned.
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    clear, cosine = reach, 1.0
    for j in range(plan.ends.shape[0]):
        for node in range(plan.first[j] + j + 1, plan.first[j + 1] + j):
            own, turned = look_around(
                motion, bodies, bodies.frames, node, get3(motion.origin, node), model.s[node], thick[node],
                wholes[node], reach, stiff[node], 0.0, True, 0.0,
            )  # fmt: skip
            clear, cosine = min(clear, own), min(cosine, turned)
    return clear, cosine


@inline
def look_around(
    motion: Motion, bodies: Bodies, then: Array, node: int, place: Vector, arc: float, thick: float, whole: float,
    reach: float, stiff: float, firm: float, keeps: bool, rough: float,
) -> tuple[float, float]:  # fmt: skip
    """The planes of a node at `place`; returns the least gap [m] to a body without one, and the cosine as `guard`.

    The bodies were in the frames `then`, and what they do to the node goes with them. keeps: pushes are those that it
    has at the surface, and bodies stay. firm [N/m]: stiffness of asperities, 0: no friction; rough: coefficient of the
    cable.
    """
    walls, was, clear, cosine = motion.walls, motion.was, math.inf, 1.0
    for i in range(1 + WALL * int(walls[node, 0])):
        was[i] = walls[node, i]
    count = 0
    for b in range(bodies.table.shape[0]):
        if excluded(bodies, b, arc, whole):
            continue
        p = place if keeps else carried(place, then[b], bodies.frames[b])
        d, n, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, p, NONE, False, bodies.stack)
        gap = d - thick
        i, off = count, gap
        if count == WALLS:
            i, off = farthest(walls, node, p, gap)
        if gap > reach or i == BARE:
            clear = min(clear, max(gap, 0.0))
            continue
        if i < count:
            clear = min(clear, max(off, 0.0))
        at, kept, t = 1 + WALL * i, 0.0, NONE
        for k in range(int(was[0])):
            o = 1 + WALL * k
            if int(was[o + BODY]) == b and was[o + PUSHED] > 0.0:
                kept, t = was[o + PUSHED], (was[o + RUB], was[o + RUB + 1], was[o + RUB + 2])
                cosine = min(cosine, dot(n, (was[o + OUT], was[o + OUT + 1], was[o + OUT + 2])))
        for c in range(at, at + WALL):
            walls[node, c] = 0.0
        walls[node, at + BODY] = b
        put3(walls, node, at + OUT, n)
        walls[node, at + AT], walls[node, at + STIFF] = dot(n, p) - gap, stiff
        walls[node, at + PUSHED] = kept
        if keeps:
            walls[node, at + KEPT] = kept
        if firm > 0.0:
            t = along(n, t)
            walls[node, at + ROUGH], walls[node, at + FIRM] = max(rough, bodies.rough[b]), firm
            put3(walls, node, at + RUB, t)
            put3(walls, node, at + REF, add(p, scale(1.0 / firm, t)))
        count = max(count, i + 1)
    walls[node, 0] = count
    return clear, cosine


@inline
def farthest(walls: Array, node: int, place: Vector, gap: float) -> tuple[int, float]:
    """Which of a node's planes is farthest from `place`, and how far [m]; BARE: none is as far as this gap."""
    found, most = BARE, gap
    for k in range(int(WALLS)):
        at = 1 + WALL * k
        own = dot(take3(walls, node, at + OUT), place) - walls[node, at + AT]
        if own > most:
            found, most = k, own
    return found, most


@inline
def excluded(bodies: Bodies, b: int, arc: float, whole: float) -> bool:
    """Whether the cable may be in body b at this arc length [m]: next to a grip on that link."""
    return bodies.table[b, 12] != 0.0 and (arc < GRIP_EXCLUSION or arc > whole - GRIP_EXCLUSION)
