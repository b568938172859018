"""Cables whose properties change along them: :class:`Section`, and what a cable is made of where."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

if TYPE_CHECKING:
    from cable_shape.cable.cable import Cable
    from cable_shape.shape import CableShape

#: From arc length [m], to arc length, and a cable of what lies there.
Pieces: TypeAlias = "tuple[tuple[float, float, Cable], ...]"
#: Keywords of a cable that are of the whole of it.
_OF_THE_WHOLE = ("length", "tails", "sections", "stiffness_interval")


@final
class Section:
    """A stretch of a cable with properties of its own, such as a protection or a stiff connector.

    Parameters
    ----------
    start, end : float
        [m] of arc length, `end` above `start`, both on the cable.
    **properties
        Any keyword of :class:`cable_shape.Cable` but length, tails and sections; constant inside. What is not named is
        as in the rest of the cable. A number for `bending_stiffness` alone leaves the twisting stiffness as it is.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    __slots__ = ("end", "properties", "start")

    start: float
    end: float
    properties: Mapping[str, Any]

    def __init__(self, start: float, end: float, **properties: Any) -> None:
        put = object.__setattr__
        put(self, "start", checks.number("Section.start", start, at_least=0.0, unit="m"))
        put(self, "end", checks.number("Section.end", end, above=self.start, unit="m"))
        from cable_shape.cable.cable import Cable

        known = [name for name in Cable.__slots__ if name not in _OF_THE_WHOLE]
        checks.known_keys("Section", properties, known)
        rest = properties.get("rest_curvature")
        if rest is not None:
            properties["rest_curvature"] = tuple(checks.vector("Section.rest_curvature", rest, 3, "1/m").tolist())
        put(self, "properties", MappingProxyType(properties))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a Section is fixed; make another")

    def __reduce__(self) -> tuple[Any, ...]:
        return section_from, (self.as_dict(),)

    def as_dict(self) -> dict[str, Any]:
        """The keywords that make this section, as plain numbers and lists."""
        plain = {key: list(value) if isinstance(value, tuple) else value for key, value in self.properties.items()}
        return {"start": self.start, "end": self.end, **plain}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Section) and self.as_dict() == other.as_dict()

    def __hash__(self) -> int:
        return hash((self.start, self.end))

    def __repr__(self) -> str:
        return f"Section({', '.join(f'{k}={v!r}' for k, v in self.as_dict().items())})"


def section_from(values: Any, where: str = "section") -> Section:
    """A section from its keywords."""
    if isinstance(values, Section):
        return values
    remedy = "Write Section(start, end, bending_stiffness=...)."
    if not isinstance(values, Mapping):
        raise ArgumentError.of(where, values, "it must be a Section", remedy)
    for key in ("start", "end"):
        if key not in values:
            raise ArgumentError(f"{where}: the key {key!r} is missing. Add it, in m of arc length.")
    return Section(**values)


def sections_of(values: Any, length: float) -> tuple[Section, ...]:
    """Sections of a cable in ascending order, which do not overlap and end on the cable."""
    if values is None:
        return ()
    items = checks.entries("sections", values, object, "Give a list of Section.")
    found = sorted((section_from(item, f"sections[{i}]") for i, item in enumerate(items)), key=lambda one: one.start)
    before = 0.0
    for one in found:
        if one.start < before:
            bound = f"it overlaps the section that ends at {before:g} m"
            raise ArgumentError.of("sections: start", one.start, bound, "Let one begin where the other ends.")
        if one.end > length * (1.0 + 1e-12):
            bound = f"it must be at most the length of the cable, {length:g} m"
            raise ArgumentError.of("sections: end", one.end, bound, "Shorten the section, or lengthen the cable.")
        before = one.end
    return tuple(found)


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
