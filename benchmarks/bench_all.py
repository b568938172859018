#!/usr/bin/env python
"""Every bench, one after the other, and all their figures in one table.

    scripts/bench [all] [--quick] [--only PART ...] [--save FILE] [--compare FILE] [--logs FOLDER] [--draw FILE]

Each part runs in a process of its own; what it prints goes to FOLDER/PART.log (out/bench), its figures, with what was
asked of them, into the table at the end, which also tells the wall and processor time of each part. The exit status
is 1 if a part fails, a figure does not hold, or, beside FILE, a ratio has fallen by more than 1.3 times. About ten
minutes on a quiet machine; parts that other load does not change run side by side. The rivals of `scripts/bench rivals`
take part where they are installed. A full run of all parts writes docs/numbers.md, any other FOLDER/numbers.md; --draw
writes docs/numbers.md of a FILE that --save kept, and runs nothing.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numbers_page
from figures import Figures, bench_options, bench_parser, finish, heading
from tqdm import tqdm

HERE = Path(__file__).resolve().parent
LOGS = HERE.parent / "out" / "bench"


class Part(NamedTuple):
    """A bench, its options in full and with --quick; one that keeps no figures is judged by its exit status."""

    name: str
    full: tuple[str, ...] = ()
    quick: tuple[str, ...] = ("--quick",)
    figures: bool = True
    steady: bool = False  # other load does not change its figures: it runs beside the others that are steady


PARTS = (
    Part("gradient"),
    Part("cosserat"),
    Part("scene"),
    Part("contact", ("--motions", "50")),
    Part("combinations", steady=True),
    Part("harness"),
    Part("motion"),
    Part("seen"),
    Part("planner"),
    Part("studies"),
    Part("cell", ("--seconds", "5")),
    Part("evidence"),
    Part("truth", steady=True),
    Part("certify", ("--rows", "20000", "--clips", "2000"), steady=True),
)


class Spent(NamedTuple):
    """Wall and processor time of a part [s], and its exit status."""

    wall: float
    processor: float
    code: int


def run(part: Part, quick: bool, kept: Path, log: Path) -> Spent:
    """One part in a process of its own."""
    command = [sys.executable, str(HERE / f"bench_{part.name}.py"), *(part.quick if quick else part.full)]
    if part.figures:
        command += ["--save", str(kept)]
    began = perf_counter()
    with log.open("w", encoding="utf-8") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return Spent(perf_counter() - began, used.ru_utime + used.ru_stime, process.returncode)


def drawn(kept: dict[str, Any]) -> str:
    """The page of numbers."""
    names = {file.stem.removeprefix("bench_") for file in HERE.glob("bench_*.py")}
    return numbers_page.page(kept, sorted(names - {"all"}))


def main(arguments: list[str] | None = None) -> int:
    """All parts, then one table."""
    parser = bench_parser(__doc__, "each part with its own --quick: to see that it works")
    names = [part.name for part in PARTS]
    parser.add_argument("--only", choices=names, nargs="+", default=names, metavar="PART", help="these parts alone")
    parser.add_argument("--logs", type=Path, default=LOGS, metavar="FOLDER", help="where the parts print to")
    parser.add_argument("--draw", type=Path, metavar="FILE", help="write docs/numbers.md of the figures kept in FILE")
    options = bench_options(parser, arguments)
    if options.draw is not None:
        if not options.draw.is_file():
            parser.error(f"--draw {options.draw}: no such file. Make one by --save.")
        numbers_page.PAGE.write_text(drawn(json.loads(options.draw.read_text(encoding="utf-8"))), encoding="utf-8")
        return 0
    options.logs.mkdir(parents=True, exist_ok=True)
    load = f"{os.getloadavg()[0]:.1f}"
    figures, spent, began, front = Figures(), {}, perf_counter(), ""
    parts = [part for part in PARTS if part.name in options.only]
    turns = [[part] for part in parts if not part.steady] + [[part for part in parts if part.steady]]
    with (
        tempfile.TemporaryDirectory(prefix="bench_") as folder,
        tqdm(total=len(parts), desc="bench", unit="part") as bar,
    ):
        kept = {part.name: Path(folder) / f"{part.name}.json" for part in parts}

        def spend(part: Part) -> Spent:
            return run(part, options.quick, kept[part.name], options.logs / f"{part.name}.log")

        for turn in filter(None, turns):
            bar.set_postfix_str(", ".join(part.name for part in turn))
            with ThreadPoolExecutor(len(turn)) as pool:
                spent |= dict(zip((part.name for part in turn), pool.map(spend, turn), strict=True))
            bar.update(len(turn))
        for name, file in kept.items():
            own = Figures()
            if file.exists():
                saved = json.loads(file.read_text(encoding="utf-8"))
                own.add_json(saved, f"{name}: ")
                front = saved.get("front", front)
            if not file.exists() or (spent[name].code and own.hold):
                own.check(f"{name}: ran to its end and holds", spent[name].code == 0)
            figures.rows += own.rows
    whole = perf_counter() - began
    more = {
        "seconds": {name: round(part.wall, 1) for name, part in spent.items()},
        "load": load,
        "front": front,
    }
    code = finish(figures, options, **more)
    whole_run = set(options.only) == set(names) and not options.quick
    page = numbers_page.PAGE if whole_run else options.logs / "numbers.md"
    page.write_text(drawn(figures.as_json(quick=options.quick, **more)), encoding="utf-8")
    heading(f"Time of each part; what they print is in {options.logs}")
    for name, (wall, processor, status) in spent.items():
        print(f"{name:14} {wall:7.0f} s, processor {processor:7.0f} s{f'   exit status {status}' if status else ''}")
    print(f"{'all':14} {whole:7.0f} s")
    return code


if __name__ == "__main__":
    raise SystemExit(main())
