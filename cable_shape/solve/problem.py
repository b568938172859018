"""What a model is asked to solve: :class:`Problem`, built once and moved every cycle."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, as_grip
from cable_shape.scene.body_tables import carried_by, clip_frames, link_rows
from cable_shape.scene.scene import Clip, Obstacle, PointMass, Scene
from cable_shape.scene.scene_parts import clip_names

#: Default `tolerance` / length, of the discretisation; and that of a tail, whose place is all that is asked of it.
NAMED_TOLERANCE, TAIL_TOLERANCE = 1e-5, 1e-3
MIN_POINTS, MAX_POINTS = 2, 100_000
#: Rows of a table of accelerations: every kink is a node of the rod.
MAX_ACCELERATIONS = 200
#: And of velocities at least: their second derivative counts.
FEWEST_VELOCITIES = 4
#: A kink that turns an acceleration by less than this fraction of the largest is rounding: of positions, too, that were
#: differenced twice.
_STRAIGHT = 1e-9
#: Clips are at least this fraction of the length apart from each other and from the grips.
CLIP_SPACING = 1e-3
#: m/s^2, world: the default
GRAVITY = (0.0, 0.0, -9.81)
_GRAVITY: Array = np.array(GRAVITY)
_GRAVITY.flags.writeable = False
_UNLOADED = FreeEnd()
_NOWHERE = Grip(Pose())
_NO_PLACES: Array = np.empty(0)
_NO_FORCES: Array = np.empty((0, 3))
_NO_LINKS: Array = np.empty((0, 7))


class Problem:
    """One cable between two ends, under its loads; the ends may move, the rest stays.

    Attributes
    ----------
    cable : Cable
    gravity : (3,) [m/s^2]
    points : int
    tolerance : float [m], largest position error allowed
    load : (2, 3) [N/m], world: weight, inertia and distributed load at s = 0 and s = length, linear between
    acceleration : (m, 3) [m/s^2], m >= 2, world: of the cable, uniform in arc length; None: at rest
    velocity : (m, 3) [m/s], m >= 4, world: of the cable, uniform in arc length; None: at rest, or not known
    lag : (m, 3) [1/(m^3 s)], load of its damping, see :mod:`cable_shape.solve.moving`; None: it has none
    swing : (m, 3) [m/s^2], what the acceleration that loads it as its own, drag and damping do has beyond the line from
        its first to its last row; None: nothing
    load_arc_length : (k,) [m], ascending, of the concentrated loads
    load_force : (k, 3) [N], world, of the concentrated loads (weights of point masses)
    masses : the point masses behind the concentrated loads
    clips : what holds the cable between its ends, in ascending arc length
    retraction : (k,) [N], by which each of them draws the cable towards its start
    bodies : what the cable is kept out of in the equilibrium: first the bodies fixed in the world, then those on links
    carried : the links that carry bodies or clips, and what is on them, see :func:`carried_by`
    gripping : links that hold the cable, whose bodies it may touch near its ends
    links : where the links are, None if that is not known: then their bodies are left out
    rubs : whether there is friction, where surfaces have some
    start : Grip
    end : Grip or FreeEnd
    cache : what a model derives once from all but the ends, by the model's name
    made : what it derives from the cable alone; copies of a problem share it
    """

    __slots__ = (
        "_clip_frames",
        "_given",
        "_unplaced",
        "acceleration",
        "bodies",
        "cable",
        "cache",
        "carried",
        "clips",
        "end",
        "gravity",
        "gripping",
        "lag",
        "links",
        "load",
        "load_arc_length",
        "load_force",
        "made",
        "masses",
        "points",
        "retraction",
        "rubs",
        "scene",
        "start",
        "swing",
        "tolerance",
        "velocity",
    )

    def __init__(
        self,
        cable: Cable,
        *,
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        tolerance: float | None = None,
        scene: Scene | None = None,
        distributed_load: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        friction: bool = True,
    ) -> None:
        if not isinstance(cable, Cable):
            raise ArgumentError.of("cable", cable, "it must be a Cable", "Write Cable(length=..., ...).")
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
        self.cable = cable
        self.gravity = _GRAVITY if gravity is GRAVITY else checks.vector("gravity", gravity, 3, "m/s^2")
        self.points = checks.integer("points", points, at_least=MIN_POINTS, at_most=MAX_POINTS)
        if tolerance is None:
            self.tolerance = NAMED_TOLERANCE * cable.length
        else:
            self.tolerance = checks.number("tolerance", tolerance, above=0.0, unit="m")
        weight = cable.linear_density * self.gravity
        self.load: Array = np.array((weight, weight))
        if distributed_load is not None:
            self.load += _two_forces(distributed_load)
        self.acceleration: Array | None = None
        self.velocity: Array | None = None
        self.lag: Array | None = None
        self.swing: Array | None = None
        checks.instance("friction", friction, (bool,), "Write True or False.")
        self.rubs = friction
        if acceleration is not None:
            self._accelerate(_table(acceleration))
        self.scene = scene
        self.cache: dict[str, Any] = {}
        self.made: dict[tuple[int, float], Any] = {}
        self.masses: tuple[PointMass, ...] = ()
        self.load_arc_length = _NO_PLACES
        self.load_force = _NO_FORCES
        self.clips: tuple[Clip, ...] = ()
        if scene is not None and (scene.masses or scene.clips):
            parts: tuple[Clip | PointMass, ...] = (*scene.clips, *scene.masses)
            for part in parts:
                if part.segment is not None:
                    raise ArgumentError.of(
                        f"{type(part).__name__}.segment", part.segment, "a cable has no segments", "Leave it out."
                    )
            self._load_masses(scene)
            self._check_clips(scene)
            self.clips = tuple(scene.clips)
        self.retraction: Array = np.array([clip.retraction for clip in self.clips])
        self.bodies: tuple[Obstacle, ...] = ()
        if scene is not None and scene.contact == "solve":
            links = checks.entries("robot_links", robot_links, Obstacle)
            self.bodies = tuple(sorted((*scene.obstacles, *links), key=lambda body: body.link is not None))
        self.gripping = frozenset(checks.entries("gripping_links", gripping_links, str, "Give a list of link names."))
        self.carried = carried_by(self.bodies, self.clips)
        self._clip_frames = self.clips_at(_NO_LINKS)
        self._unplaced = any(clip.link is not None for clip in self.clips)
        self.links: Mapping[str, Pose] | None = None
        self._given: Pose | Grip | None = None
        self.start = _NOWHERE
        self.end: Grip | FreeEnd = _UNLOADED

    def clips_at(self, links: Array) -> Array:
        """(k, 7), where the clips are with the links in these rows, see `link_rows`; NaN where that is not known."""
        return clip_frames(self.clips, links, self.carried)

    @property
    def clip_frames(self) -> Array:
        """(k, 7), where the clips are; those that leave rotation free have that of the world.

        Raises
        ------
        ArgumentError
            If one is on a link and it is not known where that is.
        """
        if self._unplaced:
            refuse_unplaced(self.clips)
        return self._clip_frames

    def link_rows(self, links: Mapping[str, Pose] | None) -> Array:
        """(m, 7), where the links are that carry bodies or clips; (0, 7): not known, or there are none.

        Raises
        ------
        ArgumentError
            If `links` lacks one of them.
        """
        return _NO_LINKS if links is None or not self.carried else link_rows(links, self.carried)

    @property
    def clips_move(self) -> bool:
        """Whether some clip is on a link."""
        return any(clip.link is not None for clip in self.clips)

    @property
    def moving_clips(self) -> tuple[list[str], Array]:
        """Those on links, as `sensitivity` names them, and where they are (m, 7)."""
        if not self.clips:
            return [], _NO_LINKS
        on = [i for i, clip in enumerate(self.clips) if clip.link is not None]
        names = clip_names(self.clips)
        return [f"clip:{names[i]}" for i in on], self.clip_frames[on]

    @property
    def solves_crossing(self) -> bool:
        """Whether the cable is kept out of others and of itself: where it runs through no eyelet."""
        if self.scene is None or self.scene.contact != "solve":
            return False
        return not any(clip.kind == "slide" for clip in self.clips)

    def _accelerate(self, table: Array) -> None:
        """Adds the load of an acceleration (m, 3), and of the drag of a velocity beside it (m, 6)."""
        self.acceleration = table[:, :3]
        if table.shape[1] == 6:
            self.velocity = table[:, 3:]
            if self.cable.linear_density == 0.0 and any(self.slowed_by(self.cable)):
                bound = "a cable that drag and damping hold back must have weight"
                raise ArgumentError.of("linear_density", 0.0, bound, "Give it, or no velocity.")
        held_back = self.held_back
        assert held_back is not None
        self.load -= self.cable.linear_density * held_back[[0, -1]]
        self.swing = swing_of(held_back)

    @property
    def held_back(self) -> Array | None:
        """(m, 3) [m/s^2]: the acceleration that loads the cable as its own, drag and damping do; None: at rest."""
        if self.acceleration is None or self.velocity is None:
            return self.acceleration
        drag, damping = self.slowed_by(self.cable)
        if drag == damping == 0.0:
            return self.acceleration
        out = self.acceleration + drag / self.cable.linear_density * self.velocity
        if self.lag is not None:
            out -= damping / self.cable.linear_density * self.lag
        return np.asarray(out)

    @staticmethod
    def slowed_by(cable: Cable) -> tuple[float, float]:
        """What of a cable `velocity` [N s/m^2] and `lag` [N m^2 s] are multiplied by."""
        return cable.drag, longest_delay(cable) * cable.mean_bending_stiffness

    def damped(self, lag: Array | None) -> Problem:
        """The same with this load of damping (m, 3) [1/(m^3 s)]."""
        if lag is None and self.lag is None:
            return self
        out = copy.copy(self)
        out.lag, out.cache = lag, {}
        before, now = self.held_back, out.held_back
        assert before is not None
        assert now is not None
        out.load = self.load - self.cable.linear_density * (now - before)[[0, -1]]
        out.swing = swing_of(now)
        return out

    def accelerated(self, acceleration: ArrayLike) -> Problem:
        """The same, of a cable that did not accelerate, with an acceleration."""
        out = copy.copy(self)
        out.cache, out.load = {}, self.load.copy()
        out._accelerate(_table(acceleration))
        if self.masses:
            assert self.scene is not None
            out._load_masses(self.scene)
        return out

    def beside(self, cable: Cable) -> Problem:
        """The same on a cable that differs little: weight and inertia change with it, what holds it keeps its place."""
        other = copy.copy(self)
        other.cable, other.cache, other.made = cable, {}, {}
        falls = np.array((self.fall(0.0), self.end_fall))
        other.load = self.load + (cable.linear_density - self.cable.linear_density) * falls
        before, now = self.held_back, other.held_back
        if self.velocity is not None and before is not None and now is not None:
            assert self.acceleration is not None
            slowed, slower = ((x - self.acceleration)[[0, -1]] for x in (before, now))  # what is not the acceleration's
            other.load -= cable.linear_density * slower - self.cable.linear_density * slowed
            other.swing = swing_of(now)
        other.load_force = np.array([m.mass * other.fall(m.arc_length) for m in self.masses]).reshape(-1, 3)
        return other

    def after(self, last: Problem, share: float) -> Problem:
        """The same under loads on the way from those of `last`, of the same cable, at this share of it."""
        if share == 1.0:
            return self
        other = copy.copy(self)
        other.cache = {}
        other.load = last.load + share * (self.load - last.load)
        other.load_force = last.load_force + share * (self.load_force - last.load_force)
        other.retraction = last.retraction + share * (self.retraction - last.retraction)
        rows = max([2, *(len(a) for a in (self.acceleration, last.acceleration) if a is not None)])
        before, now = _rows(last.acceleration, rows), _rows(self.acceleration, rows)
        other.acceleration = before + share * (now - before)
        before, now = _rows(last.held_back, rows), _rows(self.held_back, rows)
        other.swing = swing_of(before + share * (now - before))
        return other

    def loaded_otherwise(self, last: Problem) -> bool:
        """Whether it is the same cable, with loads at the same places, that are not those of `last`."""
        if last is self or last.cable is not self.cable:
            return False
        if not np.array_equal(last.load_arc_length, self.load_arc_length):
            return False
        if last.retraction.size != self.retraction.size:
            return False
        swings = [np.empty(0) if one.swing is None else one.swing for one in (last, self)]
        pairs = (
            swings, (last.load, self.load), (last.load_force, self.load_force), (last.end_fall, self.end_fall),
            (last.retraction, self.retraction),
        )  # fmt: skip
        return not all(np.array_equal(one, other) for one, other in pairs)

    def hangs_like(self, last: Problem) -> bool:
        """Whether it is the same cable at rest under the same loads, in clips of the same kinds at the same places."""
        held = [
            [(clip.arc_length, clip.kind, clip.friction, clip.retraction) for clip in one.clips] for one in (last, self)
        ]
        at_rest = self.swing is None and last.swing is None
        return (
            last.cable is self.cable
            and at_rest
            and held[0] == held[1]
            and (self.tolerance, self.points) == (last.tolerance, last.points)
            and np.array_equal(last.load_arc_length, self.load_arc_length)
            and not self.loaded_otherwise(last)
        )

    @property
    def end_fall(self) -> Array:
        """`fall` at the cable's end."""
        return self.gravity if self.acceleration is None else np.asarray(self.gravity - self.acceleration[-1])

    def fall(self, arc_length: float) -> Array:
        """(3,) [m/s^2], gravity without the acceleration there: what weighs on a mass at this arc length."""
        if self.acceleration is None:
            return self.gravity
        places = np.linspace(0.0, self.cable.length, len(self.acceleration))
        there = [np.interp(arc_length, places, self.acceleration[:, i]) for i in range(3)]
        return np.asarray(self.gravity - np.array(there))

    def _load_masses(self, scene: Scene) -> None:
        """Point masses become concentrated loads, in ascending arc length."""
        self.masses = tuple(sorted(scene.masses, key=lambda m: m.arc_length))
        for mass in self.masses:
            if mass.arc_length > self.cable.length:
                raise ArgumentError.of(
                    "PointMass.arc_length",
                    mass.arc_length,
                    f"it must be at most the length of the cable, {self.cable.length:g} m",
                    "Arc length counts from the start grip.",
                )
        self.load_arc_length = np.array([m.arc_length for m in self.masses])
        self.load_force = np.array([m.mass * self.fall(m.arc_length) for m in self.masses]).reshape(-1, 3)

    def _check_clips(self, scene: Scene) -> None:
        """Clips are on the cable, between the grips, and not too close to each other."""
        length = self.cable.length
        least = CLIP_SPACING * length
        before = 0.0
        for i, clip in enumerate(scene.clips):
            if not clip.arc_length <= length - least:
                raise ArgumentError.of(
                    f"clips[{i}].arc_length",
                    clip.arc_length,
                    f"it must be at most {length - least:g} m on a cable of {length:g} m",
                    "Arc length counts from the start grip; the end is held by a grip, not by a clip.",
                )
            if clip.arc_length - before < least:
                where = "the start grip" if i == 0 else f"clips[{i - 1}]"
                raise ArgumentError.of(
                    f"clips[{i}].arc_length",
                    clip.arc_length,
                    f"it must be at least {least:g} m beyond {where}",
                    "Arc length counts from the start grip; join clips that are as good as one.",
                )
            before = clip.arc_length
            if clip.kind == "slide" and any(abs(mass.arc_length - before) < least for mass in self.masses):
                raise ArgumentError.of(
                    f"clips[{i}].arc_length",
                    before,
                    "a point mass is there, which cannot run through an eyelet",
                    "Move one of them, or make it a 'ball' clip.",
                )

    def move(
        self,
        start: Pose | Grip,
        end: Pose | Grip | FreeEnd | None,
        links: Mapping[str, Pose] | None = None,
    ) -> Problem:
        """Puts the ends there (None: a free end), and the links, and returns itself."""
        if links is not None and type(links) is not dict and not isinstance(links, Mapping):
            raise ArgumentError.of("links", links, "it must be a mapping", "Write {link: Pose(...)}.")
        if self.clips and self.clips_move:
            self._clip_frames, self._unplaced = self.clips_at(self.link_rows(links)), links is None
        self.links = links
        if start is not self._given:  # often only one end moves
            self.start = start if type(start) is Grip else as_grip("start", start)
            self._given = start
        if type(end) is Grip or type(end) is FreeEnd:
            self.end = end
        elif end is None:
            self.end = _UNLOADED
        else:
            self.end = as_grip("end", end)
        return self


def refuse_unplaced(clips: Sequence[Clip]) -> None:
    """Refuses a clip on a link of which nobody knows where it is.

    Raises
    ------
    ArgumentError
    """
    name, clip = next((n, c) for n, c in zip(clip_names(clips), clips, strict=True) if c.link is not None)
    raise ArgumentError.of(
        "links",
        None,
        f"clip {name!r} is on link {clip.link!r}, and where that is must be known",
        "Give links={link: Pose(...)} where they are taken, or hold the clip in the world, without a link.",
    )


def longest_delay(cable: Cable) -> float:
    """[s], the longest retardation time along a cable; 0: its moment does not depend on how fast it bends."""
    return max(piece.retardation_time for _, _, piece in pieces_of(cable))


def _rows(table: Array | None, rows: int) -> Array:
    """An acceleration (m, 3), None: none, told in so many rows: exact if it has as many, or is linear."""
    if table is None:
        return np.zeros((rows, 3))
    here, there = np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, len(table))
    return np.stack([np.interp(here, there, a) for a in table.T], axis=1)


def swing_of(table: Array) -> Array | None:
    """What an acceleration (m, 3) has beyond the line from its first to its last row; None: nothing."""
    swing = table - np.linspace(table[0], table[-1], len(table))
    return swing if np.abs(swing).max() > _STRAIGHT * np.abs(table).max() else None


def _table(value: ArrayLike) -> Array:
    """An acceleration (3,) or (m, 3) as a table of two rows at least; (m, 6) with the velocity beside it."""
    remedy = (
        f"Give three numbers in m/s^2, or a table (m, 3) with 2 to {MAX_ACCELERATIONS} rows, uniform in arc length "
        f"from the start grip to the end; or (m, 6) with {FEWEST_VELOCITIES} rows at least, the velocity in m/s beside."
    )
    a = checks.numbers("acceleration", value, remedy)
    if a.shape == (3,):
        a = np.array((a, a))
    fewest = {3: 2, 6: FEWEST_VELOCITIES}.get(a.shape[-1]) if a.ndim == 2 else None
    if fewest is None or not fewest <= len(a) <= MAX_ACCELERATIONS:
        raise ArgumentError.of("acceleration", f"shape {a.shape}", "it must be (3,), (m, 3) or (m, 6)", remedy)
    if not (np.abs(a) <= checks.MOST).all():
        bound = f"every entry must be finite, none above {checks.MOST:g}"
        raise ArgumentError.of("acceleration", a.tolist(), bound, remedy)
    return a


def _two_forces(value: ArrayLike) -> Array:
    """((fx, fy, fz) at s = 0, (fx, fy, fz) at s = length) as (2, 3)."""
    remedy = "Write ((fx, fy, fz) at s = 0, (fx, fy, fz) at s = length)."
    a = checks.numbers("distributed_load", value, remedy)
    if a.shape != (2, 3) or not (np.abs(a) <= checks.MOST).all():
        bound = "it must be two rows of three finite numbers in N/m"
        raise ArgumentError.of("distributed_load", value, bound, remedy)
    return a
