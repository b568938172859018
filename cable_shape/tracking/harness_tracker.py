"""The harness as it is seen: :class:`HarnessTracker`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, as_grip
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import Obstacle
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY
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
)
from cable_shape.tracking.harness_rod import HarnessRod
from cable_shape.tracking.harness_unknown import HarnessUnknown
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

_WRITE = "Write {'a.start': Pose(...), ...}."


@final
class HarnessTracker(Following):
    """Follows one harness by points that a camera sees of it: what ``Tracker(harness)`` makes.

    The points are those of all segments, in any order; which of them each is of is found again at each look. Parameters
    are those of :class:`cable_shape.Tracker` but for these:

    harness : Harness
    scene : Scene, optional
        Clips, eyelets among them, and masses, which name their `segment`; with ``contact="solve"`` it rests on the
        bodies, and does not swing.
    uncertainty : Uncertainty, optional
        Names are those of harnesses. Default: EI of each segment by half, its length by 0.5 %, the grips by 3 mm and
        0.05 rad, and misses of 1.2 % of the longest segment.
    points : int
        Of each segment.
    """

    def __init__(
        self,
        harness: Harness,
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
        checks.instance("harness", harness, (Harness,), "Write Harness(segments={...}, junctions=[...]).")
        bends = BENDS if uncertainty is not None else BENDS_OF_ANY
        if uncertainty is None:
            spread = {f"length:{name}": LENGTH * cable.length for name, cable in harness.segments.items()}
            spread["bending_stiffness:each"] = STIFFNESS
            uncertainty = Uncertainty(spread, GRIP, GRIP, misses=MISSES * harness.longest)
        checks.instance("uncertainty", uncertainty, (Uncertainty,), "Write Uncertainty({...}), or leave it out.")
        points = checks.integer("points", points, at_least=FEWEST, at_most=MOST)
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(clips=[...]), or Scene.from_yaml(path).")
        self.harness = harness
        resting = scene is not None and scene.contact == "solve"
        unknown = HarnessUnknown(harness, uncertainty, bends, swings=not resting)
        options: dict[str, Any] = {
            "gravity": gravity, "scene": scene, "points": points, "tolerance": 1e-5 * harness.longest,
            "robot_links": checks.entries("robot_links", robot_links, Obstacle),
            "gripping_links": checks.entries("gripping_links", gripping_links, str, "Give a list of link names."),
        }  # fmt: skip
        super().__init__(HarnessRod(harness, unknown, **options), uncertainty, noise, outliers, segment)
        self._one = points

    def reset(self) -> None:
        """Forgets all looks: the next one starts from nothing."""
        super().reset()
        self._tubes: dict[str, Tube] | None = None

    @property
    def tube(self) -> dict[str, Tube]:
        """The shape of each segment, by its name, with its covariance, at the last look.

        Raises
        ------
        ArgumentError
            Before the first `update`.
        """
        if self._tubes is None:
            raise ArgumentError("tube: there is no look yet. Call update first.")
        return self._tubes

    @property
    def ends(self) -> dict[str, Grip | FreeEnd] | None:
        """The open ends at the last look, those that are only seen where they were found; None: there was none yet."""
        return None if self._ends is None else dict(self._ends)

    def update(
        self, points: Any, *, stamp: int, ends: Mapping[str, End] | None = None, links: Links = None
    ) -> HarnessShape:
        """The shape for points seen at a stamp.

        Parameters
        ----------
        points : (n, 3) array_like
            [m], world, of all segments, in any order; none: (0, 3). With a `segment` whatever that takes.
        stamp : int
            [ns], when they were seen, not before the last.
        ends : mapping of open end to Pose, Grip or FreeEnd
            Where the grips were then. An end that was held before and is not named is followed by what is seen; one
            that never was is free.
        links : mapping of robot link to its Pose in the world, optional
            Where they were then, as of `Tracker.update`.

        Returns
        -------
        HarnessShape
            Look at `lost`, too. NOT_CONVERGED as long as no end was told.

        Raises
        ------
        ArgumentError
            For points that are no (n, 3) finite numbers, ends that the harness does not have, and other wrong
            arguments.
        StaleInputError
            If the stamp goes backwards.
        """
        told = self._told(ends)
        found = None
        if self._stands(told):
            found = self.followed(points, stamp, told, links)
        else:
            self._stamp = checks.stamp(stamp, self._stamp)
        if found is None:
            return self._nowhere()
        self._tubes = self._tubes_of(*found)
        shape: HarnessShape = found[0]
        return shape

    def predicted(self, *, stamp: int, ends: Mapping[str, End] | None = None, links: Links = None) -> HarnessShape:
        """The shape to be expected at a stamp [ns] not before the last, with grips and links there; no look is counted.

        Raises
        ------
        ArgumentError, StaleInputError
            As `update`, and where no grip is told nor was ever.
        """
        return self.expected(stamp, ends, links)[0]

    def expected(
        self, stamp: int, ends: Mapping[str, End] | None = None, links: Links = None, *, tube: bool = True
    ) -> tuple[HarnessShape, dict[str, Tube] | None]:
        """The same, and the tubes of its segments if they are asked for; None where there is no usable shape."""
        shape, known = self.ahead(stamp, self._told(ends), links)
        return shape, self._tubes_of(shape, self.spread_ahead(known)) if tube and shape.status else None

    def _told(self, ends: Mapping[str, End] | None) -> Told:
        """What is told of every open end."""
        given = {} if ends is None else ends
        checks.instance("ends", given, (Mapping,), _WRITE)
        checks.known_keys("ends", given, self.harness.open_ends)
        last = self._ends or {}
        told: dict[str, Grip | FreeEnd | None] = {}
        for name in self.harness.open_ends:
            end = given.get(name)
            if end is None:
                told[name] = None if isinstance(last.get(name), Grip) else FreeEnd()
            else:
                told[name] = end if isinstance(end, FreeEnd) else as_grip(name, end)
        return told

    def _stands(self, told: Told) -> bool:
        """Whether any end is held, or was; a clip may hold the rest."""
        return any(end is None or isinstance(end, Grip) for end in told.values())

    def _tubes_of(self, shape: HarnessShape, covariance: Array) -> dict[str, Tube]:
        known, out = self.uncertainty, {}
        for i, (name, one) in enumerate(shape.segments.items()):
            own = covariance[i * self._one : (i + 1) * self._one]
            out[name] = Tube(one, own, known.radius(own, one.tangents), known.confidence, 0.0)
        return out

    def _nowhere(self) -> HarnessShape:
        """What is said where nobody knows where the harness is."""
        n, harness = self._one, self.harness
        buffer = np.full((len(harness.segments), NUMBERS_PER_POINT * n), math.nan)
        for row, cable in zip(buffer, harness.segments.values(), strict=True):
            row[:n] = np.linspace(0.0, cable.length, n)
        detail = "Nobody knows where the grips are. Give ends once."
        shape = HarnessShape(harness, buffer.ravel(), n, model="cosserat", status=Status.NOT_CONVERGED, detail=detail)
        empty, wide = np.full((n, 3, 3), math.nan), np.full(n, math.nan)
        confidence = self.uncertainty.confidence
        self._tubes = {name: Tube(one, empty, wide, confidence) for name, one in shape.segments.items()}
        return shape
