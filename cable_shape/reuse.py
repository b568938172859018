"""When the last shape may be given again: neither ends nor links have moved enough to change it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cable_shape.checks import Array
from cable_shape.kernels.poses import moved
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.problem import Problem

#: The last shape is given again while the ends have moved by less than this fraction of `tolerance`, rotations counted
#: as length x angle. Down to the slack below a shape moves by at most 100 times as much as its ends.
REUSE_FRACTION = 0.01
#: Of a cable with less slack than this fraction of its length only the very same ends give the last shape again: its
#: sag changes by 0.31 / sqrt(slack) of what its ends move.
REUSE_SLACK = 2e-5

Ends = tuple[Grip, Grip | FreeEnd]
Links = Mapping[str, Pose] | None


def unmoved(ends: Ends | None, links: Links, problem: Problem) -> bool:
    """Whether ends and links are too near to the last `ends` and `links` to change the answer by its tolerance."""
    if ends is None:
        return False
    start, end = ends
    length = problem.cable.length
    if _further(end, problem.end, REUSE_FRACTION * problem.tolerance):
        return False
    way = _moved(start, problem.start, length) + _moved(end, problem.end, length)
    way += _links_moved(links, problem, length)
    if way == 0.0:
        return True
    return way < REUSE_FRACTION * problem.tolerance and not _taut(problem)


def _taut(problem: Problem) -> bool:
    """Whether an end is nearly as far from the other, or the next clip, as the cable between is long, or further."""
    clips, end, length = problem.clips, problem.end, problem.cable.length
    start = problem.start.cable_frame.position
    if clips and _stretched(clips[0].pose.position - start, clips[0].arc_length):
        return True
    if not isinstance(end, Grip):
        return False
    near, arc = (clips[-1].pose.position, clips[-1].arc_length) if clips else (start, 0.0)
    return _stretched(end.cable_frame.position - near, length - arc)


def _stretched(chord: Array, length: float) -> bool:
    """Whether a chord (3,) leaves a cable of this length hardly any slack."""
    return math.sqrt(float(chord @ chord)) > (1.0 - REUSE_SLACK) * length


def _further(before: Grip | FreeEnd, now: Grip | FreeEnd, distance: float) -> bool:
    """Whether an end has moved along an axis by more than a distance [m]: a quick look, which may say no."""
    if type(before) is not Grip or type(now) is not Grip:
        return False
    a, b = before.cable_frame.array, now.cable_frame.array
    return bool(abs(a[0] - b[0]) > distance or abs(a[1] - b[1]) > distance or abs(a[2] - b[2]) > distance)


def _moved(before: Grip | FreeEnd, now: Grip | FreeEnd, length: float) -> float:
    """[m], how far an end moved: distance plus length times angle; infinite if it is held in another way."""
    if before is now:
        return 0.0
    if type(before) is not Grip or type(now) is not Grip:
        return math.inf
    if before.kind != now.kind:
        return math.inf
    if before.curvature is not now.curvature and before.curvature.tobytes() != now.curvature.tobytes():
        return math.inf
    if before.cable_frame.turns != now.cable_frame.turns:
        return math.inf
    return float(moved(before.cable_frame.array, now.cable_frame.array, length))


def _links_moved(before: Links, problem: Problem, length: float) -> float:
    """[m], how far the links moved that carry bodies, as `_moved`; infinite if they are known or unknown only now."""
    links = problem.links
    if links is before or not problem.bodies:
        return 0.0
    if links is None or before is None:
        return math.inf
    largest = 0.0
    for body in problem.bodies:
        if body.link is not None and body.link in links and body.link in before:
            largest = max(largest, float(moved(before[body.link].array, links[body.link].array, length)))
    return largest
