"""One step of a cable in contact: a compiled solve from the last solution, and what is left to be done about it."""

from __future__ import annotations

import math
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact import check, drive
from cable_shape.kernels.contact.drive import UNSETTLED
from cable_shape.kernels.contact.errors import AMISS
from cable_shape.kernels.contact.near import GRIP_EXCLUSION
from cable_shape.kernels.contact.press import RESTLESS, RUNNING
from cable_shape.kernels.direct import Direct
from cable_shape.kernels.distance import bounds, surface
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.shape import NUMBERS_PER_POINT
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.laid import LEAST_LENGTH, MOST_ELEMENTS
from cable_shape.solve.touching.road import Road
from cable_shape.solve.touching.state import Kept, TouchState

DEEPEST = 1e-4  #: [m] a shape deeper in a body than this between nodes gets a node there
WARM_ITERATIONS, STEP_ITERATIONS = 30, 20
GENTLE_ITERATIONS = 20  #: more, where friction gives way more easily at first
FAR = 0.7  #: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
FINE = 1.9e-4  #: of the length: an error from contacts above this, or AMISS times it in all, asks for a finer mesh
_SURE = 2e-4  #: of the length: with a smaller error estimate a shape found from nothing is none of the mesh alone
_EXACT = 1e-5  #: of the length: an error from contacts below this is none of nodes in their way
#: Of the length: elements shorter than this are not divided where contacts stand; their pushes would mean nothing.
SHORTEST = 1.25e-3
_RUNS = 8  #: of taking contacts that stand along the cable
_SQUARE = 1e-3  #: cosine of the angle between cable and push of a contact that stands on an edge: it runs there, else
_PRESSED = 5  #: steps of a road in which bodies push the cable between nodes, before these become nodes
_ROUNDS, _FEW = 8, 3  #: of adding nodes where the cable dips into a body between them, and where an equilibrium is near
_CONFIRMED = 4  #: meshes, each finer than the last, on which a shape is looked for that was found from nothing
#: Of half a body's thickness and the cable's: how deep a point is that stands for one in the middle of the body, where
#: points and times are at most so much apart.
_MIDDLE = 0.4
_FINEST = 20  #: times as far as that points may be apart: there are as many between them
_LONGEST_WAY = 2.0  #: of the length: further ways are not looked at, and count as past a body
_ANYWHERE: Array = np.empty((0, 3))
#: Cosine of the angle by which the direction between two cables of a pair may turn in one step: further, and they may
#: have come past each other.
_TURNED = 0.3
_SOLVE = Direct(drive.solve)


@final
class Steps:
    """The steps of one prediction; the last one's shape is in `buffer`.

    links (k, 7): where the links that carry bodies are to be. iterations: of all steps. loads (k, 7): of the last
    shape on the clips. late: whether `out_of_time` has been true. still: contacts stand at their nodes.
    """

    __slots__ = ("buffer", "deadline", "iterations", "late", "links", "loads", "problem", "state", "still")

    def __init__(self, problem: Problem, state: TouchState, deadline: float) -> None:
        self.problem, self.state, self.deadline = problem, state, deadline
        self.iterations = 0
        self.late = self.still = False
        self.links = state.bodies.link_rows(problem.links)
        self.loads: Array = np.empty((0, 7))
        self.buffer = state.new_buffer()

    def go(
        self,
        frames: Array,
        history: int,
        most: int,
        far: float,
        sunk: float = 0.0,
        *,
        jump: bool = False,
        drag: float = 0.0,
    ) -> bool:
        """From the last solution to `frames`, not inside a body between the nodes, and unless a `jump` not past one.

        Nor do pairs turn round, but without drag where it may lead infinitely `far`. drag [N]: holds the rotations back
        from those of the last solution.
        False: the last solution is as it was.
        """
        state = self.state
        if state.untidy and not self.still:
            state.tidy()
        state.target(frames)
        before = _ANYWHERE if jump else state.positions
        refine = not jump and drag == 0.0
        fine = FINE * state.length if refine else math.inf
        guarded = bool(state.links) and (far < math.inf or drag > 0.0)
        toward, origin = (state.toward(), state.copy()) if guarded else (_ANYWHERE, None)
        deepest = -1.0 if state.in_pieces else DEEPEST  # how thick each piece is, is looked at in `settle`
        code = self._call(history, most, far, sunk, drag, before, deepest, fine)
        if code == UNSETTLED:
            aside = state.put_aside(then=True)
            state.accept()
            if not self.settle(frames, sunk, drag, refine=refine) or (before.size and self.passes(before, self.buffer)):
                state.put_back(aside)  # where it settles with contacts that stand, roads have gone on from there
                return False
            state.untidy = True
        elif code != CONVERGED:
            return False
        if origin is not None and ((toward * state.toward()).sum(axis=1) < _TURNED).any():
            state.restore(origin)
            return False
        state.remember(self.positions(self.buffer))
        return True

    def again(
        self, most: int, *, far: float = math.inf, sunk: float = 0.0, drag: float = 0.0, history: int = 0
    ) -> bool:
        """Solves for the frames in the trial, to which the last solution already belongs unless there is a `history`.

        What is left to be done about it is not looked at.
        """
        if history == 0:
            self.state.count_again()
        code = self._call(max(history, 1), most, far, sunk, drag, _ANYWHERE, -1.0, math.inf)
        if code == UNSETTLED:
            self.state.accept(again=history == 0)
        return code == UNSETTLED

    def _call(
        self,
        history: int,
        most: int,
        far: float,
        sunk: float,
        drag: float,
        before: Array,
        deepest: float,
        fine: float,
    ) -> int:
        """One compiled solve."""
        state, bodies = self.state, self.state.bodies
        running = 0 if self.still else RUNNING
        state.factored = False
        state.s_then[:] = state.s
        rough = state.has_friction
        smooth = not state.rubs or drag > 0.0 or sunk > 0.0
        if smooth:
            state.forget_friction()
        smooth = rough and smooth
        lying, kernel = (state.smooth, bodies.smooth) if smooth else (state.lying, bodies.kernel)
        for gentle in (0, 1, 2) if rough and not smooth else (0,):
            tries = most + (GENTLE_ITERATIONS if gentle else 0)
            code: int = _SOLVE(
                lying, kernel, state.net, before, self.buffer, state.loads, state.info, self.problem.points,
                state.bodied, history, tries, far, state.weight, state.limp, sunk, drag, running, bodies.horizon,
                deepest, fine, gentle,
            )  # fmt: skip
            self.iterations += int(state.info[0])
            if code in (CONVERGED, UNSETTLED):
                if len(state.clip_knots):
                    self.loads = state.loads[state.clip_knots].copy()
                break
            state.put_nodes_back()
        return code

    def settle(self, frames: Array, sunk: float = 0.0, drag: float = 0.0, *, refine: bool = True) -> bool:
        """Adds nodes where the cable dips into a body between them and, to `refine`, where contacts are too inexact."""
        state = self.state
        exact, shortest = _EXACT * state.length, SHORTEST if self.still else LEAST_LENGTH
        for _ in range(_ROUNDS):
            # contacts that run were stopped: by their iterations, or by a node that is moved now
            if refine and not self.still:
                stopped = state.info[0] > RUNNING
                moved = (not self._square or (state.info[16] > exact and not stopped)) and state.tidy()
                if moved or stopped:
                    state.target(frames)
                    if not self.again(WARM_ITERATIONS, sunk=sunk):
                        return False
                if moved and not self._square:
                    continue
            arcs = self._dips(sunk)
            deep = arcs.size > 0
            if not deep and refine and not self._exact():
                of_contacts = AMISS * state.info[16]
                arcs = state.ends_of_rows(shortest) if of_contacts > 0.5 * state.info[7] else state.too_coarse()
                arcs = np.union1d(arcs, state.steep())
            if not arcs.size:
                return True
            if self.still:
                everywhere = (0.5 * (state.nodes[1:] + state.nodes[:-1]))[state.h > 0.0]
                if not any(self._stand_finer(frames, at) for at in (arcs, state.beside_contacts(), everywhere)):
                    return not deep
                continue
            if state.elements + arcs.size > MOST_ELEMENTS or not state.insert(arcs):
                return not deep
            state.target(frames)
            if not self.again(WARM_ITERATIONS, sunk=sunk, drag=drag):
                return False
        return not self._dips(sunk, 2.0 * DEEPEST).size

    def confirmed(self, frames: Array) -> bool:
        """Whether the last solution is still there on finer meshes, unless its error is small enough to be sure of it.

        A coarse mesh may have an equilibrium of its own, and no shape from before tells so of one found from nothing.
        """
        state = self.state
        for _ in range(_CONFIRMED):
            if state.info[7] <= _SURE * state.length or state.elements > MOST_ELEMENTS:
                break
            if not state.insert(np.union1d(state.too_coarse(), state.beside_contacts())):
                break
            state.target(frames)
            if not (self.again(WARM_ITERATIONS) and self.settle(frames)):
                return False
        return True

    def _stand_finer(self, frames: Array, arcs: Array) -> bool:
        """The same with contacts that stand, and nodes at `arcs`; else the last solution stays as it is."""
        state = self.state
        kept = self.kept()
        if state.elements + arcs.size > MOST_ELEMENTS or not state.insert(arcs, SHORTEST):
            return False
        state.target(frames)
        if self.stand(frames):
            return True
        self.take_back(kept)
        return False

    def _exact(self) -> bool:
        """Whether the last solution's contacts make as small an error as is asked for."""
        fine = FINE * self.state.length
        return bool(self.state.info[16] <= fine and self.state.info[7] <= AMISS * fine)

    @property
    def _square(self) -> bool:
        """Whether contacts on edges press the cable square, and none is held beside an edge by its node alone."""
        return self.state.askew <= _SQUARE and not self.state.off_edges

    def by_road(self, frames: Array) -> Road | None:
        """Against drag to `frames`, in front of all bodies, to rest, which becomes the last solution; None: no way."""
        road = self._on_road(frames)
        if road is None and self.state.even():
            road = self._on_road(frames)
        if road is not None:
            road.hand_over()
        return road

    def _on_road(self, frames: Array) -> Road | None:
        """The road come to rest; None: no way.

        What bodies push between nodes on it becomes nodes, and it begins anew.
        """
        state = self.state
        for left in range(_FEW if state.hasty else _ROUNDS, -1, -1):
            road = Road(state, self.links, self.out_of_time)
            there, arcs = road.go(frames, _PRESSED if left else MOST_ELEMENTS), road.pressed
            if not arcs.size or state.elements + arcs.size > MOST_ELEMENTS or not state.insert(arcs, SHORTEST):
                break
        return road if there else None

    def stand(self, frames: Array) -> bool:
        """An equilibrium whose contacts stand at their nodes, from the last solution, which is near one.

        Between one and the next, those without neighbours are taken along the cable to where it is nearest: on an edge
        a node elsewhere holds the cable back. What Newton's method finds elsewhere, past a body, is none.
        """
        self.still, kept = True, None
        for _ in range(_RUNS):
            if self.by_road(frames) is None:
                break
            self.state.target(frames)
            if not self.again(WARM_ITERATIONS, far=FAR) or self.passes(self.state.positions, self.buffer):
                break
            self.state.remember(self.positions(self.buffer))
            square = self._square
            if square and self._exact():
                return True
            if square:
                kept = self.kept()
            if self.state.run() < RESTLESS * self.state.length and square:
                return True
        if kept is not None:
            self.take_back(kept)
        return kept is not None

    def stand_on(self, frames: Array) -> bool:
        """From the last solution to `frames` with contacts that stand, where they do; else that is as it was."""
        state = self.state
        if not state.stood:
            return False
        aside, self.still = state.put_aside(), True
        went = self.go(frames, state.history, STEP_ITERATIONS, FAR)
        state.stood = went and self._square and self._exact()
        self.still = False
        if went and not state.stood:
            state.put_back(aside)
            state.move_bodies(self.links)
        return state.stood

    def kept(self) -> tuple[Kept, Array, Array, Array]:
        """The last solution, its shape, what is told of it, and the positions from which the cable moves on."""
        return self.state.copy(), self.buffer.copy(), self.state.info.copy(), self.state.positions

    def take_back(self, kept: tuple[Kept, Array, Array, Array]) -> None:
        """Makes what was kept the last solution."""
        self.state.restore(kept[0])
        self.buffer[:], self.state.info[:] = kept[1:3]
        self.state.remember(kept[3])

    def own(self, buffer: Array, c: int) -> tuple[Array, Array]:
        """Arc lengths (n,) [m] and positions (n, 3) [m] of cable c of a shape."""
        n = self.problem.points
        first = NUMBERS_PER_POINT * n * c
        return buffer[first : first + n], buffer[first + n : first + 4 * n].reshape(n, 3)

    def positions(self, buffer: Array) -> Array:
        """(c n, 3) [m], of all cables that are kept out of bodies."""
        count = self.state.bodied
        if count == 1:
            return self.own(buffer, 0)[1]
        return np.concatenate([self.own(buffer, c)[1] for c in range(count)])

    def depth(self, buffer: Array) -> float:
        """The least gap [m] of a shape to any body."""
        return min(float(self._measured(buffer, c)[:, 0].min(initial=math.inf)) for c in range(self.state.bodied))

    def passes(self, before: Array, buffer: Array) -> bool:
        """Whether a cable may have got past a body from one shape's positions (c n, 3) to the next shape."""
        state, bodies, n = self.state, self.state.bodies, self.problem.points
        return any(
            check.passes(
                arcs, before[c * n : (c + 1) * n], after, bodies.table, bodies.frames, bodies.frames_then,
                bodies.triangles, bodies.tree, state.chains[c].radius, bodies.stack,
            )
            for c, (arcs, after) in enumerate(self.own(buffer, c) for c in range(state.bodied))
        )  # fmt: skip

    def goes_through(self, before: Array, then: Array, buffer: Array) -> bool:
        """Whether the straight way from positions (c n, 3) to a shape leads through the middle of a body, or may do so.

        The bodies were in the frames `then` (m, 4, 3). Far ways along a body are none past it, as `passes` has it; but
        one that is so thin that it could be told between the points by very many more alone counts as passed.
        """
        n = self.problem.points
        ways = ((c, before[c * n : (c + 1) * n]) for c in range(self.state.bodied))
        return any(self._goes_through(c, own, then, buffer) for c, own in ways)

    def _goes_through(self, c: int, before: Array, then: Array, buffer: Array) -> bool:
        """The same of cable c."""
        bodies = self.state.bodies
        arcs, after = self.own(buffer, c)
        for b, body in enumerate(bodies.table):
            middle = _MIDDLE * (surface.reach_of(body) + self.state.chains[c].radius)
            start = np.array([check.carried(tuple(p), then[b], bodies.frames[b]) for p in before])
            far = float(np.linalg.norm(after - start, axis=1).max())
            if far <= middle or self._least_gap(start, arcs, b, c) > far:
                continue
            if far > _LONGEST_WAY * self.state.length:
                return True
            apart = max(float(np.linalg.norm(np.diff(line, axis=0), axis=1).max()) for line in (start, after))
            if apart > _FINEST * middle:
                return True
            rows = [_divided(np.column_stack((arcs, line)), math.ceil(apart / middle)) for line in (start, after)]
            for at in np.linspace(0.0, 1.0, 2 + math.ceil(far / middle)):
                along = (1.0 - at) * rows[0] + at * rows[1]
                if self._least_gap(along[:, 1:], along[:, 0], b, c) < -middle:
                    return True
        return False

    def _least_gap(self, line: Array, arcs: Array, b: int, c: int) -> float:
        """[m], of points (n, 3) at arc lengths (n,) of cable c to body b; infinite next to the grips of one that
        grips."""
        state, bodies, length = self.state, self.state.bodies, float(arcs[-1])
        one = bodies.table[b : b + 1], bodies.frames[b : b + 1], bodies.triangles, bodies.tree
        gaps = [
            check.depth_of(p, arc, length, *one, state.chains[c].radius, bodies.stack)[0]
            for p, arc in zip(line, arcs, strict=True)
        ]
        return float(min(gaps))

    def out_of_time(self) -> bool:
        """Whether the deadline is over."""
        self.late = self.late or perf_counter() > self.deadline
        return self.late

    def _measured(self, buffer: Array, c: int) -> Array:
        """(p m, 8), as `bounds.closest_points` has it, of every body near cable c, of one of its p pieces after the
        other."""
        state, bodies = self.state, self.state.bodies
        arcs, positions = self.own(buffer, c)
        found, start, pieces = [], 0.0, state.chains[c].pieces
        for end, _, radius, _ in pieces:
            line = (positions, arcs) if len(pieces) == 1 else _between(positions, arcs, start, end)
            bounds.closest_points(
                *line, radius, bodies.horizon, GRIP_EXCLUSION, True, bodies.table, bodies.moved_links,
                bodies.triangles, bodies.tree, bodies.measured, bodies.counts,
            )  # fmt: skip
            found.append(bodies.measured.copy())
            start = end
        return found[0] if len(found) == 1 else np.concatenate(found)

    def _dips(self, sunk: float, deepest: float = DEEPEST) -> Array:
        """Arc lengths where the shape in the buffer is too deep in a body."""
        deep = []
        for c in range(self.state.bodied):
            found = self._measured(self.buffer, c)
            found = found[found[:, 0] + sunk < -deepest]
            n = self.problem.points
            own = self.buffer[NUMBERS_PER_POINT * n * c : NUMBERS_PER_POINT * n * (c + 1)]
            sags = np.array([drive.sagitta(own, n, arc) for arc in found[:, 1]])
            deep.append(found[found[:, 0] + sunk + sags < -deepest, 1] + self.state.gaps[c])
        return np.unique(np.concatenate(deep))


def _divided(rows: Array, parts: int) -> Array:
    """(k parts + 1, n), rows (k + 1, n) and those between, evenly."""
    at = np.arange(parts * (len(rows) - 1) + 1) / parts
    return np.stack([np.interp(at, np.arange(len(rows)), column) for column in rows.T], axis=1)


def _between(positions: Array, arcs: Array, start: float, end: float) -> tuple[Array, Array]:
    """Positions (k, 3) [m] and arc lengths (k,) [m] of the part of a line between two of these."""
    inside = (arcs > start) & (arcs < end)
    own = np.concatenate(([start], arcs[inside], [end]))
    ends = [[np.interp(at, arcs, x) for x in positions.T] for at in (start, end)]
    return np.concatenate((ends[:1], positions[inside], ends[1:])), own
