"""What a calibration of a harness may fit: names, units, and how a vector of them makes a harness and its grips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness, run_of
from cable_shape.cable.junction import Junction
from cable_shape.cable.pieces import changed
from cable_shape.calibration.parameters import Parameter, displacement
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.pose import Grip, Pose
from cable_shape.solve.harness_problem import End

#: Kind of number -> (its components, unit, step of the finite differences, largest step at once, whether its logarithm
#: is fitted); of segments, then of ends.
OF_SEGMENTS: dict[str, tuple[tuple[str, ...], str, float, float, bool]] = {
    "bending_stiffness": (("bending_stiffness",), "N m^2", 2e-2, 1.0, True),
    "twisting_stiffness": (("twisting_stiffness",), "N m^2", 2e-2, 1.0, True),
    "linear_density": (("linear_density",), "kg/m", 1e-2, 0.5, True),
    "length": (("length",), "m", 1e-4, 0.02, False),
    "rest_curvature": (("rest_curvature_1", "rest_curvature_2"), "1/m", 1e-2, 2.0, False),
}
OF_ENDS: dict[str, tuple[tuple[str, ...], str, float, float, bool]] = {
    "tilt": (("tilt_1", "tilt_2"), "rad", 2e-3, 0.2, False),
    "roll": (("roll",), "rad", 2e-3, 0.3, False),
    "offset": (("offset_x", "offset_y", "offset_z"), "m", 1e-4, 0.01, False),
}
KNOWN = OF_SEGMENTS | OF_ENDS
#: After the kind: for every segment by itself; and a kind that stands for the tilts of branches in their junctions.
EACH, FRAMES = "each", "frames"
_WRITE = "Write KIND, KIND:SEGMENT, KIND:SEGMENT+SEGMENT or KIND:each of segments, KIND:END of ends."


@final
@dataclass(frozen=True, slots=True)
class Target:
    """What one name of a fit changes: `kind` of the segments, or of the end, in `of`; its numbers begin at `first`."""

    name: str
    kind: str
    of: tuple[str, ...]
    first: int

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its numbers."""
        _, _, where = self.name.partition(":")
        return tuple(f"{part}:{where}" if where else part for part in KNOWN[self.kind][0])

    @property
    def columns(self) -> list[int]:
        """Where its numbers are among all."""
        return list(range(self.first, self.first + len(KNOWN[self.kind][0])))

    def of_these(self, values: Array) -> Array:
        """Its numbers."""
        return values[self.columns]


@final
class HarnessParameters:
    """The numbers to be fitted, in their order, about a harness to start from.

    fit: names, see :func:`cable_shape.calibration.harness_fit.calibrate_harness`; priors: standard deviation by name,
    or by its kind for all of it, of stiffness and density as a fraction.
    """

    def __init__(self, harness: Harness, fit: str | Sequence[str], priors: Mapping[str, float] | None = None) -> None:
        given = (fit,) if isinstance(fit, str) else checks.entries("fit", fit, str, _WRITE)
        self.harness = harness
        meant = {one: name for name in given for one in _spelt_out(name, harness)}
        names = [one for name in given for one in _spelt_out(name, harness)]
        kinds = {name.partition(":")[0] for name in names}
        known = checks.mapping("priors", priors, (*names, *kinds, *given), "Write {name: standard deviation}.")
        spread = {key: checks.number(f"priors[{key!r}]", x, above=0.0) for key, x in known.items()}
        self.targets: list[Target] = []
        self.each: list[Parameter] = []
        start: list[float] = []
        for name in names:
            target = _target(name, harness, len(start))
            self._refuse_twice(target)
            self.targets.append(target)
            _, unit, step, most, log = KNOWN[target.kind]
            known_by = (key for key in (name, meant[name], target.kind) if key in spread)
            prior = spread.get(next(known_by, ""), math.inf)
            self.each += [Parameter(part, unit, step, most, log, prior) for part in target.parts]
            start += self._start(target)
        if not names:
            raise ArgumentError.of("fit", given, "it must name something", _WRITE)
        self.names = tuple(names)
        self.start: Array = np.array(start)

    def _refuse_twice(self, target: Target) -> None:
        """Refuses a segment, or an end, of which the same is fitted already."""
        for other in self.targets:
            both = set(other.of) & set(target.of)
            if other.kind == target.kind and both:
                bound = f"{target.kind} of {min(both)!r} is in {other.name!r}, too"
                raise ArgumentError.of("fit", target.name, bound, "Name every segment and every end once.")

    def _start(self, target: Target) -> list[float]:
        """Where the fit begins."""
        if target.kind in OF_ENDS:
            return [0.0] * len(KNOWN[target.kind][0])
        cables = [self.harness.segments[name] for name in target.of]
        if target.kind == "length":
            return [sum(cable.length for cable in cables)]
        if target.kind == "rest_curvature":
            return _common_curvature(target, cables)
        value = _number_of(cables[0], target.kind)
        if not value > 0.0:
            where = f"segments[{target.of[0]!r}].{target.kind}"
            raise ArgumentError.of(where, value, "to be fitted it must be above 0", "Give a rough value.")
        return [math.log(value)]

    @property
    def precision(self) -> Array:
        """(k, k), of what is known before: inverse of variances about the start; 0 where nothing is."""
        return np.diag(np.array([p.prior for p in self.each]) ** -2.0)

    @property
    def longer(self) -> dict[str, Array]:
        """(k,) of each segment: by how much longer [m] it is a unit of each number."""
        out = {name: np.zeros(len(self.start)) for name in self.harness.segments}
        for target in self.targets:
            if target.kind == "length":
                for name in target.of:
                    out[name][target.first] = self.harness.segments[name].length / self.start[target.first]
        return out

    def by_name(self, values: Array) -> dict[str, float]:
        """Each number in its unit."""
        return {p.name: math.exp(v) if p.log else float(v) for p, v in zip(self.each, values, strict=True)}

    def make(self, values: Array, lengths: Mapping[str, float] | None = None) -> Harness:
        """The harness of these numbers.

        GJ follows EI unless it is fitted, too. lengths: of segments that begin with others than the harness's.
        """
        changes: dict[str, dict[str, Any]] = {name: {} for name in self.harness.segments}
        for name, length in (lengths or {}).items():
            changes[name]["length"] = length
        for target in self.targets:
            if target.kind in OF_SEGMENTS:
                self._change(target, values, changes)
        cables = {}
        for name, cable in self.harness.segments.items():
            change = changes[name]
            if "bending_stiffness" in change:
                ratio = change["bending_stiffness"][0] / cable.bending_stiffness[0]
                change.setdefault("twisting_stiffness", ratio * cable.twisting_stiffness)
            cables[name] = changed(cable, **change) if change else cable
        return Harness(cables, [self._junction(junction, values) for junction in self.harness.junctions])

    def _change(self, target: Target, values: Array, changes: dict[str, dict[str, Any]]) -> None:
        """Adds to `changes` of each segment what one of the names makes other."""
        now = target.of_these(values)
        cables = [self.harness.segments[name] for name in target.of]
        start = self._start(target)
        for name, cable in zip(target.of, cables, strict=True):
            change = changes[name]
            if target.kind == "length":
                longer = (float(now[0]) - start[0]) * cable.length / start[0]
                change["length"] = change.get("length", cable.length) + longer
            elif target.kind == "rest_curvature":
                change["rest_curvature"] = (float(now[0]), float(now[1]), float(cable.rest_curvature[2]))
            elif target.kind == "bending_stiffness":
                factor = math.exp(now[0] - start[0])
                change["bending_stiffness"] = [factor * x for x in cable.bending_stiffness]
            else:
                change[target.kind] = math.exp(now[0] - start[0]) * getattr(cable, target.kind)

    def _junction(self, junction: Junction, values: Array) -> Junction:
        """A junction whose ends are turned as the numbers say."""
        frames = dict(junction.frames)
        for end in junction.ends:
            beside = self.beside(values, end)
            if beside is not None:
                frames[end] = junction.frame(end) * beside
        return Junction(junction.name, junction.ends, junction.kind, frames, junction.mass) if frames else junction

    def beside(self, values: Array, end: str) -> Pose | None:
        """How the cable frame of an end lies beside what its grip, or its junction, says; None: as it says."""
        own = {target.kind: target.of_these(values) for target in self.targets if target.of == (end,)}
        none = np.zeros(3)
        place, turn, roll = own.get("offset", none), own.get("tilt", none), own.get("roll", none)
        return displacement(place.tolist(), turn.tolist(), float(roll[0]))

    def held(self, values: Array, ends: Mapping[str, End]) -> dict[str, End]:
        """Ends with the cable frames of grips displaced in themselves."""
        out = dict(ends)
        for target in self.targets:
            end = target.of[0]
            if target.kind in OF_ENDS and end in out:
                held, beside = ends[end], self.beside(values, end)
                grip = Grip(held) if isinstance(held, Pose) else held
                if beside is not None and isinstance(grip, Grip):
                    out[end] = Grip(grip.pose, grip.kind, grip.offset * beside, grip.curvature)
        return out


def _spelt_out(name: str, harness: Harness) -> list[str]:
    """The names that one stands for: of each segment, or of each branch in the junctions."""
    kind, _, where = name.partition(":")
    if kind == FRAMES:
        known = {junction.name: junction for junction in harness.junctions}
        if where and where not in known:
            raise UnknownKeyError.among(f"fit: {FRAMES}", where, known)
        which = [known[where]] if where else [one for one in harness.junctions if one.kind == "rigid"]
        return [f"tilt:{end}" for junction in which for end in junction.ends[1:]]
    if kind in OF_SEGMENTS and where == EACH and EACH not in harness.segments:
        return [f"{kind}:{segment}" for segment in harness.segments]
    return [name]


def _target(name: str, harness: Harness, first: int) -> Target:
    """What a name means in this harness."""
    kind, colon, where = name.partition(":")
    if kind not in KNOWN:
        raise UnknownKeyError.among("fit", kind, (*KNOWN, FRAMES))
    if kind in OF_SEGMENTS:
        run = run_of(where, harness) if colon else tuple(harness.segments)
        for segment in run:
            if segment not in harness.segments:
                raise UnknownKeyError.among(f"fit: {kind}", segment, (*harness.segments, EACH))
        if len(set(run)) < len(run):
            raise ArgumentError.of("fit", name, "it names a segment twice", "Name every segment once.")
        return Target(name, kind, run, first)
    if where not in harness.ends:
        raise UnknownKeyError.among(f"fit: {kind}", where, harness.ends)
    junction = harness.junction_of(where)
    if junction is not None and (kind == "offset" or junction.kind == "ball"):
        bound = f"this end is in the {junction.kind} junction {junction.name!r}"
        remedy = "Of a rigid junction fit tilts and rolls; of a ball nothing."
        raise ArgumentError.of("fit", name, bound, remedy)
    return Target(name, kind, (where,), first)


def _number_of(cable: Cable, kind: str) -> float:
    """A number of a cable; of a stiffness about two axes their mean."""
    return float(cable.mean_bending_stiffness if kind == "bending_stiffness" else getattr(cable, kind))


def _common_curvature(target: Target, cables: Sequence[Cable]) -> list[float]:
    """The constant rest curvature that all of these have, about d1 and d2."""
    tables = [cable.rest_curvature for cable in cables]
    if any(table.ndim == 2 for table in tables) or any((table[:2] != tables[0][:2]).any() for table in tables):
        bound = "segments that share a fitted rest curvature begin with the same three numbers"
        raise ArgumentError.of("fit", target.name, bound, "Name segments alike, or each by itself.")
    return [float(x) for x in tables[0][:2]]
