"""What trackers of cables and of harnesses have in common: :class:`Following`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.shape import CableShape, Status
from cable_shape.tracking.filter import Filter, Known, Seen, spread_of
from cable_shape.tracking.fit import Fit, Noise
from cable_shape.tracking.harness_rod import HarnessRod
from cable_shape.tracking.rod import Ends, Rod
from cable_shape.uncertainty.uncertainty import Uncertainty

#: What is not known of a cable of which nothing is said: logarithm of EI, share of the length; of its grips m, rad.
STIFFNESS, LENGTH, GRIP = 0.5, 0.005, (0.003, 0.05)
#: Of a cable of which something is: bends beside it times the length; else.
BENDS, BENDS_OF_ANY = 0.5, 0.8
#: Shares of the length: what the centreline of a rod with the right numbers is off by on a piece of it, and the
#: quantile of all that real cables are off by.
MODEL, MISSES = 0.001, 0.012
#: m/s^2: how a cable swings of which no look was had yet.
SWING = 1.0
#: Twice the logarithm of how much likelier points must be with the cable than without.
EVIDENCE = 30.0
#: [s] without a point on the cable after which it is lost.
PATIENCE = 0.5
#: Of the innovation: above it this is another cable, or another shape of it.
ODD = 3.0
#: Points of a shape, of each segment: pieces of the line that points are compared with.
FEWEST, MOST = 11, 1001

Told = Mapping[str, Grip | FreeEnd | None]
Links = Mapping[str, Pose] | None


class Look(NamedTuple):
    """What came of one look."""

    fit: Fit
    ends: Ends
    expected: Known
    seen: Seen
    evidence: float
    here: Any  # where the rod is with it, see `Trail`


class Following:
    """Looks at one thing made of rods, one after the other.

    Parameters
    ----------
    rod : Rod or HarnessRod
    uncertainty : Uncertainty
        Of which tubes are made.
    noise, outliers, segment
        Those of :class:`cable_shape.Tracker`.
    """

    ODD = ODD  #: [1], innovation above which this is another cable

    def __init__(
        self,
        rod: Rod | HarnessRod,
        uncertainty: Uncertainty,
        noise: float,
        outliers: float,
        segment: Callable[[Any], ArrayLike] | None,
    ) -> None:
        noise = checks.number("noise", noise, above=0.0, unit="m")
        outliers = checks.number("outliers", outliers, above=0.0)
        if outliers >= 1.0:
            raise ArgumentError.of("outliers", outliers, "it must be below 1", "Give a share, 0.1 for a tenth.")
        if segment is not None and not callable(segment):
            raise ArgumentError.of("segment", segment, "it must be callable", "Give a function of an image, or None.")
        self.uncertainty, self._segment = uncertainty, segment
        self._noise = Noise(noise, MODEL * rod.longest, outliers, rod.length**3)
        self._filter = Filter(rod, self._noise, SWING)
        first = rod.unknown.first
        self._precisions = [
            (own, np.linalg.pinv(first[own, own], hermitian=True))
            for own in rod.unknown.parts
            if np.diag(first)[own].all()
        ]
        self.reset()

    def reset(self) -> None:
        """Forgets all looks: the next one starts from nothing."""
        self._filter.reset()
        self._stamp: int | None = None
        self._on_it: int | None = None  # stamp of the last look with points on the cable
        self._ends: Ends | None = None
        self.lost = True  #: whether it is not known where the cable is: no point was on it of late
        self.innovation = math.nan  #: [1], how far the last look was from what was expected; above 3: not this cable

    def followed(self, points: Any, stamp: int, told: Told, links: Links) -> tuple[Any, Array] | None:
        """The shape for points seen at a stamp [ns], and its covariance (n, 3, 3) [m^2]; None: nobody knows.

        told: of each end what holds it; None: that is only seen. links: where the robot's links were then.
        """
        self._filter.rod.links = links
        stamp = checks.stamp(stamp, self._stamp)
        cloud = cloud_of(points if self._segment is None else self._segment(points))
        seen = frozenset(name for name, end in told.items() if end is None)
        look = self._look(cloud, stamp, told, seen)
        self._stamp = stamp
        if look is None:
            self.lost, self.innovation = True, math.inf if len(cloud) else math.nan
            return None
        self._ends = self._filter.take(look.fit, look.ends, look.expected, seen)
        found = look.evidence >= EVIDENCE
        self._on_it = stamp if found else self._on_it
        waited = math.inf if self._on_it is None else 1e-9 * (stamp - self._on_it)
        self.lost = not found and (len(cloud) > 0 or waited > PATIENCE)
        self.innovation = self._odd(look) if found else (math.inf if len(cloud) else math.nan)
        return look.fit.shape, spread_of(look.fit.moves, look.fit.covariance, self._noise.model)

    def ahead(self, stamp: int, told: Told, links: Links) -> tuple[Any, Known]:
        """The shape to be expected at a stamp [ns] not before the last, with the grips there; what is known then."""
        stamp = checks.stamp(stamp, self._stamp)
        seen = frozenset(name for name, end in told.items() if end is None)
        ends = self._all_of(told)
        if ends is None:
            raise ArgumentError("start and end are not known: no look was had yet. Give both, or call update first.")
        known = self._filter.expected(stamp, seen)
        self._filter.rod.links = links
        return self._filter.rod.solve(known.mean, ends), known

    def spread_ahead(self, known: Known) -> Array:
        """(n, 3, 3) [m^2], of the shape that `ahead` has just given."""
        return spread_of(self._filter.rod.moves(), known.covariance, self._noise.model)

    @property
    def rod_state(self) -> Any:
        """The solver's memory of the last shape; None: there is none."""
        return self._filter.rod.trail.memory

    def _all_of(self, told: Told) -> Ends | None:
        """What is told, and the last of what is not; None where there is none yet."""
        last = self._ends or {}
        ends = {name: end if end is not None else last.get(name) for name, end in told.items()}
        return None if None in ends.values() else ends  # type: ignore[return-value]

    def guesses(self, cloud: Array, told: Told, seen: Seen, covariance: Array) -> Iterator[Ends]:
        """Ends between which the cable may be, the likeliest first, where nothing was known before.

        covariance (k, k): of what is not known then, to be made wider where ends are only guessed.
        """
        if not seen:
            yield {name: end for name, end in told.items() if end is not None}

    def _look(self, cloud: Array, stamp: int, told: Told, seen: Seen) -> Look | None:
        """The best of: going on from the last look, and if that does not explain this one, beginning anew."""
        ends, trail = self._all_of(told), self._filter.rod.trail
        looks, before = [], trail.here
        if ends is not None:
            went_on = self._tried(cloud, ends, self._filter.expected(stamp, seen), seen)
            if went_on is not None and not len(cloud):
                return went_on
            looks += [] if went_on is None else [went_on]
            if went_on is not None and went_on.evidence >= EVIDENCE and self._odd(went_on) < ODD:
                return went_on
        looks += self._from_nothing(cloud, stamp, told, seen)
        best = max(looks, key=lambda look: look.evidence, default=None)
        if best is not None and best.evidence >= EVIDENCE:
            if trail.here is not best.here:
                trail.go_to(best.here)
            return best
        trail.go_to(before)
        if ends is None:
            return None
        return self._tried(np.empty((0, 3)), ends, self._filter.expected(stamp, seen), seen)

    def _tried(self, cloud: Array, ends: Ends, expected: Known, seen: Seen) -> Look | None:
        """One fit."""
        fit = self._filter.fit(cloud, ends, expected, seen)
        if fit is None:
            self._filter.rod.trail.reset()
            fit = self._filter.fit(cloud, ends, expected, seen)
        if fit is None:
            return None
        without = -2.0 * len(cloud) * math.log(self._noise.outside)
        return Look(fit, ends, expected, seen, without - fit.cost - fit.shift, self._filter.rod.trail.here)

    def _from_nothing(self, cloud: Array, stamp: int, told: Told, seen: Seen) -> list[Look]:
        """Fits that know of no look before."""
        unknown = self._filter.unknown
        expected = Known(stamp, np.zeros(unknown.size), unknown.covariance(SWING), SWING)
        looks, trail = [], self._filter.rod.trail
        trail.follows = False
        try:
            for ends in self.guesses(cloud, told, seen, expected.covariance):
                trail.reset()
                look = self._tried(cloud, ends, expected, seen)
                looks += [] if look is None else [look]
        finally:
            trail.follows = True
        return looks

    def _odd(self, look: Look) -> float:
        """[1], root mean square of what a look differs by from what was expected, in standard deviations."""
        fit, unknown = look.fit, self._filter.unknown
        drawn = 0.0
        for own, inverse in self._precisions:
            if unknown.end_of(own) not in look.seen:
                drawn = max(drawn, float(fit.z[own] @ inverse @ fit.z[own]) / len(inverse))
        jump = fit.shift / max(fit.directions, 1.0)
        left = fit.residual / max(2.0 * fit.pieces, 1.0)
        return math.sqrt(max(drawn, jump, left))


def nothing(points: int, length: float, detail: str) -> CableShape:
    """What is said where nobody knows where a cable is."""
    buffer = np.full(CableShape.new_buffer(points).shape, math.nan)
    buffer[:points] = np.linspace(0.0, length, points)
    return CableShape(
        buffer, points, length=length, model="cosserat", status=Status.NOT_CONVERGED, detail=detail,
        error_estimate=math.inf,
    )  # fmt: skip


def cloud_of(points: Any) -> Array:
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
