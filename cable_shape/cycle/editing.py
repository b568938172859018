"""Edits of a cycle's cables and bodies: :class:`Editing` makes them on cables of its own, which are kept if all can be.

The way that an edit takes is followed as the motion of a grip is: in one step, or in as many as it takes for the
cable to keep to its branch. Each step goes on from the shape of the one before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import TAIL_SIDES, Cable
from cable_shape.cable.harness import Harness
from cable_shape.cycle.cable_cycle import CableCycle, CableCycles, Found
from cable_shape.cycle.dynamic import DYNAMIC
from cable_shape.cycle.harness_cycle import Found as FoundHarness
from cable_shape.cycle.harness_cycle import HarnessCycle, HarnessCycles
from cable_shape.errors import ArgumentError
from cable_shape.pose import Ends, FreeEnd, Grip, Pose
from cable_shape.prediction.carried import carried, carried_tails, place_of, stretched
from cable_shape.prediction.changes import Change, change_of, on_the_way
from cable_shape.prediction.edits import Edit
from cable_shape.prediction.layout import Laid, Layout, cable_id
from cable_shape.prediction.solvers import Memory
from cable_shape.prediction.together import joined, told_of
from cable_shape.safety.report import Clearance
from cable_shape.scene.scene import Clip
from cable_shape.shape import CableShape, Status
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.spot import Spot

#: The shortest step, as a share of an edit's way.
_SMALLEST_STEP = 1.0 / 64.0
#: A shape so graded is on the branch of the one before.
_FOLLOWED = (Status.OK, Status.UNSTABLE, Status.BUDGET)

_Crossing = tuple[tuple[str, ...], Crossing]
Part = CableCycle | HarnessCycle


@final
class Editing:
    """Some edits, one after the other.

    layout, cycles, crossing: what there is, cables and harnesses, which is left as it is; afterwards what the edits
    have made of it. maker, harness_maker: of their parts.
    """

    def __init__(
        self,
        layout: Layout,
        cycles: Mapping[str, Part],
        maker: CableCycles,
        harness_maker: HarnessCycles | None,
        crossing: _Crossing | None,
    ) -> None:
        self.layout, self.cycles, self.crossing = layout, dict(cycles), crossing
        self._maker, self._harness_maker = maker, harness_maker
        self._taken = [body.name for body in maker.options["robot_links"]]

    @property
    def cables(self) -> dict[str, Cable]:
        """What is between the grips, and the segments of harnesses, by name."""
        return {name: laid.cable for name, laid in self.layout.cables.items()}

    @property
    def singles(self) -> dict[str, CableCycle]:
        """The parts of the cables."""
        return {name: one for name, one in self.cycles.items() if isinstance(one, CableCycle)}

    @property
    def harnesses(self) -> dict[str, HarnessCycle]:
        """The parts of the harnesses."""
        return {name: one for name, one in self.cycles.items() if isinstance(one, HarnessCycle)}

    def take(self, edit: Edit, cable: str | None) -> None:
        """One edit more.

        Raises
        ------
        ArgumentError
            If it cannot be, or the cable cannot follow it. Then nothing that was given has changed.
        """
        change = change_of(self.layout, edit, cable, self._place, self._taken)
        goal = change.goal
        bodies = goal.scene.obstacles != self.layout.scene.obstacles
        changed = {n for n, laid in goal.cables.items() if laid != self.layout.cables[n]}
        names = [n for n in goal.single if bodies or n in changed or self.crossing]
        made: dict[str, Part] = {name: self._made(goal, name) for name in names}
        for name in goal.harnesses:
            together = self.crossing is not None and name in self.crossing[0]
            if bodies or together or any(cable_id(name, one) in changed for one in goal.segments(name)):
                made[name] = self._made_harness(goal, name)
        way = _Way(self.layout, change, self.cycles, made, self.crossing)
        self._refuse_inside(change, made)
        if self._maker.motion == DYNAMIC:
            way.swing(self.cycles)
        else:
            way.go()
        for name, new in made.items():
            old = self.cycles[name]
            if isinstance(new, CableCycle) and isinstance(old, CableCycle):
                laid, then = goal.cables[name], self.layout.cables[name]
                ends = (laid.first, laid.last, laid.opened) == (then.first, then.last, then.opened)
                new.go_on_from(old, held_alike=ends)
            elif isinstance(new, HarnessCycle) and isinstance(old, HarnessCycle):
                new.go_on_from(old)
        self.cycles.update(made)
        self.layout, self.crossing = goal, way.crossing

    def _place(self, name: str, clip: Clip) -> Pose | None:
        """Where a cable, or a segment, is that a clip is to hold, in the frame in which the clip's pose is."""
        harness = self.layout.harness_with(name)
        found: Any = self.cycles[harness or name].found
        if found is None:
            return None
        shape = found.shape.segments[name.rpartition("/")[2]] if harness else found.shape
        there = place_of(shape, clip.arc_length)
        if clip.link is None:
            return there
        link: Pose | None = None if found.links is None else found.links.get(clip.link)
        if link is None:
            known = "none" if not found.links else ", ".join(sorted(found.links))
            bound = "where this link is was not known at the last step"
            raise ArgumentError.of("Insert.clip.link", clip.link, bound, f"Known: {known}.")
        return link.inverse() * there

    def _made(self, layout: Layout, name: str) -> CableCycle:
        """A cable's part in its new scene."""
        laid = layout.cables[name]
        load = _load_between(self._maker.distributed_load.get(name), laid)
        before = self.cycles[name]
        assert isinstance(before, CableCycle)
        turned = laid.opened == "start"
        return self._maker.make(name, laid.cable, layout.scene_of(name), load, turned=turned, before=before)

    def _made_harness(self, layout: Layout, name: str) -> HarnessCycle:
        """A harness's part in its new scene."""
        maker = self._harness_maker
        assert maker is not None
        given: Mapping[str, Any] = maker.distributed_load.get(name) or {}
        laid = layout.segments(name)
        loads = {one: _load_between(load, laid[one]) for one, load in given.items()}
        return maker.make(name, layout.harness_of(name), layout.scene_of_harness(name), loads or None)

    def _refuse_inside(self, change: Change, made: Mapping[str, Part]) -> None:
        """A body that is added must not have the middle of a cable in it: on which side is that to be?"""
        new = {b.name for b in change.goal.scene.obstacles} - {b.name for b in self.layout.scene.obstacles}
        if not new or change.goal.scene.contact != "solve":
            return
        checked: list[tuple[str, Cable, Clearance]] = []
        for name, cycle in made.items():
            found: Any = self.cycles[name].found
            if found is not None and isinstance(cycle, CableCycle):
                parts = (found.shape, *found.tails.values())
                checked += [(name, cycle.predictor.cable, cycle.check_shape(one, found.links)) for one in parts]
            elif found is not None and isinstance(cycle, HarnessCycle):
                checked += cycle.check_found(found)
        for name, cable, clearance in checked:
            radius = 0.5 * cable.diameter
            for body in clearance.bodies:
                if body.body in new and body.distance < -radius:
                    raise ArgumentError.of(
                        f"body {body.body!r}: depth of cable {name!r} in it",
                        round(-body.distance, 6),
                        f"the middle of the cable must be outside, at most {radius:g} m deep",
                        "Add it beside the cable, and move it.",
                    )


@final
class _Way:
    """The way of one change, along which the new parts of the cables are taken.

    crossing: what keeps all cables out of each other, at first of those that there were, then of the new ones.
    """

    def __init__(
        self,
        layout: Layout,
        change: Change,
        cycles: Mapping[str, Part],
        made: Mapping[str, Part],
        crossing: _Crossing | None,
    ) -> None:
        self._change, self._made = change, made
        self._known: dict[str, Any] = {}  # by cable, or harness: a Found, where it is on the way
        self._memories: dict[str, Memory] = {}
        self._spots: dict[str, list[Spot]] = {}  # where it touches itself, or, of all cables, each other
        for name, new in made.items():
            old = cycles[name]
            if old.found is None:
                continue
            if isinstance(new, HarnessCycle):
                self._known[name] = _carried_harness(old.found, layout, change, name, new)
                own: Any = old.predictor.crossing
                if own is not None and len(own.strands.parts) == 1:
                    ids = [cable_id(name, segment) for segment in layout.harnesses[name].segments]
                    self._spots[name] = _carried_spots(own, ids, layout, change)
                continue
            assert isinstance(old, CableCycle)
            found, predictor = old.found, old.predictor
            assert found is not None
            before, after = layout.cables[name], change.origin.cables[name]
            shape = carried(found.shape, found.tails, before, after)
            self._known[name] = known = Found(shape, {}, _ends(found, shape, before, after), found.links)
            new.begin_tails(carried_tails(found.shape, found.tails, before, after), shape, known.ends, found.links)
            alike = (before.opened == "start") == (after.opened == "start")
            stays = alike and (before.first, before.last) == (after.first, after.last)
            self._memories[name] = predictor.memory if stays else None
            if crossing is None and predictor.crossing is not None:
                self._spots[name] = _carried_spots(predictor.crossing, (name,), layout, change)
        self.crossing: _Crossing | None = None
        self._names: tuple[str, ...] = ()
        if crossing is not None and all(name in self._known for name in crossing[0]):
            self._names = crossing[0]
            self._spots[""] = _carried_spots(crossing[1], crossing[1].strands.names, layout, change)

    def go(self) -> None:
        """Takes the cables along.

        Raises
        ------
        ArgumentError
            If they cannot follow, where they would have to.
        """
        done, step, longest = 0.0, 1.0, 1.0
        whole = self._change.goal is self._change.origin  # there is no way between the two
        while self._known and done < 1.0:
            at = min(1.0, done + step)
            shapes = self._step(done, at, leap=whole)
            if all(self._followed(name, shape, done) for name, shape in shapes.items()):
                self._accept(shapes)
                done, step = at, min(2.0 * step, longest)
                continue
            if whole or step < 4.0 * _SMALLEST_STEP:
                self._jump(done, shapes if whole else self._step(done, 1.0, leap=True))
                break
            longest, step = 0.5 * step, 0.25 * step
        for name in self._known:
            self._made[name].predictor.leap(allowed=True)
        for name, known in self._known.items():
            self._made[name].begin(known.shape, known.ends, known.links)

    def swing(self, cycles: Mapping[str, Part]) -> None:
        """Lets what swings go on from where it is: it is moved by what holds and touches it in the next steps.

        cycles: the parts before.
        """
        for name, known in self._known.items():
            part: Any = self._made[name]
            if isinstance(part, HarnessCycle):
                shape: Any = _stretched_harness(known.shape, part.predictor.harness, part)
            else:
                shape = stretched(known.shape, part.predictor.cable.length)
            part.swing_on(cycles[name], shape, known.ends, known.links)

    def _followed(self, name: str, shape: CableShape | HarnessShape, done: float) -> bool:
        """Whether a shape is where the last one leads to."""
        slid = done == 0.0 and self._loose(name) and shape.status is Status.SNAPPED
        return slid or shape.status in _FOLLOWED

    def _loose(self, name: str) -> bool:
        """Whether something has let go of a cable, or of a segment of a harness."""
        return any(name in (one, self._change.goal.harness_with(one)) for one in self._change.loose)

    def _jump(self, done: float, shapes: Mapping[str, CableShape | HarnessShape]) -> None:
        """Takes what was found at the end of the way, wherever that is."""
        if all(shape.status for shape in shapes.values()):
            self._accept(shapes)
        elif self._change.forced:
            name, shape = next((name, shape) for name, shape in shapes.items() if not shape.status)
            why = (shape.detail or shape.status.remedy).removesuffix(".")
            bound = f"cable {name!r} cannot follow further: {why}"
            raise ArgumentError.of(
                f"{self._change.what}, share of its way", done, bound, "Bring the cable nearer, or move in between."
            )

    def _accept(self, shapes: Mapping[str, CableShape | HarnessShape]) -> None:
        """These are where the cables are now."""
        for name, shape in shapes.items():
            self._known[name] = self._known[name]._replace(shape=shape)
            part = self._made[name]
            if isinstance(part, CableCycle):
                self._memories[name] = part.predictor.memory
            own = part.predictor.crossing
            if not self._names and own is not None and own.last is not None:
                self._spots[name] = own.last[1]
        if self.crossing is not None and self.crossing[1].last is not None:
            self._spots[""] = self.crossing[1].last[1]

    def _step(self, done: float, at: float, *, leap: bool) -> dict[str, CableShape | HarnessShape]:
        """The shapes at a share of the way, from where the cables are at another one.

        leap: also where no small steps lead to them.
        """
        then, now = on_the_way(self._change, done), on_the_way(self._change, at)
        whole = self._change.goal is self._change.origin  # where it is to go is what it has been made of
        for name, known in self._known.items():
            part, loose = self._made[name], done == 0.0 and self._loose(name)
            part.predictor.leap(allowed=leap)
            if isinstance(part, HarnessCycle):
                harness, scene = (None, None) if whole else (now.harness_of(name), then.scene_of_harness(name))
                shape = _stretched_harness(known.shape, part.predictor.harness if harness is None else harness, part)
                part.predictor.begin(
                    shape, known.ends, known.links, harness=harness, scene=scene, loose=loose,
                    spots=self._spots.get(name),
                )  # fmt: skip
                continue
            cable = part.predictor.cable if whole else now.cables[name].cable
            part.predictor.begin(
                stretched(known.shape, cable.length),
                known.ends,
                known.links,
                cable=None if whole else cable,
                scene=None if whole else then.scene_of(name),
                loose=loose,
                memory=self._memories[name],
                spots=self._spots.get(name),
            )
        self.crossing = self._crossed()
        for name in () if whole else self._known:
            part = self._made[name]
            if at == 1.0:
                part.predictor.head_for()
            elif isinstance(part, HarnessCycle):
                part.predictor.head_for(now.harness_of(name), now.scene_of_harness(name))
            else:
                part.predictor.head_for(now.cables[name].cable, now.scene_of(name))
        found: dict[str, CableShape | HarnessShape] = {}
        if self.crossing is not None:
            predictors = {name: self._made[name].predictor for name in self._names}
            found.update(told_of(predictors, self.crossing[1].solve()))
        for name in self._known:
            if name not in found:
                found[name] = self._made[name].predictor.solve()
        return found

    def _crossed(self) -> _Crossing | None:
        """What keeps the cables out of each other from where they are; None: nothing does, or did so far."""
        parts = {name: self._made[name] for name in self._names}
        if not parts or not all(part.predictor.problem.solves_crossing for part in parts.values()):
            return None
        crossing = joined({name: part.predictor.solo for name, part in parts.items()})
        shapes: list[CableShape] = []
        for name, part in parts.items():
            shape = self._known[name].shape
            if isinstance(part, HarnessCycle):
                whole = _stretched_harness(shape, part.predictor.problem.harness, part)
                shapes += part.predictor.segments_of(whole)
            else:
                shapes.append(part.predictor.told(stretched(shape, part.predictor.solo.cable.length)))
        crossing.take_up(shapes, self._spots[""])
        return self._names, crossing


def _ends(found: Found, shape: CableShape, before: Laid, after: Laid) -> Ends:
    """What holds the ends of a shape after an edit: what held them before, or a grip there where the cable is."""
    held: list[Any] = list(found.ends)
    places = ((before.first, after.first, 0.0), (before.last, after.last, shape.length))
    for i, (side, (then, now, at)) in enumerate(zip(TAIL_SIDES, places, strict=True)):
        if after.opened == side:
            held[i] = held[i] if isinstance(held[i], FreeEnd) else None
        elif now != then or before.opened == side:
            held[i] = _grip_at(place_of(shape, at), held[i])
    return held[0], held[1]


def _carried_harness(found: Any, layout: Layout, change: Change, name: str, new: HarnessCycle) -> FoundHarness:
    """Where a harness is after an edit, as `carried` has it of each segment, and what holds its ends."""
    before, after = layout.segments(name), change.origin.segments(name)
    parts, ends, lying = {}, dict(found.ends), dict[str, CableShape]()
    for one, laid in after.items():
        then, id_of = before[one], cable_id(name, one)
        tails = {side: tail for (of, side), tail in found.tails.items() if of == id_of}
        old = found.shape.segments[one]
        parts[one] = shape = carried(old, tails, then, laid)
        lying.update((f"{one}.{side}", tail) for side, tail in carried_tails(old, tails, then, laid).items())
        held: Any = tuple(ends.get(f"{one}.{side}") for side in TAIL_SIDES)
        for side, way in zip(TAIL_SIDES, _ends(Found(old, {}, held, None), shape, then, laid), strict=True):
            if f"{one}.{side}" in ends or way is not None:
                ends[f"{one}.{side}"] = way
    harness = change.origin.harness_of(name)
    whole = _as_one(found.shape, harness, parts, new)
    new.begin_tails(lying, whole, ends, found.links)
    return FoundHarness(whole, {}, ends, found.links)


def _stretched_harness(shape: HarnessShape, harness: Harness, part: HarnessCycle) -> HarnessShape:
    """A shape as one of segments of other lengths."""
    parts = {one: stretched(shape.segments[one], cable.length) for one, cable in harness.segments.items()}
    return _as_one(shape, harness, parts, part)


def _as_one(shape: HarnessShape, harness: Harness, parts: Mapping[str, CableShape], part: HarnessCycle) -> HarnessShape:
    """The segments' shapes as one, in the clips of this part."""
    return shape.on(harness, parts, part.predictor.problem.clips)


def _grip_at(place: Pose, before: Any) -> Pose | Grip:
    """Holds the cable where it is as it was held before."""
    return Grip(place, before.kind) if isinstance(before, Grip) else place


def _carried_spots(crossing: Crossing, names: Sequence[str], layout: Layout, change: Change) -> list[Spot]:
    """Where cables, or segments, touch, by arc lengths as they are after an edit."""
    out = []
    for spot in [] if crossing.last is None else crossing.last[1]:
        moved, inside = spot.copy(), True
        for side, number in enumerate(spot.cables):
            before, after = (one.cables[names[number]] for one in (layout, change.origin))
            moved.arcs[side] = _solved_at(after, _made_at(before, moved.arcs[side]))
            inside = inside and 0.0 < moved.arcs[side] < after.cable.length
        moved.before = moved.arcs.copy()
        if inside:
            out.append(moved)
    return out


def _made_at(laid: Laid, arc: float) -> float:
    """[m], arc length of a cable as it was made, of one as it is solved for: from its end, where its start is open."""
    return laid.last - arc if laid.opened == "start" else laid.first + arc


def _solved_at(laid: Laid, arc: float) -> float:
    """[m], the other way round."""
    return laid.last - arc if laid.opened == "start" else arc - laid.first


def _load_between(load: ArrayLike | None, laid: Laid) -> ArrayLike | None:
    """The distributed load (2, 3) [N/m] of a whole cable at both grips; on a tail it is that at its end."""
    length = laid.made.length
    if load is None or (laid.first, laid.last) == (0.0, length):
        return load
    start, end = np.asarray(load, dtype=np.float64)
    shares = [min(max(at / length, 0.0), 1.0) for at in (laid.first, laid.last)]
    return np.array([(1.0 - x) * start + x * end for x in shares])
