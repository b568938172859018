"""The catenary: a perfectly flexible cable, exact under its weight, concentrated loads and stretch.

    n' + f = 0,   r' = (1 + |n|/EA) n/|n|

For a dead load the force is known up to its value at the start, and the closure r(L) - r(0) is the gradient of a
convex function of it: Newton's method on three unknowns, started from the closed form for the mean load, which is
already the answer for an inextensible cable under uniform load. The method is that of the elastic catenary (Irvine,
Cable Structures, MIT Press 1981) generalised to loads in any direction.

What it leaves out: bending and twisting, and so the orientation of the grips. Moments at a free end have no effect. A
load that varies along the cable is taken as constant over 1/400 of the length; the error estimate says what that costs.
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import catenary as kernel
from cable_shape.pose import FreeEnd, Pose
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_distance import rod_distance

MODEL = "catenary"

#: Panels of constant load over the whole length, where the load varies.
_PANELS = 400
#: Loads nearer to an end than this fraction of the length are carried by the end.
_AT_END = 1e-9
_NOWHERE = Pose().array  # read-only, as all poses are: kernels are compiled for each kind of array
_NO_TIP = np.zeros(3)


class _Constants(NamedTuple):
    """What stays while the ends move."""

    panels: Array  # (k, 7), see kernels/catenary.closure
    coarse: Array  # the same with half as many panels; empty where the load does not vary
    mean: Array  # (3,) [N/m]
    weight: Array  # (3,) [N/m]
    give: float  # 1/N
    at_end: Array  # (3,) [N], weights of masses at the end


def solve(problem: Problem, warm: Array) -> CableShape:
    """The catenary between the problem's ends, or hanging from its start.

    Parameters
    ----------
    problem : Problem
    warm : (4,)
        Not used: the closed form for the mean load is as good a start as the last solution.
    """
    del warm
    began = perf_counter()
    constants: _Constants | None = problem.cache.get(MODEL)
    if constants is None:
        constants = problem.cache[MODEL] = _constants(problem)
    cable, end, points = problem.cable, problem.end, problem.points
    free = type(end) is FreeEnd
    if isinstance(end, FreeEnd):
        far, tip = _NOWHERE, end.force + end.mass * problem.end_fall + constants.at_end
    else:
        far, tip = end.cable_frame.array, _NO_TIP
    near = problem.start.cable_frame.array
    buffer, result = CableShape.new_buffer(points), np.zeros(kernel.RESULTS)
    code = kernel.solve(
        near, far, free, tip, constants.panels, constants.mean, cable.length, constants.give, constants.weight, points,
        problem.tolerance, buffer, result,
    )  # fmt: skip
    iterations, residual, defect, energy, roll, chord = result.tolist()
    error = defect + (_staircase(problem, constants, buffer) if code == kernel.FOUND else math.inf)
    status, detail = _verdict(problem, code, constants, chord, error)
    shape = CableShape(
        buffer,
        points,
        length=cable.length,
        model=MODEL,
        status=status,
        detail=detail,
        energy=energy,
        error_estimate=rod_distance(problem, error)
        if status is Status.OK and cable.mean_bending_stiffness > 0.0
        else error,
        residual=residual,
        iterations=int(iterations),
        roll_error=roll,
    )
    if code == kernel.FOUND:
        shape.energy += _energy_of_masses(problem, shape)
    shape.solve_time = perf_counter() - began
    return shape


def _constants(problem: Problem) -> _Constants:
    """Panels between concentrated loads, finer where the distributed load varies."""
    cable = problem.cable
    length, weight = cable.length, cable.linear_density * problem.gravity
    give = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
    if not len(problem.load_arc_length) and np.array_equal(problem.load[0], problem.load[1]):
        mean = problem.load[0]
        panel = np.array(((length, *mean.tolist(), 0.0, 0.0, 0.0),))
        return _Constants(panel, np.empty((0, 7)), mean, weight, give, np.zeros(3))
    inside = (problem.load_arc_length > _AT_END * length) & (problem.load_arc_length < (1.0 - _AT_END) * length)
    places, forces = problem.load_arc_length[inside], problem.load_force[inside]
    at_end = problem.load_force[problem.load_arc_length >= (1.0 - _AT_END) * length].sum(axis=0)
    varies = not np.array_equal(problem.load[0], problem.load[1])
    mean = problem.load.mean(axis=0) + forces.sum(axis=0) / length
    fine = _panels(problem.load, length, places, forces, _PANELS if varies else 1)
    coarse = _panels(problem.load, length, places, forces, _PANELS // 2) if varies else np.empty((0, 7))
    return _Constants(fine, coarse, mean, weight, give, at_end)


def _panels(load: Array, length: float, places: Array, forces: Array, count: int) -> Array:
    """(k, 7) length, mean load, concentrated load at the beginning, of every panel."""
    edges = np.union1d(np.linspace(0.0, length, count + 1), places)
    panels = np.zeros((len(edges) - 1, 7))
    panels[:, 0] = np.diff(edges)
    middle = 0.5 * (edges[1:] + edges[:-1])[:, None] / length
    panels[:, 1:4] = (1.0 - middle) * load[0] + middle * load[1]
    np.add.at(panels[:, 4:7], np.searchsorted(edges, places), forces)
    return panels


def _staircase(problem: Problem, constants: _Constants, buffer: Array) -> float:
    """[m], what taking a varying load as constant in each panel costs, from the same with half as many panels."""
    if not len(constants.coarse):
        return 0.0
    n = problem.points
    force, none = buffer[11 * n : 11 * n + 3], np.zeros((3, 3))
    fine = kernel.closure(force, constants.panels, constants.give, none)
    half = kernel.closure(force, constants.coarse, constants.give, none)
    return float(np.linalg.norm(fine - half))


def _energy_of_masses(problem: Problem, shape: CableShape) -> float:
    """[J], potential energy of point masses and of a plug."""
    energy = 0.0
    for mass in problem.masses:
        place = [np.interp(mass.arc_length, shape.arc_length, column) for column in shape.positions.T]
        energy -= mass.mass * float(problem.gravity @ place)
    if isinstance(problem.end, FreeEnd):
        energy -= problem.end.mass * float(problem.gravity @ shape.positions[-1])
    return energy


def _verdict(problem: Problem, code: int, constants: _Constants, chord: float, error: float) -> tuple[Status, str]:
    """Status and, when all is not well, its detail."""
    length = problem.cable.length
    if code == kernel.OVERSTRETCHED:
        return Status.OVERSTRETCHED, (
            f"chord {chord:.6g} m, {chord - length:.3g} m beyond the length {length:.6g} m of an inextensible cable; "
            "bring the grips closer or give axial_stiffness"
        )
    if code == kernel.FOUND and error <= problem.tolerance:
        return Status.OK, ""
    if code == kernel.FOUND:
        return Status.NOT_CONVERGED, (
            f"error estimate {error:.2g} m is above the tolerance {problem.tolerance:.2g} m; raise the tolerance"
        )
    if not constants.panels[:, 1:7].any():
        return Status.NOT_CONVERGED, (
            "a slack cable without weight, load and bending stiffness has no definite shape; give it a linear_density"
        )
    return Status.NOT_CONVERGED, "the force that closes the cable was not found; move the grips in smaller steps"
