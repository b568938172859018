#!/usr/bin/env python
"""Cables that are seen: followed though they are hidden, beside coherent point drift, and servoed.

    scripts/bench seen [--quick] [--data FOLDER] [--only markers clouds servoing] [--save FILE] [--compare FILE]

Markers are those of real cables in FOLDER (../shared/data), each cable fitted to other trajectories; left out where
there are none. Clouds are synthetic.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from pathlib import Path

from figures import Figures, bench_options, bench_parser, finish, machine
from seen_clouds import print_clouds
from seen_markers import print_markers
from seen_servoing import print_servoing
from truth_data import CABLES, DATA

PARTS = ("markers", "clouds", "servoing")


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "few scenes, half the frames, 10 targets")
    parser.add_argument("--data", type=Path, default=DATA, metavar="FOLDER", help="recordings of real cables")
    parser.add_argument("--cables", type=int, nargs="+", choices=CABLES, default=CABLES, metavar="K")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts of it")
    options = bench_options(parser)
    figures = Figures()
    print(machine())
    if "markers" in options.only:
        if options.data.is_dir():
            print_markers(figures, list(options.cables), options.data, options.quick)
        else:
            print(f"No recordings of real cables in {options.data}: that part is left out.")
    if "clouds" in options.only:
        print_clouds(figures, 10 if options.quick else 100)
    if "servoing" in options.only:
        print_servoing(figures, 10 if options.quick else 100)
    return finish(figures, options)


if __name__ == "__main__":
    sys.exit(main())
