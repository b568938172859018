"""`cable-shape tolerances`: how sure a study's measures and its shape are, and what makes them unsure."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cable_shape.command.study_file import add_function, read_study
from cable_shape.planning.study_spread import POINTS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("file", type=Path, metavar="STUDY.yaml", help="places with distributions")
    parser.add_argument("-o", "--out", type=Path, metavar="OUT", help="a folder for a report")
    parser.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the envelope (0.95)")
    parser.add_argument("--instant", type=int, default=0, metavar="N", help="at which it is told (0)")
    parser.add_argument("--points", type=int, default=POINTS, metavar="N", help=f"of Sobol's samples ({POINTS})")
    add_function(parser)


def run(arguments: argparse.Namespace) -> int:
    """Says how wide the envelope is and what each source does."""
    study = read_study(arguments.file, arguments.function)
    held = study.envelope(arguments.confidence, arguments.instant)
    for name, radius in held.radius.items():
        at = int(radius.argmax())
        text = f"{1e3 * radius.max():.3g} mm at point {at} of {len(radius)}"
        print(f"{100 * held.confidence:g} % of {held.shapes} shapes are within {text} {name}".rstrip())
    if held.without:
        print(f"{held.without} points have no shape")
    found = study.shares(arguments.points)
    for k, measure in enumerate(study.measures):
        print(f"{measure.name}: standard deviation {found.deviation[k]:.4g} {measure.unit}".rstrip())
        for i in np.argsort(-np.nan_to_num(found.total[k])).tolist():
            linear, first, total = (100.0 * x[k, i] for x in (found.linear, found.first, found.total))
            text = f"{linear:6.1f} % to first order, {first:6.1f} % alone, {total:6.1f} % with others"
            print(f"  {found.sources[i]:<34} {text}")
    if arguments.out is not None:
        from cable_shape.command.tolerances_report import write_tolerances_report

        print("written:", write_tolerances_report(study, held, found, arguments.out))
    return 0
