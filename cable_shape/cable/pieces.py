"""What a cable with sections is made of where: :func:`pieces_of`, and what is asked of the pieces."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.section import Section
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.shape import CableShape

#: From arc length [m], to arc length, and a cable of what lies there.
Pieces: TypeAlias = tuple[tuple[float, float, Cable], ...]
#: What of a cable its sections follow where it becomes another one.
_IN_RATIO = (
    "length", "bending_stiffness", "twisting_stiffness", "axial_stiffness", "linear_density", "retardation_time", "drag"
)  # fmt: skip


def pieces_of(cable: Cable) -> Pieces:
    """Where a cable is made of what: from arc length [m], to arc length, and a cable of the whole length of it."""
    return _pieces(cable) if cable.sections else ((0.0, cable.length, cable),)


@lru_cache(maxsize=256)  # asked for in every cycle, and cables are fixed
def _pieces(cable: Cable) -> Pieces:
    base = cable.replace(sections=None)
    out, at = [], 0.0
    for section in cable.sections:
        if section.start > at:
            out.append((at, section.start, base))
        changes = dict(section.properties)
        if "bending_stiffness" in changes:
            changes.setdefault("twisting_stiffness", base.twisting_stiffness)
        out.append((section.start, min(section.end, cable.length), base.replace(**changes)))
        at = section.end
    if at < cable.length:
        out.append((at, cable.length, base))
    return tuple(out)


def cable_at(cable: Cable, arc_length: float) -> Cable:
    """What a cable is made of at an arc length [m]: the cable itself where it has no sections."""
    pieces = pieces_of(cable)
    return next((one for _, end, one in pieces if arc_length < end), pieces[-1][2])


def radius_of(cable: Cable) -> float:
    """[m], of the thinnest piece of a cable; what others are thicker by is `thicker`."""
    return 0.5 * min(one.diameter for _, _, one in pieces_of(cable))


def widest(cable: Cable) -> float:
    """[m], diameter of the thickest piece of a cable."""
    return max(one.diameter for _, _, one in pieces_of(cable))


def stretches(cable: Cable) -> bool:
    """Whether all of a cable gives to tension."""
    return all(one.axial_stiffness is not None for _, _, one in pieces_of(cable))


def slowest(cable: Cable) -> Cable:
    """A cable without sections that swings at most as fast: as soft as the softest piece, as heavy as the heaviest."""
    if not cable.sections:
        return cable
    made = [one for _, _, one in pieces_of(cable)]
    softest = min(made, key=lambda one: one.mean_bending_stiffness)
    return softest.replace(linear_density=max(one.linear_density for one in made))


def thicker(cable: Cable, arc_length: Array) -> Array | None:
    """(n,) [m], by how much a cable is thicker than `radius_of` at arc lengths; None: nowhere."""
    if not cable.sections:
        return None
    least = radius_of(cable)
    more = np.zeros(len(arc_length))
    for start, end, one in pieces_of(cable):
        here = (arc_length >= start) & (arc_length <= end)
        more[here] = np.maximum(more[here], 0.5 * one.diameter - least)
    return more if more.any() else None


def changed(cable: Cable, **changes: Any) -> Cable:
    """A cable with other numbers, whose sections keep their ratio to it, and where along it they are."""
    if not cable.sections:
        return cable.replace(**changes)
    ratios = {
        key: np.atleast_1d(value)[0] / np.atleast_1d(getattr(cable, key))[0]
        for key, value in changes.items()
        if key in _IN_RATIO
    }
    stretch = ratios.pop("length", 1.0)
    sections = []
    for one in cable.sections:
        own: dict[str, Any] = dict(one.properties)
        for key, ratio in ratios.items():
            if own.get(key) is not None:
                own[key] = [ratio * x for x in own[key]] if np.ndim(own[key]) else ratio * own[key]
        sections.append(
            Section(stretch * one.start, min(stretch * one.end, changes.get("length", cable.length)), **own)
        )
    return cable.replace(**changes, sections=sections)


def refuse(cable: Cable, who: str, remedy: str = "Leave them out, or predict single shapes.") -> None:
    """Refuses a cable with sections where they are not known."""
    if cable.sections:
        raise ArgumentError.of("cable.sections", len(cable.sections), f"{who} knows no sections", remedy)


def energy_of_sections(cable: Cable, shape: CableShape, gravity: Array) -> float:
    """[J], potential energy of what the sections weigh more than the rest of the cable, from the points of its shape.

    Between points the centreline is the cubic of their places and tangents.
    """
    heavier = [(a, b, one.linear_density - cable.linear_density) for a, b, one in pieces_of(cable)]
    if not any(more for _, _, more in heavier):
        return 0.0
    s, r, t = shape.arc_length, shape.positions @ gravity, shape.tangents @ gravity
    h = s[1] - s[0]
    whole = h * (0.5 * (r[:-1] + r[1:]) + h / 12.0 * (t[:-1] - t[1:]))
    up_to = np.concatenate(([0.0], np.cumsum(whole)))

    def integral(at: float) -> float:
        i = min(int(at / h), s.size - 2)
        x = at / h - i
        own = r[i] * (x - x**3 + 0.5 * x**4) + r[i + 1] * (x**3 - 0.5 * x**4)
        own += h * (t[i] * (0.5 * x**2 - 2.0 / 3.0 * x**3 + 0.25 * x**4) + t[i + 1] * (0.25 * x**4 - x**3 / 3.0))
        return float(up_to[i] + h * own)

    return -sum(more * (integral(b) - integral(a)) for a, b, more in heavier if more)
