"""What a cycle is given: cables by name, what is told of each, and ends where a gripper is open."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cycle.dynamic import DYNAMIC
from cable_shape.errors import ArgumentError
from cable_shape.pose import Ends, FreeEnd
from cable_shape.prediction.layout import Laid
from cable_shape.uncertainty.uncertainty import Uncertainty

BY_NAME = "Write {name of the cable: ..}."
_LONGEST_LOOK = 10.0  # s


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


def loads_of(
    load: ArrayLike | Mapping[str, ArrayLike] | None, named: Mapping[str, Cable], every: Collection[str]
) -> dict[str, Any]:
    """`distributed_load` of each cable, or of some cables and harnesses."""
    if isinstance(load, Mapping):
        return checks.mapping("distributed_load", load, every, BY_NAME)
    return dict.fromkeys(named, load)


def look_of(look_ahead: float, motion: str) -> float:
    """`look_ahead` [s] of a cycle with this `motion`."""
    look = checks.number("look_ahead", look_ahead, at_least=0.0, at_most=_LONGEST_LOOK, unit="s")
    if look > 0.0 and motion != DYNAMIC:
        bound = "only a cable that swings goes on when its grips stop"
        raise ArgumentError.of("look_ahead", look, bound, "Write motion='dynamic', or leave it out.")
    return look


def uncertainties_of(
    uncertainty: Uncertainty | Mapping[str, Uncertainty] | None, every: Collection[str]
) -> dict[str, Uncertainty]:
    """`uncertainty` of each cable and harness, or of some."""
    if isinstance(uncertainty, Uncertainty):
        return dict.fromkeys(every, uncertainty)
    known = checks.mapping("uncertainty", uncertainty, every, f"Write Uncertainty(...). {BY_NAME}")
    for name, one in known.items():
        checks.instance(f"uncertainty[{name!r}]", one, (Uncertainty,), "Write Uncertainty(...).")
    return known
