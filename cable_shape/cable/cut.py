"""A stretch of a cable as a cable of its own: :func:`stretch_of`, what two grips have between them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cable_shape.cable.cable import LENGTHS, Cable
from cable_shape.cable.section import Section
from cable_shape.errors import ArgumentError


def reach_of(cable: Cable) -> tuple[float, float]:
    """[m], where a cable begins and ends, tails and all: arc lengths from its own start."""
    return 0.0 - cable.tails.get("start", 0.0), cable.length + cable.tails.get("end", 0.0)


@lru_cache(maxsize=64)  # asked for several times in an edit
def stretch_of(cable: Cable, first: float, last: float) -> Cable:
    """The cable from one arc length [m] to another one, with the rest as its tails.

    Its tails are made like the ends that they hang from. A table of rest curvature keeps its spacing, about: its rows
    are interpolated.

    Raises
    ------
    ArgumentError
        If there is no cable there, or the stretch is too short for one.
    """
    low, high = reach_of(cable)
    for name, at in (("first", first), ("last", last)):
        if not low <= at <= high:
            bound = f"the cable goes from {low:g} m to {high:g} m of arc length"
            raise ArgumentError.of(name, at, bound, "Give an arc length on it.")
    if not last - first >= LENGTHS[0]:
        bound = f"at least {LENGTHS[0]:g} m of cable must be between the grips, and the start is at {first:g} m"
        raise ArgumentError.of("last", last, bound, "Grip the end further along the cable than the start.")
    if (first, last) == (0.0, cable.length):
        return cable
    tails = {side: more for side, more in (("start", first - low), ("end", high - last)) if more >= LENGTHS[0]}
    return cable.replace(
        length=last - first,
        tails=tails,
        sections=_sections(cable, first, last),
        rest_curvature=_rest_curvature(cable, first, last),
    )


def _sections(cable: Cable, first: float, last: float) -> list[Section]:
    """Those between two arc lengths; one that reaches an end goes on in the tail there."""
    out = []
    for one in cable.sections:
        start = first if one.start == 0.0 else one.start
        end = max(last, cable.length) if one.end >= cable.length else one.end
        start, end = max(start, first), min(end, last)
        if end > start:
            out.append(Section(start - first, end - first, **one.properties))
    return out


def _rest_curvature(cable: Cable, first: float, last: float) -> np.ndarray:
    """(3,) or (n, 3) [1/m], between two arc lengths; beyond the ends as it is there."""
    table = cable.rest_curvature
    if table.ndim == 1:
        return table
    rows = max(2, 1 + round((last - first) / cable.length * (len(table) - 1)))
    own, at = np.linspace(0.0, cable.length, len(table)), np.linspace(first, last, rows)
    return np.stack([np.interp(at, own, column) for column in table.T], axis=1)
