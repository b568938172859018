"""What a cycle is given: cables by name, and ends where a gripper is open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.errors import ArgumentError
from cable_shape.pose import Ends, FreeEnd
from cable_shape.prediction.layout import Laid


def opened_ends(segments: Mapping[str, Laid], ends: Any) -> Any:
    """The ends of a harness, free where a gripper is open, whatever pose it has."""
    if not isinstance(ends, Mapping):
        return ends
    out = dict(ends)
    for segment, laid in segments.items():
        end = f"{segment}.{laid.opened}"
        if laid.opened and not isinstance(out.get(end), FreeEnd):
            out[end] = None
    return out


def opened_end(ends: Ends, side: str) -> Ends:
    """The ends of a cable whose gripper at one of them is open, whatever pose it has."""
    free = [end if isinstance(end, FreeEnd) else None for end in ends]
    return (free[0], ends[1]) if side == "start" else (ends[0], free[1])  # type: ignore[return-value]


def named_ones(cables: Cable | Mapping[str, Cable | Harness]) -> tuple[dict[str, Cable], dict[str, Harness]]:
    """The cables and the harnesses by name; a cable that is alone is named "cable"."""
    if isinstance(cables, Cable):
        return {"cable": cables}, {}
    if isinstance(cables, Harness):  # type: ignore[unreachable]
        raise ArgumentError.of("cables", cables, "a harness needs a name", "Write Cycle({'h': harness}).")
    if not isinstance(cables, Mapping):
        raise ArgumentError.of("cables", cables, "it must be a Cable or a mapping", "Write {name: Cable(...)}.")
    if not cables:
        raise ArgumentError("cables = {} is not allowed: there must be at least one. Give a Cable.")
    for name, cable in cables.items():
        checks.word("cables", name)
        checks.instance(f"cables[{name!r}]", cable, (Cable, Harness), "Write Cable(length=..., ...).")
    return (
        {name: cable for name, cable in cables.items() if isinstance(cable, Cable)},
        {name: cable for name, cable in cables.items() if isinstance(cable, Harness)},
    )
