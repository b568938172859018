"""What contact between cables keeps of each from one solve to the next: mesh, the last two solutions, work space."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels import rod_mesh, span_drive, span_guess, span_slide, span_stability, span_work
from cable_shape.kernels.network.drive import LARGEST_TURN
from cable_shape.kernels.span_drive import ESTIMATE, INFO, TURN
from cable_shape.kernels.span_factor import PLACE
from cable_shape.kernels.span_work import BEFORE, NOW, TRIAL
from cable_shape.pose import FreeEnd, Grip
from cable_shape.problem import NAMED_TOLERANCE, Problem
from cable_shape.shape import CableShape
from cable_shape.solve.mesh import Piece, indicated, interpolated, layered

#: Rotations of the cable frame that a grip or a clip leaves free: about d1, d2, d3.
_FREE_ROTATIONS = {
    "clamped": (0.0, 0.0, 0.0),
    "fixed": (0.0, 0.0, 0.0),
    "swivel": (0.0, 0.0, 1.0),
    "hinge": (0.0, 0.0, 1.0),
    "pinned": (1.0, 1.0, 1.0),
    "ball": (1.0, 1.0, 1.0),
    "slide": (1.0, 1.0, 1.0),
    "free": (1.0, 1.0, 1.0),
}
_IDENTITY = (0.0, 0.0, 0.0, 1.0)

#: Elements of a span, and of the whole cable.
FEWEST_ELEMENTS, MOST_ELEMENTS = 4, 1200
AIM = 0.9  #: a new mesh aims at this fraction of the tolerance
_TOO_FINE = 1.0 / 40.0  #: a mesh is made coarser when its error is below this fraction of the tolerance
_NEUTRAL = 1e-4  #: modes softer than this fraction of the stiffness / length^2 count as neutral, and neutral as stable
TURN_AIM = 0.55  #: rotation of an element [rad] that a new mesh aims at
_MOST_EXCESS = 700.0  #: a mesh is changed at most as for an error so many times off
_FEWEST_POINTS = 20  #: of a shape that is worth starting from
_AT = 1e-9  #: loads nearer to an end or a clip than this fraction of the length are carried by it


@final
class SpanState:
    """The solver's memory for one cable in clips; one object a predictor, not shared between threads.

    `history` tells how many solutions there are to start from (0: none); `last`, a shape of the same cable, held in
    other clips or in none, is then the next best. The arrays of the compiled solver are described in
    :mod:`cable_shape.kernels.span_work` and :mod:`cable_shape.kernels.span_factor`.
    """

    def __init__(self, problem: Problem, last: CableShape | None = None) -> None:
        self.last = last
        self.history = 0
        self.elements = self.spans = self.forces = self.roll = 0
        self.info: Array = np.zeros(INFO)
        self.par: Array = np.zeros(span_drive.PAR)
        self.mesh: Array = np.empty(0)
        self.sol: Array = np.empty(0)
        self.work: Array = np.empty(0)
        self.where: Any = np.empty(0, dtype=np.int64)
        self.mask: Array = np.empty((0, 3))
        self.place: Array = np.empty((0, PLACE))
        self.arcs: Array = np.empty(0)  # (m+1,) [m], of the supports
        self.stops: Array = np.empty(0)  # (k,) [m], other arc lengths where the force jumps
        self.frames: Array = np.empty(0)  # (m+1, 7) and turns (1,) of the last solution, quaternion signs continuous
        self.turns: Array = np.empty(0)
        self.target: Array = np.empty(0)  # (m+1, 7) of the trial
        self.rings: Any = np.empty(0, dtype=np.int64)  # the supports that are eyelets
        self.knots: Any = np.empty(0, dtype=np.int64)  # nodes of the supports and of the stops
        self.fewest = 0  # elements with which a coarser mesh has failed
        self._kinds: tuple[str, ...] = ()
        self._ends = ("", "")
        self._tip: Array = np.zeros(3)
        self.take(problem)

    def take(self, problem: Problem) -> None:
        """Makes `problem` the one to solve; the last solution stays as a start if its clips are alike."""
        cable, par = problem.cable, self.par
        if cable.mean_bending_stiffness == 0.0:
            raise ArgumentError.of(
                "bending_stiffness",
                0.0,
                "a cable in clips needs it above 0 N m^2",
                "Give EI in N m^2, or remove the clips and choose model='catenary'.",
            )
        length = cable.length
        arcs = np.array((0.0, *(clip.arc_length for clip in problem.clips), length))
        rings = np.array([1 + i for i, clip in enumerate(problem.clips) if clip.kind == "slide"], dtype=np.int64)
        at, weight = problem.load_arc_length.copy(), problem.load_force
        for arc in arcs:
            at[np.abs(at - arc) < _AT * length] = arc
        stops = np.setdiff1d(at, arcs)
        alike = par[13] == length and arcs.size == self.arcs.size and np.array_equal(rings, self.rings)
        if alike:
            arcs[rings] = self.arcs[rings]  # what is in an eyelet was found
        if not (alike and np.array_equal(arcs, self.arcs) and np.array_equal(stops, self.stops)):
            self.history = self.elements = 0
        self.problem = problem
        self.arcs, self.rings, self.stops, self.spans = arcs, rings, stops, arcs.size - 1
        par[0:2] = cable.bending_stiffness
        par[2] = cable.twisting_stiffness
        par[3:5] = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
        par[5] = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
        par[9:12] = cable.linear_density * problem.gravity
        par[12] = _NEUTRAL * min(par[:3]) / length**2
        par[13] = length
        self.bend = cable.mean_bending_stiffness
        self.table: Array = np.atleast_2d(cable.rest_curvature)  # (r, 3) [1/m], as `acts` for `span_slide`
        inside = (at > 0.0) & (at < length)
        self.points: Array = at[inside]
        self.weights: Array = np.ascontiguousarray(weight[inside])
        self.end_weight: Array = weight[at == length].sum(axis=0)
        self.place = np.zeros((arcs.size, PLACE))
        self._frames = np.zeros((arcs.size, 7))
        for row, clip in zip(self._frames[1:], problem.clips, strict=False):
            row[:] = clip.pose.array
            if clip.kind in ("ball", "slide"):
                row[3:] = _IDENTITY
        self._ends = ("", "")

    def aim(self, start: Grip, end: Grip | FreeEnd) -> Array:
        """The frames of the supports (m+1, 7), after what holds the ends has been taken into account."""
        frames = self._frames.copy()
        frames[0] = start.cable_frame.array
        if type(end) is Grip:
            frames[-1] = end.cable_frame.array
            if (start.kind, end.kind) != self._ends:
                self._hold(start.kind, end.kind, np.zeros(3), np.zeros(3))
        else:
            assert isinstance(end, FreeEnd)
            frames[-1] = frames[0]
            tip = end.mass * self.problem.end_fall + end.force + self.end_weight
            self._hold(start.kind, "free", tip, end.moment)
        return frames

    def _hold(self, start: str, end: str, tip: Array, moment: Array) -> None:
        """Takes over how the supports hold the cable, and the load on a free end."""
        self.par[6:9] = moment
        kinds = (start, *(clip.kind for clip in self.problem.clips), end)
        if (start, end) == self._ends and kinds == self._kinds and (tip == self._tip).all():
            return
        self._ends = (start, end)
        if self.elements and kinds != self._kinds:
            self.history = min(self.history, 1)
            q = span_work.slot(self.sol, self.elements, self.spans, NOW)[0]
            self.frames[:, 3:] = q[self.where]
        self._kinds, self._tip = kinds, tip
        self.forces = self.spans - (end == "free")
        self.mask = np.array([_FREE_ROTATIONS[kind] for kind in kinds])
        held = np.flatnonzero(self.mask[:-1, 2] == 0.0)
        self.roll = int(held[-1]) if held.size else 0
        if self.mask[:, 2].all() and self.par[0] == self.par[1] and not self.table.any():
            self.mask[0, 2] = 0.0  # nothing holds the roll of a round straight cable: it would be a zero mode
        if self.elements:
            self._load(self.nodes)

    # -- the mesh

    @property
    def nodes(self) -> Array:
        """(N+1,) [m], arc lengths."""
        return self.mesh[: self.elements + 1]

    def first_mesh(self, frames: Array, fineness: float = 1.0) -> None:
        """A cold start's mesh: half of each span's nodes within a few boundary layers [m] of its ends.

        fineness: so many times the usual number of elements.
        """
        load = self.problem.load.mean(axis=0) + self.weights.sum(axis=0) / self.par[13]
        layers = np.empty(self.spans)
        force = np.zeros(3)
        for j, length in enumerate(np.diff(self.arcs)):
            if j < self.forces:
                chord = frames[j + 1, :3] - frames[j, :3]
                layers[j] = span_guess.layer_of(self.par, chord, load, length, force)
            else:
                tension = float(np.linalg.norm(self._tip + load * length))
                layers[j] = math.sqrt(self.bend / max(tension, 1e-9 * self.bend / length**2))
        pieces, shares = layered(self.arcs, layers)
        finer = (NAMED_TOLERANCE * self.par[13] / self.problem.tolerance) ** (1.0 / 6.0)
        self.elements = self.history = self.fewest = 0
        self._lay_out(pieces, self._counts(fineness * min(max(finer, 0.75), 3.0) * shares))

    def next_mesh(self) -> bool:
        """A mesh that the last error estimate asks for, and the last solution on it; False if it cannot be finer."""
        estimate, n, tolerance = float(self.info[ESTIMATE]), self.elements, self.problem.tolerance
        excess = estimate / (AIM * tolerance) if math.isfinite(estimate) else _MOST_EXCESS
        excess = min(max(excess, 1.0 / _MOST_EXCESS), _MOST_EXCESS)
        q = span_work.slot(self.sol, n, self.spans, NOW)[0]
        errors = span_work.mesh_parts(self.mesh, n)[4]
        if not np.isfinite(errors).all():
            errors = np.ones(n)
        pieces, shares = indicated(self.nodes, list(pairwise(self.where)), q, errors, excess, TURN_AIM)
        counts = self._counts(shares)
        if estimate > tolerance:
            if n >= MOST_ELEMENTS:
                return False
            if counts.sum() < 1.1 * n:
                counts = self._counts(1.1 * n / shares.sum() * shares)
        if counts.sum() > MOST_ELEMENTS:
            counts = self._counts((MOST_ELEMENTS - self.spans) / shares.sum() * shares)
        self._lay_out(pieces, counts)
        size = span_work.slot_size(self.elements, self.spans)
        self.sol[2 * size :] = self.sol[:size]
        return True

    def too_coarse(self, info: list[float]) -> bool:
        """Whether the error is above its tolerance, or an element turns too far for the inertia to be trusted."""
        return info[ESTIMATE] > self.problem.tolerance or info[TURN] > LARGEST_TURN

    def far_too_coarse(self, info: list[float]) -> bool:
        """Whether even a step on the way needs a finer mesh."""
        return info[ESTIMATE] > 30.0 * self.problem.tolerance or info[TURN] > 2.0 * LARGEST_TURN

    def too_fine(self, info: list[float]) -> bool:
        """Whether a mesh of much fewer elements would do."""
        return (
            info[ESTIMATE] < _TOO_FINE * self.problem.tolerance
            and info[TURN] < 0.5 * TURN_AIM
            and self.elements > max(1.5 * (FEWEST_ELEMENTS * self.spans + 2 * self.stops.size), self.fewest)
        )

    def _counts(self, shares: Array) -> Any:
        """Whole numbers of elements of the spans, none too few."""
        inside = np.histogram(self.stops, self.arcs)[0]
        return np.maximum(np.ceil(shares).astype(np.int64), FEWEST_ELEMENTS + 2 * inside)

    def _lay_out(self, pieces: list[Piece], counts: Array) -> None:
        """Nodes of equal share of each span's density, `counts` elements a span; solutions are carried over."""
        old_nodes, old, n_old = self.nodes.copy(), self.sol, self.elements
        n = int(counts.sum())
        nodes = np.empty(n + 1)
        self.where = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(counts)))
        for j, (x, density) in enumerate(pieces):
            a, b = self.where[j], self.where[j + 1]
            x[0], x[-1] = self.arcs[j], self.arcs[j + 1]
            stops = self.stops[(self.stops > x[0]) & (self.stops < x[-1])]
            rod_mesh.equidistribute(x, density, stops, counts[j], nodes[a : b + 1])
        self.elements = n
        self.knots = np.union1d(self.where, np.searchsorted(nodes, self.stops))
        self.mesh = np.zeros(span_work.mesh_size(n))
        self.sol = np.zeros(3 * span_work.slot_size(n, self.spans))
        self.work = np.zeros(span_work.work_size(n, self.spans))
        self._load(nodes)
        self._part()
        if n_old:
            for which in (NOW, BEFORE, TRIAL):
                q, *others = span_work.slot(old, n_old, self.spans, which)
                q_new, *others_new = span_work.slot(self.sol, n, self.spans, which)
                q_new[:] = interpolated(nodes, old_nodes, q)
                for a, b in zip(others, others_new, strict=True):
                    b[:] = a
        self._trial_arcs[:] = self.arcs

    def _part(self) -> None:
        """Views of the parts of the solutions."""
        n = self.elements
        _, _, self.frames, self._arcs_now, self.turns = span_work.slot(self.sol, n, self.spans, NOW)
        _, _, self.target, self._trial_arcs, self._trial_turns = span_work.slot(self.sol, n, self.spans, TRIAL)

    def _load(self, nodes: Array) -> None:
        """Puts the nodes there, and what acts on the elements between them."""
        s, h, load, rest, _ = span_work.mesh_parts(self.mesh, self.elements)
        s[:] = nodes
        self.acts = np.vstack((self.problem.load, self._tip, self.weights))
        span_slide.load_elements(s, self.acts, self.points, self.table, h, load, rest)

    # -- solutions

    def start_from(self, frames: Array, kind: int, sag: float) -> None:
        """Puts a guess (see ``span_guess.guess``) between `frames` into the trial."""
        self.target[:] = frames
        self._trial_turns[0] = 0.0
        span_guess.guess(self.par, self.mesh, self.sol, self.where, self.mask, self.elements, self.forces, kind, sag)

    def resume(self, frames: Array) -> bool:
        """Puts the last shape in the place of the last solution, its supports where their points are; False if none."""
        shape = self.last
        if shape is None or not shape.status or shape.length != self.par[13] or shape.points < _FEWEST_POINTS:
            return False
        self.first_mesh(frames)
        q, lam, _, arcs, _ = span_work.slot(self.sol, self.elements, self.spans, NOW)
        q[:] = interpolated(self.nodes, shape.arc_length, shape.quaternions)
        middles = 0.5 * (self.nodes[1:] + self.nodes[:-1])
        load = span_work.mesh_parts(self.mesh, self.elements)[2][:, 3:6]
        for i in range(3):
            force = np.interp(middles, shape.arc_length, shape.force[:, i]) - load[:, i]
            lam[:, i] = [force[a:b].mean() for a, b in pairwise(self.where)]
            self.frames[:, i] = np.interp(self.arcs, shape.arc_length, shape.positions[:, i])
        self.frames[:, 3:] = q[self.where]
        self.turns[0] = shape.turns
        arcs[:] = self.arcs
        self.history = 1
        return True

    def energy_of_masses(self) -> float:
        """[J], potential energy of point masses and of a plug in the last solution."""
        problem, energy = self.problem, 0.0
        if not problem.masses and (type(problem.end) is Grip or problem.end.mass == 0.0):
            return 0.0
        first = span_work.vectors(self.work, self.elements)[0]
        positions = np.vstack((np.zeros(3), np.cumsum(-first[:, :3], axis=0))) + self.frames[0, :3]
        for mass in problem.masses:
            node = int(np.abs(self.nodes - mass.arc_length).argmin())
            energy -= mass.mass * float(problem.gravity @ positions[node])
        if isinstance(problem.end, FreeEnd):
            energy -= problem.end.mass * float(problem.gravity @ positions[-1])
        return energy

    # -- eyelets

    def slide_to(self, arcs: Array) -> None:
        """Moves the cable through its eyelets: the nodes between them and the next stops are spread anew."""
        old = np.concatenate((self.arcs, self.stops))
        new = np.concatenate((arcs, self.stops))
        order = np.argsort(old)
        nodes = np.interp(self.nodes, old[order], new[order])
        nodes[self.where] = arcs
        self.arcs = arcs.copy()
        self._load(nodes)
        self._trial_arcs[:] = arcs

    def refresh(self) -> None:
        """Factors the matrix of the last solution."""
        span_stability.refresh(
            self.par, self.mesh, self.sol, self.work, self.where, self.mask, self.place, self.elements, self.forces
        )
