"""Blocks of random grasps solved, certified and judged: what `scripts/bench certify` counts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from certify_check import Certificate, certify
from certify_grasps import MOST_HALVINGS, Grasp, halvings_for, in_clips, plain, points, stacked

import cable_shape as cs

SEED, CLIPS_SEED = 2026, 2027
#: Points in one call of the check, whose arrays are then in the processor's caches.
AT_ONCE = 12_000
#: A frame turns by at most so much [rad] from point to point, and points are so many boundary layers apart.
MOST_TURN, MOST_LAYERS = 1.0, 0.9
#: Share of the stiffness that a shape must have to spare to be called stable without a look at more points.
RESERVE = 0.003
#: Of the tolerance: what is further away is looked at with more points before it is judged.
NEAR = 0.6
#: Times the shape's own estimate of force and moment, and share of the largest, beyond which they are wrong.
ESTIMATES, SHARE = 2.0, 1e-3
#: Of numbers that are to agree but for rounding, and of held directions [rad]: a hundredth of the tolerance.
ROUNDING = 1e-7
#: Of the tolerance: what is called wrong is looked at beside the same shape solved so many times finer.
FINER = 100.0
#: Times turn^2: share of the stiffness that the check's own elements may lack where points are still far apart.
LACKING = 0.01
#: One row in so many is certified at four times the points, too.
CHECKED = 200
#: Of the tolerance: distances that are counted.
COUNTED = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 5.0)


class Judged(NamedTuple):
    """One row's certificate, in terms of its bounds: above 1 is wrong."""

    halvings: int
    away: float
    force: float
    moment: float
    off: float
    stable: bool
    resolved: bool
    turn: float
    layers: float

    @property
    def wrong(self) -> str:
        """Why, in words; empty if nothing is."""
        what = [
            f"{name} {value:.3g}"
            for name, value in (("away", self.away), ("force", self.force), ("moment", self.moment), ("off", self.off))
            if not value <= 1.0
        ]
        return ", ".join(what if self.stable else [*what, "no minimum"])

    @property
    def clear(self) -> bool:
        """Whether more points are not needed."""
        return self.resolved and self.away <= NEAR and not self.wrong


def beyond(error: float, estimate: float, shape: cs.CableShape, values: np.ndarray, taut: bool = False) -> float:
    """An error of force or moment in terms of its bound; of a taut cable the tolerance itself changes the force."""
    share = SHARE
    if taut:
        slack = 1.0 - float(np.linalg.norm(shape.positions[-1] - shape.positions[0])) / shape.length
        share = max(SHARE, 0.5e-5 / max(slack, 5e-4))
    return error / max(ESTIMATES * estimate, share * float(np.linalg.norm(values, axis=1).max()))


def judged(shape: cs.CableShape, found: Certificate, k: int, halvings: int) -> Judged:
    """Row k of the certificates."""
    turn, layers = float(found.turn[k]), float(found.layers[k])
    return Judged(
        halvings,
        float(found.away[k]) / (1e-5 * shape.length),
        beyond(float(found.force[k]), shape.force_error, shape, shape.force, taut=True),
        beyond(float(found.moment[k]), shape.moment_error, shape, shape.moment),
        float(max(found.balance[k], found.law[k], found.frames[k])) / ROUNDING,
        bool(found.stable[k]),
        turn <= MOST_TURN and layers <= MOST_LAYERS,
        turn,
        layers,
    )


def looked_at_again(grasp: Grasp, shape: cs.CableShape, row: Judged) -> Judged:
    """What is called wrong, beside the same shape solved finer, if this is certified.

    Where a shape is nearly taut or next to limp, one Newton step from it, or the second variation at it, is not enough.
    """
    fine = grasp.predict(row.halvings, FINER)
    if fine.status is not cs.Status.OK:
        return row
    (its,) = certified([grasp], [fine], row.halvings, -LACKING * row.turn**2)
    if not its.stable:
        fines = {row.halvings: fine}

        def stable(halvings: int, reserve: float) -> bool:
            shape = fines.setdefault(halvings, grasp.predict(halvings, FINER))
            return certified([grasp], [shape], halvings, reserve)[0].stable

        its = its._replace(stable=in_the_limit(stable, row.halvings))
    apart, forces, moments = (
        float(np.linalg.norm(getattr(shape, name) - getattr(fine, name), axis=1).max())
        for name in ("positions", "force", "moment")
    )
    if its.wrong or apart > 1e-3 * shape.length:  # or another shape
        return row
    return row._replace(
        away=apart / (1e-5 * shape.length),
        force=beyond(forces, shape.force_error, shape, shape.force, taut=True),
        moment=beyond(moments, shape.moment_error, shape, shape.moment),
        stable=its.stable,
    )


def in_the_limit(stable: Callable[[int, float], bool], halvings: int) -> bool:
    """Whether a second variation lacks no share of its stiffness as the points come to lie closer and closer.

    stable: of halvings of the spacing, and of a share of the stiffness taken off. What linear elements lack falls with
    the square of their length: how it falls from one spacing to half of it tells whether anything is left.
    """
    halvings = min(halvings, MOST_HALVINGS - 1)
    return 4.0 * lacking(stable, halvings + 1) < lacking(stable, halvings)


def lacking(stable: Callable[[int, float], bool], halvings: int) -> float:
    """The share of the stiffness with which, added, it is stable; infinite: no share up to 1 is."""
    if not stable(halvings, -1.0):
        return math.inf
    low, high = 1e-9, 1.0
    while high > 1.02 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if stable(halvings, -middle) else (middle, high)
    return high


def certified(grasps: list[Grasp], shapes: list[cs.CableShape], halvings: int, reserve: float) -> list[Judged]:
    """Certificates of shapes of one number of points, a few at a time."""
    out: list[Judged] = []
    step = max(1, AT_ONCE // points(halvings))
    for a in range(0, len(grasps), step):
        some = shapes[a : a + step]
        found = certify(stacked(grasps[a : a + step], some, halvings), reserve)
        out += [judged(shape, found, k, halvings) for k, shape in enumerate(some)]
    return out


def _groups(grasps: list[Grasp], rows: list[int], halvings: dict[int, int]) -> Iterator[list[int]]:
    """Rows of one number of points, and with masses or without."""
    groups: dict[tuple[int, bool, bool], list[int]] = {}
    for row in rows:
        cable = grasps[row].cable
        elastic = cable.axial_stiffness is not None
        groups.setdefault((halvings[row], bool(grasps[row].masses), elastic), []).append(row)
    yield from groups.values()


def plain_block(first: int, last: int, seed: int = SEED) -> dict[str, Any]:
    """Plain grasps `first` to `last`: statuses, what has no shape, what is wrong, and how large errors are."""
    grasps = [plain(seed, row) for row in range(first, last)]
    halvings = {k: grasp.halvings for k, grasp in enumerate(grasps)}
    shapes = {k: grasp.predict(halvings[k]) for k, grasp in enumerate(grasps)}
    statuses = Counter(shape.status.name for shape in shapes.values())
    none = [[first + k, shape.status.name] for k, shape in shapes.items() if shape.status is not cs.Status.OK]
    left = [k for k, shape in shapes.items() if shape.status is cs.Status.OK]
    done: dict[int, Judged] = {}
    reserve, again = RESERVE, 0
    while left:
        for group in _groups(grasps, left, halvings):
            h = halvings[group[0]]
            found = certified([grasps[k] for k in group], [shapes[k] for k in group], h, reserve)
            done |= dict(zip(group, found, strict=True))
        left = [k for k in left if not done[k].clear and halvings[k] < MOST_HALVINGS]
        again += 1
        if again > 3:
            break
        reserve = RESERVE if again < 2 else 0.0
        for k in left:
            row = done[k]
            needed = halvings_for(1.0 / max(1.1 * row.layers / MOST_LAYERS, 1.1 * row.turn / MOST_TURN, 1.0))
            halvings[k] = min(halvings[k] + (2 if row.resolved else max(needed, 1)), MOST_HALVINGS)
            shapes[k] = grasps[k].predict(halvings[k])
    done |= {k: looked_at_again(grasps[k], shapes[k], row) for k, row in done.items() if row.wrong}
    checked = [[0.0, False]]
    for k, row in done.items():
        if (first + k) % CHECKED == 0 and row.halvings + 2 <= MOST_HALVINGS:
            h = row.halvings + 2
            (fine,) = certified([grasps[k]], [grasps[k].predict(h)], h, 0.0)
            checked.append([abs(fine.away - row.away), fine.stable != row.stable])
    kinds = Counter(what for k in done for what in grasps[k].what)
    return {
        "rows": [first, last],
        "statuses": dict(statuses),
        "without": none,
        "wrong": [[first + k, row.wrong, row.halvings] for k, row in done.items() if row.wrong],
        "unresolved": [first + k for k, row in done.items() if not row.resolved],
        "kinds": dict(kinds),
        "away": [max((row.away for row in done.values()), default=0.0), sum(row.away for row in done.values())],
        "above": [sum(row.away > x for row in done.values()) for x in COUNTED],
        "points": sum(points(row.halvings) for row in done.values()),
        "checked": [len(checked) - 1, *np.max(checked, axis=0).tolist()],
    }


def clips_block(first: int, last: int, seed: int = CLIPS_SEED) -> dict[str, Any]:
    """Statuses of rows in clips and in eyelets."""
    statuses = {"clips": Counter[str](), "eyelets": Counter[str]()}
    none = []
    for row in range(first, last):
        name, cable, scene, start, end = in_clips(seed, row)
        status = cs.predict(cable, start, end, scene=scene).status
        statuses[name][status.name] += 1
        if status is not cs.Status.OK:
            none.append([row, status.name])
    return {"rows": [first, last], **{name: dict(found) for name, found in statuses.items()}, "without": none}
