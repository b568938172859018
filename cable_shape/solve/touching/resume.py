"""What a shape in contact tells the solver that goes on from it: which nodes are pressed, what supports carry."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact.near import ARC, BARE, HELD, MATE, NORMAL, PRESS, RUB, WAS
from cable_shape.shape import TOUCH, CableShape

_ALONE = 1.5  #: of an element: contacts that are further than this from the next one of their body are no row
_NEAR = 0.1  #: of an element: a node nearer to a contact is its node


def pressed_rows(shape: CableShape, names: tuple[str, ...]) -> Array:
    """(k, TOUCH), the shape's contacts with the bodies of these names, the row of the name in place of the body.

    Parts of one body have its name, in one order.
    """
    known = {one: row for row, one in enumerate(numbered(names))}
    told = numbered(shape.bodies)
    rows = [(row[0], known[told[int(row[1])]], *row[2:]) for row in shape.touches if told[int(row[1])] in known]
    return np.array(rows).reshape(-1, TOUCH)


def numbered(names: tuple[str, ...]) -> list[tuple[str, int]]:
    """Each name, and how many of the same were before."""
    seen: Counter[str] = Counter()
    out = []
    for name in names:
        out.append((name, seen[name]))
        seen[name] += 1
    return out


def with_lone(nodes: Array, rows: Array) -> Array:
    """The nodes (N+1,), and one at each contact that is not one of a row on its body."""
    for row in rows:
        others = rows[(rows[:, 1] == row[1]) & (rows[:, 0] != row[0]), 0]
        j = min(max(int(np.searchsorted(nodes, row[0])), 1), nodes.size - 1)
        h = nodes[j] - nodes[j - 1]
        lone = float(np.abs(others - row[0]).min(initial=np.inf)) > _ALONE * h
        if lone and min(row[0] - nodes[j - 1], nodes[j] - row[0]) > _NEAR * h:
            nodes = np.insert(nodes, j, row[0])
    return nodes


def press_nodes(rows: Array, nodes: Array, held: Any, near: Array, on: Array) -> None:
    """Shares the forces of contacts out among the nodes beside them that nothing holds; near and on of one solution."""
    free = np.ones(nodes.size, dtype=bool)
    free[held] = False
    free[[0, -1]] = False
    for row in rows:
        j = min(max(int(np.searchsorted(nodes, row[0])), 1), nodes.size - 1)
        share = (row[0] - nodes[j - 1]) / (nodes[j] - nodes[j - 1])
        for k, part in ((j - 1, 1.0 - share), (j, share)):
            if free[k] and part > _NEAR:
                on[k, :2] = row[1]
                near[k, PRESS] += part * row[8]
                near[k, NORMAL : NORMAL + 3] = row[5:8]
                near[k, RUB : RUB + 3] += part * row[9:12]


def hold_nodes(nodes: Array, own: Array, shape: CableShape, frames: Array, near: Array, on: Any) -> None:
    """Has friction count from this shape on, at the nodes that `press_nodes` has pressed; frames (m, 4, 3): bodies'.

    own (n,) [m]: arc lengths of the nodes on their own cable.
    """
    for k in np.flatnonzero(on[:, 0] != BARE):
        axes, origin = frames[on[k, 0], :3], frames[on[k, 0], 3]
        spot = np.array([np.interp(nodes[k], shape.arc_length, column) for column in shape.positions.T])
        near[k, WAS : WAS + 3] = axes @ (spot - origin)
        near[k, HELD : HELD + 3] = axes @ near[k, RUB : RUB + 3]
        near[k, ARC], near[k, MATE] = own[k], 1.0 + on[k, 0]
