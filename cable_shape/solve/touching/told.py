"""What a pile of cables that touch has found, and the contacts of each of them: :class:`Told`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import widest
from cable_shape.checks import Array
from cable_shape.kernels.contact import drive
from cable_shape.shape import TOUCH, Status
from cable_shape.solve.touching.harness_state import HarnessTouchState
from cable_shape.solve.touching.spot import Spot

NO_FRICTION = (0.0, 0.0, 0.0, 0.0)  #: along the surfaces of cables that touch
ITSELF = "itself"  #: the body's name, where a cable touches itself


@final
class Told(NamedTuple):
    """An equilibrium of a pile, graded; `cables` are the numbers of those that are in it."""

    cables: list[int]
    spots: list[Spot]
    state: HarnessTouchState
    buffer: Array  # of all shapes, one after the other
    loads: Array  # (k, 7), on the clips
    iterations: int
    status: Status
    detail: str
    overlap: float  # [m], see `Pile.overlap`
    solve_time: float  # [s]

    @property
    def error_estimate(self) -> float:
        """[m], of the positions."""
        return float(self.state.info[drive.I_ESTIMATE]) + self.overlap

    def touches(self, names: Sequence[str], cables: Sequence[Cable]) -> tuple[tuple[str, ...], list[Array]]:
        """Names of what these cables may touch, and the contacts of each in the pile as `CableShape` has them."""
        bodies, out = list(self.state.bodies.names), []
        for own, cable in zip(self.state.touches_of_segments(), self.cables, strict=False):
            rows = [own]
            for spot in self.spots:
                for side, sign in ((0, 1.0), (1, -1.0)):
                    if spot.cables[side] != cable or not spot.press > 0.0:
                        continue
                    other, normal = spot.cables[1 - side], sign * spot.normal
                    name = ITSELF if other == cable else names[other]
                    if name not in bodies:
                        bodies.append(name)
                    point = spot.places[1 - side] + 0.5 * widest(cables[other]) * normal
                    row = (spot.arcs[side], bodies.index(name), *point, *normal, spot.press, *NO_FRICTION)
                    rows.append(np.array(row).reshape(1, TOUCH))
            found = np.vstack(rows)
            out.append(found[np.argsort(found[:, 0], kind="stable")])
        return tuple(bodies), out
