#!/usr/bin/env python
"""Run time against error, stability under stress, what was skipped, and where the time goes: tables and pictures.

    scripts/bench evidence [--quick] [--only PART ...] [--out FOLDER] [--save FILE] [--compare FILE]

Overwrites docs/performance.md, docs/stability.md and their pictures, unless only some parts are asked for: then the
pictures alone. --save keeps the ratios as JSON; --compare prints them beside those kept, and the exit status is 1 if
one has fallen by more than 1.3 times. Under 10 minutes on a quiet machine.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import evidence_maps
import evidence_profile
import evidence_skip
import evidence_walk
import evidence_weak
import evidence_work
from evidence_pages import Pages
from tqdm import tqdm

DOCS = Path(__file__).resolve().parents[1] / "docs"
PARTS = {
    "work": evidence_work.evidence,
    "skip": evidence_skip.evidence,
    "profile": evidence_profile.evidence,
    "maps": evidence_maps.evidence,
    "walk": evidence_walk.evidence,
    "weak": evidence_weak.evidence,
}


def main(arguments: list[str] | None = None) -> int:
    """All parts, then the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few points, short walks: to see that it works")
    parser.add_argument("--only", choices=PARTS, nargs="+", default=list(PARTS), help="these parts, no pages")
    parser.add_argument("--out", type=Path, help="folder of pages and pictures (docs; with --quick out/evidence)")
    parser.add_argument("--save", type=Path, metavar="FILE", help="keep the ratios as JSON")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="print the ratios beside those kept")
    options = parser.parse_args(arguments)
    if options.compare is not None and not options.compare.is_file():
        parser.error(f"--compare {options.compare}: no such file. Make one by --save.")
    folder = options.out or (DOCS.parent / "out" / "evidence" if options.quick else DOCS)
    pages = Pages(folder, options.quick)
    began = perf_counter()
    for name in tqdm(options.only, desc="parts", unit="part", disable=None):
        PARTS[name](pages)
    if len(set(options.only)) == len(PARTS):
        pages.write()
        print(f"written: {folder}/performance.md and stability.md")
    print(f"{perf_counter() - began:.0f} s")
    if options.save is not None:
        pages.save(options.save)
    return 1 if options.compare is not None and pages.compare(options.compare) else 0


if __name__ == "__main__":
    raise SystemExit(main())
