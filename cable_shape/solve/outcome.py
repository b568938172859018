"""What is told where there is no shape: straight lines between the supports, and what is too far apart."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.frames import align, straight
from cable_shape.kernels.network.drive import STRAIGHT
from cable_shape.kernels.rod_guess import tangent
from cable_shape.pose import FreeEnd
from cable_shape.shape import CableShape, Status
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

MODEL = "cosserat"
#: Of the moment on a free end: a twisting moment that a start must hold and cannot, if it is larger.
_UNHELD = 1e-6


def chords_of(state: Network, poses: Array) -> Array:
    """(f,) [m]: distances of neighbouring supports, without a free end."""
    return np.asarray(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)[: state.forces])


def no_room(problem: Problem, state: Network, poses: Array) -> tuple[Status, Array, str, float] | None:
    """Why there is no equilibrium at all: status, poses, what to say, the length that is missing [m]; None if there may
    be one."""
    if state.forces == 0 or state.stretch != 0.0:
        return None
    if state.spans == 1:
        room = math.dist(poses[0, :3].tolist(), poses[1, :3].tolist()) < STRAIGHT * state.length
        if room:
            return None
    chords, arcs = chords_of(state, poses), state.arcs
    holding = [j for j in range(state.spans + 1) if j not in state.rings]
    for a, b in pairwise(holding):
        if b > state.forces:
            continue
        path, length = float(chords[a:b].sum()), float(arcs[b] - arcs[a])
        if path < STRAIGHT * length:
            continue
        if state.spans == 1:
            detail = f"the ends are {path - length:.3g} m further apart than the cable is long ({length:g} m). "
        else:
            through = " through the eyelets between them" if b - a > 1 else ""
            detail = (
                f"{_name(a, state.spans)} and {_name(b, state.spans)} are {path:.4g} m apart{through}, "
                f"{path - length:.3g} m more than the cable between them is long ({length:.4g} m). Bring them "
                "closer, or let a clip hold another point of the cable; the shape is straight lines."
            )
        return Status.OVERSTRETCHED, poses, detail, max(path - length, 0.0)
    return None


def unheld_roll(problem: Problem, state: Network, buffer: Array, error: float) -> str:
    """A moment about the tangent of a start that does not hold its roll, in words; empty if there is none.

    Where nothing holds the roll of a round straight cable it is held at the start, for want of an equation; a dead
    moment on the free end that twists the cable there then has no counterpart. error [N m]: of the shape's moments.
    """
    end, n = problem.end, problem.points
    if not (state.rolls and isinstance(end, FreeEnd)):
        return ""
    moment = buffer[14 * n : 14 * n + 3]
    twisting = float(moment @ np.array(tangent(tuple(buffer[4 * n : 4 * n + 4].tolist()))))
    if abs(twisting) <= 10.0 * error + _UNHELD * float(np.linalg.norm(end.moment)):
        return ""
    return (
        f"nothing holds the twisting moment of {twisting:.3g} N m at the start, which is {problem.start.kind!r}: the "
        "cable would spin. Clamp the start, or leave the moment on the free end out. "
    )


def straight_lines(
    problem: Problem, state: Network, buffer: Array, poses: Array, status: Status, detail: str
) -> CableShape:
    """Straight lines between the supports, for want of a shape; `buffer` becomes its own."""
    n, arcs = problem.points, state.arcs
    far = poses[-1] if state.forces == state.spans else poses[0]
    roll = straight(poses[0], far, problem.cable.length, n, buffer)
    shape = CableShape(
        buffer,
        n,
        length=problem.cable.length,
        model=MODEL,
        status=status,
        detail=detail,
        error_estimate=math.inf,
        residual=math.inf,
        roll_error=float(roll),
        force_error=math.inf,
        moment_error=math.inf,
    )
    if state.spans == 1:
        return shape
    corners = poses[:, :3].copy()
    if state.forces < state.spans:  # a free end has no place
        corners[-1] = corners[-2]
    s, q = buffer[:n], poses[0, 3:].copy()
    positions, quaternions = buffer[n : 4 * n].reshape(n, 3), buffer[4 * n : 8 * n].reshape(n, 4)
    for j in range(state.spans):
        inside = (s >= arcs[j]) & (s <= arcs[j + 1])
        step = corners[j + 1] - corners[j]
        chord = float(np.linalg.norm(step))
        if chord > 0.0:
            align(q, *(step / chord))
        positions[inside] = corners[j] + np.outer((s[inside] - arcs[j]) / (arcs[j + 1] - arcs[j]), step)
        quaternions[inside] = q
    return shape


def _name(support: int, spans: int) -> str:
    """What a support is called in the scene."""
    return "the start grip" if support == 0 else "the end grip" if support == spans else f"clips[{support - 1}]"
