"""`cable-shape import`: files of other programs to those of this one."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from cable_shape.cable import kbl_harness
from cable_shape.cable.formboard import dxf, laid_flat, svg
from cable_shape.cable.harness import Harness
from cable_shape.cable.output import cable_text, harness_text, put, report_text
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of

HARNESSES, CURVES = (".kbl", ".xml", ".yml", ".yaml"), (".csv", ".dxf", ".stl", ".obj", ".glb", ".step", ".stp")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    known = ", ".join((*HARNESSES, *CURVES))
    parser.add_argument("file", type=Path, metavar="FILE", help=f"one of {known}")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder for what is made of it")
    parser.add_argument("--merge-below", type=float, default=0.0, metavar="M", help="merge shorter segments [m] (none)")
    parser.add_argument(
        "--clip-kind", choices=("ball", "hinge", "fixed"), default="ball", help="what fixings are (ball)"
    )
    parser.add_argument("--hold", choices=kbl_harness.HOLDS, default="fixings", help="hold connectors, too (fixings)")
    parser.add_argument("--branches", type=Path, metavar="FILE.yaml", help="of WireViz: where bundles branch")
    parser.add_argument("--unit", help="of curves and meshes: m, mm, cm, in; needed where the file has none")
    parser.add_argument("--linear-density", type=float, metavar="KG/M", help="of a cable from a curve or mesh")
    parser.add_argument("--bending-stiffness", type=float, metavar="NM2", help="of a cable from a curve or mesh")
    parser.add_argument("--diameter", type=float, metavar="M", help="of a cable from a curve; of a mesh it is found")


def run(arguments: argparse.Namespace) -> int:
    """Reads, writes all files at once, and says what became of it."""
    file = path_of(arguments.file)
    kind = file.suffix.lower()
    if kind in HARNESSES:
        harness = _harness(arguments, file, kind)
        flat = laid_flat(harness)
        text = report_text(harness)
        files = {
            "harness.yaml": harness_text(harness), "import.md": text, "formboard.svg": svg(flat),
            "formboard.dxf": dxf(flat),
        }  # fmt: skip
    elif kind in CURVES:
        from cable_shape.cable.curves import preformed

        cable, line, told = preformed(
            file, arguments.unit, arguments.linear_density, arguments.bending_stiffness, arguments.diameter
        )
        from cable_shape.cable.output import case_text

        text = told
        files = {"cable.yaml": cable_text(cable, file.name), "case.yaml": case_text(line), "import.md": told}
    else:
        known = ", ".join((*HARNESSES, *CURVES))
        raise ArgumentError.of("FILE", str(file), "this kind of file is not read", f"Known: {known}.")
    place = put(arguments.out, files)
    print(text, end="")
    print("written:", ", ".join(str(place / name) for name in files))
    return 0


def _harness(arguments: argparse.Namespace, file: Path, kind: str) -> Harness:
    if kind in (".yml", ".yaml"):
        from cable_shape.cable.wireviz import from_wireviz

        return from_wireviz(file, arguments.branches)
    made: Harness = kbl_harness.from_kbl(
        Harness, file, arguments.merge_below, arguments.clip_kind, arguments.hold, bar=_bar
    )  # fmt: skip
    return made


def _bar(items: Iterable[Any]) -> Iterable[Any]:
    """A progress bar on stderr, if that is a terminal."""
    from tqdm import tqdm

    bar: Iterable[Any] = tqdm(items, unit=" segments", disable=None, leave=False, file=sys.stderr)
    return bar
