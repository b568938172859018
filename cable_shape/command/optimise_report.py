"""report.html of the best point of a study: what limits it, what lies around it, and its worst instants."""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.command import study_pictures as pictures
from cable_shape.command.study_report import number, write_page
from cable_shape.command.study_words import at_point
from cable_shape.planning.study import Study
from cable_shape.planning.study_best import Best
from cable_shape.planning.study_chunk import Chunk, measured, solve_chunk
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_walk import walk

#: Points of each curve around the best point, and how much of a range it shows to each side.
AROUND, PART = 31, 0.15


def write_best_report(study: Study, found: Best, out: Path) -> Path:
    """Writes OUT/report.html."""
    out.mkdir(parents=True, exist_ok=True)
    told = solve_chunk(study.cases, study.measures, found.point[None], False)
    where = html.escape(at_point(study.axes, found.point))
    by = html.escape(", ".join(found.limiting))
    effort = f"{found.solves} points were solved for, and {found.shapes} single shapes for derivatives"
    curves = "".join(_around(study, found, i) for i, axis in enumerate(study.axes) if not axis.law)
    drawn = any(axis.law for axis in study.axes)
    note = "That is the worst of all tolerances drawn; what follows is in the middle of them." if drawn else ""
    body = [
        f"<h1>{html.escape(study.name)}: the best point</h1>",
        f"<p>{where}: {100 * found.used:.4g} % of a limit is used at most, by {by}. {effort}; "
        f"{100 * found.exact:.0f} % of these are exact. {note}</p>",
        f"<h2>What limits</h2>{_measures(study, told)}",
        f"<h2>Around it</h2><figure class='row'>{curves}</figure>",
        *_pictures(study, found, told),
    ]
    write_page(out / "report.html", f"{study.name}: the best point", body)
    return out / "report.html"


def _measures(study: Study, told: Chunk) -> str:
    """All measures there, with what they use of their limits."""
    rows = ["<tr><th>measure</th><th>worst</th><th>limit</th><th>used</th><th>instant</th></tr>"]
    for k, measure in enumerate(study.measures):
        value, limit = float(told.value[0, k]), float(told.limit[0, k])
        used = float(measure.used(np.array(value), np.array(limit)))
        bound = "" if math.isnan(limit) else number(measure, limit)
        share = "" if math.isnan(limit) else f"{100 * used:.4g} %"
        cells = (number(measure, value), bound, share, str(told.instant[0, k]))
        line = "".join(f"<td class='n'>{cell}</td>" for cell in cells)
        rows.append(f"<tr><td>{html.escape(measure.name)}</td>{line}</tr>")
    return f"<table>{''.join(rows)}</table>"


def _around(study: Study, found: Best, i: int) -> str:
    """What measures use of their limits as one thing varies, all else as at the best point."""
    axis = study.axes[i]
    if axis.words:
        values = axis.values
    else:
        low, high = axis.values.min(), axis.values.max()
        part = PART * (high - low)
        values = np.linspace(max(low, found.point[i] - part), min(high, found.point[i] + part), AROUND)
    points = np.tile(found.point, (len(values), 1))
    points[:, i] = values
    told = solve_chunk(study.cases, study.measures, points, False)
    series = {}
    for k, measure in enumerate(study.measures):
        used = measure.used(told.value[:, k], told.limit[:, k])
        used = np.where(np.isfinite(used) & (told.first < 0), used, math.nan)
        if not np.isnan(used).all():
            series[measure.name] = 100.0 * used
    return pictures.around(axis, values, series, float(found.point[i]), 100.0 * found.used)


def _pictures(study: Study, found: Best, told: Chunk) -> list[str]:
    """The worst instants of what limits."""
    case = study.cases.at(found.point.tolist())
    rows = walk(case)
    out, seen = [], set()
    for k, measure in enumerate(study.measures):
        instant = int(told.instant[0, k])
        if measure.name not in found.limiting or instant in seen:
            continue
        seen.add(instant)
        marks = _mark(case, measure, rows, instant)
        drawn = pictures.shapes(rows, instant, marks, case.scene)
        text = f"{html.escape(measure.name)} {number(measure, told.value[0, k])} at instant {instant}"
        out.append(f"<figure>{drawn}<figcaption>The worst instant of {text}; ringed where.</figcaption></figure>")
    return out


def _mark(case: Any, measure: Measure, rows: Any, instant: int) -> list[Array]:
    """Where a measure is worst at an instant."""
    _, places, names = measured(case.instants, (measure,), rows)
    place, one = float(places[instant, 0]), rows[str(names[instant, 0])]
    if math.isnan(place):
        return []
    arcs = np.linspace(0.0, one.cable.length, one.points)
    return [np.array([np.interp(place, arcs, x) for x in one.part(1, 3)[instant].T])]
