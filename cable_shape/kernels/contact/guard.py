"""Planes that keep a network in motion in front of bodies: :func:`guard`.

At the point of a convex body that is nearest to a node lies a plane with all of the body behind it. Where a node is in
front of its plane before a step and after it, so is the way between, and what a step may have done to what is between
two nodes is seen by `check.passes`.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.near import GRIP_EXCLUSION, NONE
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.distance.surface import touch
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.motion import AT, BODY, KEPT, OUT, PUSHED, STIFF, WALL, WALLS, Motion, motion_of
from cable_shape.kernels.network.tables import Floats, Whole, model_of, plan_of
from cable_shape.kernels.rod_algebra import Vector, dot, get3, put3, take3


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
                motion, bodies, node, model.s[node], thick[node], wholes[node], reach, stiff[node]
            )  # fmt: skip
            clear, cosine = min(clear, own), min(cosine, turned)
    return clear, cosine


@viewing
def look_around(
    motion: Motion, bodies: Bodies, node: int, arc: float, thick: float, whole: float, reach: float, stiff: float
) -> tuple[float, float]:  # fmt: skip
    """The planes of one node; returns the least gap [m] to a body without one, and the cosine as `guard`."""
    walls, p, clear, cosine = motion.walls, get3(motion.origin, node), math.inf, 1.0
    had = int(walls[node, 0])
    first, second = pushed(walls, node, 0, had), pushed(walls, node, 1, had)
    third, fourth = pushed(walls, node, 2, had), pushed(walls, node, 3, had)
    count = 0
    for b in range(bodies.table.shape[0]):
        exclusion = GRIP_EXCLUSION if bodies.table[b, 12] != 0.0 else 0.0
        if arc < exclusion or arc > whole - exclusion:
            continue
        d, n, _ = touch(bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree, p, NONE, False, bodies.stack)
        gap = d - thick
        if gap > reach or count == WALLS:
            clear = min(clear, max(gap, 0.0))
            continue
        kept = 0.0
        for body, push, x, y, z in (first, second, third, fourth):
            if body == b and push > 0.0:
                kept = push
                cosine = min(cosine, dot(n, (x, y, z)))
        put_wall(walls, node, count, b, n, dot(n, p) - gap, stiff, kept)
        count += 1
    walls[node, 0] = count
    return clear, cosine


@inline
def pushed(walls: Floats, node: int, k: int, had: int) -> tuple[float, float, float, float, float]:
    """Body of plane k of a node, how hard it pushes [N], and its normal; -1 without such a plane."""
    i = 1 + WALL * k
    x, y, z = take3(walls, node, i + OUT)
    return (walls[node, i + BODY], walls[node, i + PUSHED], x, y, z) if k < had else (-1.0, 0.0, 0.0, 0.0, 0.0)


@inline
def put_wall(walls: Floats, node: int, k: int, b: int, n: Vector, at: float, stiff: float, kept: float) -> None:
    """Plane k of a node."""
    i = 1 + WALL * k
    walls[node, i + BODY] = b
    put3(walls, node, i + OUT, n)
    walls[node, i + AT], walls[node, i + STIFF], walls[node, i + KEPT], walls[node, i + PUSHED] = at, stiff, kept, kept
