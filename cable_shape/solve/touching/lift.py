"""Cables held elsewhere: those that lie over others higher, from where they are let down, or on the way."""

from __future__ import annotations

from collections.abc import Sequence

from cable_shape.checks import Array
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.pile import carried_of
from cable_shape.solve.touching.places import Spot


def levels(spots: Sequence[Spot], down: Array) -> dict[int, int]:
    """For each cable of these spots how many lie below it at most; none at all where no order tells.

    That is where a cable touches itself, or each of two lies over the other, directly or not.
    """
    over = set()
    for spot in spots:
        first, second = spot.cables
        over.add((first, second) if float(spot.normal @ down) < 0.0 else (second, first))
    out = dict.fromkeys({cable for pair in over for cable in pair}, 0)
    for _ in out:
        before = dict(out)
        for upper, lower in over:
            out[upper] = max(out[upper], out[lower] + 1)
        if out == before:
            return out
    return {}


def lifted(grip: Grip, way: Array) -> Grip:
    """The grip, moved by `way` (3,) [m]."""
    pose = grip.pose
    return grip.at(Pose(pose.position + way, pose.quaternion))


def held_at(problems: Sequence[Problem], frames: Array) -> None:
    """Moves the ends of cables, and links, to where `frames` has them: see `all_frames`."""
    links = dict(zip(carried_of(problems), map(Pose.trusted, frames[2 * len(problems) :]), strict=False))
    for i, problem in enumerate(problems):
        start, end = (_at(grip, row) for grip, row in zip((problem.start, problem.end), frames[2 * i :], strict=False))
        assert isinstance(start, Grip)
        problem.move(start, end, None if problem.links is None else {**problem.links, **links})


def _at(grip: Grip | FreeEnd, frame: Array) -> Grip | FreeEnd:
    """The grip where it holds its cable by this frame (7,)."""
    if not isinstance(grip, Grip):
        return grip
    return grip.at(Pose.trusted(frame, grip.pose.turns) * grip.offset.inverse())
