"""What the tests of replays share: one run, and what it wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Reader

import cable_shape as cs
from cable_shape.replay.bag_writer import cable_shape_store
from cable_shape.replay.outcome import Outcome, Settings
from cable_shape.replay.run import replay

CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
MODEL = "gradient4"


def run(bag: Path, out: Path, **options: Any) -> Outcome:
    given = {"cable": CABLE, "model": MODEL, "points": 60, "rrd": False, "picture": False, **options}
    return replay(bag, out, Settings(**given))


def messages(out: Path, topic: str) -> list[tuple[int, Any]]:
    """(log time, message) of one topic of OUT/replay."""
    store = cable_shape_store()
    with Reader(out / "replay") as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [(time, store.deserialize_cdr(raw, c.msgtype)) for c, time, raw in reader.messages(connections)]


def report_of(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "report.json").read_text())
    return found
