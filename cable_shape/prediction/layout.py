"""What edits change: :class:`Layout`, cables as they are held now among bodies as they are now."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.cut import reach_of, stretch_of
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose, between
from cable_shape.prediction.edits import Add, Edit, Insert, Move, Open, Regrip, Release, SetCable
from cable_shape.scene.scene import Allow, Clip, Obstacle, PointMass, Scene
from cable_shape.scene.scene_parts import clip_names

#: Of a cable and a clip that is to hold it: where it is now, told as the clip's pose is; None: it has no shape yet.
Whereabouts = Callable[[str, Clip], Pose | None]
#: Numbers of a cable that change on a straight way; those of a section, and limits, change at once.
_NUMBERS = (
    "length", "linear_density", "bending_stiffness", "twisting_stiffness", "rest_curvature", "diameter",
    "gradient_length", "inner_diameter",
)  # fmt: skip


#: [m], a grip that takes the cable where a fixed clip holds it takes it over from that.
_SAME_PLACE = 1e-9


@final
@dataclass(frozen=True, slots=True)
class Laid:
    """One cable as it is held: between which arc lengths [m] of it as it was made, in which clips, with which masses.

    Arc lengths of clips and masses count from the start grip. opened: nothing holds the end, whatever gripper is there.
    """

    made: Cable
    first: float
    last: float
    clips: tuple[Clip, ...] = ()
    masses: tuple[PointMass, ...] = ()
    opened: bool = False

    @property
    def cable(self) -> Cable:
        """What is between the grips, with the rest as its tails."""
        return stretch_of(self.made, self.first, self.last)


@final
@dataclass(frozen=True, slots=True)
class Layout:
    """All cables by name, and the scene that they share: its bodies count, what holds the cables is theirs.

    Where it allows contact is told by arc lengths of the cables as they were made.
    """

    scene: Scene
    cables: Mapping[str, Laid]

    @classmethod
    def of(cls, scene: Scene, cables: Mapping[str, Cable], own_clips: Mapping[str, Sequence[Clip]]) -> Layout:
        """As it is before any edit; clips without a name get the one that they are called by."""
        laid = {}
        for name, cable in cables.items():
            clips = tuple(own_clips.get(name, scene.clips))
            named = tuple(dataclasses.replace(c, name=n) for c, n in zip(clips, clip_names(clips), strict=True))
            laid[name] = Laid(cable, 0.0, cable.length, named, tuple(scene.masses))
        return cls(scene, laid)

    def scene_of(self, name: str) -> Scene:
        """What holds and surrounds one cable."""
        laid = self.cables[name]
        allow = self.scene.allow
        if laid.first:
            allow = [_shifted(one, laid.first) for one in allow]
        return self.scene.replace(clips=laid.clips, masses=laid.masses, allow=allow)

    @property
    def common(self) -> Scene:
        """The bodies, and what holds every cable; all that holds something where there are only harnesses."""
        if not self.cables:
            return self.scene
        if len(self.cables) == 1:
            return self.scene_of(next(iter(self.cables)))
        first, *others = self.cables.values()
        clips = [clip for clip in first.clips if all(clip in one.clips for one in others)]
        masses = [mass for mass in first.masses if all(mass in one.masses for one in others)]
        return self.scene.replace(clips=clips, masses=masses)

    def with_cable(self, name: str, **changes: Any) -> Layout:
        """The same with one cable held otherwise."""
        laid = dataclasses.replace(self.cables[name], **changes)
        return dataclasses.replace(self, cables={**self.cables, name: laid})

    def with_bodies(self, bodies: Sequence[Obstacle]) -> Layout:
        """The same with other bodies."""
        return dataclasses.replace(self, scene=self.scene.replace(obstacles=bodies))


def _shifted(allow: Allow, by: float) -> Allow:
    """The same stretch of cable, told from a start grip that is by so much [m] further on."""
    start, end = (None if at is None else at - by for at in (allow.start, allow.end))
    return dataclasses.replace(allow, start=start, end=end)


@final
class Change(NamedTuple):
    """What one edit does.

    From `origin`, which has all that `goal` has, where the cables still have the shapes that they had, a way leads
    there (:func:`on_the_way`). loose: cables of which that is no equilibrium, since something has let go of them.
    forced: whether what cannot be followed is refused; what lets go always can be. what: the edited part, in words.
    """

    origin: Layout
    goal: Layout
    loose: frozenset[str] = frozenset()
    forced: bool = True
    what: str = ""


def change_of(layout: Layout, edit: Edit, cable: str | None, where: Whereabouts, taken: Sequence[str] = ()) -> Change:
    """What an edit does to a layout; cable: whose clip, grip or numbers are meant; taken: other names of bodies.

    Raises
    ------
    ArgumentError
        For what cannot be: it names the value, the bound and the remedy.
    """
    if isinstance(edit, Add) and isinstance(edit.part, Clip):
        edit = Insert(edit.part)
    if isinstance(edit, Add):
        if isinstance(edit.part, Obstacle):
            return _add_body(layout, edit.part, taken)
        return _add_mass(layout, edit.part, _the_cable(layout, cable, "Add"))  # type: ignore[arg-type]
    if isinstance(edit, Insert):
        return _insert(layout, edit.clip, _the_cable(layout, cable, "Insert"), where, taken)
    if isinstance(edit, Regrip):
        return _regrip(layout, edit, _the_cable(layout, cable, "Regrip"))
    if isinstance(edit, Open):
        return _open(layout, edit, _the_cable(layout, cable, "Open"))
    if isinstance(edit, SetCable):
        return _set_cable(layout, edit.cable, _the_cable(layout, cable, "SetCable"))
    body = None if isinstance(edit, Release) else _body_named(layout, edit.name)
    holders = [n for n, laid in layout.cables.items() if cable in (None, n) and _clip_named(laid, edit.name)]
    if body is None and not holders:
        _refuse_name(layout, edit, cable)
    if body is not None and holders:
        bound = "a body and a clip have this name"
        raise ArgumentError.of(f"{type(edit).__name__}.name", edit.name, bound, "Rename one of them.")
    if isinstance(edit, Move):
        return _move(layout, edit, body, holders)
    if body is not None:
        rest = [one for one in layout.scene.obstacles if one is not body]
        goal = layout.with_bodies(rest)
        return Change(goal, goal, frozenset(layout.cables), forced=False, what=f"body {edit.name!r}")
    goal = layout
    for name in holders:
        goal = goal.with_cable(name, clips=tuple(c for c in layout.cables[name].clips if c.name != edit.name))
    return Change(goal, goal, frozenset(holders), forced=False, what=f"clip {edit.name!r}")


def _the_cable(layout: Layout, cable: str | None, what: str) -> str:
    """The cable that is meant."""
    if cable is not None:
        return cable
    if len(layout.cables) > 1:
        known = ", ".join(layout.cables)
        raise ArgumentError.of("cable", None, f"{what} is about one of several cables", f"Name it: {known}.")
    return next(iter(layout.cables))


def _body_named(layout: Layout, name: str) -> Obstacle | None:
    return next((body for body in layout.scene.obstacles if body.name == name), None)


def _clip_named(laid: Laid, name: str) -> Clip | None:
    return next((clip for clip in laid.clips if clip.name == name), None)


def _refuse_name(layout: Layout, edit: Any, cable: str | None) -> None:
    """Nothing is called so."""
    bodies = [] if isinstance(edit, Release) else [body.name for body in layout.scene.obstacles]
    clips = [clip.name for n, laid in layout.cables.items() if cable in (None, n) for clip in laid.clips]
    known = ", ".join(dict.fromkeys(str(name) for name in (*bodies, *clips))) or "none"
    bound = "no such clip" if isinstance(edit, Release) else "no such body or clip"
    raise ArgumentError.of(f"{type(edit).__name__}.name", edit.name, bound, f"Known: {known}.")


def _refuse_taken(layout: Layout, name: str, of: str, taken: Sequence[str], cables: Sequence[str]) -> None:
    """Something is called so already."""
    names = {body.name for body in layout.scene.obstacles} | set(taken)
    names |= {clip.name or "" for one in cables for clip in layout.cables[one].clips}
    if name in names:
        raise ArgumentError.of(of, name, "names must be unique", "Choose another one, or remove what has it.")


def _add_body(layout: Layout, body: Obstacle, taken: Sequence[str]) -> Change:
    _refuse_taken(layout, body.name, "Add.part.name", taken, tuple(layout.cables))
    goal = layout.with_bodies((*layout.scene.obstacles, body))
    return Change(goal, goal, what=f"body {body.name!r}")


def _add_mass(layout: Layout, mass: PointMass, name: str) -> Change:
    masses = layout.cables[name].masses
    origin = layout.with_cable(name, masses=(*masses, dataclasses.replace(mass, mass=0.0)))
    return Change(origin, layout.with_cable(name, masses=(*masses, mass)), what=f"mass at {mass.arc_length:g} m")


def _insert(layout: Layout, clip: Clip, name: str, where: Whereabouts, taken: Sequence[str]) -> Change:
    laid = layout.cables[name]
    if clip.name is None:
        known = {one.name for one in laid.clips} | set(taken) | {body.name for body in layout.scene.obstacles}
        free = next(f"clip{i}" for i in range(len(known) + 1) if f"clip{i}" not in known)
        clip = dataclasses.replace(clip, name=free)
    else:
        _refuse_taken(layout, clip.name, "Insert.clip.name", taken, (name,))
    length = laid.cable.length
    if not 0.0 < clip.arc_length < length:
        bound = f"it must be between the grips, above 0 m and below {length:g} m"
        raise ArgumentError.of("Insert.clip.arc_length", clip.arc_length, bound, "It counts from the start grip.")
    there = where(name, clip)
    goal = layout.with_cable(name, clips=_in_order((*laid.clips, clip)))
    if there is None:
        return Change(goal, goal, what=f"clip {clip.name!r}")
    before = dataclasses.replace(clip, pose=there)
    return Change(layout.with_cable(name, clips=_in_order((*laid.clips, before))), goal, what=f"clip {clip.name!r}")


def _in_order(clips: Sequence[Clip]) -> tuple[Clip, ...]:
    """In ascending arc length."""
    return tuple(sorted(clips, key=lambda clip: clip.arc_length))


def _move(layout: Layout, edit: Move, body: Obstacle | None, holders: Sequence[str]) -> Change:
    if body is not None:
        moved = dataclasses.replace(body, pose=edit.pose)
        goal = layout.with_bodies([moved if one is body else one for one in layout.scene.obstacles])
        return Change(layout, goal, what=f"body {edit.name!r}")
    goal = layout
    for name in holders:
        clips = layout.cables[name].clips
        goal = goal.with_cable(
            name, clips=tuple(dataclasses.replace(c, pose=edit.pose) if c.name == edit.name else c for c in clips)
        )
    return Change(layout, goal, what=f"clip {edit.name!r}")


def _regrip(layout: Layout, edit: Regrip, name: str) -> Change:
    laid = layout.cables[name]
    at, (low, high) = edit.arc_length, reach_of(laid.made)
    if not low <= at <= high:
        bound = f"the cable goes from {low:g} m to {high:g} m of arc length"
        raise ArgumentError.of("Regrip.arc_length", at, bound, "Give an arc length of the cable as it was made.")
    first, last = (at, laid.last) if edit.end == "start" else (laid.first, at)
    if not first < last:
        bound = f"the grips hold {laid.first:g} m and {laid.last:g} m of arc length"
        raise ArgumentError.of("Regrip.arc_length", at, bound, "The start must be before the end.")
    stretch_of(laid.made, first, last)
    handed = [c for c in laid.clips if c.kind == "fixed" and abs(laid.first + c.arc_length - at) <= _SAME_PLACE]
    held = tuple(clip for clip in laid.clips if clip not in handed)
    for clip in held:
        there = laid.first + clip.arc_length
        if not first < there < last:
            bound = f"clip {clip.name!r} holds the cable at {there:g} m, beyond that grip"
            raise ArgumentError.of("Regrip.arc_length", at, bound, "Release the clip first.")
    for mass in laid.masses:
        there = laid.first + mass.arc_length
        if not first <= there <= last:
            bound = f"a point mass at {there:g} m would be on a tail, where it is not known"
            raise ArgumentError.of("Regrip.arc_length", at, bound, "Grip the cable beyond the mass.")
    shift = laid.first - first
    goal = layout.with_cable(
        name,
        first=first,
        last=last,
        clips=tuple(dataclasses.replace(clip, arc_length=clip.arc_length + shift) for clip in held),
        masses=tuple(dataclasses.replace(mass, arc_length=mass.arc_length + shift) for mass in laid.masses),
        opened=laid.opened and edit.end == "start",
    )
    outwards = first < laid.first or last > laid.last
    return Change(goal, goal, frozenset((name,)) if outwards else frozenset(), what=f"{edit.end} at {at:g} m")


def _open(layout: Layout, edit: Open, name: str) -> Change:
    laid = layout.cables[name]
    if edit.end == "start":
        bound, remedy = "something must hold the start", "Regrip the start, or describe the cable the other way round."
        raise ArgumentError.of("Open.end", edit.end, bound, remedy)
    if laid.opened:
        raise ArgumentError.of("Open.end", edit.end, "this end is open already", "Regrip it to hold it again.")
    goal = layout.with_cable(name, last=reach_of(laid.made)[1], opened=True)
    return Change(goal, goal, frozenset((name,)), forced=False, what="end")


def _set_cable(layout: Layout, cable: Cable, name: str) -> Change:
    laid = layout.cables[name]
    (low, high), (low_then, high_then) = reach_of(cable), reach_of(laid.made)
    first = low if laid.first == low_then else laid.first
    last = high if laid.last == high_then else laid.last
    if laid.first == 0.0:
        first = 0.0
    if laid.last == laid.made.length and not laid.opened:
        last = cable.length
    stretch_of(cable, first, last)
    goal = layout.with_cable(name, made=cable, first=first, last=last)
    return Change(layout, goal, what=f"cable {name!r}")


def on_the_way(change: Change, at: float) -> Layout:
    """The layout at this share of the way that a change takes; 1 is its goal."""
    goal, origin = change.goal, change.origin
    if at == 1.0 or goal is origin:
        return goal
    poses = {body.name: body.pose for body in origin.scene.obstacles}
    bodies = [_moved(body, poses[body.name], at) for body in goal.scene.obstacles]
    cables = {}
    for name, laid in goal.cables.items():
        then = origin.cables[name]
        if laid == then:
            cables[name] = laid
            continue
        held = {clip.name: clip.pose for clip in then.clips}
        cable = stretch_between(then.cable, laid.cable, at)
        cables[name] = dataclasses.replace(
            laid,
            made=cable,
            first=0.0,
            last=cable.length,
            clips=tuple(_moved(clip, held[clip.name], at) for clip in laid.clips),
            masses=tuple(
                dataclasses.replace(b, mass=(1.0 - at) * a.mass + at * b.mass)
                for a, b in zip(then.masses, laid.masses, strict=True)
            ),
        )
    return Layout(goal.scene.replace(obstacles=bodies), cables)


def _moved(part: Any, then: Pose, at: float) -> Any:
    """A body or clip on its way from where it was."""
    if part.pose == then:
        return part
    return dataclasses.replace(part, pose=Pose.trusted(between(then.array, part.pose.array, at)))


def stretch_between(origin: Cable, goal: Cable, at: float) -> Cable:
    """A cable whose numbers are on the way from one to another, whose sections, limits and tails it has."""
    if at == 1.0 or origin is goal or origin == goal:
        return goal
    changes: dict[str, Any] = {}
    for key in _NUMBERS:
        a, b = (np.asarray(getattr(one, key), dtype=np.float64) for one in (origin, goal))
        if a.shape != b.shape or np.array_equal(a, b):
            continue
        way = (1.0 - at) * a + at * b
        changes[key] = way.tolist() if way.ndim else float(way)
    for key in ("axial_stiffness", "shear_stiffness"):  # their compliances, where there are none
        stiff, soft = getattr(origin, key), getattr(goal, key)
        soft = (1.0 - at) * (0.0 if stiff is None else 1.0 / stiff) + at * (0.0 if soft is None else 1.0 / soft)
        changes[key] = 1.0 / soft if soft > 0.0 else None
    length = changes.get("length", goal.length)
    if goal.sections and length < goal.length:
        changes.pop("length")  # where sections are is known on the whole cable only
    return goal.replace(**changes)
