"""`cable-shape sweep`: the space that a motion sweeps, and which bodies it comes near."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from cable_shape.cable.pieces import widest
from cable_shape.checks import number
from cable_shape.command.motion_study import followed
from cable_shape.errors import ArgumentError
from cable_shape.planning.export import export
from cable_shape.planning.study_near import nearest
from cable_shape.planning.swept import swept


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("file", type=Path, metavar="STUDY.yaml", help="a study's file, of which nothing varies here")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="FILE", help=".stl or .obj; of a harness a file a segment"
    )
    parser.add_argument("--margin", type=float, default=0.0, metavar="M", help="around the cable's surface [m] (0)")
    parser.add_argument(
        "--looseness", type=float, default=0.005, metavar="M", help="how far the mesh may be off (0.005)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Writes the mesh, and says how loose it is and what is near."""
    margin = number("--margin", arguments.margin, at_least=0.0, unit="m")
    if arguments.out.suffix.lower() not in (".stl", ".obj"):
        raise ArgumentError.of("--out", str(arguments.out), "it must end in .stl or .obj", "Name another file.")
    _, case, found = followed(arguments.file)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    for name, rows in found.items():
        mesh = swept(rows, 0.5 * widest(rows.cable) + margin, looseness=arguments.looseness)
        file = arguments.out.with_stem(f"{arguments.out.stem}_{name}") if name else arguments.out
        export(mesh, file)
        print(f"{file}: {mesh}")
    for one in nearest(case, found):
        if math.isinf(one.distance):
            print(f"  {one.body:<24} out of reach")
            continue
        where = f"{one.segment} at {one.arc_length:.4g} m".strip()
        print(f"  {one.body:<24} {1e3 * one.distance:.2f} mm at instant {one.instant:.2f}, {where}")
    return 0
