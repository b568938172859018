#!/usr/bin/env python
"""Figures of the Cosserat predictor: accuracy, order, critical loads, robustness, self-grading, speed.

    scripts/bench cosserat [--quick] [--save FILE] [--compare FILE] [--cases FOLDER]

Prints tables, every figure with what is asked of it, and all of these again at the end. Times are medians on this
machine, the others' measured in turns with ours; FOLDER holds reference cases (default: ../shared/cases beside the
repository), parts that need it are left out where it is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import perf_counter

from cosserat_cases import error_of, load, reach
from cosserat_critical import critical_values
from cosserat_jumps import print_jumps
from cosserat_order import print_order
from cosserat_published import print_published
from cosserat_random import print_grasps, print_sweep, print_taut_grasps
from cosserat_speed import print_speed
from figures import Figures, bench_options, bench_parser, finish, heading
from tqdm import tqdm

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"


def print_references(folder: Path, figures: Figures) -> None:
    """Every numerical reference shape without clips: mean error / length at default settings, and the status."""
    heading("Reference grasps, default tolerance: mean error / L")
    errors, other = [], []
    for values in tqdm(load(folder / "public"), desc="references", unit="shape", leave=False, disable=None):
        shape, _ = reach(values)
        errors.append(error_of(shape.positions, values))
        if errors[-1] > 1e-5 or not shape.status:
            other.append(values["name"])
            print(f"{values['name']:38} {errors[-1]:9.1e}  {shape.status.name}", flush=True)
    print(f"above 1e-5 or not usable: {', '.join(other) or 'none'}")
    figures.at_most(f"mean error / L, worst of {len(errors)} reference grasps", max(errors), 1e-5)


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "a tenth of the random problems, a third of the timings")
    parser.add_argument("--cases", type=Path, default=CASES, help="folder of the reference cases")
    options = bench_options(parser)
    began = perf_counter()
    figures = Figures()
    count = 100 if options.quick else 1000
    tables: list[Callable[[], None]] = []
    if options.cases.is_dir():
        of_cases = (print_references, print_published, print_order)
        tables += [lambda table=table: table(options.cases, figures) for table in of_cases]
    else:
        print(f"{options.cases} is not here: no reference shapes, no order. Give --cases FOLDER.")
    tables += [
        lambda: critical_values(figures),
        lambda: print_grasps(count, figures),
        lambda: print_taut_grasps(count, figures),
        lambda: print_jumps(count, figures),
        lambda: print_sweep(figures),
        lambda: print_speed(figures, options.quick),
    ]
    for table in tables:
        table()
    code = finish(figures, options)
    print(f"\n{perf_counter() - began:.0f} s")
    return code


if __name__ == "__main__":
    raise SystemExit(main())
