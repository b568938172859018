"""Cases from YAML or JSON files: :func:`load_case`.

Two forms are read. The first has the keywords of :func:`cable_shape.predict` as keys::

    cable: {length: 1.2, linear_density: 0.1, bending_stiffness: 0.01}    # or the path of a cable's YAML file, whose
                                                                          # `grips`, if it has any, correct both ends
    start: {position: [0, 0, 0], quaternion: [0.5, 0.5, 0.5, 0.5]}        # kind, offset, curvature may follow
    end: {position: [0.8, 0, 0], quaternion: [0.5, 0.5, 0.5, 0.5]}        # turns may follow; absent: a free end
    scene: {masses: [{arc_length: 0.6, mass: 0.02}]}                      # or the path of a scene's YAML file
    model: gradient4

The second is that of published reference shapes, see :mod:`cable_shape.command.reference_case`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_shape import checks
from cable_shape.cable.case_parts import cable_of, end_of, grip_of, scene_of
from cable_shape.command.case import Case
from cable_shape.command.harness_case import HarnessCase, harness_case_of
from cable_shape.command.reference_case import reference_case
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of
from cable_shape.files.yaml_files import load_yaml
from cable_shape.pose import FreeEnd

OPTION_KEYS = ("model", "gravity", "points", "tolerance", "distributed_load")
CASE_KEYS = ("name", "cable", "start", "end", "scene", *OPTION_KEYS)


def load_case(path: str | Path) -> Case | HarnessCase:
    """The case in a YAML or JSON file; one with the key `harness` or `segments` is of :mod:`.harness_case`.

    Raises
    ------
    ArgumentError
        Naming the file, the key, the bound and the remedy.
    """
    file = path_of(path, "case")
    values = load_yaml(file)
    cable = values.get("cable")
    try:
        if values.get("kind") == "critical_value" or (isinstance(cable, Mapping) and "EI1" in cable):
            return reference_case(values)
        if "harness" in values or "segments" in values:
            return harness_case_of(values, file.parent, file.stem)
        return case_of(values, file.parent, file.stem)
    except ArgumentError as error:
        raise type(error)(f"{file}: {error}") from None


def case_of(values: Mapping[str, Any], folder: Path, name: str) -> Case:
    """The case with the keywords of predict as keys; relative paths are taken from `folder`."""
    checks.known_keys("case", values, CASE_KEYS)
    for key in ("cable", "start"):
        if key not in values:
            raise ArgumentError(f"{key} is missing. Keys of a case: {', '.join(CASE_KEYS)}.")
    options = {key: values[key] for key in OPTION_KEYS if values.get(key) is not None}
    file = cable_of(values["cable"], folder)
    start, end = grip_of("start", values["start"]), end_of("end", values.get("end"))
    return Case(
        name=str(values.get("name") or name),
        cable=file.cable,
        start=file.start.told(values["start"].get("kind")).grip(start),
        end=end if isinstance(end, FreeEnd) else file.end.told(values["end"].get("kind")).grip(end),
        scene=scene_of(values.get("scene"), folder),
        options=options,
    )
