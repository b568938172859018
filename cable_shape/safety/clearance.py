"""How far a cable is from the bodies around it: :class:`ClearanceChecker`.

The cable is taken as capsules around the pieces of its centreline. The distance to a body is the least signed distance
of the centreline to the body minus the cable's radius. On overlap it is negative: while the centreline stays outside,
the depth to which the cable's surface enters; once it is inside, the depth of its deepest point below the body's
surface, plus the radius. For a closed mesh the deepest point is sought among the points of the shape only; an open mesh
is a thin surface, so that the depth is at most the radius.

Every distance is solved in double precision (:mod:`cable_shape.kernels`): spheres, capsules and half-spaces in closed
form, boxes and cylinders to 1e-14 m, meshes triangle by triangle. What bounds rule out is skipped, which
does not change the answer by a bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import radius_of, thicker
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.contact.near import GRIP_EXCLUSION
from cable_shape.kernels.distance import bounds, swollen
from cable_shape.pose import Pose
from cable_shape.safety.report import BodyDistance, Clearance
from cable_shape.scene.body_tables import body_tables, carried_by, link_rows
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape, Status

#: Of these shapes no clearance is told: they are not where the cable is.
NOT_JUDGED = (Status.NOT_CONVERGED, Status.BUDGET_EXCEEDED)

#: [m], a cable that rests on a body, solved for, is at most so far inside it.
DEEPEST_REST = 2e-4

#: The default horizon: this many warning distances, and at least so many metres.
HORIZON_FACTOR, LEAST_HORIZON = 3.0, 0.1


@final
class ClearanceChecker:
    """Checks the shapes of one cable against a scene and a robot, again and again.

    Parameters
    ----------
    scene : Scene
        Its obstacles are checked; those with a `link` move with the robot.
    radius : float, optional
        [m], of the cable, at least 0. Default: that of `cable`.
    cable : Cable, optional
        Whose sections are as thick as they are.
    robot_links : sequence of Obstacle
        Collision geometry of the robot, each with its `link`.
    gripping_links : sequence of str
        Links that hold the cable: bodies on them are not compared with the first and last `grip_exclusion` of the
        cable. A cable of less than twice that length is not compared with them at all.
    grip_exclusion : float
        [m] of arc length.
    horizon : float, optional
        [m], bodies further away are only bounded. Default: three times the warning distance, at least 0.1 m.
    cull : bool
        False solves every pair, to test that the bounds never change the answer.

    Raises
    ------
    ArgumentError
        For a negative number, a robot link without `link`, or a horizon below the warning distances.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        radius: float | None = None,
        cable: Cable | None = None,
        robot_links: Sequence[Obstacle] = (),
        gripping_links: Sequence[str] = (),
        grip_exclusion: float = GRIP_EXCLUSION,
        horizon: float | None = None,
        cull: bool = True,
    ) -> None:
        if radius is None:
            radius = 0.0 if cable is None else radius_of(cable)
        self.radius = checks.number("radius", radius, at_least=0.0, unit="m")
        self._cable = cable
        self.grip_exclusion = checks.number("grip_exclusion", grip_exclusion, at_least=0.0, unit="m")
        least = max(scene.warn_distance, scene.error_distance)
        if horizon is None:
            horizon = max(HORIZON_FACTOR * least, LEAST_HORIZON)
        self.horizon = checks.number(
            "horizon", horizon, at_least=least, unit="m", remedy="Warnings need every distance up to theirs."
        )
        for body in robot_links:
            if body.link is None:
                raise ArgumentError.of(
                    f"robot_links: {body.name}.link", None, "it must be a link", "An obstacle of the world is in Scene."
                )
        self.cull = cull
        bodies = (*scene.obstacles, *robot_links)
        self.names = tuple(body.name for body in bodies)
        self._carried = carried_by(bodies)
        self.links = tuple(self._carried)
        #: (m,), of the bodies in `names`: whether they are on a link, which may move
        self.moving: NDArray[np.bool_] = np.array([body.link is not None for body in bodies], dtype=np.bool_)
        self._fixed = sum(body.link is None for body in bodies)
        self.tables = body_tables(bodies, self.links, frozenset(gripping_links))

    def check(
        self, shape: CableShape, links: Mapping[str, Pose] | None = None, swell: Array | None = None
    ) -> Clearance:
        """Distances of `shape` to all bodies.

        Parameters
        ----------
        shape : CableShape
            Of a shape that did not converge nothing is told: the answer lists no body and says beyond = 0.
        links : mapping of robot link to its Pose in the world, optional
            Without it bodies on links are left out and `robot_checked` is False, also when there are none.
        swell : (n,), optional
            [m], by how much the cable is taken for thicker at each of its points, its tube for example; where it rests
            on a body it is not.

        Raises
        ------
        ArgumentError
            If `links` lacks a link that carries a body, or the shape's positions are not finite.
        """
        if shape.status in NOT_JUDGED:
            return Clearance(beyond=0.0)
        checked = len(self.names) if links is not None else self._fixed
        if not checked:
            return Clearance(robot_checked=links is not None)
        if self._cable is not None and self._cable.sections:
            more = thicker(self._cable, shape.arc_length)
            swell = more if swell is None else swell if more is None else swell + more
        result = np.full((len(self.names), bounds.RESULT_COLUMNS), math.nan)
        counts = np.empty(2, np.int64)
        rows = _NO_LINKS if links is None else link_rows(links, self._carried)
        tables = (self.tables[0], rows, *self.tables[1:])
        line = shape.positions, shape.arc_length, self.radius
        reach = self.horizon if swell is None else self.horizon + float(swell.max())
        status = bounds.closest_points(*line, reach, self.grip_exclusion, self.cull, *tables, result, counts)
        if status != bounds.OK:
            raise ArgumentError.of("shape.positions", "NaN or infinity", "they must be finite", "Look at its status.")
        if swell is not None:
            self._swell(shape, swell, tables, result)
        near = [
            BodyDistance(self.names[i], row[0], row[1], result[i, 2:5], result[i, 5:8])
            for i, row in enumerate(result[:, :2].tolist())
            if row[0] != np.inf
        ]
        return Clearance(
            bodies=tuple(near),
            beyond=np.inf if len(near) == checked else self.horizon,
            robot_checked=links is not None,
            pairs_culled=int(counts[0]),
            pairs_exact=int(counts[1]),
            table=result,
        )

    def _swell(self, shape: CableShape, swell: Array, tables: tuple[Array, ...], result: Array) -> None:
        """Makes the rows those of a swollen cable, but for bodies on which the cable rests, whatever its error."""
        touched = {shape.bodies[int(row)] for row in shape.touches[:, 1].tolist()}
        resting = [i for i, name in enumerate(self.names) if name in touched]
        kept = result[resting]
        line = shape.positions, shape.arc_length, self.radius
        swollen.closest_points(*line, np.ascontiguousarray(swell), self.grip_exclusion, *tables, result)
        result[resting] = kept
        result[result[:, 0] > self.horizon] = _BEYOND


_NO_LINKS: Array = np.empty((0, 7))
_BEYOND: Array = np.array((math.inf, *(bounds.RESULT_COLUMNS - 1) * (math.nan,)))
