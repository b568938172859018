"""What `cable-shape import` writes: files of a folder that appear all at once, or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.centreline import Centreline
from cable_shape.cable.harness import Harness
from cable_shape.cable.imported import Imported
from cable_shape.errors import ArgumentError
from cable_shape.files.files import YAML_BYTES, path_of
from cable_shape.pose import FreeEnd, Grip, pose_entry
from cable_shape.scene.scene_files import clip_entry, mass_entry

_SAME = Cable(1.0, 1.0, 1.0).as_dict()
_DIGITS = 9


def put(folder: str | Path, files: Mapping[str, str]) -> Path:
    """Writes texts by file names into a folder, all of them or none; a folder that is there keeps its other files.

    Raises
    ------
    ArgumentError
        Where something that is no folder has its name.
    """
    place = path_of(folder, "output folder")
    for name, text in files.items():
        if name.endswith(".yaml") and len(text.encode()) > YAML_BYTES:
            remedy = "Merge short segments (--merge-below), or use it from Python."
            bound = f"more than the {YAML_BYTES} bytes that are read back"
            raise ArgumentError.of(name, f"{len(text.encode())} bytes", bound, remedy)
    if place.exists() and not place.is_dir():
        raise ArgumentError.of("-o", str(place), "something that is no folder is there", "Name another folder.")
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{place.name}-", dir=place.parent) as temporary:
        made = Path(temporary) / "made"
        made.mkdir()
        for name, text in files.items():
            (made / name).write_text(text, encoding="utf-8")
        if place.exists():
            for name in files:
                os.replace(made / name, place / name)
        else:
            made.rename(place)
    return place


def harness_text(harness: Harness) -> str:
    """The YAML of an imported harness: segments, junctions, how it is held, its scene; a segment a line."""
    made: Any = harness.imported or Imported("")
    lines = [f"# Imported from {made.source}; what was derived and left out: import.md", "segments:"]
    lines += [f"  {json.dumps(name)}: {_flow(cable_entry(cable))}" for name, cable in harness.segments.items()]
    lines.append("junctions:" if harness.junctions else "junctions: []")
    lines += [f"  - {_flow(junction)}" for junction in harness.as_dict()["junctions"]]
    lines.append("ends:" if made.ends else "ends: {}")
    lines += [f"  {json.dumps(end)}: {_flow(end_entry(held))}" for end, held in made.ends.items()]
    lines.append("scene:")
    for key, entries in (("clips", map(clip_entry, made.clips)), ("masses", map(mass_entry, made.masses))):
        rows = [f"    - {_flow(entry)}" for entry in entries]
        lines += [f"  {key}:", *rows] if rows else [f"  {key}: []"]
    return "\n".join(lines) + "\n"


def cable_text(cable: Cable, source: str) -> str:
    """The YAML of an imported cable."""
    rows = [f"{key}: {_flow(value)}" for key, value in cable_entry(cable).items()]
    return "\n".join([f"# Imported from {source}", *rows]) + "\n"


def cable_entry(cable: Cable) -> dict[str, Any]:
    """Its keywords, but for those that have their defaults."""
    told = {key: value for key, value in cable.as_dict().items() if key not in _SAME or value != _SAME[key]}
    return {**told, **{key: getattr(cable, key) for key in ("length", "linear_density", "diameter")}}


def end_entry(held: Grip | FreeEnd) -> dict[str, Any]:
    """How an end is held, as an entry of `ends`."""
    if isinstance(held, FreeEnd):
        return {"mass": held.mass}
    kind = {} if held.kind == "clamped" else {"kind": held.kind}
    return {**pose_entry(held.pose), **kind}


def _flow(value: Any) -> str:
    """On one line, which is YAML and JSON; numbers to nine digits."""
    return json.dumps(_rounded(value), allow_nan=False, ensure_ascii=False)


def _rounded(value: Any) -> Any:
    if isinstance(value, (float, np.floating)):
        return float(f"{float(value):.{_DIGITS}g}")
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    return [_rounded(one) for one in value] if isinstance(value, (list, tuple)) else value


def report_text(harness: Harness) -> str:
    """What became of the file, in words: a page."""
    made: Any = harness.imported
    joints = [len(junction.ends) for junction in harness.junctions]
    head = [
        f"# {made.source}", "",
        f"{len(harness.segments)} segments, {harness.length:.6f} m; {sum(n > 2 for n in joints)} junctions, "
        f"{sum(n == 2 for n in joints)} inliners, {len(harness.open_ends)} open ends; {len(made.clips)} clips; "
        f"wires {made.wire_mass:.6f} kg.",
    ]  # fmt: skip
    for title, items in (
        ("Derived, not in the file", made.derived), ("Merged", made.merged), ("Left out", made.left_out),
        ("Remarks", made.remarks),
    ):  # fmt: skip
        head += ["", f"## {title}", "", *([f"- {item}" for item in items] or ["Nothing."])]
    return "\n".join(head) + "\n"


def case_text(line: Centreline) -> str:
    """A case of `cable-shape predict`: the cable beside it, clamped at both ends as it was drawn."""
    rows = [f"{side}: {_flow(pose_entry(pose))}" for side, pose in (("start", line.start), ("end", line.end))]
    return "\n".join(["# As it was drawn. Move an end, and it bends.", "cable: cable.yaml", *rows]) + "\n"
