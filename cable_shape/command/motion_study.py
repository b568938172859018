"""The motion of a study's file, nothing varied."""

from __future__ import annotations

from pathlib import Path

from cable_shape.command.study_file import read_study
from cable_shape.errors import ArgumentError
from cable_shape.planning.study import Study
from cable_shape.planning.study_case import Case
from cable_shape.planning.study_walk import Rows, walk


def followed(file: Path) -> tuple[Study, Case, dict[str, Rows]]:
    """The study, its case as the file has it, and all shapes.

    Raises
    ------
    ArgumentError
        If an instant has no usable shape.
    """
    study = read_study(file, without=("vary", "sample", "measure"))
    case = study.cases.at([])
    found = walk(case)
    for rows in found.values():
        if not rows.usable.all():
            bad = int((~rows.usable).argmax())
            raise ArgumentError(f"{file}: instant {bad} has no usable shape. {rows.shape(bad).status.remedy}")
    return study, case, found
