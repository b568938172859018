#!/usr/bin/env python
"""Cables that are routed: random motions judged by a check in numpy, and times of steps with many contacts.

    scripts/bench contact [--quick] [--motions N] [--processes N] [--only routing times] [--save FILE] [--compare FILE]

Motions have 200 steps, each shape is certified. What the figures are asked of are 500 of them, which take hours.
"""

from __future__ import annotations

import os

from contact_routing import MOTIONS, print_routing
from contact_times import print_road, print_times
from figures import Figures, bench_options, bench_parser, finish, machine

PARTS = ("routing", "times")


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "20 motions")
    parser.add_argument("--motions", type=int, metavar="N", help=f"random motions of all kinds together ({MOTIONS})")
    parser.add_argument("--processes", type=int, metavar="N", default=os.cpu_count(), help="at a time (one per core)")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts of it")
    options = bench_options(parser)
    figures = Figures()
    print(machine())
    if "times" in options.only:
        print_times(figures)
        print_road(figures)
    if "routing" in options.only:
        print_routing(figures, options.motions or (20 if options.quick else MOTIONS), processes=options.processes)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
