"""check_trajectory of cables and harnesses: kept out of each other, or not to come too near; how they move together."""

from __future__ import annotations

import math
from itertools import count
from typing import Any

import numpy as np
import pytest
from forks import CABLE, HELD, forked, posed

import cable_shape as cs
from cable_shape.errors import ArgumentError, CableShapeError
from cable_shape.prediction.cables_predictor import CablesPredictor

SOLVED = cs.Scene(contact="solve")
FORK = forked(CABLE)
ARM = FORK.segments["l"]
PARTS: dict[str, Any] = {"c": CABLE, "h": FORK}


def pose(row: np.ndarray) -> cs.Pose:
    return cs.Pose(row[:3], row[3:])


def lowered(high: float, low: float, waypoints: int) -> dict[str, Any]:
    """A cable is let down across both arms of a fork."""
    heights = np.linspace(high, low, waypoints)
    across = tuple(np.array([posed((0.25, y, z), 90.0) for z in heights]) for y in (-0.45, 0.45))
    return {"c": across, "h": {end: np.tile(row, (waypoints, 1)) for end, row in HELD.items()}}


def grips_at(path: dict[str, Any], i: int) -> dict[str, Any]:
    start, end = path["c"]
    return {"c": (pose(start[i]), pose(end[i])), "h": {end: pose(table[i]) for end, table in path["h"].items()}}


def test_a_cable_let_down_on_a_harness_is_followed_and_told_as_a_cycle_tells_it() -> None:
    path = lowered(0.14, 0.08, 13)
    found = cs.check_trajectory(PARTS, SOLVED, None, path)
    assert found.valid, found.first
    assert found.segments.all()
    assert found.margins_of.keys() == {"c", "h/stem", "h/l", "h/r"}
    cycle, stamps = cs.Cycle(PARTS, scene=SOLVED, tolerance=1e-4), count(0, 10**10)
    for i in range(13):
        report = cycle.step(grips_at(path, i), next(stamps))
        near = [b.distance for b in report.clearance["c"].bodies if b.body.startswith("h/")]
        assert found.clearance[i] == pytest.approx(min(near, default=math.inf), abs=2e-4)
        for name, margins in report.margins.items():
            told = {(m.kind, m.other): m.used for m in found.margins_of[name][i]}
            for margin in margins:
                if margin.kind is cs.WarningKind.STABILITY:
                    assert told[margin.kind, ""] == pytest.approx(margin.used, rel=0.02)
    assert {contact.body for contact in report.shapes["c"].contacts} == {"h/l", "h/r"}


@pytest.mark.parametrize("waypoints", [2, 21])
def test_a_way_straight_through_a_harness_leads_to_where_the_cable_lies_on_it(waypoints: int) -> None:
    path = lowered(0.2, -0.02, waypoints)
    found = cs.check_trajectory(PARTS, SOLVED, None, path)
    assert found.valid, found.first
    assert found.clearance[-1] == pytest.approx(0.0, abs=2e-4)
    below = cs.Cycle(PARTS, scene=SOLVED).step(grips_at(path, waypoints - 1), 0)
    assert not below.shapes["c"].contacts  # from nothing it hangs below


def test_without_contact_solved_for_they_may_not_come_too_near_between_waypoints_either() -> None:
    near = cs.Scene(error_distance=0.005, warn_distance=0.01)
    found = cs.check_trajectory(PARTS, near, None, lowered(0.2, 0.02, 2))
    assert found.first is not None
    assert found.first.reason is cs.Reason.CLEARANCE
    assert (found.first.segment, found.first.other[:2]) == ("c", "h/")
    assert found.waypoints == (None, None)
    assert 0.0 < found.first.place < 1.0
    cycle, stamps = cs.Cycle(PARTS, scene=near), count(0, 10**10)
    scan = lowered(0.2, 0.02, 401)
    for i in range(401):
        bodies = cycle.step(grips_at(scan, i), next(stamps)).clearance["c"].bodies
        if min((b.distance for b in bodies if b.body.startswith("h/")), default=math.inf) < 0.005:
            break
    assert found.first.place == pytest.approx(i / 400.0, abs=4e-3)
    assert cs.check_trajectory(PARTS, near, None, lowered(0.2, 0.16, 2)).valid


def test_how_each_moves_with_what_holds_the_other_is_differences() -> None:
    predictor = CablesPredictor(PARTS, scene=SOLVED, tolerance=1e-7)
    for height in np.linspace(0.14, 0.06, 17):
        shapes = predictor.predict(grips_at(lowered(height, height, 1), 0))
    assert shapes["c"].contacts
    assert predictor.touching == {"c", "h"}
    told = predictor.sensitivity()
    path, step = lowered(0.06, 0.06, 1), 1e-4
    columns = {("c", 0): 0, ("c", 1): 6, ("h", "stem.start"): 12, ("h", "l.end"): 18, ("h", "r.end"): 24}
    for (name, end), first in columns.items():
        for axis in range(3):
            sides = []
            for sign in (1.0, -1.0):
                grips: Any = grips_at(path, 0)
                ends = dict(enumerate(grips["c"])) if name == "c" else grips["h"]
                ends[end] = cs.Pose(ends[end].position + sign * step * np.eye(3)[axis], ends[end].quaternion)
                if name == "c":
                    grips["c"] = tuple(ends.values())
                found = predictor.predict(grips)
                sides.append({"c": found["c"], **{f"h/{k}": one for k, one in found["h"].segments.items()}})
            for strand, moved in told.items():
                expected = (sides[0][strand].positions - sides[1][strand].positions) / (2.0 * step)
                np.testing.assert_allclose(moved[:, :, first + axis], expected, atol=2e-3)
    assert {strand: moved.shape for strand, moved in told.items()} == dict.fromkeys(told, (150, 3, 30))
    apart = CablesPredictor(PARTS, scene=SOLVED)
    apart.predict(grips_at(lowered(0.3, 0.3, 1), 0))
    told = apart.sensitivity()
    assert not told["h/l"][:, :, :12].any()
    assert not told["c"][:, :, 12:].any()
    assert told["h/l"][:, :, 12:].any()


def test_loads_of_one_segment_and_ends_are_named() -> None:
    path = lowered(0.14, 0.12, 3)
    strong = FORK.replace(segments={**FORK.segments, "l": ARM.replace(max_tension=0.8)})
    parts = {**PARTS, "h": strong}
    assert cs.check_trajectory(parts, SOLVED, None, path).valid
    moves = {"h": {"l": np.full((3, 3), 20.0)}}
    pulled = cs.check_trajectory(parts, SOLVED, None, path, acceleration=moves)
    assert pulled.first is not None
    assert (pulled.first.reason, pulled.first.segment) == (cs.Reason.TENSION, "h/l")
    ends = {"c.start": path["c"][0], "c.end": path["c"][1], **{f"h/{end}": one for end, one in path["h"].items()}}
    assert cs.check_trajectory(PARTS, SOLVED, None, cs.EndsPath(ends)).valid
    with pytest.raises(CableShapeError, match=r"h/stem\.end"):
        cs.check_trajectory(PARTS, SOLVED, None, cs.EndsPath({**ends, "h/stem.end": path["c"][0]}))
    with pytest.raises(CableShapeError, match=r"unknown key 'h\.start'.*h/stem\.start"):
        cs.check_trajectory(PARTS, SOLVED, None, {**path, "h": path["c"]})
    with pytest.raises(ArgumentError, match=r"acceleration\['h'\].*\(3, 3\)"):
        cs.check_trajectory(PARTS, SOLVED, None, path, acceleration={"h": {"l": np.zeros((2, 3))}})
