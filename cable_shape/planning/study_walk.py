"""The shapes of one case at all its instants, each from the one before it: :func:`walk`.

A rod that touches nothing is followed in compiled code (:mod:`cable_shape.kernels.safety.follow_rows`); where one warm
solve does not do, and for harnesses, contact, eyelets, sections and closed forms, a predictor is asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.kernels.distance import bounds
from cable_shape.kernels.network import drive
from cable_shape.kernels.safety import follow_rows
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.planning.study_case import Case
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.prediction.nearby import Memory, memory_of
from cable_shape.prediction.predictor import Predictor
from cable_shape.robots.robot import Robot
from cable_shape.safety.clearance import NOT_JUDGED, ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import Clearance
from cable_shape.safety.stress import section_of
from cable_shape.scene.body_tables import link_rows
from cable_shape.scene.scene import Scene
from cable_shape.scene.scene_parts import clip_names
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

#: Of these shapes loads and clearance are told; of an overstretched one neither, since nobody knows where it is.
_JUDGED = [status.value for status in Status if status not in NOT_JUDGED and status is not Status.OVERSTRETCHED]


@final
class Rows:
    """The shapes of one cable, or of one segment, at m instants, and what they are judged by.

    Attributes
    ----------
    length : float or (m,) [m], stress-free, of the cable at each instant where it varies
    status : (m,) int, values of Status
    buffers : (m, 17 n), see CableShape.buffer
    energy : (m,) [J]
    supports : (m, clips, 7), arc length [m], force [N] and moment [N m] on each clip
    tables : (m, bodies, 8), see `kernels.distance.bounds`
    margins : (m, 6 + bodies, 5), see `kernels.safety.loads_used`; values are told with and without a limit
    details : dict of instant to str
    """

    def __init__(
        self, cable: Cable, scene: Scene, robot: Robot | None, instants: int, points: int, clips: Sequence[str]
    ) -> None:
        off = scene.contact == "off"
        self.cable, self.points, self.clips = cable, points, tuple(clips)
        self.length: float | Array = cable.length
        self.checker = ClearanceChecker(
            Scene(
                obstacles=() if off else scene.obstacles,
                warn_distance=scene.warn_distance,
                error_distance=scene.error_distance,
            ),
            cable=cable,
            robot_links=() if robot is None or off else robot.link_geometry,
            gripping_links=() if robot is None else robot.gripping_links,
        )
        self.bodies = self.checker.names
        watch = MarginWatch(cable, scene)
        self.pieces, self.warn, self.soft = _pieces(cable, watch.pieces), watch.warn, watch.soft
        self.status: NDArray[np.int64] = np.full(instants, Status.NOT_CONVERGED.value)
        self.buffers: Array = np.full((instants, NUMBERS_PER_POINT * points), math.nan)
        self.infos: Array = np.full((instants, drive.INFO + 2), math.nan)
        self.loads: Array = np.full((instants, len(clips) + 2 if clips else 0, 7), math.nan)
        self.tables: Array = np.full((instants, len(self.bodies), bounds.RESULT_COLUMNS), math.nan)
        self.margins: Array = np.full((instants, margins.BODIES + len(self.bodies), margins.COLUMNS), math.nan)
        self.details: dict[int, str] = {}

    def __len__(self) -> int:
        return len(self.status)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(m,): whether there is a shape that may be acted on."""
        return self.status <= Status.BUDGET.value

    @property
    def energy(self) -> Array:
        """(m,) [J]."""
        return self.infos[:, drive.I_ENERGY]

    def part(self, first: int, width: int) -> Array:
        """(m, n, width), of the buffers."""
        n = self.points
        return self.buffers[:, first * n : (first + width) * n].reshape(len(self), n, width)

    def shape(self, instant: int) -> CableShape:
        """The shape at an instant."""
        return CableShape(
            self.buffers[instant],
            self.points,
            length=float(np.broadcast_to(self.length, len(self))[instant]),
            model=cosserat.MODEL,
            status=Status(int(self.status[instant])),
            detail=self.details.get(instant, ""),
            energy=float(self.energy[instant]),
            error_estimate=float(self.infos[instant, drive.I_ESTIMATE]),
            supports=self.loads[instant, 1:-1],
        )

    def take(self, instant: int, shape: CableShape, judged: follow_rows.Judged, links: Array) -> None:
        """Keeps a shape that a predictor gave, and judges it."""
        self.buffers[instant] = shape.buffer
        self.status[instant] = shape.status.value
        info = self.infos[instant]
        info[:] = math.nan
        info[drive.I_ENERGY] = shape.energy
        info[drive.I_ESTIMATE] = math.nan if callable(shape.unread_error) else shape.error_estimate
        if shape.detail:
            self.details[instant] = shape.detail
        if len(self.loads[instant]) and len(shape.supports) == len(self.loads[instant]) - 2:
            self.loads[instant, 1:-1] = shape.supports
        if shape.status.value in _JUDGED:
            rows = self.margins[instant]
            follow_rows.judge(self.buffers[instant], self.points, judged, links, self.tables[instant], rows)


def _pieces(cable: Cable, pieces: Array) -> Array:
    """What margins are measured by, with a limit of 1 where there is none, so that the worst place is found."""
    out = pieces.copy()
    limits = out[:, margins.P_LIMITS :]
    limits[np.isnan(limits)] = 1.0
    for row, (_, _, one) in zip(out, pieces_of(cable), strict=True):
        row[margins.P_SECTION : margins.P_LIMITS] = section_of(one)
    return out


def walk(case: Case) -> dict[str, Rows]:
    """The rows of a case by segment; of a cable under the name ""."""
    if isinstance(case.cable, Harness):
        return _harness(case, case.cable)
    predictor = predictor_of(case)
    rows = rows_of(case, predictor)
    if follows(case, predictor):
        Followed(case, rows, predictor.problem).run()
    else:
        judged = judged_by(rows, isinstance(case.held["end"], Grip), np.empty((0, 4)))
        watch, near_nothing = MarginWatch(predictor.cable, Scene()), Clearance()
        for i in range(case.instants):
            links = links_at(case, i)
            shape = predictor.predict(*ends_at(case, i), links)
            rows.take(i, shape, judged, link_rows_of(rows, links))
            watch.margins(shape, near_nothing, i, state=predictor.rod_state)
            if watch.stability is not None:
                rows.margins[i, margins.STABILITY] = (*watch.stability[1:5], math.nan)
    return {"": rows}


def memories(case: Case, instants: Sequence[int]) -> Iterator[tuple[int, Memory]]:
    """What solved for the shape at each of these ascending instants that has one, until the next is asked for."""
    predictor: Any = any_predictor_of(case)
    harness = isinstance(case.cable, Harness)
    if not harness and follows(case, predictor):
        rows = rows_of(case, predictor)
        followed = Followed(case, rows, predictor.problem)
        for i in instants:
            followed.run(i + 1)
            if rows.usable[i] and followed.state is not None and followed.state.history:
                yield i, followed.state.copied()  # what reads it leaves no trace in what follows
        return
    for i in range(instants[-1] + 1):
        if harness:
            shape: Any = predictor.predict(held_at(case, i))
        else:
            shape = predictor.predict(*ends_at(case, i), links_at(case, i))
        state = memory_of(predictor)
        if i in instants and shape.status and state is not None:
            yield i, state.copied() if isinstance(state, Network) else state


def any_predictor_of(case: Case) -> Any:
    """What solves for a case, of a cable or of a harness."""
    if isinstance(case.cable, Harness):
        return Predictor(case.cable, scene=case.scene, **case.options)
    return predictor_of(case)


def predictor_of(case: Case) -> Predictor:
    """What solves for a case of one cable."""
    assert not isinstance(case.cable, Harness)
    return Predictor(
        case.cable.cable,
        scene=case.scene,
        robot_links=() if case.robot is None else case.robot.link_geometry,
        gripping_links=() if case.robot is None else case.robot.gripping_links,
        **case.options,
    )


def rows_of(case: Case, predictor: Predictor) -> Rows:
    """Room for its shapes."""
    problem = predictor.problem
    return Rows(problem.cable, case.scene, case.robot, case.instants, problem.points, clip_names(problem.clips))


def follows(case: Case, predictor: Predictor) -> bool:
    """Whether compiled code can follow the cable: a rod that touches nothing, in no eyelet and no clip that moves."""
    runs = any(clip.kind == "slide" or clip.link is not None for clip in predictor.problem.clips)
    return predictor.is_rod and case.scene.contact != "solve" and not (predictor.cable.sections or runs)


def _harness(case: Case, harness: Harness) -> dict[str, Rows]:
    """The same of a harness."""
    predictor = any_predictor_of(case)
    out = rows_of_harness(case, harness, predictor.problem.points)
    judged = {name: judged_by(rows, False, np.empty((0, 4))) for name, rows in out.items()}
    for i in range(case.instants):
        shape = predictor.predict(held_at(case, i))
        for name, one in shape.segments.items():
            out[name].take(i, one, judged[name], NO_LINKS)
            out[name].status[i] = shape.status.value
    return out


def rows_of_harness(case: Case, harness: Harness, points: int) -> dict[str, Rows]:
    """Room for the shapes of its segments."""
    named = list(zip(clip_names(case.scene.clips), case.scene.clips, strict=True))
    of = {segment: [name for name, clip in named if clip.segment == segment] for segment in harness.segments}
    return {n: Rows(one, case.scene, None, case.instants, points, of[n]) for n, one in harness.segments.items()}


def held_at(case: Case, instant: int) -> dict[str, Grip | FreeEnd]:
    """How the ends of a harness are held at an instant."""
    return {
        end: grip.at(Pose.trusted(case.frames[end][instant])) if isinstance(grip, Grip) else grip
        for end, grip in case.held.items()
    }


NO_LINKS: Array = np.empty((0, 7))


def link_rows_of(rows: Rows, links: Mapping[str, Pose] | None) -> Array:
    return NO_LINKS if links is None else link_rows(links, dict.fromkeys(rows.checker.links, "the robot"))


def judged_by(rows: Rows, held: bool, masses: Array) -> follow_rows.Judged:
    checker = rows.checker
    return follow_rows.Judged(
        rows.pieces, rows.warn, rows.soft, held, masses, checker.radius, checker.horizon, checker.grip_exclusion,
        *checker.tables,
    )  # fmt: skip


def links_at(case: Case, instant: int) -> Mapping[str, Pose] | None:
    """Where the robot's links are."""
    return None if case.links is None else case.links[instant]


def ends_at(case: Case, instant: int) -> tuple[Grip, Grip | FreeEnd]:
    start, end = case.held["start"], case.held["end"]
    assert isinstance(start, Grip)
    first = start.at(Pose.trusted(case.frames["start"][instant]))
    return first, end.at(Pose.trusted(case.frames["end"][instant])) if isinstance(end, Grip) else end


@final
class Followed:
    """A rod that touches nothing, and is followed in compiled code where that is enough."""

    def __init__(self, case: Case, rows: Rows, problem: Problem) -> None:
        self.case, self.rows, self.problem = case, rows, problem
        self.state: Network | None = None
        self.done = 0  # rows that are filled
        self._led: Network | None = None  # the memory that compiled code goes on from, if it can
        self.mode: Array = np.empty((0, 3))
        self.memory = np.array((math.nan, 0.0, 0.0))
        self.judged = judged_by(rows, False, np.empty((0, 4)))
        self.links = np.empty((len(rows), 0, 7))
        if case.links is not None:
            self.links = np.array([link_rows_of(rows, links) for links in case.links])

    def run(self, until: int | None = None) -> None:
        """Fills the rows from where it was left on, all of them or those before `until`."""
        last = len(self.rows) if until is None else until
        if self.state is None:
            ends = ends_at(self.case, 0)
            self.state = Network(self.problem.move(*ends))
            self.state.aim(*ends)
            masses = self.state.masses(ends[1])
            self.judged = self.judged._replace(held=isinstance(ends[1], Grip), masses=masses)
        while self.done < last:
            if self._led is None:
                self._led = self._solve(self.done)
                self.done += 1
            if self._led is not None:
                done = self._follow(self._led, self.done, last)
                self.rows.status[self.done : done] = Status.OK.value
                self._led = self._led if done == last else None
                self.done = done

    def _solve(self, i: int) -> Network | None:
        """One instant by all means; the memory to go on from, if compiled code can."""
        rows, ends = self.rows, ends_at(self.case, i)
        problem = self.problem
        problem.move(*ends)
        state = self.state
        assert state is not None
        shape = cosserat.solve(problem, state)
        rows.take(i, shape, self.judged, self.links[i])
        if shape.status is not Status.OK or state.history == 0 or state.rolls:
            self.memory[0] = math.nan
            return None
        steps = follow_rows.STEPS_NEAR
        if len(self.mode) != len(state.nodes):
            self.mode = np.random.default_rng(0).normal(size=(len(state.nodes), 3))
            steps = follow_rows.STEPS_AT_FIRST
        follow_rows.tell_stability(
            state.ints, state.floats, state.sols, state.work, np.empty(0), self.judged.soft, self.mode, steps, True,
            self.memory, rows.margins[i],
        )  # fmt: skip
        return state

    def _follow(self, state: Network, first: int, last: int) -> int:
        """From an instant on as far as compiled code goes, and before `last`: the first one that it leaves."""
        rows, case = self.rows, self.case
        starts = case.frames["start"][:last]
        instants = follow_rows.Instants(
            state.knots,
            starts,
            case.frames.get("end", starts)[:last],
            self.links,
            self.problem.tolerance,
            state.too_fine_below,
        )
        found = follow_rows.Found(rows.buffers, rows.infos, rows.loads, rows.tables, rows.margins)
        work = state.ints, state.floats, state.sols, state.work
        done: int = follow_rows.follow_rows(
            *work, instants, self.judged, found, self.mode, self.memory, first, state.history
        )
        if done > first:
            state.history, state.factored = 2, True
        return done
