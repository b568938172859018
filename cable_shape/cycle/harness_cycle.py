"""What a cycle does for one harness: predict it, and check and judge every segment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness, split_end
from cable_shape.cycle.cable_cycle import check_parts, tail_options
from cable_shape.cycle.dynamic import DYNAMIC, QUASISTATIC, Dynamic, nearest
from cable_shape.cycle.harness_stability import HarnessStability
from cable_shape.cycle.seen import AsSeen
from cable_shape.motion.harness_motion import HarnessMotion
from cable_shape.pose import Grip, Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.layout import cable_id
from cable_shape.prediction.tails import Tail, held_frame, runs
from cable_shape.safety.allowed import Allowed
from cable_shape.safety.caught import Caught
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import Ahead, CableWarning, Clearance, Margin, WarningKind
from cable_shape.safety.snap import Find
from cable_shape.safety.warnings import (
    Standing,
    ahead_warnings,
    bridged_warning,
    narrow_warning,
    tail_warning,
    tube_warning,
    warnings_of,
)
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.uncertainty.harness_motion_tube import HarnessMotionTube
from cable_shape.uncertainty.harness_tube_watch import HarnessTubeWatch
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

Links = Mapping[str, Pose] | None


@final
class Found(NamedTuple):
    """A usable shape of a harness with its tails, and between what ends it was found, with links where."""

    shape: HarnessShape
    tails: Mapping[tuple[str, str], CableShape]
    ends: Mapping[str, End]
    links: Links


def beside_each_other(name: str, harness: Harness) -> set[frozenset[str]]:
    """Pairs of segments, by their ids, that meet in a junction: their clearance there is no clearance."""
    out = set()
    for junction in harness.junctions:
        ids = {cable_id(name, end.rpartition(".")[0]) for end in junction.ends}
        out |= {frozenset((a, b)) for a in ids for b in ids if a != b}
    return out


@final
class HarnessCycle:
    """One harness, cycle by cycle. Parameters are those of :class:`cable_shape.Cycle`.

    look_ahead: None: at rest in every instant; else it swings, with so far [s] a look ahead, 0: without.
    How far its inertia counts is judged segment by segment, from how the ends of each move in the prediction.
    """

    def __init__(
        self,
        name: str,
        harness: Harness,
        scene: Scene,
        robot_links: Sequence[Obstacle],
        gripping_links: Sequence[str],
        options: Mapping[str, Any],
        snap_horizon: float,
        quasistatic_limit: float | None,
        uncertainty: Uncertainty | None,
        look_ahead: float | None = None,
    ) -> None:
        self.name, self.scene = name, scene
        self.predictor = HarnessPredictor(
            harness, scene=scene, robot_links=robot_links, gripping_links=gripping_links, name=name, **options
        )
        self.cables = {cable_id(name, segment): cable for segment, cable in harness.segments.items()}
        may_be_held = {cable_id(name, split_end(end)[0]) for end in harness.open_ends}
        self._checkers = {
            one: ClearanceChecker(
                scene,
                cable=cable,
                robot_links=robot_links,
                gripping_links=gripping_links if one in may_be_held else (),
            )
            for one, cable in self.cables.items()
        }
        self._allowed = {
            one: Allowed(scene, cable, robot_links, gripping_links if one in may_be_held else ())
            for one, cable in self.cables.items()
        }
        self._judged: dict[str, Clearance] = {}  # of which there may be alarm
        self._links: Links = None  # where they were in the last check
        gravity = self.predictor.problem.gravity
        self._caught = {one: Caught(cable, scene, gravity, self.cables.values()) for one, cable in self.cables.items()}
        self._watches = {
            one: MarginWatch(cable, scene, gravity=gravity, quasistatic_limit=quasistatic_limit)
            for one, cable in self.cables.items()
        }
        self._standing = {one: Standing(scene) for one in self.cables}
        self.stability = HarnessStability(self.predictor, snap_horizon)
        self._known: HarnessTubeWatch | None = None
        self.dynamic: Any = None  # a `Dynamic`, or one of several that swing together, see `swinging`
        if look_ahead is not None:
            given: dict[str, Any] = {"gravity": gravity, "points": self.predictor.problem.points}
            given |= {"distributed_load": options.get("distributed_load"), "robot_links": robot_links}
            given["gripping_links"] = gripping_links
            self.dynamic = Dynamic(
                HarnessMotion(harness, scene, name=name, **given)
                if uncertainty is None
                else HarnessMotionTube(harness, uncertainty, scene, name=name, **given),
                options.get("distributed_load"),
            )
        elif uncertainty is not None:
            self._known = HarnessTubeWatch(harness, uncertainty, scene=scene, **options)
        self._swung = None if self.dynamic is None else self.dynamic.tube
        self._look_ahead = look_ahead or 0.0
        self.ahead: dict[str, Ahead] = {}  # of the last shape's segments, by their ids
        self._tails: dict[str, Tail] = {}
        hanging = tail_options(self.predictor, scene, robot_links, gripping_links)
        for end, long in harness.tails.items():
            segment, side = split_end(end)
            self._tails[end] = Tail(harness.segments[segment], side, long, **hanging)
        self.tails: dict[tuple[str, str], CableShape] = {}  # by id of the segment and side
        self.tubes: dict[str, Tube] = {}  # of the last shape's segments, if they are asked for and known
        self.tail_tubes: dict[tuple[str, str], Tube] = {}  # of its tails, likewise
        self._moving: Mapping[str, ArrayLike] | None = None  # acceleration of the last shape
        self._seen: AsSeen | None = None  # the last shape was seen, not predicted
        self.found: Found | None = None  # the last usable shape

    def reset(self) -> None:
        """Forgets everything from before."""
        self.predictor.reset()
        if self.dynamic is not None:
            self.dynamic.reset()
        for watch in self._watches.values():
            watch.reset()
        for standing in self._standing.values():
            standing.reset()
        self.stability.reset()
        for tail in self._tails.values():
            tail.reset()
        self.tubes, self.tails, self.tail_tubes, self.ahead = {}, {}, {}, {}
        self._seen = None
        self.found = None
        if self._known is not None:
            self._known.reset()

    def predict(
        self,
        ends: Mapping[str, End],
        links: Links,
        acceleration: Mapping[str, ArrayLike] | None,
        stamp: int = 0,
        solved: HarnessShape | None = None,
    ) -> HarnessShape:
        """The shape of the harness, unless it has been solved for, and those of tails beyond its grips into `tails`."""
        self._moving = acceleration
        if solved is not None:
            shape = solved
        elif self.dynamic is None:
            shape = self.predictor.predict(ends, links=links, acceleration=acceleration)
        else:
            shape = self.dynamic.predict(ends, stamp, links)
        self.tails = self._hang(shape, ends, links)
        if shape.status:
            self.found = Found(shape, self.tails, ends, links)
        return shape

    def take_seen(self, seen: AsSeen, ends: Mapping[str, End], links: Links) -> None:
        """Judges a shape that was seen in place of that which was just predicted."""
        assert isinstance(seen.shape, HarnessShape)
        self._seen = seen
        self.tails = self._hang(seen.shape, ends, links)

    def look_again(self) -> None:
        """Before the next prediction: after a shape that was seen it is no repetition, though ends stood still."""
        if self._seen is not None:
            self._seen = None
            self.predictor.look_again()

    def begin(self, shape: HarnessShape, ends: Mapping[str, End], links: Links) -> None:
        """Takes over a shape at which its predictor has arrived: the next step is not that shape again, but goes on."""
        self.predictor.look_again()
        self.found = Found(shape, self._hang(shape, ends, links), ends, links)

    def swing_on(self, before: HarnessCycle, shape: HarnessShape, ends: Mapping[str, End], links: Links) -> None:
        """Goes on from a shape with its velocity, the last one of the part before an edit."""
        assert self.dynamic is not None
        assert before.dynamic is not None
        self.dynamic.go_on_from(before.dynamic, shape, ends, links)
        self.begin(shape, ends, links)

    def go_on_from(self, other: HarnessCycle) -> None:
        """Takes over what another one remembers of the same harness beside its shape."""
        for one, standing in self._standing.items():
            standing.go_on_from(other._standing[one])

    def begin_tails(
        self, lying: Mapping[str, CableShape], shape: HarnessShape, ends: Mapping[str, End], links: Links
    ) -> None:
        """Has tails of a shape between these ends go on from how they lie, by the ends that they hang beyond."""
        for end, tail in lying.items():
            held, (segment, side) = ends.get(end), split_end(end)
            if isinstance(held, (Pose, Grip)) and end in self._tails and self._tails[end].lies:
                self._tails[end].begin(tail, held_frame(held, shape.segments[segment], side), links)

    def _hang(self, shape: HarnessShape, ends: Mapping[str, End], links: Links) -> dict[tuple[str, str], CableShape]:
        """The tails of a shape between these ends."""
        tails = {}
        for end, tail in self._tails.items():
            held, (segment, side) = ends.get(end), split_end(end)
            if isinstance(held, (Pose, Grip)):
                there = held_frame(held, shape.segments[segment], side)
                tails[cable_id(self.name, segment), side] = tail.predict(there, links)
        return tails

    def check_found(self, found: Found) -> list[tuple[str, Cable, Clearance]]:
        """Every segment by its id, and the clearance of its shape, and of its tails."""
        tails = ((one, tail) for (one, _), tail in found.tails.items())
        return [
            (one, self.cables[one], self._checkers[one].check(part, found.links))
            for one, part in (*self.parts(found.shape).items(), *tails)
        ]

    def spread(self, shape: HarnessShape, ends: Mapping[str, End], links: Links, stamp: int) -> dict[str, Tube]:
        """The tubes of the segments of the shape just predicted, if they are asked for and known; kept."""
        inertia = 0.0  # in the load already
        if self._moving is None:
            ratios = [
                self._watches[one].inertia(part, (_frame(part, 0), _frame(part, -1)), stamp)
                for one, part in (self.parts(shape) if shape.status else {}).items()
            ]
            inertia = math.nan if any(map(math.isnan, ratios)) else max(ratios, default=math.nan)
        known = self._known or self._swung
        if known is not None and self._seen is not None:
            known.trouble = ""
            told: Any = self._seen.tube or {}
            self.tubes, self.tail_tubes = {cable_id(self.name, segment): tube for segment, tube in told.items()}, {}
        elif self._swung is not None:
            self.tubes = {cable_id(self.name, segment): tube for segment, tube in self._swung.tubes(shape).items()}
        elif self._known is not None:
            found = self._known.tubes(self.predictor, shape, ends, self._moving, inertia, links)
            self.tubes, self.tail_tubes = {cable_id(self.name, segment): tube for segment, tube in found.items()}, {}
            for key, tail in self.tails.items():
                end = self._end_of(key)
                tube = self._known.tail_tube(end, self._tails[end], tail, ends)
                if tube is not None:
                    self.tail_tubes[key] = tube
        return self.tubes

    def _end_of(self, key: tuple[str, str]) -> str:
        """The end "a.start" of a tail by its segment's id and side."""
        return f"{key[0].rpartition('/')[2]}.{key[1]}"

    def parts(self, shape: HarnessShape) -> dict[str, CableShape]:
        """The shapes of the segments, by their ids."""
        return {cable_id(self.name, segment): one for segment, one in shape.segments.items()}

    def check(self, shapes: Mapping[str, CableShape], links: Links) -> dict[str, Clearance]:
        """The clearance of every segment."""
        self._links = links
        if self.scene.contact == "off":
            return {one: Clearance(beyond=0.0, robot_checked=links is not None) for one in shapes}
        self._look(shapes, links)
        hanging: dict[str, list[tuple[Tail, CableShape, Tube | None]]] = {one: [] for one in shapes}
        for key, tail in self.tails.items():
            hanging[key[0]].append((self._tails[self._end_of(key)], tail, self.tail_tubes.get(key)))
        return {
            one: check_parts(self._checkers[one], shape, self.tubes.get(one), hanging[one], links)
            for one, shape in shapes.items()
        }

    def _look(self, shapes: Mapping[str, CableShape], links: Links) -> None:
        """Where the segments swing if the grips stop now, into `ahead`."""
        if self.dynamic is None or self._look_ahead == 0.0 or any(shape.reused for shape in shapes.values()):
            return
        self.ahead = {}
        usable = all(shape.status for shape in shapes.values())
        looks = self.dynamic.ahead(self._look_ahead) if usable else []
        for one, checker in self._checkers.items():
            segment = one.rpartition("/")[2]
            found = nearest(
                [(time, shape.segments[segment]) for time, shape in looks], partial(checker.check, links=links)
            )
            if found is not None:
                self.ahead[one] = found

    def margins(
        self, shape: HarnessShape, clearance: Mapping[str, Clearance], stamp: int, find: Find | None = None
    ) -> dict[str, tuple[Margin, ...]]:
        """How far trouble is of every segment, stability with the one that turns most; times from two cycles.

        find: what looks for a snap, of what touches others.
        """
        found = {}
        for one, part in self.parts(shape).items():
            self._judged[one], forces = self._judge(one, part, clearance[one])
            found[one] = self._watches[one].margins(part, self._judged[one], stamp) + forces
            found[one] += self._caught[one].margins(part)
        if self._moving is not None:  # the prediction does not leave it out
            found = {
                one: tuple(m for m in margins if m.kind is not WarningKind.QUASISTATIC)
                for one, margins in found.items()
            }
        self.stability.judge(shape, stamp, None if self._seen is None else self._seen.rod, find)
        if self.stability.margin is not None:
            softest = cable_id(self.name, self.stability.segment)
            found[softest] = (*found[softest], self.stability.margin)
        return found

    def _judge(self, one: str, shape: CableShape, clearance: Clearance) -> tuple[Clearance, tuple[Margin, ...]]:
        """The clearance of a segment of which there may be alarm, and the margins of forces of meant contact."""
        if not self._allowed[one]:
            return clearance, ()
        hanging: list[tuple[CableShape, float, float]] = []
        known = [self.tubes[one]] if one in self.tubes else []
        for key, tail in self.tails.items():
            if key[0] == one:
                hanging.append((tail, *runs(key[1], shape.length)))
                known += [self.tail_tubes[key]] if key in self.tail_tubes else []
        swell = max((float(tube.radius.max()) for tube in known), default=0.0)
        return self._allowed[one].judged(shape, clearance, self._links, swell, hanging)

    @property
    def after_snap(self) -> dict[str, CableShape]:
        """The segments after a snap that is about to come."""
        after = self.stability.snaps.after
        return self.parts(after) if isinstance(after, HarnessShape) else {}

    def warnings(
        self,
        shapes: Mapping[str, CableShape],
        margins: Mapping[str, tuple[Margin, ...]],
    ) -> list[CableWarning]:
        """What to say of every segment."""
        tolerance = self.predictor.problem.tolerance
        more = self.stability.warning(self.name)
        first, shape = next(iter(shapes.items()))
        known = self._known or self._swung
        if known is not None and known.trouble and shape.status:
            more.append(tube_warning(first, shape, known.trouble))
        elif first in self.tubes and not self.tubes[first].holds:
            more.append(narrow_warning(first, self.tubes[first]))
        if self.dynamic is not None and self.dynamic.bridged:
            more.append(bridged_warning(first, shape, self.dynamic.bridged))
        for one, told in self.ahead.items():
            more += ahead_warnings(one, self.scene, shapes[one], self._judged[one], *told)
        more += [
            tail_warning(one, side, tail) for (one, side), tail in self.tails.items() if tail.status is not Status.OK
        ]
        return more + [
            warning
            for one, shape in shapes.items()
            for warning in warnings_of(
                one,
                self.cables[one],
                self.scene,
                shape,
                self._judged[one],
                tolerance=tolerance,
                margins=margins[one],
                standing=self._standing[one],
                period=self._watches[one].period,
                tails=[tail for (of, _), tail in self.tails.items() if of == one],
            )
        ]


@final
@dataclass(frozen=True, slots=True)
class HarnessCycles:
    """Makes the :class:`HarnessCycle` of each harness, as often as it, or its scene, is another one.

    options: keywords of its predictor. distributed_load and uncertainty are by harness.
    """

    robot_links: Sequence[Obstacle]
    gripping_links: Sequence[str]
    options: Mapping[str, Any]
    distributed_load: Mapping[str, Any]
    snap_horizon: float
    quasistatic_limit: float | None
    uncertainty: Mapping[str, Uncertainty]
    motion: str = QUASISTATIC
    look_ahead: float = 0.0

    def make(self, name: str, harness: Harness, scene: Scene, load: Any) -> HarnessCycle:
        """The part of a harness in its scene, under distributed loads by segment."""
        keywords = {**self.options, "distributed_load": load}
        return HarnessCycle(
            name, harness, scene, self.robot_links, self.gripping_links, keywords, self.snap_horizon,
            self.quasistatic_limit if self.motion == QUASISTATIC else None, self.uncertainty.get(name),
            self.look_ahead if self.motion == DYNAMIC else None,
        )  # fmt: skip


def _frame(shape: CableShape, row: int) -> Pose:
    """The cable frame at an end of a segment."""
    return Pose.trusted(np.concatenate((shape.positions[row], shape.quaternions[row])))
