"""`cable-shape export`: the motion of a study, or one of its instants, to files of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from cable_shape.checks import integer
from cable_shape.command.motion_study import followed
from cable_shape.planning.export import ENDINGS, export


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("file", type=Path, metavar="STUDY.yaml", help="a study's file, of which nothing varies here")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILE", help=", ".join(ENDINGS))
    parser.add_argument("--instant", type=int, metavar="N", help="this one only; STL, OBJ and MJCF have the first")
    parser.add_argument("--period", type=float, default=0.02, metavar="S", help="between two instants [s] (0.02)")


def run(arguments: argparse.Namespace) -> int:
    """Writes the file, of a harness a file a segment."""
    _, _, found = followed(arguments.file)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    for name, rows in found.items():
        instant = arguments.instant
        if instant is None and not ENDINGS.get(arguments.out.suffix.lower(), True):
            instant = 0
        if instant is not None:
            integer("--instant", instant, at_least=0, at_most=max(len(rows) - 1, 1))
        which = range(len(rows)) if instant is None else (instant,)
        file = arguments.out.with_stem(f"{arguments.out.stem}_{name}") if name else arguments.out
        print("written:", export([rows.shape(i) for i in which], file, rows.cable, period=arguments.period))
    return 0
