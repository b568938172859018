"""Requests to the planner as arguments of `predict_batch` and `check_trajectory`, within the limits of the node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.messages.edits import edits_of
from cable_shape.planning.paths import EndsPath, GripPath, JointPath
from cable_shape.pose import FreeEnd
from cable_shape.prediction.edits import Edit
from cable_shape.ros.workers import PlannerSetup
from cable_shape.solve.problem import MAX_POINTS, MIN_POINTS

#: Grasps times points of one request: 400 MB while it is worked on.
MOST_POINTS = 3_000_000
_NOTHING: Mapping[str, FreeEnd] = MappingProxyType({})
_ARRAYS = 0b11111  # all values of PredictShapes.arrays


class Grasps(NamedTuple):
    """What PredictShapes asks for."""

    starts: Array  # (k, 7); of a harness (k, 7 g), all its held ends
    ends: Array  # (k, 7); of a harness empty
    points: int
    tolerance: float | None  # m
    time_limit: float  # s


class Motion(NamedTuple):
    """What CheckTrajectory asks for."""

    path: JointPath | GripPath | EndsPath
    edits: Mapping[int, tuple[Edit, ...]]  # by the waypoint that comes next
    points: int
    tolerance: float | None  # m
    time_limit: float  # s


def grasps(request: Any, setup: PlannerSetup, held: Sequence[str] = (), segments: int = 1) -> Grasps:
    """A request of PredictShapes; held: the ends of a harness that grippers hold.

    Raises
    ------
    ArgumentError
        For arrays that are no rows of seven, more rows or points than are allowed, a tolerance or time that is none.
    """
    starts, ends = _both(request, setup, held)
    points, tolerance, time_limit = _common(request, setup)
    if len(starts) * points * segments > MOST_POINTS:
        bound = f"grasps times points = {len(starts)} * {points * segments}, at most {MOST_POINTS} are allowed"
        raise ArgumentError.of("starts", f"{len(starts)} rows", bound, "Split them, or ask for fewer points.")
    if request.arrays & ~_ARRAYS:
        bound = f"it must be a sum of the constants of PredictShapes, at most {_ARRAYS}"
        raise ArgumentError.of("arrays", request.arrays, bound, "For example POSITIONS = 1.")
    return Grasps(starts, ends, points, tolerance, time_limit)


def motion(
    request: Any, setup: PlannerSetup, held: Sequence[str] = (), free: Mapping[str, FreeEnd] = _NOTHING
) -> Motion:
    """A goal of CheckTrajectory; held, free: ends of a harness.

    Raises
    ------
    ArgumentError
        As above, and for joints and poses at once or none of both, edits of a harness or of no place, and whatever the
        paths refuse.
    """
    given = request.trajectory
    joints, poses = bool(given.points or given.joint_names), bool(request.starts or request.ends or request.times)
    if joints == poses:
        bound = "give either trajectory or starts and ends"
        raise ArgumentError.of("goal", "both" if joints else "neither", bound, "Leave the other one empty.")
    path: JointPath | GripPath | EndsPath
    if joints:
        _few("trajectory.points", len(given.points), setup.rows)
        path = JointPath.from_message(given)
    else:
        starts, ends = _both(request, setup, held)
        times = np.array(request.times) if request.times else None
        if held:
            path = EndsPath({**by_end(starts, held), **free}, times)
        else:
            path = GripPath(starts, ends, times)
    waypoints = len(given.points) if joints else len(starts)
    return Motion(path, _edits(request, waypoints, bool(held)), *_common(request, setup))


def _edits(request: Any, waypoints: int, harness: bool) -> Mapping[int, tuple[Edit, ...]]:
    """The edits of a goal on a path of so many waypoints, by the waypoint that comes next."""
    places = [int(place) for place in request.before]
    if len(places) != len(request.edits):
        bound = f"there are {len(request.edits)} edits"
        raise ArgumentError.of("before", f"{len(places)} numbers", bound, "Give the next waypoint of each.")
    if not places:
        return {}
    if harness:
        raise ArgumentError.of("edits", f"{len(places)} edits", "those on the way are of one cable", "Leave them out.")
    if sorted(places) != places or places[0] < 1 or places[-1] > waypoints:
        bound = f"they must be 1 to {waypoints}, the number of waypoints, and never fall"
        raise ArgumentError.of("before", places, bound, "Give the number of the waypoint that comes next.")
    out: dict[int, tuple[Edit, ...]] = {}
    for place, edit in zip(places, edits_of(request.edits), strict=True):
        out[place] = (*out.get(place, ()), edit)
    return out


def _common(request: Any, setup: PlannerSetup) -> tuple[int, float | None, float]:
    """Points, tolerance [m] and time limit [s]: those of the node where the request says 0."""
    tolerance = checks.number("tolerance", request.tolerance, at_least=0.0, unit="m") or setup.tolerance
    time_limit = checks.number("time_limit", request.time_limit, at_least=0.0, unit="s") or setup.time_limit
    points = checks.integer("points", request.points or setup.points, at_least=MIN_POINTS, at_most=MAX_POINTS)
    return points, tolerance or None, min(time_limit, setup.time_limit)


def by_end(poses: Array, held: Sequence[str]) -> dict[str, Array]:
    """Tables (k, 7) of each held end, from rows of all of them (k, 7 g)."""
    return {end: np.ascontiguousarray(poses[:, 7 * i : 7 * i + 7]) for i, end in enumerate(held)}


def _both(request: Any, setup: PlannerSetup, held: Sequence[str]) -> tuple[Array, Array]:
    """`starts` and `ends` of a request; of a harness all poses are in `starts`."""
    if not held:
        return _poses("starts", request.starts, setup.rows), _poses("ends", request.ends, setup.rows)
    if request.ends:
        bound = f"of a harness the poses of all held ends, {', '.join(held)}, are in starts, row by row"
        raise ArgumentError.of("ends", f"{len(request.ends)} numbers", bound, "Leave it empty.")
    return _poses("starts", request.starts, setup.rows, len(held)), np.empty((0, 7))


def _poses(name: str, numbers: Any, most: int, each: int = 1) -> Array:
    """(k, 7 each) of a flat array."""
    rows, rest = divmod(len(numbers), 7 * each)
    if rest or not rows:
        many = "seven" if each == 1 else f"{each} times seven"
        bound = f"it must hold {many} numbers for every grasp or waypoint, and at least one"
        raise ArgumentError.of(name, f"{len(numbers)} numbers", bound, "Give x y z and quaternion x y z w, row by row.")
    _few(name, rows, most)
    return np.array(numbers, dtype=np.float64).reshape(rows, 7 * each)


def _few(name: str, rows: int, most: int) -> None:
    if rows > most:
        bound = f"at most planner_rows = {most} are allowed"
        raise ArgumentError.of(name, f"{rows} rows", bound, "Split the request, or set planner_rows of the node.")
