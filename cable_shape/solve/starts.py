"""Where a search from nothing starts: guesses, a straight cable, a stiffer one.

Each returns whether it has left an equilibrium as the network's last solution.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.frames import align
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.pose import rotate
from cable_shape.solve.network import Network
from cable_shape.solve.problem import NAMED_TOLERANCE

#: Iterations of a solve from a guess.
COLD_ITERATIONS = 80
#: Chord / length of the straight cable from which a shape in clips is approached.
_SLACK = 0.97
#: So many times as stiff are cables from which next to limp ones are softened, and by this factor in one step.
_STIFFER, _SOFTENING = (8.0, 64.0, 512.0, 4096.0), 2.0
#: Guesses (kind, tilt of the handles) for a cable that is stiffened.
_HANGS, _CURVED = (HANGING, 0.0), (CURVED, 0.3)


class Searching(Protocol):
    """What is asked of a :class:`cable_shape.solve.search.Search` here."""

    softened: bool

    @property
    def state(self) -> Network: ...

    def call(self, history: int, most: int, guard: bool = True) -> bool: ...

    def refine(self) -> bool: ...

    def follow(self, poses: Array, *, snaps: bool) -> bool: ...

    def out_of_time(self) -> bool: ...


def guessed(search: Searching, poses: Array, fineness: float, wound: float, guard: bool = True) -> bool:
    """Tries the guesses, the likeliest first, on meshes so many times as fine as usual."""
    state = search.state
    for kind, sag in state.guesses(poses):
        state.first_mesh(poses, fineness)
        state.start_from(poses, kind, sag, wound)
        if search.call(0, COLD_ITERATIONS, guard=guard):
            return True
        if search.out_of_time():
            return False
    return False


def approached(search: Searching, poses: Array) -> bool:
    """Starts from a straight cable and goes to `poses` in small steps: for supports that no guess suits."""
    state = search.state
    span = poses[state.forces, :3] - poses[0, :3]
    chord = float(np.linalg.norm(span))
    along = span / chord if chord > 0.1 * state.length else rotate(poses[0, 3:], np.array((0.0, 0.0, 1.0)))
    origin = poses.copy()
    for j in range(state.spans + 1):
        origin[j, :3] = poses[0, :3] + _SLACK * state.arcs[j] * along
        align(origin[j, 3:], *along)
    if not guessed(search, origin, 2.0, 0.0):  # it has to do for all of the way
        return False
    state.history = 1
    return search.follow(poses, snaps=True)


def softened(search: Searching, poses: Array) -> bool:
    """From the shape of a stiffer cable, asked once: what is next to limp bends too sharply for any guess."""
    state = search.state
    if search.softened or state.forces == 0 or state.spans > 1:
        return False
    search.softened = True
    tolerance = state.tolerance
    state.tolerance = min(tolerance, NAMED_TOLERANCE * state.length)
    try:
        stiffer = next((f for f in _STIFFER if _as_stiff(search, f, poses)), 1.0)
        while stiffer > 1.0:
            stiffer = max(1.0, stiffer / _SOFTENING)
            state.stiffen(stiffer)
            state.history = 1
            state.unsettle()
            state.target[...] = poses
            if search.out_of_time() or not search.call(1, COLD_ITERATIONS) or not search.refine():
                return False
        return stiffer == 1.0 and state.history > 0
    finally:
        state.stiffen(1.0)
        state.tolerance, state.history = tolerance, 0


def _as_stiff(search: Searching, factor: float, poses: Array) -> bool:
    """Whether a cable so many times as stiff has a stable shape that a guess leads to."""
    state = search.state
    state.stiffen(factor)
    turns = state.turns
    for kind, sag in (_HANGS, _CURVED):
        state.first_mesh(poses)
        state.start_from(poses, kind, sag, turns)
        if search.call(0, COLD_ITERATIONS) and search.refine():
            state.history = 1
            return True
    return False
