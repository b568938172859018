"""What cases of cables and of harnesses have in common: grips, free ends, cables and scenes from plain mappings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from cable_shape import checks
from cable_shape.cable.cable_file import CableFile
from cable_shape.errors import ArgumentError, shown
from cable_shape.files.files import path_of
from cable_shape.pose import IDENTITY, FreeEnd, Grip, Pose
from cable_shape.scene.scene import Scene

T = TypeVar("T")

POSE_KEYS = ("position", "quaternion", "turns")
GRIP_KEYS = ("kind", "offset", "curvature")
FREE_END_KEYS = ("mass", "force", "moment")


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


def cable_of(value: Any, folder: Path) -> CableFile:
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
