"""The figures of a bench beside what was asked of them: a table at its end, a file to keep, one to compare with."""

from __future__ import annotations

import argparse
import json
import math
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import scipy

#: A figure this many times off the one kept is told as changed; a ratio fallen by as much fails a comparison.
CHANGED = 1.3


def heading(text: str) -> None:
    """A line above a table."""
    print(f"\n## {text}", flush=True)


def machine() -> str:
    """Processor, cores and versions, in one line."""
    name = platform.processor() or platform.machine()
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        names = [line.partition(":")[2].strip() for line in cpu.read_text().splitlines() if "model name" in line]
        name = f"{names[0]}, {len(names)} threads" if names else name
    versions = f"numpy {np.__version__}, scipy {scipy.__version__}, numba {numba.__version__}"
    return f"{name}; Python {platform.python_version()}, {versions}; {platform.system()}"


class Figure(NamedTuple):
    """What was measured, and what was asked, in words.

    kind: "ratio", how many times faster: nothing is asked but not to become worse.
    """

    name: str
    measured: float
    asked: str
    text: str
    holds: bool
    kind: str = ""


class Figures:
    """Rows of the last table."""

    def __init__(self) -> None:
        self.rows: list[Figure] = []

    @property
    def hold(self) -> bool:
        """Whether all that was asked is met."""
        return all(row.holds for row in self.rows)

    def at_most(self, figure: str, measured: float, bound: float, form: str = "{:.1e}", unit: str = "") -> None:
        """Asks for `measured <= bound`; prints both and keeps them."""
        self._add(figure, measured, measured <= bound, "at most " + form.format(bound) + unit, form, unit)

    def at_least(self, figure: str, measured: float, bound: float, form: str = "{:.1f}", unit: str = "") -> None:
        """Asks for `measured >= bound`; prints both and keeps them."""
        self._add(figure, measured, measured >= bound, "at least " + form.format(bound) + unit, form, unit)

    def check(self, figure: str, holds: bool) -> None:
        """Something that holds or does not, its figures printed before."""
        self.rows.append(Figure(figure, float(holds), "yes", "yes" if holds else "no", bool(holds)))

    def ratio(self, figure: str, times: float) -> None:
        """So many times as fast: nothing is asked, but a comparison tells, and fails, if it has fallen."""
        self.rows.append(Figure(figure, float(times), "-", f"{times:.3g}", True, "ratio"))

    def _add(self, name: str, measured: float, holds: bool, asked: str, form: str, unit: str) -> None:
        row = Figure(name, float(measured), asked, form.format(measured) + unit, bool(holds))
        print(f"{name}: {row.text} (asked {asked})", flush=True)
        self.rows.append(row)

    def print_summary(self) -> None:
        """The last table: all of which something was asked."""
        heading("Summary")
        print(f"{'figure':66} {'asked':18} {'measured':16} holds?")
        for row in self.rows:
            if not row.kind:
                print(f"{row.name:66} {row.asked:18} {row.text:16} {'yes' if row.holds else 'NO'}")

    def named(self) -> dict[str, Figure]:
        """By name; one of which two things are asked also by the second."""
        out: dict[str, Figure] = {}
        for row in self.rows:
            out[row.name if row.name not in out else f"{row.name}, {row.asked}"] = row
        return out

    def as_json(self, **more: Any) -> dict[str, Any]:
        """Named figures with what was asked and whether it holds."""
        rows = {
            name: {
                "measured": row.measured if math.isfinite(row.measured) else None,
                "asked": row.asked,
                "text": row.text,
                "holds": row.holds,
                "kind": row.kind,
            }
            for name, row in self.named().items()
        }
        return {"machine": machine(), **more, "figures": rows}

    def add_json(self, kept: Mapping[str, Any], prefix: str) -> None:
        """The figures of another bench's file."""
        for name, row in kept["figures"].items():
            measured = math.nan if row["measured"] is None else row["measured"]
            self.rows.append(Figure(f"{prefix}{name}", measured, row["asked"], row["text"], row["holds"], row["kind"]))

    def compare(self, kept: Mapping[str, Any]) -> list[str]:
        """Prints the figures beside those kept; names of the ratios that are worse."""
        before = kept["figures"]
        print(f"{'figure':72} {'kept':>10} {'now':>10}   now / kept ({kept['machine']})")
        worse = []
        named = self.named()
        for key, row in named.items():
            was = before.get(key, {}).get("measured")
            if was is None:
                print(f"{key:72} {'-':>10} {row.measured:10.3g}")
                continue
            change = row.measured / was if was else math.nan
            mark = "" if 1.0 / CHANGED <= change <= CHANGED or math.isnan(change) else "  changed"
            if row.kind == "ratio" and change < 1.0 / CHANGED:
                mark = "  WORSE"
                worse.append(key)
            print(f"{key:72} {was:10.3g} {row.measured:10.3g}   {change:.2f}{mark}")
        for name in sorted(before.keys() - named.keys()):
            print(f"{name:72} {before[name]['text']:>10}          -   not measured now")
        return worse


def bench_parser(description: str | None, quick: str) -> argparse.ArgumentParser:
    """The options that every bench has; quick: what --quick leaves out."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--save", type=Path, metavar="FILE", help="keep the figures as JSON")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="print the figures beside those kept in FILE")
    return parser


def bench_options(parser: argparse.ArgumentParser, arguments: list[str] | None = None) -> argparse.Namespace:
    """The options given; a file to compare with that is missing is told before the work."""
    options = parser.parse_args(arguments)
    if options.compare is not None and not options.compare.is_file():
        parser.error(f"--compare {options.compare}: no such file. Make one by --save.")
    return options


def finish(figures: Figures, options: argparse.Namespace, **more: Any) -> int:
    """Summary, file and comparison; exit status 1 if a figure does not hold, or a ratio has become worse."""
    figures.print_summary()
    if options.quick:
        print("A quick run: shares and percentiles of so few tries may fall short here and yet hold in full.")
    worse: list[str] = []
    if options.compare is not None:
        heading(f"Beside {options.compare}")
        kept = json.loads(options.compare.read_text(encoding="utf-8"))
        if kept["quick"] != options.quick:
            print("One of the two runs was quick, the other was not: their figures are not those of the same work.")
        worse = figures.compare(kept)
    if options.save is not None:
        text = json.dumps(figures.as_json(quick=options.quick, **more), indent=1)
        options.save.write_text(text + "\n", encoding="utf-8")
    return 0 if figures.hold and not worse else 1
