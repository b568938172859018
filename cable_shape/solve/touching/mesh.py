"""Where the nodes of a cable in contact go: at first, beside the ends of rows, and where contacts have run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import rod_mesh
from cable_shape.kernels.contact import afterwards, run
from cable_shape.kernels.contact.near import (
    ARC,
    BARE,
    CURVED,
    HELD,
    LINK,
    NORMAL,
    PRESS,
    RUB,
    SECOND,
    SPOT,
    WAS,
    along_cable,
    tangent_of,
)
from cable_shape.kernels.distance.surface import touch
from cable_shape.shape import CableShape
from cable_shape.solve.touching.bodies import TouchBodies

ELEMENTS = 48  #: of a mesh before nodes are added, at least
LAYERED = 0.5  #: of these, for the layers at what holds the cable
FINENESS = 2.0  #: elements over which bending takes up the weight: where a limp cable meets a body it turns in as much
MOST_AT_FIRST = 320
FEWEST_ELEMENTS = 16  #: of them between two clips
SHARE_OF_WORST = 0.1  #: of the largest share in the error that an element has: those above are divided
TURN, SOON = 0.03, 0.12  #: rad: elements beside a contact that turn by less are fine enough, see `afterwards.steep`
WORST = 0.5  #: of the contact that misses most: those above get nodes beside them
STRETCHED = 1.6  #: times as long as at first: elements that an eyelet has stretched so far are divided
ASTRIDE = 0.05  #: cosine of the angle between cable and push of two contacts at both sides of an edge
SAME_FACE = 0.99  #: cosine of the angle by which a surface turns from where it is told to, over an edge
EVEN = 0.5  #: of their first length: shorter elements are joined before a road that found no way is tried again
TIP = 5e-5  #: [m] from a free end, which is no support itself, to the node that stands in for it
STAND_IN = 1e-5  #: [m], the same from a junction of a harness
KINKED = 0.3  #: of the tension: a contact that presses harder turns a taut cable at once
_ABSCISSAE = 65
_FORCE = 8  #: see `CableShape.touches`


def first_count(length: float, bend: float, weight: float) -> int:
    """Elements of a cable before nodes are added: where it touches down is not known. weight [N/m]."""
    even: float = FINENESS * length * (weight / bend) ** (1.0 / 3.0)
    return max(ELEMENTS, min(math.ceil(LAYERED * ELEMENTS + even), MOST_AT_FIRST))


def first_nodes(
    arcs: Array, stops: Array, bend: float, free: tuple[bool, bool], shape: CableShape, elements: int,
    finer: float = 1.0,
) -> Array:  # fmt: skip
    """Arc lengths for a cable of which `shape` is a rough idea: denser towards what holds it, or what kinks it.

    arcs (b,) [m], of the supports; stops [m], where nodes must be; bend [N m^2]; free: nothing holds the start, and
    the end; elements: of the whole cable, about; finer: times as many.
    """
    pulls = np.linalg.norm(shape.force, axis=1)
    pieces = []
    for a, b in pairwise(arcs):
        inside = (shape.arc_length >= a) & (shape.arc_length <= b)
        tension = float(np.median(pulls[inside] if inside.any() else pulls))
        length = b - a
        layer = math.sqrt(bend / max(tension, bend / length**2))
        kinks = _kinks(shape, a, b, tension, layer)
        x, density = _layered((a, *kinks, b), layer)
        density += 0.5 * density.mean()
        density = 1.0 + LAYERED * ELEMENTS / (elements - LAYERED * ELEMENTS) * (density - 1.0)
        own = np.union1d(stops[(stops > a) & (stops < b)], kinks)
        count = max(FEWEST_ELEMENTS, math.ceil(finer * elements * length / (arcs[-1] - arcs[0]))) + 2 * own.size
        nodes = np.empty(count + 1)
        rod_mesh.equidistribute(x, density, own, count, nodes)
        pieces.append(nodes[:-1])
    nodes = np.append(np.concatenate(pieces), arcs[-1])
    if free[1]:
        nodes = np.insert(nodes, nodes.size - 1, nodes[-1] - TIP)
    return np.insert(nodes, 1, nodes[0] + TIP) if free[0] else nodes


def _layered(ends: Sequence[float], layer: float) -> tuple[Array, Array]:
    """Abscissae [m] and a density, with layers at both sides of each of these arc lengths."""
    places: list[Array] = []
    densities: list[Array] = []
    for a, b in pairwise(ends):
        length = b - a
        x, density = np.empty(_ABSCISSAE), np.empty(_ABSCISSAE)
        rod_mesh.layered(length, min(max(layer, 1e-5 * length), length), x, density)
        x += a
        x[0], x[-1] = a, b
        places.append(x[len(places) > 0 :])
        densities.append(density[len(densities) > 0 :])
    return np.concatenate(places), np.concatenate(densities)


def _kinks(shape: CableShape, a: float, b: float, tension: float, layer: float) -> list[float]:
    """Arc lengths [m] between two where contacts turn a taut cable at once, further apart than `layer` [m]."""
    found: list[float] = []
    for arc in shape.touches[shape.touches[:, _FORCE] > KINKED * tension, 0].tolist():
        if arc - (found[-1] if found else a) > layer and b - arc > layer:
            found.append(arc)
    return found


def ends_of_rows(nodes: Array, q: Array, near: Array, on: Any, least: float) -> Array:
    """Arc lengths beside the contacts without two neighbours that miss most, halfway to the next nodes.

    least [m]: contacts between two elements shorter than this are left out.
    """
    touched = on[:, 0] != BARE
    divisible = np.diff(nodes) >= least
    wanted = (divisible[1:] | divisible[:-1]) & touched[1:-1] & ~(touched[:-2] & touched[2:])
    k = np.flatnonzero(wanted) + 1
    x, y, z, w = q[k].T
    tangents = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
    missed = near[k, PRESS] * np.abs((tangents * near[k, NORMAL : NORMAL + 3]).sum(axis=1))
    k = k[missed >= WORST * missed.max(initial=0.0)]
    return np.unique(0.5 * np.concatenate((nodes[k] + nodes[k - 1], nodes[k] + nodes[k + 1])))


def worst(nodes: Array, errors: Array, inside: Any) -> Array:
    """Middles of the elements with the largest `errors` (N,); inside: which pieces between nodes are elements."""
    return np.asarray(0.5 * (nodes[1:] + nodes[:-1])[inside][errors >= SHARE_OF_WORST * errors.max()])


def tidied(
    nodes: Array, h: Array, q: Array, near: Array, on: Any, flex: Array, stops: Array, least: float
) -> Array | None:  # fmt: skip
    """Where a contact has run up to the next node, takes that away and divides the element on the other side.

    Another contact and `stops` stay: beside the shorter element a contact may come nearer to them. least [m]: shorter
    ones are not divided there. None: nowhere.
    """
    if not run.any_crowded(near, on, q, h, flex):
        return None
    away: list[int] = []
    new: list[float] = []
    for k in np.flatnonzero((on[1:-1, 0] != BARE) | (on[1:-1, LINK] != BARE)) + 1:
        side = run.crowded(near, on, q, h, k, flex)
        j = k + side
        stays = j in (0, nodes.size - 1) or on[j, 0] != BARE or nodes[j] in stops
        if side == 0 or (stays and abs(nodes[k] - nodes[k - side]) < least):
            continue
        if not stays:
            away.append(j)
        new.append(0.5 * (nodes[k] + nodes[k - side]))
    return np.sort(np.concatenate((np.delete(nodes, away), new))) if new else None


def thinned(
    nodes: Array, near: Array, on: Any, spacing: Array, middles: Array, stops: Array, *, full: bool, coarse: bool
) -> Array | None:
    """Takes away every other node far from where a row ends that is closer to the next than `spacing` [m] at `middles`.

    full: what lies in a row without being pressed does not end it. coarse: only inside of rows. None: there is no
    such node.
    """
    away = np.empty(nodes.size, np.int64)
    count = afterwards.spare(nodes, near, on, spacing, middles, stops, full, coarse, away)
    return np.delete(nodes, away[:count]) if count else None


def evened(nodes: Array, free: Any, spacing: Array, middles: Array, stops: Array) -> Array | None:
    """Takes away `free` nodes (n,), bool, so that no element beside them is shorter than `EVEN` of `spacing` [m] at
    `middles`. None: there is no such node."""
    wanted = EVEN * np.interp(nodes, middles, spacing)
    kept = ~free | np.isin(nodes, stops)
    held = np.flatnonzero(kept)
    last = 0
    for k in range(1, nodes.size):
        if kept[k]:
            last = k
            continue
        ahead = held[np.searchsorted(held, k)]
        if min(nodes[k] - nodes[last], nodes[ahead] - nodes[k]) >= wanted[k]:
            kept[k] = True
            last = k
    return None if kept.all() else nodes[kept]


def share_in(nodes: Array, near: Array, on: Any, new: Any) -> None:
    """Gives `new` nodes in rows of contacts their parts of what those beside them are held by: the rest stays as it is.

    What a row is pulled by along a surface is linear in arc length between its nodes; what acts at its ends, where
    the cable lifts off, stays there, but for as much as the next node carries.
    """
    old = np.flatnonzero(~new)
    pairs = [(a, b) for a, b in pairwise(old.tolist()) if on[a, 0] != BARE and on[a, 0] == on[b, 0]]
    if not near[old, RUB : RUB + 3].any() or not pairs:
        return
    around, sides, before = np.zeros(nodes.size), np.zeros(nodes.size), near.copy()
    for a, b in pairs:
        around[[a, b]] += 0.5 * (nodes[b] - nodes[a])
        sides[[a, b]] += 1
    forces = [PRESS, *range(RUB, RUB + 3), *range(HELD, HELD + 3)]
    directions = [*range(NORMAL, NORMAL + 3), *range(WAS, WAS + 3)]
    for a, b in pairs:
        if b == a + 1:
            continue
        share = (nodes[a : b + 1, None] - nodes[a]) / (nodes[b] - nodes[a])
        whole = 0.5 * (nodes[b] - nodes[a])
        first, last = (before[k] / around[k] * (sides[k] == 2) for k in (a, b))
        if sides[a] != 2:
            first = last
        elif sides[b] != 2:
            last = first
        part = np.zeros(b + 1 - a)
        part[1:] += 0.5 * np.diff(nodes[a : b + 1])
        part[:-1] += 0.5 * np.diff(nodes[a : b + 1])
        given = ((1.0 - share) * first + share * last) * part[:, None]
        near[a + 1 : b] = before[a]
        near[a + 1 : b, forces] = given[1:-1, forces]
        near[a + 1 : b, directions] = ((1.0 - share) * before[a] + share * before[b])[1:-1, directions]
        near[a, forces] += given[0, forces] - whole * first[forces]
        near[b, forces] += given[-1, forces] - whole * last[forces]
        near[a + 1 : b, ARC] = before[a, ARC] + share[1:-1, 0] * (before[b, ARC] - before[a, ARC])
        near[a + 1 : b, SPOT : SPOT + 3] = 0.0
        on[a + 1 : b] = on[a]
        on[a + 1 : b, LINK:] = BARE


def join_over_edges(nodes: Array, q: Array, near: Array, on: Any, thick: Array, edge: float) -> None:
    """Has one of neighbours at both sides of an edge, that which is least askew, carry what all do.

    edge: as `Laid.askew` knows an edge, in radii of the cable.
    """
    single = (on[:, 0] != BARE) & (on[:, SECOND:] == BARE).all(axis=1)
    touched = enumerate(np.flatnonzero(single).tolist())
    for _, found in groupby(touched, key=lambda ik: (ik[1] - ik[0], on[ik[1], 0])):
        row = [k for _, k in found]
        leaning = [float(np.dot(tangent_of(q, k), near[k, NORMAL : NORMAL + 3])) for k in row]
        before = [i for i, x in enumerate(leaning) if x < -ASTRIDE]
        after = [i for i, x in enumerate(leaning) if x > ASTRIDE]
        if not before or not after or before[0] > after[-1]:
            continue
        a, b = row[before[0]], row[after[-1]]
        turn = math.acos(min(1.0, float(near[a, NORMAL : NORMAL + 3] @ near[b, NORMAL : NORMAL + 3])))
        if turn * thick[a] < edge * (nodes[b] - nodes[a]):
            continue
        kept = min(range(before[0], after[-1] + 1), key=lambda i: abs(leaning[i]))
        for k in range(a, b + 1):
            for column in (PRESS, *range(RUB, RUB + 3), *range(HELD, HELD + 3)):
                if k != row[kept]:
                    near[row[kept], column] += near[k, column]
                    near[k, column] = 0.0
            if k != row[kept]:
                on[k] = BARE


def off_edges(h: Array, q: Array, near: Array, on: Any, flex: Array, bodies: TouchBodies) -> bool:
    """Whether a contact that has no neighbour stands beside an edge over which it would run: its node alone holds it.

    There the surface has turned by more than its curvature at the contact tells.
    """
    for k in np.flatnonzero(on[:, 0] != BARE):
        second = along_cable(q, h, near, on, k, 0.0, flex)
        if second <= 0.0:
            continue
        t, n = np.array(tangent_of(q, k)), near[k, NORMAL : NORMAL + 3]
        way = min(max(-float(t @ n) / second, -0.5 * h[k - 1]), 0.5 * h[k])
        b, there = on[k, 0], tuple(near[k, SPOT : SPOT + 3] + way * t)
        body = bodies.table[b], bodies.frames[b], bodies.triangles, bodies.tree
        turned = touch(*body, there, tuple(n), False, bodies.stack)[1]
        told = n + way * near[k, CURVED : CURVED + 9].reshape(3, 3) @ t
        if float(turned @ told) < SAME_FACE * float(np.linalg.norm(told)):
            return True
    return False


def stretched(nodes: Array, inside: Any, spacing: Array, middles: Array) -> Array:
    """Middles of the elements much longer than `spacing` [m] at `middles`; inside: as for `worst`."""
    at = 0.5 * (nodes[1:] + nodes[:-1])
    return np.asarray(at[inside & (np.diff(nodes) > STRETCHED * np.interp(at, middles, spacing))])


def spread(old: Array, new: Array, fixed: Array) -> tuple[Array, Array]:
    """Arc lengths in ascending order, and where they go if `old` go to `new` and `fixed` stay."""
    before, after = np.concatenate((old, fixed)), np.concatenate((new, fixed))
    order = np.argsort(before)
    return before[order], after[order]
