#!/usr/bin/env python
"""MuJoCo's cable and PyElastica beside the rod: grasps A to D, a swing, contact with friction.

scripts/bench rivals --install                              makes .venv-rivals with MuJoCo 3.17 and PyElastica 1.0
scripts/bench rivals [--quick] [--save FILE] [--compare FILE]   prints what `scripts/bench evidence` draws
scripts/bench rivals --tune                                 searches their time steps and damping anew (ten minutes)
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import evidence_rivals
import rivals_tune
from evidence_pages import Pages, table
from evidence_work import beside_rivals, cold, rows_of
from figures import bench_options, bench_parser, finish, heading
from problems import GRASPS
from rivals_laid import print_laid
from rivals_swing import print_swings

HERE = Path(__file__).resolve().parent


def install() -> None:
    """The rivals' own environment."""
    subprocess.run((sys.executable, "-m", "venv", evidence_rivals.VENV), check=True)
    pip = (evidence_rivals.VENV / "bin" / "python", "-m", "pip", "install", "--disable-pip-version-check", "-q")
    subprocess.run((*pip, "-r", HERE / "requirements_rivals.txt"), check=True)
    print(f"installed: {evidence_rivals.VENV}")


def main(arguments: list[str] | None = None) -> int:
    """Installs, tunes, or measures."""
    parser = bench_parser(__doc__, "the coarsest mesh of each")
    parser.add_argument("--install", action="store_true", help="make the rivals' environment")
    parser.add_argument("--tune", action="store_true", help="search their settings, and keep them for all later runs")
    options = bench_options(parser, arguments)
    if options.install:
        install()
        return 0
    if options.tune:
        rivals_tune.tune()
        return 0
    pages = Pages(HERE.parent / "out" / "rivals", options.quick)
    heading("The rod beside simulators: time to the equilibrium, also in times of the rod's, and mean error / L")
    if evidence_rivals.python() is None:
        print(evidence_rivals.MISSING)
        return finish(pages.figures, options)
    print(evidence_rivals.METHOD)
    results = {f"{name}, cold": cold(name, options.quick)[0] for name in GRASPS}
    beside_rivals(results, pages)
    head = ("grasp", "model", "setting", "links", "time / rod", "mean error / L")
    print(table(head, [row for name, series in results.items() for row in rows_of(name, series)]))
    print_swings(pages.figures, options.quick)
    print_laid(pages.figures, options.quick)
    return finish(pages.figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
