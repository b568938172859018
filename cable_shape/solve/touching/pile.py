"""Cables that touch each other, from one equilibrium to the next: :class:`Pile`."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import energy_of_sections, widest
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.kernels.contact.press import I_EXCESS
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import FreeEnd, Grip
from cable_shape.scene.body_tables import carried_by, clip_frames, link_rows
from cable_shape.shape import NUMBERS_PER_POINT, TOUCH, CableShape, Status
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.laid import Pair
from cable_shape.solve.touching.places import (
    DEEPEST,
    MOUTH,
    SHORTEST,
    Line,
    Spot,
    at_an_end,
    hand_of,
    overlap_of,
    overlaps_at,
)
from cable_shape.solve.touching.search import relax
from cable_shape.solve.touching.step import FAR, WARM_ITERATIONS, Steps
from cable_shape.solve.touching.touching import ACCURACY, BURIED, inexact

NO_FRICTION = (0.0, 0.0, 0.0, 0.0)  #: along the surfaces of cables that touch
ITSELF = "itself"  #: the body's name, where a cable touches itself
_FINEST = 4.0  #: times as many elements as usual, where they make too large an error


@final
class Shapes:
    """Shapes of several cables as what a harness's shape holds of its segments."""

    def __init__(self, shapes: Sequence[CableShape]) -> None:
        self.points = shapes[0].points
        self.buffer: Array = np.concatenate([shape.buffer for shape in shapes])
        self.bodies = tuple(dict.fromkeys(name for shape in shapes for name in shape.bodies))
        self.touches = [shape.touches.copy() for shape in shapes]
        for shape, rows in zip(shapes, self.touches, strict=True):
            rows[:, 1] = [self.bodies.index(shape.bodies[int(body)]) for body in rows[:, 1]]
        self.turns = np.array([shape.turns for shape in shapes])


@final
class Pile:
    """`spots`, and the cables that have any; `frames` (n, 7) are those of the last equilibrium.

    They are those of the ends of all the cables in turn, and of the links that carry bodies, as :func:`all_frames` has
    them. cables: the numbers of those that are solved for.
    """

    def __init__(
        self,
        names: Sequence[str],
        problems: list[Problem],
        shapes: list[CableShape],
        frames: Array,
        spots: list[Spot],
        more: Collection[int] = (),
        finer: float = 1.0,
    ) -> None:
        """From the shapes of all the cables between these frames; more: cables that it has though they touch none.

        finer: of so many times as many elements as usual.
        """
        self._names, self._every = tuple(names), problems
        self.spots, self.frames = spots, frames.copy()
        self.more = frozenset(more)
        self.cables = sorted(self.more.union(cable for spot in spots for cable in spot.cables))
        self._problem = HarnessProblem.of_cables(self._problems)
        self._state = HarnessTouchState(self._problem)  # type: ignore[arg-type]
        self._state.rubs = False  # what cables lie on below each other does not hold them
        self._state.move_bodies(self._links(frames))
        self.finer = finer
        least = ACCURACY * self._problem.harness.longest if self._problem.bodies else 0.0
        self.tolerance = max(self._problem.tolerance, least)
        self._steps = Steps(self._problem, self._state, math.inf)  # type: ignore[arg-type]
        self._start(Shapes([shapes[i] for i in self.cables]))

    @property
    def _problems(self) -> dict[str, Problem]:
        """Those of the cables, by the names of their segments."""
        return {f"c{i}": self._every[i] for i in self.cables}

    def _start(self, shapes: Shapes) -> None:
        """Begins with these shapes."""
        state = self._state
        gaps = {cable: state.gaps[row] for row, cable in enumerate(self.cables)}
        state.links = tuple(
            Pair(s.arcs + [gaps[cable] for cable in s.cables], s.reach, s.press, s.places, s.stays) for s in self.spots
        )
        poses = self._poses(self.frames)
        state.start_from(shapes, poses, self.finer)  # type: ignore[arg-type]
        state.remember(self._steps.positions(shapes.buffer))
        for spot in self.spots:
            spot.hand = hand_of(spot, self._lines(spot, shapes.buffer))
        if not any(spot.press > 0.0 for spot in self.spots):  # on this mesh, before anything presses
            state.reach = np.zeros(len(self.spots))
            self._steps.go(poses, 1, WARM_ITERATIONS, FAR)

    def _links(self, frames: Array) -> Array:
        """(m, 7), those of the links that carry bodies or clips."""
        return frames[2 * len(self._every) :]

    def _poses(self, frames: Array) -> Array:
        """(k, 7), of the knots, with the ends in `frames`."""
        out = self._state.aimed()
        knots = self._state.cable.layout.knots
        if self._problem.clips_move:
            links, carried = self._links(frames), carried_of(self._every)
            placed = [clip_frames(self._every[i].clips, links, carried) for i in self.cables]
            out[self._state.cable.clip_rows] = np.concatenate(placed)
        for cable in self.cables:
            for side, end in enumerate(("start", "end")):
                if type(getattr(self._every[cable], end)) is Grip:
                    out[knots["end", f"c{cable}.{end}"]] = frames[2 * cable + side]
        return out

    # -- what is asked of it

    def take(self) -> None:
        """The ends and links where the problems have them now."""
        self._problem.follow(self._problems)

    @property
    def buried(self) -> bool:
        """Whether a grip or a clip is inside a body now."""
        state = self._state
        links = state.bodies.links
        state.move_bodies(state.bodies.link_rows(self._problem.links))
        found = state.buried(state.aimed(), BURIED)[0] >= 0
        state.move_bodies(links)
        return found

    @property
    def stable(self) -> bool:
        """Whether the last equilibrium is."""
        return bool(self._state.info[I_EXCESS] == 0.0)

    def keep(self) -> tuple[Any, ...]:
        """What :meth:`restore` takes to come back here."""
        return self.frames.copy(), [spot.copy() for spot in self.spots], self._state.put_aside()

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Back to where `keep` was called."""
        frames, spots, aside = kept
        self.frames, self.spots = frames.copy(), [spot.copy() for spot in spots]
        self._state.put_back(aside)
        self._state.move_bodies(self._links(frames))

    def go(self, frames: Array, *, search: bool = False) -> bool:
        """The equilibrium with the ends in `frames`, on the branch of the last one, or in a `search` any; False: none.

        Then the last one stays.
        """
        state, steps = self._state, self._steps
        state.reach = np.array([spot.reach for spot in self.spots])
        links = self._links(frames)
        steps.links = links
        state.move_bodies(links)
        poses, kept = self._poses(frames), self.keep()
        found = steps.go(poses, state.history, WARM_ITERATIONS, math.inf if search else FAR) and self._take(frames)
        if not found and search:
            self.restore(kept)
            state.move_bodies(links)
            found = relax(steps, poses) and self._take(frames)
        if not found:
            self.restore(kept)
        return found

    def _take(self, frames: Array) -> bool:
        """Takes over the state's last solution, at `frames`, if all cables keep off each other where they touch."""
        state = self._state
        state.history = 2
        self.frames, before = frames.copy(), [spot.copy() for spot in self.spots]
        for spot, pair in zip(self.spots, state.pairs(), strict=True):
            gaps = [state.gaps[self.cables.index(cable)] for cable in spot.cables]
            spot.arcs, spot.places, spot.press = pair.arcs - gaps, pair.places, pair.push
        return all(self._keeps_off(spot, then) for spot, then in zip(self.spots, before, strict=True))

    def _keeps_off(self, spot: Spot, before: Spot) -> bool:
        """Whether two cables neither overlap where they touch, or nearly do, nor have come through each other there.

        At the mouth of a grip or a clip, where a contact stops, they may overlap, and slip off the cable's end.
        """
        lines = self._lines(spot, self._steps.buffer)
        spot.hand = hand_of(spot, lines)
        turned = spot.hand * before.hand < 0.0 and float(spot.normal @ before.normal) < 0.0
        if turned and not at_an_end(spot, self._every):
            return False
        for row in overlaps_at(spot, lines, SHORTEST * widest(self._every[spot.cables[0]].cable)):
            places = list(zip(spot.cables, row[1:3].tolist(), strict=True))
            deepest = DEEPEST + sum(self._sagitta(*place) for place in places)
            if row[0] < spot.reach - deepest and not any(self._in_a_mouth(*place, spot.reach) for place in places):
                return False
        return True

    def _in_a_mouth(self, cable: int, arc: float, reach: float) -> bool:
        """Whether a place is at what holds a cable."""
        clips = self._steps.loads[self._problem.clips[f"c{cable}"], 0]
        return bool(np.abs(np.array((0.0, self._every[cable].cable.length, *clips)) - arc).min() < MOUTH * reach)

    def _lines(self, spot: Spot, buffer: Array) -> list[Line]:
        """The centrelines of two cables that touch, in a shape."""
        return [self._steps.own(buffer, self.cables.index(cable)) for cable in spot.cables]

    def _sagitta(self, cable: int, arc: float) -> float:
        """[m], by how much the straight line between two points of the last shape is off the cable."""
        n = self._problem.points
        row = NUMBERS_PER_POINT * n * self.cables.index(cable)
        return float(drive.sagitta(self._steps.buffer[row : row + NUMBERS_PER_POINT * n], n, arc))

    @property
    def coarse(self) -> bool:
        """Whether the last equilibrium is not within tolerance."""
        return not float(self._state.info[drive.I_ESTIMATE]) <= self.tolerance

    @property
    def overlap(self) -> float:
        """[m], by how much cables that lie along each other overlap between the places of their row at most."""
        rows = {spot.cables: spot for spot in self.spots if spot.stays}
        return max((overlap_of(spot, self._lines(spot, self._steps.buffer)) for spot in rows.values()), default=0.0)

    def refined(self) -> bool:
        """A finer mesh where it is too coarse; False if the equilibrium is lost on it."""
        while self.coarse and self.finer < _FINEST:
            self.finer *= 2.0
            shapes = [self.shape(cable, Status.OK, "", 0.0) for cable in self.cables]
            self._start(Shapes(shapes))
            if not self.go(self.frames):
                return False
        return True

    def shape(self, cable: int, status: Status, detail: str, began: float, overlap: float = 0.0) -> CableShape:
        """A cable's shape with all its contacts, so graded; `began`: when its solve did; overlap: as the property."""
        state, problem = self._state, self._every[cable]
        row, n = self.cables.index(cable), problem.points
        size = NUMBERS_PER_POINT * n
        buffer = self._steps.buffer[row * size : (row + 1) * size].copy()
        for side, at in ((problem.start, n), (problem.end, 4 * n - 3)):
            if type(side) is Grip and at > n:
                buffer[at : at + 3] = side.cable_frame.position
        info = state.info
        told = info[drive.INFO :]
        cables = len(state.gaps)
        estimate = float(info[drive.I_ESTIMATE])
        if status and not estimate <= self.tolerance:
            status, detail = Status.NOT_CONVERGED, inexact(estimate, self.tolerance)
        bodies, rows = self._contacts(cable)
        touches = np.vstack((state.touches_of_segments()[row], np.array(rows).reshape(-1, TOUCH)))
        shape = CableShape(
            buffer,
            n,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=float(told[2 * cables + row]) + self._energy_of_masses(cable, buffer),
            error_estimate=estimate + overlap,
            residual=float(info[drive.I_RESIDUAL]),
            iterations=self._steps.iterations,
            turns=int(state.turns[NOW, row]),
            twist=float(told[2 * row]),
            solve_time=perf_counter() - began,
            supports=self._steps.loads[self._problem.clips[f"c{cable}"]],
            touches=touches[np.argsort(touches[:, 0], kind="stable")],
            bodies=bodies,
            frictionless=state.has_friction,
        )
        shape.energy += energy_of_sections(problem.cable, shape, problem.gravity)
        return shape

    def _contacts(self, cable: int) -> tuple[tuple[str, ...], list[Array]]:
        """Names of the bodies and cables that a cable may touch, and its contacts with cables as `CableShape` has
        them."""
        bodies, rows = list(self._state.bodies.names), []
        for spot in self.spots:
            for side, sign in ((0, 1.0), (1, -1.0)):
                if spot.cables[side] != cable or not spot.press > 0.0:
                    continue
                other = spot.cables[1 - side]
                name, normal = ITSELF if other == cable else self._names[other], sign * spot.normal
                if name not in bodies:
                    bodies.append(name)
                point = spot.places[1 - side] + 0.5 * widest(self._every[other].cable) * normal
                rows.append(np.array((spot.arcs[side], bodies.index(name), *point, *normal, spot.press, *NO_FRICTION)))
        return tuple(bodies), rows

    def _energy_of_masses(self, cable: int, buffer: Array) -> float:
        """[J], potential energy of a cable's point masses and plug."""
        problem = self._every[cable]
        n = problem.points
        arcs, places = buffer[:n], buffer[n : 4 * n].reshape(n, 3)
        masses = [(mass.mass, mass.arc_length) for mass in problem.masses]
        if isinstance(problem.end, FreeEnd):
            masses.append((problem.end.mass, problem.cable.length))
        out = 0.0
        for mass, arc in masses:
            at = np.array([np.interp(arc, arcs, x) for x in places.T])
            out -= mass * float(problem.gravity @ at)
        return out

    def member(self, cable: int, told: int | None = None) -> Member:
        """One of the cables, to ask for derivatives of its shape, or by it of that of another one, `told`."""
        row = self.cables.index(cable if told is None else told)
        return Member(self._state, self._every[cable], row, f"c{cable}")


@final
class Member:
    """One cable of a pile as what has solved for it, see :class:`cable_shape.solve.answers.Solved`.

    row: among the cables of the pile that of the shape which is asked for.
    """

    history = 1
    rings: tuple[int, ...] = ()

    def __init__(self, state: HarnessTouchState, problem: Problem, row: int, name: str) -> None:
        self.problem, self._state, self._name = problem, state, name
        n = problem.points
        self.rows, self.sampled = slice(row * n, (row + 1) * n), n * state.gaps.size
        self.ints, self.floats, self.sols, self.work = state.ints, state.floats, state.sols, state.work
        self.refresh, self.pulls = state.refresh, state.pulls

    @property
    def network_nodes(self) -> int:
        """See `TouchState`."""
        return self._state.network_nodes

    def knots_of(self, supports: Sequence[int]) -> Array:
        """Which knots these supports are."""
        knots, name = self._state.cable.layout.knots, self._name
        clips = [knots["clip", i] for i in self._state.problem.clips[name]]
        every = np.array([knots["end", f"{name}.start"], *clips, knots["end", f"{name}.end"]])
        return np.asarray(every[list(supports)])

    def models_beside(self, cables: Sequence[Cable], kept: dict[bytes, Array] | None = None) -> Array:
        """(c, size): models of the pile with others in this cable's place, on the mesh as it is."""
        return self._state.models_of(self._name, cables)

    def body_columns(self, name: str) -> tuple[Array, Array]:
        """(points, 3, 6), (0, 6): how positions change as a body moves."""
        out, df = self._state.body_columns(name)
        return out[self.rows], df


def carried_of(problems: Sequence[Problem]) -> dict[str, str]:
    """The links that carry bodies, and those that carry clips of any of these cables."""
    return carried_by(problems[0].bodies, [replace(c, name=None) for one in problems for c in one.clips])


def all_frames(problems: list[Problem]) -> Array:
    """(n, 7), of both ends of all the cables, and of the links that carry bodies or clips, where they are known."""
    links = problems[0].links
    carried = {} if links is None else problems[0].carried if len(problems) == 1 else carried_of(problems)
    frames = np.empty((2 * len(problems) + len(carried), 7))
    for i, problem in enumerate(problems):
        start, end = problem.start.cable_frame.array, problem.end
        frames[2 * i] = start
        frames[2 * i + 1] = start if isinstance(end, FreeEnd) else end.cable_frame.array
    if links is not None and carried:
        frames[2 * len(problems) :] = link_rows(links, carried)
    return frames
