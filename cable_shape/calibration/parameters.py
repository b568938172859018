"""What a calibration may fit: names, units, and how a vector of them makes a cable and grips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import cable_at, changed
from cable_shape.cable.section import Section
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.pose import FreeEnd, Grip, Pose

#: Supports of what varies along the cable, unless another number is given, which may be so large: a rest curvature is
#: linear between so many places, evenly spread, a stiffness constant on each of so many pieces of one length.
ROWS, FEWEST_ROWS, MOST_ROWS = 5, 3, 33
#: [1], standard deviation of its change over the whole length times this length: half a turn.
WANDERS = 3.0
#: [1], standard deviation of the change of a stiffness' logarithm over the whole length.
STIFFENS = 0.5
#: [1], standard deviation of how its slope changes over the whole length, in terms of that change a length: with ten
#: supports or more it is this that keeps it smooth.
SWERVES = 10.0


def along(rows: int) -> tuple[str, ...]:
    """Names of a rest curvature that varies along the cable, by its supports in % of the length."""
    return tuple(f"rest_curvature_{i}_at_{100.0 * k / (rows - 1):.4g}" for k in range(rows) for i in (1, 2))


def pieces(rows: int) -> tuple[str, ...]:
    """Names of a stiffness that varies along the cable, by the middles of its pieces in % of the length."""
    return tuple(f"bending_stiffness_at_{100.0 * (k + 0.5) / rows:.4g}" for k in range(rows))


#: name -> (components, unit, step of the finite differences, largest step at once, whether its logarithm is fitted).
#: Stiffness, and what slows a moving cable, are fitted as logarithms: they are positive, and known to so many per cent.
KNOWN: dict[str, tuple[tuple[str, ...], str, float, float, bool]] = {
    "bending_stiffness": (("bending_stiffness",), "N m^2", 2e-2, 1.5, True),
    "bending_stiffness_along": (pieces(ROWS), "N m^2", 2e-2, 1.0, True),
    "twisting_stiffness": (("twisting_stiffness",), "N m^2", 2e-2, 1.5, True),
    "axial_stiffness": (("axial_stiffness",), "N", 2e-2, 1.5, True),
    "retardation_time": (("retardation_time",), "s", 2e-2, 1.0, True),
    "drag": (("drag",), "N s/m^2", 2e-2, 1.0, True),
    "length": (("length",), "m", 1e-4, 0.02, False),
    "rest_curvature": (("rest_curvature_1", "rest_curvature_2"), "1/m", 1e-2, 2.0, False),
    "rest_curvature_along": (along(ROWS), "1/m", 1e-2, 2.0, False),
    "start_offset": (("start_x", "start_y", "start_z"), "m", 1e-4, 0.01, False),
    "end_offset": (("end_x", "end_y", "end_z"), "m", 1e-4, 0.01, False),
    "start_tilt": (("start_tilt_1", "start_tilt_2"), "rad", 2e-3, 0.2, False),
    "end_tilt": (("end_tilt_1", "end_tilt_2"), "rad", 2e-3, 0.2, False),
    "start_pitch": (("start_tilt_1",), "rad", 2e-3, 0.2, False),
    "end_pitch": (("end_tilt_1",), "rad", 2e-3, 0.2, False),
    "roll": (("roll",), "rad", 2e-3, 0.5, False),
    "start_roll": (("start_roll",), "rad", 2e-3, 0.5, False),
}
#: Where fits begin of what slows a cable that does not say it, s and N s/m^2.
_BEGINS = {"retardation_time": 0.05, "drag": 0.01}
#: Names of what varies along the cable.
ALONG, STIFF_ALONG = "rest_curvature_along", "bending_stiffness_along"
#: How many components of these each support has.
VARYING = {ALONG: 2, STIFF_ALONG: 1}
#: Error / prior beyond which a number is known by its prior.
_PRIOR_ONLY = 0.9
#: Rows of a table of rest curvature that has the kinks of both the cable's own and the hat functions, at most.
_MOST_TABLE = 200
_POSITIVE = ("bending_stiffness", "twisting_stiffness", "axial_stiffness", "retardation_time", "drag")


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

    fit: names of `KNOWN`; priors: standard deviation by name, of a stiffness as a fraction of it; supports: of a rest
    curvature along the cable.
    """

    def __init__(
        self, cable: Cable, fit: Sequence[str], priors: Mapping[str, float] | None = None, supports: int = ROWS
    ) -> None:
        names = (fit,) if isinstance(fit, str) else checks.entries("fit", fit, str, f"Known: {', '.join(KNOWN)}.")
        if not names or len(set(names)) != len(names):
            raise ArgumentError.of("fit", names, "it must name something, each once", f"Known: {', '.join(KNOWN)}.")
        for name in names:
            if name not in KNOWN:
                raise UnknownKeyError.among("fit", name, KNOWN)
        given = checks.mapping("priors", priors, names, "Write {name: standard deviation}.")
        for name in ("rest_curvature", "bending_stiffness"):
            if {name, f"{name}_along"} <= set(names):
                raise ArgumentError.of("fit", names, f"{name} is a part of {name}_along", "Fit one of them.")
        for side in ("start", "end"):
            if {f"{side}_pitch", f"{side}_tilt"} <= set(names):
                raise ArgumentError.of("fit", names, f"{side}_pitch is a part of {side}_tilt", "Fit one of them.")
        self.cable = cable
        self.names = names
        self.supports = checks.integer("supports", supports, at_least=FEWEST_ROWS, at_most=MOST_ROWS)
        self.each: list[Parameter] = []
        self._wanders = {ALONG: WANDERS / cable.length, STIFF_ALONG: STIFFENS}
        start: list[float] = []
        for name in names:
            _, unit, step, most, log = KNOWN[name]
            parts = self._parts(name)
            prior = checks.number(f"priors[{name!r}]", given[name], above=0.0) if name in given else math.inf
            if name in VARYING:
                self._wanders[name], prior = min(prior, self._wanders[name]), math.inf
            self.each += [Parameter(part, unit, step, most, log, prior) for part in parts]
            start += self._start(name)
        self.start: Array = np.array(start)

    def _parts(self, name: str) -> tuple[str, ...]:
        """Names of the components."""
        named = {ALONG: along, STIFF_ALONG: pieces}.get(name)
        return KNOWN[name][0] if named is None else named(self.supports)

    def where(self, name: str) -> slice:
        """Where the components of `name` are."""
        first = sum(len(self._parts(before)) for before in self.names[: self.names.index(name)])
        return slice(first, first + len(self._parts(name)))

    @property
    def precision(self) -> Array:
        """(k, k), of what is known before: inverse of variances about the start; 0 where nothing is.

        See `smoothness` for what varies along the cable.
        """
        out = np.diag(np.array([p.prior for p in self.each]) ** -2.0)
        for name, width in self._varying():
            own = self.where(name)
            out[own, own] += np.kron(smoothness(self.supports, self._wanders[name]), np.eye(width))
        return out

    def _varying(self) -> list[tuple[str, int]]:
        """Names of what varies along the cable, and how many components of it each support has."""
        return [(name, width) for name, width in VARYING.items() if name in self.names]

    def by_prior(self, covariance: Array) -> list[str]:
        """Of what varies along the cable, between which places in % of the length the data say hardly anything."""
        out = []
        for name, width in self._varying():
            own = covariance[self.where(name), self.where(name)]
            names, before = self._parts(name), np.linalg.pinv(smoothness(self.supports, self._wanders[name]))
            for i in range(len(names) - width):
                k, j = i // width, i + width
                spread = before[k, k] + before[k + 1, k + 1] - 2.0 * before[k, k + 1]
                if not own[i, i] + own[j, j] - 2.0 * own[i, j] < _PRIOR_ONLY**2 * spread:
                    out.append(f"the change from {names[i]} to {names[j]} is known by its prior, hardly by the data.")
        return out

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
        if name == ALONG:
            table = np.atleast_2d(cable.rest_curvature)
            rows = np.linspace(0.0, 1.0, len(table)) if len(table) > 1 else np.zeros(1)
            at = np.linspace(0.0, 1.0, self.supports)
            return [float(np.interp(x, rows, table[:, axis])) for x in at for axis in (0, 1)]
        if name == STIFF_ALONG:
            middles = (np.arange(self.supports) + 0.5) / self.supports * cable.length
            return [math.log(cable_at(cable, at).mean_bending_stiffness) for at in middles.tolist()]
        if name in _POSITIVE:
            value = cable.mean_bending_stiffness if name == "bending_stiffness" else getattr(cable, name)
            if not value and not cable.sections:
                value = _BEGINS.get(name)
            if not value:
                raise ArgumentError.of(name, value, "to be fitted it must be given above 0", "Give a rough value.")
            return [math.log(value)]
        return [0.0] * len(KNOWN[name][0])

    def taken(self, other: Parameters, values: Array) -> Array:
        """(k,): the values of other parameters, which differ in the number of supports or in names."""
        out = np.array(self.start)
        for name in self.names:
            if name not in other.names:
                continue
            theirs = values[other.where(name)]
            if name in VARYING:
                at, places = (np.linspace(0.0, 1.0, rows) for rows in (self.supports, other.supports))
                columns = theirs.reshape(other.supports, -1).T
                theirs = np.stack([np.interp(at, places, column) for column in columns], axis=1).ravel()
            out[self.where(name)] = theirs
        return out

    def by_name(self, values: Array) -> dict[str, float]:
        """Each number in its unit."""
        return {p.name: math.exp(v) if p.log else float(v) for p, v in zip(self.each, values, strict=True)}

    def make_cable(self, values: Array) -> Cable:
        """The cable of these numbers. GJ follows EI, unless it is fitted, too."""
        now, cable = self.by_name(values), self.cable
        changes: dict[str, Any] = {name: now[name] for name in ("length", *_POSITIVE[1:]) if name in now}
        if "bending_stiffness" in now:
            ratio = now["bending_stiffness"] / cable.mean_bending_stiffness
            changes["bending_stiffness"] = [ratio * x for x in cable.bending_stiffness]
            changes.setdefault("twisting_stiffness", ratio * cable.twisting_stiffness)
        if "rest_curvature_1" in now:
            changes["rest_curvature"] = (now["rest_curvature_1"], now["rest_curvature_2"], cable.rest_curvature[2])
        if ALONG in self.names:
            changes["rest_curvature"] = self._along(np.asarray(values)[self.where(ALONG)])
        cable = changed(cable, **changes) if changes else cable
        return (
            self._in_pieces(cable, np.asarray(values)[self.where(STIFF_ALONG)]) if STIFF_ALONG in self.names else cable
        )

    def _in_pieces(self, cable: Cable, now: Array) -> Cable:
        """A cable whose stiffness is changed on pieces of one length to have these logarithms (supports,) in their
        middles; what else its sections have stays."""
        ratios = np.exp(now - np.array(self._start(STIFF_ALONG)))
        edges = [cable.length * k / self.supports for k in range(self.supports + 1)]
        own = [at for one in cable.sections for at in (one.start, one.end)]
        cuts = np.unique(np.round(np.array([*edges, *own]) / cable.length, 9)) * cable.length
        follows = "twisting_stiffness" not in self.names
        sections = []
        for low, high in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
            middle = 0.5 * (low + high)
            ratio, one = float(ratios[int(middle / cable.length * self.supports)]), cable_at(cable, middle)
            properties = next((dict(x.properties) for x in cable.sections if x.start < middle < x.end), {})
            properties["bending_stiffness"] = [ratio * x for x in one.bending_stiffness]
            if follows:
                properties["twisting_stiffness"] = ratio * one.twisting_stiffness
            sections.append(Section(low, high, **properties))
        mean = math.exp(float(now.mean())) / cable.mean_bending_stiffness
        whole: dict[str, Any] = {"bending_stiffness": [mean * x for x in cable.bending_stiffness]}
        if follows:
            whole["twisting_stiffness"] = mean * cable.twisting_stiffness
        return cable.replace(**whole, sections=sections)

    def _along(self, now: Array) -> Array:
        """(n, 3) [1/m]: the cable's own table, changed by hat functions to have these values (2 supports,) there."""
        table = np.atleast_2d(self.cable.rest_curvature)
        supports = self.supports
        rows = supports if len(table) == 1 else math.lcm(len(table) - 1, supports - 1) + 1
        if rows > _MOST_TABLE:
            rows = max(len(table), supports)
        at, hats = np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, supports)
        own = np.linspace(0.0, 1.0, len(table)) if len(table) > 1 else np.zeros(1)
        out = np.stack([np.interp(at, own, table[:, axis]) for axis in range(3)], axis=1)
        change = (now - np.array(self._start(ALONG))).reshape(supports, 2)
        for axis in range(2):
            out[:, axis] += np.interp(at, hats, change[:, axis])
        return out

    def offset(self, values: Array, side: str) -> Pose | None:
        """How the cable frame at the "start" or "end" lies beside what its grip says; None: as it says."""
        now = self.by_name(values)
        place = [now.get(f"{side}_{axis}", 0.0) for axis in "xyz"]
        turn = [now.get(f"{side}_tilt_1", 0.0), now.get(f"{side}_tilt_2", 0.0)]
        roll = now.get("roll" if side == "end" else "start_roll", 0.0)
        return displacement(place, turn, roll)


def displacement(place: Sequence[float], turn: Sequence[float], roll: float) -> Pose | None:
    """Where a cable frame lies beside another: moved [m] and tilted [rad, about d1 and d2] in it, then rolled about its
    own d3 [rad]; None: it is the same."""
    if not any(place) and not any(turn) and roll == 0.0:
        return None
    angle = math.hypot(*turn)
    f = 0.5 if angle == 0.0 else math.sin(0.5 * angle) / angle
    tilt = Pose(place, (f * turn[0], f * turn[1], 0.0, math.cos(0.5 * angle)))
    return tilt * Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(0.5 * roll), math.cos(0.5 * roll)))


def supports_in(names: Sequence[str], size: int) -> int:
    """How many supports what varies along the cable has, of so many numbers of these names; 0: it cannot be."""
    others = sum(len(KNOWN[name][0]) for name in names if name not in VARYING)
    width = sum(VARYING.get(name, 0) for name in names)
    if not width:
        return ROWS if size == others else 0
    rows, odd = divmod(size - others, width)
    return rows if not odd and FEWEST_ROWS <= rows <= MOST_ROWS else 0


def smoothness(rows: int, wanders: float) -> Array:
    """(rows, rows): precision of one component of what varies along the cable; its level is not known.

    wanders, in its unit: standard deviation of its change over the whole length, as of a random walk (first
    differences); its slope is another random walk, which changes by SWERVES times that a length (second differences).
    Both mean the same with any number of supports.
    """
    step = 1.0 / (rows - 1)
    change = np.diff(np.eye(rows), axis=0) / (wanders * math.sqrt(step))
    turn = np.diff(np.eye(rows), n=2, axis=0) / (SWERVES * wanders * step**1.5)
    return np.asarray(change.T @ change + turn.T @ turn)


def held(end: Grip | FreeEnd, offset: Pose | None) -> Grip | FreeEnd:
    """An end with the cable frame displaced by `offset` in itself."""
    if offset is None or isinstance(end, FreeEnd):
        return end
    return Grip(end.pose, end.kind, end.offset * offset, end.curvature)
