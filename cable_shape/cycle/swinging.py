"""Cables and harnesses of a cycle that touch each other as they swing: one motion of all of them, :class:`Swinging`."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, Generic, NamedTuple, TypeVar, cast, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import SIDES, Harness
from cable_shape.cable.junction import Junction
from cable_shape.cycle.dynamic import LONGEST, Dynamic, Held, Links
from cable_shape.motion.harness_motion import HarnessMotion
from cable_shape.motion.motion import Motion
from cable_shape.prediction.layout import cable_id
from cable_shape.scene.scene import Clip, PointMass, Scene
from cable_shape.scene.scene_parts import clip_names
from cable_shape.shape import CableShape, Status
from cable_shape.solve.harness_problem import End, renamed
from cable_shape.solve.harness_shape import HarnessShape

Shape = TypeVar("Shape", CableShape, HarnessShape)


@final
class Strung(NamedTuple):
    """A part as the motion of all knows it: what its segments are called there, by their own names, a cable's by ""."""

    name: str
    dynamic: Dynamic[Any]  # it would be, by itself
    scene: Scene
    keys: Mapping[str, str]

    @property
    def harness(self) -> Harness | None:
        """None: it is a cable."""
        motion = self.dynamic.motion
        return motion.harness if isinstance(motion, HarnessMotion) else None

    @property
    def cables(self) -> dict[str, Cable]:
        """By what they are called."""
        motion = self.dynamic.motion
        if isinstance(motion, Motion):
            return {self.keys[""]: motion.cable}
        return {self.keys[name]: cable for name, cable in motion.harness.segments.items()}

    @property
    def loads(self) -> dict[str, Any]:
        """Distributed loads, where there are some, likewise."""
        load = self.dynamic.load
        given = load if isinstance(self.dynamic.motion, HarnessMotion) else {"": load}
        return {self.keys[name]: one for name, one in (given or {}).items() if one is not None}

    @property
    def junctions(self) -> list[Junction]:
        """Those of a harness."""
        return [] if self.harness is None else [renamed(one, self.keys) for one in self.harness.junctions]

    @property
    def clips(self) -> list[Clip]:
        """Its clips, by what its segments are called, with names of their own: several parts may be in those of one."""
        own = zip(self.scene.clips, clip_names(self.scene.clips), strict=True)
        return [
            replace(clip, segment=self.keys[clip.segment or ""], name=f"{self.name}/{called}") for clip, called in own
        ]

    @property
    def masses(self) -> list[PointMass]:
        """Its masses, likewise."""
        return [replace(mass, segment=self.keys[mass.segment or ""]) for mass in self.scene.masses]

    def ends(self, ends: Held) -> dict[str, End]:
        """As those of all."""
        if isinstance(ends, Mapping):
            split = {end: end.rpartition(".") for end in ends}
            return {f"{self.keys[name]}.{side}": ends[end] for end, (name, _, side) in split.items()}
        return {f"{self.keys['']}.{side}": end for side, end in zip(SIDES, ends, strict=True)}

    def own_ends(self, ends: Mapping[str, End]) -> Held:
        """Of those of all its own."""
        own = {f"{name}.{side}": f"{key}.{side}" for name, key in self.keys.items() for side in SIDES}
        if self.harness is not None:
            return {end: ends[key] for end, key in own.items() if key in ends}
        return ends[own[".start"]], ends[own[".end"]]  # type: ignore[return-value]

    def told(self, shape: Any) -> dict[str, CableShape]:
        """Shapes of its segments, by what they are called."""
        if isinstance(shape, HarnessShape):
            return {self.keys[name]: one for name, one in shape.segments.items()}
        return {self.keys[""]: shape}

    def shape(self, whole: HarnessShape) -> Any:
        """What of a shape of all is its own. Energies are told of all together alone."""
        if self.harness is None:
            own: Any = whole.segments[self.keys[""]]
        else:
            segments = {name: whole.segments[key] for name, key in self.keys.items()}
            own = whole.on(self.harness, segments, cast("HarnessMotion", self.dynamic.motion).problem.clips)
            own.reused, own.energy = whole.reused, math.nan
        own.kinetic_energy = own.work = own.dissipated = own.lost = math.nan
        return own


@final
class OneOf(Generic[Shape]):
    """One of several that swing together, in place of a :class:`Dynamic`: they take their steps before it is asked."""

    tube = None

    def __init__(self, together: Swinging, name: str) -> None:
        self.together, self._strung = together, together.strung[name]
        self.alone = self._strung.dynamic
        self.motion, self.load = self.alone.motion, self.alone.load

    @property
    def bridged(self) -> float:
        """[s], see `Dynamic`."""
        return self.together.dynamic.bridged

    @property
    def stamp(self) -> int | None:
        """[ns], of the last step."""
        return self.together.dynamic.stamp

    @property
    def steps(self) -> list[float]:
        """[s], the last ones."""
        return self.together.dynamic.steps

    @property
    def last(self) -> Shape | None:
        """The shape after the last step; None: there is none."""
        whole = self.together.dynamic.last
        return None if whole is None else self._strung.shape(whole)

    @property
    def ends(self) -> Held | None:
        """At the last step."""
        ends = self.together.dynamic.ends
        return None if ends is None else self._strung.own_ends(cast("Mapping[str, End]", ends))

    @property
    def links(self) -> Links:
        """Likewise."""
        return self.together.dynamic.links

    def reset(self) -> None:
        """See `Dynamic`: of all."""
        self.together.dynamic.reset()

    def predict(self, ends: Held, stamp: int, links: Links = None) -> Shape:
        """See `Dynamic`: where the last step of all has led to."""
        shape: Shape = self._strung.shape(self.together.shape)
        return shape

    def ahead(self, seconds: float) -> list[tuple[float, Shape]]:
        """See `Dynamic`."""
        return [(time, self._strung.shape(shape)) for time, shape in self.together.ahead(seconds)]

    def by_itself(self) -> Dynamic[Any]:
        """The part as it swings on alone."""
        self.alone.reset()
        last, ends = self.last, self.ends
        if last is not None and ends is not None:
            self.alone.go_on_from(self, last, ends, self.links)
        return self.alone


@final
class Swinging:
    """Several parts that are kept out of each other as they swing.

    parts: by name, each as it swings so far, and its scene. options: keywords of the motion.
    """

    shape: HarnessShape  # the last one, of all

    def __init__(
        self, parts: Mapping[str, tuple[Dynamic[Any] | OneOf[Any], Scene]], options: Mapping[str, Any]
    ) -> None:
        self.strung: dict[str, Strung] = {}
        called: dict[str, str] = {}  # by what segments are called in the motion
        for name, (dynamic, scene) in parts.items():
            alone = dynamic.alone if isinstance(dynamic, OneOf) else dynamic
            keys = {}
            for segment in alone.motion.harness.segments if isinstance(alone.motion, HarnessMotion) else ("",):
                key = f"{name}.{segment}" if segment else name
                while key in called or (segment and key in parts):
                    key += "_"
                keys[segment], called[key] = key, cable_id(name, segment) if segment else name
            self.strung[name] = Strung(name, alone, scene, keys)
        every = self.strung.values()
        first = next(iter(every))
        scene = first.scene.replace(
            clips=[clip for one in every for clip in one.clips],
            masses=[mass for one in every for mass in one.masses],
            plug=None,
        )
        harness = Harness(
            {key: cable for one in every for key, cable in one.cables.items()},
            [junction for one in every for junction in one.junctions],
        )
        problem, loads = first.dynamic.motion.problem, {key: load for one in every for key, load in one.loads.items()}
        self.motion = HarnessMotion(
            harness, scene, problem.gravity, problem.points, distributed_load=loads or None, called=called, **options
        )
        self.dynamic = Dynamic[HarnessShape](self.motion)
        self.parts: dict[str, OneOf[Any]] = {name: OneOf(self, name) for name in parts}
        self._looks: tuple[HarnessShape, list[tuple[float, HarnessShape]]] | None = None

    def take_up(self, parts: Mapping[str, Dynamic[Any] | OneOf[Any]], left_by: Swinging | None) -> None:
        """Goes on from where these parts are, if all were somewhere within a second; left_by: with whom they were."""
        shapes = {name: one.last for name, one in parts.items()}
        stamps = [one.stamp for one in parts.values() if one.stamp is not None]
        if any(shape is None for shape in shapes.values()) or (max(stamps) - min(stamps)) * 1e-9 > LONGEST:
            return
        segments = {key: shape for name, one in self.strung.items() for key, shape in one.told(shapes[name]).items()}
        harness, newest = self.motion.harness, max(parts.values(), key=lambda one: one.stamp or 0)
        first = next(iter(segments.values()))
        buffer = np.concatenate([shape.buffer for shape in segments.values()])
        whole = HarnessShape(
            harness, buffer, first.points, model=first.model, status=Status.OK, bodies=first.bodies,
            error_estimate=max(shape.error_estimate for shape in segments.values()),
        )  # fmt: skip
        whole = whole.on(harness, segments, self.motion.problem.clips)
        ends = {name: one.ends for name, one in parts.items() if one.ends is not None}
        before = _Before(newest.stamp, newest.steps, None if left_by is None else left_by.motion)
        self.dynamic.go_on_from(before, whole, self._ends(ends), newest.links)

    def predict(self, held: Mapping[str, Held], stamp: int, links: Links) -> None:
        """Takes all to a stamp [ns], with the ends of each, and links, there."""
        self.shape = self.dynamic.predict(self._ends(held), stamp, links)

    def ahead(self, seconds: float) -> list[tuple[float, HarnessShape]]:
        """See `Dynamic`; all parts ask for the same."""
        if self._looks is None or self._looks[0] is not self.shape:
            self._looks = self.shape, self.dynamic.ahead(seconds)
        return self._looks[1]

    def _ends(self, held: Mapping[str, Held]) -> dict[str, End]:
        """Of all, as the motion takes them."""
        return {end: at for name, one in self.strung.items() for end, at in one.ends(held[name]).items()}


@final
class _Before(NamedTuple):
    """What of a `Dynamic` another one goes on from."""

    stamp: int | None
    steps: list[float]
    motion: HarnessMotion | None


def step_on(
    now: Swinging | None, parts: Mapping[str, Any], beside: Collection[str], grips: Mapping[str, Held], stamp: int,
    links: Links, options: Mapping[str, Any],
) -> Swinging | None:  # fmt: skip
    """Takes those of these parts that are `beside` each other a step on, for each to ask for its own; returns them.

    now: those that went together so far. A part that is alone goes on by itself.
    """
    names = [name for name in beside if name in parts]
    if len(names) < 2:
        names = []
    for name, part in parts.items():
        if name not in names and isinstance(part.dynamic, OneOf):
            part.dynamic = part.dynamic.by_itself()
    if not names:
        return now
    if now is None or [*now.parts] != names or any(parts[name].dynamic is not now.parts[name] for name in names):
        before: dict[str, Any] = {name: parts[name].dynamic for name in names}
        made = Swinging({name: (one, parts[name].scene) for name, one in before.items()}, options)
        made.take_up(before, now)
        for name in names:
            parts[name].dynamic = made.parts[name]
        now = made
    now.predict({name: grips[name] for name in names}, stamp, links)
    return now
