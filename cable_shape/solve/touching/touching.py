"""The quasistatic Cosserat rod that rests on bodies (see docs/method.md).

The plain rod, or that in clips, answers as long as its shape is clear of every body. Otherwise nodes that would be
inside a body are pressed out of it along its normal, and held along it by friction; which ones is found along with the
shape.
Bodies on robot links move with them: what they push follows in steps that no body is passed in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import Grip
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL, straight_line
from cable_shape.solve.touching import taut
from cable_shape.solve.touching.moments import OVER, TOO_MUCH, UNEVEN, beyond_cone, refined, thin, uneven
from cable_shape.solve.touching.road import TAUT, is_far, led_by
from cable_shape.solve.touching.search import approach, follow, grow, relax
from cable_shape.solve.touching.soften import LIMP, STIFF, soften
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.step import DEEPEST, FAR, WARM_ITERATIONS, Steps

#: Of the layers of the last mesh: of thinner ones a new one is made.
_THINNER = 0.7
BURIED = 2e-4  #: [m] a grip deeper in a body than this has no shape
STUCK = (
    "no way from the last shape leads to one between these ends but past an obstacle, behind which the cable cannot "
    "have come. It stays so until the ends are back where a way leads on, or until reset: then any shape is taken. "
)
_AWAY = 10.0  #: of the length: so far away, a body is in nobody's way
_ATTEMPTS = (1.0, 0.0, -1.0)  #: bodies come from below, grow, come from above
#: Of each step of a harness, where fewer lead nowhere: contacts of all its segments change, one at a time.
_PATIENT = 90
_LEAST_CHORD = 1e-3  #: of the length: ends that are nearer, seen from above, tell no side
ACCURACY = 5e-4  #: of the length: what a shape in contact is asked for where the tolerance is below


def inside(what: str, name: str, gap: float, body: str) -> str:
    """That what is called so, a grip or a clip, is inside a body, in words; gap [m] below 0."""
    return (
        f"the cable at the {name} is {-gap * 1e3:.1f} mm inside obstacle {body!r}. "
        f"Move the {what} out of it, or leave the obstacle out of the scene. "
    )


def solve(
    problem: Problem, state: TouchState, rod: Network | None, *, deadline: float = math.inf, leaps: bool = True
) -> tuple[CableShape, Network | None]:
    """The rod between the problem's ends and in its clips, outside its bodies; and `rod` afterwards.

    `rod` is the memory of the rod without contact; None: it is made where it is needed. leaps: where no small step
    leads there, the cable may slide to another equilibrium, or be found from nothing; else it is NOT_CONVERGED then,
    soon. Never raises for a physical reason: see `status`.

    Raises
    ------
    ArgumentError
        If the problem's `links` lack a link that carries a body.
    """
    began = perf_counter()
    if state.problem is not problem:
        state.take(problem)
    one = Solve(problem, state, rod, deadline, began, leaps)
    return one.run(), one.rod


def inexact(estimate: float, allowed: float) -> str:
    """What is the matter with an equilibrium in contact whose error is not known to be small enough [m]."""
    return (
        f"an equilibrium in contact, but its error estimate, {estimate:.3g} m, is above {allowed:.3g} m, the larger of "
        f"`tolerance` and {ACCURACY:g} of the length. Raise `tolerance` above the estimate to accept it."
    )


def too_short(missing: float, bodies: list[str]) -> str:
    """What is the matter with a cable that lacks so much [m] on its way past these."""
    past = " and ".join(map(repr, bodies)) or "the obstacles"
    return f"the cable is {missing:.3g} m too short for its way past {past}. Bring the ends closer. "


class Solve:
    """One call of :func:`solve`: free, then warm from the last shape, then in small steps, then from nothing."""

    __slots__ = ("began", "deadline", "leaps", "problem", "rod", "state", "steps")

    def __init__(
        self,
        problem: Problem,
        state: TouchState,
        rod: Network | None,
        deadline: float,
        began: float,
        leaps: bool = True,
    ) -> None:
        self.problem, self.state, self.rod = problem, state, rod
        self.deadline, self.began, self.leaps = deadline, began, leaps
        self.steps = Steps(problem, state, deadline)

    def run(self) -> CableShape:
        """The shape, whatever comes."""
        shape, state = self._solved(), self.state
        if shape.status is Status.OVERSTRETCHED:
            state.slipped = state.slipped or not state.rubs
        elif shape.usable:
            shape.frictionless = shape.frictionless or (state.slipped and state.touching and state.has_friction)
            state.slipped = False
        return shape

    def _solved(self) -> CableShape:
        """The same; of friction it tells what this one step knows."""
        state = self.state
        state.stuck = False
        state.rubs = self.problem.rubs and state.tight <= 1.0
        state.move_bodies(self.steps.links)
        frames = state.aimed()
        buried = self._buried(frames)
        if buried:
            return self._no_shape(Status.NOT_CONVERGED, buried)
        if not state.touching:
            shape = self._alone()
            if shape.status in (Status.NOT_CONVERGED, Status.OVERSTRETCHED, Status.BUDGET_EXCEEDED):
                return shape  # on which side of the bodies the cable is, the last shape goes on to tell
            clear = self.steps.depth(shape.buffer) > -DEEPEST
            last = state.free
            if clear and (last is None or not self.steps.passes(state.seen(last), shape.buffer)):
                state.rest(shape, frames)
                return shape
            if last is None:
                return self._cold(frames, shape)
            state.start_from(last, state.free_frames)
        return self._warm(frames)

    # -- attempts

    def _alone(self) -> CableShape:
        """The shape without contact."""
        return cosserat.solve(self.problem, self._made(), deadline=self.deadline)

    def _made(self) -> Network:
        """The memory of the rod without contact."""
        if self.rod is None:
            self.rod = Network(self.problem)
        return self.rod

    def _free(self, problem: Problem) -> CableShape:
        """The same from nothing, of another problem's cable."""
        return cosserat.solve(problem, deadline=self.deadline)

    def _warm(self, frames: Array) -> CableShape:
        """From the last solution."""
        state, steps = self.state, self.steps
        state.thin()
        shape, reached = self._onward(frames)
        if shape is not None:
            return shape
        state.put_back(reached)
        state.move_bodies(steps.links)
        if not self.leaps:
            return self._stuck(STUCK)
        if state.patience.left > 0 and not steps.late:
            state.patience.left -= 1
            return self._stuck(STUCK)
        rubbed, state.rubs = state.rubs and state.has_friction, False
        if rubbed:  # what sticks may leave no way
            shape = self._by_road(frames)
            if shape is not None:
                return shape
            state.put_back(reached)
            state.move_bodies(steps.links)
        before, then = state.positions, state.bodies.frames_then
        if relax(steps, frames) and not steps.goes_through(before, then, steps.buffer):
            return self._finish(Status.SNAPPED)
        state.put_back(reached)
        state.move_bodies(steps.links)
        if steps.late:
            return self._no_shape(Status.BUDGET_EXCEEDED, "")
        found = self._anew(frames)
        if found is not None:
            return found
        state.put_back(reached)
        if steps.out_of_time():
            return self._no_shape(Status.BUDGET_EXCEEDED, "")
        state.patience.fail()
        return self._stuck(STUCK)

    def _onward(self, frames: Array) -> tuple[CableShape | None, tuple[Any, ...]]:
        """By Newton's method, or by the road; None if neither leads there. And how far that came, or nothing."""
        state, steps = self.state, self.steps
        if steps.stand_on(frames) or steps.go(frames, state.history, WARM_ITERATIONS, FAR):
            return self._found(frames), ()
        origin = state.put_aside()
        if follow(steps, frames):
            return self._found(frames), ()
        reached = state.put_aside()
        drawn, too_short, tight = None, reached, state.tight
        if state.single and not state.stretches and state.pull > taut.TIGHT:
            state.put_back(origin)
            drawn = self._let_out(frames)
            if drawn is not None:
                if drawn.usable or tight > 1.0:
                    return drawn, ()
                too_short, steps.buffer = state.put_aside(), state.new_buffer()  # it may be taut only
            state.put_back(reached)
            state.move_bodies(steps.links)
        shape = self._by_road(frames) if self.leaps else None
        if drawn is None or (shape is not None and shape.usable):
            return shape, reached
        state.put_back(too_short)
        state.move_bodies(steps.links)
        return drawn, ()

    def _found(self, frames: Array) -> CableShape:
        """The equilibrium that Newton's method found."""
        shape = self._finish(Status.OK)
        exact = shape.status or shape.missing_length > 0.0 or not self.state.touching
        return shape if exact else self._better(frames, shape)

    def _let_out(self, frames: Array) -> CableShape | None:
        """That of a cable that gives ever more, from the last solution; None if that leads nowhere, or over a snap."""
        state, steps = self.state, self.steps
        state.move_bodies(steps.links)
        led, before, there = led_by(state, frames), state.positions, state.grips[NOW].copy()
        while state.tight < taut.LOOSEST and taut.loosened(steps, there):
            looser = state.put_aside()
            state.move_bodies(steps.links)
            if steps.go(frames, 1, WARM_ITERATIONS, FAR) or follow(steps, frames):
                shape = self._finish(Status.OK)
                near = shape.usable and not is_far(before, state.positions, led, state.length)
                return shape if near or shape.missing_length > 0.0 else None
            state.put_back(looser)
        return None

    def _better(self, frames: Array, shape: CableShape) -> CableShape:
        """An equilibrium whose error is too large, or the same with contacts that stand, if that is exact enough."""
        state = self.state
        kept, info = state.put_aside(), state.info.copy()
        found = self._by_road(frames)
        if found is not None:
            return found
        state.put_back(kept)
        state.info[:] = info
        return shape

    def _by_road(self, frames: Array) -> CableShape | None:
        """Against drag, in front of all bodies; None if no way leads to a shape that is exact enough."""
        state, steps = self.state, self.steps
        before, then, led = state.positions, state.bodies.frames_then, led_by(state, frames)
        road = steps.by_road(frames) if state.single else None  # not yet of several segments
        if road is None:
            return None
        if not road.taut and steps.go(frames, 1, WARM_ITERATIONS, FAR):
            shape = self._arrived(before, then, led)
            if shape is not None:
                return shape
        at_rest = state.put_aside()
        found = steps.stand(frames) and (steps.settle(frames) or road.taut)
        steps.still = False
        if found:
            shape = self._arrived(before, then, led)
            state.stood = shape is not None and state.touching
            return shape
        if not road.taut or (state.rubs and state.has_friction):  # without what sticks it may find its length
            return None
        state.put_back(at_rest)  # contacts that stand may have led past a body
        state.move_bodies(steps.links)
        if state.tight > 1.0 and taut.led_to_its_length(steps):
            return self._arrived(before, then, led)
        shape = self._no_shape(Status.OVERSTRETCHED, too_short(road.missing, self._touched()))
        shape.missing_length = road.missing
        return shape

    def _arrived(self, before: Array, then: Array, led: float) -> CableShape | None:
        """The equilibrium to which a road has led from positions (n, 3) [m]; None if it is not exact enough.

        then (m, 4, 3): where the bodies were; led [m]: how far supports and bodies have gone since. It has snapped
        where it has gone much further, or over a body: the road passes none, but the straight way may.
        """
        state, steps = self.state, self.steps
        after = steps.positions(steps.buffer)
        state.remember(after)
        snapped = is_far(before, after, led, state.length) or steps.goes_through(before, then, steps.buffer)
        shape = self._finish(Status.SNAPPED if snapped else Status.OK)
        return shape if shape.status or shape.missing_length > 0.0 else None

    def _anew(self, frames: Array) -> CableShape | None:
        """From nothing, where the last solution leads nowhere; None if the cable may have come past a body on the way.

        The last solution is that of this shape, whatever comes.
        """
        state, steps = self.state, self.steps
        before, then = state.positions, state.bodies.frames_then
        free = self._free(self.problem)
        if not free.status:
            return None
        shape = self._cold(frames, free, Status.SNAPPED)
        return shape if shape.status and not steps.goes_through(before, then, shape.buffer) else None

    def _cold(self, frames: Array, free: CableShape, status: Status = Status.OK) -> CableShape:
        """From the shape without contact, to which the bodies come from below, or grow, or come from above or a side.

        Where none of this leads there, a stiffer cable is laid down and made softer; limp ones begin so.
        """
        state, steps = self.state, self.steps
        if -steps.depth(free.buffer) <= DEEPEST:
            state.rest(free, frames)
            if status is not Status.OK:
                free.status, free.detail = status, status.remedy
            return free
        gravity = self.problem.gravity
        size = float(np.linalg.norm(gravity))
        down = gravity / size if size > 0.0 else np.array((0.0, 0.0, -1.0))
        aside = np.cross(down, frames[-1, :3] - frames[0, :3])
        aside /= max(float(np.linalg.norm(aside)), _LEAST_CHORD * state.length)
        ways = [attempt * down for attempt in _ATTEMPTS] + [sign * aside for sign in (1.0, -1.0) if aside.any()]
        softer = partial(soften, steps, frames, lambda stiffer: self._lay(frames, stiffer, down))
        self._stand(free, down)
        state.rubs = False
        attempts: list[Callable[[], bool]] = [partial(self._bring, frames, free, way) for way in ways]
        if state.limpness < STIFF:
            attempts.insert(0 if state.limpness < LIMP else len(attempts), softer)
        if state.gaps.size > 1:
            attempts += [partial(self._bring, frames, free, sign * down, _PATIENT) for sign in (1.0, -1.0)]
        for attempt in attempts:
            if steps.late:
                return self._no_shape(Status.BUDGET_EXCEEDED, "")
            if attempt() and steps.settle(frames) and steps.confirmed(frames):
                return self._finish(status)
        return self._lost() if not steps.late else self._no_shape(Status.BUDGET_EXCEEDED, "")

    def _stand(self, free: CableShape, down: Array) -> None:
        """Has bodies on links stay where they are if the free shape is clear of them: arms above a table, for example,
        would else come through the cable from below, with the table.
        """
        bodies = self.state.bodies
        bodies.standing = bool(len(bodies.links))
        if bodies.standing:
            bodies.shift(_AWAY * self.state.length * down)
            bodies.standing = self.steps.depth(free.buffer) > 0.0
            bodies.shift(np.zeros(3))

    def _bring(self, frames: Array, free: CableShape, away: Array, most: int = WARM_ITERATIONS) -> bool:
        """Whether the bodies come to the free shape from `away`, or grow if that is nowhere; most: iterations."""
        found = approach(self.steps, frames, free, away, most) if away.any() else grow(self.steps, frames, free)
        self.state.bodies.shift(np.zeros(3))
        return found

    def _lay(self, frames: Array, problem: Problem, down: Array) -> bool:
        """The same for the free shape of another problem's cable."""
        free = self._free(problem)
        if not free.status or free.status is Status.OVERSTRETCHED:
            return False
        return any(self._bring(frames, free, attempt * down) for attempt in _ATTEMPTS if not self.steps.late)

    def _lost(self) -> CableShape:
        self.state.forget()
        return self._stuck("no way to a shape outside the obstacles. ")

    def _stuck(self, detail: str) -> CableShape:
        self.state.stuck = True
        return self._no_shape(Status.NOT_CONVERGED, detail)

    def _buried(self, frames: Array) -> str:
        """Which grip or clip is inside which body, in words; empty if none is."""
        state = self.state
        i, body, gap = state.buried(frames, BURIED)
        if i < 0:
            return ""
        return inside(*self._support(i, len(frames) - 1), gap, state.bodies.names[body])

    def _support(self, i: int, last: int) -> tuple[str, str]:
        """What a support is, and its name."""
        name = "start grip" if i == 0 else "end grip" if i == last else f"clips[{i - 1}]"
        return "grip" if i in (0, last) else "clip", name

    # -- results

    def _finish(self, status: Status) -> CableShape:
        """Grades and reports the solution in the buffer."""
        state = self.state
        state.patience.succeed()
        state.history = 2
        shape = self._shape(status)
        self._grade(shape)
        if state.single and not self.steps.late:
            if (shape.missing_length > 0.0 or state.tight > 1.0) and taut.tightened(self.steps, shape.missing_length):
                shape = self._shape(status)
                self._grade(shape)
            if shape.missing_length > 0.0:
                shape = self._too_short(status)
        if state.tight < 1.0 and taut.stretch_of(self.steps)[0] < taut.EASED * state.length:
            state.tighten(1.0)
        if shape.status and state.touching and state.single and not self.steps.late:
            shape = self._made_finer(shape, status)
        if not state.touching:
            state.rest(shape, state.grips[NOW].copy())
            self._leave(shape)
        shape.error_estimate += self._deviation(shape)
        return shape

    def _made_finer(self, shape: CableShape, status: Status) -> CableShape:
        """The shape, on a finer mesh where layers are thin or a contact rubs by more than it can."""
        state, is_thin = self.state, thin(self.state)
        ways = [self._layered] if is_thin else []
        if is_thin or beyond_cone(state, shape).size:
            ways.append(partial(refined, self.steps, self._shape))
        for finer in ways:
            if shape.status and finer(shape):
                shape = self._shape(status)
                self._grade(shape)
        if ways and shape.status and uneven(state, shape, self.steps.loads, TOO_MUCH).size:
            shape.status, shape.detail = Status.NOT_CONVERGED, UNEVEN
        elif ways and shape.status and beyond_cone(state, shape).size:
            shape.status, shape.detail = Status.NOT_CONVERGED, OVER
        return shape

    def _deviation(self, shape: CableShape) -> float:
        """[m], how far the bodies that it touches are off what they are in place of."""
        return self.state.bodies.deviation(shape.touches)

    def _too_short(self, status: Status) -> CableShape:
        """The last solution as that of a cable that hardly gives; one that gives and pulls little is what stays."""
        state, steps = self.state, self.steps
        state.rubs = False
        taut.pull(steps, *taut.EASY)
        kept = steps.kept()
        taut.pull(steps, *taut.HARD)
        shape = self._shape(status)
        self._grade(shape)
        steps.buffer = state.new_buffer()
        steps.take_back(kept)
        return shape

    def _layered(self, shape: CableShape) -> bool:
        """Whether the solution is one on a new mesh, for tension has made the layers at what holds the cable thin."""
        state, steps = self.state, self.steps
        pull = float(np.abs(state.ends[NOW]).max())
        if pull * state.widest**2 < state.bend:
            return False
        layer = math.sqrt(state.bend / pull)
        if layer > _THINNER * state.layer:
            return False
        kept, frames, before = steps.kept(), state.grips[NOW].copy(), shape.positions.copy()
        state.layer = layer
        state.start_from(shape, frames)
        found = steps.go(frames, 1, WARM_ITERATIONS, FAR, jump=True) and steps.settle(frames)
        if found and not steps.passes(before, steps.buffer):
            return True
        steps.take_back(kept)
        return False

    def _shape(self, status: Status) -> CableShape:
        """The solution in the buffer."""
        problem, state, steps = self.problem, self.state, self.steps
        info = state.info.tolist()
        if type(problem.end) is Grip:
            n = problem.points
            steps.buffer[4 * n - 3 : 4 * n] = problem.end.cable_frame.position
        found = state.touches()
        state.touching = len(found) > 0
        rubbed, frictionless = state.told_friction(len(steps.loads))
        shape = CableShape(
            steps.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            energy=info[8] + state.energy_of_masses(),
            error_estimate=info[7],
            residual=info[5],
            iterations=steps.iterations,
            turns=int(state.turns[NOW, 0]),
            twist=info[9],
            solve_time=perf_counter() - self.began,
            supports=steps.loads,
            rubbed=rubbed,
            touches=found,
            bodies=state.bodies.names,
            frictionless=frictionless or (state.touching and not state.rubs and state.has_friction),
        )
        shape.energy += energy_of_sections(problem.cable, shape, problem.gravity)
        return shape

    def _leave(self, shape: CableShape) -> None:
        """Lets the rod go on from a shape that touches nothing."""
        rod = self._made()
        rod.history = 0
        rod.last = shape
        rod.arcs[rod.rings] = self.state.arcs[self.state.rings]

    def _grade(self, shape: CableShape) -> None:
        """Fills status and detail of a shape that is OK or SNAPPED if nothing is the matter with it."""
        shape.missing_length = self._stretched(shape)
        allowed = max(self.problem.tolerance, ACCURACY * self.state.length)
        within = shape.error_estimate <= allowed
        detail = ""
        if shape.missing_length > 0.0:
            shape.status, shape.error_estimate = Status.OVERSTRETCHED, math.inf
            detail = too_short(shape.missing_length, self._touched()) + "It is drawn as if it were longer."
        elif self.steps.late:
            shape.status = Status.BUDGET if within else Status.BUDGET_EXCEEDED
        elif not within:
            shape.status, detail = Status.NOT_CONVERGED, inexact(shape.error_estimate, allowed)
        elif shape.status is Status.OK and self.state.info[2] != 0.0:
            shape.status = Status.UNSTABLE
        shape.detail = detail or ("" if shape.status is Status.OK else shape.status.remedy)

    def _touched(self) -> list[str]:
        """The names of the bodies that push the cable in the last solution."""
        rows = self.state.touches()[:, 1].tolist()
        return [self.state.bodies.names[int(body)] for body in dict.fromkeys(rows)]

    def _stretched(self, shape: CableShape) -> float:
        """[m] what a cable that does not stretch lacks, 0 if that is next to nothing; its error grows by as much.

        A free end pulls it as long as it is: only up to the last support with a given place it can be too short.
        """
        if self.state.stretches:
            return 0.0
        whole, missing = taut.stretch_of(self.steps)
        shape.error_estimate += whole
        return missing if missing > TAUT * shape.length else 0.0

    def _no_shape(self, status: Status, detail: str) -> CableShape:
        """The straight line; what was solved before stays as a warm start."""
        problem = self.problem
        frames = self.state.aimed()
        told = detail + status.remedy
        return straight_line(
            problem, self.steps.buffer, frames[0], frames[-1], status, told, self.steps.iterations, self.began
        )
