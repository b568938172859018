"""What the rod solver keeps from one solve to the next: mesh, the last two solutions, work space."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import final

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import rod_drive, rod_mesh
from cable_shape.kernels.inertia import add_inertia
from cable_shape.kernels.rod_drive import ESTIMATE, LARGEST_TURN, TURN
from cable_shape.kernels.rod_work import work_size
from cable_shape.pose import FreeEnd, Grip
from cable_shape.problem import NAMED_TOLERANCE, Problem

#: Rotations of the cable frame that an end leaves free: about d1, d2, d3.
_FREE_ROTATIONS = {"clamped": (0.0, 0.0, 0.0), "swivel": (0.0, 0.0, 1.0), "pinned": (1.0, 1.0, 1.0)}
_FREE_END = (1.0, 1.0, 1.0)

FEWEST_ELEMENTS, MOST_ELEMENTS = 8, 600
#: A new mesh aims at this fraction of the tolerance.
AIM = 0.9
#: Loads nearer to an end than this fraction of the length are carried by the end.
_AT_END = 1e-9
#: A mesh is made coarser when its error is below this fraction of the tolerance.
_TOO_FINE = 1.0 / 40.0
#: Modes softer than this fraction of the stiffness / length^2 count as neutral, and neutral as stable.
_NEUTRAL = 1e-4
#: A frame may turn so far [rad] from its prediction whatever the ends do: predictions are not exact.
_UNMOVED = 0.2
#: Rotation of an element [rad] that a new mesh aims at.
_TURN_AIM = 0.55
#: A mesh is changed at most as for an error so many times off.
_MOST_EXCESS = 700.0
#: Points at which the density of the first mesh is given.
_ABSCISSAE = 65
_NOTHING: Array = np.zeros(3)
#: Change of a cable's length, as a fraction, beyond which the last solution is no start.
_LENGTHENED = 0.02


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
        self.fewest = 0  # elements with which a coarser mesh has failed
        self.info: Array = np.zeros(rod_drive.INFO)
        self.par: Array = np.zeros(rod_drive.PAR)
        self.unsettle()
        self.mesh = self.sol = self.work = _NOTHING
        self.target: Array = _NOTHING  # (15,) start, end, turns of the trial
        self._kinds = ("", "")
        self._tip = _NOTHING
        self.take(problem)

    def take(self, problem: Problem) -> None:
        """Makes `problem` the one to solve; frames stay as a start if the length is nearly the same."""
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
            self._stretch_mesh(cable.length)
        self.problem = problem
        self.tolerance = problem.tolerance  # [m], of meshes
        shear = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
        self.stretch = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
        stiffness = (*cable.bending_stiffness, cable.twisting_stiffness)
        par[0:6] = (*stiffness, shear, shear, self.stretch)
        par[15:18] = cable.linear_density * problem.gravity
        par[18:20] = _NEUTRAL * min(stiffness) / cable.length**2, cable.length
        self.bend = cable.mean_bending_stiffness
        rest = cable.rest_curvature
        self.table: Array = rest if rest.ndim == 2 else rest.reshape(1, 3)
        self.points, self.weights, self.stops = problem.load_arc_length, problem.load_force, problem.load_arc_length
        self.end_weight: Array = _NOTHING
        self.mean_load: Array = 0.5 * (problem.load[0] + problem.load[1])
        if self.points.size:
            at_end = self.points >= cable.length * (1.0 - _AT_END)
            inside = ~at_end & (self.points > cable.length * _AT_END)
            self.end_weight = self.weights[at_end].sum(axis=0)
            self.points = self.points[inside]
            self.weights = np.ascontiguousarray(self.weights[inside])
            self.stops = np.unique(self.points)
            self.mean_load = self.mean_load + self.weights.sum(axis=0) / cable.length
        if problem.swing is not None:
            rows = len(problem.swing)
            kinks = np.linspace(0.0, cable.length, rows)[1:-1]
            # of what coincides with a mass, the mass stays: its force jumps there
            apart = np.abs(kinks[:, None] - self.points).min(axis=1, initial=math.inf) > _AT_END * cable.length
            self.stops = np.union1d(self.points, kinks[apart])
            self.mean_load = self.mean_load - cable.linear_density * problem.swing.sum(axis=0) / (rows - 1)
        self._kinds = ("", "")

    def aim(self, start: Grip, end: Grip | FreeEnd, trial: bool = False) -> Array:
        """The ends as (15,), what holds them being taken into account; if asked in place of the trial's."""
        if type(end) is Grip:
            kinds = (start.kind, end.kind)
            if kinds != self._kinds:
                self._hold(kinds, _NOTHING, _NOTHING)
            ends = self.target if trial else np.empty(15)
            ends[:7] = start.cable_frame.array
            ends[7:14] = end.cable_frame.array
            ends[14] = 0.0
            return ends
        assert isinstance(end, FreeEnd)
        tip = end.mass * self.problem.end_fall + end.force + self.end_weight
        kinds = (start.kind, "free")
        if kinds != self._kinds or not np.array_equal(tip, self._tip):
            self._hold(kinds, tip, end.moment)
        self.par[6:9] = end.moment
        ends = self.target if trial else np.empty(15)
        ends[:7] = start.cable_frame.array
        ends[7:] = 0.0
        ends[10:14] = ends[3:7]
        return ends

    def _hold(self, kinds: tuple[str, str], tip: Array, moment: Array) -> None:
        """Takes over how the ends are held and loaded."""
        par = self.par
        before = self.width
        self._kinds, self._tip = kinds, tip
        self.unsettle()
        self.width = 1 if kinds[1] == "free" else 4
        par[6:9] = moment
        par[9:12] = _FREE_ROTATIONS[kinds[0]]
        par[12:15] = _FREE_ROTATIONS.get(kinds[1], _FREE_END)
        if par[11] and par[14] and par[0] == par[1] and not self.table.any():
            par[11] = 0.0  # nothing holds the roll of a round straight cable: it would be a zero mode
        if self.elements:
            nodes = self.mesh[: self.elements + 1]
            near = np.abs(nodes[:, None] - self.stops).argmin(axis=0)
            if np.abs(nodes[near] - self.stops).max(initial=0.0) <= _AT_END * nodes[-1]:
                nodes[near] = self.stops
                self._load()
            else:
                nodes = nodes.copy()
                self._lay_out(nodes, 1.0 / np.gradient(nodes), self.elements + self.stops.size)
            if before != self.width:
                self.work = np.zeros(work_size(self.elements, self.width))
                self.history = min(self.history, 1)

    def _stretch_mesh(self, length: float) -> None:
        """Makes the cable `length` [m] long; the mesh, if it stays, goes with it."""
        n, before = self.elements, float(self.par[19])
        if n == 0 or abs(length - before) > _LENGTHENED * before:
            self.history = self.elements = 0
            return
        self.mesh[: n + 1] *= length / before
        self.mesh[n] = length
        self.history = min(self.history, 1)

    def first_mesh(self, layer: float, fineness: float = 1.0, turn: float = 0.0) -> None:
        """A cold start's mesh: half of the nodes within a few boundary layers [m] of the ends.

        fineness: so many times the usual number of elements. turn [rad]: how far the frames turn along the cable, as
        far as that is known.
        """
        length = self.problem.cable.length
        elements = 16 if layer > 0.08 * length else 18 if layer > 0.02 * length else 28
        finer = (NAMED_TOLERANCE * length / self.tolerance) ** (1.0 / 6.0)
        elements = math.ceil(elements * fineness * min(max(finer, 0.75), 3.0))
        elements = min(MOST_ELEMENTS, max(elements, math.ceil(1.3 * turn / _TURN_AIM)))
        x, density = np.empty(_ABSCISSAE), np.empty(_ABSCISSAE)
        rod_mesh.layered(length, min(max(layer, 1e-5 * length), length), x, density)
        self.elements = self.history = self.fewest = 0
        self._lay_out(x, density, elements + 2 * self.stops.size)

    def next_mesh(self, fewest: int = 0) -> bool:
        """A mesh that the last error estimate asks for, and the last solution on it; False if it cannot be finer.

        fewest: it has at least so many elements.
        """
        estimate, n = float(self.info[ESTIMATE]), self.elements
        excess = estimate / (AIM * self.tolerance) if math.isfinite(estimate) else _MOST_EXCESS
        x, density = np.empty(n + 2), np.empty(n + 2)
        nodes = self.mesh[: n + 1]
        q = self.sol[: 4 * n + 4].reshape(n + 1, 4)
        excess = min(max(excess, 1.0 / _MOST_EXCESS), _MOST_EXCESS)
        wanted = rod_mesh.indicated(nodes, q, self.mesh[20 * n + 1 :], excess, _TURN_AIM, x, density)
        elements = min(MOST_ELEMENTS, max(fewest, FEWEST_ELEMENTS + 2 * self.stops.size, math.ceil(wanted)))
        if estimate > self.tolerance:
            if n == MOST_ELEMENTS:
                return False
            elements = max(elements, min(MOST_ELEMENTS, n + 1))
        self._lay_out(x, density, elements)
        size = rod_drive.slot_size(elements)
        self.sol[2 * size :] = self.sol[:size]
        return True

    def too_coarse(self, info: list[float]) -> bool:
        """Whether the error is above its tolerance, or an element turns too far for the inertia to be trusted."""
        return info[ESTIMATE] > self.tolerance or info[TURN] > LARGEST_TURN

    def far_too_coarse(self, info: list[float]) -> bool:
        """Whether even a step on the way needs a finer mesh."""
        return info[ESTIMATE] > 30.0 * self.tolerance or info[TURN] > 2.0 * LARGEST_TURN

    def too_fine(self, info: list[float]) -> bool:
        """Whether a mesh of much fewer elements would do."""
        return (
            info[ESTIMATE] < _TOO_FINE * self.tolerance
            and info[TURN] < 0.5 * _TURN_AIM
            and self.elements > max(1.5 * (FEWEST_ELEMENTS + 2 * self.stops.size), self.fewest)
        )

    def _lay_out(self, x: Array, density: Array, elements: int) -> None:
        mesh = np.zeros(rod_drive.mesh_size(elements))
        loads = (self.problem.load, self.points, self.weights, self._tip, self.table)
        rod_drive.lay_out(mesh, elements, x, density, self.stops, *loads)
        self._add_swing(mesh, elements)
        sol = np.zeros(3 * rod_drive.slot_size(elements))
        if self.elements:
            old = self.mesh[: self.elements + 1]
            rod_drive.carry_over(old, self.sol, self.elements, mesh[: elements + 1], sol, elements)
        self.mesh, self.sol, self.elements = mesh, sol, elements
        self.target = sol[-15:]
        self.work = np.zeros(work_size(elements, self.width))

    def _load(self) -> None:
        """Takes over loads and rest curvature on the mesh as it is."""
        n = self.elements
        nodes, h = self.mesh[: n + 1], self.mesh[n + 1 : 2 * n + 1]
        load, rest = self.mesh[2 * n + 1 : 11 * n + 1].reshape(n, 9), self.mesh[11 * n + 1 : 17 * n + 1].reshape(n, 6)
        rod_mesh.element_loads(nodes, self.problem.load, self.points, self.weights, self._tip, h, load)
        rod_mesh.element_rest(nodes, self.table, rest)
        self._add_swing(self.mesh, n)

    def _add_swing(self, mesh: Array, elements: int) -> None:
        """Adds the load of an acceleration that is not linear along the cable."""
        problem = self.problem
        if problem.swing is not None:
            load = mesh[2 * elements + 1 : 11 * elements + 1].reshape(elements, 9)
            add_inertia(mesh[: elements + 1], problem.swing, problem.cable.linear_density, load)

    def settle(self) -> None:
        """The last solution is one under these loads: from it only a motion of the ends turns frames far."""
        self.history = min(2, self.history + 1)
        self.par[20] = _UNMOVED

    def unsettle(self) -> None:
        """The next solution may be far from the last one though no end moves."""
        self.par[20] = math.inf

    @property
    def ends(self) -> Array:
        """(15,) start, end and turns of the last solution, quaternion signs continuous."""
        size = rod_drive.slot_size(self.elements)
        return self.sol[size - 15 : size]

    def hanging(self, ends: Array) -> tuple[Array, float]:
        """Force of the hanging guess at the end [N], boundary layer [m]."""
        par, length = self.par, self.problem.cable.length
        force = np.zeros(3)
        if self.width == 1:
            tension = float(np.linalg.norm(self.mean_load * length + self._tip))
            return force, math.sqrt(self.bend / max(tension, 1e-9 * self.bend / length**2))
        return force, rod_drive.hang(par, ends, self.mean_load, force)

    def start_from(self, ends: Array, force: Array, kind: int, sag: float) -> None:
        """Puts a guess (see ``rod_drive.guess``) between `ends` into the trial."""
        self.target[:] = ends
        span = ends[7:10] - ends[:3]
        rod_drive.guess(self.par, self.mesh, self.sol, self.elements, span, self.mean_load, force, kind, sag)

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
