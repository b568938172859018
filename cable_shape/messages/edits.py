"""Edits and scenes as the fields of CableEdit and CableScene: what the node is told, and what a recording tells.

Texts are written as JSON, whose numbers give back the same bits, and read as YAML, of which that is a part.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from cable_shape.cable.cable import Cable
from cable_shape.errors import ArgumentError
from cable_shape.files.files import YAML_BYTES
from cable_shape.files.yaml_files import read_strictly
from cable_shape.messages.fields import FARTHEST
from cable_shape.pose import Pose
from cable_shape.prediction.edits import Add, Edit, Insert, Move, Open, Regrip, Release, Remove, SetCable
from cable_shape.prediction.layout import Layout
from cable_shape.scene.scene import Clip, Obstacle, PointMass
from cable_shape.scene.scene_files import clip_entry, clip_of, mass_entry, obstacle_entry, part_of

#: CableEdit.kind
KINDS: dict[int, type] = dict(enumerate((Add, Remove, Move, Insert, Release, Regrip, Open, SetCable)))
_NUMBERS = {kind: number for number, kind in KINDS.items()}
_OPENED = ("", "end", "start")
_WORDS = "0 ADD, 1 REMOVE, 2 MOVE, 3 INSERT, 4 RELEASE, 5 REGRIP, 6 OPEN, 7 SET_CABLE"

MOST_EDITS = 1000  # of one request


def edits_of(messages: Sequence[Any]) -> list[Edit]:
    """What CableEdit messages say, whichever library made them.

    Raises
    ------
    ArgumentError
        Naming the number of the edit, the field, the value, the bound and the remedy.
    """
    if not 0 < len(messages) <= MOST_EDITS:
        bound = f"there must be 1 to {MOST_EDITS}"
        raise ArgumentError.of("edits", f"{len(messages)} edits", bound, "Send them in several requests.")
    out = []
    for i, message in enumerate(messages):
        try:
            out.append(_edit_of(message))
        except ArgumentError as error:  # of files, too
            raise ArgumentError(f"edits[{i}]: {error}") from None
    return out


def _edit_of(message: Any) -> Edit:
    kind = KINDS.get(int(message.kind))
    if kind is None:
        raise ArgumentError.of("kind", int(message.kind), "no such kind", f"Known: {_WORDS}.")
    if kind in (Remove, Release):
        return kind(message.name)
    if kind is Move:
        p, q = message.pose.position, message.pose.orientation
        return Move(message.name, _near(Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))))
    if kind is Regrip:
        return Regrip(message.end, float(message.arc_length))
    if kind is Open:
        return Open(message.end)
    if kind is SetCable:
        return SetCable(Cable.from_mapping(_read(message.part), "part"))
    part = (clip_of if kind is Insert else part_of)(_read(message.part), "part")
    if not isinstance(part, PointMass):
        _near(part.pose)
    return kind(part)  # type: ignore[no-any-return]


def _read(text: str) -> dict[str, Any]:
    """The mapping in a text."""
    size = len(text.encode("utf-8", "replace"))
    if size > YAML_BYTES:
        raise ArgumentError.of(
            "part", f"{size} bytes", f"at most {YAML_BYTES} are read", "Leave out what is not needed."
        )
    values = read_strictly(text, "part")
    if not isinstance(values, dict):
        bound = "it must be a mapping of keys to values"
        raise ArgumentError.of("part", type(values).__name__, bound, "Write for example {name: post, sphere: 0.03}.")
    return values


def _near(pose: Pose) -> Pose:
    """The pose, if it is within reach."""
    if abs(pose.position).max() > FARTHEST:
        bound = f"every entry must be within {FARTHEST:g} m of the frame's origin"
        raise ArgumentError.of("position", pose.position.tolist(), bound, "Give it in m, in the frame of the input.")
    return pose


def edit_fields(edit: Edit) -> dict[str, Any]:
    """The fields of a CableEdit that says this; its `pose` as a Pose, where it has one."""
    fields: dict[str, Any] = {"kind": _NUMBERS[type(edit)]}
    if isinstance(edit, (Remove, Release)):
        return {**fields, "name": edit.name}
    if isinstance(edit, Move):
        return {**fields, "name": edit.name, "pose": edit.pose}
    if isinstance(edit, Regrip):
        return {**fields, "end": edit.end, "arc_length": edit.arc_length}
    if isinstance(edit, Open):
        return {**fields, "end": edit.end}
    if isinstance(edit, SetCable):
        return {**fields, "part": _text(edit.cable.as_dict())}
    part = edit.clip if isinstance(edit, Insert) else edit.part
    return {**fields, "part": _text(_entry(part))}


def scene_fields(layout: Layout) -> dict[str, Any]:
    """All fields of CableScene but the header and the number."""
    held = layout.cables.values()
    return {
        "scene": _text(layout.common.as_dict()),
        "cable_ids": list(layout.cables),
        "cables": [_text(one.made.as_dict()) for one in held],
        "starts": [float(one.first) for one in held],
        "ends": [float(one.last) for one in held],
        "opened": [_OPENED.index(one.opened) for one in held],
        "clips": [_text([clip_entry(clip) for clip in one.clips]) for one in held],
        "masses": [_text([mass_entry(mass) for mass in one.masses]) for one in held],
    }


def _entry(part: Obstacle | Clip | PointMass) -> dict[str, Any]:
    if isinstance(part, Obstacle):
        return obstacle_entry(part)
    return clip_entry(part) if isinstance(part, Clip) else mass_entry(part)


def _text(values: Any) -> str:
    return json.dumps(values, allow_nan=False)
