"""What a calibration may fit: names, units, and how a vector of them makes a cable and grips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.pose import FreeEnd, Grip, Pose

#: name -> (components, unit, step of the finite differences, largest step at once, whether its logarithm is fitted).
#: Stiffness is fitted as a logarithm: it is positive, and known to so many per cent.
KNOWN: dict[str, tuple[tuple[str, ...], str, float, float, bool]] = {
    "bending_stiffness": (("bending_stiffness",), "N m^2", 2e-2, 1.5, True),
    "twisting_stiffness": (("twisting_stiffness",), "N m^2", 2e-2, 1.5, True),
    "axial_stiffness": (("axial_stiffness",), "N", 2e-2, 1.5, True),
    "length": (("length",), "m", 1e-4, 0.02, False),
    "rest_curvature": (("rest_curvature_1", "rest_curvature_2"), "1/m", 1e-2, 2.0, False),
    "start_offset": (("start_x", "start_y", "start_z"), "m", 1e-4, 0.01, False),
    "end_offset": (("end_x", "end_y", "end_z"), "m", 1e-4, 0.01, False),
    "start_tilt": (("start_tilt_1", "start_tilt_2"), "rad", 2e-3, 0.2, False),
    "end_tilt": (("end_tilt_1", "end_tilt_2"), "rad", 2e-3, 0.2, False),
    "roll": (("roll",), "rad", 2e-3, 0.5, False),
}
_STIFFNESS = ("bending_stiffness", "twisting_stiffness", "axial_stiffness")


@final
@dataclass(frozen=True, slots=True)
class Parameter:
    """One number to be fitted. `step`: of finite differences; `most`: largest change at once; both of `log` if so."""

    name: str
    unit: str
    step: float
    most: float
    log: bool
    prior: float  # standard deviation about the start (of the logarithm if `log`); infinite: none


@final
class Parameters:
    """The numbers to be fitted, in their order, about a cable to start from.

    fit: names of `KNOWN`; priors: standard deviation by name, of a stiffness as a fraction of it.
    """

    def __init__(self, cable: Cable, fit: Sequence[str], priors: Mapping[str, float] | None = None) -> None:
        names = (fit,) if isinstance(fit, str) else tuple(fit)
        if not names or len(set(names)) != len(names):
            raise ArgumentError.of("fit", names, "it must name something, each once", f"Known: {', '.join(KNOWN)}.")
        for name in names:
            if name not in KNOWN:
                raise UnknownKeyError.among("fit", name, KNOWN)
        given = dict(priors or {})
        for name in given:
            if name not in names:
                raise UnknownKeyError.among("priors", name, names)
        self.cable = cable
        self.names = names
        self.each: list[Parameter] = []
        start: list[float] = []
        for name in names:
            parts, unit, step, most, log = KNOWN[name]
            prior = checks.number(f"priors[{name!r}]", given[name], above=0.0) if name in given else math.inf
            self.each += [Parameter(part, unit, step, most, log, prior) for part in parts]
            start += self._start(name)
        self.start: Array = np.array(start)

    def _start(self, name: str) -> list[float]:
        """Where the fit begins."""
        cable = self.cable
        if name == "length":
            return [cable.length]
        if name == "rest_curvature":
            if cable.rest_curvature.ndim == 2:
                remedy = "Give a cable whose rest curvature is three numbers, or do not fit it."
                raise ArgumentError.of("rest_curvature", "a table", "only a constant one is fitted", remedy)
            return [float(x) for x in cable.rest_curvature[:2]]
        if name in _STIFFNESS:
            value = cable.mean_bending_stiffness if name == "bending_stiffness" else getattr(cable, name)
            if not value:
                raise ArgumentError.of(name, value, "to be fitted it must be given above 0", "Give a rough value.")
            return [math.log(value)]
        return [0.0] * len(KNOWN[name][0])

    def by_name(self, values: Array) -> dict[str, float]:
        """Each number in its unit."""
        return {p.name: math.exp(v) if p.log else float(v) for p, v in zip(self.each, values, strict=True)}

    def make_cable(self, values: Array) -> Cable:
        """The cable of these numbers. GJ follows EI, unless it is fitted, too."""
        now, cable = self.by_name(values), self.cable
        changes: dict[str, Any] = {name: now[name] for name in ("length", *_STIFFNESS[1:]) if name in now}
        if "bending_stiffness" in now:
            ratio = now["bending_stiffness"] / cable.mean_bending_stiffness
            changes["bending_stiffness"] = [ratio * x for x in cable.bending_stiffness]
            changes.setdefault("twisting_stiffness", ratio * cable.twisting_stiffness)
        if "rest_curvature_1" in now:
            changes["rest_curvature"] = (now["rest_curvature_1"], now["rest_curvature_2"], cable.rest_curvature[2])
        return cable.replace(**changes) if changes else cable

    def offset(self, values: Array, side: str) -> Pose | None:
        """How the cable frame at the "start" or "end" lies beside what its grip says; None: as it says."""
        now = self.by_name(values)
        place = [now.get(f"{side}_{axis}", 0.0) for axis in "xyz"]
        turn = [now.get(f"{side}_tilt_1", 0.0), now.get(f"{side}_tilt_2", 0.0)]
        roll = now.get("roll", 0.0) if side == "end" else 0.0
        if not any(place) and not any(turn) and roll == 0.0:
            return None
        angle = math.hypot(*turn)
        f = 0.5 if angle == 0.0 else math.sin(0.5 * angle) / angle
        tilt = Pose(place, (f * turn[0], f * turn[1], 0.0, math.cos(0.5 * angle)))
        return tilt * Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(0.5 * roll), math.cos(0.5 * roll)))


def held(end: Grip | FreeEnd, offset: Pose | None) -> Grip | FreeEnd:
    """An end with the cable frame displaced by `offset` in itself."""
    if offset is None or isinstance(end, FreeEnd):
        return end
    return Grip(end.pose, end.kind, end.offset * offset, end.curvature)
