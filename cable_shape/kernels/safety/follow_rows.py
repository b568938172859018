"""One cable along many instants of a motion: the compiled inner loop of a study.

Every instant starts from the two before it, as a predictor's do, for as long as one warm solve on the mesh at hand is
all that is needed; the first one that needs more is left to :mod:`cable_shape.solve.search`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.bounds import closest_points
from cable_shape.kernels.network.drive import (
    I_DOUBT,
    I_ENERGY,
    I_ESTIMATE,
    I_TURN,
    LARGEST_TURN,
    energy_of_masses,
    solve,
)
from cable_shape.kernels.network.mesh import TURN_AIM
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS
from cable_shape.kernels.network.respond import softest_mode
from cable_shape.kernels.network.tables import TRIAL, Floats, Whole, copy_rows, solution_of
from cable_shape.kernels.safety import loads_used as margins

#: As of a predictor's warm solve, see `solve.search`.
MOST_ITERATIONS, FARTHEST = 25, 0.7
#: Inverse iterations for the softest mode of the first shape on a mesh, near a snap, and else; mu from which none is.
STEPS_AT_FIRST, STEPS_NEAR, STEPS = 60, 4, 1
NEAR = 1.0


class Judged(NamedTuple):
    """What a shape is judged by."""

    pieces: Floats  # see `margins`
    warn: float  # [m]
    soft: float  # [N], unit of eigenvalues
    held: bool  # grips hold both ends
    masses: Floats  # (j, 4) arc length [m] and weight [N] of each
    radius: float  # [m], of the cable
    horizon: float  # [m], bodies further away are not told
    exclusion: float  # [m] of arc length next to grips, see `bounds`
    bodies: Floats  # see `bounds`
    triangles: Floats
    nodes: Floats


class Instants(NamedTuple):
    """Where everything is; m instants."""

    knots: Floats  # (k, 7) poses of the supports, those between the ends as they stay
    starts: Floats  # (m, 7)
    ends: Floats  # (m, 7)
    links: Floats  # (m, l, 7)
    tolerance: float  # [m]
    fine: float  # error [m] below which the mesh is too fine; 0: it cannot be coarser


class Found(NamedTuple):
    """What is found of each instant, in the same row of these."""

    buffers: Floats  # (m, 17 points)
    infos: Floats  # (m, 22) see `drive`
    loads: Floats  # (m, knots, 7) see `drive.knot_loads`; (m, 0, 7): not asked
    tables: Floats  # (m, bodies, 8) see `bounds`
    margins: Floats  # (m, 6 + bodies, 5) see `margins`


@kernel(nogil=True)
def follow_rows(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, instants: Instants, judged: Judged, found: Found,
    mode: Floats, memory: Floats, first: int, history: int,
) -> int:  # fmt: skip
    """Solves the instants from `first` on, and returns the first one that needs more than one warm solve, or m.

    history: how many solutions there are to start from, 1 or 2. mode (nodes, 3) and memory: of the stability of the
    instant before, see `margins`.
    """
    points = found.buffers.shape[1] // 17
    nothing = np.empty(0)
    last = instants.knots.shape[0] - 1
    for i in range(first, instants.starts.shape[0]):
        pose = solution_of(ints, sols, TRIAL).pose
        copy_rows(pose, instants.knots, 7)
        for c in range(7):
            pose[0, c], pose[last, c] = instants.starts[i, c], instants.ends[i, c]
        info = found.infos[i]
        code = solve(
            ints, floats, sols, space, found.buffers[i], info, found.loads[i], points, history, False, False, True,
            MOST_ITERATIONS, FARTHEST,
        )  # fmt: skip
        if code != CONVERGED:
            return i
        fine = info[I_ESTIMATE] + info[I_DOUBT] < instants.fine and info[I_TURN] < 0.5 * TURN_AIM
        if info[I_EXCESS] != 0.0 or not info[I_ESTIMATE] <= instants.tolerance or info[I_TURN] > LARGEST_TURN or fine:
            return i
        history = 2
        info[I_ENERGY] += energy_of_masses(ints, floats, space, judged.masses)
        judge(found.buffers[i], points, judged, instants.links[i], found.tables[i], found.margins[i])
        near = not memory[0] > NEAR
        tell_stability(
            ints, floats, sols, space, nothing, judged.soft, mode, STEPS_NEAR if near else STEPS, near, memory,
            found.margins[i],
        )  # fmt: skip
    return instants.starts.shape[0]


@kernel(nogil=True)
def judge(buffer: Floats, points: int, judged: Judged, links: Floats, table: Floats, rows: Floats) -> None:
    """Fills table (m, 8) and rows (6 + m, 5) for a shape's buffer, all but its stability; links (l, 7)."""
    margins.measure_loads(buffer, points, judged.pieces, judged.held, True, rows)
    rows[margins.STABILITY, :] = math.nan
    if judged.bodies.shape[0] > 0:
        positions, arcs = buffer[points : 4 * points].reshape(points, 3), buffer[:points]
        closest_points(
            positions, arcs, judged.radius, judged.horizon, judged.exclusion, True, judged.bodies, links,
            judged.triangles, judged.nodes, table, np.empty(2, np.int64),
        )  # fmt: skip
    margins.measure_bodies(table, judged.warn, rows)


@kernel
def tell_stability(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, run: Floats, soft: float, mode: Floats, steps: int,
    fresh: bool, memory: Floats, rows: Floats,
) -> None:  # fmt: skip
    """Fills the row STABILITY of the solution now; improves mode (nodes, 3)."""
    eigen = np.empty(2)
    softest_mode(ints, floats, sols, space, run, mode, steps, fresh, eigen)
    margins.remember((eigen[0], eigen[1]), soft, memory)
    margins.tell_stability(False, memory, rows)
