#!/usr/bin/env python
"""MuJoCo's cable and PyElastica beside the rod on the grasps A to D: time to the equilibrium, and error.

scripts/bench rivals --install                              makes .venv-rivals with MuJoCo 3.17 and PyElastica 1.0
scripts/bench rivals [--quick] [--save FILE] [--compare FILE]   prints what `scripts/bench evidence` draws
scripts/bench rivals --tune                                 searches their time steps and damping anew (ten minutes)
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import evidence_rivals
import numpy as np
import rivals_tune
from cosserat_speed import GRASPS
from evidence_pages import figures, timed
from figures import Figures, bench_options, bench_parser, finish, heading

import cable_shape as cs

REQUIREMENTS = Path(__file__).resolve().parent / "requirements_rivals.txt"


def install() -> None:
    """The rivals' own environment."""
    subprocess.run((sys.executable, "-m", "venv", evidence_rivals.VENV), check=True)
    pip = (evidence_rivals.VENV / "bin" / "python", "-m", "pip", "install", "--disable-pip-version-check", "-q")
    subprocess.run((*pip, "-r", REQUIREMENTS), check=True)
    print(f"installed: {evidence_rivals.VENV}")


def print_rivals(collected: Figures, quick: bool) -> None:
    """One line a simulator and mesh, beside the rod's on the same grasp."""
    heading("The rod beside simulators: time to the equilibrium, also in times of the rod's, and mean error / L")
    found = evidence_rivals.measured(quick)
    if not found:
        print(evidence_rivals.MISSING)
        return
    print(evidence_rivals.METHOD)
    print(f"{'':3}{'':24}{'links':>6}{'steps':>8}{'time':>13}{'/ rod':>9}{'error / L':>11}")
    for name, (cable, start, end) in GRASPS.items():
        shape, exact = (
            cs.predict(cable, start, end, model="cosserat", tolerance=tolerance)
            for tolerance in (None, evidence_rivals.EXACT * cable.length)
        )
        error = float(np.linalg.norm(shape.positions - exact.positions, axis=1).mean()) / cable.length
        ours = timed(lambda c=cable, s=start, e=end: cs.predict(c, s, e, model="cosserat"))
        print(f"{name:3}{'rod, cold':24}{'':14}{1e3 * ours:10.3f} ms{1:9}{figures(error):>11}")
        for simulator, line in found[name].items():
            for s in line:
                times = s.seconds / ours
                print(
                    f"{'':3}{simulator:24}{s.job.joints:6d}{s.steps:8d}{1e3 * s.seconds:10.1f} ms"
                    f"{figures(times):>9}{figures(s.error):>11}"
                )
                collected.ratio(f"rod : {simulator}, {s.job.joints} links, grasp {name} cold", times)


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
    collected = Figures()
    print_rivals(collected, options.quick)
    return finish(collected, options)


if __name__ == "__main__":
    raise SystemExit(main())
