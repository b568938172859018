"""What a study measures at every instant: :class:`Measure`, by name or by a function of the user's.

=====================  ============================================================  =======  ======================
name                   what                                                          worst    limit, where there is
=====================  ============================================================  =======  ======================
bend_radius            smallest radius of curvature [m]                              least    `min_bend_radius`
tension                greatest tension [N]                                          most     `max_tension`
twist_rate             greatest \\|twist rate\\| [rad/m]                               most     `max_twist_rate`
stress                 greatest von Mises stress [Pa]                                most     `allowable_stress`
stretch                distance of the ends / longest possible length                most     1
stability              smallest eigenvalue of the second variation, in units of      least    0
                       the smallest stiffness / length^2
clearance              least distance to a body [m]                                  least    `error_distance`
clearance:BODY         the same to one body                                          least    `error_distance`
force:S, moment:S      size of force [N] and moment [N m] in the section at S, an    most
                       arc length [m], "start" or "end"
clip:NAME              size of the force on a clip [N]                               most
energy                 elastic and gravitational energy [J]                          most
lowest                 height of the lowest point of the centreline [m]              least
=====================  ============================================================  =======  ======================

Distances beyond the horizon of the clearance check, 0.1 m or three warning distances, are infinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.planning.study_walk import Rows
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import clip_names
from cable_shape.shape import CableShape

MEASURE_KEYS = ("measure", "limit", "worst")
WORST = ("least", "most")
#: Of those that margins tell: row, whether the least is the worst, unit, and the cable's limit.
_MARGINS = {
    "stretch": (margins.STRETCH, "most", "", ""),
    "tension": (margins.TENSION, "most", "N", "max_tension"),
    "bend_radius": (margins.BEND, "least", "m", "min_bend_radius"),
    "twist_rate": (margins.TWIST, "most", "rad/m", "max_twist_rate"),
    "stress": (margins.STRESS, "most", "Pa", "allowable_stress"),
    "stability": (margins.STABILITY, "least", "", ""),
}
_PLAIN = ("clearance", "energy", "lowest")
_WITH = ("clearance", "force", "moment", "clip")
UNITS = {"clearance": "m", "force": "N", "moment": "N m", "clip": "N", "energy": "J", "lowest": "m"}
NAMES = (*_MARGINS, *_PLAIN, *(f"{kind}:.." for kind in _WITH))

#: Of rows: values (m,) and arc lengths (m,) [m], NaN where there is none.
Told = tuple[Array, Array]


@final
class Measure(NamedTuple):
    """One number of every instant.

    worst: "least" or "most", which of all instants is told; limit: NaN for that of cable and scene, or none.
    """

    name: str
    worst: str
    unit: str
    limit: float = math.nan
    function: Callable[[CableShape], float] | None = None

    def of(self, rows: Rows) -> Told:
        """Its values at all instants."""
        if self.function is not None:
            return _by(self.function, rows)
        kind, _, what = self.name.partition(":")
        m = len(rows)
        nowhere = np.full(m, math.nan)
        if self.name in _MARGINS:
            row = rows.margins[:, _MARGINS[self.name][0]]
            column = margins.USED if self.name == "stretch" else margins.VALUE
            told = np.where(np.isnan(row[:, margins.USED]), math.nan, row[:, column])
            return told, row[:, margins.ARC_LENGTH]
        if kind == "clearance":
            which = range(len(rows.bodies)) if not what else [rows.bodies.index(what)]
            if not len(which):
                return np.where(rows.usable, math.inf, math.nan), nowhere
            tables = rows.tables[:, list(which)]
            nearest = np.where(np.isnan(tables[:, :, 0]), math.inf, tables[:, :, 0]).argmin(axis=1)
            row = tables[np.arange(m), nearest]
            return row[:, 0], row[:, 1]
        if self.name == "energy":
            return rows.energy.copy(), nowhere
        if self.name == "lowest":
            z = rows.part(1, 3)[:, :, 2]
            return z.min(axis=1), rows.length * z.argmin(axis=1) / (rows.points - 1)
        if kind == "clip":
            if what not in rows.clips:
                return nowhere, nowhere
            row = rows.loads[:, 1 + rows.clips.index(what)]
            return np.linalg.norm(row[:, 1:4], axis=1), row[:, 0]
        place = {"start": np.zeros(m), "end": np.broadcast_to(rows.length, m)}.get(what)
        place = np.full(m, float(what)) if place is None else place
        x = np.clip(place / rows.length, 0.0, 1.0) * (rows.points - 1)
        i = np.minimum(x.astype(np.int64), rows.points - 2)
        part, every = rows.part(11 if kind == "force" else 14, 3), np.arange(m)
        left, right = part[every, i], part[every, i + 1]
        return np.linalg.norm(left + (x - i)[:, None] * (right - left), axis=1), place

    def limit_of(self, rows: Rows, scene: Scene) -> float:
        """What it is judged by; NaN: nothing."""
        if not math.isnan(self.limit) or self.function is not None:
            return self.limit
        if self.name in _MARGINS:
            name = _MARGINS[self.name][3]
            limit = getattr(rows.cable, name) if name else {"stretch": 1.0, "stability": 0.0}[self.name]
            return math.nan if limit is None else float(limit)
        return scene.error_distance if self.name.startswith("clearance") else math.nan

    def beyond(self, values: Array, limit: Any) -> Any:
        """Whether values are on the wrong side of a limit; never of none."""
        return values < limit if self.worst == "least" else values > limit

    def used(self, value: Array, limit: Array) -> Array:
        """How much of the limit is used, 1 at it: value / limit, limit / value where the least is the worst; of the
        stability as of its margin."""
        with np.errstate(all="ignore"):
            if self.worst == "most":
                return np.asarray(value / limit)
            if self.name == "stability":
                return np.where(value >= 0.0, 1.0 / (1.0 + value), 1.0 - value)
            used = np.where(value > 0.0, limit / value, math.inf)
            return np.where((limit == 0.0) & (value >= 0.0), 0.0, used)


def _by(function: Callable[[CableShape], float], rows: Rows) -> Told:
    """The values of a user's function, of usable shapes."""
    values = np.full(len(rows), math.nan)
    for i in np.flatnonzero(rows.usable).tolist():
        values[i] = float(function(rows.shape(i)))
    return values, np.full(len(rows), math.nan)


def measures_of(
    told: Any, functions: Mapping[str, Callable[[CableShape], float]], bodies: Sequence[str], scene: Scene
) -> tuple[Measure, ...]:
    """The measures that a file names; `functions` are the user's own.

    Raises
    ------
    ArgumentError
        For a name that does not exist, of a body or clip that is not there.
    """
    given = ["bend_radius", "tension", "clearance"] if told is None else told
    if isinstance(given, (str, Mapping)) or not isinstance(given, Sequence) or not given:
        raise ArgumentError.of("measure", told, "it must be a list", f"Known: {', '.join(NAMES)}.")
    out = []
    for i, item in enumerate(given):
        entry: Any = {"measure": item} if isinstance(item, str) else item
        checks.known_keys(f"measure[{i}]", entry, MEASURE_KEYS)
        out.append(_measure(f"measure[{i}]", entry, functions, bodies, clip_names(scene.clips)))
    names = [measure.name for measure in out]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ArgumentError.of("measure", twice, "it is named twice", "Keep one.")
    return tuple(out)


def _measure(
    where: str,
    entry: Mapping[str, Any],
    functions: Mapping[str, Callable[[CableShape], float]],
    bodies: Sequence[str],
    clips: Sequence[str],
) -> Measure:
    name = entry.get("measure")
    checks.word(f"{where}.measure", name)
    assert isinstance(name, str)
    limit = math.nan if entry.get("limit") is None else checks.number(f"{where}.limit", entry["limit"])
    kind, colon, what = name.partition(":")
    if name in functions:
        worst = checks.one_of(f"{where}.worst", entry.get("worst", "most"), WORST)
        return Measure(name, worst, "", limit, functions[name])
    known = (*_MARGINS, *_PLAIN, *functions)
    if not colon:
        checks.one_of(where, name, known)
    elif kind not in _WITH:
        raise ArgumentError.of(where, name, f"it must be one of {', '.join((*known, *NAMES[-4:]))}", "Choose one.")
    elif kind in ("clearance", "clip"):
        checks.one_of(f"{where}: {kind}", what, bodies if kind == "clearance" else clips)
    elif what not in ("start", "end"):
        try:
            checks.number(f"{where}: {kind}", float(what), at_least=0.0, unit="m")
        except ValueError as error:
            if isinstance(error, ArgumentError):
                raise
            bound = "behind the colon there must be an arc length in m, start or end"
            raise ArgumentError.of(where, name, bound, f"Write {kind}:start, or {kind}:0.25.") from None
    if name in _MARGINS:
        _, natural, unit, _ = _MARGINS[name]
    else:
        natural, unit = "least" if kind in ("clearance", "lowest") else "most", UNITS[kind]
    worst = checks.one_of(f"{where}.worst", entry.get("worst", natural), WORST)
    return Measure(name, worst, unit, limit)
