"""Many shapes of one cable from one solved shape beside them: the compiled inner loop of a batch.

Every row starts from the same solution, moved to first order as its ends differ, so that no row depends on another.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels import margins, rod_drive
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.batch_lean import WIDTH, aim, lean
from cable_shape.kernels.batch_newton import solve_beside
from cable_shape.kernels.batch_start import start_at
from cable_shape.kernels.batch_tube import LENGTHS, STEPS, TABLES, tube
from cable_shape.kernels.bounds import closest_points
from cable_shape.kernels.rod_answer import neighbours
from cable_shape.kernels.rod_drive import ESTIMATE, EXCESS, FAR, TURN, slot_size
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.kernels.rod_work import work_size
from cable_shape.kernels.swollen import closest_points as swell

Array = Any
COARSE = 7  # the error is above its tolerance, or an element turns too far
FARTHEST = 0.7  # rad, a frame's largest turn from its prediction: further away is another branch
LOST = 8  # the centre of the row's cell was not reached
MODE_STEPS = 2  # inverse iterations from the mode of the shape beside


@kernel(nogil=True)
def solve_rows(
    rows: Array, cells: Array, reach: float, turn: float, longest: float, starts: Array, ends: Array, par: Array,
    mesh: Array, sol: Array, work: Array, elements: int, mode: Array, estimate: float, loads: tuple[Array, ...],
    points: int, tolerance: float, soft: float,
    section: Array, limits: Array, radius: float, horizon: float, bodies: Array, triangles: Array, nodes: Array,
    masses: Array, known: tuple[Array, ...], buffers: Array, infos: Array, codes: Array, tables: Array,
    margin_rows: Array, radii: Array,
) -> None:  # fmt: skip
    """Solves the `rows` (r,) of starts and ends (k, 7), which lie in `cells` (r, 9), equal ones side by side.

    First the centre of each cell is solved for from the solution now in `sol` and its factors in `work`, on a mesh of
    its own, then the rows from there; see `batch_start.start_at` for mesh, mode, estimate and loads. What is found of
    a row is put into the same row of buffers (k, 17 points), infos (k, 18) (see `rod_drive`, the energy with that of
    the masses), tables (k, m, 8) (see `bounds`) and margin_rows (k, 6 + m, 5) (see `margins`). A code, of codes (r,),
    that is not CONVERGED leaves the row to another solver. masses (j, 4): arc length [m] and weight [N] of each.
    known: see `batch_tube.tube`; radii (k, points) [m] takes the radius of each row's tube, by which the cable then is
    thicker for the bodies; (k, 0): there are none.
    """
    far_work = work.copy()
    target = np.empty(15)
    links = np.empty((0, 7))
    counts = np.empty(2, np.int64)
    memory = np.empty(margins.MEMORY)
    wanted = radii.shape[1] > 0
    moves, shifts = np.empty((radii.shape[1], 3, 12)), np.empty((radii.shape[1], 3, known[STEPS].shape[0]))
    beside, swing = np.empty((0, 0)), np.empty((0, 3))
    met, own, own_mesh, near, factors, own_mode = False, elements, mesh, sol, far_work, mode
    size = slot_size(own)
    trial, own_work, row_mode = np.zeros(3 * size), np.zeros(work_size(own, WIDTH)), mode.copy()
    for i in range(rows.shape[0]):
        row = rows[i]
        buffer, info = buffers[row], infos[row]
        if i == 0 or (cells[i] != cells[i - 1]).any():
            met, own, own_mesh, near, factors, own_mode = start_at(
                cells[i], reach, turn, longest, par, mesh, sol, far_work, elements, mode, estimate, tolerance, loads,
                info,
            )  # fmt: skip
            size = slot_size(own)
            trial, own_work, row_mode = np.zeros(3 * size), np.zeros(work_size(own, WIDTH)), own_mode.copy()
            if met and wanted:
                beside = neighbours(
                    own_mesh, own, known[LENGTHS], known[TABLES], loads[1], loads[2], loads[3], swing, 0.0
                )
        if not met:
            codes[i] = LOST
            continue
        if not aim(starts[row], ends[row], near[size - 15 : size], target):
            codes[i] = FAR
            continue
        lean(near, factors, own, target, trial)
        code = solve_beside(par, own_mesh, trial, factors, own_work, buffer, info, own, points, tolerance, FARTHEST)
        if code == CONVERGED and not (info[ESTIMATE] <= tolerance and info[TURN] <= rod_drive.LARGEST_TURN):
            code = COARSE
        elif code == CONVERGED and info[EXCESS] != 0.0:
            code = FAR
        codes[i] = code
        if code != CONVERGED:
            continue
        info[rod_drive.ENERGY] += energy_of_masses(masses, own_mesh, own_work, own, target)
        found = margin_rows[row]
        margins.measure_loads(buffer, points, section, limits, True, True, found)
        found[margins.STABILITY, :] = np.nan
        row_mode[:, :] = own_mode
        memory[0], memory[1], memory[2] = np.nan, 0.0, 0.0
        margins.measure_stability(
            par, own_mesh, trial, own_work, own, WIDTH, row_mode, MODE_STEPS, False, soft, False, False, memory,
            found,
        )  # fmt: skip
        if wanted:  # last: it refreshes the factors
            tube(
                par, own_mesh, trial, own_work, own, WIDTH, buffer, points, known, beside, moves, shifts, radii[row]
            )  # fmt: skip
        if bodies.shape[0] > 0:
            positions = buffer[points : 4 * points].reshape(points, 3)
            reach_now = horizon + (radii[row].max() if wanted else 0.0)
            closest_points(
                positions, buffer[:points], radius, reach_now, 0.0, True, bodies, links, triangles, nodes,
                tables[row], counts,
            )  # fmt: skip
            if wanted:
                swell(
                    positions, buffer[:points], radius, radii[row], 0.0, bodies, links, triangles, nodes, tables[row]
                )  # fmt: skip
                for m in range(bodies.shape[0]):
                    if tables[row, m, 0] > horizon:
                        tables[row, m, 0] = np.inf
        margins.measure_bodies(tables[row], limits[5], found)


@kernel
def energy_of_masses(masses: Array, mesh: Array, work: Array, elements: int, ends: Array) -> float:
    """[J], potential energy of point masses (j, 4) of the solution that has just been found."""
    energy = 0.0
    if masses.shape[0] == 0:
        return energy
    steps = rod_drive.steps(work, elements, WIDTH)
    for j in range(masses.shape[0]):
        x, y, z = ends[0], ends[1], ends[2]
        for k in range(elements):
            if 0.5 * (mesh[k] + mesh[k + 1]) > masses[j, 0]:
                break
            x, y, z = x - steps[k, 0], y - steps[k, 1], z - steps[k, 2]
        energy -= masses[j, 1] * x + masses[j, 2] * y + masses[j, 3] * z
    return energy
