"""What a study found, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_shape.checks import Array
from cable_shape.planning.study_result import StudyResult
from cable_shape.planning.study_vary import Axis


def summary(found: StudyResult) -> list[str]:
    """What was found, in a few lines."""
    study = found.study
    lines = [f"{study.name}: {len(found)} points, {int(found.instants.sum())} shapes asked for"]
    without = int((~found.complete).sum())
    if without:
        first = int((~found.complete).argmax())
        lines.append(f"  {without} points lack a shape somewhere; the first is point {first}: {found.why(first)}")
    lines.append(f"  {within(found)}")
    for k, measure in enumerate(study.measures):
        told = best_of(found, k)
        if told is None:
            lines.append(f"  {measure.name:<24} no value")
            continue
        best, worst = told
        at = at_point(study.axes, found.points[best])
        text = f"{found.value[best, k]:.6g} to {found.value[worst, k]:.6g} {measure.unit}".rstrip()
        lines.append(f"  {measure.name:<24} {text}; best at {at}" if at else f"  {measure.name:<24} {text}")
    return lines


def at_point(axes: Sequence[Axis], point: Array) -> str:
    """What varies, and its values there (axes,)."""
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in zip(axes, point.tolist(), strict=True))


def within(found: StudyResult) -> str:
    """How many points are within all limits, from where to where, and which is furthest from the nearest limit."""
    good = np.flatnonzero(found.within)
    if not good.size:
        return "No point is within all limits."
    count = "1 point is" if good.size == 1 else f"{good.size} points are"
    used = np.fmax.reduce(found.used[good], axis=1)
    if np.isnan(used).all():
        return f"{count} within all limits."
    best = int(good[np.nanargmin(used)])
    ranges, at = [], []
    for i, axis in enumerate(found.study.axes):
        column = found.points[good, i]
        ranges.append(f"{axis.name} {axis.span(column)}")
        at.append(f"{axis.name} {axis.shown(found.points[best, i])}")
    text = f"{count} within all limits, {'; '.join(ranges)}. Furthest from its nearest limit is {', '.join(at)}"
    return f"{text}, with {100.0 * float(np.nanmin(used)):.3g} % of it used."


def best_of(found: StudyResult, k: int) -> tuple[int, int] | None:
    """The points at which a measure's worst value is best, and worst."""
    column = found.value[:, k]
    if np.isnan(column).all():
        return None
    low, high = int(np.nanargmin(column)), int(np.nanargmax(column))
    return (high, low) if found.study.measures[k].worst == "least" else (low, high)
