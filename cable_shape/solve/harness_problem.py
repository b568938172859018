"""What a predictor of a harness is asked to solve: :class:`HarnessProblem`, one :class:`Problem` a segment."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import SIDES, Harness, split_end
from cable_shape.cable.junction import Junction
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.body_tables import carried_by, clip_frames, link_rows
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import Clip, Obstacle, PointMass, clip_names
from cable_shape.solve.problem import GRAVITY, NAMED_TOLERANCE, Problem, refuse_unplaced

End = Pose | Grip | FreeEnd | None
_FREE = FreeEnd()
_CLAMPED = Grip(Pose())
_NO_LINKS: Array = np.empty((0, 7))


@final
class HarnessProblem:
    """A harness between its grips, under its loads; the ends may move, the rest stays.

    Attributes
    ----------
    harness : Harness
    segments : mapping of segment to Problem, which says what its cable is made of and what loads it between its ends
    clips : mapping of segment to the numbers of its clips in `scene.clips`, ascending in arc length
    gravity : (3,) [m/s^2]
    points : int, of each segment
    tolerance : float [m], largest position error allowed
    rubs : whether there is friction, where surfaces have some
    carried : the links that carry bodies or clips, and what is on them, see :func:`carried_by`
    ends : mapping of open end to Grip or FreeEnd
    laid_out : mapping of how the ends are held to the network that this makes, see `solve.harness_layout`
    """

    __slots__ = (
        "_clip_frames", "_given", "_keywords", "_loads", "_scenes", "_unplaced", "bodies", "carried", "clip_names",
        "clips", "ends", "gravity", "gripping", "harness", "laid_out", "links", "points", "rubs", "scene", "segments",
        "tolerance",
    )  # fmt: skip

    def __init__(
        self,
        harness: Harness,
        *,
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        tolerance: float | None = None,
        scene: Scene | None = None,
        distributed_load: Mapping[str, ArrayLike] | None = None,
        acceleration: Mapping[str, ArrayLike] | None = None,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        friction: bool = True,
    ) -> None:
        checks.instance("harness", harness, (Harness,), "Write Harness(segments={...}, junctions=[...]).")
        self.harness = harness
        if tolerance is None:
            tolerance = NAMED_TOLERANCE * harness.longest
        self.tolerance = checks.number("tolerance", tolerance, above=0.0, unit="m")
        self.scene = scene
        checks.instance("friction", friction, (bool,), "Write True or False.")
        self.rubs = friction
        self._scenes, self.clips = _scenes_of(harness, scene)
        self.clip_names = () if scene is None else clip_names(scene.clips)
        self._loads = _of_segments("distributed_load", distributed_load, harness)
        moves = _of_segments("acceleration", acceleration, harness)
        self._keywords: dict[str, Any] = {"gravity": gravity, "points": points, "tolerance": self.tolerance}
        self.segments: dict[str, Problem] = {}
        for name in harness.segments:
            self.segments[name] = self._segment(name, moves.get(name))
        first = next(iter(self.segments.values()))
        self.gravity, self.points = first.gravity, first.points
        self.laid_out: dict[tuple[str, ...], Any] = {}
        self.bodies: tuple[Obstacle, ...] = ()
        if scene is not None and scene.contact == "solve":
            links = checks.entries("robot_links", robot_links, Obstacle)
            self.bodies = tuple(sorted((*scene.obstacles, *links), key=lambda body: body.link is not None))
        self.gripping = frozenset(checks.entries("gripping_links", gripping_links, str, "Give a list of link names."))
        held = () if scene is None else tuple(scene.clips)
        self.carried = carried_by(self.bodies, held)
        self._unplaced = any(clip.link is not None for clip in held)
        self._clip_frames = clip_frames(held, _NO_LINKS, self.carried)
        self.links: Mapping[str, Pose] | None = None
        self._given: dict[str, End] | None = None
        self.ends: dict[str, Grip | FreeEnd] = dict.fromkeys(harness.open_ends, _FREE)

    @classmethod
    def of_several(cls, parts: Sequence[Part]) -> HarnessProblem:
        """Several cables and harnesses as one, in which none is joined to another; their ends are where theirs are."""
        other = object.__new__(cls)
        first = parts[0][0]
        problems, junctions = dict[str, Problem](), list[Junction]()
        for part, names in parts:
            if isinstance(part, Problem):
                problems[names[0]] = part
                continue
            problems.update(zip(names, part.segments.values(), strict=True))
            junctions += [renamed(one, dict(zip(part.segments, names, strict=True))) for one in part.harness.junctions]
        other.harness = Harness({name: one.cable for name, one in problems.items()}, junctions)
        other.segments = problems
        other.gravity, other.points, other.tolerance = first.gravity, first.points, first.tolerance
        # a scene's clips may hold each of them, under one name
        clips = [replace(clip, segment=name, name=None) for name, one in problems.items() for clip in one.clips]
        other.scene = Scene(clips=clips)
        _, other.clips = _scenes_of(other.harness, other.scene)
        other.clip_names = clip_names(other.scene.clips)
        other.laid_out = {}
        other.bodies, other.gripping, other.links = first.bodies, first.gripping, first.links
        other.carried = carried_by(first.bodies, [clip for one in problems.values() for clip in one.clips])
        other.follow(parts)
        return other

    def follow(self, parts: Sequence[Part]) -> None:
        """Puts the ends and links where those of these are, of which it was made."""
        self._given, self.links = None, parts[0][0].links
        self._unplaced, self.ends = False, {}
        frames = []
        for part, names in parts:
            if isinstance(part, Problem):
                frames.append(part.clip_frames)
                self.ends.update((f"{names[0]}.{side}", getattr(part, side)) for side in SIDES)
                continue
            frames += [part.clip_frames[numbers] for numbers in part.clips.values()]
            called = dict(zip(part.harness.ends, (f"{name}.{side}" for name in names for side in SIDES), strict=True))
            self.ends.update((called[end], held) for end, held in part.ends.items())
        self._clip_frames = np.concatenate(frames)

    def _segment(self, name: str, acceleration: ArrayLike | None) -> Problem:
        """What the problem is of one segment."""
        try:
            made = Problem(
                self.harness.segments[name],
                scene=self._scenes[name],
                distributed_load=self._loads.get(name),
                acceleration=acceleration,
                **self._keywords,
            )
        except ArgumentError as error:
            raise type(error)(f"segment {name!r}: {error}") from None
        if made.velocity is not None:
            raise ArgumentError.of(
                f"acceleration[{name!r}]",
                "with a velocity",
                "a harness takes accelerations only",
                "Give three columns.",
            )
        return made

    def moving(self, acceleration: Mapping[str, ArrayLike] | None) -> HarnessProblem:
        """The same with its segments accelerated, or at rest; the ends stay where they are."""
        moves = _of_segments("acceleration", acceleration, self.harness)
        other = object.__new__(HarnessProblem)
        for name in self.__slots__:
            setattr(other, name, getattr(self, name))
        other.segments = {name: self._segment(name, moves.get(name)) for name in self.segments}
        other.laid_out = {}
        return other

    def held_elsewhere(self, scene: Scene | None) -> HarnessProblem:
        """The same in a scene without contact that differs only in where its clips are."""
        other = copy.copy(self)
        if scene is not None:
            other.scene, other._clip_frames = scene, clip_frames(scene.clips, _NO_LINKS, self.carried)
        return other

    def beside(self, name: str, cable: Cable) -> HarnessProblem:
        """The same with a segment that differs little, see :meth:`Problem.beside`."""
        other = copy.copy(self)
        other.harness = self.harness.replace(segments={**self.harness.segments, name: cable})
        other.segments = {**self.segments, name: self.segments[name].beside(cable)}
        other.laid_out = {}
        return other

    @property
    def clip_frames(self) -> Array:
        """(k, 7), where the scene's clips are, see :attr:`Problem.clip_frames`."""
        if self._unplaced:
            assert self.scene is not None
            refuse_unplaced(self.scene.clips)
        return self._clip_frames

    @property
    def solves_crossing(self) -> bool:
        """Whether segments are kept out of each other and of themselves: where none runs through an eyelet."""
        if self.scene is None or self.scene.contact != "solve":
            return False
        return not any(clip.kind == "slide" for clip in self.scene.clips)

    @property
    def clips_move(self) -> bool:
        """Whether some clip is on a link."""
        return bool(self.moving_clips)

    @property
    def moving_clips(self) -> list[int]:
        """The numbers of those on links."""
        return [] if self.scene is None else [i for i, clip in enumerate(self.scene.clips) if clip.link is not None]

    @property
    def grips(self) -> tuple[str, ...]:
        """Names of the held ends, in the order of the segments."""
        return tuple(end for end, held in self.ends.items() if type(held) is Grip)

    def move(self, ends: Mapping[str, End], links: Mapping[str, Pose] | None = None) -> HarnessProblem:
        """Puts the ends there, those not named are free, and the links, and returns itself.

        Raises
        ------
        ArgumentError
            For an end that does not exist or is in a junction, and where nothing holds a part of the harness.
        """
        if type(ends) is not dict:
            checks.instance("ends", ends, (Mapping,), "Write {'a.start': Pose(...), ...}.")
        self.place(links)
        given, now = self._given, self.ends
        if given is not None and given.keys() == ends.keys():
            for end, held in ends.items():
                if held is not given[end]:
                    now[end] = self._end(end, held)
                    given[end] = held
                    if type(now[end]) is FreeEnd:
                        self._check_held(now)
            return self
        for end in ends:
            if end not in now:
                self._refuse(end)
        now = {end: self._end(end, ends.get(end)) for end in now}
        self._check_held(now)
        self.ends, self._given = now, dict(ends)
        return self

    def place(self, links: Mapping[str, Pose] | None) -> None:
        """Puts the links there; None: they are not known."""
        if links is not None:
            checks.instance("links", links, (Mapping,), "Write {link: Pose(...)}.")
        if self.scene is not None and self.clips_move:
            rows = _NO_LINKS if links is None else link_rows(links, self.carried)
            self._clip_frames, self._unplaced = clip_frames(self.scene.clips, rows, self.carried), links is None
        self.links = links

    def _end(self, end: str, held: End) -> Grip | FreeEnd:
        """How an end is held; a bare Pose is clamped, None is free."""
        if type(held) is Grip or type(held) is FreeEnd:
            found: Grip | FreeEnd = held
        elif held is None:
            found = _FREE
        else:
            checks.instance(end, held, (Pose, Grip, FreeEnd), "Write Pose(position, quaternion).")
            found = _CLAMPED.at(held, held)
        if type(found) is Grip and found.cable_frame.turns:
            bound = "windings of a harness come from the path that led there"
            raise ArgumentError.of(f"{end}: turns", found.cable_frame.turns, bound, "Leave them out and turn the end.")
        return found

    def _refuse(self, end: object) -> None:
        """Why an end cannot be held."""
        junction = self.harness.junction_of(end) if isinstance(end, str) else None
        if junction is not None:
            remedy = "Hold an open end, or take it out of the junction."
            raise ArgumentError.of("ends", end, f"it is in junction {junction.name!r}, which holds it", remedy)
        known = ", ".join(self.harness.open_ends) or "none is open"
        raise ArgumentError.of("ends", end, "there is no such end of a segment", f"Ends that may be held: {known}.")

    def _check_held(self, ends: Mapping[str, Grip | FreeEnd]) -> None:
        """Every part of the harness is held somewhere."""
        held = {end.rpartition(".")[0] for end, how in ends.items() if type(how) is Grip}
        held |= {name for name, clips in self.clips.items() if clips}
        for part in self.harness.parts():
            if not part & held:
                names = sorted(part)
                which = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
                raise ArgumentError.of(
                    "ends", sorted(end for end, how in ends.items() if type(how) is Grip),
                    f"nothing holds the part with the segments {which}",
                    "Name one of its open ends with a Pose or a Grip, or hold it in a clip.",
                )  # fmt: skip

    def loaded_otherwise(self, last: HarnessProblem) -> bool:
        """Whether loads at the same places are not those of `last`."""
        pairs = ((one, last.segments[name]) for name, one in self.segments.items() if name in last.segments)
        return any(one.loaded_otherwise(before) for one, before in pairs)

    def fall(self, end: str) -> Array:
        """(3,) [m/s^2], what weighs on a mass at an end."""
        segment, _, side = end.rpartition(".")
        problem = self.segments[segment]
        return problem.fall(0.0) if side == "start" else problem.end_fall


Part = tuple[Problem | HarnessProblem, Sequence[str]]  #: a cable, or a harness, and what its segments are called


def renamed(junction: Junction, names: Mapping[str, str]) -> Junction:
    """The same of segments by other names."""
    ends = {end: f"{names[split_end(end)[0]]}.{split_end(end)[1]}" for end in junction.ends}
    frames = {ends[end]: frame for end, frame in junction.frames.items()}
    name = f"{next(iter(names.values()))}.{junction.name}"
    return Junction(name, tuple(ends.values()), junction.kind, frames, junction.mass)


def _scenes_of(harness: Harness, scene: Scene | None) -> tuple[dict[str, Scene | None], dict[str, list[int]]]:
    """The clips and masses of each segment as a scene of its own, and the numbers of its clips."""
    scenes: dict[str, Scene | None] = dict.fromkeys(harness.segments)
    numbers: dict[str, list[int]] = {name: [] for name in harness.segments}
    if scene is None:
        return scenes, numbers
    checks.instance("scene", scene, (Scene,), "Write Scene(clips=[...]), or Scene.from_yaml(path).")
    if scene.plug is not None:
        remedy = "Give the end a FreeEnd(mass=...)."
        raise ArgumentError.of("scene.plug", scene.plug, "a harness has more ends than one", remedy)
    both: tuple[tuple[str, Sequence[Clip | PointMass]], ...] = (("clips", scene.clips), ("masses", scene.masses))
    for kind, parts in both:
        for i, part in enumerate(parts):
            if part.segment not in scenes:
                known = f"Segments: {', '.join(harness.segments)}."
                bound = "it must name the segment" if part.segment is None else "there is no such segment"
                raise ArgumentError.of(f"{kind}[{i}].segment", part.segment, bound, known)
    for i, clip in enumerate(scene.clips):
        assert clip.segment is not None
        numbers[clip.segment].append(i)
    for name in harness.segments:
        clips = [replace(scene.clips[i], segment=None) for i in numbers[name]]
        masses = [replace(mass, segment=None) for mass in scene.masses if mass.segment == name]
        if clips or masses:
            scenes[name] = Scene(clips=clips, masses=masses)
    return scenes, numbers


def _of_segments(where: str, values: Mapping[str, ArrayLike] | None, harness: Harness) -> dict[str, ArrayLike]:
    """A mapping of segments to what each is given."""
    remedy = f"Write {{segment: ...}}; segments: {', '.join(harness.segments)}."
    return checks.mapping(where, values, harness.segments, remedy)
