"""What one edit does to a :class:`Layout`: :func:`change_of`, and the way that it takes: :func:`on_the_way`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import TAIL_SIDES, Cable
from cable_shape.cable.cut import reach_of, stretch_of
from cable_shape.cable.harness import split_end
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose, between
from cable_shape.prediction.edits import Add, Edit, Insert, Move, Open, Regrip, Release, SetCable
from cable_shape.prediction.layout import Laid, Layout, cable_id
from cable_shape.scene.scene import Clip, Obstacle, PointMass

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
    edit, cable = _addressed(layout, edit, cable)
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
    meant = [n for n in layout.cables if cable in (None, n, layout.harness_with(n))]
    holders = [n for n in meant if _clip_named(layout.cables[n], edit.name)]
    if body is None and not holders:
        _refuse_name(layout, edit, meant)
    if body is not None and holders:
        bound = "a body and a clip have this name"
        raise ArgumentError.of(f"{type(edit).__name__}.name", edit.name, bound, "Rename one of them.")
    if isinstance(edit, Move):
        return _move(layout, edit, body, holders)
    if body is not None:
        rest = [one for one in layout.scene.obstacles if one is not body]
        goal = layout.with_bodies(rest)
        held = frozenset(layout.cables) if layout.scene.contact == "solve" else frozenset[str]()
        return Change(goal, goal, held, forced=False, what=f"body {edit.name!r}")
    goal = layout
    for name in holders:
        goal = goal.with_cable(name, clips=tuple(c for c in layout.cables[name].clips if c.name != edit.name))
    return Change(goal, goal, frozenset(holders), forced=False, what=f"clip {edit.name!r}")


def _addressed(layout: Layout, edit: Any, cable: str | None) -> tuple[Any, str | None]:
    """An edit of a harness as one of the segment that its clip, its mass or its end names."""
    if not isinstance(edit, (Add, Insert, Regrip, Open, SetCable)) or isinstance(getattr(edit, "part", None), Obstacle):
        return edit, cable
    part: Any = edit.clip if isinstance(edit, Insert) else edit.part if isinstance(edit, Add) else None
    kind = type(edit if part is None else part).__name__
    end: Any = edit.end if isinstance(edit, (Regrip, Open)) else None
    known = (*layout.single, *layout.harnesses)
    name = known[0] if cable is None and len(known) == 1 else cable
    if name is None or name not in layout.harnesses:
        if part is not None and part.segment is not None:
            raise ArgumentError.of(f"{kind}.segment", part.segment, "a cable has no segments", "Leave it out.")
        if end is not None and end not in TAIL_SIDES:
            raise ArgumentError.of(f"{kind}.end", end, "a cable has no segments", "Write 'start' or 'end'.")
        _refuse_joined(layout, edit, name)
        return edit, cable
    harness = layout.harnesses[name]
    segments = f"Segments: {', '.join(harness.segments)}."
    if isinstance(edit, SetCable):
        remedy = f"Write cable='{cable_id(name, 'SEGMENT')}'. {segments}"
        raise ArgumentError.of("cable", cable, "SetCable is about one segment of a harness", remedy)
    if part is not None:
        if part.segment not in harness.segments:
            bound = f"{name!r} is a harness: it must name a segment"
            raise ArgumentError.of(f"{kind}.segment", part.segment, bound, segments)
        bare = dataclasses.replace(part, segment=None)
        return (Insert(bare) if isinstance(edit, Insert) else Add(bare)), cable_id(name, part.segment)
    if end not in harness.ends:
        bound = f"{name!r} is a harness: it must be an end of a segment"
        raise ArgumentError.of(f"{kind}.end", end, bound, f"Write 'NAME.end'. {segments}")
    segment, side = split_end(end)
    of_segment = Regrip(side, edit.arc_length) if isinstance(edit, Regrip) else Open(side)
    _refuse_joined(layout, of_segment, cable_id(name, segment))
    return of_segment, cable_id(name, segment)


def _refuse_joined(layout: Layout, edit: Any, name: str | None) -> None:
    """Ends in junctions are held by those; where contact is allowed is told from the start of all segments alike."""
    harness = None if name is None else layout.harness_with(name)
    if harness is None or not isinstance(edit, (Regrip, Open)):
        return
    end = f"{str(name).rpartition('/')[2]}.{edit.end}"
    junction = layout.harnesses[harness].junction_of(end)
    if junction is not None:
        bound = f"it is in junction {junction.name!r}, which holds it"
        raise ArgumentError.of(f"{type(edit).__name__}.end", end, bound, "Name an open end.")
    stretches = [one.body for one in layout.scene.allow if (one.start, one.end) != (None, None)]
    if edit.end == "start" and stretches:
        bound = f"contact with {stretches[0]!r} is allowed on a stretch from the start of all segments"
        raise ArgumentError.of(f"{type(edit).__name__}.end", end, bound, "Allow it all along, or regrip the end.")


def _the_cable(layout: Layout, cable: str | None, what: str) -> str:
    """The cable that is meant."""
    if cable is not None:
        return cable
    if len(layout.single) != 1:
        known = ", ".join((*layout.single, *layout.harnesses))
        raise ArgumentError.of("cable", None, f"{what} is about one of several cables", f"Name it: {known}.")
    return next(iter(layout.single))


def _body_named(layout: Layout, name: str) -> Obstacle | None:
    return next((body for body in layout.scene.obstacles if body.name == name), None)


def _clip_named(laid: Laid, name: str) -> Clip | None:
    return next((clip for clip in laid.clips if clip.name == name), None)


def _refuse_name(layout: Layout, edit: Any, meant: Sequence[str]) -> None:
    """Nothing is called so."""
    bodies = [] if isinstance(edit, Release) else [body.name for body in layout.scene.obstacles]
    clips = [clip.name for name in meant for clip in layout.cables[name].clips]
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
    opened = "" if laid.opened == edit.end else laid.opened
    goal = layout.with_laid(name, dataclasses.replace(laid, clips=held).held_from(first, last, opened=opened))
    outwards = first < laid.first or last > laid.last
    return Change(goal, goal, frozenset((name,)) if outwards else frozenset(), what=f"{edit.end} at {at:g} m")


def _open(layout: Layout, edit: Open, name: str) -> Change:
    laid = layout.cables[name]
    if laid.opened == edit.end:
        raise ArgumentError.of("Open.end", edit.end, "this end is open already", "Regrip it to hold it again.")
    if laid.opened:
        bound = f"the {laid.opened} is open: something must hold the cable"
        raise ArgumentError.of("Open.end", edit.end, bound, f"Regrip the {laid.opened} first.")
    low, high = reach_of(laid.made)
    first, last = (low, laid.last) if edit.end == "start" else (laid.first, high)
    goal = layout.with_laid(name, laid.held_from(first, last, opened=edit.end))
    return Change(goal, goal, frozenset((name,)), forced=False, what=edit.end)


def _set_cable(layout: Layout, cable: Cable, name: str) -> Change:
    laid = layout.cables[name]
    (low, high), (low_then, high_then) = reach_of(cable), reach_of(laid.made)
    first = low if laid.first == low_then else laid.first
    last = high if laid.last == high_then else laid.last
    if laid.first == 0.0 and laid.opened != "start":
        first = 0.0
    if laid.last == laid.made.length and laid.opened != "end":
        last = cable.length
    stretch_of(cable, first, last)
    if laid.opened == "start":  # clips and masses keep their place on the cable as it was made
        laid = laid.held_from(first, last)
    goal = layout.with_laid(name, dataclasses.replace(laid, made=cable, first=first, last=last))
    return Change(layout, goal, what=f"cable {name!r}")


def on_the_way(change: Change, at: float) -> Layout:
    """The layout at this share of the way that a change takes; 1 is its goal."""
    goal, origin = change.goal, change.origin
    if at == 1.0 or goal is origin:
        return goal
    if at == 0.0 and all(_alike(laid, origin.cables[name]) for name, laid in goal.cables.items()):
        return origin
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
    return Layout(goal.scene.replace(obstacles=bodies), cables, goal.harnesses)


def _alike(one: Laid, other: Laid) -> bool:
    """Whether they are the same stretch of the same cable."""
    return one.made is other.made and (one.first, one.last, one.opened) == (other.first, other.last, other.opened)


def _moved(part: Any, then: Pose, at: float) -> Any:
    """A body or clip on its way from where it was."""
    if part.pose == then:
        return part
    return dataclasses.replace(part, pose=Pose.trusted(between(then.array, part.pose.array, at)))


def stretch_between(origin: Cable, goal: Cable, at: float) -> Cable:
    """A cable whose numbers are on the way from one to another, whose sections, limits and tails it has then."""
    if at == 1.0 or origin is goal or origin == goal:
        return goal
    if at == 0.0 and origin.sections == goal.sections:
        return origin
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
