"""How far cables are from each other, and from themselves: :class:`CableNear`.

Cables are rows of capsules around the pieces of their centrelines. Of a cable with itself those pieces are compared
between which it is at least pi diameters long and has turned round, its chord at most 2/pi of its length, as on half a
circle: a straight or gently bent cable is not near itself, a loop, a hairpin and a snarl are. Tails are left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import widest
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance import cable_near
from cable_shape.kernels.distance.bounds import RESULT_COLUMNS
from cable_shape.safety.clearance import HORIZON_FACTOR, LEAST_HORIZON, NOT_JUDGED
from cable_shape.safety.report import BodyDistance, Clearance
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve.touching.spot import SHORTEST
from cable_shape.solve.touching.told import ITSELF

Counts = NDArray[np.int64]
Row = tuple[float, ...]  # distance, arc length, point on the cable, point on the other


@final
class CableNear:
    """Checks the shapes of several cables against each other, again and again.

    Parameters
    ----------
    cables : mapping of name to Cable
    scene, robot_links
        As for :class:`~cable_shape.safety.clearance.ClearanceChecker`; the scene's warning distances give the horizon.
    joined : collection of pairs of names
        Cables that meet, as segments of a harness in a junction: they are not checked against each other.
    cull : bool
        False solves every pair of pieces, to test that the bounds never change the answer.

    Raises
    ------
    ArgumentError
        If an obstacle has the name of a cable, or an obstacle or a cable is called "itself".
    """

    def __init__(
        self,
        cables: Mapping[str, Cable],
        scene: Scene,
        robot_links: Sequence[Obstacle] = (),
        *,
        cull: bool = True,
        joined: Collection[frozenset[str]] = (),
    ) -> None:
        self.cull = cull
        self._joined_ones = joined
        self._diameters = {name: widest(cable) for name, cable in cables.items()}
        self._bodies_before = len(scene.obstacles) + len(robot_links)
        self._nothing = np.full((max(self._bodies_before, len(cables)), RESULT_COLUMNS), math.inf)
        self._spot = np.empty(cable_near.SPOT)
        self._swell: Mapping[str, float] = {}
        self.horizon = max(HORIZON_FACTOR * max(scene.warn_distance, scene.error_distance), LEAST_HORIZON)
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

    def bodies(self, name: str) -> list[str]:
        """What is near a cable: the others, and itself."""
        return [other for other in self._diameters if other != name] + [ITSELF]

    def added(
        self,
        shapes: Mapping[str, CableShape],
        clearance: Mapping[str, Clearance],
        swell: Mapping[str, float] | None = None,
    ) -> dict[str, Clearance]:
        """The clearances of all the cables to bodies, with the cables near them added.

        swell: by how much a cable is taken for thicker [m], where it does not rest on the other.
        """
        self._swell = swell or {}
        judged = [name for name in self._diameters if name in shapes and shapes[name].status not in NOT_JUDGED]
        found: dict[str, dict[int, Row]] = {name: {} for name in judged}
        counts = {name: np.zeros(2, dtype=np.int64) for name in judged}
        for i, a in enumerate(judged):
            for b in judged[i:]:
                if self._joined_ones and frozenset((a, b)) in self._joined_ones:
                    continue
                self._between(a, b, shapes, found, counts)
        out = dict(clearance)
        for name, rows in found.items():
            out[name] = self._joined(name, clearance[name], rows, counts[name], len(judged) == len(shapes))
        return out

    def _between(
        self,
        a: str,
        b: str,
        shapes: Mapping[str, CableShape],
        found: dict[str, dict[int, Row]],
        counts: dict[str, Counts],
    ) -> None:
        """Fills the rows of two cables, or of one with itself."""
        spot, first, other = self._spot, shapes[a], shapes[b]
        resting = first.presses(ITSELF if a == b else b).size > 0
        radii = tuple(0.5 * self._diameters[k] + (0.0 if resting else self._swell.get(k, 0.0)) for k in (a, b))
        near = cable_near.nearest(
            first.positions, first.arc_length, other.positions, other.arc_length, a == b, SHORTEST * self._diameters[a],
            self.horizon + radii[0] + radii[1], self.cull, spot, counts[a], counts[b],
        )  # fmt: skip
        if not near:
            return
        normal = (spot[3:6] - spot[6:9]) / spot[0] if spot[0] > 0.0 else np.zeros(3)
        on = spot[3:6] - radii[0] * normal, spot[6:9] + radii[1] * normal
        distance = float(spot[0]) - sum(radii)
        found[a][self.bodies(a).index(ITSELF if a == b else b)] = (distance, float(spot[1]), *on[0], *on[1])
        if a != b:
            found[b][self.bodies(b).index(a)] = (distance, float(spot[2]), *on[1], *on[0])

    def _joined(
        self, name: str, clearance: Clearance, rows: Mapping[int, Row], counts: Counts, all_in: bool
    ) -> Clearance:
        """One cable's clearance with those rows."""
        others = len(self._diameters) - 1
        before = self._nothing[: self._bodies_before] if clearance.table is None else clearance.table
        table = np.concatenate((before, self._nothing[: others + 1]))
        bodies = clearance.bodies
        if rows:
            names = self.bodies(name)
            for place, row in sorted(rows.items()):
                table[len(before) + place] = row
                bodies = (*bodies, BodyDistance(names[place], row[0], row[1], np.array(row[2:5]), np.array(row[5:8])))
        beyond = clearance.beyond if all_in else 0.0
        if sum(place < others for place in rows) < others:
            beyond = min(beyond, self.horizon)
        culled, exact = counts.tolist()
        return Clearance(
            bodies,
            beyond,
            clearance.robot_checked,
            clearance.pairs_culled + culled,
            clearance.pairs_exact + exact,
            table=table,
        )
