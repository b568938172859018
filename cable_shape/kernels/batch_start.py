"""The shape at the centre of a cell, on a mesh of its own: where the rows of a batch in that cell start from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cable_shape.kernels import rod_drive
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.batch_cells import grasp
from cable_shape.kernels.batch_lean import WIDTH, aim, lean
from cable_shape.kernels.response import smallest_eigenvalue
from cable_shape.kernels.rod_drive import ESTIMATE, EXCESS, TRIAL, TURN, mesh_parts, mesh_size, slot, slot_size
from cable_shape.kernels.rod_mesh import indicated
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.kernels.rod_work import work_size

Array = Any
Start = tuple[bool, int, Array, Array, Array, Array]
ASTRAY = 2.0  # rad, a frame's largest turn from its prediction, which is a long way: further away is another branch
MOST_ITERATIONS = 25
#: A cell's mesh aims at this fraction of the tolerance and at elements that turn by so much [rad], and is made anew if
#: it misses this by a half or that turn: the rows around need some room.
SHARE, AIM, WIDEST = 0.15, 0.5, 0.6
FEWEST, MOST_MESHES = 8, 3
MODE_STEPS = 4


@kernel
def carry_mode(s: Array, mode: Array, s_new: Array, found: Array) -> None:
    """Interpolates a mode (N+1, 3) from the nodes s to others, linearly."""
    e = 0
    for k in range(s_new.shape[0]):
        while e < s.shape[0] - 2 and s_new[k] > s[e + 1]:
            e += 1
        x = (s_new[k] - s[e]) / (s[e + 1] - s[e])
        for i in range(3):
            found[k, i] = (1.0 - x) * mode[e, i] + x * mode[e + 1, i]


@kernel
def start_at(
    key: Array, reach: float, turn: float, longest: float, par: Array, mesh: Array, sol: Array, work: Array,
    elements: int, mode: Array, estimate: float, tolerance: float, loads: tuple[Array, ...], info: Array,
) -> Start:  # fmt: skip
    """Solves for the centre of the cell `key` from the solution now in `sol`, whose fresh factors are in `work`.

    mesh, mode (N+1, 3), estimate [m]: of that solution, with the error of each element. loads: what `rod_drive.lay_out`
    takes from `stops` on. Returns whether it was found, and then its elements, mesh, solution, fresh factors and mode.
    """
    size = slot_size(elements)
    start, end, target, nothing = np.empty(7), np.empty(7), np.empty(15), np.empty(0)
    own, own_mesh, own_mode = elements, mesh, mode
    own_sol, own_work = np.zeros(3 * size), work
    grasp(key, reach, turn, longest, start, end)
    if not aim(start, end, sol[size - 15 : size], target):
        return False, own, own_mesh, own_sol, own_work, own_mode
    lean(sol, work, elements, target, own_sol)
    stops = loads[0].shape[0]
    met = False
    for _ in range(MOST_MESHES):
        q, _, _ = slot(own_sol, own, TRIAL)
        s = own_mesh[: own + 1]
        x, density = np.empty(own + 2), np.empty(own + 2)
        excess = min(max(estimate / (SHARE * tolerance), 1e-3), 1e3)
        wanted = indicated(s, q, mesh_parts(own_mesh, own)[5], excess, AIM, x, density)
        count = max(FEWEST + 2 * stops, math.ceil(wanted))
        next_mesh, next_sol = np.zeros(mesh_size(count)), np.zeros(3 * slot_size(count))
        rod_drive.lay_out(next_mesh, count, x, density, *loads)
        s_new = next_mesh[: count + 1]
        rod_drive.carry_over(s, own_sol, own, s_new, next_sol, count)
        p, _, ends = slot(next_sol, count, TRIAL)
        for i in range(4):
            p[0, i], p[count, i] = ends[3 + i], ends[10 + i]
        next_mode = np.empty((count + 1, 3))
        carry_mode(s, own_mode, s_new, next_mode)
        own, own_mesh, own_sol, own_mode = count, next_mesh, next_sol, next_mode
        own_work = np.zeros(work_size(own, WIDTH))
        code = rod_drive.solve(
            par, own_mesh, own_sol, own_work, nothing, info, own, WIDTH, 0, 0, True, MOST_ITERATIONS, ASTRAY
        )
        met = code == CONVERGED and info[EXCESS] == 0.0
        estimate = info[ESTIMATE]
        if not met or (estimate <= 1.5 * SHARE * tolerance and info[TURN] <= WIDEST):
            break
        # another mesh starts from this solution
        one = slot_size(own)
        own_sol[2 * one :] = own_sol[:one]
    if met:
        smallest_eigenvalue(par, own_mesh, own_sol, own_work, own, WIDTH, own_mode, MODE_STEPS, True)
    return met, own, own_mesh, own_sol, own_work, own_mode
