"""What a replay remembers of its cycles: :class:`Tally`, and what it makes of them."""

from __future__ import annotations

import math
from array import array
from collections import Counter, defaultdict
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.files.files import finite
from cable_shape.safety.report import BodyDistance, CableWarning, CycleReport, Severity


@final
@dataclass(slots=True)
class WarningCount:
    """How often a warning was given, and its worst case."""

    worst: CableWarning
    first: int  # stamp [ns]
    worst_at: int  # stamp [ns]
    cycles: int = 0


@final
@dataclass(slots=True)
class Extremes:
    """What one cable, or one segment of a harness, came to in all cycles."""

    bend_radius: float = math.inf  # m
    tension: float = -math.inf  # N
    closest: tuple[BodyDistance, int] | None = None  # and its stamp

    def add(self, bend_radius: float, tension: float, closest: BodyDistance | None, stamp: int) -> None:
        """Takes one cycle; NaN where there is no shape."""
        if bend_radius < self.bend_radius:
            self.bend_radius = bend_radius
        if tension > self.tension:
            self.tension = tension
        if closest is not None and (self.closest is None or closest.distance < self.closest[0].distance):
            self.closest = (closest, stamp)


@final
class Tally:
    """Collects one report after another; series hold one entry a cycle, NaN where there was nothing.

    Of a harness they are those of the segment that is worst in each cycle.
    """

    def __init__(self) -> None:
        self.stamps = array("q")  # ns
        self.cycle_time = array("d")  # s
        self.clearance = array("d")  # m
        self.bend_radius = array("d")  # m
        self.tension = array("d")  # N
        self.statuses: Counter[str] = Counter()
        self.models: Counter[str] = Counter()
        self.reused = 0
        self.restarts = 0
        self.longest_chord = 0.0  # m
        self.worst_error_estimate = 0.0  # m
        self.parts: defaultdict[str, Extremes] = defaultdict(Extremes)  # by cable or segment
        self.beyond = math.inf  # m, every body was at least this far where none is named
        self.warnings: dict[tuple[str, str, str, str], WarningCount] = {}

    def add(self, report: CycleReport) -> None:
        """Takes one cycle with a cable, or with the segments of a harness."""
        self.stamps.append(report.stamp)
        self.cycle_time.append(report.times.get("total", math.nan))
        shapes = report.shapes.values()
        first = next(iter(shapes))  # of a harness all have the same status
        self.statuses[first.status.name] += 1
        self.models[first.model] += 1
        self.reused += first.reused
        ends = [(shape.positions[0], shape.positions[-1]) for shape in shapes]
        self.longest_chord = max(self.longest_chord, *(math.dist(*both) for both in ends))
        if first.status:
            self.worst_error_estimate = max(self.worst_error_estimate, first.error_estimate)
        self._add_parts(report)
        for warning in report.warnings:
            self._add_warning(warning, report.stamp)

    def _add_parts(self, report: CycleReport) -> None:
        radii, tensions, distances = [], [], []
        for name, shape in report.shapes.items():
            clearance = report.clearance[name]
            self.beyond = min(self.beyond, clearance.beyond)
            closest = clearance.closest
            radius = tension = math.nan
            if shape.status:
                bent = float(np.hypot(shape.curvature[:, 0], shape.curvature[:, 1]).max())
                radius, tension = 1.0 / bent if bent > 0.0 else math.inf, float(shape.tension.max())
            radii.append(radius)
            tensions.append(tension)
            self.parts[name].add(radius, tension, closest, report.stamp)
            if closest is not None:
                distances.append(closest.distance)
        self.bend_radius.append(min(radii))
        self.tension.append(max(tensions))
        self.clearance.append(min(distances, default=math.nan))

    def _add_warning(self, warning: CableWarning, stamp: int) -> None:
        key = (warning.kind.name, warning.other, warning.severity.name, warning.cable_id)
        entry = self.warnings.get(key)
        if entry is None:
            entry = self.warnings[key] = WarningCount(warning, stamp, stamp)
        elif warning.margin > entry.worst.margin:
            entry.worst, entry.worst_at = warning, stamp
        entry.cycles += 1

    @property
    def cycles(self) -> int:
        """Number of cycles taken."""
        return len(self.stamps)

    def seconds(self, stamps: Any) -> Array:
        """`stamps` [ns] as seconds since the first cycle."""
        return np.asarray((np.asarray(stamps, dtype=np.int64) - self.stamps[0]) * 1e-9, dtype=np.float64)

    def as_dict(self) -> dict[str, Any]:
        """Figures of all cycles as plain values in SI units; None where there is none."""
        stamps = np.array(self.stamps)
        return {
            "cycles": self.cycles,
            "first_stamp": int(stamps[0]),
            "last_stamp": int(stamps[-1]),
            "reused": self.reused,
            "clock_restarts": self.restarts,
            "status": dict(sorted(self.statuses.items())),
            "model": dict(sorted(self.models.items())),
            "longest_chord": self.longest_chord,
            "smallest_bend_radius": extreme(np.nanmin, self.bend_radius),
            "largest_tension": extreme(np.nanmax, self.tension),
            "largest_error_estimate": self.worst_error_estimate,
            "cycle_time": self._cycle_time(),
            "closest_approach": self._closest(),
            "parts": {name: self._extremes(part) for name, part in self.parts.items()},
            "warnings": [self._warning(entry) for _, entry in sorted(self.warnings.items(), key=_severe_first)],
        }

    def _cycle_time(self) -> dict[str, float]:
        times = np.array(self.cycle_time)
        p50, p99 = np.percentile(times, (50.0, 99.0))
        return {"mean": float(times.mean()), "p50": float(p50), "p99": float(p99), "max": float(times.max())}

    def _extremes(self, part: Extremes) -> dict[str, Any]:
        return {
            "smallest_bend_radius": finite(part.bend_radius),
            "largest_tension": finite(part.tension),
            "closest_approach": None if part.closest is None else self._approach(*part.closest),
        }

    def _closest(self) -> dict[str, Any] | None:
        found = [(part.closest, name) for name, part in self.parts.items() if part.closest is not None]
        if not found:
            return None
        nearest, name = min(found, key=lambda one: one[0][0].distance)
        return {"cable_id": name, **self._approach(*nearest)}

    def _approach(self, body: BodyDistance, stamp: int) -> dict[str, Any]:
        return {
            "distance": body.distance,
            "body": body.body,
            "stamp": stamp,
            "time": float(self.seconds(stamp)),
            "arc_length": body.arc_length,
            "point_on_cable": body.point_on_cable.tolist(),
            "point_on_body": body.point_on_body.tolist(),
        }

    def _warning(self, entry: WarningCount) -> dict[str, Any]:
        worst = entry.worst
        return {
            "cable_id": worst.cable_id,
            "kind": worst.kind.name,
            "severity": worst.severity.name,
            "other": worst.other,
            "cycles": entry.cycles,
            "first_time": float(self.seconds(entry.first)),
            "worst_time": float(self.seconds(entry.worst_at)),
            "worst_value": finite(worst.value),
            "limit": finite(worst.limit),
            "text": worst.text,
        }


def extreme(choose: Any, values: Any) -> float | None:
    """The extreme finite entry of a series; None without any."""
    a = np.asarray(values, dtype=np.float64)
    a = a[np.isfinite(a)]
    return float(choose(a)) if a.size else None


def _severe_first(item: tuple[tuple[str, str, str, str], WarningCount]) -> tuple[int, str, str, str]:
    (kind, other, severity, cable_id), _ = item
    return (-Severity[severity].value, kind, other, cable_id)
