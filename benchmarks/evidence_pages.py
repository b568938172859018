"""Where the evidence goes: a page, the first table of the page of numbers, and figures to keep and compare."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from figures import Figures, machine
from matplotlib.figure import Figure

#: Marks around what `scripts/bench certify` writes on its page.
CERTIFIED, END = "<!-- written by scripts/bench certify -->", "<!-- to here -->"
#: Mark before the first table of docs/numbers.md.
BEGIN = "<!-- written by scripts/bench evidence -->"
NUMBERS = Path(__file__).resolve().parents[1] / "docs" / "numbers.md"
#: Of the paper's, for a shape of 150 points in space, section 4.
PAPER = "96 ms"


class Point(NamedTuple):
    """One setting of one model: time [s], mean error / length, what was set, and elements or links."""

    time: float
    error: float
    setting: str
    size: int = 0


#: By model.
Series = dict[str, list[Point]]


def figures(value: float, digits: int = 2) -> str:
    """A number with so many digits that count."""
    if not np.isfinite(value):
        return "-"
    if value == 0.0 or 1e-2 <= abs(value) < 1e4:
        return f"{value:.{max(digits - 1 - int(np.floor(np.log10(abs(value) or 1.0))), 0)}f}"
    return f"{value:.{digits - 1}e}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


class Pages:
    """Texts, pictures and ratios of docs/performance.md, as they come."""

    def __init__(self, folder: Path, quick: bool) -> None:
        self.folder, self.quick = folder, quick
        self.figures = Figures()
        self.front = ""
        self.ratios: dict[str, tuple[float, str]] = {}
        self.texts: list[str] = []
        (folder / "images").mkdir(parents=True, exist_ok=True)

    def add(self, *texts: str) -> None:
        """Paragraphs and tables, printed, too."""
        self.texts += texts
        print("\n\n".join(texts), end="\n\n", flush=True)

    def ratio(self, name: str, value: float, meaning: str = "") -> None:
        """A figure that does not depend on how fast the machine is."""
        self.ratios[name] = (value, meaning)
        self.figures.ratio(name, value)

    def picture(self, figure: Figure, name: str, alt: str) -> None:
        """Writes a picture and shows it on the page."""
        figure.savefig(self.folder / "images" / f"{name}.png", dpi=90)
        plt.close(figure)
        self.add(f"![{alt}](images/{name}.png)")

    def write(self) -> None:
        """The page."""
        note = "\n\nA quick run: few points and repetitions." if self.quick else ""
        found = sorted(self.ratios.items(), key=lambda item: -item[1][0])
        rows = [(name, figures(value, 3), note) for name, (value, note) in found]
        head = ["# Run time against error", f"Written by `scripts/bench evidence` on {machine()}.{note}", "## Ratios"]
        head += ["Both in turns, or in the same run.", table(("a : b", "a is so many times as fast", ""), rows)]
        (self.folder / "performance.md").write_text("\n\n".join((*head, *self.texts)) + "\n", encoding="utf-8")


def front(series: Mapping[str, Series], default: str) -> str:
    """The table of time and error of all models and their peers.

    `series` by problem; `default`: the setting of the rod that is shown.
    """
    problems = [f"{name}, cold" for name in "ABCD"] + ["M, warm"]
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
