"""From one solved shape to the next one beside it: to first order by its factors, then by Newton's method.

A cell of a lattice of grasps (`batch_cells`) has a shape at its centre, solved for from nothing. Nothing here depends
on more than the two poses that are asked for. Not for cables in eyelets, which run through them from cell to cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.batch_cells import grasp
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.drive import solve
from cable_shape.kernels.network.guess import CURVED, HANGING, guess
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS, advance
from cable_shape.kernels.network.predict import turn_ends
from cable_shape.kernels.network.respond import answer, at_rest, move_knots, refresh, still
from cable_shape.kernels.network.start import FOUND, MOST_MESHES, put_knots, start
from cable_shape.kernels.network.tables import (
    N_KNOTS,
    NOW,
    TRIAL,
    Floats,
    Whole,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
)
from cable_shape.kernels.rod_algebra import get3, put3, qconj, qlog, qmul, subtract

#: A cell's mesh is made for this fraction of the tolerance: the rows around need some room.
SHARE = 0.35
MOST_ITERATIONS = 25
#: rad, by which the frames of shapes differ that are not one.
OTHER = 0.2


class Told(NamedTuple):
    """The cable, how it is held, and how well it is to be known; the same for all grasps."""

    bare: Whole  # plan and model with one element a span
    held: Floats
    poses: Floats  # (k, 7) of the knots between the two ends
    stops: Floats  # arc lengths that are nodes
    finer: float  # see `start.start`
    tolerance: float  # [m]
    reach: float  # units of the lattice of cells [m], [rad]
    turn: float
    longest: float  # [m], chord of the grasp at a cell's centre


Solved = tuple[bool, Whole, Floats, Floats, Floats]


@viewing
def aim(ints: Whole, sols: Floats, begin: Floats, end: Floats, poses: Floats) -> bool:
    """Fills poses (k, 7): the knots of the solution now, but the ends at `begin` and `end` (7,), canonically wound.

    False: the end is turned against what holds the roll by so much more or less that it is another winding there.
    """
    plan, now = plan_of(ints), solution_of(ints, sols, NOW)
    copy_rows(poses, now.pose, 7)
    last, roll = poses.shape[0] - 1, plan.roll[0, 0]
    own = wound = other = 0.0
    for i in range(3, 7):
        own += begin[i] * now.pose[0, i]
    for i in range(7):
        poses[0, i] = -begin[i] if own < 0.0 and i > 2 else begin[i]
    for i in range(3, 7):
        wound += poses[roll, i] * end[i]
    for i in range(7):
        poses[last, i] = -end[i] if wound < 0.0 and i > 2 else end[i]
        other += poses[last, i] * now.pose[last, i] if i > 2 else 0.0
    return other > 0.0


@viewing
def lean(ints: Whole, floats: Floats, sols: Floats, space: Floats, poses: Floats, twists: Floats) -> None:
    """Makes the trial the solution now, moved to first order as its knots move to `poses` (k, 7).

    space: with fresh factors of that solution. twists (k, 6): scratch.
    """
    at_rest(ints, sols)
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    last = poses.shape[0] - 1
    for k in range(last + 1):
        p = (poses[k, 3], poses[k, 4], poses[k, 5], poses[k, 6])
        q = (sol.pose[k, 3], sol.pose[k, 4], sol.pose[k, 5], sol.pose[k, 6])
        turn = qmul(p, qconj(q))
        if turn[3] < 0.0:
            turn = (-turn[0], -turn[1], -turn[2], -turn[3])
        put3(twists, k, 0, subtract(get3(poses, k), get3(sol.pose, k)))
        put3(twists, k, 3, qlog(turn))
    still(ints, space)
    move_knots(ints, floats, sols, space, twists)
    answer(ints, floats, sols, space, twists)
    advance(ints, sols, space, 1.0)
    for k in (0, last):
        for i in range(7):
            sol.pose[k, i] = poses[k, i]
    turn_ends(plan, model, sol)


@kernel
def cell_shape(told: Told, key: Whole, out: Floats, info: Floats) -> Solved:
    """The shape at the centre of a cell, from nothing: whether it was found; plan, model, solutions, factors."""
    poses = told.poses.copy()
    last = poses.shape[0] - 1
    grasp(key, told.reach, told.turn, told.longest, poses[0], poses[last])
    if wound(told.bare, poses):
        for i in range(3, 7):
            poses[last, i] = -poses[last, i]
    loads = np.empty((0, 7))
    code, ints, floats, sols, space = start(
        told.bare, told.held, poses, 0.0, told.stops, told.finer, SHARE * told.tolerance, MOST_MESHES, 0, out,
        info, loads,
    )  # fmt: skip
    met = code == FOUND and info[I_EXCESS] == 0.0
    if met:
        refresh(ints, floats, sols, space, True)
    return met, ints, floats, sols, space


@viewing
def wound(ints: Whole, poses: Floats) -> bool:
    """Whether the quaternion of the last knot has not the sign of no turn against what holds the roll."""
    plan, last = plan_of(ints), poses.shape[0] - 1
    product = 0.0
    for i in range(3, 7):
        product += poses[plan.roll[0, 0], i] * poses[last, i]
    return product < 0.0


@kernel(nogil=True)
def others(told: Told, keys: Whole, info: Floats, several: Whole) -> None:
    """Fills several (c,) for cells (c, d): 1 where guesses lead to other stable shapes than the first one."""
    out, loads = np.empty(0), np.empty((0, 7))
    for c in range(keys.shape[0]):
        several[c] = 0
        met, ints, floats, sols, space = cell_shape(told, keys[c], out, info)
        if not met:
            continue
        size = solution_size(ints)
        kept, poses = sols[:size].copy(), np.empty((ints[N_KNOTS], 7))
        put_poses(ints, kept, poses)
        placed = np.zeros(ints[N_KNOTS], np.int64)
        for kind, sag in ((HANGING, 0.0), (CURVED, 0.3)):
            put_knots(ints, sols, poses, 0.0)
            guess(ints, floats, sols, placed, kind, sag, False)
            code = solve(ints, floats, sols, space, out, info, loads, 0, 0, True, False, True, MOST_ITERATIONS, 7.0)
            if code == CONVERGED and info[I_EXCESS] == 0.0 and apart(ints, kept, sols):
                several[c] = 1


@viewing
def put_poses(ints: Whole, sols: Floats, poses: Floats) -> None:
    """Fills poses (k, 7) with those of the solution now."""
    copy_rows(poses, solution_of(ints, sols, NOW).pose, 7)


@viewing
def apart(ints: Whole, first: Floats, second: Floats) -> bool:
    """Whether a frame of the solution now of one is turned by more than OTHER against that of the other."""
    p, q = solution_of(ints, first, NOW).q, solution_of(ints, second, NOW).q
    least = 1.0
    for k in range(p.shape[0]):
        least = min(least, abs(p[k, 0] * q[k, 0] + p[k, 1] * q[k, 1] + p[k, 2] * q[k, 2] + p[k, 3] * q[k, 3]))
    return least < math.cos(0.5 * OTHER)


@viewing
def take_trial(ints: Whole, sols: Floats, own: Floats) -> None:
    """Makes the trial of one memory that of another."""
    size = solution_size(ints)
    copy(own[2 * size : 3 * size], sols[2 * size : 3 * size])
