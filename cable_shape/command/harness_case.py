"""Cases of harnesses from YAML or JSON files, and what `cable-shape predict` gives of them.

The keys are those of a cable's case but for these::

    harness: fork.yaml                                    # or {segments: .., junctions: ..}
    ends:                                                 # those not named are free
      trunk.start: {position: [0, 0, 0], quaternion: [0, 0.7071, 0, 0.7071]}     # kind, offset may follow
      left.end: {position: [0.8, 0.1, 0.1], quaternion: [0, 0.7071, 0, 0.7071]}
      right.end: {mass: 0.02}
    distributed_load: {trunk: [[0, 0, -1], [0, 0, 0]]}    # by segment

A harness's own file is a case, too, if its `ends` say where they are held, or its `scene` has clips that hold it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.case_parts import end_of, scene_of
from cable_shape.cable.harness import Harness
from cable_shape.cable.harness_file import ENDS, HARNESS_KEYS
from cable_shape.command.case_output import COLUMNS, Row, _vector, check_suffix
from cable_shape.errors import ArgumentError
from cable_shape.files.files import finite, path_of
from cable_shape.pose import FreeEnd, Grip
from cable_shape.scene.scene import Scene
from cable_shape.solve.harness_shape import HarnessShape

OPTION_KEYS = ("model", "gravity", "points", "tolerance", "distributed_load")
CASE_KEYS = ("name", "harness", "ends", "scene", *OPTION_KEYS)
_ARRAYS = ("arc_length", "positions", "quaternions", "curvature", "force", "moment")


@final
@dataclass(frozen=True, slots=True)
class HarnessCase:
    """The arguments of one :func:`cable_shape.predict` of a harness, under a name."""

    name: str
    harness: Harness
    ends: Mapping[str, Grip | FreeEnd]
    scene: Scene | None
    options: Mapping[str, Any]

    def predict(self, **changes: Any) -> HarnessShape:
        """Solves it; `changes` replace options of the file."""
        from cable_shape.prediction.predictor import predict

        found: HarnessShape = predict(self.harness, self.ends, scene=self.scene, **{**self.options, **changes})
        return found


def harness_case_of(values: Mapping[str, Any], folder: Path, name: str) -> HarnessCase:
    """The case with these keys; relative paths are taken from `folder`."""

    if "harness" not in values:  # a harness's own file
        checks.known_keys("harness", values, HARNESS_KEYS)
        own = {key: values[key] for key in ("segments", "junctions") if key in values}
        values = {"harness": own, "ends": values.get(ENDS) or {}, "scene": values.get("scene")}
    checks.known_keys("case", values, CASE_KEYS)
    harness, ends = values["harness"], values.get("ends")
    if not isinstance(ends, Mapping):
        raise ArgumentError.of("ends", ends, "it must be a mapping", "Write a.start: {position: .., quaternion: ..}.")
    made = (
        Harness.from_yaml(folder / path_of(harness, "harness"))
        if isinstance(harness, str)
        else Harness.from_mapping(harness, folder=folder)
    )
    return HarnessCase(
        name=str(values.get("name") or name),
        harness=made,
        ends={str(end): end_of(f"ends.{end}", held) for end, held in ends.items()},
        scene=scene_of(values.get("scene"), folder),
        options={key: values[key] for key in OPTION_KEYS if values.get(key) is not None},
    )


def rows(case: HarnessCase, shape: HarnessShape) -> Iterator[Row]:
    """The figures of one shape in words."""
    yield "harness", f"{len(case.harness.segments)} segments, {case.harness.length:.4g} m in all"
    yield "model", shape.model
    yield "status", f"{shape.status.name}: {shape.detail or shape.status.remedy}"
    yield "error estimate", f"{shape.error_estimate:.3g} m"
    yield "iterations", str(shape.iterations)
    yield "solve time", f"{shape.solve_time * 1e6:.0f} µs"
    yield "energy", f"{shape.energy:.6g} J"
    for end, held in case.ends.items():
        if isinstance(held, Grip):
            name, _, side = end.rpartition(".")
            i, sign = (0, 1.0) if side == "start" else (-1, -1.0)
            yield f"force on the grip at {end}", _vector(sign * shape.segments[name].force[i], "N")
            yield f"moment on the grip at {end}", _vector(sign * shape.segments[name].moment[i], "N m")
    for name, pose in shape.junctions.items():
        yield f"junction {name}", _vector(pose.position, "m")
    for name, one in shape.segments.items():
        radius, tension = one.bend_radius.min(), one.tension.max()
        lowest = one.positions[:, 2].min()
        told = f"bend radius {radius:.4g} m, tension {tension:.4g} N, lowest z = {lowest:.4g} m"
        yield f"segment {name}", told


def as_dict(case: HarnessCase, shape: HarnessShape) -> dict[str, Any]:
    """The shape as plain values; infinite and undefined numbers as None."""
    return {
        "name": case.name,
        "harness": case.harness.as_dict(),
        "model": shape.model,
        "status": shape.status.name,
        "usable": shape.usable,
        "detail": shape.detail,
        "error_estimate": finite(shape.error_estimate),
        "iterations": shape.iterations,
        "solve_time": shape.solve_time,
        "energy": finite(shape.energy),
        "junctions": {
            name: {"position": pose.position.tolist(), "quaternion": pose.quaternion.tolist()}
            for name, pose in shape.junctions.items()
        },
        "segments": {
            name: {array: getattr(one, array).tolist() for array in _ARRAYS} for name, one in shape.segments.items()
        },
    }


def write(case: HarnessCase, shape: HarnessShape, path: Path) -> None:
    """Writes the shape to `path`: JSON, or CSV with the number of the segment in the first column."""
    kind = check_suffix(path).suffix.lower()
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == ".json":
        path.write_text(json.dumps(as_dict(case, shape), indent=1, allow_nan=False) + "\n", encoding="utf-8")
        return
    if kind == ".png":
        from cable_shape.command.harness_picture import draw

        draw(case, shape, path)
        return
    if kind == ".rrd":
        from cable_shape.command.recorded import record

        record(path, {case.name: case.harness}, {case.name: case.ends}, case.scene)
        return
    parts = []
    for i, one in enumerate(shape.segments.values()):
        arrays = [getattr(one, array).reshape(one.points, -1) for array in _ARRAYS]
        parts.append(np.concatenate((np.full((one.points, 1), float(i)), *arrays), axis=1))
    header = ",".join(("segment", *COLUMNS))
    np.savetxt(path, np.concatenate(parts), fmt="%.12g", delimiter=",", header=header, comments="")
