"""Many shapes of one cable from shapes beside them: the compiled inner loop of a batch.

Every row starts from the shape at the centre of its own cell, moved to first order as its ends differ, so that no row
depends on another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.distance.bounds import closest_points
from cable_shape.kernels.distance.swollen import closest_points as swell
from cable_shape.kernels.network.beside import Told, aim, cell_shape, lean, take_trial
from cable_shape.kernels.network.drive import (
    FAR,
    I_DOUBT,
    I_ENERGY,
    I_ESTIMATE,
    I_TURN,
    LARGEST_TURN,
    energy_of_masses,
    solve,
)
from cable_shape.kernels.network.mesh import neighbours
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS
from cable_shape.kernels.network.respond import softest_mode
from cable_shape.kernels.network.tables import Floats, Whole
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.kernels.safety.batch_spread import Known, tube

COARSE = 7  # the error is above its tolerance, or an element turns too far
FARTHEST = 0.7  # rad, a frame's largest turn from its prediction: further away is another branch
LOST = 8  # the centre of the row's cell was not reached
MOST_ITERATIONS = 25
MODE_STEPS, MODE_STEPS_OF_CELL = 2, 6  # inverse iterations from the mode of the shape beside, and from none


class Rows(NamedTuple):
    """Which grasps are asked for."""

    rows: Whole  # (r,) of starts and ends, rows of one cell side by side
    cells: Whole  # (r, d) where they lie
    starts: Floats  # (k, 7)
    ends: Floats  # (k, 7)


class Judged(NamedTuple):
    """What a shape is judged by."""

    pieces: Floats  # see `margins`
    warn: float  # [m]
    soft: float  # [N], unit of eigenvalues
    held: bool  # grips hold both ends
    masses: Floats  # (j, 4) arc length [m] and weight [N] of each
    radius: float  # [m], of the cable
    horizon: float  # [m], bodies further away are not told
    bodies: Floats  # see `bounds`
    triangles: Floats
    nodes: Floats


class Found(NamedTuple):
    """What is found of each row, in the same row of these."""

    buffers: Floats  # (k, 17 points)
    infos: Floats  # (k, 22) see `drive`, the energy with that of the masses
    loads: Floats  # (k, knots, 7) see `drive.knot_loads`; (k, 0, 7): not asked
    tables: Floats  # (k, bodies, 8) see `bounds`
    margins: Floats  # (k, 6 + bodies, 5) see `margins`
    radii: Floats  # (k, points) [m] of each row's tube; (k, 0): there is none


@kernel(nogil=True)
def solve_rows(asked: Rows, told: Told, judged: Judged, known: Known, points: int, found: Found, codes: Whole) -> None:
    """Solves the rows asked for; a code, of codes (r,), that is not CONVERGED leaves the row to another solver."""
    knots = told.poses.shape[0]
    poses, twists, nothing = np.empty((knots, 7)), np.empty((knots, 6)), np.empty(0)
    info = np.zeros(found.infos.shape[1])
    memory, eigen = np.empty(margins.MEMORY), np.empty(2)
    wanted = found.radii.shape[1] > 0
    steps = known.steps.shape[0]
    moves, shifts = np.empty((found.radii.shape[1], 3, 12)), np.empty((found.radii.shape[1], 3, steps))
    models = np.empty((0, 0))
    begun, met, own_ints, own_floats, own_sols, own_space = False, False, told.bare, told.held, nothing, nothing
    row_sols, row_space = nothing, nothing
    mode, own_mode = np.empty((0, 3)), np.empty((0, 3))
    for i in range(asked.rows.shape[0]):
        row = asked.rows[i]
        if not begun or (asked.cells[i] != asked.cells[i - 1]).any():
            met, own_ints, own_floats, own_sols, own_space = cell_shape(told, asked.cells[i], nothing, info)
            if met:
                row_sols, row_space = np.zeros_like(own_sols), own_space.copy()
                own_mode = np.zeros((own_ints[0] + own_ints[1], 3))
                softest_mode(
                    own_ints, own_floats, own_sols, own_space, nothing, own_mode, MODE_STEPS_OF_CELL, False, eigen
                )
                mode = own_mode.copy()
                if wanted:
                    models = neighbours(told.bare, known.models, own_ints, own_floats, known.before, known.after)
        begun = True
        if not met:
            codes[i] = LOST
            continue
        if not aim(own_ints, own_sols, asked.starts[row], asked.ends[row], poses):
            codes[i] = FAR
            continue
        lean(own_ints, own_floats, own_sols, own_space, poses, twists)
        take_trial(own_ints, own_sols, row_sols)
        buffer, told_of = found.buffers[row], found.infos[row]
        code = solve(
            own_ints, own_floats, row_sols, row_space, buffer, told_of, found.loads[row], points, 0, True, False, True,
            MOST_ITERATIONS, FARTHEST,
        )  # fmt: skip
        error = told_of[I_ESTIMATE] + told_of[I_DOUBT]
        if code == CONVERGED and not (error <= told.tolerance and told_of[I_TURN] <= LARGEST_TURN):
            code = COARSE
        elif code == CONVERGED and told_of[I_EXCESS] != 0.0:
            code = FAR
        codes[i] = code
        if code != CONVERGED:
            continue
        told_of[I_ENERGY] += energy_of_masses(own_ints, own_floats, row_space, judged.masses)
        rows = found.margins[row]
        margins.measure_loads(buffer, points, judged.pieces, judged.held, True, rows)
        rows[margins.STABILITY, :] = np.nan
        mode[:, :] = own_mode
        memory[0], memory[1], memory[2] = np.nan, 0.0, 0.0
        softest_mode(own_ints, own_floats, row_sols, row_space, nothing, mode, MODE_STEPS, False, eigen)
        margins.remember((eigen[0], eigen[1]), judged.soft, memory)
        margins.tell_stability(False, memory, rows)
        if wanted:  # last: it refreshes the factors
            tube(own_ints, own_floats, row_sols, row_space, buffer, points, known, models, moves, shifts,
                 found.radii[row])  # fmt: skip
        if judged.bodies.shape[0] > 0:
            measure_clearance(judged, buffer, points, found.radii[row], found.tables[row])
        margins.measure_bodies(found.tables[row], judged.warn, rows)


@kernel
def measure_clearance(judged: Judged, buffer: Floats, points: int, radius: Floats, table: Floats) -> None:
    """Fills table (m, 8) for a shape's buffer; radius (points,) [m]: of its tube, empty: none."""
    links, counts = np.empty((0, 7)), np.empty(2, np.int64)
    positions, arcs = buffer[points : 4 * points].reshape(points, 3), buffer[:points]
    wide = radius.max() if radius.shape[0] > 0 else 0.0
    closest_points(
        positions, arcs, judged.radius, judged.horizon + wide, 0.0, True, judged.bodies, links, judged.triangles,
        judged.nodes, table, counts,
    )  # fmt: skip
    if radius.shape[0] > 0:
        swell(
            positions, arcs, judged.radius, radius, 0.0, judged.bodies, links, judged.triangles, judged.nodes, table
        )  # fmt: skip
        for m in range(judged.bodies.shape[0]):
            if table[m, 0] > judged.horizon:
                table[m, 0] = np.inf
