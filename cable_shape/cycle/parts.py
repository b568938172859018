"""Shapes and reports with harnesses taken apart: what is said, drawn and sent of each segment as of a cable."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import SIDES, Harness
from cable_shape.prediction.layout import cable_id as cable_id
from cable_shape.safety.report import CycleReport
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape


def cables_of(cables: Mapping[str, Cable | Harness]) -> dict[str, Cable]:
    """The cables by their names, and the segments of harnesses under "harness/segment"."""
    out: dict[str, Cable] = {}
    for name, cable in cables.items():
        if isinstance(cable, Harness):
            out.update((cable_id(name, segment), one) for segment, one in cable.segments.items())
        else:
            out[name] = cable
    return out


def parts_of(shapes: Mapping[str, Any]) -> dict[str, CableShape]:
    """The shape of every cable by its name, and of every segment of a harness under "harness/segment"."""
    out: dict[str, CableShape] = {}
    for name, shape in shapes.items():
        if isinstance(shape, HarnessShape):
            out.update((cable_id(name, segment), one) for segment, one in shape.segments.items())
        else:
            out[name] = shape
    return out


def in_parts(report: CycleReport) -> CycleReport:
    """The same report with `shapes` and `grips` of segments, as the rest of it is; an end in a junction is None."""
    shapes: Mapping[str, Any] = report.shapes
    if not any(isinstance(shape, HarnessShape) for shape in shapes.values()):
        return report
    given: Mapping[str, Any] = report.grips
    grips: dict[str, Any] = {}
    for name, ends in given.items():
        if not isinstance(ends, Mapping):
            grips[name] = ends
            continue
        for segment in shapes[name].segments:
            grips[cable_id(name, segment)] = tuple(ends.get(f"{segment}.{side}") for side in SIDES)
    return dataclasses.replace(report, shapes=parts_of(shapes), grips=grips)
