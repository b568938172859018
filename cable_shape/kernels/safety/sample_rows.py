"""Many cables that differ a little, each between ends of its own: the compiled inner loop of a sample.

Every row starts from the one shape in the middle, moved to first order as its ends move, so that no row depends on
another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.beside import aim, lean, take_trial
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
from cable_shape.kernels.network.mesh import copy_model, move_nodes
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS
from cable_shape.kernels.network.respond import softest_mode
from cable_shape.kernels.network.tables import TRIAL, Floats, Whole, copy, solution_of
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.kernels.safety.batch_rows import COARSE, FARTHEST, MOST_ITERATIONS
from cable_shape.kernels.safety.follow_rows import Found, Judged, judge


class Middle(NamedTuple):
    """The shape that all rows start from, with fresh factors."""

    bare: Whole  # plan with one element a span
    ints: Whole
    floats: Floats
    sols: Floats
    space: Floats
    mode: Floats  # (n, 3), the softest
    steps: int  # inverse iterations for that of each row; 0: no stability is asked for
    stays: Floats  # (a,) [m], arc lengths of what has a place along the cable
    tolerance: float  # [m]


class Rows(NamedTuple):
    """What differs, r rows."""

    models: Floats  # (r, size) with one element a span
    stays: Floats  # (r, a) [m], where those arc lengths are
    knots: Floats  # (r, k, 7), places of the supports; of the ends also how they are turned
    pieces: Floats  # (r, p, PIECE), see `margins`
    soft: Floats  # (r,) [N], unit of eigenvalues


@kernel(nogil=True)
def solve_rows(middle: Middle, rows: Rows, judged: Judged, found: Found, codes: Whole) -> None:
    """Solves all rows; a code, of codes (r,), that is not CONVERGED leaves the row to another solver."""
    ints, sols = middle.ints, middle.sols
    points, last = found.buffers.shape[1] // 17, rows.knots.shape[1] - 1
    floats, own, space, factors = (
        np.empty_like(middle.floats),
        np.zeros_like(sols),
        middle.space.copy(),
        middle.space.copy(),
    )
    poses, twists = np.empty((last + 1, 7)), np.empty((last + 1, 6))
    nothing, links, mode = np.empty(0), np.empty((0, 7)), np.empty_like(middle.mode)
    memory, eigen, trial = np.empty(margins.MEMORY), np.empty(2), sols.copy()
    for i in range(codes.shape[0]):
        codes[i] = FAR
        if not aim(ints, sols, rows.knots[i, 0], rows.knots[i, last], poses):
            continue
        poses[1:last, :3] = rows.knots[i, 1:last, :3]
        lean(ints, middle.floats, trial, factors, poses, twists)
        solution_of(ints, trial, TRIAL).pose[1:last, :3] = poses[1:last, :3]
        take_trial(ints, trial, own)
        copy(floats, middle.floats)
        copy_model(middle.bare, rows.models[i], ints, floats)
        move_nodes(ints, middle.floats, middle.stays, rows.stays[i], floats)
        info = found.infos[i]
        code = solve(
            ints, floats, own, space, found.buffers[i], info, found.loads[i], points, 0, True, False, True,
            MOST_ITERATIONS, FARTHEST,
        )  # fmt: skip
        if code == CONVERGED:
            error = info[I_ESTIMATE] + info[I_DOUBT]
            fine = error <= middle.tolerance and info[I_TURN] <= LARGEST_TURN
            code = FAR if info[I_EXCESS] != 0.0 else code if fine else COARSE
        codes[i] = code
        if code != CONVERGED:
            continue
        info[I_ENERGY] += energy_of_masses(ints, floats, space, judged.masses)
        its = Judged(
            rows.pieces[i], judged.warn, rows.soft[i], judged.held, judged.masses, judged.radius, judged.horizon,
            judged.exclusion, judged.bodies, judged.triangles, judged.nodes,
        )  # fmt: skip
        judge(found.buffers[i], points, its, links, found.tables[i], found.margins[i])
        if middle.steps > 0:
            mode[:, :] = middle.mode
            memory[0], memory[1], memory[2] = np.nan, 0.0, 0.0
            softest_mode(ints, floats, own, space, nothing, mode, middle.steps, False, eigen)
            margins.remember((eigen[0], eigen[1]), rows.soft[i], memory)
            margins.tell_stability(False, memory, found.margins[i])
