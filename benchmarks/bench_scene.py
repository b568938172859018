#!/usr/bin/env python
"""Figures of clips, clearance, margins and contact: success, errors, certificates, and what they add to a cycle.

scripts/bench scene [--quick] [--save FILE] [--compare FILE]
"""

from __future__ import annotations

from figures import Figures, bench_options, bench_parser, finish
from scene_clearance import print_clearance
from scene_clips import print_clips
from scene_contact import print_contact
from scene_limp import print_limp
from scene_many import print_many
from scene_margins import print_margins
from scene_pile import print_pile
from scene_random import print_random


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "fewer random scenes, cycles and steps")
    options = bench_options(parser)
    figures = Figures()
    print_clips(figures, 30 if options.quick else 300)
    print_clearance(figures)
    print_many(figures, 150 if options.quick else 600)
    print_margins(figures, 200 if options.quick else 2000)
    print_contact(figures, quick=options.quick)
    print_limp(figures, 2 if options.quick else 6)
    print_pile(figures, 1 if options.quick else 8)
    print_random(figures, 2 if options.quick else 25)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
