"""What a pile of cables that touch has found, and the contacts of each of them: :class:`Told`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import split_end
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.shape import NUMBERS_PER_POINT, TOUCH, Status
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.spot import Spot

ITSELF = "itself"  #: the body's name, where a cable touches itself


@final
class Told:
    """An equilibrium of a pile, graded; `cables` are the numbers of those that are in it, a row each.

    Attributes
    ----------
    bodies : tuple of str, what they may touch, by names
    touches : list of (k, TOUCH), the contacts of each as `CableShape` has them
    overlap, frictionless : see `Pile`
    """

    def __init__(
        self,
        cables: list[int],
        names: Sequence[str],
        every: Sequence[Cable],
        spots: list[Spot],
        state: HarnessTouchState,
        buffer: Array,
        loads: Array,
        *,
        iterations: int,
        status: Status,
        detail: str,
        overlap: float,
        frictionless: bool,
        solve_time: float,
    ) -> None:
        """names, every: of all cables, by their numbers; loads (k, 7): on the clips; solve_time [s].

        buffer: of all shapes, one after the other, levers behind.
        """
        self.cables, self.state, self._buffer, self._loads = cables, state, buffer, loads
        self.frictionless = frictionless
        self.iterations, self.status, self.detail, self.solve_time = iterations, status, detail, solve_time
        self.error_estimate = float(state.info[drive.I_ESTIMATE]) + overlap  # m, of the positions
        self.bodies, self.touches = self._contacts(names, every, spots)
        self.error_estimate += max(map(state.bodies.deviation, self.touches), default=0.0)
        self._segments = list(state.problem.segments)

    def buffer_of(self, row: int) -> Array:
        """A copy of the shape of one."""
        size = NUMBERS_PER_POINT * self.state.problem.points
        return self._buffer[row * size : (row + 1) * size].copy()

    def loads_on(self, row: int) -> Array:
        """(k, 7), on the clips of one."""
        loads: Array = self._loads[self.state.problem.clips[self._segments[row]]]
        return loads

    def energy_of(self, row: int) -> float:
        """[J], elastic + gravitational, without masses."""
        return float(self.state.info[drive.INFO + 2 * self.state.gaps.size + row])

    def twist_of(self, row: int) -> float:
        """[rad], the integral of u3."""
        return float(self.state.info[drive.INFO + 2 * row])

    def levers_of(self, rows: range) -> list[int]:
        """The rows of the levers at ends of these."""
        own = {self._segments[row] for row in rows}
        ends = [str(name[1]) for name in self.state.layout.knots if name[0] == "lever"]
        return [row for row, end in enumerate(ends, len(self._segments)) if split_end(end)[0] in own]

    def energy_with_masses(self, rows: range, levers: Sequence[int]) -> float:
        """[J], elastic + gravitational, of these and all masses on them."""
        state, own = self.state, self._segments[rows.start : rows.stop]
        if len(own) == len(self._segments):
            return float(state.info[drive.I_ENERGY]) + state.energy_of_masses(own)
        return sum(map(self.energy_of, (*rows, *levers))) + state.energy_of_masses(own)

    def _contacts(
        self, names: Sequence[str], cables: Sequence[Cable], spots: Sequence[Spot]
    ) -> tuple[tuple[str, ...], list[Array]]:
        """Names of what these cables may touch, and the contacts of each."""
        bodies, out = list(self.state.bodies.names), []
        for own, cable in zip(self.state.touches_of_segments(), self.cables, strict=False):
            rows = [own]
            for spot in spots:
                for side, sign in ((0, 1.0), (1, -1.0)):
                    if spot.cables[side] != cable or not spot.press > 0.0:
                        continue
                    other, normal = spot.cables[1 - side], sign * spot.normal
                    name = ITSELF if other == cable else names[other]
                    if name not in bodies:
                        bodies.append(name)
                    point = spot.places[1 - side] + 0.5 * widest(cables[other]) * normal
                    pull = spot.pull if side == 0 else 0.0 - spot.pull
                    row = (spot.arcs[side], bodies.index(name), *point, *normal, spot.press, *pull, spot.slips)
                    rows.append(np.array(row).reshape(1, TOUCH))
            found = np.vstack(rows)
            out.append(found[np.argsort(found[:, 0], kind="stable")])
        return tuple(bodies), out
