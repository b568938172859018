"""`cable-shape optimise`: the point of a study that is furthest from its nearest limit."""

from __future__ import annotations

import argparse
from pathlib import Path

from cable_shape.command.study_file import add_function, read_study
from cable_shape.planning.study_best import GRID, STARTS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("file", type=Path, metavar="STUDY.yaml", help="places with a range, measures with limits")
    parser.add_argument("-o", "--out", type=Path, metavar="OUT", help="a folder for a report, with what is around it")
    parser.add_argument("--precision", type=float, default=1e-4, metavar="X", help="of the range of each place (1e-4)")
    parser.add_argument("--grid", type=int, default=GRID, metavar="N", help=f"points for each place at first ({GRID})")
    parser.add_argument("--starts", type=int, default=STARTS, metavar="N", help=f"of its best go on ({STARTS})")
    add_function(parser)


def run(arguments: argparse.Namespace) -> int:
    """Says where it is and what limits it there."""
    study = read_study(arguments.file, arguments.function)
    found = study.best(precision=arguments.precision, grid=arguments.grid, starts=arguments.starts)
    for axis, value in zip(study.axes, found.point.tolist(), strict=True):
        print(f"  {axis.name:<32} {axis.shown(value)}")
    print(f"{100.0 * found.used:.4g} % of a limit is used at most, by {', '.join(found.limiting)}")
    for measure, value in zip(study.measures, found.value.tolist(), strict=True):
        print(f"  {measure.name:<32} {value:.6g} {measure.unit}".rstrip())
    others = ", ".join(f"{100.0 * used:.4g}" for used in found.starts)
    print(f"{found.solves} points solved for; the starts came to {others} %")
    print(f"{found.shapes} single shapes for derivatives; {100.0 * found.exact:.0f} % of the derivatives are exact")
    if arguments.out is not None:
        from cable_shape.command.optimise_report import write_best_report

        print("written:", write_best_report(study, found, arguments.out))
    return 0
