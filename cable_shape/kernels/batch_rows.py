"""Many shapes of one cable from one solved shape beside them: the compiled inner loop of a batch.

Every row starts from the same solution, moved to first order as its ends differ, so that no row depends on another.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.kernels import margins, rod_drive
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.batch_cells import grasp
from cable_shape.kernels.bounds import closest_points
from cable_shape.kernels.rod_algebra import (
    Quaternion,
    Vector,
    add,
    apply,
    get3,
    get4,
    get9,
    inlined,
    put3,
    qconj,
    qexp,
    qlog,
    qmul,
    qnormal,
    tapply,
)
from cable_shape.kernels.rod_drive import ESTIMATE, EXCESS, FAR, NOW, TRIAL, TURN, slot, slot_size
from cable_shape.kernels.rod_factor import backward, border, forward
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.kernels.rod_work import matrices, vectors, work_size

Array = Any
WIDTH = 4  # of the border: both ends are held
COARSE = 7  # the error is above its tolerance, or an element turns too far
MOST_ITERATIONS = 25
FARTHEST = 0.7  # rad, a frame's largest turn from its prediction: further away is another branch
ANYWHERE = 7.0  # rad, a cell's centre may be on any branch
MODE_STEPS = 2  # inverse iterations from the mode of the shape beside


@kernel
def aim(start: Array, end: Array, near: Array, ends: Array) -> bool:
    """Fills ends (15,) with both poses (7,), canonically wound, quaternion signs next to those of `near` (15,).

    False: the end is turned against the start by so much more or less that it is another winding there.
    """
    ends[:7], ends[7:14], ends[14] = start, end, 0.0
    relative = own = other = 0.0
    for i in range(3, 7):
        relative += ends[i] * ends[7 + i]
        own += ends[i] * near[i]
    a = 1.0 if own >= 0.0 else -1.0
    b = a if relative >= 0.0 else -a
    for i in range(3, 7):
        ends[i] *= a
        ends[7 + i] *= b
        other += ends[7 + i] * near[7 + i]
    return other > 0.0


@inlined
def shortest(p: Quaternion, q: Quaternion) -> Vector:
    """The rotation vector that turns the frame p into q, in the frame p, of at most half a turn."""
    turn = qmul(qconj(p), q)
    return qlog(turn) if turn[3] >= 0.0 else qlog((-turn[0], -turn[1], -turn[2], -turn[3]))


@kernel
def lean(sol: Array, work: Array, elements: int, ends: Array, trial: Array) -> None:
    """Fills the trial of `trial`: the solution now of `sol`, both ends clamped, leaning to first order to `ends`.

    work: with fresh factors of that solution.
    """
    q0, lam0, old = slot(sol, elements, NOW)
    q, lam, new = slot(trial, elements, TRIAL)
    new[:] = ends
    _, U, _, P, Y, W = matrices(work, elements, WIDTH)
    parts, _, G, d, gram, total, step = vectors(work, elements, WIDTH)
    first = shortest(get4(q0, 0), (ends[3], ends[4], ends[5], ends[6]))
    last = shortest(get4(q0, elements), (ends[10], ends[11], ends[12], ends[13]))
    G[:, :] = 0.0
    put3(G, 1, 0, tapply(get9(U, 0, 0), first))
    put3(G, elements - 1, 0, add(get3(G, elements - 1), apply(get9(U, elements - 1, 0), last)))
    closure = np.empty(3)
    a, b = tapply(get9(parts, 0, 9), first), tapply(get9(parts, elements - 1, 18), last)
    closure[0], closure[1], closure[2] = add(a, b)
    for i in range(3):
        closure[i] += (ends[7 + i] - ends[i]) - (old[7 + i] - old[i])
    forward(G, P, Y, W, gram)
    border(gram, total[3:], closure, step)
    backward(P, Y, W, step, d)
    put3(d, 0, 0, first)
    put3(d, elements, 0, last)
    for k in range(elements + 1):
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = qnormal(qmul(get4(q0, k), qexp(get3(d, k))))
    for i in range(3):
        lam[i] = lam0[i] + step[i]
    q[0, 0], q[0, 1], q[0, 2], q[0, 3] = ends[3], ends[4], ends[5], ends[6]
    for i in range(4):
        q[elements, i] = ends[10 + i]


@kernel
def approach(
    key: Array, reach: float, turn: float, longest: float, par: Array, mesh: Array, sol: Array, work: Array,
    elements: int, found: Array, own_work: Array, info: Array,
) -> bool:  # fmt: skip
    """Solves for the centre of the cell `key` from the solution now in `sol`: into `found` and `own_work`."""
    size = slot_size(elements)
    start, end, target, nothing = np.empty(7), np.empty(7), np.empty(15), np.empty(0)
    grasp(key, reach, turn, longest, start, end)
    if not aim(start, end, sol[size - 15 : size], target):
        return False
    lean(sol, work, elements, target, found)
    code = rod_drive.solve(
        par, mesh, found, own_work, nothing, info, elements, WIDTH, 0, 0, True, MOST_ITERATIONS, ANYWHERE
    )
    return code == CONVERGED and info[EXCESS] == 0.0


@kernel(nogil=True)
def solve_rows(
    rows: Array, cells: Array, reach: float, turn: float, longest: float, starts: Array, ends: Array, par: Array,
    mesh: Array, sol: Array, work: Array, elements: int, points: int, tolerance: float, mode: Array, soft: float,
    section: Array, limits: Array, radius: float, horizon: float, bodies: Array, triangles: Array, nodes: Array,
    masses: Array, buffers: Array, infos: Array, codes: Array, tables: Array, margin_rows: Array,
) -> None:  # fmt: skip
    """Solves the `rows` (r,) of starts and ends (k, 7), which lie in `cells` (r, 9), equal ones side by side.

    First the centre of each cell is solved for from the solution now in `sol` and its factors in `work`, then the rows
    from there. What is found of a row is put into the same row of buffers (k, 17 points), infos (k, 18) (see
    `rod_drive`, the energy with that of the masses), tables (k, m, 8) (see `bounds`) and margin_rows (k, 6 + m, 5) (see
    `margins`). A code, of codes (r,), that is not CONVERGED leaves the row to another solver. mode (N+1, 3): the
    softest one of `sol`; masses (j, 4): arc length [m] and weight [N] of each.
    """
    size, room = slot_size(elements), work_size(elements, WIDTH)
    own_mesh, own_mode = mesh.copy(), mode.copy()
    far, far_work = sol.copy(), work.copy()
    beside, beside_work = np.empty(3 * size), np.zeros(room)
    trial, own_work = np.zeros(3 * size), np.zeros(room)
    target = np.empty(15)
    links = np.empty((0, 7))
    counts = np.empty(2, np.int64)
    memory = np.empty(margins.MEMORY)
    met = False
    for i in range(rows.shape[0]):
        row = rows[i]
        buffer, info = buffers[row], infos[row]
        if i == 0 or (cells[i] != cells[i - 1]).any():
            beside[:] = far
            met = approach(
                cells[i], reach, turn, longest, par, own_mesh, far, far_work, elements, beside, beside_work, info
            )
            near, factors = (beside, beside_work) if met else (far, far_work)
        if not aim(starts[row], ends[row], near[size - 15 : size], target):
            codes[i] = FAR
            continue
        lean(near, factors, elements, target, trial)
        code = rod_drive.solve(
            par, own_mesh, trial, own_work, buffer, info, elements, WIDTH, points, 0, True, MOST_ITERATIONS, FARTHEST
        )
        if code == CONVERGED and not (info[ESTIMATE] <= tolerance and info[TURN] <= rod_drive.LARGEST_TURN):
            code = COARSE
        elif code == CONVERGED and info[EXCESS] != 0.0:
            code = FAR
        codes[i] = code
        if code != CONVERGED:
            continue
        info[rod_drive.ENERGY] += energy_of_masses(masses, own_mesh, own_work, elements, target)
        if bodies.shape[0] > 0:
            positions = buffer[points : 4 * points].reshape(points, 3)
            closest_points(
                positions, buffer[:points], radius, horizon, 0.0, True, bodies, links, triangles, nodes, tables[row],
                counts,
            )  # fmt: skip
        found = margin_rows[row]
        margins.measure_loads(buffer, points, section, limits, True, True, found)
        margins.measure_bodies(tables[row], limits[5], found)
        found[margins.STABILITY, :] = np.nan
        own_mode[:] = mode
        memory[0], memory[1], memory[2] = np.nan, 0.0, 0.0
        margins.measure_stability(
            par, own_mesh, trial, own_work, elements, WIDTH, own_mode, MODE_STEPS, False, soft, False, False, memory,
            found,
        )  # fmt: skip


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
