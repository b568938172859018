"""One compiled solve of the rod after another, and what they found: :class:`RodCall`."""

from __future__ import annotations

from time import perf_counter
from typing import final

from cable_shape.checks import Array
from cable_shape.kernels import rod_drive, rod_stability
from cable_shape.kernels.rod_drive import ENERGY, ESTIMATE, EXCESS, ITERATIONS, RESIDUAL, TURNS, TWIST
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.models.rod_common import MODEL, straight_line
from cable_shape.models.rod_state import RodState
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status

COLD_ITERATIONS, WARM_ITERATIONS, STEP_ITERATIONS = 80, 25, 12
#: So many meshes are tried for one shape.
MESHES = 12
#: A warm solve that turns a frame by more than this [rad] from its prediction is checked by small steps.
FAR = 0.7


@final
class RodCall:
    """A problem, the solver's memory, and the last compiled solve."""

    __slots__ = ("before", "began", "buffer", "deadline", "info", "iterations", "late", "problem", "state")

    def __init__(self, problem: Problem, state: RodState, deadline: float, began: float) -> None:
        self.problem = problem
        self.state = state
        self.deadline = deadline
        self.began = began
        self.iterations = 0
        self.late = False
        self.before: CableShape | None = None  # the last shape of a branch that ended
        self.buffer = CableShape.new_buffer(problem.points)
        self.info: list[float] = []

    def solve(self, history: int, most: int, guard: bool = True, output: bool = True, far: float = 7.0) -> bool:
        """One compiled solve; True if it found an equilibrium, a stable one if guarded."""
        state = self.state
        points = self.problem.points if output else 0
        code = rod_drive.solve(
            state.par, state.mesh, state.sol, state.work, self.buffer, state.info, state.elements, state.width, points,
            history, guard, most, far,
        )  # fmt: skip
        self.info = state.info.tolist()
        self.iterations += int(self.info[ITERATIONS])
        return bool(code == CONVERGED)

    @property
    def final(self) -> bool:
        """Whether the last solve found a stable shape within tolerance, on a mesh as fine as it need be."""
        info, state = self.info, self.state
        return info[EXCESS] == 0.0 and not state.too_coarse(info) and not state.too_fine(info)

    def refine(self) -> bool:
        """Meshes as fine as the error asks for, starting from the last solution; False where it is lost."""
        for _ in range(MESHES):
            if not self.state.too_coarse(self.info) or not self.state.next_mesh():
                break
            if self.out_of_time() or not self.solve(0, COLD_ITERATIONS):
                return False
        return True

    def least_eigenvalue(self) -> float:
        """[N m / m^2], of the second variation at the last solution."""
        state = self.state
        least = rod_stability.smallest_eigenvalue(
            state.par, state.mesh, state.sol, state.work, state.elements, state.width
        )
        rod_stability.refresh(state.par, state.mesh, state.sol, state.work, state.elements, state.width, True)
        return float(least)

    def shape(self, status: Status, detail: str) -> CableShape:
        """What the last compiled solve found."""
        problem, info = self.problem, self.info
        return CableShape(
            self.buffer,
            problem.points,
            length=problem.cable.length,
            model=MODEL,
            status=status,
            detail=detail,
            energy=info[ENERGY] + self.state.energy_of_masses(),
            error_estimate=info[ESTIMATE],
            residual=info[RESIDUAL],
            iterations=self.iterations,
            turns=int(info[TURNS]),
            twist=info[TWIST],
            solve_time=perf_counter() - self.began,
            before=self.before,
        )

    def no_shape(self, status: Status, ends: Array, detail: str) -> CableShape:
        """The straight line between the ends; what was solved before stays as a warm start."""
        far = ends[7:14] if self.state.width > 1 else ends[:7]
        told = detail + status.remedy
        return straight_line(self.problem, self.buffer, ends[:7], far, status, told, self.iterations, self.began)

    def out_of_time(self) -> bool:
        self.late = self.late or perf_counter() > self.deadline
        return self.late
