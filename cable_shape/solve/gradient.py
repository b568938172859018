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

import math
from collections.abc import Callable
from functools import lru_cache
from time import perf_counter
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import gradient as kernel
from cable_shape.kernels.gradient_ends import CLAMPED, FREE, PINNED
from cable_shape.kernels.gradient_tension import FAILED, FOUND, SINGULAR, critical
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_distance import rod_distance

_KIND = {"clamped": CLAMPED, "swivel": CLAMPED, "pinned": PINNED}
_NOWHERE = Pose().array  # read-only, as all poses are: kernels are compiled for each kind of array
_NOTHING: Array = np.zeros(3)

_OK = Status.OK  # looked up once: an enumeration's members take longer than their name says

#: Loads nearer to an end than this fraction of the length are carried by the end.
_AT_END = 1e-9


def new_memory() -> Array:
    """What :func:`solve4` and :func:`solve6` keep from call to call; cold."""
    return np.full(kernel.MEMORY, math.nan)


def solve4(problem: Problem, memory: Array) -> CableShape:
    """The gradient cable of 4th order: T x'' - B x'''' + f = 0.

    Parameters
    ----------
    problem : Problem
    memory
        From :func:`new_memory`; of the last solution, whatever its problem was.

    Raises
    ------
    ArgumentError
        If the bending stiffness is 0.
    """
    return _solve(problem, memory, 4)


def solve6(problem: Problem, memory: Array) -> CableShape:
    """The gradient cable of 6th order, with C = EI `gradient_length`^2 and the curvature vector given at the ends.

    Parameters and errors as for :func:`solve4`.
    """
    return _solve(problem, memory, 6)


@final
class _Constants:
    """What stays while the ends move; `held` follows the way in which they are held."""

    __slots__ = ("_end", "_start", "at_end", "at_start", "carried", "held", "numbers")

    def __init__(self, problem: Problem, order: int) -> None:
        cable = problem.cable
        stiffness, length = cable.mean_bending_stiffness, cable.length
        if stiffness == 0.0:
            raise ArgumentError.of(
                "bending_stiffness", 0.0, "a gradient cable needs it above 0 N m^2", "Choose model='catenary'."
            )
        numbers = np.empty(kernel.NUMBERS)
        numbers[kernel.LENGTH], numbers[kernel.STIFFNESS] = length, stiffness
        numbers[kernel.GRADIENT] = 0.0 if order == 4 else (cable.gradient_length / length) ** 2
        numbers[kernel.ETA] = 0.0 if cable.axial_stiffness is None else stiffness / (length**2 * cable.axial_stiffness)
        numbers[kernel.WEIGHT_FORCE : kernel.LOAD] = cable.linear_density * problem.gravity
        numbers[kernel.LOAD : kernel.FINEST] = problem.load.ravel()
        numbers[kernel.FINEST] = min(max(0.01 * problem.tolerance / length, 1e-12), 1e-5)
        self.numbers: Array = numbers
        self.at_start: Array = _NOTHING  # (3,) [N], loads carried by the ends
        self.at_end: Array = _NOTHING
        self.carried = False  # whether there are any
        if len(problem.load_arc_length):
            self._load(problem)
        self.held: Array = np.zeros(kernel.HELD)
        self._start: Grip | None = None  # the ends whose way of being held that is
        self._end: Grip | FreeEnd | None = None

    def _load(self, problem: Problem) -> None:
        """Takes over the concentrated loads."""
        fraction = problem.load_arc_length / problem.cable.length
        inside = (fraction > _AT_END) & (fraction < 1.0 - _AT_END)
        place, which = np.unique(fraction[inside], return_inverse=True)
        load = np.zeros((len(place), 3))
        np.add.at(load, which, problem.load_force[inside])
        self.numbers = np.concatenate((self.numbers, place, load.ravel()))
        self.at_start = problem.load_force[fraction <= _AT_END].sum(axis=0)
        self.at_end = problem.load_force[fraction >= 1.0 - _AT_END].sum(axis=0)
        self.carried = bool(self.at_start.any() or self.at_end.any())

    def hold(self, problem: Problem) -> None:
        """Takes over the way in which the ends are held; most often it is that of the last ones."""
        start, end = problem.start, problem.end
        if _held_alike(start, self._start) and _held_alike(end, self._end):
            return
        self._start, self._end = start, end
        held, kind0 = self.held, _KIND[start.kind]
        held[kernel.CURVATURE0 : kernel.CURVATURE1] = start.curvature
        if isinstance(end, FreeEnd):
            kind1, plug = FREE, end.mass * problem.end_fall + self.at_end
            held[kernel.CURVATURE1 :] = np.concatenate((np.zeros(3), end.force + plug, end.moment, plug))
        else:
            kind1 = _KIND[end.kind]
            held[kernel.CURVATURE1 : kernel.TIP] = end.curvature
        held[kernel.KIND0], held[kernel.KIND1] = kind0, kind1
        held[kernel.BUCKLING] = buckling_tension(float(self.numbers[kernel.GRADIENT]), kind0, kind1)


def _held_alike(now: Grip | FreeEnd, before: Grip | FreeEnd | None) -> bool:
    """Whether two ends are held in the same way, wherever they are."""
    if now is before:
        return True
    if type(now) is not Grip or type(before) is not Grip:
        return False
    return now.curvature is before.curvature and now.kind == before.kind


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


def _solve(problem: Problem, memory: Array, order: int) -> CableShape:
    began = perf_counter()
    model = "gradient4" if order == 4 else "gradient6"
    constants: _Constants | None = problem.cache.get(model)
    if constants is None:
        constants = problem.cache[model] = _Constants(problem, order)
    constants.hold(problem)
    start, end = problem.start, problem.end
    near = start.cable_frame.array
    far = end.cable_frame.array if type(end) is Grip else _NOWHERE
    buffer = np.empty(NUMBERS_PER_POINT * problem.points)
    code = kernel.solve(near, far, constants.held, constants.numbers, memory, buffer)
    iterations, residual, error, energy, roll, chord = memory[: kernel.RESAMPLING].tolist()
    if constants.carried:
        energy -= float(constants.at_start @ near[:3])
        if far is not _NOWHERE:
            energy -= float(constants.at_end @ far[:3])
    estimate: float | Callable[[Array], float] = error
    if code == FOUND and error <= problem.tolerance:
        status, detail, estimate = _OK, "", rod_distance(problem, error)
    else:
        status, detail = _verdict(code, problem, chord, error)
    return CableShape(
        buffer,
        problem.points,
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
