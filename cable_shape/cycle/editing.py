"""Edits of a cycle's cables and bodies: :class:`Editing` makes them on cables of its own, which are kept if all can be.

The way that an edit takes is followed as the motion of a grip is: in one step, or in as many as it takes for the
cable to keep to its branch. Each step goes on from the shape of the one before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import Cable
from cable_shape.cycle.cable_cycle import CableCycle, CableCycles, Found
from cable_shape.errors import ArgumentError
from cable_shape.pose import Ends, FreeEnd, Grip, Pose
from cable_shape.prediction.cables_predictor import joined
from cable_shape.prediction.carried import carried, place_of, stretched
from cable_shape.prediction.edits import Edit
from cable_shape.prediction.layout import Change, Laid, Layout, change_of, on_the_way
from cable_shape.scene.scene import Clip
from cable_shape.shape import CableShape, Status
from cable_shape.solve.network import Network
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.places import Spot

#: The shortest step, as a share of an edit's way.
_SMALLEST_STEP = 1.0 / 64.0
#: A shape so graded is on the branch of the one before.
_FOLLOWED = (Status.OK, Status.UNSTABLE, Status.BUDGET)

_Crossing = tuple[tuple[str, ...], Crossing]


@final
class Editing:
    """Some edits, one after the other.

    layout, cycles, crossing: what there is, which is left as it is; afterwards what the edits have made of it. maker:
    of the parts of cables.
    """

    def __init__(
        self, layout: Layout, cycles: Mapping[str, CableCycle], maker: CableCycles, crossing: _Crossing | None
    ) -> None:
        self.layout, self.cycles, self.crossing = layout, dict(cycles), crossing
        self._maker = maker
        self._taken = [body.name for body in maker.options["robot_links"]]

    @property
    def cables(self) -> dict[str, Cable]:
        """What is between the grips, by name."""
        return {name: laid.cable for name, laid in self.layout.cables.items()}

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
        names = [n for n, laid in goal.cables.items() if bodies or laid != self.layout.cables[n] or self.crossing]
        made = {name: self._made(goal, name) for name in names}
        way = _Way(self.layout, change, self.cycles, made, self.crossing)
        self._refuse_inside(change, made)
        way.go()
        for name, new in made.items():
            old, laid, then = self.cycles[name], goal.cables[name], self.layout.cables[name]
            ends = (laid.first, laid.last, laid.opened) == (then.first, then.last, then.opened)
            new.go_on_from(old, held_alike=ends)
        self.cycles.update(made)
        self.layout, self.crossing = goal, way.crossing

    def _place(self, name: str, clip: Clip) -> Pose | None:
        """Where a cable is that a clip is to hold, in the frame in which the clip's pose is."""
        found = self.cycles[name].found
        if found is None:
            return None
        there = place_of(found.shape, clip.arc_length)
        if clip.link is None:
            return there
        link = None if found.links is None else found.links.get(clip.link)
        if link is None:
            known = "none" if not found.links else ", ".join(sorted(found.links))
            bound = "where this link is was not known at the last step"
            raise ArgumentError.of("Insert.clip.link", clip.link, bound, f"Known: {known}.")
        return link.inverse() * there

    def _made(self, layout: Layout, name: str) -> CableCycle:
        """A cable's part in its new scene."""
        laid = layout.cables[name]
        load = _load_between(self._maker.distributed_load.get(name), laid)
        return self._maker.make(name, laid.cable, layout.scene_of(name), load)

    def _refuse_inside(self, change: Change, made: Mapping[str, CableCycle]) -> None:
        """A body that is added must not have the middle of a cable in it: on which side is that to be?"""
        new = {b.name for b in change.goal.scene.obstacles} - {b.name for b in self.layout.scene.obstacles}
        if not new or change.goal.scene.contact != "solve":
            return
        for name, cycle in made.items():
            found = self.cycles[name].found
            if found is None:
                continue
            radius = 0.5 * cycle.predictor.cable.diameter
            for body in cycle.check_shape(found.shape, found.links).bodies:
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
        cycles: Mapping[str, CableCycle],
        made: Mapping[str, CableCycle],
        crossing: _Crossing | None,
    ) -> None:
        self._change, self._made = change, made
        self._known: dict[str, Found] = {}  # by cable: where it is on the way
        self._memories: dict[str, Network | None] = {}
        self._spots: dict[str, list[Spot]] = {}  # where it touches itself, or, of all cables, each other
        for name in made:
            found, old = cycles[name].found, cycles[name].predictor
            if found is None:
                continue
            before, after = layout.cables[name], change.origin.cables[name]
            shape = carried(found.shape, found.tails, before, after)
            self._known[name] = Found(shape, {}, _ends(found, shape, before, after), found.links)
            stays = (before.first, before.last) == (after.first, after.last)
            self._memories[name] = old.memory if stays else None
            if crossing is None and old.crossing is not None:
                self._spots[name] = _carried_spots(old.crossing, (name,), layout, change)
        self.crossing: _Crossing | None = None
        self._names: tuple[str, ...] = ()
        if crossing is not None and all(name in self._known for name in crossing[0]):
            self._names = crossing[0]
            self._spots[""] = _carried_spots(crossing[1], self._names, layout, change)

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

    def _followed(self, name: str, shape: CableShape, done: float) -> bool:
        """Whether a shape is where the last one leads to."""
        slid = done == 0.0 and name in self._change.loose and shape.status is Status.SNAPPED
        return slid or shape.status in _FOLLOWED

    def _jump(self, done: float, shapes: Mapping[str, CableShape]) -> None:
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

    def _accept(self, shapes: Mapping[str, CableShape]) -> None:
        """These are where the cables are now."""
        for name, shape in shapes.items():
            self._known[name] = self._known[name]._replace(shape=shape)
            self._memories[name] = self._made[name].predictor.memory
            own = self._made[name].predictor.crossing
            if not self._names and own is not None and own.last is not None:
                self._spots[name] = own.last[1]
        if self.crossing is not None and self.crossing[1].last is not None:
            self._spots[""] = self.crossing[1].last[1]

    def _step(self, done: float, at: float, *, leap: bool) -> dict[str, CableShape]:
        """The shapes at a share of the way, from where the cables are at another one.

        leap: also where no small steps lead to them.
        """
        then, now = on_the_way(self._change, done), on_the_way(self._change, at)
        for name, known in self._known.items():
            cable = now.cables[name].cable
            self._made[name].predictor.leap(allowed=leap)
            self._made[name].predictor.begin(
                stretched(known.shape, cable.length),
                known.ends,
                known.links,
                cable=cable,
                scene=then.scene_of(name),
                loose=done == 0.0 and name in self._change.loose,
                memory=self._memories[name],
                spots=self._spots.get(name),
            )
        self.crossing = self._crossed()
        for name in self._known:
            own = (None, None) if at == 1.0 else (now.cables[name].cable, now.scene_of(name))
            self._made[name].predictor.head_for(*own)
        if self.crossing is None:
            return {name: self._made[name].predictor.solve() for name in self._known}
        return dict(zip(self._names, self.crossing[1].solve(), strict=True))

    def _crossed(self) -> _Crossing | None:
        """What keeps the cables out of each other from where they are; None: nothing does, or did so far."""
        predictors = [self._made[name].predictor for name in self._names]
        if not predictors or not all(one.problem.solves_crossing for one in predictors):
            return None
        crossing = joined(self._names, predictors)
        lengths = [predictor.cable.length for predictor in predictors]
        shapes = [stretched(self._known[name].shape, x) for name, x in zip(self._names, lengths, strict=True)]
        crossing.take_up(shapes, self._spots[""])
        return self._names, crossing


def _ends(found: Found, shape: CableShape, before: Laid, after: Laid) -> Ends:
    """What holds the ends of a shape after an edit: what held them before, or a grip there where the cable is."""
    start, end = found.ends
    if after.first != before.first:
        start = _grip_at(place_of(shape, 0.0), start)
    if after.opened:
        end = end if isinstance(end, FreeEnd) else None
    elif after.last != before.last or before.opened:
        end = _grip_at(place_of(shape, shape.length), end)
    return start, end


def _grip_at(place: Pose, before: Pose | Grip | FreeEnd | None) -> Pose | Grip:
    """Holds the cable where it is as it was held before."""
    return Grip(place, before.kind) if isinstance(before, Grip) else place


def _carried_spots(crossing: Crossing, names: Sequence[str], layout: Layout, change: Change) -> list[Spot]:
    """Where cables touch, by arc lengths as they are after an edit."""
    out = []
    for spot in [] if crossing.last is None else crossing.last[1]:
        moved, inside = spot.copy(), True
        for side, number in enumerate(spot.cables):
            before, after = (one.cables[names[number]] for one in (layout, change.origin))
            moved.arcs[side] += before.first - after.first
            inside = inside and 0.0 < moved.arcs[side] < after.cable.length
        moved.before = moved.arcs.copy()
        if inside:
            out.append(moved)
    return out


def _load_between(load: ArrayLike | None, laid: Laid) -> ArrayLike | None:
    """The distributed load (2, 3) [N/m] of a whole cable at both grips; on a tail it is that at its end."""
    length = laid.made.length
    if load is None or (laid.first, laid.last) == (0.0, length):
        return load
    start, end = np.asarray(load, dtype=np.float64)
    shares = [min(max(at / length, 0.0), 1.0) for at in (laid.first, laid.last)]
    return np.array([(1.0 - x) * start + x * end for x in shares])
