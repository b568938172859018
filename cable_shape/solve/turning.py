"""How the frames of the last solution turn with what holds the cable: :func:`turning`, beside `answers.sensitivity`."""

from __future__ import annotations

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import tables
from cable_shape.kernels.network.turning import turns
from cable_shape.pose import FreeEnd, Grip
from cable_shape.solve.answers import Solved, about_gripper


def turning(state: Solved, arc_length: float, *, at: str = "cable", by_clips: bool = False) -> Array:
    """(3, 12): how the cable frame at an arc length [m] turns, in its own axes, with the poses of start and end.

    by_clips: after them come six columns for each clip on a robot link.

    Columns as those of `sensitivity`; those of a free end are zero. Exact at the nodes, a cubic through the
    nearest ones between them.

    Raises
    ------
    ArgumentError
        In eyelets, through which the cable would run on, and of cables that touch each other.
    """
    problem = state.problem
    ints = state.ints
    if len(state.rings) or ints[tables.N_CABLES] != 1:
        what = "clips of kind 'slide'" if len(state.rings) else "cables that touch each other"
        raise ArgumentError.of("arc_length", arc_length, f"how frames turn is not known with {what}", "Leave them out.")
    state.refresh()
    clips = [i for i, clip in enumerate(problem.clips, 1) if by_clips and clip.link is not None]
    knots = state.knots_of([0, 1 + len(problem.clips), *clips])
    out = np.empty((6 * len(knots), state.network_nodes, 3))
    turns(ints, state.floats, state.sols, state.work, knots, out)
    places, rows = np.unique(tables.model_of.py_func(ints, state.floats).s, return_index=True)
    first = min(max(int(np.searchsorted(places, arc_length)) - 2, 0), max(len(places) - 4, 0))
    near = slice(first, first + 4)
    block = np.tensordot(_weights(places[near], arc_length), out[:, rows[near]], (0, 1)).T
    for k, end in enumerate((problem.start, problem.end)):
        columns = block[None, :, 6 * k : 6 * k + 6]
        if isinstance(end, FreeEnd):
            columns[:] = 0.0
        elif at == "gripper":
            assert isinstance(end, Grip)
            about_gripper(end, columns)
    return block


def _weights(places: Array, at: float) -> Array:
    """Lagrange's, of values at these places."""
    apart = np.where(np.eye(len(places), dtype=bool), 1.0, places[:, None] - places[None, :])
    return np.array([np.prod(np.delete(at - places, i) / np.delete(row, i)) for i, row in enumerate(apart)])
