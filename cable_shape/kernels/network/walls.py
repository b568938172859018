"""Planes that a node is kept in front of, and friction on them: how its place answers to a force.

Plane k pushes by p n, p = max(0, kept + stiff (at - n . x)), and rubs by a force t along it: with what the node has
gone along it since it got there, d = (1 - n n^T) (x - ref), asperities give

    t = -firm d  if that is no longer than rough p: it sticks; else as long as that: it slips (Coulomb).

Without friction x is the minimum of a convex function; what p and t do to each other is found in turns. The derivative
of the place, `give`, takes limits of friction for constant, and is symmetric.
"""

from __future__ import annotations

import math

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.tables import Floats
from cable_shape.kernels.rod_algebra import (
    Matrix,
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    mscale,
    msub,
    outer,
    put3,
    put9,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_element import IDENTITY

#: Planes that a node may have, and columns of each: body, outward normal 3, n . x at the surface [m], stiffness [N/m],
#: push that it has at the surface [N], push [N], coefficient of friction, stiffness of the asperities [N/m], where the
#: node would be without friction's force 3 [m], that force 3 [N].
WALLS, WALL = 4, 16
BODY, OUT, AT, STIFF, KEPT, PUSHED, ROUGH, FIRM, REF, RUB = 0, 1, 4, 5, 6, 7, 8, 9, 10, 13
#: Of planes that nodes have at their seats: not 0: it goes on to push, should it pull; and its push or pull [N].
STICKS, PULLED = ROUGH, FIRM
MOST_SETS = 12  # that planes push
FROZEN_ROUNDS = 8  # of the same where no law changes
MOST_ROUNDS, SAME = 40, 1e-10  # of pushes and friction, and the change, of the largest force, of the last
SLIPS = 0.999  # of the square of the most that friction may be
#: What D misses, of 1 / stiff, is rounding times stiff / hold: by so much a place misses, and no push would be known.
REFINED = 2
ROUNDING = 1e-12  # [m] a node this near to a plane is as it was, in front of it or pushed by it


@viewing
def touched(walls: Floats, node: int, a: Vector, hold: float, pull: Vector, places: Floats, gives: Floats) -> None:
    """Fills place and give of a node that `hold` [N/m] draws to a, and a force pulls; pushes and friction, too."""
    x, D = pushed(walls, node, a, hold, add(pull, rubbing(walls, node)))
    count, rubs = int(walls[node, 0]), False
    for k in range(count):
        rubs = rubs or walls[node, 1 + WALL * k + ROUGH] > 0.0
    for _ in range(MOST_ROUNDS if rubs else 0):
        changed = largest = 0.0
        for k in range(count):
            i = 1 + WALL * k
            n, t = take3(walls, node, i + OUT), take3(walls, node, i + RUB)
            limit = walls[node, i + ROUGH] * walls[node, i + PUSHED]
            new = rub(along(n, subtract(x, take3(walls, node, i + REF))), t, 1.0 / hold, walls[node, i + FIRM], limit)
            put3(walls, node, i + RUB, new)
            way = subtract(new, t)
            changed, largest = max(changed, dot(way, way)), max(largest, limit * limit)
        if changed <= SAME * SAME * largest:
            break
        x, D = pushed(walls, node, a, hold, add(pull, rubbing(walls, node)))
    for k in range(count if rubs else 0):
        i = 1 + WALL * k
        limit, firm = walls[node, i + ROUGH] * walls[node, i + PUSHED], walls[node, i + FIRM]
        n = take3(walls, node, i + OUT)
        d = along(n, subtract(x, take3(walls, node, i + REF)))
        D = rubbed(D, n, d, firm, limit, dot(d, d) ** 0.5 * firm > limit)
    put3(places, node, 0, x)
    put9(gives, node, 0, D)


@viewing(forceinline=True)
def pushed(walls: Floats, node: int, a: Vector, hold: float, pull: Vector) -> tuple[Vector, Matrix]:
    """The place under this pull, and its derivative: Newton steps change the set of planes that push."""
    count = int(walls[node, 0])
    x, D = add(a, scale(1.0 / hold, pull)), mscale(1.0 / hold, IDENTITY)
    pushing = -1
    for _ in range(MOST_SETS):
        now = 0
        for k in range(count):
            i = 1 + WALL * k
            push = walls[node, i + KEPT] + walls[node, i + STIFF] * (
                walls[node, i + AT] - dot(take3(walls, node, i + OUT), x)
            )
            walls[node, i + PUSHED] = max(push, 0.0)
            was = pushing >= 0 and (pushing & (1 << k)) != 0
            now += (1 << k) if push > (-ROUNDING if was else ROUNDING) * walls[node, i + STIFF] else 0
        if now == pushing:
            break
        pushing = now
        force, D = pull, mscale(1.0 / hold, IDENTITY)
        for k in range(count):
            if now & (1 << k) == 0:
                continue
            i = 1 + WALL * k
            n, stiff = take3(walls, node, i + OUT), walls[node, i + STIFF]
            force = add(force, scale(walls[node, i + KEPT] + stiff * (walls[node, i + AT] - dot(n, a)), n))
            D = stiffened(D, n, stiff)
        x = add(a, apply(D, force))
        for _ in range(REFINED):
            force = subtract(pull, scale(hold, subtract(x, a)))
            for k in range(count):
                if now & (1 << k) == 0:
                    continue
                i = 1 + WALL * k
                n = take3(walls, node, i + OUT)
                push = walls[node, i + KEPT] + walls[node, i + STIFF] * (walls[node, i + AT] - dot(n, x))
                force = add(force, scale(push, n))
            x = add(x, apply(D, force))
    return x, D


@viewing
def as_before(walls: Floats, node: int, a: Vector, hold: float, pull: Vector, places: Floats, gives: Floats) -> None:
    """`touched` with the planes pushing that pushed before, and rubbing as they did: where an iteration begins.

    What is carried on in time tells less of which will push than where they pushed last.
    """
    x, D = add(a, scale(1.0 / hold, pull)), mscale(1.0 / hold, IDENTITY)
    force = add(pull, rubbing(walls, node))
    for k in range(int(walls[node, 0])):
        i = 1 + WALL * k
        if walls[node, i + PUSHED] > 0.0:
            n, stiff = take3(walls, node, i + OUT), walls[node, i + STIFF]
            force = add(force, scale(walls[node, i + KEPT] + stiff * (walls[node, i + AT] - dot(n, a)), n))
            D = stiffened(D, n, stiff)
    x = add(a, apply(D, force))
    for k in range(int(walls[node, 0])):
        i = 1 + WALL * k
        if not walls[node, i + PUSHED] > 0.0:
            continue
        n, t = take3(walls, node, i + OUT), take3(walls, node, i + RUB)
        limit = walls[node, i + ROUGH] * walls[node, i + PUSHED]
        D = rubbed(
            D, n, along(n, subtract(x, take3(walls, node, i + REF))), walls[node, i + FIRM], limit, slips(t, limit)
        )
        walls[node, i + PUSHED] = walls[node, i + KEPT] + walls[node, i + STIFF] * (walls[node, i + AT] - dot(n, x))
    put3(places, node, 0, x)
    put9(gives, node, 0, D)


@inline
def slips(t: Vector, limit: float) -> bool:
    """Whether friction t is all it may be."""
    return bool(limit > 0.0 and dot(t, t) >= SLIPS * limit * limit)


@inline
def rubbed(D: Matrix, n: Vector, d: Vector, firm: float, limit: float, slides: bool) -> Matrix:
    """The derivative of a place with friction, on a plane with normal n where it is d from where it would be without.

    limit: what it may be [N], 0: none; slides: it is.
    """
    way = dot(d, d) ** 0.5
    if limit > 0.0 and slides and way > 0.0:
        return stiffened(D, scale(1.0 / way, cross(n, d)), limit / way)
    if limit > 0.0 and not slides:
        u = across(n)
        return stiffened(stiffened(D, u, firm), cross(n, u), firm)
    return D


@viewing
def frozen(walls: Floats, node: int, a: Vector, hold: float, pull: Vector, places: Floats, gives: Floats) -> None:
    """`touched` near to a place at hand where no law changes: what is pressed is, sticks or slips, and nothing else is.

    Planes without stiffness do nothing; those of infinite roughness stick, the others slip if they are rough.
    """
    x, D = get3(places, node), IDENTITY
    for _ in range(FROZEN_ROUNDS):
        force, D = subtract(pull, scale(hold, subtract(x, a))), mscale(1.0 / hold, IDENTITY)
        for k in range(int(walls[node, 0])):
            i = 1 + WALL * k
            n, stiff, firm = take3(walls, node, i + OUT), walls[node, i + STIFF], walls[node, i + FIRM]
            if stiff == 0.0:
                continue
            push = walls[node, i + KEPT] + stiff * (walls[node, i + AT] - dot(n, x))
            d = along(n, subtract(x, take3(walls, node, i + REF)))
            size, t = math.sqrt(dot(d, d)), (0.0, 0.0, 0.0)
            D = stiffened(D, n, stiff)
            if firm > 0.0 and walls[node, i + ROUGH] == math.inf:
                t, u = scale(-firm, d), across(n)
                D = stiffened(stiffened(D, u, firm), cross(n, u), firm)
            elif firm > 0.0 and size > 0.0:
                limit = walls[node, i + ROUGH] * push
                t = scale(-limit / size, d)
                D = stiffened(D, scale(1.0 / size, cross(n, d)), max(limit, 0.0) / size)
            walls[node, i + PUSHED] = push
            put3(walls, node, i + RUB, t)
            force = add(force, add(scale(push, n), t))
        x = add(x, apply(D, force))
    put3(places, node, 0, x)
    put9(gives, node, 0, D)


@inline
def rubbing(walls: Floats, node: int) -> Vector:
    """[N], friction of all planes of a node."""
    t = (0.0, 0.0, 0.0)
    for k in range(int(walls[node, 0])):
        t = add(t, take3(walls, node, 1 + WALL * k + RUB))
    return t


@inline
def rub(d: Vector, t: Vector, soft: float, firm: float, limit: float) -> Vector:
    """[N], friction after it was t where the way along the surface is d, if a force moves that by `soft` [m/N]."""
    free = subtract(d, scale(soft, t))
    new = scale(-firm / (1.0 + firm * soft), free)
    size = dot(new, new) ** 0.5
    return new if size <= limit else scale(limit / size, new)


@viewing(forceinline=True)
def stiffened(D: Matrix, n: Vector, stiff: float) -> Matrix:
    """(D^-1 + stiff n n^T)^-1."""
    Dn = apply(D, n)
    return msub(D, outer(scale(stiff / (1.0 + stiff * dot(n, Dn)), Dn), Dn))


@inline
def along(n: Vector, v: Vector) -> Vector:
    """The part of v along the surface of normal n."""
    return subtract(v, scale(dot(n, v), n))


@inline
def across(n: Vector) -> Vector:
    """A unit vector across n."""
    v = cross(n, (1.0, 0.0, 0.0) if abs(n[0]) < 0.6 else (0.0, 1.0, 0.0))
    return scale(1.0 / dot(v, v) ** 0.5, v)
