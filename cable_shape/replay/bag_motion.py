"""A recording as the motion of a study: :func:`motion_of_bag`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, BagError, StaleInputError
from cable_shape.messages.pairing import SECOND, Pairing, StampGuard
from cable_shape.pose import Pose
from cable_shape.replay.bags import Bag
from cable_shape.replay.inputs import other_frame, stamp_of

#: Where the poses of a cable's grips are, if nothing is told; "joints" in place of ends: of a robot.
TOPICS = {"start": "/left_gripper/pose", "end": "/right_gripper/pose"}
JOINTS = "joints"
_KINDS = {False: "geometry_msgs/msg/PoseStamped", True: "sensor_msgs/msg/JointState"}


def motion_of_bag(path: str | Path, topics: Mapping[str, str] | None = None, max_skew: float = 0.02) -> dict[str, Any]:
    """The key `motion` of a study that moves as a recording did.

    Parameters
    ----------
    path : path of a rosbag2 folder, or of one .mcap or .db3 file
    topics : mapping of an end to a topic, optional
        Of PoseStamped: "start" and "end", or one of them, of a cable, "SEGMENT.start" and so on of a harness. Or
        {"joints": topic} of JointState. Default: /left_gripper/pose and /right_gripper/pose.
    max_skew : float
        [s], poses further apart are not paired, by the rule of the node.

    Raises
    ------
    BagError
        If it cannot be read, lacks a topic, or nothing on it can be used; it says what was recorded.
    """
    given = checks.mapping("motion.topics", topics, topics or (), "Write {start: /left_gripper/pose}.") or TOPICS
    joints = JOINTS in given
    if joints and len(given) > 1:
        raise ArgumentError.of("motion.topics", dict(given), "joints move all ends", "Name joints, or ends.")
    skew = checks.number("motion.max_skew", max_skew, at_least=0.0, unit="s")
    with Bag(path) as bag:
        for topic in given.values():
            if bag.types.get(topic) != _KINDS[joints]:
                found = ", ".join(f"{name} ({kind})" for name, kind in sorted(bag.types.items())) or "none"
                bound = f"motion.bag: {path} has no topic {topic} of {_KINDS[joints]}. Topics found: {found}."
                raise BagError(f"{bound} Name another in motion.topics.")
        read = _joints(bag, given[JOINTS]) if joints else _poses(bag, given, skew)
    stamps = read.pop("stamps")
    if not len(stamps):
        why = "; ".join(bag.problems) or f"no two poses are within {skew:g} s of each other"
        raise BagError(
            f"motion.bag: {path} has nothing that can be used ({why}). Raise max_skew, or name other topics."
        )
    if len(stamps) > 1:
        read["times"] = 1e-9 * (stamps - stamps[0])
    return read


def _poses(bag: Bag, topics: Mapping[str, str], skew: float) -> dict[str, Any]:
    """Stamps [ns], and the poses (k, 7) of every end."""
    sides = {topic: i for i, topic in enumerate(topics.values())}
    guards = [StampGuard(topic) for topic in sides]
    pairing: Pairing[Array] = Pairing(round(skew * SECOND), len(sides))
    frame: str | None = None
    stamps: list[int] = []
    rows: list[tuple[Array, ...]] = []
    for topic, _, message in bag.messages(list(sides)):
        frame = message.header.frame_id if frame is None else frame
        if message.header.frame_id != frame:
            raise BagError(f"motion.bag: {other_frame(topic, message.header.frame_id, frame)}")
        if not _newer(guards[sides[topic]], message):
            continue
        p, q = message.pose.position, message.pose.orientation
        try:
            pose = Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)).array
        except ArgumentError:
            continue
        pair = pairing.put(sides[topic], stamp_of(message), pose)
        if pair is not None and (not stamps or pair.stamp > stamps[-1]):
            stamps.append(pair.stamp)
            rows.append(pair.values)
    tables = {end: np.array([row[i] for row in rows]) for i, end in enumerate(topics)}
    ends = tables if set(tables) <= set(TOPICS) else {"ends": tables}
    return {**ends, "stamps": np.array(stamps)}


def _joints(bag: Bag, topic: str) -> dict[str, Any]:
    """Stamps [ns], and the joints' names and positions (k, j): those of the first message."""
    guard = StampGuard(topic)
    names: list[str] = []
    stamps: list[int] = []
    rows: list[list[float]] = []
    for _, _, message in bag.messages([topic]):
        here = dict(zip(message.name, np.asarray(message.position, dtype=np.float64).tolist(), strict=False))
        names = names or list(here)
        if _newer(guard, message) and all(np.isfinite(here.get(name, np.nan)) for name in names):
            stamps.append(stamp_of(message))
            rows.append([here[name] for name in names])
    return {"joints": {"names": names, "positions": np.array(rows)}, "stamps": np.array(stamps)}


def _newer(guard: StampGuard, message: Any) -> bool:
    """Whether a message is newer than the last one.

    Raises
    ------
    BagError
        Where the clock was set back: these are two motions.
    """
    try:
        restarted = guard.check(stamp_of(message))
    except StaleInputError:
        return False
    if restarted:
        raise BagError(f"motion.bag: {guard.topic}: the clock was set back. Cut the recording into its motions.")
    return True
