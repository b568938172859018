"""What the rod solver keeps from one solve to the next: mesh, the last two solutions, work space."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import rod_drive, rod_guess, rod_mesh
from cable_shape.kernels.rod_work import work_size
from cable_shape.pose import FreeEnd, Grip
from cable_shape.problem import Problem

#: Rotations of the cable frame that an end leaves free: about d1, d2, d3.
_FREE_ROTATIONS = {"clamped": (0.0, 0.0, 0.0), "swivel": (0.0, 0.0, 1.0), "pinned": (1.0, 1.0, 1.0)}
_FREE_END = (1.0, 1.0, 1.0)

FEWEST_ELEMENTS, MOST_ELEMENTS = 14, 600
#: A new mesh aims at this fraction of the tolerance.
AIM = 0.9
#: Loads nearer to an end than this fraction of the length are carried by the end.
_AT_END = 1e-9
#: A mesh is made coarser when its error is below this fraction of the tolerance.
_TOO_FINE = 1.0 / 60.0
#: Modes softer than this fraction of the stiffness / length^2 count as neutral, and neutral as stable.
_NEUTRAL = 1e-4
#: Rotation of an element [rad] that a new mesh aims at.
_TURN_AIM = 0.5
#: Points at which the density of the first mesh is given.
_ABSCISSAE = 129


@final
class RodState:
    """The solver's memory for one cable; one object a predictor, not shared between threads.

    `history` tells how many solutions there are to start from (0: cold). All arrays that the compiled solver needs are
    packed into five flat ones, see :mod:`cable_shape.kernels.rod_drive`.
    """

    def __init__(self, problem: Problem) -> None:
        self.history = 0
        self.elements = 0
        self.width = 0
        self.info: Array = np.zeros(rod_drive.INFO)
        self.par: Array = np.zeros(rod_drive.PAR)
        self.mesh: Array = np.empty(0)
        self.sol: Array = np.empty(0)
        self.work: Array = np.empty(0)
        self.target: Array = np.empty(0)  # (15,) start, end, turns of the trial
        self._kinds = ("", "")
        self._tip: Array = np.zeros(3)
        self.take(problem)

    def take(self, problem: Problem) -> None:
        """Makes `problem` the one to solve; frames stay as a start if the length is the same."""
        cable = problem.cable
        if cable.mean_bending_stiffness == 0.0:
            raise ArgumentError.of(
                "bending_stiffness",
                0.0,
                "model 'cosserat' needs it above 0 N m^2",
                "Give EI in N m^2, or choose model='catenary'.",
            )
        par = self.par
        if par[19] != cable.length:
            self.history = self.elements = 0
        self.problem = problem
        par[0:2] = cable.bending_stiffness
        par[2] = cable.twisting_stiffness
        par[3:5] = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
        par[5] = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
        par[15:18] = cable.linear_density * problem.gravity
        par[19] = cable.length
        par[18] = _NEUTRAL * min(par[:3]) / cable.length**2
        self.bend = cable.mean_bending_stiffness
        self.table: Array = np.atleast_2d(cable.rest_curvature)
        at_end = problem.load_arc_length >= cable.length * (1.0 - _AT_END)
        inside = ~at_end & (problem.load_arc_length > cable.length * _AT_END)
        self.points: Array = problem.load_arc_length[inside]
        self.weights: Array = np.ascontiguousarray(problem.load_force[inside])
        self.end_weight: Array = problem.load_force[at_end].sum(axis=0)
        self.stops: Array = np.unique(self.points)
        self._kinds = ("", "")

    def aim(self, start: Grip, end: Grip | FreeEnd) -> Array:
        """The ends as (15,), after what holds them has been taken into account."""
        ends = np.zeros(15)
        ends[:7] = start.cable_frame.array
        if type(end) is Grip:
            ends[7:14] = end.cable_frame.array
            kinds = (start.kind, end.kind)
            if kinds != self._kinds:
                self._hold(kinds, np.zeros(3), np.zeros(3))
        else:
            assert isinstance(end, FreeEnd)
            ends[10:14] = ends[3:7]
            tip = end.mass * self.problem.gravity + end.force + self.end_weight
            kinds = (start.kind, "free")
            if kinds != self._kinds or not np.array_equal(tip, self._tip):
                self._hold(kinds, tip, end.moment)
            self.par[6:9] = end.moment
        return ends

    def _hold(self, kinds: tuple[str, str], tip: Array, moment: Array) -> None:
        """Takes over how the ends are held and loaded."""
        par = self.par
        before = self.width
        self._kinds, self._tip = kinds, tip
        self.width = 1 if kinds[1] == "free" else 4
        par[6:9] = moment
        par[9:12] = _FREE_ROTATIONS[kinds[0]]
        par[12:15] = _FREE_ROTATIONS.get(kinds[1], _FREE_END)
        if par[11] and par[14] and par[0] == par[1] and not self.table.any():
            par[11] = 0.0  # nothing holds the roll of a round straight cable: it would be a zero mode
        if self.elements:
            nodes = self.mesh[: self.elements + 1].copy()
            self._lay_out(nodes, 1.0 / np.gradient(nodes), self.elements)
            if before != self.width:
                self.history = min(self.history, 1)

    def first_mesh(self, layer: float, turn: float = 0.0) -> None:
        """A cold start's mesh: half of the nodes within a few boundary layers [m] of the ends.

        turn [rad]: how far the frames turn along the cable, as far as that is known.
        """
        length = self.par[19]
        elements = 28 if layer > 0.1 * length else 36 if layer > 0.02 * length else 48
        elements = min(MOST_ELEMENTS, max(elements, math.ceil(1.3 * turn / _TURN_AIM)))
        x, density = np.empty(_ABSCISSAE), np.empty(_ABSCISSAE)
        rod_mesh.layered(length, min(max(layer, 1e-5 * length), length), x, density)
        self.elements = self.history = 0
        self._lay_out(x, density, elements + 2 * self.stops.size)

    def next_mesh(self) -> bool:
        """A mesh that the last error estimate asks for, and the last solution on it; False if it cannot be finer."""
        estimate, n = self.info[7], self.elements
        factor = 3.0
        if math.isfinite(estimate):
            factor = 1.05 * (estimate / (AIM * self.problem.tolerance)) ** 0.25
            factor = min(3.0, max(factor, self.info[13] / _TURN_AIM))
        elements = min(MOST_ELEMENTS, max(FEWEST_ELEMENTS + 2 * self.stops.size, math.ceil(n * factor)))
        if elements == n:
            if n == MOST_ELEMENTS or factor <= 1.0:
                return False
            elements += 1
        x, density = np.empty(n + 2), np.empty(n + 2)
        rod_mesh.indicated(self.mesh[: n + 1], self.mesh[20 * n + 1 :], x, density)
        self._lay_out(x, density, elements)
        size = rod_drive.slot_size(elements)
        self.sol[2 * size :] = self.sol[:size]
        return True

    def too_coarse(self) -> bool:
        """Whether the error is above its tolerance, or an element turns too far for the inertia to be trusted."""
        return bool(self.info[7] > self.problem.tolerance or self.info[13] > rod_drive.LARGEST_TURN)

    def far_too_coarse(self) -> bool:
        """Whether even a step on the way needs a finer mesh."""
        return bool(self.info[7] > 30.0 * self.problem.tolerance or self.info[13] > 2.0 * rod_drive.LARGEST_TURN)

    def too_fine(self) -> bool:
        """Whether a mesh of half as many elements would do."""
        return bool(
            self.info[7] < _TOO_FINE * self.problem.tolerance
            and self.info[13] < 0.5 * _TURN_AIM
            and self.elements > 2 * (FEWEST_ELEMENTS + 2 * self.stops.size)
        )

    def _lay_out(self, x: Array, density: Array, elements: int) -> None:
        mesh = np.zeros(rod_drive.mesh_size(elements))
        loads = (self.problem.load, self.points, self.weights, self._tip, self.table)
        rod_drive.lay_out(mesh, elements, x, density, self.stops, *loads)
        sol = np.zeros(3 * rod_drive.slot_size(elements))
        if self.elements:
            old = self.mesh[: self.elements + 1]
            rod_drive.carry_over(old, self.sol, self.elements, mesh[: elements + 1], sol, elements)
        self.mesh, self.sol, self.elements = mesh, sol, elements
        self.target = sol[-15:]
        self.work = np.zeros(work_size(elements, self.width))

    @property
    def ends(self) -> Array:
        """(15,) start, end and turns of the last solution, quaternion signs continuous."""
        size = rod_drive.slot_size(self.elements)
        return self.sol[size - 15 : size]

    def hanging(self, ends: Array) -> tuple[Array, Array, float]:
        """Mean load [N/m], force of the hanging guess at the end [N], boundary layer [m]."""
        par, length = self.par, float(self.par[19])
        load = self.problem.load.mean(axis=0) + self.weights.sum(axis=0) / length
        force = np.zeros(3)
        if self.width == 1:
            tension = float(np.linalg.norm(load * length + self._tip))
            return load, force, math.sqrt(self.bend / max(tension, 1e-9 * self.bend / length**2))
        frames = (ends[3:7], ends[10:14])
        t0, t1 = (rod_guess.tangent(tuple(q.tolist())) for q in frames)
        held = np.array((1.0 - par[9], 1.0 - par[12]))
        span = ends[7:10] - ends[:3]
        layer = rod_guess.hanging_force(span, load, length, float(par[5]), self.bend, t0, t1, held, force)
        return load, force, layer

    def start_from(self, ends: Array, load: Array, force: Array, kind: int, sag: float) -> None:
        """Puts a guess (see ``rod_drive.guess``) between `ends` into the trial."""
        self.target[:] = ends
        span = ends[7:10] - ends[:3]
        rod_drive.guess(self.par, self.mesh, self.sol, self.elements, span, load, force, kind, sag)

    def start_with(self, ends: Array, frames: Callable[[Array], Array], force: Array) -> None:
        """Puts given frames (see ``cosserat.solve_beside``) between `ends` into the trial."""
        nodes = self.elements + 1
        q = frames(self.mesh[:nodes])
        trial = self.sol[2 * rod_drive.slot_size(self.elements) :]
        trial[: 4 * nodes] = q.ravel()
        trial[4 * nodes : 4 * nodes + 3] = force
        self.target[:] = ends
        if float(q[0] @ ends[3:7]) * float(q[-1] @ ends[10:14]) < 0.0:
            self.target[10:14] *= -1.0

    def energy_of_masses(self) -> float:
        """[J], potential energy of point masses and of a plug in the last solution."""
        problem, energy = self.problem, 0.0
        if not problem.masses and (type(problem.end) is Grip or problem.end.mass == 0.0):
            return 0.0
        nodes, positions = self.node_positions()
        for mass in problem.masses:
            node = int(np.abs(nodes - mass.arc_length).argmin())
            energy -= mass.mass * float(problem.gravity @ positions[node])
        if isinstance(problem.end, FreeEnd):
            energy -= problem.end.mass * float(problem.gravity @ positions[-1])
        return energy

    def node_positions(self) -> tuple[Array, Array]:
        """Arc lengths (N+1,) and positions (N+1, 3) of the nodes of the last solution."""
        positions = np.empty((self.elements + 1, 3))
        positions[0] = self.ends[:3]
        positions[1:] = positions[0] - np.cumsum(rod_drive.steps(self.work, self.elements, self.width)[:, :3], axis=0)
        return self.mesh[: self.elements + 1], positions
