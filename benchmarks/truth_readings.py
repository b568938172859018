"""The same frames of real cables, read in other ways: what grips hold, how long the cable is, how it accelerates."""

from __future__ import annotations

import numpy as np
from figures import heading
from truth_data import Frames
from truth_limits import least, line

import cable_shape as cs

#: EI / weight [m^3] that are tried, every 58 %.
RATIOS = np.geomspace(1e-5, 0.1, 21)


def readings(cables: dict[int, Frames]) -> None:
    """Prints them, static and with inertial load."""
    heading("Other readings of the same frames: least mean distance that any EI/w reaches on them, % of the length")
    print(f"{'':52}" + "".join(f"{f'cable{n}':>14}" for n in cables))
    for row in ("static", "inertial load"):
        found: list[dict[str, float]] = []
        for frames in cables.values():
            calm = np.flatnonzero(frames.kind == "quasi")
            read = otherwise([(frames.static if row == "static" else frames.moving)[i] for i in calm], frames.cable)
            found.append({name: 100.0 * least(*one, RATIOS)[0] / frames.cable.length for name, one in read.items()})
        for name in found[0]:
            line(f"{row}: {name}", [each[name] for each in found])


def otherwise(seen: list[cs.Observation], cable: cs.Cable) -> dict[str, tuple[list[cs.Observation], cs.Cable]]:
    """Observations and cable of each reading."""

    def again(start: str, end: str, factor: float = 1.0) -> list[cs.Observation]:
        out = []
        for o in seen:
            assert isinstance(o.end, cs.Grip)
            load = None if o.acceleration is None else factor * o.acceleration
            grips = cs.Grip(o.start.pose, start), cs.Grip(o.end.pose, end)
            out.append(cs.Observation(*grips, o.points, acceleration=load))
        return out

    found = {
        "as told": (seen, cable),
        "twist held at both ends": (again("clamped", "clamped"), cable),
        "start free to turn": (again("pinned", "swivel"), cable),
        "end free to turn": (again("clamped", "pinned"), cable),
        "0.5 % shorter": (seen, cable.replace(length=0.995 * cable.length)),
        "0.5 % longer": (seen, cable.replace(length=1.005 * cable.length)),
    }
    if any(o.acceleration is not None for o in seen):
        found["accelerations 5 % less"] = (again("clamped", "swivel", 0.95), cable)
        found["accelerations 5 % more"] = (again("clamped", "swivel", 1.05), cable)
    return found
