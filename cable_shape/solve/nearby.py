"""The shape of a cable almost alike, from the factors of the last solution: :func:`nearby`.

What holds the cable moves, or it is made of something else, by so little that first order is all there is: one step of
Newton's method with the factors at hand; no branch and no mesh is looked for. Rotations, forces, moments, loads on
clips and the energy are told as of a shape that was solved for, its own discretisation error taken off. So differences
of two such shapes, one above and one below, are derivatives of all that is told, and nothing is solved for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.kernels.network import correct as correction
from cable_shape.kernels.network import drive, mesh, newton, respond, sliding, system, tables
from cable_shape.kernels.network.tables import NOW, TRIAL
from cable_shape.kernels.rod_algebra import qconj, qexp, qlog, qmul, scale
from cable_shape.kernels.rod_guess import angle_axis, tangent
from cable_shape.pose import FreeEnd
from cable_shape.shape import CableShape, Status
from cable_shape.solve.network import Network
from cable_shape.solve.plan import Whole
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL


def nearby(state: Network, problem: Problem) -> tuple[CableShape, Network] | None:
    """The shape that `problem` has to first order beside the last solution of `state`, and the memory of it.

    state: with a solution, freshly factored by `refresh`; it stays as it is. None where the network of the problem is
    another one: with supports of other kinds, masses or kinks in another number.
    """
    other = Network(problem)
    poses = other.aim(problem.start, problem.end)
    moved = places(state, other)
    if moved is None:
        return None
    before, after = moved
    ints = state.ints
    floats = mesh.neighbours(state.bare, other.held[None], ints, state.floats, before, after[None])[0]
    given = range(len(poses) - isinstance(problem.end, FreeEnd))
    run = first_order(state, other, floats, poses, given)
    return _told(other, run), other


def first_order(state: Network, other: Network, floats: Array, poses: Array, given: Sequence[int]) -> Array:
    """Makes the solution of `other`, of the model `floats`, that beside the last one of `state`; room for its eyelets.

    poses (k, 7): of the knots, of which those `given` move there.
    """
    ints, sols, space = state.ints, state.sols.copy(), state.work.copy()
    run: Array = sliding.new_slides(ints, True)
    respond.at_rest(ints, sols)
    if len(run):
        sliding.columns(ints, state.floats.copy(), sols, space, run)
    differ(ints, state.floats, floats, sols, space)
    follow(ints, state.floats, sols, space, poses, given)
    if len(run):
        sliding.slide_step(ints, floats, sols, space, run, 1.0)
    newton.advance(ints, sols, space, 1.0)
    sliding.move_along(ints, floats, run, 1.0)
    size = int(tables.solution_size.py_func(ints))
    sols[:size] = sols[2 * size : 3 * size]
    other.take_arrays(ints, floats, sols, space)
    other.history = 1
    return run


def differ(ints: Whole, floats: Array, others: Array, sols: Array, space: Array) -> None:
    """Makes the right-hand side by how much the gradient at the trial is more under a model `others` than `floats`.

    Forces of spans that only carry what hangs on them become those of `others`.
    """
    work = tables.work_of.py_func(ints, space)
    respond.still(ints, space)
    parts = work.G, work.sums[:, :3], work.pull
    system.gradient(ints, floats, sols, space)
    before = [part.copy() for part in parts]
    drive.strip(ints, others, sols)
    system.gradient(ints, others, sols, space)
    for part, was in zip(parts, before, strict=True):
        part -= was


def places(state: Network, other: Network) -> tuple[Array, Array] | None:
    """Ascending arc lengths (a,) of supports, masses and kinks of one cable, and where they are on the other one."""
    own, its = state.material.stops, other.material.stops
    alike = other.structure == state.structure and own.size == its.size and other.points.size == state.points.size
    if not alike:
        return None
    arcs = other.arcs.copy()
    arcs[state.rings] = state.bounds()[state.rings]  # what is in an eyelet is found
    kinks = np.isin(own, state.stops) & ~np.isin(own, state.points)
    before = np.concatenate((state.bounds(), state.points, own[kinks]))
    order = np.argsort(before)
    return before[order], np.concatenate((arcs, other.points, its[kinks]))[order]


def follow(ints: Whole, floats: Array, sols: Array, space: Array, poses: Array, given: Sequence[int]) -> None:
    """Answers to the right-hand side and to knots `given` that move to `poses` (k, 7), which the trial takes.

    The step of all else is left in the work space.
    """
    plan, model = tables.plan_of.py_func(ints), tables.model_of.py_func(ints, floats)
    trial = tables.solution_of.py_func(ints, sols, TRIAL)
    twists, goal = np.zeros((len(trial.pose), 6)), trial.pose.copy()
    for k in given:
        pose = poses[k]
        now, rotation = tuple(trial.pose[k, 3:]), tuple(pose[3:])
        twists[k, :3] = pose[:3] - trial.pose[k, :3]
        if plan.vertices[k, 0] >= 0:  # it turns by itself, but for where it holds d3
            holds = model.loose[k, 0] == 0.0
            rotation = qmul(qexp(scale(*angle_axis(tangent(now), tangent(rotation)))), now) if holds else now
        spin = qmul(rotation, qconj(now))
        twists[k, 3:] = qlog(spin if spin[3] >= 0.0 else tuple(-x for x in spin))
        goal[k, :3] = pose[:3]
        goal[k, 3:] = qmul(qexp(tuple(twists[k, 3:])), now)
    respond.move_knots(ints, floats, sols, space, twists)
    respond.answer(ints, floats, sols, space, twists)
    trial.pose[...] = goal


def correct(state: Network, run: Array, points: int, out: Array, info: Array, loads: Array) -> None:
    """Fills what `drive.solve` tells of the solution now, its discretisation error taken off; run: of `first_order`."""
    ints, floats, sols, space = state.ints, state.floats, state.sols, state.work
    state.refresh()
    if len(run):
        sliding.columns(ints, floats, sols, space, run)
    correction.correct(ints, floats, sols, space, run, np.empty(correction.ERRORS))
    drive.settle_leaves(ints, floats, sols, space)
    kept = floats.copy()  # the mesh stays that of the solution that is corrected
    sliding.move_along(ints, floats, run, 1.0)
    drive.sample(ints, floats, sols, space, points, out, info)
    drive.knot_loads(ints, floats, space, loads)
    floats[:] = kept


def _told(state: Network, run: Array) -> CableShape:
    """The shape of the solution now."""
    problem = state.problem
    out, info = CableShape.new_buffer(problem.points), np.zeros(drive.INFO + 2)
    loads = np.zeros((len(state.knots), 7))
    correct(state, run, problem.points, out, info, loads)
    shape = CableShape(
        out,
        problem.points,
        length=problem.cable.length,
        model=MODEL,
        status=Status.OK,
        energy=float(info[drive.I_ENERGY]) + state.energy_of_masses(),
        turns=int(state.solution(NOW).turns[0]),
        twist=float(info[drive.INFO]),
        supports=loads[1:-1],
    )
    if problem.cable.sections:
        shape.energy += energy_of_sections(problem.cable, shape, problem.gravity)
    return shape
