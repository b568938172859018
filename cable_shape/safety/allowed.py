"""Contact that is meant: :class:`Allowed`, what of a cable's clearance is judged, and how much of a force is used."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of, widest
from cable_shape.checks import Array
from cable_shape.kernels.distance import bounds
from cable_shape.pose import Pose
from cable_shape.safety.clearance import DEEPEST_REST, HORIZON_FACTOR, LEAST_HORIZON, NOT_JUDGED
from cable_shape.safety.report import BodyDistance, Clearance, Margin, WarningKind
from cable_shape.scene.body_tables import body_tables, carried_by, link_rows
from cable_shape.scene.scene import Allow, Obstacle, Scene
from cable_shape.shape import CableShape

#: A span, or a tail, where on the cable that begins [m], and which way it runs, 1 or -1.
Part = tuple[CableShape, float, float]


@final
class Allowed:
    """The contact that a scene allows one cable; false if it allows none.

    robot_links, gripping_links: as for :class:`~cable_shape.safety.clearance.ClearanceChecker`.
    """

    def __init__(
        self, scene: Scene, cable: Cable, robot_links: Iterable[Obstacle] = (), gripping_links: Iterable[str] = ()
    ) -> None:
        self._cable = cable
        self._of: dict[str, list[Allow]] = {}
        for allow in scene.allow:
            self._of.setdefault(allow.body, []).append(allow)
        gripping = set(gripping_links)
        self._bodies = {
            body.name: body
            for body in (*scene.obstacles, *robot_links)
            if body.name in self._of and body.link not in gripping
        }
        self._horizon = max(HORIZON_FACTOR * max(scene.warn_distance, scene.error_distance), LEAST_HORIZON)

    def __bool__(self) -> bool:
        return bool(self._of)

    def judged(
        self,
        shape: CableShape,
        clearance: Clearance,
        links: Mapping[str, Pose] | None = None,
        swell: float = 0.0,
        tails: Sequence[Part] = (),
    ) -> tuple[Clearance, tuple[Margin, ...]]:
        """The clearance of which there may be alarm, and the margins of the forces.

        A body that may be touched is as near as it is to the rest of the cable, or not there. Of other cables, and of
        bodies on links that grip, the nearest point of the cable stands for all of it.

        Parameters
        ----------
        links : mapping of robot link to its Pose in the world, optional
        swell : float
            [m], by how much the cable is taken for thicker.
        tails : sequence of (shape, [m] where it begins, 1 or -1)
            What hangs beyond the grips, and runs on from there, or back.
        """
        if not self._of or shape.status in NOT_JUDGED:
            return clearance, ()
        parts = ((shape, 0.0, 1.0), *tails)
        bodies, table = [], None if clearance.table is None else clearance.table.copy()
        for body in clearance.bodies:
            allows = self._of.get(body.body)
            if allows is None or not self._may_touch(allows, parts, clearance, body):
                bodies.append(body)
                continue
            rest = self._rest(body.body, allows, parts, links, swell)
            if table is not None:
                same = (table[:, 0] == body.distance) & (table[:, 1] == body.arc_length)
                table[np.flatnonzero(same)[0]] = math.inf if rest is None else rest
            if rest is not None:
                bodies.append(BodyDistance(body.body, float(rest[0]), float(rest[1]), rest[2:5], rest[5:8]))
        forces = [margin for name in self._of for margin in self._force(name, parts)]
        return dataclasses.replace(clearance, bodies=tuple(bodies), table=table), tuple(forces)

    def _may_touch(
        self, allows: Sequence[Allow], parts: Sequence[Part], clearance: Clearance, body: BodyDistance
    ) -> bool:
        """Whether a body may be where it is: on a stretch where that is meant, not too hard, nor bent too far there."""
        if clearance.confidence == 0.0 and body.distance < -DEEPEST_REST:
            return False
        here = [allow for allow in allows if allow.stretch[0] <= body.arc_length <= allow.stretch[1]]
        return any(
            (allow.max_force is None or _pressed(parts, allow)[0] <= allow.max_force)
            and not any(self._bent(part, allow) for part in parts)
            for allow in here
        )

    def _bent(self, part: Part, allow: Allow) -> bool:
        """Whether a part is bent further than the cable may be, on the stretch that a body may touch."""
        shape, first, way = part
        limits = [one.min_bend_radius for _, _, one in pieces_of(self._cable) if one.min_bend_radius is not None]
        if not limits or float(shape.bend_radius.min()) >= max(limits):
            return False
        low, high = allow.stretch
        arcs = first + way * shape.arc_length
        for start, end, piece in pieces_of(self._cable):
            if piece.min_bend_radius is None:
                continue
            begins, ends = (-math.inf if start == 0.0 else start), (math.inf if end == self._cable.length else end)
            there = (arcs >= max(begins, low)) & (arcs <= min(ends, high))
            if (shape.bend_radius[there] < piece.min_bend_radius).any():
                return True
        return False

    def _rest(
        self,
        name: str,
        allows: Sequence[Allow],
        parts: Sequence[Part],
        links: Mapping[str, Pose] | None,
        swell: float,
    ) -> Array | None:
        """(8,), as a row of a clearance's table: the nearest that a body is to where it may not be touched."""
        body = self._bodies.get(name)
        if body is None or (body.link is not None and links is None):
            return None
        stretches = sorted(allow.stretch for allow in allows)
        lines = [_line(part) for part in parts if part[0].status not in NOT_JUDGED]
        left = [_between(stretches, float(arcs[0]), float(arcs[-1])) for arcs, _ in lines]
        if not any(left):
            return None
        best: Array | None = None
        carried = carried_by((body,))
        tables = body_tables((body,), tuple(carried), frozenset())
        rows = np.empty((0, 7)) if links is None else link_rows(links, carried)
        radius = 0.5 * widest(self._cable) + swell
        for (arcs, positions), rest in zip(lines, left, strict=True):
            for low, high in rest:
                inside = arcs[(arcs > low) & (arcs < high)]
                own = np.concatenate(([low], inside, [high]))
                line = np.stack([np.interp(own, arcs, x) for x in positions.T], axis=1)
                result, counts = np.empty((1, bounds.RESULT_COLUMNS)), np.empty(2, np.int64)
                bounds.closest_points(
                    line, own, radius, self._horizon, 0.0, True, tables[0], rows, *tables[1:], result, counts
                )
                if result[0, 0] < (math.inf if best is None else best[0]):
                    best = result[0]
        return best

    def _force(self, name: str, parts: Sequence[Part]) -> list[Margin]:
        """The margin of the force of a body, where there is one and a limit of it: of its stretches the worst."""
        found = []
        for allow in self._of[name]:
            if allow.max_force is not None:
                force, at = _pressed(parts, allow)
                used = force / allow.max_force
                found.append(Margin(WarningKind.CONTACT_FORCE, used, allow.max_force, force, at, name))
        worst = max(found, key=lambda margin: margin.used, default=None)
        return [worst] if worst is not None and worst.value > 0.0 else []


def _line(part: Part) -> tuple[Array, Array]:
    """Arc lengths (n,) [m] from the start grip, ascending, and positions (n, 3) [m]."""
    shape, first, way = part
    order = slice(None, None, 1 if way > 0.0 else -1)
    return first + way * shape.arc_length[order], shape.positions[order]


def _pressed(parts: Sequence[Part], allow: Allow) -> tuple[float, float]:
    """[N], the force of a body on a stretch in all, and [m] where most of it is."""
    low, high = allow.stretch
    rows = [
        (force, first + way * arc)
        for shape, first, way in parts
        for arc, body, force in shape.touches[:, [0, 1, 8]].tolist()
        if shape.bodies[int(body)] == allow.body and low <= first + way * arc <= high
    ]
    return (sum(force for force, _ in rows), max(rows)[1]) if rows else (0.0, 0.0)


def _between(stretches: Iterable[tuple[float, float]], start: float, end: float) -> list[tuple[float, float]]:
    """What stretches, in ascending order, leave of a line from start to end."""
    out, at = [], start
    for low, high in stretches:
        if min(low, end) > at:
            out.append((at, min(low, end)))
        at = max(at, high)
    return [*out, (at, end)] if at < end else out
