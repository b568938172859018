"""The cable as it is seen: :class:`Tracker`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import Obstacle
from cable_shape.shape import CableShape
from cable_shape.solve.problem import GRAVITY
from cable_shape.tracking.filter import Seen
from cable_shape.tracking.following import (
    BENDS,
    BENDS_OF_ANY,
    FEWEST,
    GRIP,
    LENGTH,
    MISSES,
    MOST,
    STIFFNESS,
    Following,
    Links,
    Told,
    nothing,
)
from cable_shape.tracking.rod import Ends, Rod
from cable_shape.tracking.start import paths, poses
from cable_shape.tracking.unknown import Unknown
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

#: Places of the swing.
ROWS = 5
#: m and rad, of grips that were found among points.
_FOUND = (0.03, 0.4)


@final
class Tracker(Following):
    """Follows a cable by points that a camera sees of it, in any order, with stray ones, hidden stretches, or none.

    Of a :class:`cable_shape.Harness` it makes a :class:`.harness_tracker.HarnessTracker`.

    The shape is always the rod's own: what is fitted is what is not known of it, the grips' errors, the numbers of the
    cable, bends along it, and how it swings. Where nobody sees it, it is as likely as the physics says, and the tube
    is as wide.

    Parameters
    ----------
    cable : Cable or Harness
        As well as it is known; one of :func:`cable_shape.calibrate` is followed best.
    scene : Scene, optional
        Clips hold it, masses load it; with ``contact="solve"`` it rests on the bodies, and does not swing.
    uncertainty : Uncertainty, optional
        What is not known of cable and grips, and what the model misses. Default: EI by half, the length by 0.5 %, the
        grips by 3 mm and 0.05 rad, and misses of 1.2 % of the length, as of real cables.
    noise : float
        [m], standard deviation of a point about the centreline, in each direction across it: that of the camera, how
        thick the cable is, how a marker is mounted.
    outliers : float
        Share of points that are of something else, above 0 and below 1; a guess.
    gravity : (3,) array_like
        [m/s^2], world.
    points : int
        Number of points of the shapes, uniform in arc length.
    segment : callable, optional
        Makes points (n, 3) [m] of whatever `update` is given.
    robot_links, gripping_links
        Bodies on the robot's links, and which links hold the cable, as of :class:`cable_shape.Predictor`; with
        ``contact="solve"``.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __new__(cls, cable: Any, *args: Any, **keywords: Any) -> Any:
        """A tracker of harnesses for a harness."""
        if not isinstance(cable, Harness):
            return super().__new__(cls)
        from cable_shape.tracking.harness_tracker import HarnessTracker

        return HarnessTracker(cable, *args, **keywords)

    def __init__(
        self,
        cable: Cable | Harness,
        scene: Scene | None = None,
        *,
        uncertainty: Uncertainty | None = None,
        noise: float = 0.005,
        outliers: float = 0.1,
        gravity: ArrayLike = GRAVITY,
        points: int = 101,
        segment: Callable[[Any], ArrayLike] | None = None,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
    ) -> None:
        if not isinstance(cable, Cable):
            raise ArgumentError.of("cable", cable, "it must be a Cable or a Harness", "Write Cable(length=..., ...).")
        bends = BENDS if uncertainty is not None else BENDS_OF_ANY
        if uncertainty is None:
            spread = {"bending_stiffness": STIFFNESS, "length": LENGTH * cable.length}
            uncertainty = Uncertainty(spread, GRIP, GRIP, misses=MISSES * cable.length)
        checks.instance("uncertainty", uncertainty, (Uncertainty,), "Write Uncertainty({...}), or leave it out.")
        points = checks.integer("points", points, at_least=FEWEST, at_most=MOST)
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
        if cable.mean_bending_stiffness == 0.0:
            remedy = "Give EI in N m^2, however small it is."
            raise ArgumentError.of("bending_stiffness", 0.0, "the tracker needs it above 0 N m^2", remedy)
        self.cable = cable
        resting = scene is not None and scene.contact == "solve"
        unknown = Unknown(cable, uncertainty, 0 if resting else ROWS, bends if not cable.sections else 0.0)
        options: dict[str, Any] = {
            "gravity": gravity, "scene": scene, "points": points, "tolerance": 1e-5 * cable.length,
            "robot_links": checks.entries("robot_links", robot_links, Obstacle),
            "gripping_links": checks.entries("gripping_links", gripping_links, str, "Give a list of link names."),
        }  # fmt: skip
        super().__init__(Rod(cable, unknown, **options), uncertainty, noise, outliers, segment)

    def reset(self) -> None:
        """Forgets all looks: the next one starts from nothing."""
        super().reset()
        self._tube: Tube | None = None

    @property
    def tube(self) -> Tube:
        """The last shape with its covariance.

        Raises
        ------
        ArgumentError
            Before the first `update`.
        """
        if self._tube is None:
            raise ArgumentError("tube: there is no look yet. Call update first.")
        return self._tube

    @property
    def ends(self) -> tuple[Grip, Grip | FreeEnd] | None:
        """Both grips of the last look, those that are only seen where they were found; None: they were not yet."""
        if self._ends is None:
            return None
        return self._ends["start"], self._ends["end"]  # type: ignore[return-value]

    def update(
        self,
        points: Any,
        *,
        stamp: int,
        start: Pose | Grip | None = None,
        end: Pose | Grip | FreeEnd | None = None,
        links: Links = None,
    ) -> CableShape:
        """The shape for points seen at a stamp.

        Parameters
        ----------
        points : (n, 3) array_like
            [m], world, in any order; none: (0, 3). With a `segment` whatever that takes.
        stamp : int
            [ns], when they were seen, not before the last.
        start, end : Pose or Grip, optional
            Where the grips were then; None: that is only seen. `end` may be a FreeEnd.
        links : mapping of robot link to its Pose in the world, optional
            Where they were then: of clips on links, and of bodies on them if contact is solved for; without it these
            are left out.

        Returns
        -------
        CableShape
            Look at `lost`, too. NOT_CONVERGED as long as nobody knows where the grips are.

        Raises
        ------
        ArgumentError
            For points that are no (n, 3) finite numbers, and other wrong arguments.
        StaleInputError
            If the stamp goes backwards.
        """
        found = self.followed(points, stamp, _told(start, end), links)
        if found is None:
            n = self._filter.rod.points
            detail = "Nobody knows where the grips are: no line as long as the cable is among the points. "
            detail += "Give start and end once, or points all along the cable."
            shape = nothing(n, self.cable.length, detail)
            self._tube = Tube(shape, np.full((n, 3, 3), np.nan), np.full(n, np.nan), self.uncertainty.confidence)
            return shape
        self._tube = self._tube_of(*found)
        return self._tube.shape

    def predicted(
        self,
        *,
        stamp: int,
        start: Pose | Grip | None = None,
        end: Pose | Grip | FreeEnd | None = None,
        links: Links = None,
    ) -> CableShape:
        """The shape to be expected at a stamp [ns] not before the last, with grips and links there; no look is counted.

        Raises
        ------
        ArgumentError, StaleInputError
            As `update`, and where a grip is neither told nor was ever.
        """
        return self.expected(stamp, start, end, links)[0]

    def expected(
        self,
        stamp: int,
        start: Pose | Grip | None = None,
        end: Pose | Grip | FreeEnd | None = None,
        links: Links = None,
        *,
        tube: bool = True,
    ) -> tuple[CableShape, Tube | None]:
        """The same, and its tube if that is asked for; None where there is no usable shape."""
        shape, known = self.ahead(stamp, _told(start, end), links)
        return shape, self._tube_of(shape, self.spread_ahead(known)) if tube and shape.status else None

    def _tube_of(self, shape: CableShape, covariance: Array) -> Tube:
        radius = self.uncertainty.radius(covariance, shape.tangents)
        return Tube(shape, covariance, radius, self.uncertainty.confidence, 0.0)

    def guesses(self, cloud: Array, told: Told, seen: Seen, covariance: Array) -> Iterator[Ends]:
        """See `Following`: both ways of the longest way through the points."""
        if not seen:
            yield from super().guesses(cloud, told, seen, covariance)
            return
        for name in seen:
            own = self._filter.unknown.grips[name]
            covariance[own, :] = covariance[:, own] = 0.0
            covariance[own, own] = np.diag(np.repeat(np.square(_FOUND), 3))
        for line in paths(cloud, self.cable.length):
            first, last = poses(line, self.cable.length)
            yield {"start": told["start"] or Grip(first), "end": told["end"] or Grip(last)}


def _told(start: Pose | Grip | None, end: Pose | Grip | FreeEnd | None) -> Told:
    """What is told of both ends."""
    far = end if isinstance(end, FreeEnd) or end is None else as_grip("end", end)
    return {"start": None if start is None else as_grip("start", start), "end": far}


_MADE_FROM = inspect.signature(Tracker.__init__)
_MADE_FROM = _MADE_FROM.replace(parameters=list(_MADE_FROM.parameters.values())[1:])
Tracker.__signature__ = _MADE_FROM  # type: ignore[attr-defined]  # not that of __new__
