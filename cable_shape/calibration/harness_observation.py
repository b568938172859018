"""One look at a harness between its grips: :class:`HarnessObservation`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness, run_of
from cable_shape.calibration.observation import numbers_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.scene.scene import Scene
from cable_shape.solve.harness_problem import End

_WRITE_POINTS = "Write {'a': points, 'b+c': points}, where 'b+c' is on whichever of the two is nearer."


@final
class HarnessObservation:
    """Points seen on a harness at rest, or moving with a known acceleration, and where it was held.

    Parameters
    ----------
    ends : mapping of open end to Pose, Grip or FreeEnd
        As for a prediction. A grip whose roll was not measured is a "swivel".
    points : mapping of segments to (m, 3) array_like
        [m], world, on the centreline, in any order; rows with NaN are left out. The key is a segment, or several joined
        by "+", such as those of a trunk: a point is then on whichever of them is nearest.
    arc_length : mapping of segments to (m,) array_like, optional
        [m], by the same keys, along these segments one after the other; NaN: not known, and the closest point is taken.
    acceleration : mapping of segment to (3,) or (k, 3) array_like, optional
        [m/s^2], see :meth:`cable_shape.Predictor.predict`.
    lengths : mapping of segment to float, optional
        [m], of segments that were not as long then as the harness says: held, or marked, elsewhere.
    scene : Scene, optional
        Its clips held the harness then; with ``contact="solve"`` it may have lain on its obstacles.
    group : int, optional
        Observations of one recording share what the model does not know: give them the same number. Default: every
        observation for itself.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    __slots__ = ("acceleration", "arc_length", "ends", "group", "lengths", "points", "scene")

    ends: dict[str, End]
    points: dict[str, Array]
    arc_length: dict[str, Array]
    acceleration: dict[str, Array] | None
    lengths: dict[str, float]
    scene: Scene | None
    group: int | None

    def __init__(
        self,
        ends: Mapping[str, End],
        points: Mapping[str, ArrayLike],
        arc_length: Mapping[str, ArrayLike] | None = None,
        acceleration: Mapping[str, ArrayLike] | None = None,
        lengths: Mapping[str, float] | None = None,
        scene: Scene | None = None,
        group: int | None = None,
    ) -> None:
        checks.instance("ends", ends, (Mapping,), "Write {'a.start': Pose(...), ...}.")
        checks.instance("points", points, (Mapping,), _WRITE_POINTS)
        known = checks.mapping("arc_length", arc_length, points, "Write {segment: arc lengths}.")
        self.ends = dict(ends)
        self.points, self.arc_length = {}, {}
        for key, value in points.items():
            seen, arc = _seen(key, value, known.get(key))
            if len(seen):
                self.points[key], self.arc_length[key] = seen, arc
        if not self.points:
            raise ArgumentError.of("points", sorted(points), "one point at least must be finite", "Leave it out.")
        self.acceleration = None
        if acceleration is not None:
            checks.instance("acceleration", acceleration, (Mapping,), "Write {segment: acceleration}.")
            self.acceleration = {key: numbers_of(f"acceleration[{key!r}]", a) for key, a in acceleration.items()}
        given = {} if lengths is None else lengths
        checks.instance("lengths", given, (Mapping,), "Write {segment: length}.")
        self.lengths = {
            key: checks.number(f"lengths[{key!r}]", length, above=0.0, unit="m") for key, length in given.items()
        }
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(clips=[...]).")
        self.scene = scene
        self.group = None if group is None else checks.integer("group", group, at_least=0, at_most=2**62)

    @property
    def lies(self) -> bool:
        """Whether the harness may have lain on bodies."""
        return self.scene is not None and self.scene.contact == "solve" and bool(self.scene.obstacles)

    @property
    def supports(self) -> tuple[object, ...]:
        """What its scene holds and hangs on the harness, but for where in space; equal for observations alike."""
        if self.scene is None:
            return ()
        clips = ((clip.segment, clip.arc_length, clip.kind, clip.link, clip.name) for clip in self.scene.clips)
        masses = ((mass.segment, mass.arc_length, mass.mass) for mass in self.scene.masses)
        return (*clips, *masses)

    def check(self, harness: Harness) -> None:
        """Refuses segments that the harness does not have."""
        for key in self.points:
            for segment in run_of(key, harness):
                if segment not in harness.segments:
                    raise UnknownKeyError.among("points", segment, harness.segments)
        for name, given in (("acceleration", self.acceleration), ("lengths", self.lengths)):
            checks.known_keys(name, given or {}, harness.segments)


def _seen(key: object, value: ArrayLike, arc_length: ArrayLike | None) -> tuple[Array, Array]:
    """Finite points (m, 3), and where they are (m,)."""
    checks.word("points", key)
    name = f"points[{key!r}]"
    seen = numbers_of(name, value)
    if seen.ndim != 2 or seen.shape[1] != 3:
        raise ArgumentError.of(name, f"shape {seen.shape}", "it must be (m, 3)", "Give one row x, y, z a point.")
    arc = np.full(len(seen), math.nan) if arc_length is None else numbers_of(f"arc_length[{key!r}]", arc_length)
    if arc.shape != (len(seen),):
        remedy = "Give one number a point, NaN where it is not known."
        raise ArgumentError.of(f"arc_length[{key!r}]", f"shape {arc.shape}", f"it must be ({len(seen)},)", remedy)
    if (arc < 0.0).any():
        remedy = "It counts from the start of the first segment named."
        raise ArgumentError.of(f"arc_length[{key!r}]", float(np.nanmin(arc)), "it must be at least 0 m", remedy)
    whole = np.isfinite(seen).all(axis=1)
    return np.ascontiguousarray(seen[whole]), np.ascontiguousarray(arc[whole])
