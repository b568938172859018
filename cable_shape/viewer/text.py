"""What the picture says in words: the state of each cable, and warnings as they come and go."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import final

import numpy as np

from cable_shape.safety.report import LOAD_MARGINS, CableWarning, Clearance, CycleReport, Margin, Severity, WarningKind
from cable_shape.shape import CableShape


def millimetres(distance: float) -> str:
    """A distance [m] in words that fit a label."""
    if abs(distance) < 1e-4:
        return f"{distance * 1e6:.2g} µm"
    return f"{distance * 1e3:.1f} mm" if abs(distance) < 1.0 else f"{distance:.2f} m"


#: kinds of margins, in the order in which they are drawn
MARGIN_KINDS = (
    WarningKind.CLEARANCE, *LOAD_MARGINS, WarningKind.QUASISTATIC, WarningKind.CONTACT_FORCE, WarningKind.CAUGHT,
)  # fmt: skip


def kind_name(kind: WarningKind) -> str:
    """A kind of margin in words."""
    return "stretch" if kind is WarningKind.OVERSTRETCHED else kind.name.lower().replace("_", " ")


def state(report: CycleReport, legend: str) -> str:
    """The report as a page of Markdown: the warnings that stand, then a table with a row for each cable."""
    rows = [dict(_cells(report, name, shape)) for name, shape in report.shapes.items()]
    heads = list(rows[0]) if rows else []
    lines = []
    for name, shape in report.shapes.items():
        if not shape.status:
            lines += [f"**ERROR** {name}: {shape.detail or shape.status.remedy}", ""]
    for warning in report.warnings:
        lines += [f"**{warning.severity.name}** {warning.text}", ""]
    lines += [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    lines += [f"| {' | '.join(row.values())} |" for row in rows]
    return "\n".join([*lines, "", f"*{legend}*"])


def _cells(report: CycleReport, name: str, shape: CableShape) -> Iterator[tuple[str, str]]:
    """Head and text of each cell in a cable's row."""
    yield "cable", f"**{name}**"
    yield "status", f"{shape.status.name} (reused)" if shape.reused else shape.status.name
    yield "clearance", _clearance(report.clearance.get(name))
    radius = float(shape.bend_radius.min())
    yield "bend radius", millimetres(radius) if np.isfinite(radius) else "straight"
    yield "tension", f"{shape.tension.max():.3g} N"
    yield "twist", f"{np.degrees(shape.twist):.0f}°"
    yield "nearest limit", _nearest_limit(report.margins.get(name, ()))
    if shape.velocity is not None:
        yield "speed", f"{np.linalg.norm(shape.velocity, axis=1).max():.2g} m/s"
    if name in report.plugs:
        plug = report.plugs[name]
        yield f"plug to {plug.socket}", f"{millimetres(plug.position)}, {np.degrees(plug.angle):.1f}°"
    yield "model", f"{shape.model} ±{millimetres(shape.error_estimate)}"


def _clearance(clearance: Clearance | None) -> str:
    if clearance is None:
        return "not checked"
    closest = clearance.closest
    if closest is not None:
        said = f"**{millimetres(closest.distance)}** to {closest.body}"
    else:
        said = f"over {millimetres(clearance.beyond)}" if np.isfinite(clearance.beyond) else "nothing near"
    return said if clearance.robot_checked else f"{said}; robot not checked"


def _nearest_limit(margins: Sequence[Margin]) -> str:
    """The margin that is used up most, with the time that is left."""
    if not margins:
        return "not judged"
    worst = max(margins, key=lambda m: m.used)
    left = f", in {worst.time_to_limit:.1f} s" if 0.0 < worst.time_to_limit < np.inf else ""
    return f"{margin(worst)}{left}"


def margin(margin: Margin, of: str = "") -> str:
    """A margin in words, and which cable it is of."""
    about = f"{f'{of} ' if of else ''}{kind_name(margin.kind)}{f' to {margin.other}' if margin.other else ''}"
    return f"{about} {100.0 * margin.used:.0f} %"


@final
class WarningLog:
    """Tells a warning once when it begins, when it changes in severity and when it is over."""

    def __init__(self) -> None:
        self._standing: dict[tuple[str, WarningKind, str], Severity] = {}

    def changes(self, warnings: tuple[CableWarning, ...]) -> list[tuple[Severity | None, str]]:
        """What is new since the last call, as severity (None: over) and text."""
        told: list[tuple[Severity | None, str]] = []
        now = {(w.cable_id, w.kind, w.other): w.severity for w in sorted(warnings, key=lambda w: w.severity.value)}
        for warning in warnings:
            key = (warning.cable_id, warning.kind, warning.other)
            if warning.severity is now[key] and self._standing.get(key) is not now[key]:
                self._standing[key] = now[key]
                told.append((warning.severity, warning.text))
        for key in [key for key in self._standing if key not in now]:
            del self._standing[key]
            cable, kind, other = key
            about = kind.name.lower().replace("_", " ")
            told.append((None, f"{cable}: {about}{f' to {other}' if other else ''} is over"))
        return told
