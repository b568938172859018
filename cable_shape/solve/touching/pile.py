"""Cables that touch each other, from one equilibrium to the next: :class:`Pile`."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.kernels.contact.press import I_EXCESS
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.laid import Pair
from cable_shape.solve.touching.places import MOUTH
from cable_shape.solve.touching.search import relax
from cable_shape.solve.touching.spot import (
    DEEPEST,
    SHORTEST,
    Line,
    Spot,
    at_an_end,
    hand_of,
    overlap_of,
    overlaps_at,
)
from cable_shape.solve.touching.step import FAR, WARM_ITERATIONS, Steps
from cable_shape.solve.touching.strands import Strands
from cable_shape.solve.touching.told import Told
from cable_shape.solve.touching.touching import ACCURACY, BURIED, inexact

_FINEST = 4.0  #: times as many elements as usual, where they make too large an error


@final
class Pile:
    """`spots`, and the cables that have any, or are solved for along with such; `frames` (n, 7) are those of the last
    equilibrium, see `Strands`. cables: the numbers of those that are solved for.
    """

    def __init__(
        self,
        strands: Strands,
        shapes: Sequence[CableShape] | Mapping[int, CableShape],
        frames: Array,
        spots: list[Spot],
        more: Collection[int] = (),
        finer: float = 1.0,
        *,
        rubs: bool = True,
    ) -> None:
        """From the shapes of all the cables between these frames; more: cables that it has though they touch none.

        finer: of so many times as many elements as usual. rubs: see `rubs`.
        """
        self._strands = strands
        self.spots, self.frames = spots, frames.copy()
        self.more = frozenset(more)
        self.cables = strands.hung_together(self.more.union(cable for spot in spots for cable in spot.cables))
        self._problem = strands.network(self.cables)
        self._state = HarnessTouchState(self._problem)  # type: ignore[arg-type]
        self.rubs = rubs
        self.frictionless = False  # surfaces have friction, which the last equilibrium is without
        self._state.move_bodies(self._links(frames))
        self.finer = finer
        least = ACCURACY * self._problem.harness.longest if self._problem.bodies else 0.0
        self.tolerance = max(self._problem.tolerance, least)
        self._steps = Steps(self._problem, self._state, math.inf)  # type: ignore[arg-type]
        self._start(shapes)

    def _start(self, shapes: Sequence[CableShape] | Mapping[int, CableShape]) -> None:
        """Begins with these shapes of all the cables."""
        state = self._state
        gaps = {cable: state.gaps[row] for row, cable in enumerate(self.cables)}
        state.links = tuple(
            Pair(s.arcs + [gaps[i] for i in s.cables], s.reach, s.press, s.places, s.stays, s.pull, s.slips)
            for s in self.spots
        )
        poses = self._poses(self.frames)
        started = self._strands.start(self.cables, shapes)
        state.start_from(started, poses, self.finer)
        state.remember(self._steps.positions(started.buffer))
        for spot in self.spots:
            spot.hand = hand_of(spot, self._lines(spot, started.buffer))
        if not any(spot.press > 0.0 for spot in self.spots):  # on this mesh, before anything presses
            state.reach = np.zeros(len(self.spots))
            self._steps.go(poses, 1, WARM_ITERATIONS, FAR)

    @property
    def rubs(self) -> bool:
        """Whether there is friction, where surfaces have some: not on ways that are no steps of the cables."""
        return self._state.rubs

    @rubs.setter
    def rubs(self, rubs: bool) -> None:
        self._state.rubs = rubs and all(part.problem.rubs for part in self._strands.parts)

    def _links(self, frames: Array) -> Array:
        """(m, 7), those of the links that carry bodies or clips."""
        return frames[2 * len(self._strands.cables) :]

    def _poses(self, frames: Array) -> Array:
        """(k, 7), of the knots, with the ends in `frames`."""
        return self._strands.poses(self._state, self.cables, frames)

    # -- what is asked of it

    def take(self) -> None:
        """The ends and links where the problems have them now."""
        self._steps.iterations = 0
        self._strands.follow(self._problem, self.cables)

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
        poses, kept, rubbed = self._poses(frames), self.keep(), state.rubs
        found = steps.go(poses, state.history, WARM_ITERATIONS, math.inf if search else FAR) and self._take(frames)
        if not found and search:
            self.restore(kept)
            state.move_bodies(links)
            rubs, state.rubs = state.rubs, False
            found = relax(steps, poses) and self._take(frames)
            state.rubs, rubbed = rubs, False
        if found:
            rows = any(spot.stays and spot.press > 0.0 for spot in self.spots)
            self.frictionless = state.has_friction and (rows or not rubbed)
        else:
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
            spot.pull, spot.slips = pair.pull - (pair.pull @ spot.normal) * spot.normal, pair.slips
        return all(self._keeps_off(spot, then) for spot, then in zip(self.spots, before, strict=True))

    def _keeps_off(self, spot: Spot, before: Spot) -> bool:
        """Whether two cables neither overlap where they touch, or nearly do, nor have come through each other there.

        At the mouth of a grip or a clip, where a contact stops, they may overlap, and slip off the cable's end.
        """
        lines = self._lines(spot, self._steps.buffer)
        spot.hand = hand_of(spot, lines)
        turned = spot.hand * before.hand < 0.0 and float(spot.normal @ before.normal) < 0.0
        if turned and not at_an_end(spot, self._strands.cables):
            return False
        least, joined = SHORTEST * widest(self._strands.cables[spot.cables[0]]), self._strands.joined(spot.cables)
        for row in overlaps_at(spot, lines, least, joined):
            places = list(zip(spot.cables, row[1:3].tolist(), strict=True))
            deepest = DEEPEST + sum(self._sagitta(*place) for place in places)
            if row[0] < spot.reach - deepest and not any(self._in_a_mouth(*place, spot.reach) for place in places):
                return False
        return True

    def _in_a_mouth(self, cable: int, arc: float, reach: float) -> bool:
        """Whether a place is at what holds a cable."""
        clips = self._steps.loads[self._problem.clips[self._strands.key(cable)], 0]
        return bool(np.abs(np.array((0.0, self._strands.cables[cable].length, *clips)) - arc).min() < MOUTH * reach)

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
            self._start(dict(zip(self.cables, self.shapes(Status.OK, "", 0.0), strict=True)))
            frictionless = self.frictionless
            if not self.go(self.frames):
                return False
            self.frictionless = self.frictionless or frictionless
        return True

    def shapes(self, status: Status, detail: str, began: float) -> list[CableShape]:
        """The shapes of its cables with all their contacts, so graded; `began`: when their solve did."""
        state, steps = self._state, self._steps
        estimate = float(state.info[drive.I_ESTIMATE])
        if status and not estimate <= self.tolerance:
            status, detail = Status.NOT_CONVERGED, inexact(estimate, self.tolerance)
        told = Told(
            self.cables, self._strands.names, self._strands.cables, self.spots, state, steps.buffer, steps.loads,
            iterations=steps.iterations, status=status, detail=detail, overlap=self.overlap,
            frictionless=self.frictionless,
            solve_time=perf_counter() - began,
        )  # fmt: skip
        return self._strands.shapes(told)

    def member(self, cable: int, told: int | None = None) -> Member:
        """One of the cables, to ask for derivatives of its shape, or by it of that of another one, `told`."""
        row = self.cables.index(cable if told is None else told)
        return Member(self._state, self._strands.part_with(cable).problem, row, self._strands.key(cable))

    @property
    def state(self) -> HarnessTouchState:
        """The memory of all of them."""
        return self._state


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

    def turns_most(self, mode: Array) -> float:
        """[m], arc length at which it turns most in a mode (nodes, 3) of all of them."""
        return self._state.turns_most(self._name, mode)

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
