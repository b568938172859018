"""The gradient cable of 4th and 6th order in closed form, in 3D (after eqs 2 to 5 of the cabling-shape paper).

Componentwise, with the parameter l in [0, L], one tension T, B = EI (mean of the two) and C = EI l_g^2,

    T x'' - B x'''' + C x^(6) + f(l) + sum P_j delta(l - l_j) = 0,       integral of |x'| dl = L (1 + T / EA):

the stationary point of the energy 1/2 (T |x'|^2 + B |x''|^2 + C |x'''|^2) less the work of the loads, which gives the
6th-order term its sign and the ends their natural conditions. The paper writes it per unit of tension (eqs 4 and 5:
x'' - s x'''' = w with s = EI / T, g = sqrt(s)) and, for small slopes, per unit of horizontal force (eq 3). T is free,
may be negative, and is found by the length (eq 2). f is linear in l; a load P_j sits where the arc length of the shape
itself is that of the load.

Ends: clamped or swivel, position and x' = d3 (6th order: and x'' = the grip's `curvature`); pinned, position and no
moment. A free end ("exterior" solution) has the natural conditions T x' - B x''' + C x^(5) = tip force,
B x'' - C x'''' = tip moment x x', x''' = 0. With a free end T is the one multiplier of the length condition, so it is
the mean of a tension that truly runs from the weight of the cable to the force at the tip.

What it leaves out: twist, rest curvature, anisotropy and shear, and exact bending: B x'''' takes the derivative along
l, which is not the arc length (the speed |x'| of a slack cable departs from 1), and T is constant where the true
tension varies. So it tends to the rod only as the cable becomes taut, or straight and little loaded. docs/gradient.md
gives the distances to rod solutions that ``scripts/bench gradient`` prints.

Reported along the shape: `force` n = T x' - B x''' + C x^(5), which balances the loads exactly; `curvature` and
`moment` = EI t x t' of the true curve; frames parallel-transported from the start, with the roll that is then unmet at
a clamped end in `roll_error`; `energy` of true bending and stretching, without the gradient term, and of the weight,
which does not include `distributed_load`.
"""

from __future__ import annotations

from functools import lru_cache
from time import perf_counter
from typing import NamedTuple

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import gradient as kernel
from cable_shape.kernels.gradient_ends import CLAMPED, FREE, PINNED
from cable_shape.kernels.gradient_tension import FAILED, FOUND, SINGULAR, critical
from cable_shape.models.rod_distance import RodDistance
from cable_shape.pose import FreeEnd
from cable_shape.problem import Problem
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status

_KIND = {"clamped": CLAMPED, "swivel": CLAMPED, "pinned": PINNED}
_NO_TIP = np.zeros(9)
_NOWHERE = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
_STRAIGHT = np.zeros(3)

#: Loads nearer to an end than this fraction of the length are carried by the end.
_AT_END = 1e-9


def solve4(problem: Problem, warm: Array) -> CableShape:
    """The gradient cable of 4th order: T x'' - B x'''' + f = 0.

    Parameters
    ----------
    problem : Problem
    warm : (4,)
        The last solution's state, read and overwritten; NaN: cold. Any values are safe.

    Raises
    ------
    ArgumentError
        If the bending stiffness is 0.
    """
    return _solve(problem, warm, 4)


def solve6(problem: Problem, warm: Array) -> CableShape:
    """The gradient cable of 6th order, with C = EI `gradient_length`^2 and the curvature vector given at the ends.

    Parameters and errors as for :func:`solve4`.
    """
    return _solve(problem, warm, 6)


class _Constants(NamedTuple):
    """What stays while the ends move."""

    numbers: Array
    place: Array  # fractions of the length, inside
    load: Array  # (k, 3)
    at_start: Array  # (3,) [N], loads carried by the ends
    at_end: Array
    held: bool  # whether there are any
    finest: float  # share of the tolerance for each panel, as a fraction of the length
    buckling: dict[tuple[int, int], float]


def _constants(problem: Problem, order: int) -> _Constants:
    cable = problem.cable
    stiffness, length = cable.mean_bending_stiffness, cable.length
    if stiffness == 0.0:
        raise ArgumentError.of(
            "bending_stiffness", 0.0, "a gradient cable needs it above 0 N m^2", "Choose model='catenary'."
        )
    numbers = np.empty(13)
    numbers[kernel.LENGTH], numbers[kernel.STIFFNESS] = length, stiffness
    numbers[kernel.GRADIENT] = 0.0 if order == 4 else (cable.gradient_length / length) ** 2
    numbers[kernel.ETA] = 0.0 if cable.axial_stiffness is None else stiffness / (length**2 * cable.axial_stiffness)
    numbers[kernel.WEIGHT_FORCE : kernel.LOAD] = cable.linear_density * problem.gravity
    numbers[kernel.LOAD :] = problem.load.ravel()
    finest = min(max(0.01 * problem.tolerance / length, 1e-12), 1e-5)
    if not len(problem.load_arc_length):
        return _Constants(numbers, np.empty(0), np.empty((0, 3)), np.zeros(3), np.zeros(3), False, finest, {})
    fraction = problem.load_arc_length / length
    inside = (fraction > _AT_END) & (fraction < 1.0 - _AT_END)
    place, which = np.unique(fraction[inside], return_inverse=True)
    load = np.zeros((len(place), 3))
    np.add.at(load, which, problem.load_force[inside])
    at_start = problem.load_force[fraction <= _AT_END].sum(axis=0)
    at_end = problem.load_force[fraction >= 1.0 - _AT_END].sum(axis=0)
    return _Constants(numbers, place, load, at_start, at_end, bool(at_start.any() or at_end.any()), finest, {})


@lru_cache(maxsize=256)
def buckling_tension(c: float, start: int, end: int) -> float:
    """T L^2 / B at which a straight cable with these ends buckles; c = (gradient length / L)^2, 0: 4th order."""
    known = {
        (CLAMPED, CLAMPED): -39.47841760435743,  # -4 pi^2
        (CLAMPED, PINNED): -20.190728556426629,  # -x^2, tan x = x
        (PINNED, PINNED): -9.869604401089358,  # -pi^2
        (CLAMPED, FREE): -2.4674011002723397,  # -pi^2 / 4
        (PINNED, FREE): 0.0,
    }
    fourth = known[start, end] if (start, end) in known else known[end, start]
    if c == 0.0 or fourth == 0.0:
        return fourth
    return float(critical(c, np.array((start, end)), fourth))


def _solve(problem: Problem, warm: Array, order: int) -> CableShape:
    began = perf_counter()
    model = "gradient4" if order == 4 else "gradient6"
    constants: _Constants | None = problem.cache.get(model)
    if constants is None:
        constants = problem.cache[model] = _constants(problem, order)
    start, end, points = problem.start, problem.end, problem.points
    kind0 = _KIND[start.kind]
    if type(end) is FreeEnd:
        kind1, end_frame, end_curvature = FREE, _NOWHERE, _STRAIGHT
        tip = np.concatenate((end.force + end.mass * problem.end_fall + constants.at_end, end.moment, _STRAIGHT))
        tip[6:] = end.mass * problem.end_fall + constants.at_end
    else:
        kind1, end_frame, end_curvature, tip = _KIND[end.kind], end.cable_frame.array, end.curvature, _NO_TIP
    buckling = constants.buckling.get((kind0, kind1))
    if buckling is None:
        buckling = buckling_tension(float(constants.numbers[kernel.GRADIENT]), kind0, kind1)
        constants.buckling[kind0, kind1] = buckling
    buffer = np.empty(NUMBERS_PER_POINT * points)
    result = np.empty(kernel.RESULTS)
    code = kernel.solve(
        start.cable_frame.array, start.curvature, kind0, end_frame, end_curvature, kind1, tip, constants.numbers,
        constants.place, constants.load, buckling, constants.finest, points, warm, buffer, result,
    )  # fmt: skip
    iterations, residual, error, energy, roll, chord, _ = result.tolist()
    if constants.held:
        energy -= float(constants.at_start @ start.cable_frame.position)
        if kind1 != FREE:
            energy -= float(constants.at_end @ end_frame[:3])
    estimate: float | RodDistance = error
    if code == FOUND and error <= problem.tolerance:
        status, detail, estimate = Status.OK, "", RodDistance(problem, error)
    else:
        status, detail = _verdict(code, problem, chord, error)
    return CableShape(
        buffer,
        points,
        length=problem.cable.length,
        model=model,
        status=status,
        detail=detail,
        energy=energy,
        error_estimate=estimate,
        residual=residual,
        iterations=int(iterations),
        solve_time=perf_counter() - began,
        roll_error=roll,
    )


def _verdict(code: int, problem: Problem, chord: float, error: float) -> tuple[Status, str]:
    """Status and its detail when all is not well."""
    length = problem.cable.length
    if code == kernel.OVERSTRETCHED:
        return Status.OVERSTRETCHED, (
            f"chord {chord:.6g} m, {chord - length:.3g} m beyond the length {length:.6g} m of an inextensible cable; "
            "bring the grips closer or give axial_stiffness"
        )
    if code == FOUND:
        return Status.NOT_CONVERGED, (
            f"error estimate {error:.2g} m is above the tolerance {problem.tolerance:.2g} m; raise the tolerance"
        )
    if code == FAILED:
        return Status.NOT_CONVERGED, "no tension gives the cable its length; move the grips or choose another model"
    if code == SINGULAR:
        return Status.NOT_CONVERGED, "the boundary conditions are singular; choose another model"
    return Status.NOT_CONVERGED, "the numbers left the range of floating point; check the units of the cable"
