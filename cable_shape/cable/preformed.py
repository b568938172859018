"""Cables that were drawn bent, as their makers form hoses and pipes: the curve of :meth:`Cable.from_centreline`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from cable_shape.cable.centreline import Centreline
from cable_shape.errors import ArgumentError

#: What a curve gives, so that nobody else does.
GIVEN = ("length", "rest_curvature")


def form_of(curve: Centreline | ArrayLike, keywords: Mapping[str, Any]) -> Centreline:
    """The form of a cable with these keywords, of which a curve gives GIVEN."""
    for name in GIVEN:
        if name in keywords:
            bound = "the curve says it"
            raise ArgumentError.of(name, keywords[name], bound, "Leave it out, or make the Cable without a curve.")
    return curve if isinstance(curve, Centreline) else Centreline.from_points(curve)


def check_crossing(line: Centreline, within: float, where: str = "centreline") -> None:
    """Refuses a curve that comes nearer to itself than this [m]: what is as thick as that is in its own way."""
    found = line.crosses_itself(within)
    if found is not None:
        raise ArgumentError(
            f"{where}: the curve runs through itself at {found[0]:.4g} m and {found[1]:.4g} m of its length. Draw the "
            "cable beside itself, or give each piece of it as a cable of its own."
        )
