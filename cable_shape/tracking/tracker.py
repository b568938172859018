"""The cable as it is seen: :class:`Tracker`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import GRAVITY
from cable_shape.tracking.filter import Ends, Filter, Known, spread_of
from cable_shape.tracking.fit import Fit, Noise
from cable_shape.tracking.rod import Rod
from cable_shape.tracking.start import paths, poses
from cable_shape.tracking.unknown import Unknown
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

#: What is not known of a cable of which nothing is said: logarithm of EI, share of the length; of its grips m, rad.
STIFFNESS, LENGTH, GRIP = 0.5, 0.005, (0.003, 0.05)
#: Of a cable of which something is: bends beside it times the length; else.
BENDS, BENDS_OF_ANY = 0.5, 0.8
#: Shares of the length: what the centreline of a rod with the right numbers is off by on a piece of it, and the
#: quantile of all that real cables are off by.
MODEL, MISSES = 0.001, 0.012
#: Places of the swing.
ROWS = 5
#: m/s^2: how a cable swings of which no look was had yet.
SWING = 1.0
#: Twice the logarithm of how much likelier points must be with the cable than without.
EVIDENCE = 30.0
#: [s] without a point on the cable after which it is lost.
PATIENCE = 0.5
#: Of the innovation: above it this is another cable, or another shape of it.
ODD = 3.0
#: m and rad, of grips that were found among points.
_FOUND = (0.03, 0.4)
#: Points of a shape: pieces of the line that points are compared with.
_FEWEST, _MOST = 11, 1001


class _Look(NamedTuple):
    """What came of one look."""

    fit: Fit
    ends: Ends
    expected: Known
    seen: tuple[bool, bool]
    evidence: float


@final
class Tracker:
    """Follows one cable by points that a camera sees of it, in any order, with stray ones, hidden stretches, or none.

    The shape is always the rod's own: what is fitted is what is not known of it, the grips' errors, the numbers of the
    cable, bends along it, and how it swings. Where nobody sees it, it is as likely as the physics says, and the tube
    is as wide.

    Parameters
    ----------
    cable : Cable
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

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    ODD = ODD  #: [1], innovation above which this is another cable

    def __init__(
        self,
        cable: Cable,
        scene: Scene | None = None,
        *,
        uncertainty: Uncertainty | None = None,
        noise: float = 0.005,
        outliers: float = 0.1,
        gravity: ArrayLike = GRAVITY,
        points: int = 101,
        segment: Callable[[Any], ArrayLike] | None = None,
    ) -> None:
        checks.instance("cable", cable, (Cable,), "Write Cable(length=..., ...); harnesses are not tracked.")
        bends = BENDS if uncertainty is not None else BENDS_OF_ANY
        if uncertainty is None:
            spread = {"bending_stiffness": STIFFNESS, "length": LENGTH * cable.length}
            uncertainty = Uncertainty(spread, GRIP, GRIP, misses=MISSES * cable.length)
        checks.instance("uncertainty", uncertainty, (Uncertainty,), "Write Uncertainty({...}), or leave it out.")
        if segment is not None and not callable(segment):
            raise ArgumentError.of("segment", segment, "it must be callable", "Give a function of an image, or None.")
        noise = checks.number("noise", noise, above=0.0, unit="m")
        outliers = checks.number("outliers", outliers, above=0.0)
        if outliers >= 1.0:
            raise ArgumentError.of("outliers", outliers, "it must be below 1", "Give a share, 0.1 for a tenth.")
        points = checks.integer("points", points, at_least=_FEWEST, at_most=_MOST)
        self.cable, self.uncertainty, self._segment = cable, uncertainty, segment
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
        if cable.mean_bending_stiffness == 0.0:
            remedy = "Give EI in N m^2, however small it is."
            raise ArgumentError.of("bending_stiffness", 0.0, "the tracker needs it above 0 N m^2", remedy)
        resting = scene is not None and scene.contact == "solve"
        unknown = Unknown(cable, uncertainty, 0 if resting else ROWS, bends if not cable.sections else 0.0)
        options = {"gravity": gravity, "scene": scene, "points": points, "tolerance": 1e-5 * cable.length}
        rod = Rod(cable, unknown, **options)
        self._noise = Noise(noise, MODEL * cable.length, outliers, cable.length**3)
        self._filter = Filter(rod, self._noise, SWING)
        self.reset()

    def reset(self) -> None:
        """Forgets all looks: the next one starts from nothing."""
        self._filter.reset()
        self._stamp: int | None = None
        self._on_it: int | None = None  # stamp of the last look with points on the cable
        self._ends: Ends | None = None
        self._tube: Tube | None = None
        self.lost = True  #: whether it is not known where the cable is: no point was on it of late
        self.innovation = math.nan  #: [1], how far the last look was from what was expected; above 3: not this cable

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
    def ends(self) -> Ends | None:
        """Both grips of the last look, those that are only seen where they were found; None: they were not yet."""
        return self._ends

    def update(
        self,
        points: Any,
        *,
        stamp: int,
        start: Pose | Grip | None = None,
        end: Pose | Grip | FreeEnd | None = None,
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
        stamp = checks.stamp(stamp, self._stamp)
        cloud = _cloud(points if self._segment is None else self._segment(points))
        near = None if start is None else as_grip("start", start)
        far = end if isinstance(end, FreeEnd) or end is None else as_grip("end", end)
        seen = near is None, far is None
        look = self._look(cloud, stamp, near, far, seen)
        self._stamp = stamp
        if look is None:
            return self._nothing(len(cloud))
        self._ends = self._filter.take(look.fit, look.ends, look.expected, seen)
        found = look.evidence >= EVIDENCE
        self._on_it = stamp if found else self._on_it
        waited = math.inf if self._on_it is None else 1e-9 * (stamp - self._on_it)
        self.lost = not found and (len(cloud) > 0 or waited > PATIENCE)
        self.innovation = self._odd(look) if found else (math.inf if len(cloud) else math.nan)
        covariance = spread_of(look.fit, look.fit.covariance, self._noise.model)
        shape = look.fit.shape
        radius = self.uncertainty.radius(covariance, shape.tangents)
        self._tube = Tube(shape, covariance, radius, self.uncertainty.confidence, 0.0)
        return shape

    def predicted(
        self, *, stamp: int, start: Pose | Grip | None = None, end: Pose | Grip | FreeEnd | None = None
    ) -> CableShape:
        """The shape to be expected at a stamp [ns] not before the last, with the grips there; no look is counted.

        Raises
        ------
        ArgumentError, StaleInputError
            As `update`, and where a grip is neither told nor was ever.
        """
        stamp = checks.stamp(stamp, self._stamp)
        seen = start is None, end is None
        last: tuple[Any, Any] = self._ends or (None, None)
        near, far = start if start is not None else last[0], end if end is not None else last[1]
        if near is None or far is None:
            raise ArgumentError("start and end are not known: no look was had yet. Give both, or call update first.")
        ends = as_grip("start", near), far if isinstance(far, FreeEnd) else as_grip("end", far)
        return self._filter.rod.solve(self._filter.expected(stamp, seen).mean, *ends)

    def _look(
        self, cloud: Array, stamp: int, near: Grip | None, far: Grip | FreeEnd | None, seen: tuple[bool, bool]
    ) -> _Look | None:
        """The best of: going on from the last look, and if that does not explain this one, beginning anew."""
        last = self._ends
        start = near if near is not None else None if last is None else last[0]
        end = far if far is not None else None if last is None else last[1]
        looks = []
        if start is not None and end is not None:
            went_on = self._tried(cloud, (start, end), self._filter.expected(stamp, seen), seen)
            if went_on is not None and not len(cloud):
                return went_on
            looks += [] if went_on is None else [went_on]
            if went_on is not None and went_on.evidence >= EVIDENCE and self._odd(went_on) < ODD:
                return went_on
        looks += self._from_nothing(cloud, stamp, near, far, seen)
        best = max(looks, key=lambda look: look.evidence, default=None)
        if best is not None and best.evidence >= EVIDENCE:
            return best
        if start is None or end is None:
            return None
        self._filter.rod.reset()
        return self._tried(np.empty((0, 3)), (start, end), self._filter.expected(stamp, seen), seen)

    def _tried(self, cloud: Array, ends: Ends, expected: Known, seen: tuple[bool, bool]) -> _Look | None:
        """One fit."""
        fit = self._filter.fit(cloud, ends, expected, seen)
        if fit is None:
            self._filter.rod.reset()
            fit = self._filter.fit(cloud, ends, expected, seen)
        if fit is None:
            return None
        without = -2.0 * len(cloud) * math.log(self._noise.outside)
        return _Look(fit, ends, expected, seen, without - fit.cost - fit.shift)

    def _from_nothing(
        self, cloud: Array, stamp: int, near: Grip | None, far: Grip | FreeEnd | None, seen: tuple[bool, bool]
    ) -> list[_Look]:
        """Fits that know of no look before."""
        unknown = self._filter.unknown
        expected = Known(stamp, np.zeros(unknown.size), unknown.covariance(SWING), SWING)
        ends: list[Ends] = []
        if near is not None and far is not None:
            ends.append((near, far))
        else:
            for end, first in enumerate((0, 6)):
                if seen[end]:
                    own = slice(first, first + 6)
                    expected.covariance[own, own] = np.diag(np.repeat(np.square(_FOUND), 3))
            for line in paths(cloud, self.cable.length):
                first_pose, last_pose = poses(line, self.cable.length)
                ends.append((near or Grip(first_pose), far or Grip(last_pose)))
        looks = []
        for one in ends:
            self._filter.rod.reset()
            look = self._tried(cloud, one, expected, seen)
            looks += [] if look is None else [look]
        return looks

    def _odd(self, look: _Look) -> float:
        """[1], root mean square of what a look differs by from what was expected, in standard deviations."""
        fit, unknown = look.fit, self._filter.unknown
        drawn = 0.0
        for own in unknown.parts:
            first = unknown.first[own, own]
            if np.diag(first).all() and not (own.start < 12 and look.seen[own.start // 6]):
                drawn = max(drawn, float(fit.z[own] @ np.linalg.pinv(first, hermitian=True) @ fit.z[own]) / len(first))
        jump = fit.shift / max(fit.directions, 1.0)
        left = fit.residual / max(2.0 * fit.pieces, 1.0)
        return math.sqrt(max(drawn, jump, left))

    def _nothing(self, count: int) -> CableShape:
        """What is said where nobody knows where the cable is."""
        self.lost, self.innovation = True, math.inf if count else math.nan
        n = self._filter.rod.points
        buffer = np.full(CableShape.new_buffer(n).shape, math.nan)
        buffer[:n] = np.linspace(0.0, self.cable.length, n)
        detail = "Nobody knows where the grips are: no line as long as the cable is among the points. "
        detail += "Give start and end once, or points all along the cable."
        shape = CableShape(
            buffer, n, length=self.cable.length, model="cosserat", status=Status.NOT_CONVERGED, detail=detail,
            error_estimate=math.inf,
        )  # fmt: skip
        empty = np.full((n, 3, 3), math.nan)
        self._tube = Tube(shape, empty, np.full(n, math.nan), self.uncertainty.confidence, math.nan)
        return shape


def _cloud(points: Any) -> Array:
    """(n, 3), finite."""
    remedy = "Give (n, 3) in m, world, rows that are NaN left out; np.empty((0, 3)) where nothing is seen."
    a = checks.numbers("points", points, remedy)
    if a.size == 0 and a.ndim <= 2:
        return np.empty((0, 3))
    if a.ndim != 2 or a.shape[1] != 3:
        raise ArgumentError.of("points", f"shape {a.shape}", "it must be (n, 3)", remedy)
    bad = ~(np.abs(a) <= checks.MOST).all(axis=1)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        bound = f"every entry must be finite, none above {checks.MOST:g}"
        raise ArgumentError.of(f"points[{row}]", a[row].tolist(), bound, remedy)
    return a
