"""The first table of docs/numbers.md: of every model, solve_bvp, simulators and the paper, time and error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from evidence_pages import END, figures, table
from evidence_points import Point, Series
from figures import machine

NUMBERS = Path(__file__).resolve().parents[1] / "docs" / "numbers.md"
BEGIN = "<!-- written by scripts/bench evidence -->"
WARM = "M, warm"
#: Of the paper's, for a shape of 150 points in space, section 4.
PAPER = "96 ms"


def front(series: Mapping[str, Series], default: str) -> str:
    """The table; `series` by problem, `default` the setting of the rod that is shown."""
    problems = [f"{name}, cold" for name in "ABCD"] + [WARM]
    rows = [("`cosserat`", *(cell(series[p]["rod"], default) for p in problems))]
    closed = ("gradient4", "gradient6", "catenary")
    rows += [(f"`{model}`", *(cell(series[p].get(model, ())) for p in problems)) for model in closed]
    rows.append(("solve_bvp, tol 1e-3", *(cell(series[p]["solve_bvp"], "tol 1e-03") for p in problems)))
    simulators = [name for name in series[problems[0]] if name.startswith(("MuJoCo", "PyElastica"))]
    for name in simulators:
        cells = [cell([point for point in series[p].get(name, ()) if point.size == 20]) for p in problems]
        rows.append((f"{name}, 20 links", *cells))
    if not simulators:
        rows.append(("MuJoCo's cable, PyElastica", *["not installed"] * 4, "-"))
    rows.append(("the paper's gradient cable", *["-"] * 4, f"{PAPER} as printed, another machine"))
    head = ("150 points: time, mean error / length", "A", "B", "C", "D", "M, each step")
    return f"{table(head, rows)}\n\nWritten by `scripts/bench evidence` on {machine()}."


def cell(points: Sequence[Point], setting: str | None = None) -> str:
    """Time and error of one setting, the first without; a dash for what has no shape there."""
    found = [point for point in points if setting is None or point.setting.startswith(setting)]
    if not found:
        return "-"
    return f"{figures(1e3 * found[0].time)} ms, {found[0].error:.0e}"


def put(text: str, page: Path = NUMBERS, begin: str = BEGIN) -> None:
    """Replaces what is between the marks of a page."""
    before, rest = page.read_text(encoding="utf-8").split(begin)
    after = rest.partition(END)[2]
    page.write_text(f"{before}{begin}\n{text}\n{END}{after}", encoding="utf-8")
