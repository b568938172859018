"""A cable among strands: :class:`OneCable`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, final

import numpy as np

from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.shape import CableShape
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.spot import Pair
from cable_shape.solve.touching.strands import Held, at_frame, lifted
from cable_shape.solve.touching.told import Told


class Solo(Protocol):
    """What solves for one cable as if there were no other."""

    problem: Problem  #: moved to the ends before every solve; may be another one, of the same cable under other loads

    def alone(self) -> CableShape:
        """The shape between the problem's ends."""

    def go_on_from(self, shape: CableShape, frames: Array, links: Array) -> None:
        """Makes a shape between the ends `frames` (2, 7) the last solution, if there are bodies it may lie on.

        links (m, 7): where the links were then that carry bodies; m = 0: not known, or there are none.
        """

    def twin(self) -> Solo:
        """Once more: it goes on from the last shape, and this one stays as it is."""


@final
class OneCable:
    """See :class:`.strands.Part`; it meets no junction."""

    def __init__(self, name: str, solo: Solo) -> None:
        self.names: tuple[str, ...] = (name,)
        self.solo, self.problem = solo, solo.problem
        self.cables = [self.problem.cable]

    @property
    def problems(self) -> list[Problem]:
        """See `Part`."""
        return [self.problem]

    def held(self, strand: int) -> Held:
        """See `Part`."""
        return self.problem.start, self.problem.end

    def joined(self, pair: Pair) -> Array:
        """See `Part`."""
        return np.zeros((2, 2))

    def hold(self, frames: Array, links: Mapping[str, Pose] | None) -> None:
        """See `Part`."""
        self._move(at_frame(self.problem.start, frames[0]), at_frame(self.problem.end, frames[1]), links)

    def _move(self, start: Grip | FreeEnd, end: Grip | FreeEnd, links: Mapping[str, Pose] | None) -> None:
        assert isinstance(start, Grip)
        self.problem.move(start, end, links)

    def given(self) -> Any:
        """See `Part`."""
        return self.problem.start, self.problem.end, self.problem.links

    def give_back(self, given: Any) -> None:
        """See `Part`."""
        self.problem.move(*given)

    def higher(self, given: Any, way: Array) -> None:
        """See `Part`."""
        start, end, links = given
        self._move(lifted(start, way), lifted(end, way), links)

    def renewed(self) -> bool:
        """See `Part`."""
        before, self.problem = self.problem, self.solo.problem
        return before is not self.problem

    def levers(self, shapes: Sequence[CableShape]) -> Array:
        """See `Part`: it has none."""
        return np.empty(0)

    def shapes(self, told: Told, rows: range) -> list[CableShape]:
        """See `Part`."""
        state, problem, row = told.state, self.problem, rows.start
        n = problem.points
        buffer = told.buffer_of(row)
        for side, at in ((problem.start, n), (problem.end, 4 * n - 3)):
            if type(side) is Grip and at > n:
                buffer[at : at + 3] = side.cable_frame.position
        shape = CableShape(
            buffer,
            n,
            length=problem.cable.length,
            model=MODEL,
            status=told.status,
            detail=told.detail,
            energy=told.energy_of(row) + _energy_of_masses(problem, buffer),
            error_estimate=told.error_estimate,
            residual=float(state.info[drive.I_RESIDUAL]),
            iterations=told.iterations,
            turns=int(state.turns[NOW, row]),
            twist=told.twist_of(row),
            solve_time=told.solve_time,
            supports=told.loads_on(row),
            touches=told.touches[row],
            bodies=told.bodies,
            frictionless=told.frictionless,
        )
        shape.energy += energy_of_sections(problem.cable, shape, problem.gravity)
        return [shape]

    def alone(self) -> list[CableShape]:
        """See `Part`."""
        return [self.solo.alone()]

    def accept(self, shapes: Sequence[CableShape]) -> None:
        """See `Part`: that needs nothing."""

    def go_on_from(self, shapes: Sequence[CableShape], frames: Array, links: Array) -> None:
        """See `Part`."""
        self.solo.go_on_from(shapes[0], frames, links)

    def learn(self, other: OneCable) -> None:
        """See `Part`: that needs nothing."""

    def twin(self) -> OneCable:
        """See `Part`."""
        return self.of(self.solo.twin())

    def of(self, solo: Any) -> OneCable:
        """See `Part`."""
        return OneCable(self.names[0], solo)


def _energy_of_masses(problem: Problem, buffer: Array) -> float:
    """[J], potential energy of a cable's point masses and plug."""
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
