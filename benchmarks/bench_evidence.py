#!/usr/bin/env python
"""Run time against error, stability under stress, what was skipped, and where the time goes: tables and pictures.

    scripts/bench evidence [--quick] [--only PART ...] [--out FOLDER] [--save FILE] [--compare FILE]

Overwrites docs/performance.md, docs/stability.md, their pictures, and the first table of docs/numbers.md, unless only
some parts are asked for: then the pictures alone. --save keeps the ratios as JSON; --compare prints them beside those
kept. The exit status is 1 if one has fallen by more than 1.3 times, or an answer with a shortcut is not the one
without.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import evidence_maps
import evidence_profile
import evidence_skip
import evidence_walk
import evidence_work
from evidence_pages import Pages, put
from figures import bench_options, bench_parser, finish
from tqdm import tqdm

DOCS = Path(__file__).resolve().parents[1] / "docs"
PARTS = {
    "work": evidence_work.evidence,
    "skip": evidence_skip.evidence,
    "profile": evidence_profile.evidence,
    "maps": evidence_maps.evidence,
    "walk": evidence_walk.evidence,
}


def main(arguments: list[str] | None = None) -> int:
    """All parts, then the pages."""
    parser = bench_parser(__doc__, "few points, short walks: to see that it works")
    parser.add_argument("--only", choices=PARTS, nargs="+", default=list(PARTS), help="these parts, no pages")
    parser.add_argument("--out", type=Path, help="folder of pages and pictures (docs; with --quick out/evidence)")
    options = bench_options(parser, arguments)
    folder = options.out or (DOCS.parent / "out" / "evidence" if options.quick else DOCS)
    pages = Pages(folder, options.quick)
    began = perf_counter()
    for name in tqdm(options.only, desc="parts", unit="part", disable=None):
        PARTS[name](pages)
    if len(set(options.only)) == len(PARTS):
        pages.write()
        print(f"written: {folder}/performance.md and stability.md")
        if folder == DOCS and not options.quick:
            put(pages.front)
    print(f"{perf_counter() - began:.0f} s")
    return finish(pages.figures, options, front=pages.front)


if __name__ == "__main__":
    raise SystemExit(main())
