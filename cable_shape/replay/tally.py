"""What a replay remembers of its cycles: :class:`Tally`, and what it makes of them."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.files import finite
from cable_shape.report import BodyDistance, CableWarning, CycleReport, Severity
from cable_shape.shape import CableShape


@final
@dataclass(slots=True)
class WarningCount:
    """How often a warning was given, and its worst case."""

    worst: CableWarning
    first: int  # stamp [ns]
    worst_at: int  # stamp [ns]
    cycles: int = 0


@final
class Tally:
    """Collects one report after another; series hold one entry a cycle, NaN where there was nothing."""

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
        self.closest: tuple[BodyDistance, int] | None = None  # and its stamp
        self.beyond = math.inf  # m, every body was at least this far where none is named
        self.warnings: dict[tuple[str, str, str], WarningCount] = {}

    def add(self, report: CycleReport, shape: CableShape) -> None:
        """Takes one cycle and the shape of its cable."""
        self.stamps.append(report.stamp)
        self.cycle_time.append(report.times.get("total", math.nan))
        self.statuses[shape.status.name] += 1
        self.models[shape.model] += 1
        self.reused += shape.reused
        positions = shape.positions
        self.longest_chord = max(self.longest_chord, math.dist(positions[0], positions[-1]))
        usable = bool(shape.status)
        self.bend_radius.append(float(shape.bend_radius.min()) if usable else math.nan)
        self.tension.append(float(shape.tension.max()) if usable else math.nan)
        if usable:
            self.worst_error_estimate = max(self.worst_error_estimate, shape.error_estimate)
        self._add_clearance(report)
        for warning in report.warnings:
            self._add_warning(warning, report.stamp)

    def _add_clearance(self, report: CycleReport) -> None:
        distance = math.nan
        for clearance in report.clearance.values():
            self.beyond = min(self.beyond, clearance.beyond)
            closest = clearance.closest
            if closest is not None:
                distance = closest.distance
                if self.closest is None or distance < self.closest[0].distance:
                    self.closest = (closest, report.stamp)
        self.clearance.append(distance)

    def _add_warning(self, warning: CableWarning, stamp: int) -> None:
        key = (warning.kind.name, warning.other, warning.severity.name)
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
            "warnings": [self._warning(entry) for _, entry in sorted(self.warnings.items(), key=_severe_first)],
        }

    def _cycle_time(self) -> dict[str, float]:
        times = np.array(self.cycle_time)
        p50, p99 = np.percentile(times, (50.0, 99.0))
        return {"mean": float(times.mean()), "p50": float(p50), "p99": float(p99), "max": float(times.max())}

    def _closest(self) -> dict[str, Any] | None:
        if self.closest is None:
            return None
        body, stamp = self.closest
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


def _severe_first(item: tuple[tuple[str, str, str], WarningCount]) -> tuple[int, str, str]:
    (kind, other, severity), _ = item
    return (-Severity[severity].value, kind, other)
