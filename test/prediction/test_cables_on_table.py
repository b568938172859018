"""Cables laid across each other on a table: found from nothing, and kept."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import scene_pile
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import cable_shape as cs

DIAMETER, LENGTH, CHORD, SPACING = 0.008, 0.62, 0.6, 0.1
CABLE = cs.Cable(LENGTH, 0.1, 0.003, diameter=DIAMETER)
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
DEEPEST = 1e-4  # m, between points of centrelines that are told


def ends(rows: int, over: float, k: int) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    """So many cables along x, and as many along y, held `over` [m] higher; grips go up and down."""
    out = {}
    for i in range(2 * rows):
        turn = Rotation.from_euler("z", 90.0 * (i >= rows), degrees=True)
        y, z = SPACING * (i % rows - (rows - 1) / 2), 0.03 + over * (i >= rows) + 0.004 * np.sin(0.1 * k + i)
        q = (turn * ALONG_X).as_quat()
        out[f"cable_{i}"] = tuple(cs.Pose(turn.apply((side * CHORD / 2, y, z)), q) for side in (-1.0, 1.0))
    return out


@pytest.mark.parametrize(("rows", "over"), [(1, 0.02), (4, 0.02)])
def test_none_is_lost_where_some_lie_on_others(rows: int, over: float) -> None:
    cycle = cs.Cycle(dict.fromkeys(ends(rows, over, 0), CABLE), scene=TABLE, model="cosserat")
    for k in range(12):
        shapes = cycle.step(ends(rows, over, k), 10_000_000 * k).shapes
        assert all(shape.usable for shape in shapes.values()), {n: str(s.detail) for n, s in shapes.items()}
        for shape in shapes.values():
            told = sum(contact.force for contact in shape.contacts if contact.body == "table")
            assert shape.presses("table").sum() == pytest.approx(told)
        lines = [shape.positions for shape in shapes.values()]
        assert min(line[:, 2].min() for line in lines) > 0.5 * DIAMETER - DEEPEST
        least = min(cdist(a, b).min() for i, a in enumerate(lines) for b in lines[i + 1 :])
        assert least > DIAMETER - DEEPEST


def test_where_they_come_to_touch_elsewhere_as_they_leap_that_is_held_too() -> None:
    """A branch of three cables of this pile ends in its last step; where it falls to, one of them meets the fourth."""
    pile = scene_pile.Pile(4, 0)
    cycle = cs.Cycle(pile.cables, scene=scene_pile.TABLE, model="cosserat", snap_horizon=0.0)
    for k in range(scene_pile.STEPS):
        shapes = cycle.step(pile.ends(k), 10_000_000 * k).shapes
        assert all(shape.usable for shape in shapes.values()), {n: str(s.detail) for n, s in shapes.items()}
    for a, b in combinations(shapes.values(), 2):
        assert cdist(a.positions, b.positions).min() > scene_pile.DIAMETER - DEEPEST - 1e-4
