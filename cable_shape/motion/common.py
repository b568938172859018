"""What the motion of one cable and of a harness have in common."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.swing import BENT, ELEMENTS, LAYERS, MOST_ELEMENTS, STIFFER, Swing
from cable_shape.motion.tangents import Tangents
from cable_shape.pose import FreeEnd, Grip
from cable_shape.shape import CableShape, Status
from cable_shape.solve.harness_shape import HarnessShape

MODEL = "motion"
Shape = TypeVar("Shape", CableShape, HarnessShape)


class Traced:
    """What a motion tells of its state and of derivatives along it."""

    _swing: Swing | None
    _tangents: Tangents | None

    @property
    def alive(self) -> bool:
        """Whether there is a state to step from."""
        return self._swing is not None

    @property
    def traceable(self) -> bool:
        """Whether derivatives tell all of how it answers: it touches nothing."""
        return self._swing is not None and self._swing.among is None

    @property
    def breaks(self) -> int:
        """In how many parts of steps since `begin` was given names something else was touched than before, or slipped.

        Derivatives may break there: they go on as if it came in the same part, whatever changes.
        """
        return 0 if self._tangents is None else self._tangents.breaks

    @property
    def traced(self) -> bool:
        """Whether derivatives are carried along."""
        return self._tangents is not None


def enough(shape: CableShape, cable: Cable) -> int:
    """How many elements a cable needs that none is much longer than its boundary layers.

    And that none bends too far for what is much stiffer, twist or bending across: one that bends by x rad saves
    x^2 GJ / 6 EI of the energy of its twist by its bow, and beyond 1 it is no minimum.
    """
    pieces = [one for _, _, one in pieces_of(cable)]
    stiffness = min(min(one.bending_stiffness) for one in pieces)
    layer = math.sqrt(stiffness / max(float(np.linalg.norm(shape.force, axis=1).max()), 1e-300))
    stiffer = max(max(one.twisting_stiffness, *one.bending_stiffness) / min(one.bending_stiffness) for one in pieces)
    longest = layer * (BENT / math.sqrt(stiffer) if stiffer > STIFFER else LAYERS)
    return int(min(max(ELEMENTS, math.ceil(cable.length / longest)), MOST_ELEMENTS))


def check_moves(cable: Cable) -> None:
    """Refuses what does not move."""
    if cable.linear_density == 0.0:
        remedy = "Give it in kg/m: without mass there is no motion."
        raise ArgumentError.of("linear_density", 0.0, "Motion needs it above 0 kg/m", remedy)
    if cable.mean_bending_stiffness == 0.0:
        remedy = "Give EI in N m^2, however small it is."
        raise ArgumentError.of("bending_stiffness", 0.0, "Motion needs it above 0 N m^2", remedy)


def steps_ahead(swing: Swing | None, count: int, step: Callable[[], Shape]) -> list[Shape]:
    """So many steps of a motion, which then is as it was; fewer where one cannot be taken.

    Raises
    ------
    ArgumentError
        Before it has begun.
    """
    if swing is None:
        raise ArgumentError("ahead() needs a state to go on from, and there is none. Call begin first.")
    found: list[Shape] = []
    with swing.kept_as_it_is():
        for _ in range(count):
            shape = step()
            if not shape.status:
                break
            found.append(shape)
    return found


def failed(shape: Shape, status: Status, detail: str, missing: float = 0.0) -> Shape:
    """The shape once more, for want of another; missing [m], of an overstretched one."""
    kept = shape.again()
    kept.status, kept.detail, kept.missing_length = status, detail + status.remedy, missing
    kept.work = kept.dissipated = kept.lost = 0.0
    kept.error_estimate = math.inf
    return kept


def work_of(
    before: Grip | FreeEnd, end: Grip | FreeEnd, shape: CableShape, place: Array, frame: Array, at: int = -1
) -> float:
    """[J], of the dead loads on a free end in the last step, from `place` (3,) and `frame` (4,)."""
    if not isinstance(end, FreeEnd) or not isinstance(before, FreeEnd):
        return 0.0
    work = float(0.5 * (before.force + end.force) @ (shape.positions[at] - place))
    if not (before.moment.any() or end.moment.any()):
        return work
    x, y, z, w = -frame[0], -frame[1], -frame[2], frame[3]
    a, b, c, d = shape.quaternions[at]
    turn = np.array(
        (d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x, d * z + a * y - b * x + c * w)
    )  # fmt: skip
    turn *= math.copysign(2.0, d * w - a * x - b * y - c * z)
    return work + float(0.5 * (before.moment + end.moment) @ turn)
