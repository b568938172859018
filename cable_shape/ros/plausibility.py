"""Input that can be used but is hardly meant: grips that jump or change places. Knows no ROS."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import final

from cable_shape.pose import Pose

#: Faster than any gripper moves [m/s].
FASTEST = 10.0

#: Shorter steps are noise [m].
SHORTEST_JUMP = 0.1

#: Grips changed places if each is within this part of their distance from where the other was.
PLACE = 0.25


@final
class JumpWatch:
    """Compares the poses of the grippers of each cycle with those of the one before.

    Parameters
    ----------
    topics : sequence of str
        Of each gripper, named in the texts.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = topics
        self._before: tuple[Sequence[Pose], int] | None = None

    def forget(self) -> None:
        """The next poses have none before them."""
        self._before = None

    def look(self, poses: Sequence[Pose], stamp: int) -> tuple[str, str] | None:
        """What is odd about these poses stamped `stamp` [ns]: a word for its kind, and a text; None if nothing is."""
        last, self._before = self._before, (poses, stamp)
        if last is None or stamp <= last[1]:
            return None
        before, seconds = last[0], 1e-9 * (stamp - last[1])
        steps = [_distance(pose, was) for pose, was in zip(poses, before, strict=True)]
        least = max(SHORTEST_JUMP, FASTEST * seconds)
        if max(steps) < least:
            return None
        for i, j in itertools.combinations(range(len(poses)), 2):
            off = max(_distance(poses[i], before[j]), _distance(poses[j], before[i]))
            if off < PLACE * _distance(before[i], before[j]) and min(steps[i], steps[j]) > least:
                return "swap", (
                    f"{self._topics[i]} and {self._topics[j]} have changed places: each is where the other was "
                    f"{seconds:.3f} s ago. The shape is that of a cable held the other way round. Look at the "
                    "remappings of their publishers."
                )
        side = steps.index(max(steps))
        return f"{self._topics[side]} jump", (
            f"{self._topics[side]} jumped by {steps[side]:.3f} m within {seconds:.3f} s, at most {FASTEST:g} m/s is "
            "plausible: it is used as it is. Look for a tracker that lost its target, or lost messages."
        )


def _distance(a: Pose, b: Pose) -> float:
    """[m], between the origins."""
    return math.dist(a.array[:3].tolist(), b.array[:3].tolist())
