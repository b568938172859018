"""The shape of a cable almost alike, on bodies; of one that touches none: :mod:`cable_shape.solve.nearby`."""

from __future__ import annotations

import numpy as np

from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.kernels.contact import respond
from cable_shape.kernels.network import drive, graph, newton, sliding, system, tables
from cable_shape.kernels.network import respond as network
from cable_shape.kernels.network.system import FORCE
from cable_shape.kernels.network.tables import NOW, TRIAL
from cable_shape.pose import FreeEnd
from cable_shape.shape import CableShape, Status
from cable_shape.solve.nearby import differ, follow, places
from cable_shape.solve.plan import Whole
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import MODEL
from cable_shape.solve.touching.state import TouchState


def nearby(state: TouchState, problem: Problem) -> CableShape | None:
    """The shape that `problem` has to first order beside the last solution of `state`, on the same points of bodies.

    state: in contact, freshly factored by `refresh`; it stays as it is. Bodies may have moved. None where they are
    others, the cable is thicker or thinner, or its network is another one.
    """
    other = TouchState(problem)
    poses = other.aim(problem.start, problem.end)
    state.cable.arcs = state.arcs
    moved = places(state.cable, other.cable)
    alike = state.bodies.are(problem.bodies) and state.bodies.names == other.bodies.names
    as_thick = np.array_equal(state.chains[0].pieces[:, 2], other.chains[0].pieces[:, 2])
    if moved is None or not alike or not as_thick:
        return None
    net = state.net
    ints, sols, space = net.ints, net.sols.copy(), net.space.copy()
    floats = respond.neighbours(net, state.s, other.made[None], moved[0], moved[1][None])[0]
    run = net.run.copy()
    network.at_rest(ints, sols)
    if len(run):
        sliding.columns(ints, net.floats.copy(), sols, space, run)
    differ(ints, net.floats, floats, sols, space)
    follow(ints, net.floats, sols, space, poses, range(len(poses) - isinstance(problem.end, FreeEnd)))
    _follow_bodies(state, other, sols, space)
    if len(run):
        sliding.slide_step(ints, floats, sols, space, run, 1.0)
    newton.advance(ints, sols, space, 1.0)
    sliding.move_along(ints, floats, run, 1.0)
    return _told(other, ints, floats, sols, space, state.clip_knots)


def _follow_bodies(state: TouchState, other: TouchState, sols: Array, space: Array) -> None:
    """Adds to the answer at hand that to bodies which move to where those of the other one are."""
    net, bodies = state.net, state.bodies
    work = tables.work_of.py_func(net.ints, space)
    parts = work.d, work.spans[:, FORCE : FORCE + 3], work.move
    whole = [part.copy() for part in parts]
    for at, (here, there) in enumerate(zip(bodies.frames, other.bodies.frames, strict=True)):
        turn = there[:3].T @ here[:3]
        spin = 0.5 * np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]))
        for axis, rate in enumerate((*(there[3] - here[3]), *spin)):
            if rate == 0.0:
                continue
            own = net._replace(floats=net.floats.copy(), sols=sols, space=space)
            respond.follow_body(own, state.q[NOW], state.near[NOW], state.on[NOW], at, here[3:], axis)
            graph.solve(net.ints, own.floats, space)
            graph.lead(tables.plan_of.py_func(net.ints), work)
            for sum_of, part in zip(whole, parts, strict=True):
                sum_of += rate * part
    for part, sum_of in zip(parts, whole, strict=True):
        part[...] = sum_of


def _told(other: TouchState, ints: Whole, floats: Array, sols: Array, space: Array, clips: Whole) -> CableShape:
    """The shape of the trial, as `kernels.contact.drive.solve` tells it."""
    problem = other.problem
    system.gradient(ints, floats, sols, space)
    trial, work = tables.solution_of.py_func(ints, sols, TRIAL), tables.work_of.py_func(ints, space)
    work.start[...], work.pulled[...], work.place[...] = trial.q, trial.lam, trial.pose[:, :3]
    work.moments[:, :3], work.moments[:, 3:] = -work.first[:, 3:6], work.first[:, 6:9]
    out, info = CableShape.new_buffer(problem.points), np.zeros(drive.INFO + 2)
    loads = np.zeros((len(trial.pose), 7))
    drive.sample(ints, floats, sols, space, problem.points, out, info)
    drive.knot_loads(ints, floats, space, loads)
    masses = other.cable.masses(problem.end)
    shape = CableShape(
        out,
        problem.points,
        length=problem.cable.length,
        model=MODEL,
        status=Status.OK,
        energy=float(info[drive.I_ENERGY]) + float(drive.energy_of_masses(ints, floats, space, masses)),
        turns=int(trial.turns[0]),
        twist=float(info[drive.INFO]),
        supports=loads[clips],
    )
    shape.energy += energy_of_sections(problem.cable, shape, problem.gravity)
    return shape
