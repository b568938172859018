"""Which bodies a moving cable comes nearest to, where and when, between the instants too: :func:`nearest`."""

from __future__ import annotations

import math
from typing import NamedTuple, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.planning.study_case import Case
from cable_shape.planning.study_walk import Rows, walk
from cable_shape.planning.swept import beside
from cable_shape.pose import between

#: Instants into which the way between two is cut where a body may be nearer there.
FINER = 100


@final
class Nearest(NamedTuple):
    """How near a cable comes to a body.

    distance [m], negative on overlap, infinite beyond the horizon; instant, a fraction between two; arc_length [m];
    segment of a harness; point_on_cable, point_on_body (3,) [m], world.
    """

    body: str
    distance: float
    instant: float
    arc_length: float
    segment: str
    point_on_cable: Array
    point_on_body: Array


def nearest(case: Case, found: dict[str, Rows]) -> tuple[Nearest, ...]:
    """For each body the worst instant, as a scan FINER times as fine would find it, the nearest first.

    Between two instants a distance is nowhere below (d_a + d_b - max |D|) / 2 - E, D being how far points move from one
    to the other and E how far they are beside the straight way; only where that is below the least distance known the
    ways between are solved for. Where a robot moves, instants alone are looked at.
    """
    out = []
    for name, rows in found.items():
        way = np.linalg.norm(np.diff(rows.part(1, 3), axis=0), axis=2).max(axis=1, initial=0.0)
        off = beside(rows.part(1, 3)).max(axis=1, initial=0.0)
        for column, body in enumerate(rows.bodies):
            out.append(_one(case, name, rows, column, body, way, off))
    least: dict[str, Nearest] = {}
    for one in out:
        if one.body not in least or one.distance < least[one.body].distance:
            least[one.body] = one
    return tuple(sorted(least.values(), key=lambda one: one.distance))


def _one(case: Case, name: str, rows: Rows, column: int, body: str, way: Array, off: Array) -> Nearest:
    table = rows.tables[:, column]
    distances = np.where(np.isnan(table[:, 0]), math.inf, table[:, 0])
    best = int(distances.argmin())
    worst = _told(body, float(best), table[best], name)
    if len(rows) < 2 or case.links is not None:
        return worst
    known = np.minimum(distances, rows.checker.horizon)
    bound = np.nan_to_num(0.5 * (known[:-1] + known[1:] - way) - off, nan=math.inf)
    for i in np.argsort(bound).tolist():
        if bound[i] >= min(worst.distance, rows.checker.horizon):
            break
        fine = walk(_cut(case, i))[name].tables[:, column]
        at = int(np.nanargmin(np.where(np.isnan(fine[:, 0]), math.inf, fine[:, 0])))
        if fine[at, 0] < worst.distance:
            worst = _told(body, i + at / FINER, fine[at], name)
    return worst


def _cut(case: Case, i: int) -> Case:
    """The way from an instant to the next one."""
    shares = np.linspace(0.0, 1.0, FINER + 1).tolist()
    frames = {end: np.array([between(table[i], table[i + 1], x) for x in shares]) for end, table in case.frames.items()}
    return case._replace(frames=frames)


def _told(body: str, instant: float, row: Array, segment: str) -> Nearest:
    return Nearest(body, float(row[0]), instant, float(row[1]), segment, row[2:5].copy(), row[5:8].copy())
