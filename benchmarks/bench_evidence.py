#!/usr/bin/env python
"""Run time against error of every model, beside solve_bvp, MuJoCo and PyElastica: a table and a diagram.

    scripts/bench evidence [--quick] [--out FOLDER] [--save FILE] [--compare FILE]

Overwrites docs/performance.md, its picture, and the first table of docs/numbers.md. --save keeps the ratios as JSON;
--compare prints them beside those kept. The exit status is 1 if one has fallen by more than 1.3 times.
"""

from __future__ import annotations

from pathlib import Path

import evidence_work
from evidence_pages import Pages, put
from figures import bench_options, bench_parser, finish

DOCS = Path(__file__).resolve().parents[1] / "docs"


def main(arguments: list[str] | None = None) -> int:
    """Everything, then the page."""
    parser = bench_parser(__doc__, "few points: to see that it works")
    parser.add_argument("--out", type=Path, help="folder of page and picture (docs; with --quick out/evidence)")
    options = bench_options(parser, arguments)
    folder = options.out or (DOCS.parent / "out" / "evidence" if options.quick else DOCS)
    pages = Pages(folder, options.quick)
    evidence_work.evidence(pages)
    pages.write()
    print(f"written: {folder}/performance.md")
    if folder == DOCS and not options.quick:
        put(pages.front)
    return finish(pages.figures, options, front=pages.front)


if __name__ == "__main__":
    raise SystemExit(main())
