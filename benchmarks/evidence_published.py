"""Work and precision on the published problems: exact shapes from the literature, where their files are at hand."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cosserat_cases import STEPS, error_of, load
from cosserat_published import FAMILIES, predicted
from evidence_pages import Pages, figures, table, timed
from tqdm import tqdm

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases" / "published"
TOLERANCES = (1e-3, 1e-5, 1e-7)
ABSENT = "The files of the published problems are not at hand (`../shared/cases/published`): not drawn."


def family_of(name: str) -> str:
    """The kind of problem that a case belongs to."""
    return next(family for family in FAMILIES if name.startswith(family))


def evidence(pages: Pages, folder: Path = CASES) -> None:
    """A diagram of all, and a table of the families."""
    pages.add("performance", "### Published problems")
    cases = load(folder) if folder.is_dir() else []
    if not cases:
        pages.add("performance", ABSENT)
        return
    tolerances = TOLERANCES[:2] if pages.quick else TOLERANCES
    found = defaultdict(list)
    for values in tqdm(cases[:: 8 if pages.quick else 1], desc="published", unit="case", leave=False, disable=None):
        length = values["cable"]["length"]
        shapes = STEPS if values["end"] is None and not values["name"].startswith("elastica") else 1
        line = []
        for tolerance in tolerances:
            error = error_of(predicted(values, tolerance * length).positions, values)
            spent = timed(lambda v=values, t=tolerance * length: predicted(v, t), least=3, seconds=0.02)
            line.append((spent / shapes, max(error, 1e-13)))
        found[family_of(values["name"])].append(line)
    figure, axes = plt.subplots(figsize=(8, 4.8), layout="constrained")
    rows = []
    for number, (family, lines) in enumerate(sorted(found.items())):
        every = np.array(lines)
        axes.plot([], [], "s", color=f"C{number}", label=family.replace("_", " "))
        for i, mark in enumerate("o^v"[: len(tolerances)]):
            axes.loglog(1e3 * every[:, i, 0], every[:, i, 1], mark, ms=6, color=f"C{number}", alpha=0.8)
        worst = [figures(error) for error in every[:, :, 1].max(axis=0)]
        middle = [figures(1e3 * t) for t in np.median(every[:, :, 0], axis=0)]
        rows.append((family.replace("_", " "), str(len(lines)), *worst, *middle))
    for tolerance, mark in zip(tolerances, "o^v", strict=False):
        axes.plot([], [], mark, color="black", label=f"tolerance {tolerance:.0e} L")
    axes.set_xlabel("time of a shape [ms]")
    axes.set_ylabel("mean error / length")
    axes.grid(True, which="major", alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    names = [f"{t:.0e} L" for t in tolerances]
    pages.picture("performance", figure, "work_precision_published", "Time against error of the published problems")
    pages.add(
        "performance",
        f"The rod, cold, at tolerances of {', '.join(names)}; free ends under a load that grows in {STEPS} steps, of "
        "which one is timed; the clamped elasticas from beside the answer. Errors are against the exact shapes.",
        table(
            ("family", "cases", *(f"worst error / L, {n}" for n in names), *(f"median time [ms], {n}" for n in names)),
            rows,
        ),
    )
