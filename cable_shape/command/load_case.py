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

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from cable_shape import checks
from cable_shape.cable.cable_file import CableFile
from cable_shape.command.case import Case
from cable_shape.command.harness_case import HarnessCase, harness_case_of
from cable_shape.command.reference_case import reference_case
from cable_shape.errors import ArgumentError, shown
from cable_shape.files.files import path_of
from cable_shape.files.yaml_files import load_yaml
from cable_shape.pose import IDENTITY, FreeEnd, Grip, Pose
from cable_shape.scene.scene import Scene

T = TypeVar("T")

POSE_KEYS = ("position", "quaternion", "turns")
GRIP_KEYS = ("kind", "offset", "curvature")
FREE_END_KEYS = ("mass", "force", "moment")
OPTION_KEYS = ("model", "gravity", "points", "tolerance", "distributed_load")
CASE_KEYS = ("name", "cable", "start", "end", "scene", *OPTION_KEYS)


def load_case(path: str | Path) -> Case | HarnessCase:
    """The case in a YAML or JSON file; one with the key `harness` is read by :mod:`cable_shape.command.harness_case`.

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
        if "harness" in values:
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
    file = _cable(values["cable"], folder)
    start, end = grip_of("start", values["start"]), end_of("end", values.get("end"))
    return Case(
        name=str(values.get("name") or name),
        cable=file.cable,
        start=file.start.told(values["start"].get("kind")).grip(start),
        end=end if isinstance(end, FreeEnd) else file.end.told(values["end"].get("kind")).grip(end),
        scene=scene_of(values.get("scene"), folder),
        options=options,
    )


def grip_of(where: str, values: Any) -> Grip:
    """A Grip from a mapping with the keywords of Pose and Grip."""
    checks.known_keys(where, values, (*POSE_KEYS, *GRIP_KEYS))
    pose = pose_of(where, {key: value for key, value in values.items() if key in POSE_KEYS})
    given: dict[str, Any] = {key: values[key] for key in ("kind", "curvature") if values.get(key) is not None}
    offset = IDENTITY if values.get("offset") is None else pose_of(f"{where}.offset", values["offset"])
    return _within(where, lambda: Grip(pose, offset=offset, **given))


def end_of(where: str, values: Any) -> Grip | FreeEnd:
    """A Grip, or a FreeEnd from its keywords; None is a free end without load."""
    if values is None:
        return FreeEnd()
    if isinstance(values, Mapping) and values and set(values) <= set(FREE_END_KEYS):
        return _within(where, lambda: FreeEnd(**values))
    if isinstance(values, Mapping) and set(values) & set(FREE_END_KEYS):
        raise ArgumentError(
            f"{where}: it is either gripped ({', '.join((*POSE_KEYS, *GRIP_KEYS))}) or free "
            f"({', '.join(FREE_END_KEYS)}), but has keys of both. Remove those of one."
        )
    return grip_of(where, values)


def pose_of(where: str, values: Any) -> Pose:
    """A Pose from a mapping with its keywords; the position is required."""
    checks.known_keys(where, values, POSE_KEYS)
    if "position" not in values:
        raise ArgumentError(f"{where}: position is missing. Give three numbers in m.")
    return _within(where, lambda: Pose(**values))


def _cable(value: Any, folder: Path) -> CableFile:
    if isinstance(value, str):
        return _within(f"cable = {shown(value)}", lambda: CableFile.from_yaml(folder / path_of(value)))
    return CableFile.from_mapping(value)


def scene_of(value: Any, folder: Path) -> Scene | None:
    """A scene from its keywords, or from the path of its file."""
    if value is None:
        return None
    if isinstance(value, str):
        return _within(f"scene = {shown(value)}", lambda: Scene.from_yaml(folder / path_of(value)))
    return Scene.from_mapping(value, folder=folder)


def _within(where: str, make: Callable[[], T]) -> T:
    """`make()`, whose errors also say where they were read."""
    try:
        return make()
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None
