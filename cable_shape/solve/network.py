"""What the solver of networks keeps from one solve to the next: mesh, the last two solutions, work space."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import rod_mesh
from cable_shape.kernels.network import drive, guess, material, respond, tables
from cable_shape.kernels.network.drive import I_ESTIMATE, I_TURN, INFO, LARGEST_TURN
from cable_shape.kernels.network.tables import BEFORE, NOW, TRIAL
from cable_shape.kernels.rod_guess import hanging_force, tangent
from cable_shape.pose import FreeEnd, Grip
from cable_shape.problem import NAMED_TOLERANCE, Problem
from cable_shape.shape import CableShape
from cable_shape.solve.cables import AT, Structure, material_of, shared_loads, structure_of
from cable_shape.solve.mesh import Piece, indicated, interpolated, layered
from cable_shape.solve.plan import Whole, make_plan

_IDENTITY = (0.0, 0.0, 0.0, 1.0)
_NO_LOADS: Array = np.empty((0, 7))
_NOTHING: Array = np.zeros(3)

#: Elements of a cable between two grips, of a span between knots, and of a whole network.
FEWEST_ELEMENTS, FEWEST_OF_SPAN, MOST_ELEMENTS = 8, 4, 1200
#: A new mesh aims at this fraction of the tolerance.
AIM = 0.9
#: A mesh is made coarser when its error is below this fraction of the tolerance.
_TOO_FINE = 1.0 / 40.0
#: Modes softer than this fraction of the stiffness / length^2 count as neutral, and neutral as stable.
_NEUTRAL = 1e-4
#: A frame may turn so far [rad] from its prediction whatever the supports do: predictions are not exact.
_UNMOVED = 0.2
#: Rotation of an element [rad] that a new mesh aims at.
TURN_AIM = 0.55
#: A mesh is changed at most as for an error so many times off.
_MOST_EXCESS = 700.0
#: Points at which the density of a span's first mesh is given.
_ABSCISSAE = 65
#: Points of a shape that is worth starting from.
_FEWEST_POINTS = 20
#: Change of a cable's length, as a fraction, beyond which the last solution is no start.
_LENGTHENED = 0.02

_structure = lru_cache(maxsize=256)(structure_of)


class _Layout(NamedTuple):
    """Where things are in the arrays of a structure with so many elements in each span; shared, never written to."""

    ints: Whole
    floats: Array  # a model in which supports are told, and nothing of the cable
    size: int  # of one solution
    work: int
    runs: list[tuple[int, int]]  # first and last node of each span
    s: slice
    force: slice
    moment: slice  # of the last knot
    heavy: slice
    breaks: slice
    piece: slice
    at: slice
    act: slice
    pose: slice  # of the trial


@lru_cache(maxsize=256)
def _layout(structure: Structure, counts: tuple[int, ...]) -> _Layout:
    """The layout of a structure with so many elements in each span."""
    ints = make_plan(structure.knots, structure.spans, structure.cables, counts, structure.rings)
    floats = np.zeros(tables.model_size.py_func(ints))
    model = tables.model_of.py_func(ints, floats)
    model.free[...], model.frame[...], model.loose[...] = structure.free, _IDENTITY, structure.loose
    size = int(tables.solution_size.py_func(ints))
    sols = np.zeros(3 * size)
    trial = tables.solution_of.py_func(ints, sols, TRIAL)
    first = np.concatenate(([0], np.cumsum(counts))).tolist()
    runs = [(a + j, b + j) for j, (a, b) in enumerate(pairwise(first))]
    return _Layout(
        ints,
        floats,
        size,
        int(tables.work_size.py_func(ints)),
        runs,
        s=_place(model.s, floats),
        force=_place(model.force, floats),
        moment=_place(model.moment[-1], floats),
        heavy=_place(model.heavy, floats),
        breaks=_place(model.breaks, floats),
        piece=_place(model.piece, floats),
        at=_place(model.at, floats),
        act=_place(model.act, floats),
        pose=_place(trial.pose, sols),
    )


def _place(part: Array, whole: Array) -> slice:
    """Where a part of a flat array is in it."""
    start = (part.ctypes.data - whole.ctypes.data) // whole.itemsize
    return slice(start, start + part.size)


@final
class Network:
    """The solver's memory for one cable, in clips or not; one object a predictor, not shared between threads.

    `history` tells how many solutions there are to start from (0: none); `last`, a shape of the same cable held in
    other clips, is then the next best. What the arrays hold: :mod:`cable_shape.kernels.network.tables`.
    """

    def __init__(self, problem: Problem, last: CableShape | None = None) -> None:
        self.last = last
        self.history = self.elements = 0
        self.factored = False  # whether `work` has factors at, or next to, the last solution
        self.fewest = 0  # elements with which a coarser mesh has failed
        self.info: Array = np.zeros(INFO + 2)
        self.structure: Structure
        self.rolls = False  # a dead moment on the free end may twist a start that does not hold its roll
        self.at_rest = math.inf  # rad, by which frames may turn though no support moves
        self.counts: tuple[int, ...] = ()
        self.layout: _Layout
        self.ints: Any = None
        self._model: tables.Model | None = None
        self.floats = self.sols = self.work = self.nodes = _NOTHING
        self.length = 0.0
        self._stiff = 1.0  # by which the cable is stiffened at present
        self._kinds: tuple[str, ...] = ()
        self._tip = self._moment = _NOTHING
        self.take(problem)

    # -- what is solved

    def take(self, problem: Problem) -> None:
        """Makes `problem` the one to solve; the last solution stays as a start if its supports are alike."""
        cable = problem.cable
        if cable.mean_bending_stiffness == 0.0:
            raise ArgumentError.of(
                "bending_stiffness",
                0.0,
                "model 'cosserat' needs it above 0 N m^2",
                "Give EI in N m^2, or choose model='catenary' and remove the clips.",
            )
        length = cable.length
        arcs = np.array((0.0, *[clip.arc_length for clip in problem.clips], length))
        self._keep(problem, arcs, length)
        self.problem, self.length, self.tolerance = problem, length, problem.tolerance
        self.arcs = arcs  # (m+1,) [m], of the supports, as they are held
        self.material, self._stiff = material_of(problem), 1.0
        self.bend = cable.mean_bending_stiffness
        stiffness = (*cable.bending_stiffness, cable.twisting_stiffness)
        self.softest, self.stiffest = min(stiffness) / length**2, max(stiffness)
        self.stretch = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
        self.elastic = cable.axial_stiffness is not None or cable.shear_stiffness is not None
        self.round_straight = stiffness[0] == stiffness[1] and self.material.straight
        self._own, self.points, self.weights = shared_loads(problem, arcs)
        self.mean_load: Array = 0.5 * (problem.load[0] + problem.load[1])
        if self.points.size:
            self.mean_load = self.mean_load + self.weights.sum(axis=0) / length
        if problem.swing is not None:
            rows = len(problem.swing)
            self.mean_load = self.mean_load - cable.linear_density * problem.swing.sum(axis=0) / (rows - 1)
        self._frames: Array = np.zeros((arcs.size, 7))
        for row, clip in zip(self._frames[1:], problem.clips, strict=False):
            row[:] = clip.pose.array
            if clip.kind in ("ball", "slide"):
                row[3:] = _IDENTITY
        self._clips = tuple(clip.kind for clip in problem.clips)
        self.spans = self.forces = arcs.size - 1
        self.rings = [i for i, kind in enumerate(self._clips, 1) if kind == "slide"]
        self._kinds = ()
        self.unsettle()

    def _keep(self, problem: Problem, arcs: Array, length: float) -> None:
        """Keeps mesh and solutions where the new problem's supports are where the old one's were.

        arcs (m+1,) takes what was found to be in the eyelets.
        """
        if self.length == 0.0:
            return
        kinds = tuple(clip.kind for clip in problem.clips)
        alike = kinds == self._clips and abs(length - self.length) <= _LENGTHENED * self.length
        if alike and kinds:
            fixed = [i for i, kind in enumerate(("", *kinds, "")) if kind != "slide"]
            alike = length == self.length and np.array_equal(arcs[fixed], self.arcs[fixed])
        if not alike:
            self.history = self.elements = 0
            return
        if self.rings:
            arcs[self.rings] = (self.bounds() if self.history else self.arcs)[self.rings]
        if self.elements and length != self.length:
            self.nodes *= length / self.length
            self.nodes[-1] = length
            self.history = min(self.history, 1)

    def aim(self, start: Grip, end: Grip | FreeEnd, trial: bool = False) -> Array:
        """Poses of the supports (m+1, 7), after what holds and loads the ends has been taken into account.

        trial: into the trial itself.
        """
        if type(end) is Grip:
            kinds = (start.kind, end.kind)
            if kinds != self._kinds:
                self._hold(kinds, _NOTHING, _NOTHING)
            poses = self.target if trial else self._frames.copy()
            poses[0], poses[-1] = start.cable_frame.array, end.cable_frame.array
        else:
            assert isinstance(end, FreeEnd)
            tip = end.mass * self.problem.end_fall + end.force
            kinds = (start.kind, "free")
            if kinds != self._kinds or not (
                np.array_equal(tip, self._tip) and np.array_equal(end.moment, self._moment)
            ):
                self._hold(kinds, tip, end.moment)
            poses = self.target if trial else self._frames.copy()
            poses[0] = poses[-1] = start.cable_frame.array
        if trial and self._clips:
            poses[1:-1] = self._frames[1:-1]
        return poses

    def _hold(self, kinds: tuple[str, ...], tip: Array, moment: Array) -> None:
        """Takes over how the ends are held and loaded."""
        self._kinds, self._tip, self._moment = kinds, tip, moment
        self.unsettle()
        pieces = len(self.material.pieces)
        all_kinds = (kinds[0], *self._clips, kinds[1])
        structure = _structure(all_kinds, pieces, self.points.size, self.round_straight)
        changed = self.elements and structure != self.structure
        self.structure = structure
        free = kinds[1] == "free" and kinds[0] in ("swivel", "pinned")
        self.rolls = bool(free and self.round_straight and not self._clips and np.any(moment))
        self.forces = self.spans - (kinds[1] == "free")
        self.stops = self._stops()
        if not self.elements:
            return
        stops = self.stops
        on = np.abs(self.nodes[:, None] - stops).min(axis=0, initial=math.inf) if stops.size else stops
        if changed or (on > AT * self.length).any():
            pieces_of = [self._as_dense(self.nodes[a : b + 1]) for a, b in self._runs()]
            self._lay_out(pieces_of, self.counts)
            self.history = min(self.history, 1)
        else:
            self._load()

    def _stops(self) -> Array:
        """(j,) [m], arc lengths inside spans that are nodes; kinks of the material are none where it runs through."""
        stops = self.material.stops
        if stops.size:
            bounds = self.arcs
            held = np.abs(stops[:, None] - bounds).min(axis=1) > AT * self.length
            span = np.searchsorted(bounds, stops) - 1
            running = {knot + side for knot in self.rings for side in (-1, 0)}
            stops = stops[held & ~np.isin(span, list(running))]
        if self.points.size == 0:
            return stops
        apart = np.abs(stops[:, None] - self.points).min(axis=1, initial=math.inf) > AT * self.length
        return np.union1d(stops[apart], self.points)

    @staticmethod
    def _as_dense(nodes: Array) -> tuple[Array, Array]:
        """Abscissae and density of a span's nodes as they are."""
        return nodes.copy(), 1.0 / np.gradient(nodes)

    def settle(self) -> None:
        """The last solution is one under these loads: from it only a motion of the supports turns frames far."""
        self.history = min(2, self.history + 1)
        self.at_rest = self.floats[tables.TURN_AT_REST] = _UNMOVED

    def unsettle(self) -> None:
        """The next solution may be far from the last one though no support moves."""
        self.at_rest = math.inf
        if self.elements:
            self.floats[tables.TURN_AT_REST] = math.inf

    # -- the mesh

    def _runs(self) -> list[tuple[int, int]]:
        """First and last node of each span."""
        return self.layout.runs

    def first_mesh(self, poses: Array, fineness: float = 1.0, turn: float = 0.0) -> None:
        """A cold start's mesh: half of each span's nodes within a few boundary layers of its ends.

        fineness: so many times the usual number of elements. turn [rad]: how far the frames turn along the cable, as
        far as that is known.
        """
        layers = self._layers(poses)
        finer = (NAMED_TOLERANCE * self.length / self.tolerance) ** (1.0 / 6.0)
        finer = fineness * min(max(finer, 0.75), 3.0)
        inside = self._stops_in(self.arcs)
        if self.spans == 1:
            layer = float(layers[0])
            elements = 16 if layer > 0.08 * self.length else 18 if layer > 0.02 * self.length else 28
            elements = max(math.ceil(elements * finer), math.ceil(1.3 * turn / TURN_AIM))
            x, density = np.empty(_ABSCISSAE), np.empty(_ABSCISSAE)
            rod_mesh.layered(self.length, min(max(layer, 1e-5 * self.length), self.length), x, density)
            pieces, counts = [(x, density)], (min(MOST_ELEMENTS, elements) + 2 * int(inside[0]),)
        else:
            pieces, shares = layered(self.arcs, layers)
            counts = tuple(np.maximum(np.ceil(finer * shares).astype(np.int64), FEWEST_OF_SPAN + 2 * inside).tolist())
        self.elements = self.history = self.fewest = 0
        self._lay_out(pieces, counts)

    def _layers(self, poses: Array) -> Array:
        """(m,) [m]: boundary layers of the spans."""
        out = np.empty(self.spans)
        force, held = np.zeros(3), np.zeros(2)
        first = last = (0.0, 0.0, 1.0)
        if self.spans == 1 and self.forces:  # bent ends take up length, and tighten what is nearly taut
            near, far = self.structure.free[0]
            held[0], held[1] = 1.0 - near[0], 1.0 - far[0]
            first, last = tangent(tuple(poses[0, 3:].tolist())), tangent(tuple(poses[1, 3:].tolist()))
        for j in range(self.spans):
            length = float(self.arcs[j + 1] - self.arcs[j])
            if j < self.forces:
                chord = poses[j + 1, :3] - poses[j, :3]
                out[j] = hanging_force(chord, self.mean_load, length, self.stretch, self.bend, first, last, held, force)
            else:
                tension = float(np.linalg.norm(self._tip + self._own[-1] + self.mean_load * length))
                out[j] = math.sqrt(self.bend / max(tension, 1e-9 * self.bend / length**2))
        return out

    def next_mesh(self, fewest: int = 0) -> bool:
        """A mesh that the last error estimate asks for, and the last solution on it; False if it cannot be finer.

        fewest: it has at least so many elements.
        """
        estimate, n = float(self.info[I_ESTIMATE]), self.elements
        excess = estimate / (AIM * self.tolerance) if math.isfinite(estimate) else _MOST_EXCESS
        excess = min(max(excess, 1.0 / _MOST_EXCESS), _MOST_EXCESS)
        errors = self.model.errors
        if not np.isfinite(errors).all():
            errors = np.ones(n)
        q = self.solution(NOW).q
        pieces, shares = indicated(self.nodes, self._runs(), q, errors, excess, TURN_AIM)
        counts = self._counts(shares, fewest)
        if estimate > self.tolerance:
            if n >= MOST_ELEMENTS:
                return False
            if counts.sum() < n + max(1, n // 20):
                counts = self._counts((n + max(1.0, 0.05 * n)) / shares.sum() * shares, fewest)
        if counts.sum() > MOST_ELEMENTS:
            counts = self._counts((MOST_ELEMENTS - self.spans) / shares.sum() * shares)
        self._lay_out(pieces, tuple(counts.tolist()))
        size = self.layout.size
        self.sols[2 * size :] = self.sols[:size]
        return True

    def _stops_in(self, bounds: Array) -> Any:
        """(m,) How many stops each span has inside."""
        if not self.stops.size:
            return np.zeros(self.spans, dtype=np.int64)
        return np.histogram(self.stops, bounds)[0]

    def _counts(self, shares: Array, fewest: int = 0) -> Any:
        """Whole numbers of elements of the spans, none too few."""
        inside = self._stops_in(self.bounds())
        least = FEWEST_ELEMENTS if self.spans == 1 else FEWEST_OF_SPAN
        if self.spans == 1:
            least = max(least, fewest)
        return np.maximum(np.ceil(shares).astype(np.int64), least + 2 * inside)

    def bounds(self) -> Array:
        """(m+1,) [m]: arc lengths of the supports as the cable runs through them now."""
        if not self.rings or not self.elements:
            return self.arcs
        return np.concatenate((self.nodes[[a for a, _ in self._runs()]], [self.length]))

    def too_coarse(self, info: list[float]) -> bool:
        """Whether the error is above its tolerance, or an element turns too far for the inertia to be trusted."""
        return info[I_ESTIMATE] > self.tolerance or info[I_TURN] > LARGEST_TURN

    def far_too_coarse(self, info: list[float]) -> bool:
        """Whether even a step on the way needs a finer mesh."""
        return info[I_ESTIMATE] > 30.0 * self.tolerance or info[I_TURN] > 2.0 * LARGEST_TURN

    def too_fine(self, info: list[float]) -> bool:
        """Whether a mesh of much fewer elements would do."""
        if info[I_ESTIMATE] >= _TOO_FINE * self.tolerance or info[I_TURN] >= 0.5 * TURN_AIM:
            return False
        least = FEWEST_ELEMENTS if self.spans == 1 else FEWEST_OF_SPAN * self.spans
        return self.elements > max(1.5 * (least + 2 * self.stops.size), self.fewest)

    def _lay_out(self, pieces: list[Piece], counts: tuple[int, ...]) -> None:
        """Nodes of equal share of each span's density, `counts` elements a span; solutions are carried over."""
        bounds = self.bounds()
        before = None
        if self.elements:
            before = self.nodes.copy(), self._runs(), [self.solution(which) for which in (NOW, BEFORE, TRIAL)]
        self.counts = counts
        self.elements = sum(counts)
        layout = _layout(self.structure, counts)
        self._take_arrays(layout, layout.floats.copy(), np.zeros(3 * layout.size), np.zeros(layout.work))
        for (a, b), (x, density), low, high in zip(layout.runs, pieces, bounds[:-1], bounds[1:], strict=True):
            x[0], x[-1] = low, high
            stops = self.stops
            if stops.size:
                stops = stops[(stops > low) & (stops < high)]
            rod_mesh.equidistribute(x, density, stops, b - a, self.nodes[a : b + 1])
        self._load()
        if before is None:
            return
        nodes, old_runs, old = before
        for which, was in zip((NOW, BEFORE, TRIAL), old, strict=True):
            now = self.solution(which)
            for (a, b), (c, d) in zip(layout.runs, old_runs, strict=True):
                now.q[a : b + 1] = interpolated(self.nodes[a : b + 1], nodes[c : d + 1], was.q[c : d + 1])
            for x, y in zip(now[1:], was[1:], strict=True):
                x[...] = y

    def _take_arrays(self, layout: _Layout, floats: Array, sols: Array, work: Array) -> None:
        """Makes these the model, the solutions and the work space."""
        self.layout, self.ints, self.floats, self.sols, self.work = layout, layout.ints, floats, sols, work
        self.nodes = floats[layout.s]
        self.target = sols[layout.pose].reshape(-1, 7)
        self._model = None

    @property
    def model(self) -> tables.Model:
        """The model's arrays by name."""
        if self._model is None:
            self._model = tables.model_of.py_func(self.ints, self.floats)
        return self._model

    def _load(self) -> None:
        """Takes over cable and loads on the mesh as it is."""
        floats, layout = self.floats, self.layout
        floats[:7] = (
            self.softest, _NEUTRAL * self.softest, self.length, self.elastic, self.stiffest, self.at_rest,
            self.stretch == 0.0,
        )  # fmt: skip
        floats[layout.heavy] = self.problem.cable.linear_density * self.problem.gravity
        floats[layout.breaks] = self.material.breaks
        floats[layout.piece] = self.material.pieces.ravel()
        floats[layout.force] = self._own.ravel()
        floats[layout.force.stop - 3 : layout.force.stop] += self._tip
        floats[layout.moment] = self._moment
        if self.points.size:
            floats[layout.at] = self.points
            floats[layout.act] = self.weights.ravel()
        drive.refill(self.ints, floats)

    # -- solutions

    def solution(self, which: int) -> tables.Solution:
        """Solution NOW, BEFORE or TRIAL."""
        found: tables.Solution = tables.solution_of.py_func(self.ints, self.sols, which)
        return found

    def put_aside(self) -> tuple[Any, ...]:
        """Mesh and solutions, for `put_back`."""
        return (self.counts, self.elements, self.layout, self.floats, self.sols, self.work, self.info.copy(),
                self.history)  # fmt: skip

    def put_back(self, kept: tuple[Any, ...]) -> None:
        """Mesh and solutions as they were when put aside; a mesh as coarse as the one now is not tried again."""
        self.counts, self.elements, layout, floats, sols, work, info, self.history = kept
        self.info[:] = info
        self._take_arrays(layout, floats, sols, work)
        self.fewest = self.elements

    def copied(self) -> Network:
        """The memory once more, sharing only the problem and the plan, which a solve does not change."""
        shared = (self.problem, self.layout, self.ints, self.last)
        other = copy.deepcopy(self, {id(part): part for part in shared if part is not None})
        other._take_arrays(other.layout, other.floats, other.sols, other.work)
        return other

    def start_from(self, poses: Array, kind: int, sag: float, turns: float = 0.0) -> None:
        """Puts a guess (see ``guess.guess``) between `poses` into the trial; turns: those that their signs are of."""
        self.target[...] = poses
        self.sols[-1] = turns
        drive.strip(self.ints, self.floats, self.sols)
        placed = np.zeros(len(poses), dtype=np.int64)
        guess.guess(self.ints, self.floats, self.sols, placed, kind, sag, turns != 0.0)

    def start_with(self, poses: Array, frames: Callable[[Array], Array], force: Array) -> None:
        """Puts given frames between `poses` into the trial; force (3,) [N]: at the end."""
        trial = self.solution(TRIAL)
        trial.pose[...] = poses
        trial.turns[0] = 0.0
        trial.q[...] = frames(self.nodes)
        trial.lam[...] = force
        if float(trial.q[0] @ poses[0, 3:]) * float(trial.q[-1] @ poses[-1, 3:]) < 0.0:
            trial.pose[-1, 3:] *= -1.0

    def resume(self, poses: Array) -> bool:
        """Puts the last shape in the place of the last solution, its supports where their points are; False if none."""
        shape = self.last
        if shape is None or not shape.status or shape.length != self.length or shape.points < _FEWEST_POINTS:
            return False
        self.first_mesh(poses)
        now, nodes = self.solution(NOW), self.nodes
        now.q[...] = interpolated(nodes, shape.arc_length, shape.quaternions)
        bounds = self.bounds()
        for i in range(3):
            now.pose[:, i] = np.interp(bounds, shape.arc_length, shape.positions[:, i])
        for j, (a, b) in enumerate(self._runs()):
            first = a - j
            middles = 0.5 * (nodes[a:b] + nodes[a + 1 : b + 1])
            for i in range(3):
                force = np.interp(middles, shape.arc_length, shape.force[:, i])
                now.lam[j, i] = (force - self.model.load[first : first + b - a, 3 + i]).mean()
            now.pose[j, 3:] = now.q[a]
            now.pose[j + 1, 3:] = now.q[b]
        now.turns[0] = shape.turns
        now.arc[...] = bounds[self.rings]
        self.history = 1
        return True

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
        """Arc lengths (n,) and positions (n, 3) of the nodes of the last solution."""
        work = tables.work_of.py_func(self.ints, self.work)
        positions = np.empty((self.nodes.size, 3))
        for j, (a, b) in enumerate(self._runs()):
            positions[a] = work.place[j]
            positions[a + 1 : b + 1] = work.place[j] - np.cumsum(work.first[a - j : b - j, :3], axis=0)
        return self.nodes, positions

    # -- eyelets

    def slide_to(self, arcs: Array) -> None:
        """Moves the cable through its eyelets to these arc lengths (m+1,): nodes between them are spread anew."""
        old = np.concatenate((self.bounds(), self.points))
        new = np.concatenate((arcs, self.points))
        order = np.argsort(old)
        runs = self._runs()
        self.nodes[:] = np.interp(self.nodes, old[order], new[order])
        for (a, b), low, high in zip(runs, arcs[:-1], arcs[1:], strict=True):
            self.nodes[a], self.nodes[b] = low, high
        drive.refill(self.ints, self.floats)
        self.solution(TRIAL).arc[...] = arcs[self.rings]

    def predicted_arcs(self) -> Array:
        """The arc lengths of the supports, those at eyelets extrapolated along the motion of the supports."""
        arcs = self.bounds().copy()
        if self.history > 1:
            a = drive.pace_of(self.ints, self.floats, self.sols)
            arcs[self.rings] += a * (self.solution(NOW).arc - self.solution(BEFORE).arc)
        return arcs

    @property
    def turns(self) -> float:
        """Turns of the trial."""
        return float(self.sols[-1]) if self.elements else 0.0

    @property
    def roll(self) -> int:
        """The support against which the end's turns are counted."""
        return self.structure.cables[0].roll[0]

    @property
    def neutral(self) -> float:
        """[N], eigenvalues smaller than this count as zero."""
        return _NEUTRAL * self.softest

    def stiffen(self, factor: float) -> None:
        """Makes the cable so many times as stiff as it is."""
        pieces = self.material.pieces.copy()
        pieces[:, : material.COMPLIANCE] *= self._factor(factor)
        self.material = self.material._replace(pieces=pieces)
        if self.elements:
            self._load()

    def _factor(self, factor: float) -> Array:
        """(18,): what the columns of the pieces are multiplied with to have the bending stiffness times `factor`."""
        out = np.ones(material.COMPLIANCE)
        out[material.K_LEFT : material.K_LEFT + 3] = out[material.K_RIGHT : material.K_RIGHT + 3] = factor / self._stiff
        self._stiff = factor
        return out

    def refresh(self) -> None:
        """Factors the matrix of the last solution."""
        self.factored = True
        respond.refresh(self.ints, self.floats, self.sols, self.work, True)

    def smallest_eigenvalue(self) -> float:
        """[N], of the last solution's second variation."""
        self.factored = False  # but at a shift
        return float(respond.smallest_eigenvalue(self.ints, self.floats, self.sols, self.work))

    def pulls(self, points: int = 0) -> tuple[Array, Array, Array]:
        """F . d3 of the eyelets (e,) [N], its derivative in the arc lengths there (e, e), and that of the positions
        (points, 3, e). Needs `refresh`."""
        e = len(self.rings)
        f, J, out = np.empty(e), np.empty((e, e)), np.empty((points, 3, e))
        jumps = np.empty((self.spans, 3))
        respond.eyelets(self.ints, self.floats, self.sols, self.work, f, J, points, out, jumps)
        return f, J, out

    @property
    def poses(self) -> Array:
        """(m+1, 7): the supports of the last solution, quaternion signs continuous."""
        return self.solution(NOW).pose
