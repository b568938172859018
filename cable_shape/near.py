"""How far cables are from each other, and from themselves: :class:`CableNear`.

Cables are rows of capsules around the pieces of their centrelines. Of a cable with itself those pieces are compared
between which it is at least pi diameters long and has turned round, its chord at most 2/pi of its length, as on half a
circle: a straight or gently bent cable is not near itself, a loop, a hairpin and a snarl are. Tails are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable import Cable
from cable_shape.checks import Array
from cable_shape.clearance import HORIZON_FACTOR, LEAST_HORIZON, NOT_JUDGED
from cable_shape.errors import ArgumentError
from cable_shape.kernels import cable_near
from cable_shape.kernels.bounds import RESULT_COLUMNS
from cable_shape.models.crossing import ITSELF
from cable_shape.models.crossing_places import SHORTEST
from cable_shape.report import BodyDistance, Clearance
from cable_shape.scene import Obstacle, Scene
from cable_shape.shape import CableShape

Counts = NDArray[np.int64]


@final
class CableNear:
    """Checks the shapes of several cables against each other, again and again.

    Parameters
    ----------
    cables : mapping of name to Cable
    scene, robot_links
        As for :class:`~cable_shape.clearance.ClearanceChecker`; the scene's warning distances give the horizon.
    cull : bool
        False solves every pair of pieces, to test that the bounds never change the answer.

    Raises
    ------
    ArgumentError
        If an obstacle has the name of a cable, or an obstacle or a cable is called "itself".
    """

    def __init__(
        self, cables: Mapping[str, Cable], scene: Scene, robot_links: Sequence[Obstacle] = (), *, cull: bool = True
    ) -> None:
        self.cull = cull
        self._diameters = {name: cable.diameter for name, cable in cables.items()}
        self._bodies_before = len(scene.obstacles) + len(robot_links)
        self._horizon = max(HORIZON_FACTOR * max(scene.warn_distance, scene.error_distance), LEAST_HORIZON)
        taken = {body.name for body in (*scene.obstacles, *robot_links)}
        if ITSELF in cables:
            raise ArgumentError.of(
                "cables", ITSELF, "clearance of a cable to itself has that name", "Rename the cable."
            )
        for name in (ITSELF, *(cables if len(cables) > 1 else ())):
            if name in taken:
                raise ArgumentError.of(
                    "obstacles",
                    name,
                    "an obstacle has the name under which the clearance to a cable is told",
                    "Rename the obstacle.",
                )

    def _bodies(self, name: str) -> list[str]:
        """What is near a cable: the others, and itself."""
        return [other for other in self._diameters if other != name] + [ITSELF]

    def added(self, shapes: Mapping[str, CableShape], clearance: Mapping[str, Clearance]) -> dict[str, Clearance]:
        """The clearances of all the cables to bodies, with the cables near them added."""
        judged = [name for name in self._diameters if name in shapes and shapes[name].status not in NOT_JUDGED]
        found = {name: np.full((len(self._diameters), RESULT_COLUMNS), math.inf) for name in judged}
        counts = {name: np.zeros(2, dtype=np.int64) for name in judged}
        for i, a in enumerate(judged):
            for b in judged[i:]:
                self._between(a, b, shapes, found, counts)
        out = dict(clearance)
        for name, rows in found.items():
            out[name] = self._joined(name, clearance[name], rows, counts[name], len(judged) == len(shapes))
        return out

    def _between(
        self, a: str, b: str, shapes: Mapping[str, CableShape], found: dict[str, Array], counts: dict[str, Counts]
    ) -> None:
        """Fills the rows of two cables, or of one with itself."""
        radii = 0.5 * self._diameters[a], 0.5 * self._diameters[b]
        spot, count = np.empty(cable_near.SPOT), np.zeros(2, dtype=np.int64)
        near = cable_near.nearest(
            shapes[a].positions, shapes[a].arc_length, shapes[b].positions, shapes[b].arc_length, a == b,
            SHORTEST * self._diameters[a], self._horizon + sum(radii), self.cull, spot, count,
        )  # fmt: skip
        counts[a] += count
        if a != b:
            counts[b] += count
        if not near:
            return
        normal = (spot[3:6] - spot[6:9]) / spot[0] if spot[0] > 0.0 else np.zeros(3)
        on = spot[3:6] - radii[0] * normal, spot[6:9] + radii[1] * normal
        distance = spot[0] - sum(radii)
        found[a][self._bodies(a).index(ITSELF if a == b else b)] = (distance, spot[1], *on[0], *on[1])
        if a != b:
            found[b][self._bodies(b).index(a)] = (distance, spot[2], *on[1], *on[0])

    def _joined(self, name: str, clearance: Clearance, rows: Array, counts: Counts, all_in: bool) -> Clearance:
        """One cable's clearance with those rows."""
        table = (
            clearance.table if clearance.table is not None else np.full((self._bodies_before, RESULT_COLUMNS), math.inf)
        )
        bodies = tuple(
            BodyDistance(body, float(row[0]), float(row[1]), row[2:5], row[5:8])
            for body, row in zip(self._bodies(name), rows, strict=True)
            if row[0] != math.inf
        )
        beyond = clearance.beyond if all_in else 0.0
        if len(rows) > 1 and rows[:-1, 0].max() == math.inf:
            beyond = min(beyond, self._horizon)
        return Clearance(
            clearance.bodies + bodies,
            beyond,
            clearance.robot_checked,
            clearance.pairs_culled + int(counts[0]),
            clearance.pairs_exact + int(counts[1]),
            np.concatenate((table, rows)),
        )
