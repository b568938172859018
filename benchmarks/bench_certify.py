#!/usr/bin/env python
"""Random grasps from nothing, and for every shape that says OK a certificate by a check of its own in numpy.

    scripts/bench certify [--rows N] [--clips N] [--processes N] [--quick] [--out FOLDER] [--row N ...] [--write]

Plain grasps: chord 0.02 to 0.9999 L, any rotations, (EI/w)^(1/3) from 0.01 to 3 L; every other one with elastic
cables, rest curvature, two stiffnesses, swivel and pinned ends, or masses. Each is solved by `cable_shape.predict` at
its default tolerance, at 150 points, or more where its boundary layers are thinner than their spacing. The check
(certify_check.py) integrates the equations between the points from the shape's own places, frames, forces and moments,
turns what is left over into metres, and looks whether the second variation of the energy is positive. An OK is wrong
if the exact equilibrium is further away than the tolerance, is not a minimum, or if force or moment are off by more
than twice their estimate and a thousandth of the largest (of a taut cable's force: and what an end that is off by the
tolerance changes). It is called so only where four times as many points agree, and where the same shape, solved a
hundred times finer and certified, does. As many points are used for one row in 200, too, to tell the check's own
error. In clips and eyelets only the status is counted. No chord is longer than its cable.

What is done is kept in FOLDER (out/certify) block by block, under a name made of the sources: a run that was broken off
goes on, and one of other code begins anew. A row depends on its number alone; --row repeats rows and tells all of them.
--write puts the counts on docs/stability.md.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import hashlib
import json
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from certify_grasps import MOST_HALVINGS, plain, points
from certify_rows import COUNTED, RESERVE, SEED, certified, clips_block, plain_block
from evidence_pages import CERTIFIED, put, table
from figures import Figures, bench_options, bench_parser, finish, heading
from tqdm import tqdm

import cable_shape as cs

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "out" / "certify"
PAGE = HERE.parent / "docs" / "stability.md"
ROWS, CLIPS, BLOCK = 1_000_000, 40_000, 500
#: Rows that are told by their number.
LISTED = 60


def sources() -> str:
    """A name for the code that makes the numbers."""
    own = [*sorted(HERE.glob("certify_*.py")), HERE / "cosserat_random.py"]
    package = sorted(Path(cs.__file__).parent.rglob("*.py"))
    digest = hashlib.sha256()
    for file in (*own, *package):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def blocks(work: Callable[[int, int], dict[str, Any]], rows: int, processes: int, kept: Path) -> list[dict[str, Any]]:
    """All blocks of so many rows, those that are kept and those to be done, each kept as it comes."""
    done: dict[int, dict[str, Any]] = {}
    if kept.exists():
        lines = kept.read_text(encoding="utf-8").splitlines(keepends=True)
        whole = [line for line in lines if line.endswith("\n")]  # the last one may be broken off
        if len(whole) < len(lines):
            kept.write_text("".join(whole), encoding="utf-8")
        done = {block["rows"][0]: block for block in map(json.loads, whole)}
    spans = [(a, min(a + BLOCK, rows)) for a in range(0, rows, BLOCK)]
    left = [span for span in spans if done.get(span[0], {}).get("rows") != list(span)]
    kept.parent.mkdir(parents=True, exist_ok=True)
    bar = tqdm(total=rows, initial=rows - sum(b - a for a, b in left), desc=kept.stem, unit="row", disable=None)
    with kept.open("a", encoding="utf-8") as file, bar:

        def keep(block: dict[str, Any]) -> None:
            done[block["rows"][0]] = block
            file.write(json.dumps(block) + "\n")
            file.flush()
            bar.update(block["rows"][1] - block["rows"][0])

        if processes == 1:
            for span in left:
                keep(work(*span))
        else:
            with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
                for block in pool.map(partial(_apart, work), left):
                    keep(block)
    return [done[a] for a, _ in spans]


def _apart(work: Callable[[int, int], dict[str, Any]], span: tuple[int, int]) -> dict[str, Any]:
    return work(*span)


def counted(found: list[dict[str, Any]], key: str) -> Counter[str]:
    """The sum of one of the counts."""
    out: Counter[str] = Counter()
    for block in found:
        out.update(block[key])
    return out


def listed(rows: list[list[Any]], most: int = LISTED) -> None:
    """Rows by their numbers."""
    for row in rows[:most]:
        print("  row", *row)
    if len(rows) > most:
        print(f"  and {len(rows) - most} more")


def checked_of(found: list[dict[str, Any]]) -> tuple[int, float, float]:
    """Rows at four times the points; how much the distance changes [tolerances], and whether stability does."""
    number, worst, flips = zip(*[block["checked"] for block in found], strict=True)
    return sum(number), max(worst), max(flips)


def print_plain(found: list[dict[str, Any]], figures: Figures) -> None:
    """What the plain grasps came to."""
    rows = sum(block["rows"][1] - block["rows"][0] for block in found)
    heading(f"{rows:,} plain grasps from nothing")
    statuses = counted(found, "statuses")
    print(f"status {dict(statuses)}")
    print(f"OK with {dict(counted(found, 'kinds'))}; several of them may meet in a row")
    good = statuses["OK"]
    above = np.sum([block["above"] for block in found], axis=0)
    away = [block["away"] for block in found]
    print(
        f"{good:,} certificates at {sum(block['points'] for block in found) / max(good, 1):.0f} points a shape: all of "
        f"the equations, the ends, and the second variation; distance from the exact equilibrium / tolerance: mean "
        f"{sum(total for _, total in away) / max(good, 1):.2f}, largest {max(largest for largest, _ in away):.3f}; "
        + ", ".join(f"{number:,} above {least:g}" for least, number in zip(COUNTED, above, strict=True))
    )
    number, worst, flips = checked_of(found)
    print(f"{number:,} of them at four times the points: distance / tolerance changes by at most {worst:.3f}")
    without, wrong = ([row for block in found for row in block[key]] for key in ("without", "wrong"))
    unresolved = [[row, "points too few for its layers"] for block in found for row in block["unresolved"]]
    for name, those in (("without a shape", without), ("wrong", wrong), ("not judged", unresolved)):
        if those:
            print(f"{name}:")
            listed(those)
    figures.at_most("plain grasps: wrong OK", len(wrong), 0, "{:.0f}")
    figures.at_most("plain grasps: OK, yet not judged", len(unresolved), 0, "{:.0f}")
    figures.at_most("plain grasps: without a stable shape", 100.0 * len(without) / rows, 0.1, "{:.4f}", " %")
    figures.at_most("certificates that four times the points change, of the tolerance", worst, 0.1, "{:.3f}")
    figures.check("stability at four times the points is the same", not flips)


def print_clips(found: list[dict[str, Any]], figures: Figures) -> None:
    """What the rows in clips came to."""
    heading("In clips and eyelets, from nothing: status alone")
    for name in ("clips", "eyelets"):
        statuses = counted(found, name)
        rows = sum(statuses.values())
        print(f"{name}: {rows:,} rows, {dict(statuses)}")
        share = 100.0 * (rows - statuses["OK"]) / max(rows, 1)
        figures.at_most(f"{name}: without a stable shape", share, 0.5, "{:.3f}", " %")
    listed([row for block in found for row in block["without"]])


def section(plain_found: list[dict[str, Any]], clips_found: list[dict[str, Any]]) -> str:
    """The counts as a part of a page, with the command that makes them."""
    rows = [sum(block["rows"][1] - block["rows"][0] for block in found) for found in (plain_found, clips_found)]
    statuses = [("plain", counted(plain_found, "statuses"))]
    statuses += [(name, counted(clips_found, name)) for name in ("clips", "eyelets")]
    wrong = [row for block in plain_found for row in block["wrong"]]
    above = np.sum([block["above"] for block in plain_found], axis=0)
    far = ", ".join(f"{above[COUNTED.index(least)]:,} by more than {least:g}" for least in (1.0, 1.5, 2.0))
    largest = max(block["away"][0] for block in plain_found)
    reasons = Counter(part.split()[0] for _, why, _ in wrong for part in why.split(", "))
    words = {"away": "further away", "force": "force", "moment": "moment", "off": "ends or balance", "no": "no minimum"}
    told = ", ".join(f"{words[reason]} {reasons[reason]:,}" for reason in words)
    number, worst, flips = checked_of(plain_found)
    head = ("grasps", "rows", "without a stable shape", "status")
    lines = []
    for name, found in statuses:
        total = sum(found.values())
        less = ", ".join(f"{status} {count:,}" for status, count in found.most_common())
        lines.append((name, f"{total:,}", f"{100.0 * (total - found['OK']) / max(total, 1):.4f} %", less))
    return "\n\n".join((
        "## Certified grasps",
        f"`scripts/bench certify --rows {rows[0]} --clips {rows[1]}`: random grasps from nothing at the default "
        "tolerance, chord 0.02 to 0.9999 L, any rotations, (EI/w)^(1/3) from 0.01 to 3 L; every other plain one with "
        "elastic cables, rest curvature, two stiffnesses, swivel or pinned ends, or masses.",
        table(head, lines),
        f"Every one of the {statuses[0][1]['OK']:,} plain shapes that say OK was certified by a check of its own in "
        "numpy: the rod's equations integrated from point to point, and what is left over turned into a distance from "
        "the exact equilibrium by one Newton step; the ends; force and moment; the inertia of the second variation, of "
        "shapes that are taut within a boundary layer in the limit of ever closer points. "
        f"Wrong is what is further away than the tolerance or fails in another of these: {len(wrong):,} ({told}). In "
        f"tolerances: {far}, the furthest {largest:.2f}. At four times the points the distance of {number:,} of them "
        f"changes by {worst:.3f} at most, stability {'of some' if flips else 'of none'}. In clips and eyelets only the "
        "status counts.",
        *(["Those rows: " + "; ".join(f"{row} {why}" for row, why, _ in wrong[:LISTED]) + "."] if wrong else []),
    ))  # fmt: skip


def print_row(row: int, seed: int) -> None:
    """All about one plain row."""
    grasp = plain(seed, row)
    print(
        f"row {row}: {', '.join(grasp.what)}\n  {grasp.cable}\n  {grasp.start}\n  {grasp.end}\n  masses {grasp.masses}"
    )
    for more in (0, 1, 2):
        halvings = min(grasp.halvings + more, MOST_HALVINGS)
        shape = grasp.predict(halvings)
        print(f"  {points(halvings)} points: {shape}")
        if shape.status is cs.Status.OK:
            for reserve in (RESERVE, 0.0):
                print(f"    reserve {reserve:g}: {certified([grasp], [shape], halvings, reserve)[0]}")


def parser() -> argparse.ArgumentParser:
    """The options."""
    out = bench_parser(__doc__, "600 plain rows, 60 in clips")
    out.add_argument("--rows", type=int, help=f"plain grasps ({ROWS:,})")
    out.add_argument("--clips", type=int, help=f"rows in clips and eyelets, half of them each ({CLIPS:,})")
    out.add_argument("--processes", type=int, default=1, help="side by side (1)")
    out.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="what is done is kept there (out/certify)")
    out.add_argument("--row", type=int, nargs="+", metavar="N", help="these plain rows alone, with all that is known")
    out.add_argument("--write", action="store_true", help="put the counts on docs/stability.md")
    return out


def main(arguments: list[str] | None = None) -> int:
    """The counts."""
    options = bench_options(parser(), arguments)
    if options.row:
        for row in options.row:
            print_row(row, SEED)
        return 0
    figures = Figures()
    rows = options.rows if options.rows is not None else 600 if options.quick else ROWS
    clips = options.clips if options.clips is not None else 60 if options.quick else CLIPS
    folder = options.out / sources()
    found = [
        blocks(work, count, options.processes, folder / name)
        for work, count, name in ((plain_block, rows, "plain.jsonl"), (clips_block, clips, "clips.jsonl"))
    ]
    if rows:
        print_plain(found[0], figures)
    if clips:
        print_clips(found[1], figures)
    if options.write and rows and clips:
        put(section(*found), PAGE, CERTIFIED)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
