#!/usr/bin/env python
"""Figures of clips, clearance, margins and contact, also of cables: success, errors, and what they add to a cycle.

scripts/bench scene [--quick] [--save FILE] [--compare FILE]
"""

from __future__ import annotations

from figures import Figures, bench_options, bench_parser, finish
from scene_both import print_both
from scene_clearance import print_clearance
from scene_clips import print_clips
from scene_closed_forms import print_closed_forms
from scene_contact import print_contact
from scene_crossing import print_crossing
from scene_limp import print_limp
from scene_margins import print_margins
from scene_random import print_random


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "fewer random scenes, cycles and steps")
    options = bench_options(parser)
    figures = Figures()
    print_clips(figures, 30 if options.quick else 300)
    print_clearance(figures)
    print_margins(figures, 200 if options.quick else 2000)
    print_closed_forms(figures)
    print_contact(figures, quick=options.quick)
    print_limp(figures, 2 if options.quick else 6)
    print_crossing(figures, 2 if options.quick else 10)
    print_both(figures, 2 if options.quick else 10)
    print_random(figures, 2 if options.quick else 25)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
