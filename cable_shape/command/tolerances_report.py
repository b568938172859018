"""report.html of the tolerances of a study: the envelope, and what each source does to each measure."""

from __future__ import annotations

import html
from pathlib import Path

import numpy as np

from cable_shape.command import study_pictures as pictures
from cable_shape.command.study_report import write_page
from cable_shape.planning.study import Study
from cable_shape.planning.study_spread import Envelope, Shares


def write_tolerances_report(study: Study, held: Envelope, found: Shares, out: Path) -> Path:
    """Writes OUT/report.html."""
    out.mkdir(parents=True, exist_ok=True)
    scene = study.cases.at([axis.middle for axis in study.axes]).scene
    without = f", {held.without} points have none" if held.without else ""
    body = [
        f"<h1>{html.escape(study.name)}: tolerances</h1>",
        f"<p>{held.shapes} shapes{without}; {found.solves} points for the shares.</p>",
        "<h2>The envelope</h2>",
        f"<p>{_widths(held)}</p><figure>{pictures.tube(held.middle, held.radius, scene)}",
        "<figcaption>The mean shape, and the tube about it from three sides.</figcaption></figure>",
        f"<figure>{pictures.along(held.radius)}</figure>",
    ]
    for k, measure in enumerate(study.measures):
        factor, unit = pictures.scaled(measure)
        body.append(f"<h2>{html.escape(measure.name)}</h2>")
        body.append(f"<p>Standard deviation {factor * found.deviation[k]:.4g} {html.escape(unit)}</p>")
        body.append(f"<figure>{pictures.shares(found, k)}</figure>{_table(study, found, k)}")
    note = "Shares of the variance: to first order from derivatives in the middle of all distributions; alone and with"
    note += " others by Sobol indices. Derivatives are exact, or central differences of motions."
    body.append(f"<p class='note'>{note}</p>")
    write_page(out / "report.html", f"{study.name}: tolerances", body)
    return out / "report.html"


def _widths(held: Envelope) -> str:
    """How wide it is at most."""
    told = []
    for name, radius in held.radius.items():
        at = int(radius.argmax())
        told.append(f"{1e3 * radius.max():.4g} mm at point {at} of {len(radius)} {name}".rstrip())
    share = f"{100 * held.confidence:g} % of the shapes are at instant {held.instant} within "
    return html.escape(share + "; ".join(told))


def _table(study: Study, found: Shares, k: int) -> str:
    """The shares of each source, the greatest first."""
    rows = [
        "<tr><th>source</th><th>standard deviation</th><th>derivative</th><th></th><th>first order</th><th>alone</th>"
        "<th>with others</th></tr>"
    ]
    for i in np.argsort(-np.nan_to_num(found.total[k])).tolist():
        how = "exact" if found.exact[k, i] else "differences"
        cells = [f"{study.axes[i].spread:.4g}", f"{found.slope[k, i]:.4g}", how]
        cells += [f"{100 * x[k, i]:.1f} %" for x in (found.linear, found.first, found.total)]
        line = "".join(f"<td class='n'>{cell}</td>" for cell in cells)
        rows.append(f"<tr><td>{html.escape(found.sources[i])}</td>{line}</tr>")
    return f"<table>{''.join(rows)}</table>"
