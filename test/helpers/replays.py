"""What the tests of replays share: one run, and what it wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from recordings import ALONG_X, BEGIN, LEFT, PERIOD, RIGHT, Entry, markers_entry, pose_entry, write_bag
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.replay.bag_writer import cable_shape_store
from cable_shape.replay.outcome import Outcome
from cable_shape.replay.run import replay
from cable_shape.replay.settings import Settings

CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, diameter=0.008)
MODEL = "gradient4"
START, END = np.array((0.0, 0.0, 0.5)), np.array((0.8, 0.0, 0.5))
PUSH = np.array((0.0, 3.0, 0.0))  # m/s^2, sideways: the whole cable hangs aslant
FRAMES = 40
TRUE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
#: Where the cable lies in the frames that the grippers' trackers tell.
MOUNTS = (
    cs.Pose((0.002, -0.004, 0.003), Rotation.from_rotvec((0.06, -0.09, 0.0)).as_quat()),
    cs.Pose((-0.003, 0.002, 0.0), Rotation.from_rotvec((-0.05, 0.07, 0.0)).as_quat()),
)


def pushed(frames: int = FRAMES, hidden: int | None = None, frame: str = "world", begin: int = BEGIN) -> list[Entry]:
    """Both grips and the cable accelerate as one; of the frame `hidden` one marker is not seen."""
    ends = cs.Pose(START, ALONG_X), cs.Pose(END, ALONG_X)
    aslant = cs.predict(CABLE, *ends, model="cosserat", acceleration=PUSH, points=201).positions[::20]
    entries = []
    for k in range(frames):
        stamp, way = begin + k * PERIOD, 0.5 * PUSH * (1e-9 * k * PERIOD) ** 2
        seen = aslant + way
        if k == hidden:
            seen[4] = np.nan
        entries += [pose_entry(LEFT, stamp, START + way), pose_entry(RIGHT, stamp, END + way)]
        entries.append(markers_entry(stamp, seen, frame))
    return entries


def mounted(seed: int, count: int, end_kind: str = "swivel") -> list[cs.Observation]:
    """Points of the true cable, held where the mounts say, with the poses of the trackers."""
    rng, along_x = np.random.default_rng(seed), Rotation.from_quat(ALONG_X)
    out: list[cs.Observation] = []
    while len(out) < count:
        turns = (Rotation.from_rotvec(0.3 * rng.normal(size=3)) * along_x for _ in range(2))
        start, end = cs.Pose((0, 0, 0), next(turns).as_quat()), cs.Pose((0, 0, 0), next(turns).as_quat())
        end = cs.Pose(np.array((0.7, 0.0, 0.0)) + 0.08 * rng.normal(size=3), end.quaternion)
        held = cs.Grip(start, offset=MOUNTS[0]), cs.Grip(end, end_kind, MOUNTS[1])
        shape = cs.predict(TRUE, *held, model="cosserat", points=301)
        if shape.status is cs.Status.OK:
            points = shape.positions[10:-10:14] + 5e-5 * rng.normal(size=(21, 3))
            out.append(cs.Observation(cs.Grip(start), cs.Grip(end, end_kind), points))
    return out


def bag_of(folder: Path, seen: list[cs.Observation], tool: cs.Pose | None = None) -> Path:
    """A look a second; with `tool`, the cable frame in the tool frame, the poses are those of tools."""
    entries = []
    for k, one in enumerate(seen):
        assert isinstance(one.end, cs.Grip)
        stamp, ends = BEGIN + k * 100 * PERIOD, [one.start.pose, one.end.pose]
        if tool is not None:
            ends = [end * tool.inverse() for end in ends]
        entries += [pose_entry(t, stamp, p.position, p.quaternion) for t, p in zip((LEFT, RIGHT), ends, strict=True)]
        entries.append(markers_entry(stamp, [one.start.pose.position, *one.points, one.end.pose.position]))
    return write_bag(folder, entries)


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
