"""One cable's part of a cycle: :class:`CableCycle`, with all that is remembered from cycle to cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cycle.dynamic import DYNAMIC, QUASISTATIC, Dynamic, nearest
from cable_shape.cycle.seen import AsSeen
from cable_shape.cycle.turned_watch import TurnedWatch
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance import bounds
from cable_shape.motion.motion import Motion
from cable_shape.pose import Ends, Grip, Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.predictor import Predictor
from cable_shape.prediction.tails import Tail, held_frame, runs
from cable_shape.prediction.turned import TurnedPredictor
from cable_shape.safety.allowed import Allowed
from cable_shape.safety.caught import Caught
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import Ahead, BodyDistance, CableWarning, Clearance, Margin, WarningKind
from cable_shape.safety.snap import Find, SnapWatch, predicted_snap
from cable_shape.safety.warnings import (
    Standing,
    ahead_warnings,
    bridged_warning,
    narrow_warning,
    snap_warning,
    tail_warning,
    tube_warning,
    warnings_of,
)
from cable_shape.scene.plug import Plug, PlugError, plug_error
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve.answers import Solved
from cable_shape.solve.problem import NAMED_TOLERANCE
from cable_shape.uncertainty.motion_tube import MotionTube
from cable_shape.uncertainty.tube_watch import TubeWatch, left_out
from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

Links = Mapping[str, Pose] | None


@final
class Found(NamedTuple):
    """A usable shape of a cable with its tails, by side, and between what ends it was found, with links where."""

    shape: CableShape
    tails: Mapping[str, CableShape]
    ends: Ends
    links: Links


@final
class CableCycle:
    """Predicts, checks and judges one cable; the steps of :meth:`cable_shape.Cycle.step`, in their order.

    Parameters
    ----------
    name : str
    predictor : Predictor
    scene, robot_links, gripping_links
        As for :class:`~cable_shape.safety.clearance.ClearanceChecker`.
    plug : Plug, optional
        At the end of the cable.
    snap_horizon : float
        [s], a snap this near is predicted; 0: never.
    cables : int
        How many there are in all.
    tubes : TubeWatch, optional
        Makes clearance that of the cable's tube, and of those of its tails.
    quasistatic_limit : float, optional
        Of the load of inertia as a fraction of the weight; None: it is not told.
    dynamic : Dynamic, optional
        The cable swings; without it, it is at rest in every instant.
    look_ahead : float
        [s], how far to look where it swings if the grips stop now; 0: not at all.
    before : CableCycle, optional
        Of the same cable, before an edit: tails that are alike go on from where they are.
    """

    def __init__(
        self,
        name: str,
        predictor: Predictor | TurnedPredictor,
        scene: Scene,
        robot_links: Sequence[Obstacle],
        gripping_links: Sequence[str],
        plug: Plug | None,
        snap_horizon: float,
        cables: int = 1,
        tubes: TubeWatch | None = None,
        quasistatic_limit: float | None = None,
        dynamic: Dynamic[CableShape] | None = None,
        look_ahead: float = 0.0,
        before: CableCycle | None = None,
    ) -> None:
        self.name = name
        self.dynamic: Any = dynamic  # or one of several that swing together, see `swinging`
        self._look_ahead = look_ahead
        self._swung = None if dynamic is None else dynamic.tube
        self.predictor = predictor
        self.scene = scene
        cable, problem = predictor.cable, predictor.problem
        self._tails: dict[str, Tail]
        hanging = tail_options(predictor.solo, scene, robot_links, gripping_links)
        self._tails = {side: Tail(cable, side, length, **hanging) for side, length in cable.tails.items()}
        if before is not None and predictor.is_rod and before.predictor.cable == cable:
            self._tails.update({side: tail.twin() for side, tail in before._tails.items() if not tail.lies})
        checker = ClearanceChecker(scene, cable=cable, robot_links=robot_links, gripping_links=gripping_links)
        self._checker = checker
        self._allowed = Allowed(scene, cable, robot_links, gripping_links)
        self._caught = Caught(cable, scene, problem.gravity)
        self._plug = plug
        self._snaps = SnapWatch(snap_horizon)
        moving = np.concatenate((checker.moving, np.ones(cables, dtype=np.bool_)))  # other cables, and itself
        moving |= problem.clips_move  # the grips do not tell alone then how it comes nearer
        watch = TurnedWatch if isinstance(predictor, TurnedPredictor) else MarginWatch
        self._watch = watch(cable, scene, moving, gravity=problem.gravity, quasistatic_limit=quasistatic_limit)
        self._standing = Standing(scene)
        self._tubes = tubes
        self._forget()

    def reset(self) -> None:
        """Forgets everything from before."""
        self.predictor.reset()
        if self.dynamic is not None:
            self.dynamic.reset()
        for tail in self._tails.values():
            tail.reset()
        self._watch.reset()
        self._standing.reset()
        self._snaps.reset()
        if self._tubes is not None:
            self._tubes.reset()
        self._forget()

    def _forget(self) -> None:
        """The part of it that is kept here."""
        self.ahead: Ahead | None = None  # of the last shape
        self.tube: Tube | None = None  # of the last shape, if it is asked for and known
        self.tail_tubes: dict[str, Tube] = {}  # of the tails, by side
        self._rod: Solved | None = None  # of the last shape
        self._seen: AsSeen | None = None  # the last shape was seen, not predicted
        self._acceleration: ArrayLike | None = None  # that it was loaded with
        self.tails: dict[str, CableShape] = {}  # by side
        self.found: Found | None = None  # the last usable shape
        self._links: Links = None  # where they were in the last check
        self._judged = Clearance()  # of which there may be alarm

    def go_on_from(self, other: CableCycle, *, held_alike: bool) -> None:
        """Takes over what another one remembers of the same cable beside its shape.

        held_alike: its grips hold the same points of it.
        """
        self._standing.go_on_from(other._standing)
        if held_alike and isinstance(self._watch, MarginWatch) and isinstance(other._watch, MarginWatch):
            self._watch.go_on_from(other._watch, still=_still(self.found, other.found))

    def predict(
        self, ends: Ends, links: Links, solved: CableShape | None = None, acceleration: ArrayLike | None = None,
        stamp: int = 0,
    ) -> CableShape:  # fmt: skip
        """The shape of the span, unless it has been solved for, and of the tails into `tails`."""
        start, end = ends
        self._acceleration = acceleration
        shape: CableShape
        if self.dynamic is not None:
            shape, self._rod = self.dynamic.predict(ends, stamp, links), None
        else:
            shape = self.predictor.predict(start, end, links, acceleration=acceleration) if solved is None else solved
            self._rod = self.predictor.rod_state
        self.tails = self.hang(shape, ends, links)
        if shape.status:
            self.found = Found(shape, self.tails, ends, links)
        return shape

    def take_seen(self, seen: AsSeen, ends: Ends, links: Links) -> None:
        """Judges a shape that was seen in place of that which was just predicted."""
        assert isinstance(seen.shape, CableShape)
        self._seen, self._rod = seen, seen.rod
        self.tails = self.hang(seen.shape, ends, links)

    def look_again(self) -> None:
        """Before the next prediction: after a shape that was seen it is no repetition, though ends stood still."""
        if self._seen is not None:
            self._seen = None
            self.predictor.look_again()

    def begin(self, shape: CableShape, ends: Ends, links: Links) -> None:
        """Takes over a shape at which its predictor has arrived: the next step is not that shape again, but goes on."""
        self.predictor.look_again()
        if self._tubes is not None and shape.length == self.predictor.cable.length:
            self._tubes.begin(shape, ends, links)
        self.found = Found(shape, self.hang(shape, ends, links), ends, links)

    def swing_on(self, before: CableCycle, shape: CableShape, ends: Ends, links: Links) -> None:
        """Goes on from a shape with its velocity, the last one of the part before an edit."""
        assert self.dynamic is not None
        assert before.dynamic is not None
        self.dynamic.go_on_from(before.dynamic, shape, ends, links)
        self.begin(shape, ends, links)

    def begin_tails(self, lying: Mapping[str, CableShape], shape: CableShape, ends: Ends, links: Links) -> None:
        """Has tails of a shape between these ends go on from how they lie, by side."""
        for side, tail in lying.items():
            grip = ends[0] if side == "start" else ends[1]
            if isinstance(grip, (Pose, Grip)) and side in self._tails and self._tails[side].lies:
                self._tails[side].begin(tail, held_frame(grip, shape, side), links)

    def hang(self, shape: CableShape, ends: Ends, links: Links) -> dict[str, CableShape]:
        """The tails of a shape between these ends, by side."""
        tails = {}
        for side, tail in self._tails.items():
            grip = ends[0] if side == "start" else ends[1]
            if isinstance(grip, (Pose, Grip)):
                tails[side] = tail.predict(held_frame(grip, shape, side), links)
        return tails

    def check_shape(self, shape: CableShape, links: Links) -> Clearance:
        """The clearance of the shape of a span, or of a tail."""
        return self._checker.check(shape, links)

    def spread(self, shape: CableShape, ends: Ends, links: Links, stamp: int) -> Tube | None:
        """The tube of the shape just predicted, if it is asked for and known; kept, and those of the tails."""
        self.tail_tubes = {}
        if self._tubes is not None and self._seen is not None:
            self._tubes.trouble = ""
            self.tube = self._seen.tube  # type: ignore[assignment]
        elif self._swung is not None:
            self.tube = self._swung.tubes(shape).get("")
        elif self._tubes is not None:
            if self._acceleration is not None:
                inertia = left_out(self._tubes.uncertainty, self._acceleration, self.predictor.problem.gravity)
            else:
                assert isinstance(self._watch, MarginWatch)  # tubes are of cables whose start is held
                inertia = self._watch.inertia(shape, ends, stamp) if shape.status else math.nan
            self.tube = self._tubes.tube(self.predictor.solo, shape, ends, links, self._acceleration, inertia=inertia)
            for side, tail in self.tails.items():
                tube = self._tubes.tail_tube(self._tails[side], tail, ends)
                if tube is not None:
                    self.tail_tubes[side] = tube
        return self.tube

    def check(self, shape: CableShape, links: Links) -> Clearance:
        """The clearance of span and tails, as thick as their tubes: for each body that of the nearest part."""
        self._links = links
        if self.scene.contact == "off":
            return Clearance(beyond=0.0, robot_checked=links is not None)
        if self.dynamic is not None and self._look_ahead > 0.0 and shape.status and not shape.reused:
            looks = self.dynamic.ahead(self._look_ahead)
            self.ahead = nearest(looks, lambda there: self._checker.check(there, links))
        elif not shape.reused:
            self.ahead = None
        hanging = [(self._tails[side], tail, self.tail_tubes.get(side)) for side, tail in self.tails.items()]
        return check_parts(self._checker, shape, self.tube, hanging, links)

    def margins(
        self, shape: CableShape, clearance: Clearance, ends: Ends, stamp: int, find: Find | None = None
    ) -> tuple[Margin, ...]:
        """How far trouble is, and with it whether the cable is about to snap.

        find: what looks for that, of cables that touch.
        """
        self._judged, forces = self._judge(shape, clearance)
        margins = self._watch.margins(shape, self._judged, stamp, state=self._rod, ends=ends) + forces
        margins += self._caught.margins(shape, ends[1])
        if self._acceleration is not None:  # the prediction does not leave it out
            margins = tuple(margin for margin in margins if margin.kind is not WarningKind.QUASISTATIC)
        find = find or (None if self._watch.twists is None else self._snap_within)
        self._snaps.look(self._watch.stability, stamp, find)
        return margins

    def _judge(self, shape: CableShape, clearance: Clearance) -> tuple[Clearance, tuple[Margin, ...]]:
        """The clearance of which there may be alarm, and the margins of forces of contact that is meant."""
        if not self._allowed:
            return clearance, ()
        hanging = [(tail, *runs(side, shape.length)) for side, tail in self.tails.items()]
        known = [tube for tube in (self.tube, *self.tail_tubes.values()) if tube is not None]
        swell = max((float(tube.radius.max()) for tube in known), default=0.0)
        return self._allowed.judged(shape, clearance, self._links, swell, hanging)

    def _snap_within(self, horizon: float) -> tuple[float, float, CableShape] | None:
        """See `predicted_snap`."""
        problem, twists = self.predictor.problem, self._watch.twists
        assert twists is not None
        return predicted_snap(self.predictor.ahead(), (problem.start, problem.end), twists, horizon)

    @property
    def after_snap(self) -> CableShape | None:
        """The shape after a snap that is about to come."""
        return self._snaps.after  # type: ignore[return-value]

    @property
    def snap_skipped(self) -> bool:
        """There was no need to look for a snap."""
        return self._snaps.skipped

    def warnings(self, shape: CableShape, margins: tuple[Margin, ...]) -> tuple[CableWarning, ...]:
        """What to say of a shape with these margins, see `margins`."""
        found = warnings_of(
            self.name,
            self.predictor.cable,
            self.scene,
            shape,
            self._judged,
            tolerance=self.predictor.problem.tolerance,
            margins=margins,
            standing=self._standing,
            period=self._watch.period,
            tails=tuple(self.tails.values()),
        )
        more, after, stability = [], self.after_snap, self._watch.stability
        told = self._tubes if self._swung is None else self._swung
        if after is not None and stability is not None:
            more.append(snap_warning(self.name, stability, self._snaps.time, shape, after))
        if told is not None and told.trouble and shape.status:
            more.append(tube_warning(self.name, shape, told.trouble))
        elif self.tube is not None and not self.tube.holds:
            more.append(narrow_warning(self.name, self.tube))
        if self.dynamic is not None and self.dynamic.bridged:
            more.append(bridged_warning(self.name, shape, self.dynamic.bridged))
        if self.ahead is not None:
            more += ahead_warnings(self.name, self.scene, shape, self._judged, *self.ahead)
        more += [
            tail_warning(self.name, side, tail) for side, tail in self.tails.items() if tail.status is not Status.OK
        ]
        if not more:
            return found
        return tuple(sorted((*found, *more), key=lambda w: (-w.severity.value, -w.margin)))

    def plug_error(self, shape: CableShape) -> PlugError | None:
        """Where the plug is against its socket; None without one, or without a shape."""
        if self._plug is None or not shape.status:
            return None
        return plug_error(self._plug, self.scene.sockets[self._plug.socket], shape)


def _still(one: Found | None, other: Found | None) -> bool:
    """Whether two shapes of a cable are one, as exactly as it is solved for."""
    if one is None or other is None or one.shape.buffer.shape != other.shape.buffer.shape:
        return False
    way = np.abs(one.shape.positions - other.shape.positions).max()
    return bool(way <= NAMED_TOLERANCE * one.shape.length)


@final
@dataclass(frozen=True, slots=True)
class CableCycles:
    """Makes the :class:`CableCycle` of each of `count` cables, as often as its cable or scene is another one.

    options: of predictors and tubes. distributed_load, plugs and uncertainty are by cable.
    """

    model: str
    tolerance: float | None
    options: Mapping[str, Any]
    distributed_load: Mapping[str, ArrayLike | None]
    plugs: Mapping[str, Plug]
    uncertainty: Mapping[str, Uncertainty]
    snap_horizon: float
    quasistatic_limit: float | None
    count: int
    motion: str = QUASISTATIC
    look_ahead: float = 0.0

    def make(
        self, name: str, cable: Cable, scene: Scene, load: ArrayLike | None, *, turned: bool = False,
        before: CableCycle | None = None,
    ) -> CableCycle:  # fmt: skip
        """The part of a cable in its scene, under a distributed load (2, 3) [N/m]; turned: its start hangs free.

        before: the part that it follows.
        """
        options = {**self.options, "scene": scene, "distributed_load": load}
        kind = TurnedPredictor if turned else Predictor
        predictor = kind(cable, model=self.model, tolerance=self.tolerance, **options)
        tubes = None
        if turned and self.uncertainty.get(name) is not None:
            bound = f"how well cable {name!r} is known is told from its start, which a grip holds"
            raise ArgumentError.of("Open.end", "start", bound, "Open the end, or leave its uncertainty out.")
        if self.uncertainty.get(name) is not None:
            if not predictor.is_rod:
                bound = "only the Cosserat rod knows how its shapes change"
                raise ArgumentError.of("model", self.model, bound, "Choose 'cosserat' or 'auto', or no uncertainty.")
            if self.motion != DYNAMIC:
                tubes = TubeWatch(cable, self.uncertainty[name], **options)
        plug = self.plugs.get(name, scene.plug)
        if plug is not None:
            checks.instance(f"plugs[{name!r}]", plug, (Plug,), "Write Plug(socket).")
            checks.one_of(f"plugs[{name!r}].socket", plug.socket, scene.sockets)
        dynamic = None
        if self.motion == DYNAMIC:
            if turned:
                raise ArgumentError.of("Open.end", "start", "what swings is held at its start", "Open the end.")
            self._check_dynamic(predictor.solo)
            problem, known = predictor.problem, self.uncertainty.get(name)
            keywords = {key: options[key] for key in ("robot_links", "gripping_links", "distributed_load")}
            keywords |= {"gravity": problem.gravity, "points": problem.points}
            made = Motion(cable, scene, **keywords) if known is None else MotionTube(cable, known, scene, **keywords)
            dynamic = Dynamic[CableShape](made, load)
        return CableCycle(
            name, predictor, scene, self.options["robot_links"], self.options["gripping_links"], plug,
            self.snap_horizon, self.count, tubes, self.quasistatic_limit if dynamic is None else None, dynamic,
            self.look_ahead, before,
        )  # fmt: skip

    def _check_dynamic(self, predictor: Predictor) -> None:
        """Refuses what a cable that swings does not go together with."""
        if not predictor.is_rod:
            raise ArgumentError.of("model", self.model, "only the Cosserat rod swings", "Choose 'cosserat' or 'auto'.")


def tail_options(
    predictor: Predictor | HarnessPredictor,
    scene: Scene,
    robot_links: Sequence[Obstacle],
    gripping_links: Sequence[str],
) -> dict[str, Any]:
    """Keywords of the tails of what this predicts, in this scene."""
    budget = None if predictor.time_budget == math.inf else predictor.time_budget
    problem = predictor.problem
    return {
        "gravity": problem.gravity, "points": problem.points, "scene": scene, "robot_links": robot_links,
        "gripping_links": gripping_links, "time_budget": budget,
    }  # fmt: skip


def refuse_acceleration(name: str) -> NoReturn:
    """Of what swings: an acceleration is not given."""
    bound = "motion='dynamic' knows its inertia itself"
    raise ArgumentError.of("acceleration", name, bound, "Leave it out, or write motion='quasistatic'.")


def check_parts(
    checker: ClearanceChecker,
    shape: CableShape,
    tube: Tube | None,
    hanging: Sequence[tuple[Tail, CableShape, Tube | None]],
    links: Links,
) -> Clearance:
    """The clearance of a span and of the tails beyond it, as thick as their tubes: of each body that of the nearest."""
    clearance = checker.check(shape, links, None if tube is None else tube.radius)
    if not hanging:
        return clearance
    parts = [clearance]
    for tail, there, known in hanging:
        part = checker.check(there, links, None if known is None else known.radius)
        moved = tuple(
            BodyDistance(b.body, b.distance, tail.along(b.arc_length, shape.length), b.point_on_cable, b.point_on_body)
            for b in part.bodies
        )
        parts.append(Clearance(moved, part.beyond, part.robot_checked, part.pairs_culled, part.pairs_exact))
    return _nearest(parts, checker.names)


def _nearest(parts: Sequence[Clearance], names: Sequence[str]) -> Clearance:
    """One clearance of several parts of a cable."""
    nearest: dict[str, BodyDistance] = {}
    for part in parts:
        for body in part.bodies:
            if body.body not in nearest or body.distance < nearest[body.body].distance:
                nearest[body.body] = body
    table = np.full((len(names), bounds.RESULT_COLUMNS), np.inf)
    for row, name in zip(table, names, strict=True):
        if name in nearest:
            b = nearest[name]
            row[:] = (b.distance, b.arc_length, *b.point_on_cable, *b.point_on_body)
    return Clearance(
        bodies=tuple(nearest[name] for name in names if name in nearest),
        beyond=min(part.beyond for part in parts),
        robot_checked=all(part.robot_checked for part in parts),
        pairs_culled=sum(part.pairs_culled for part in parts),
        pairs_exact=sum(part.pairs_exact for part in parts),
        table=table,
    )
