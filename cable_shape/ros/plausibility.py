"""Input that can be used but is hardly meant: grips that jump or change places. Knows no ROS."""

from __future__ import annotations

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
    """Compares each pair of gripper poses with the one before.

    Parameters
    ----------
    topics : sequence of str
        Of the start and the end, named in the texts.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = topics
        self._before: tuple[Pose, Pose, int] | None = None

    def forget(self) -> None:
        """The next pair has none before it."""
        self._before = None

    def look(self, start: Pose, end: Pose, stamp: int) -> tuple[str, str] | None:
        """What is odd about this pair stamped `stamp` [ns]: a word for its kind, and a text; None if nothing is."""
        before, self._before = self._before, (start, end, stamp)
        if before is None or stamp <= before[2]:
            return None
        seconds = 1e-9 * (stamp - before[2])
        steps = (_distance(start, before[0]), _distance(end, before[1]))
        least = max(SHORTEST_JUMP, FASTEST * seconds)
        if max(steps) < least:
            return None
        chord = _distance(before[0], before[1])
        if max(_distance(start, before[1]), _distance(end, before[0])) < PLACE * chord and min(steps) > least:
            return "swap", (
                f"{' and '.join(self._topics)} have changed places: each is where the other was {seconds:.3f} s ago. "
                "The shape is that of a cable held the other way round. Look at the remappings of their publishers."
            )
        side = steps.index(max(steps))
        return f"{self._topics[side]} jump", (
            f"{self._topics[side]} jumped by {steps[side]:.3f} m within {seconds:.3f} s, at most {FASTEST:g} m/s is "
            "plausible: it is used as it is. Look for a tracker that lost its target, or lost messages."
        )


def _distance(a: Pose, b: Pose) -> float:
    """[m], between the origins."""
    return math.dist(a.array[:3].tolist(), b.array[:3].tolist())
