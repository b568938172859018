"""From the curves of a KBL segment to the one between its nodes: :func:`drawn`.

They may be stored in any order and direction, and run past the nodes where a segment is a piece of a longer bundle:
they are joined at their ends, and cut where they are nearest to the nodes.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from cable_shape.cable.b_spline import basis, clamped, spans
from cable_shape.cable.centreline import Centreline
from cable_shape.cable.kbl_parts import KblSegment
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

#: [m]: ends of curves that are nearer than this meet, and a node nearer than this is on its curve.
JOINT, ON = 2e-5, 1e-3
#: A curve that is longer or shorter than the segment by this share is not read rightly.
ALIKE = 0.02
_READINGS = (("uniform, not clamped", basis), ("clamped", clamped))


def drawn(segment: KblSegment, start: Array, end: Array) -> tuple[Centreline | None, str]:
    """The curve between two nodes (3,) [m], and what is odd about it, in words; None where none leads there."""
    if not segment.curves:
        return None, "it has no curve"
    stated = segment.virtual or segment.physical
    best: tuple[float, Centreline] | None = None
    for _, reading in _READINGS:
        if all(degree == 1 for degree, _ in segment.curves) and best is not None:
            break  # straight pieces are alike in both
        pieces = [spans(points, degree, reading(degree)) for degree, points in segment.curves]
        try:
            found, off = _between(pieces, start, end)
        except ArgumentError:
            continue
        far = off / ON + (0.0 if stated is None else abs(found.length / stated - 1.0) / ALIKE)
        if best is None or far < best[0]:
            best = far, found
        if far < 1.0:
            return found, ""
    if best is None or best[0] > 2.0:
        return None, "its curves do not lead from node to node in its length"
    return best[1], "its curve and its length or nodes differ"


def straight(start: Array, end: Array) -> Centreline:
    """The line between two nodes."""
    return Centreline.from_points(np.stack((start, end)))


def _between(pieces: list[Array], start: Array, end: Array) -> tuple[Centreline, float]:
    """The piece of the joined curves from one node to the other, and how far off [m] the farther node is."""
    c = _joined(pieces)
    whole = Centreline(PPoly(c, np.arange(c.shape[1] + 1.0)))
    tips = np.linalg.norm(_ends(c) - np.stack((start, end)), axis=1).max()
    if tips <= JOINT:
        return whole, float(tips)
    at, off = whole.nearest(np.stack((start, end)))
    return whole.cut(*at.tolist()), float(off.max())


def _joined(pieces: list[Array]) -> Array:
    """All curves one after the other (k + 1, m, 3): from the first on, and before it, whichever way each was stored."""
    order = max(len(c) for c in pieces)
    left = [np.concatenate((np.zeros((order - len(c), *c.shape[1:])), c)) for c in pieces]
    chain = left.pop(0)
    while left:
        tips = _ends(chain)
        gaps = []
        for i, c in enumerate(left):
            a, b = _ends(c)
            for side, tip, near in ((1, tips[1], a), (-1, tips[1], b), (2, tips[0], b), (-2, tips[0], a)):
                gaps.append((float(np.linalg.norm(tip - near)), i, side))
        gap, i, side = min(gaps)
        if gap > JOINT:
            break  # what does not join on is of no use
        piece = left.pop(i)
        piece = _reversed(piece) if side < 0 else piece
        chain = np.concatenate((chain, piece) if abs(side) == 1 else (piece, chain), axis=1)
    return chain


def _ends(c: Array) -> Array:
    """(2, 3): where pieces over 0 .. 1 begin and end."""
    return np.stack((c[-1, 0], c[:, -1].sum(axis=0)))


def _reversed(c: Array) -> Array:
    """The same pieces from their end."""
    from cable_shape.cable.centreline import _shifted

    out = _shifted(c, np.ones(c.shape[1]))[:, ::-1]
    return np.asarray(out * ((-1.0) ** np.arange(len(c) - 1, -1, -1))[:, None, None])
