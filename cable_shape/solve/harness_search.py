"""How the equilibrium of a harness is looked for, and graded: :func:`solve`."""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import drive, tables
from cable_shape.kernels.network.drive import I_ENERGY, I_ESTIMATE, I_FORCE, I_MOMENT, I_RESIDUAL, I_TURNED, INFO
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_guess import laid
from cable_shape.solve.harness_network import FIRM, HarnessNetwork
from cable_shape.solve.harness_outcome import lacking, laid_straight, out_of_reach
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_rest import bent, put_ends, start_at_rest
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.outcome import MODEL
from cable_shape.solve.search import _FAR_STEP, _SAME, FAR, WARM_ITERATIONS, Search
from cable_shape.solve.settle import Settling

#: Guesses: share of the loads that pull the knots, kind and tilt of the spans' curves.
_GUESSES = ((1.0, HANGING, 0.0), (1.0, CURVED, 0.3), (0.1, CURVED, 0.1), (0.0, CURVED, 0.02), (10.0, HANGING, 0.0))
#: In this order: how many times as fine as usual the mesh is, the guess, by how much it is disturbed, how firmly soft
#: modes are held, whether it settles first, whether only a stable shape will do.
_ATTEMPTS = (
    *((1.0, guess, 0.0, firm, False, True) for firm in FIRM[:2] for guess in _GUESSES[:3]),
    *((1.0, guess, 0.0, FIRM[2], False, True) for guess in _GUESSES),
    *((2.0, guess, 0.0, firm, False, True) for firm in FIRM for guess in _GUESSES[:2]),
    *((1.3 + 0.15 * i, _GUESSES[i % 4], 0.03 * (1 + i), FIRM[i % 3], False, True) for i in range(12)),
    *((2.0, guess, 0.0, FIRM[1], True, True) for guess in _GUESSES[:2]),
    *((2.0, guess, 0.0, FIRM[0], False, False) for guess in _GUESSES),
)
#: Iterations of a solve from a guess: parts that hang have soft modes.
_COLD_ITERATIONS = 160
#: Steps in time that a guess may take to settle.
_SETTLED = 100


@final
class HarnessSearch(Search):
    """One solve of a harness; see `Search`."""

    __slots__ = ("task", "told")

    state: HarnessNetwork

    def __init__(
        self, task: HarnessProblem, state: HarnessNetwork, deadline: float, began: float, last: HarnessProblem
    ) -> None:
        self.task = task
        self.told = state.told_before  # the loads of the last solution, if they were others
        super().__init__(task, state, deadline, began, last)  # type: ignore[arg-type]

    def room(self) -> tuple[Array, Array]:
        """For the shapes of all segments, and for what they do to the knots."""
        state = self.state
        return np.empty(NUMBERS_PER_POINT * self.task.points * state.cables), np.empty((len(state.layout.knots), 7))

    def shape(self, status: Status, detail: str) -> HarnessShape:  # type: ignore[override]
        """What the last compiled solve found."""
        task, state, info = self.task, self.state, self.info
        told = state.info[INFO:].copy()
        cables = state.cables
        rubbed, frictionless = state.told_friction(len(state.clip_rows))
        found = HarnessShape(
            task.harness,
            self.buffer,
            task.points,
            model=MODEL,
            status=status,
            detail=detail,
            energy=info[I_ENERGY] + state.energy_of_masses(),
            energies=told[2 * cables :],
            twists=told[: 2 * cables : 2],
            error_estimate=info[I_ESTIMATE],
            force_error=info[I_FORCE],
            moment_error=info[I_MOMENT],
            residual=info[I_RESIDUAL],
            iterations=self.iterations,
            solve_time=perf_counter() - self.began,
            before=self.before,  # type: ignore[arg-type]
            clips=self.loads[state.clip_rows] if state.clip_rows else None,
            clips_of=task.clips,
            rubbed=rubbed,
            frictionless=frictionless,
        )
        found.weigh_sections(task.gravity)
        return found

    def no_shape(self, status: Status, poses: Array, detail: str, missing: float = 0.0) -> HarnessShape:  # type: ignore[override]
        """Straight lines between the knots; what was solved before stays as a warm start."""
        task, state = self.task, self.state
        laid_straight(task, state, poses, self.buffer)
        told = detail if status is Status.OVERSTRETCHED else detail + status.remedy
        clips = np.zeros((len(state.clip_rows), 7))
        return HarnessShape(
            task.harness, self.buffer, task.points, model=MODEL, status=status, detail=told, iterations=self.iterations,
            solve_time=perf_counter() - self.began, missing_length=missing, clips=clips, clips_of=task.clips,
        )  # fmt: skip

    def hopeless(self, poses: Array) -> tuple[Status, Array, str, float] | None:
        """Why there is no equilibrium between `poses`; None if there may be one."""
        return out_of_reach(self.task, self.state, poses)

    def along(self, shape: Any) -> tuple[Array, Array]:
        """Arc lengths (k,) and positions (k, 3) of a shape, one segment after the other, a gap between them."""
        state = self.state
        s = [one.arc_length + gap for one, gap in zip(shape.segments.values(), state.gaps, strict=True)]
        return np.concatenate(s), np.concatenate([one.positions for one in shape.segments.values()])

    def _elsewhere(self, s: Array, coarse: Array) -> bool:
        if self.info[I_TURNED] <= _FAR_STEP:
            return False
        nodes, fine = self.state.node_positions()
        apart = np.stack([np.interp(nodes, s, x) for x in coarse.T], axis=1) - fine
        return float((apart * apart).sum(axis=1).max()) > (_SAME * self.task.harness.longest) ** 2

    def _find_again(self, coarse: object) -> bool:
        return False

    def _load(self, at: float) -> None:
        """Makes the loads those at this share of the way from the last ones, if they differ."""
        if self.told is not None:
            state = self.state
            if at in (0.0, 1.0):  # some of its numbers may be infinite
                state.take_over(state.held if at else self.told)
            else:
                state.take_over((1.0 - at) * self.told + at * state.held)

    def _give_up(self, goal: Array) -> HarnessShape:  # type: ignore[override]
        """Out of time away from the goal: the shape for the supports that were reached, if any."""
        shape: Any = self._here()
        if shape is None:
            return self.no_shape(Status.BUDGET_EXCEEDED, goal, "")
        shape.status = Status.BUDGET_EXCEEDED
        shape.detail = f"the shape is that of grips on their way. {shape.status.remedy}"
        shape.error_estimate = math.inf
        return shape  # type: ignore[no-any-return]

    # -- from nothing

    def _cold(self, poses: Array, wound: float = 0.0) -> HarnessShape:  # type: ignore[override]
        """From guesses, the likeliest first, then from some that settle against drag, until there is a stable shape."""
        state = self.state
        self.cold = True
        state.align(poses)
        # what is too short between ends beside their junctions would bend the levers that hold them there
        if state.layout.levers and (short := self._too_short(self._guess(poses, 1.0))) is not None:
            return short
        if bent(state) and (rested := self._from_rest(poses)) is not None:
            return rested
        found: HarnessShape | None = None
        kept: tuple[Any, ...] = ()
        chance = np.random.default_rng(0)
        guesses: dict[float, Array] = {}
        for fineness, (load, kind, sag), disturbed, firm, settles, guard in _ATTEMPTS:
            if not guard and found is not None:
                break
            if load not in guesses:
                guesses[load] = self._guess(poses, load)
            guess = guesses[load].copy()
            if disturbed > 0.0:
                self._disturb(guess, disturbed, chance)
            state.firm(firm)
            state.first_mesh(guess, fineness)
            if self.eyelets is not None:
                self.eyelets.spread(guess)
            state.start_from(guess, kind, sag)
            if settles and (state.rings or not self._settled()):
                continue
            if self.call(0, _COLD_ITERATIONS, guard=guard):
                told = Status.SNAPPED if self.snapped else Status.OK
                shape: Any = self._finish(told if guard else Status.UNSTABLE)
                if shape.status in (Status.OK, Status.SNAPPED):
                    return shape  # type: ignore[no-any-return]
                if found is None or (shape.usable and not found.usable):
                    found, kept = shape, state.put_aside()
                self.buffer, self.loads = self.room()
            if self.out_of_time():
                return self._give_up(guess) if found is None else found
        if found is not None:
            state.put_back(kept)
            return found
        state.history = 0
        guess = guesses[1.0]
        why = "" if self.eyelets is None else self.eyelets.why
        return self._too_short(guess) or self.no_shape(Status.NOT_CONVERGED, guess, why)

    def _too_short(self, guess: Array) -> HarnessShape | None:
        """What says that segments are too short to be laid out to all supports and to close; None: they are not."""
        missing, name = lacking(self.task, self.state, guess)
        if missing == 0.0:
            return None
        detail = (
            f"the segments lack {missing:.3g} m to reach all supports and to close, {name!r} most of all. Bring "
            "the supports closer, or lengthen it; the shape is straight lines."
        )
        self.state.history = 0
        return self.no_shape(Status.OVERSTRETCHED, guess, detail, missing)

    def _from_rest(self, poses: Array) -> HarnessShape | None:
        """From the form at rest, on two first meshes, with soft modes held ever more firmly; None: not from there."""
        state = self.state
        fixed = [row for row, knot in enumerate(state.structure.knots) if not knot.moves]
        held = [row for row in fixed if not all(state.structure.loose[row])]  # else it turns as the cable does
        found: HarnessShape | None = None
        for fineness, firm in ((1.0, FIRM[0]), (1.0, FIRM[2]), (1.7, FIRM[0]), (1.7, FIRM[2])):
            state.firm(firm)
            rest = start_at_rest(state, poses, fineness)
            near = np.where((rest[:, 3:] * poses[:, 3:]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
            poses = np.concatenate((poses[:, :3], near * poses[:, 3:]), axis=1)
            state.target[fixed, :3] = poses[fixed, :3]
            state.target[held, 3:] = poses[held, 3:]
            put_ends(state, poses)
            drive.strip(state.ints, state.floats, state.sols)
            if self.call(0, _COLD_ITERATIONS):
                shape: Any = self._finish(Status.SNAPPED if self.snapped else Status.OK)
                if shape.usable or self.late:
                    found = shape
                    break
                self.buffer, self.loads = self.room()
            if self.out_of_time():
                break
        return found

    def _lost(self, poses: Array) -> HarnessShape:  # type: ignore[override]
        """A finer mesh did not confirm the equilibrium."""
        self.state.history = 0
        return self.no_shape(Status.NOT_CONVERGED, poses, "the equilibrium was lost on a finer mesh. ")

    def _guess(self, poses: Array, load: float) -> Array:
        """Poses of all knots, of which some are given."""
        return laid(self.state, poses, load)

    def _disturb(self, poses: Array, much: float, chance: np.random.Generator) -> None:
        """Moves what nothing holds by about so much [lengths, rad]."""
        state = self.state
        for row, knot in enumerate(state.structure.knots):
            if knot.moves:
                poses[row, :3] += much * state.length * chance.normal(size=3)
                poses[row, 3:] += 0.5 * much * chance.normal(size=4)
                poses[row, 3:] /= np.linalg.norm(poses[row, 3:])

    def _settled(self) -> bool:
        """Lets the guess in the trial come to rest against drag."""
        state = self.state
        settling = Settling(state.ints, state.floats, state.sols, tables.TRIAL)

        def each() -> None:
            if self.out_of_time():
                raise TimeoutError

        try:
            found = settling.settle(_SETTLED, 1e-4, each)
        except TimeoutError:
            return False
        settling.hand_over(state.sols)
        drive.strip(state.ints, state.floats, state.sols)
        return found or settling._moved


def solve(
    task: HarnessProblem, state: HarnessNetwork | None = None, *, deadline: float = math.inf
) -> tuple[HarnessShape, HarnessNetwork]:
    """The shape of the problem's harness between its ends, and the memory for the next one.

    As `cosserat.solve`, of which this is the case of many segments.
    """
    began = perf_counter()
    if state is None:
        state = HarnessNetwork(task)
    last = state.problem
    state.told_before = None
    if last is not task:
        state.keep_loads()
        state.take(task)
    poses = state.aim(trial=state.history > 0)
    search = HarnessSearch(task, state, deadline, began, last)
    followed = state.history > 0 and search.call(state.history, WARM_ITERATIONS, far=FAR)
    if followed and search.final:
        state.settle()
        return search.shape(Status.OK, ""), state
    return search.run(poses, followed), state  # type: ignore[return-value]
