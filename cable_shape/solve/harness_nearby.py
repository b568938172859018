"""The shape of a harness almost alike, from the factors of the last solution; of a cable: :mod:`.nearby`."""

from __future__ import annotations

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import drive, mesh, tables
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.nearby import correct, first_order
from cable_shape.solve.rod_common import MODEL


def nearby(state: HarnessNetwork, problem: HarnessProblem) -> HarnessShape | None:
    """The shape that `problem` has to first order beside the last solution of `state`, which touches nothing.

    state: with a solution, freshly factored by `refresh`; it stays as it is. None where the network of the problem is
    another one, or its segments meet in other frames.
    """
    other = HarnessNetwork(problem)
    poses = other.aim()
    arcs = _arcs(state, other)
    if arcs is None:
        return None
    floats = state.floats.copy()
    nodes = floats[tables.PAR : tables.PAR + state.nodes.size]
    for (a, b), (low, high), (begin, end) in zip(state.runs, state.arcs_now(), arcs, strict=True):
        nodes[a : b + 1] = begin + (state.nodes[a : b + 1] - low) / (high - low) * (end - begin)
    mesh.take_over(state.bare, other.held, state.ints, floats)
    floats[: tables.PAR] = state.floats[: tables.PAR]
    given = [k for k, knot in enumerate(state.structure.knots) if not knot.moves]
    run = first_order(state, other, floats, poses, given)
    return _told(other, run)


def _arcs(state: HarnessNetwork, other: HarnessNetwork) -> Array | None:
    """(m, 2) [m]: where the spans of the other harness begin and end."""
    own, its = state.layout, other.layout
    if its.structure != own.structure or not np.array_equal(its.frames, own.frames):
        return None
    if [name[0] for name in its.knots] != [name[0] for name in own.knots]:
        return None
    arcs, now = its.arcs.copy(), state.arcs_now()
    for _, j in own.rings:  # what is in an eyelet is found
        arcs[j, 1] = arcs[j + 1, 0] = now[j, 1]
    return arcs


def _told(state: HarnessNetwork, run: Array) -> HarnessShape:
    """The shape of the solution now, as `drive.solve` tells it."""
    problem = state.problem
    out = np.empty(NUMBERS_PER_POINT * problem.points * state.cables)
    info, loads = np.zeros(drive.INFO + 3 * state.cables), np.zeros((len(state.layout.knots), 7))
    correct(state, run, problem.points, out, info, loads)
    told = info[drive.INFO :]
    shape = HarnessShape(
        problem.harness,
        out,
        problem.points,
        model=MODEL,
        status=Status.OK,
        energy=float(info[drive.I_ENERGY]) + state.energy_of_masses(),
        energies=told[2 * state.cables :],
        twists=told[: 2 * state.cables : 2],
        clips=loads[state.clip_rows] if state.clip_rows else None,
        clips_of=problem.clips,
    )
    shape.weigh_sections(problem.gravity)
    return shape
