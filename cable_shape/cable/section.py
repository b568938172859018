"""A stretch of a cable with properties of its own: :class:`Section`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.errors import ArgumentError

#: Keywords of a cable that a stretch of it may have otherwise; the rest are of the whole of it.
PROPERTIES = (
    "allowable_stress",
    "axial_stiffness",
    "bending_stiffness",
    "diameter",
    "drag",
    "friction",
    "gradient_length",
    "inner_diameter",
    "linear_density",
    "max_tension",
    "max_twist_rate",
    "min_bend_radius",
    "rest_curvature",
    "retardation_time",
    "shear_stiffness",
    "twisting_stiffness",
)


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

    __slots__ = ("_hash", "end", "properties", "start")

    start: float
    end: float
    properties: Mapping[str, Any]
    _hash: int

    def __init__(self, start: float, end: float, **properties: Any) -> None:
        put = object.__setattr__
        put(self, "start", checks.number("Section.start", start, at_least=0.0, unit="m"))
        put(self, "end", checks.number("Section.end", end, above=self.start, unit="m"))
        checks.known_keys("Section", properties, PROPERTIES)
        rest = properties.get("rest_curvature")
        if rest is not None:
            properties["rest_curvature"] = tuple(checks.vector("Section.rest_curvature", rest, 3, "1/m").tolist())
        put(self, "properties", MappingProxyType(properties))
        stiffness = np.ravel(properties.get("bending_stiffness", ())).tolist()
        put(self, "_hash", hash((self.start, self.end, *stiffness)))

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
        return self._hash

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
