"""Where the nodes of a cable in contact go: at first, beside the ends of rows, and where contacts have run."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import contact_slide, rod_mesh
from cable_shape.kernels.contact_near import BARE, NORMAL, PRESS
from cable_shape.shape import CableShape

ELEMENTS = 48  #: of a mesh before nodes are added
FEWEST_ELEMENTS = 16  #: of them between two clips
WORST = 0.5  #: of the contact that misses most: those above get nodes beside them
STRETCHED = 1.6  #: times as long as at first: elements that an eyelet has stretched so far are divided
TIP = 5e-5  #: [m] from a free end, which is no support itself, to the node that stands in for it
_ABSCISSAE = 65


def first_nodes(arcs: Array, stops: Array, bend: float, free: bool, shape: CableShape, finer: float = 1.0) -> Array:
    """Arc lengths for a cable of which `shape` is a rough idea: denser towards what holds it.

    arcs (b+1,) [m], of the supports; stops [m], where nodes must be; bend [N m^2]; free: the end is held by nothing;
    finer: so many times as many elements as usual.
    """
    pulls = np.linalg.norm(shape.force, axis=1)
    pieces = []
    for a, b in pairwise(arcs):
        inside = (shape.arc_length >= a) & (shape.arc_length <= b)
        tension = float(np.median(pulls[inside] if inside.any() else pulls))
        length = b - a
        layer = math.sqrt(bend / max(tension, bend / length**2))
        x, density = np.empty(_ABSCISSAE), np.empty(_ABSCISSAE)
        rod_mesh.layered(length, min(max(layer, 1e-5 * length), length), x, density)
        x, density = x + a, density + 0.5 * density.mean()
        x[0], x[-1] = a, b
        own = stops[(stops > a) & (stops < b)]
        count = max(FEWEST_ELEMENTS, math.ceil(finer * ELEMENTS * length / arcs[-1])) + 2 * own.size
        nodes = np.empty(count + 1)
        rod_mesh.equidistribute(x, density, own, count, nodes)
        pieces.append(nodes[:-1])
    nodes = np.append(np.concatenate(pieces), arcs[-1])
    if free:
        nodes = np.insert(nodes, nodes.size - 1, nodes[-1] - TIP)
    return nodes


def ends_of_rows(nodes: Array, q: Array, near: Array, on: Any) -> Array:
    """Arc lengths beside the contacts without two neighbours that miss most, halfway to the next nodes."""
    touched = on[:, 0] != BARE
    k = np.flatnonzero(touched[1:-1] & ~(touched[:-2] & touched[2:])) + 1
    x, y, z, w = q[k].T
    tangents = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
    missed = near[k, PRESS] * np.abs((tangents * near[k, NORMAL : NORMAL + 3]).sum(axis=1))
    k = k[missed >= WORST * missed.max(initial=0.0)]
    return np.unique(0.5 * np.concatenate((nodes[k] + nodes[k - 1], nodes[k] + nodes[k + 1])))


def tidied(nodes: Array, h: Array, q: Array, near: Array, on: Any, bend: float, stops: Array) -> Array | None:
    """Where a contact has run up to the next node, takes that away and divides the element on the other side.

    None: nowhere.
    """
    if not contact_slide.any_crowded(near, on, q, h, 1.0 / bend):
        return None
    away: list[int] = []
    new: list[float] = []
    for k in np.flatnonzero(on[1:-1, 0] != BARE) + 1:
        side = contact_slide.crowded(near, on, q, h, k, 1.0 / bend)
        j = k + side
        if side == 0 or j in (0, nodes.size - 1) or on[j, 0] != BARE or nodes[j] in stops:
            continue
        away.append(j)
        new.append(0.5 * (nodes[k] + nodes[k - side]))
    return np.sort(np.concatenate((np.delete(nodes, away), new))) if away else None


def thinned(nodes: Array, on: Any, spacing: Array, middles: Array, stops: Array) -> Array | None:
    """Takes away every other node far from where a row ends that is closer to the next than `spacing` [m] at `middles`.

    None: there is no such node.
    """
    touched = np.cumsum(on[:, 0] != BARE)
    k = np.arange(3, nodes.size - 3)
    around = touched[k + 2] - touched[k - 3]  # of five nodes
    close = nodes[k + 1] - nodes[k - 1] < 1.2 * np.interp(nodes[k], middles, spacing)
    spare = close & ((around == 0) | (around == 5))
    if not spare.any():
        return None
    away: list[int] = []
    for j in k[spare & ~np.isin(nodes[k], stops)]:
        if not away or away[-1] < j - 1:
            away.append(int(j))
    return np.delete(nodes, away) if away else None


def stretched(nodes: Array, spacing: Array, middles: Array) -> Array:
    """Middles of the elements much longer than `spacing` [m] at `middles`."""
    at = 0.5 * (nodes[1:] + nodes[:-1])
    return np.asarray(at[np.diff(nodes) > STRETCHED * np.interp(at, middles, spacing)])


def spread(old: Array, new: Array, fixed: Array) -> tuple[Array, Array]:
    """Arc lengths in ascending order, and where they go if `old` go to `new` and `fixed` stay."""
    before, after = np.concatenate((old, fixed)), np.concatenate((new, fixed))
    order = np.argsort(before)
    return before[order], after[order]
