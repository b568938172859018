"""The quasistatic harness that rests on bodies: as :mod:`.touching`, all its segments at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from time import perf_counter
from typing import Any, final

import numpy as np

from cable_shape.cable.pieces import stretches
from cable_shape.kernels.contact import afterwards, drive
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import FreeEnd
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve import harness_search
from cable_shape.solve.harness_guess import laid
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_outcome import laid_straight
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.road import TAUT
from cable_shape.solve.touching.touching import Solve


def support_of(knots: Iterable[tuple[Any, ...]], clips: Sequence[str], i: int) -> tuple[str, str]:
    """What knot i of a harness is, and its name; knots: of its layout, clips: their names."""
    kind, name = list(knots)[i][:2]
    if kind == "clip":
        return "clip", f"clip {clips[int(name)]!r}"
    return ("grip", f"grip {name!r}") if kind == "end" else ("part", f"{kind} {name!r}")


def solve(
    problem: HarnessProblem,
    state: HarnessTouchState,
    rod: HarnessNetwork | None,
    *,
    deadline: float = math.inf,
    leaps: bool = True,
) -> tuple[HarnessShape, HarnessNetwork | None]:
    """The harness between the problem's ends and in its clips, outside its bodies, and the memory without contact.

    As `touching.solve`.
    """
    began = perf_counter()
    if state.problem is not problem:
        state.take(problem)
    one = HarnessSolve(problem, state, rod, deadline, began, leaps)  # type: ignore[arg-type]
    shape: Any = one.run()
    return shape, one.rod


@final
class HarnessSolve(Solve):
    """One call of :func:`solve`."""

    problem: HarnessProblem  # type: ignore[assignment]
    state: HarnessTouchState
    rod: HarnessNetwork | None

    def _alone(self) -> HarnessShape:  # type: ignore[override]
        shape, self.rod = harness_search.solve(self.problem, self.rod, deadline=self.deadline)
        return shape

    def _free(self, problem: HarnessProblem) -> HarnessShape:  # type: ignore[override]
        return harness_search.solve(problem, deadline=self.deadline)[0]

    def _support(self, i: int, last: int) -> tuple[str, str]:
        return support_of(self.state.cable.layout.knots, self.problem.clip_names, i)

    def _shape(self, status: Status) -> HarnessShape:  # type: ignore[override]
        problem, state, steps, info = self.problem, self.state, self.steps, self.state.info
        cables = state.gaps.size
        told = info[drive.INFO :]
        touches = state.touches_of_segments()
        state.touching = any(len(rows) for rows in touches)
        rubbed, frictionless = state.told_friction(len(steps.loads))
        shape = HarnessShape(
            problem.harness,
            steps.buffer,
            problem.points,
            model=MODEL,
            status=status,
            energy=float(info[drive.I_ENERGY]) + state.energy_of_masses(),
            energies=told[2 * cables :].copy(),
            twists=told[: 2 * cables : 2].copy(),
            error_estimate=float(info[drive.I_ESTIMATE]),
            residual=float(info[drive.I_RESIDUAL]),
            iterations=steps.iterations,
            solve_time=perf_counter() - self.began,
            clips=steps.loads if len(steps.loads) else None,
            clips_of=problem.clips,
            rubbed=rubbed,
            frictionless=frictionless,
            touches=touches,
            bodies=state.bodies.names,
        )
        shape.weigh_sections(problem.gravity)
        return shape

    def _leave(self, shape: HarnessShape) -> None:  # type: ignore[override]
        """Lets the harness go on from a shape that touches nothing."""
        state = self.state
        self.rod = HarnessNetwork(self.problem)
        self.rod.aim()
        self.rod.resume_from(state.whole(shape), state.gaps, state.knots_at(shape, state.grips[NOW]))

    def _stretched(self, shape: HarnessShape) -> float:  # type: ignore[override]
        """[m] what the segment lacks that lacks most, 0 if that is next to nothing; errors grow by what all lack."""
        lacking = 0.0
        size = NUMBERS_PER_POINT * shape.points
        for c, (name, cable) in enumerate(self.problem.harness.segments.items()):
            if stretches(cable):
                continue
            free = any(type(self.problem.ends.get(f"{name}.{side}")) is FreeEnd for side in ("start", "end"))
            own = shape.buffer[c * size : (c + 1) * size]
            bounds = np.array((0.0,) if free else (0.0, cable.length))
            whole, missing = afterwards.stretched(own, shape.points, self.state.stretch, bounds)
            shape.error_estimate += whole
            lacking = max(lacking, missing if missing > TAUT * cable.length else 0.0)
        return lacking

    def _deviation(self, shape: HarnessShape) -> float:  # type: ignore[override]
        return max(map(self.state.bodies.deviation, shape.touches), default=0.0)

    def _no_shape(self, status: Status, detail: str) -> HarnessShape:  # type: ignore[override]
        problem, state = self.problem, self.state
        network = state.cable
        buffer = self.steps.buffer
        laid_straight(problem, network, laid(network, network.aim(), 1.0), buffer)
        return HarnessShape(
            problem.harness, buffer, problem.points, model=MODEL, status=status, detail=detail + status.remedy,
            iterations=self.steps.iterations, solve_time=perf_counter() - self.began,
            clips=np.zeros((len(state.clip_knots), 7)), clips_of=problem.clips,
        )  # fmt: skip
