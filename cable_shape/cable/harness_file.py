"""A harness from plain mappings, as YAML holds them, and the other way round.

Segments are cables by their name, or the path of a cable's file; junctions name the ends that meet in them::

    segments:
      trunk: {length: 0.6, linear_density: 0.12, bending_stiffness: 0.01}
      left: {length: 0.4, linear_density: 0.05, bending_stiffness: 0.003}
      right: branch.yaml
    junctions:
      - name: fork
        ends: [trunk.end, left.start, right.start]
        kind: rigid                                                  # or ball
        mass: 0.01                                                   # kg
        frames:                                                      # of the ends in the junction; absent: identity
          left.start: {quaternion: [0.3827, 0, 0, 0.9239]}
          right.start: {quaternion: [-0.3827, 0, 0, 0.9239]}

Keys `ends` and `markers` say which ends are held and where markers are, see :mod:`cable_shape.cycle.harness_ends`, a
key `scene` what else holds it, as :mod:`cable_shape.scene.scene_files` has it; none is a part of the harness.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.junction import Junction
from cable_shape.errors import ArgumentError, UnknownKeyError, shown
from cable_shape.files.files import path_of
from cable_shape.pose import Pose, pose_entry

H = TypeVar("H")

ENDS, MARKERS = "ends", "markers"
HARNESS_KEYS = ("segments", "junctions", ENDS, MARKERS, "scene")
JUNCTION_KEYS = ("name", "ends", "kind", "frames", "mass")


def harness_of(
    make: Callable[[dict[str, Cable], list[Junction]], H], values: Mapping[str, Any], where: str, folder: str | Path
) -> H:
    """What `make` makes of the segments and junctions in a mapping.

    Errors name `where` and the part; paths of cables are taken from `folder`.
    """
    checks.known_keys(where, values, HARNESS_KEYS)
    segments = values.get("segments")
    if not isinstance(segments, Mapping) or not segments:
        remedy = "Write name: {length: .., linear_density: .., bending_stiffness: ..}."
        raise ArgumentError.of(f"{where}: segments", segments, "it must be a mapping of names to cables", remedy)
    items = () if values.get("junctions") is None else values["junctions"]
    if not isinstance(items, (list, tuple)):
        remedy = "Start every entry with a dash."
        raise ArgumentError.of(f"{where}: junctions", items, "it must be a list", remedy)
    try:
        cables = {name: _cable(name, value, path_of(folder, "folder")) for name, value in segments.items()}
        return make(cables, [_junction(item, i) for i, item in enumerate(items)])
    except UnknownKeyError as error:
        raise UnknownKeyError(f"{where}: {error}") from None
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None


def as_dict(segments: Mapping[str, Cable], junctions: Sequence[Junction]) -> dict[str, Any]:
    """The mapping that `harness_of` takes, as plain numbers, lists and words."""
    return {
        "segments": {name: cable.as_dict() for name, cable in segments.items()},
        "junctions": [
            {
                "name": junction.name,
                "ends": list(junction.ends),
                "kind": junction.kind,
                "frames": {end: pose_entry(frame) for end, frame in junction.frames.items()},
                "mass": junction.mass,
            }
            for junction in junctions
        ],
    }


def write(entries: Mapping[str, Any], path: str | Path) -> None:
    """Writes what `as_dict` gives as YAML."""
    import yaml

    text = yaml.safe_dump(entries, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
    path_of(path, "harness").write_text(text, encoding="utf-8")


def _cable(name: object, value: Any, folder: Path) -> Cable:
    where = f"segments[{name!r}]"
    if isinstance(value, str):
        try:
            return Cable.from_yaml(folder / path_of(value, where))
        except ArgumentError as error:
            raise type(error)(f"{where}: {error}") from None
    return Cable.from_mapping(value, where)


def _junction(values: Any, i: int) -> Junction:
    where = f"junctions[{i}]"
    if not isinstance(values, Mapping):
        raise ArgumentError.of(where, values, "it must be a mapping", "Write {name: .., ends: [.., ..]}.")
    checks.known_keys(where, values, JUNCTION_KEYS)
    for key in ("name", "ends"):
        if key not in values:
            raise ArgumentError(f"{where}: the key {key!r} is missing. Add it.")
    frames = {} if values.get("frames") is None else values["frames"]
    if not isinstance(frames, Mapping):
        raise ArgumentError.of(f"{where}: frames", frames, "it must be a mapping", "Write {end: {quaternion: ..}}.")
    return Junction(
        values["name"],
        values["ends"],
        values.get("kind", "rigid"),
        {end: pose_of(f"{where}: frames[{shown(end)}]", pose) for end, pose in frames.items()},
        values.get("mass", 0.0),
    )


def pose_of(where: str, values: Any) -> Pose:
    """A frame from its keywords, by default the identity."""
    checks.known_keys(where, values, ("position", "quaternion"))
    try:
        return Pose(values.get("position", (0.0, 0.0, 0.0)), values.get("quaternion", (0.0, 0.0, 0.0, 1.0)))
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None
