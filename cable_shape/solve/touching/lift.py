"""Which cables, and harnesses, lie over which: those are held higher, from where they are let down."""

from __future__ import annotations

from collections.abc import Sequence

from cable_shape.checks import Array
from cable_shape.solve.touching.spot import Spot


def levels(spots: Sequence[Spot], parts: Sequence[int], down: Array) -> dict[int, int]:
    """For each part of these spots how many lie below it at most; none at all where no order tells.

    That is where one touches itself, or each of two lies over the other, directly or not. parts: of each strand its
    own.
    """
    over = set()
    for spot in spots:
        first, second = (parts[strand] for strand in spot.cables)
        over.add((first, second) if float(spot.normal @ down) < 0.0 else (second, first))
    out = dict.fromkeys({part for pair in over for part in pair}, 0)
    for _ in out:
        before = dict(out)
        for upper, lower in over:
            out[upper] = max(out[upper], out[lower] + 1)
        if out == before:
            return out
    return {}
