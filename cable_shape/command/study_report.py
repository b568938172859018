"""report.html of a study, one file that needs no other, and a recording of each worst point: :func:`write_report`."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.cable.harness import Harness
from cable_shape.command import study_pictures as pictures
from cable_shape.command.study_words import at_point, best_of, within
from cable_shape.planning.study_chunk import measured, write
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_result import StudyResult
from cable_shape.planning.study_walk import Rows, walk

#: Points without a shape somewhere of which the reason is told, and points that are looked at again for pictures.
_TOLD, _LOOKED_AT = 12, 6
_STYLE = """body{font:15px/1.5 system-ui,sans-serif;color:#1c2733;max-width:1180px;margin:2em auto;padding:0 1.2em}
h1{font-size:1.6em;margin-bottom:.2em}h2{font-size:1.2em;margin-top:2em;border-bottom:1px solid #d5dce3}
table{border-collapse:collapse;font-size:.92em}th,td{text-align:left;padding:.3em .8em;border-bottom:1px solid #e3e8ee}
td.n{text-align:right;font-variant-numeric:tabular-nums}td.bad{color:#c0392b}svg{max-width:100%;height:auto}
.row{display:flex;flex-wrap:wrap;gap:1em}.row svg{max-width:49%}
.note{color:#5b6876}figure{margin:1em 0}figcaption{color:#5b6876;font-size:.92em}"""


def write_report(found: StudyResult, out: Path, recordings: bool = True) -> list[Path]:
    """Writes OUT/report.html, and OUT/point_NUMBER.rrd of each point that is the worst for a measure."""
    study = found.study
    head = f"<h1>{html.escape(study.name)}</h1><p>{_lead(found)}</p>"
    body = [head, "<h2>What limits</h2>", _limits(found), _without(found)]
    written = [out / "report.html"]
    looked: dict[int, Any] = {}
    for k, measure in enumerate(study.measures):
        body.append(f"<h2 id='m{k}'>{html.escape(measure.name)}</h2>")
        told = best_of(found, k)
        if told is None:
            body.append("<p>It has no value anywhere.</p>")
            continue
        best, worst = told
        for point in (best, worst):
            if point not in looked and len(looked) < _LOOKED_AT:
                case = study.cases.at(found.points[point].tolist())
                looked[point] = case, walk(case)
        body.append(_worst(found, k, best, worst, looked))
        path = out / f"point_{worst}.rrd"
        if recordings and worst in looked and (path in written or _record(path, *looked[worst])):
            written += [] if path in written else [path]
            body.append(f"<p class='note'>All instants of that point: <code>cable-shape view {path.name}</code></p>")
    write_page(written[0], study.name, body)
    return written


def write_page(file: Path, title: str, body: Sequence[str]) -> None:
    """Writes one page that needs no other file."""
    page = f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{html.escape(title)}</title>"
    page += f"<style>{_STYLE}</style></head><body>{''.join(body)}</body></html>\n"
    write(file, page.encode())


def _lead(found: StudyResult) -> str:
    study = found.study
    varied = "; ".join(_axis(found, i) for i in range(len(study.axes))) or "nothing varies"
    shapes = int(found.usable.sum())
    return (
        f"{len(found)} points ({html.escape(varied)}), {int(found.instants.sum())} instants, {shapes} with a shape, "
        f"{int(found.snapped.sum())} after a snap. {html.escape(within(found))}"
    )


def _axis(found: StudyResult, i: int) -> str:
    axis, column = found.study.axes[i], found.points[:, i]
    law = f", {axis.law}" if axis.law else ""
    return f"{axis.name} {axis.span(column)}{law}"


def _limits(found: StudyResult) -> str:
    """Of each measure the best and the worst point, and how many points are beyond its limit."""
    used = found.used
    known = ~np.isnan(used).all(axis=1)
    most = np.where(known, np.argmax(np.where(np.isnan(used), -math.inf, used), axis=1), -1)
    rows = [
        "<tr><th>measure</th><th>limit</th><th>best</th><th>at</th><th>worst</th><th>at</th><th>instant</th>"
        "<th>arc length [m]</th><th>points beyond</th><th>points where it uses most of its limit</th></tr>"
    ]
    for k, measure in enumerate(found.study.measures):
        told = best_of(found, k)
        if told is None:
            rows.append(f"<tr><td>{html.escape(measure.name)}</td><td colspan='9'>no value</td></tr>")
            continue
        best, worst = told
        limits = found.limit[:, k]
        limit = "" if np.isnan(limits).all() else number(measure, float(np.nanmin(limits)))
        beyond = int(measure.beyond(found.value[:, k], limits).sum())
        cells = [
            f"<td><a href='#m{k}'>{html.escape(measure.name)}</a></td>", f"<td class='n'>{limit}</td>",
            f"<td class='n'>{number(measure, found.value[best, k])}</td>", f"<td>{_point(found, best)}</td>",
            f"<td class='n'>{number(measure, found.value[worst, k])}</td>", f"<td>{_point(found, worst)}</td>",
            f"<td class='n'>{found.instant[worst, k]}</td>", f"<td class='n'>{_place(found, worst, k)}</td>",
            f"<td class='n{' bad' if beyond else ''}'>{beyond}</td>", f"<td class='n'>{int((most == k).sum())}</td>",
        ]  # fmt: skip
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table>{''.join(rows)}</table>"


def _without(found: StudyResult) -> str:
    """The points that have no shape somewhere, and why."""
    bad = np.flatnonzero(~found.complete)
    if not bad.size:
        return ""
    rows = [f"<tr><td>{_point(found, i)}</td><td>{html.escape(found.why(i))}</td></tr>" for i in bad[:_TOLD].tolist()]
    more = f"<p class='note'>and {bad.size - _TOLD} more</p>" if bad.size > _TOLD else ""
    return f"<h2>{bad.size} points without a shape somewhere</h2><table>{''.join(rows)}</table>{more}"


def _worst(found: StudyResult, k: int, best: int, worst: int, looked: Mapping[int, Any]) -> str:
    """Over time at the best and the worst point, and the worst instant as a picture."""
    measure, out, series = found.study.measures[k], [], {}
    for name, point in (("worst point", worst), ("best point", best)):
        if point in looked and found.instants[point] > 1:
            case, rows = looked[point]
            series[f"{name}, {_point(found, point)}"] = (
                np.arange(found.instants[point]), measured(case.instants, (measure,), rows)[0][:, 0]
            )  # fmt: skip
    over = pictures.over_time(measure, float(found.limit[worst, k]), series) if series else ""
    drawn = pictures.curves(found, k) if len(found) > 1 else ""
    apart = "</figure><figure class='row'>" if len(found.study.axes) > 2 else ""  # panels side by side need its width
    out.append(f"<figure class='{'' if apart else 'row'}'>{drawn}{apart}{over}</figure>")
    if worst in looked and found.instant[worst, k] >= 0:
        case, rows = looked[worst]
        instant = int(found.instant[worst, k])
        place, one = found.place[worst, k], rows[str(found.segment[worst, k])]
        marks = [] if math.isnan(place) else [_at(one, instant, place)]
        text = f"{number(measure, found.value[worst, k])} at instant {instant}, {_point(found, worst)}"
        drawn = pictures.shapes(rows, instant, marks, case.scene)
        out.append(f"<figure>{drawn}<figcaption>The worst instant: {text}; ringed where.</figcaption></figure>")
    return "".join(out)


def _at(rows: Rows, instant: int, place: float) -> Any:
    positions = rows.part(1, 3)[instant]
    return np.array([np.interp(place, np.linspace(0.0, rows.cable.length, rows.points), x) for x in positions.T])


def number(measure: Measure, value: float) -> str:
    factor, unit = pictures.scaled(measure)
    return "out of reach" if math.isinf(value) else f"{factor * value:.4g} {unit}".strip()


def _point(found: StudyResult, point: int) -> str:
    return html.escape(at_point(found.study.axes, found.points[point])) or "-"


def _place(found: StudyResult, point: int, k: int) -> str:
    place, segment = found.place[point, k], str(found.segment[point, k])
    told = "" if math.isnan(place) else f"{place:.4g}"
    return html.escape(f"{segment} {told}".strip())


def _record(path: Path, case: Any, rows: Mapping[str, Rows]) -> bool:
    """All instants of a point for the viewer; False where that is not installed."""
    try:
        from cable_shape.command.recorded import record_motion
    except ModuleNotFoundError:
        return False
    whole = case.cable if isinstance(case.cable, Harness) else case.cable.cable
    record_motion(path, whole, case.scene, case.held, case.frames, case.options)
    return True
