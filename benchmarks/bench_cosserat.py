#!/usr/bin/env python
"""Figures of the Cosserat predictor: accuracy, robustness, self-grading.

    scripts/bench cosserat [--quick] [--save FILE] [--compare FILE] [--cases FOLDER]

Prints tables, every figure with what is asked of it, and all of these again at the end. FOLDER holds the published
cases (default: ../shared/cases beside the repository), which are left out where it is missing.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

from cosserat_jumps import print_jumps
from cosserat_published import print_published
from cosserat_random import Asked, grade, random_grasp, taut_grasp, without_scene
from figures import Figures, bench_options, bench_parser, finish, heading

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"


def print_random(count: int, figures: Figures) -> None:
    """Grasps of every kind, and taut ones, whose boundary layers are as thin as 1e-5 of the length."""
    heading("Random grasps from nothing; true errors are against a tolerance 1000 times finer")
    grade("random grasps", count, without_scene(random_grasp), figures, Asked(within=100.0))
    grade("taut grasps", count, without_scene(taut_grasp), figures, Asked(within=100.0, sharp=None))


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "a tenth of the random problems")
    parser.add_argument("--cases", type=Path, default=CASES, help="folder of the reference cases")
    options = bench_options(parser)
    began = perf_counter()
    figures = Figures()
    count = 100 if options.quick else 1000
    if options.cases.is_dir():
        print_published(options.cases, figures)
    else:
        print(f"{options.cases} is not here: no published shapes. Give --cases FOLDER.")
    print_random(count, figures)
    print_jumps(count, figures)
    code = finish(figures, options)
    print(f"\n{perf_counter() - began:.0f} s")
    return code


if __name__ == "__main__":
    raise SystemExit(main())
