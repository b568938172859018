"""When the last shape is given again: neither ends nor links have moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.solve.problem import Problem

if TYPE_CHECKING:
    from cable_shape.solve.harness_problem import HarnessProblem

Ends = tuple[Grip, Grip | FreeEnd]
Links = Mapping[str, Pose] | None


def kept(links: Links) -> Links:
    """Where links are, whatever becomes of the mapping that was given."""
    return None if links is None else dict(links)


def unmoved(ends: Ends | None, links: Links, problem: Problem) -> bool:
    """Whether the problem's ends and links are `ends` and `links`, those of the last shape, to the bit."""
    if ends is None:
        return False
    start, end = ends
    return same_end(end, problem.end) and same_end(start, problem.start) and links_same(links, problem)


def same_end(before: Grip | FreeEnd, now: Grip | FreeEnd) -> bool:
    """Whether an end is held in the same way at the same place."""
    if before is now:
        return True
    if type(before) is not Grip or type(now) is not Grip:
        return False
    return (
        _same_place(before.cable_frame, now.cable_frame)
        and before.kind == now.kind
        and before.cable_frame.turns == now.cable_frame.turns
        and (before.curvature is now.curvature or before.curvature.tobytes() == now.curvature.tobytes())
    )


def same_ends(before: Mapping[str, Grip | FreeEnd], now: Mapping[str, Grip | FreeEnd]) -> bool:
    """Whether all ends of a harness are held in the same way at the same places."""
    for name, end in now.items():  # `all` of a generator takes twice as long  # noqa: SIM110
        if not same_end(before[name], end):
            return False
    return True


def _same_place(before: Pose, now: Pose) -> bool:
    """Whether two poses are the same, turns apart; a quaternion and its negative are."""
    a, b = before.array, now.array
    if a[0] != b[0]:  # most often they are not
        return False
    if not (a[:3] == b[:3]).all():
        return False
    return bool((a[3:] == b[3:]).all() or (a[3:] == -b[3:]).all())


def links_same(before: Links, problem: Problem | HarnessProblem) -> bool:
    """Whether the links that carry bodies or clips are where they were."""
    links = problem.links
    if not problem.carried:
        return True
    if links is None or before is None:
        return links is before
    return all(_same_place(before[name], links[name]) for name in problem.carried if name in links and name in before)
